// The value and the position under the cursor, and the distance between two points.
import type { Api } from "./api";
import { button, h, section } from "./dom";
import { lengthOf } from "./geometry";
import type { StoreInfo, ValueInfo, Vector } from "./protocol";
import type { Hit, Stage } from "./stage";
import { stepOf, type ViewStore } from "./state";
import { place, short, unitOf } from "./words";

/** Finds what is under a point of the canvas: one request at a time, the newest wins. */
export class Probe {
  readonly element: HTMLElement;
  /** Ends of the measured line: none, one or two. */
  points: readonly Vector[] = [];
  measuring = false;
  /** The last result under the mouse, and its position. */
  hovered: { readonly hit: Hit | null; readonly x: number; readonly y: number } | null = null;
  value: ValueInfo | null = null;
  private wanted: readonly [number, number] | null = null;
  private busy = false;
  private readonly result = h("p", { class: "measured", id: "measured", role: "status" });
  private readonly toggle: HTMLButtonElement;

  constructor(
    private readonly api: Api,
    private readonly views: ViewStore,
    private readonly stage: Stage,
    private readonly store: StoreInfo,
    private readonly readout: HTMLElement,
    private readonly failed: (error: Error) => void,
  ) {
    this.toggle = button("Measure a distance", () => this.setMeasuring(!this.measuring), { id: "measure", "aria-pressed": "false" });
    const centre = button("Mark the middle of the picture", () => void this.markMiddle(), { id: "mark-middle" });
    const clear = button("Clear", () => this.setPoints([]), { id: "measure-clear" });
    const hint = h("p", { class: "note" }, "Click two points of a surface or slice, or press M to mark what is in the middle of the picture, and V for its value.");
    this.element = section("measuring", "Measuring", false, h("div", { class: "buttons" }, this.toggle, centre, clear), this.result, hint);
  }

  get pending(): boolean {
    return this.busy;
  }

  setMeasuring(on: boolean): void {
    this.measuring = on;
    this.toggle.setAttribute("aria-pressed", String(on));
    this.stage.canvas.classList.toggle("measuring", on);
  }

  /** The mouse is at this position, in CSS pixels from the canvas's corner. */
  hover(x: number, y: number): void {
    this.wanted = [x, y];
    void this.pump();
  }
  leave(): void {
    this.wanted = this.hovered = null;
    this.say("");
  }

  async mark(x: number, y: number): Promise<void> {
    const hit = await this.stage.pick(x, y);
    if (!hit) {
      this.result.textContent = "There is nothing to mark.";
      return;
    }
    this.setPoints(this.points.length === 1 ? [...this.points, hit.at] : [hit.at]);
  }
  markMiddle(): Promise<void> {
    return this.mark(...this.middle());
  }
  /** Reports what is in the centre of the picture, for users without a mouse. */
  async readMiddle(): Promise<void> {
    this.hover(...this.middle());
  }

  setPoints(points: readonly Vector[]): void {
    this.points = points;
    const [a, b] = points;
    this.result.textContent = !a ? "" : !b ? `From ${place(a)}. Mark the other end.` : `${short(lengthOf(a, b))} ${unitOf(this.store)}, from ${place(a)} to ${place(b)}`;
    this.stage.invalidate();
  }

  private middle(): [number, number] {
    return [this.stage.canvas.clientWidth / 2, this.stage.canvas.clientHeight / 2];
  }

  private async pump(): Promise<void> {
    if (this.busy) return;
    this.busy = true;
    try {
      while (this.wanted) {
        const [x, y] = this.wanted;
        this.wanted = null;
        const hit = await this.stage.pick(x, y);
        this.hovered = { hit, x, y };
        if (!hit) {
          this.say("");
          continue;
        }
        this.value = await this.api.value(hit.at, stepOf(this.store, this.views.state));
        this.say(`${place(hit.at)}: ${this.words(this.value)}`);
      }
    } catch (error) {
      this.failed(error as Error);
    } finally {
      this.busy = false;
    }
  }

  private words(info: ValueInfo): string {
    const others = Object.entries(info.quantities ?? {}).map(([name, value]) => `; ${name} ${value === null ? "missing" : short(value)}`);
    return this.ownWords(info) + others.join("");
  }

  private ownWords(info: ValueInfo): string {
    if (!info.inside) return "outside of the volume";
    if (this.store.labels) return info.label == null ? "no label" : `label ${info.label}${info.name ? ` (${info.name})` : ""}`;
    return info.value === null ? "no value" : `value ${short(info.value)}`;
  }

  private say(text: string): void {
    if (text === "") this.value = null;
    this.readout.textContent = text;
  }
}
