// Annotations on the picture: the world's directions, a scale bar, the measured line, a cross in the centre.
import { Vector3 } from "three";
import { h, setAttributes, svg } from "./dom";
import type { Probe } from "./probe";
import type { Stage } from "./stage";
import { lengthOf } from "./geometry";
import type { StoreInfo, Vector } from "./protocol";
import { short, unitOf } from "./words";

const kArm = 26; // pixels
const kCorner = 42;
const kBar = 90; // pixels, maximum

const kMargin = 12;
/** Of a direction's largest part: within 20 degrees of an axis. */
const kAlongAxis = 0.94;

const kOpposite: Readonly<Record<string, string>> = { R: "L", L: "R", A: "P", P: "A", H: "F", F: "H" };

/** The patient's side toward which a unit vector points: R, L, A, P, H (head) or F (feet); null if it is between two. */
export function sideToward(direction: Vector, frame: "RAS" | "LPS"): string | null {
  const axis = direction.findIndex((part) => Math.abs(part) > kAlongAxis);
  if (axis === -1) return null;
  const toward = axis === 2 ? "H" : frame.charAt(axis);
  return direction[axis]! > 0 ? toward : (kOpposite[toward] ?? null);
}

export class Overlay {
  private readonly root: SVGSVGElement;
  private readonly axes = ["x", "y", "z"].map((name) => ({
    line: svg("line", { class: `axis axis-${name}` }),
    text: svg("text", { class: "axis-name", "text-anchor": "middle", "dominant-baseline": "central" }, name),
  }));
  private readonly bar = svg("path", { class: "scale-bar" });
  private readonly barText = svg("text", { class: "scale-text", "text-anchor": "middle" });
  private readonly line = svg("line", { class: "measure-line" });
  private readonly ends = [svg("circle", { class: "measure-end", r: 4 }), svg("circle", { class: "measure-end", r: 4 })];
  private readonly lengthText = svg("text", { class: "measure-text", "text-anchor": "middle" });
  private readonly unit: string; // suffix of a length
  /** For a patient: the sides at the left, right, top and bottom of the picture. */
  private readonly sides = ["start", "end", "middle", "middle"].map((anchor) => svg("text", { class: "side-mark", "text-anchor": anchor, "dominant-baseline": "central" }));
  private readonly cross = svg("path", { class: "cross" });

  constructor(
    parent: HTMLElement,
    private readonly stage: Stage,
    private readonly probe: Probe,
    private readonly store: StoreInfo,
  ) {
    // For a patient: the side toward which each axis increases.
    this.axes.forEach(({ text }, i) => { text.textContent += store.frame ? ` ${store.frame.charAt(i)}` : ""; });
    this.unit = store.unit === null ? "" : ` ${unitOf(store)}`;
    this.root = svg("svg", { class: "overlay", "aria-hidden": "true" });
    for (const { line, text } of this.axes) this.root.append(line, text);
    this.root.append(this.bar, this.barText, this.line, ...this.ends, this.lengthText, ...this.sides, this.cross);
    parent.append(this.root);
    stage.onFrame(() => this.draw());
  }

  private draw(): void {
    const { clientWidth: width, clientHeight: height } = this.stage.canvas;
    this.root.setAttribute("viewBox", `0 0 ${Math.max(width, 1)} ${Math.max(height, 1)}`);
    this.drawAxes(height);
    this.drawBar(width, height);
    this.drawMeasured();
    this.drawSides(width, height);
    const focused = document.activeElement === this.stage.canvas && this.stage.canvas.matches(":focus-visible");
    const [x, y] = [width / 2, height / 2];
    this.cross.setAttribute("d", focused ? `M${x - 8} ${y}H${x - 2}M${x + 2} ${y}H${x + 8}M${x} ${y - 8}V${y - 2}M${x} ${y + 2}V${y + 8}` : "");
  }

  private drawAxes(height: number): void {
    const turned = this.axes.map((axis, i) => ({
      axis, at: new Vector3(i === 0 ? 1 : 0, i === 1 ? 1 : 0, i === 2 ? 1 : 0).transformDirection(this.stage.camera.matrixWorldInverse),
    }));
    const y0 = height - kCorner;
    for (const { axis, at } of turned) {
      setAttributes(axis.line, { x1: kCorner, y1: y0, x2: kCorner + kArm * at.x, y2: y0 - kArm * at.y });
      setAttributes(axis.text, { x: kCorner + (kArm + 9) * at.x, y: y0 - (kArm + 9) * at.y });
    }
  }

  /** Only in a look along an axis of the patient: in others, each side of the picture is between two of the patient's. */
  private drawSides(width: number, height: number): void {
    const { frame } = this.store;
    if (frame === null) return;
    const e = this.stage.camera.matrixWorld.elements;
    const right = sideToward([e[0]!, e[1]!, e[2]!], frame);
    const up = sideToward([e[4]!, e[5]!, e[6]!], frame);
    const names = right && up ? [kOpposite[right], right, up, kOpposite[up]] : ["", "", "", ""];
    const places = [[kMargin, height / 2], [width - kMargin, height / 2], [width / 2, kMargin + 4], [width / 2, height - kMargin - 4]];
    this.sides.forEach((text, i) => {
      text.textContent = names[i] ?? "";
      setAttributes(text, { x: places[i]![0]!, y: places[i]![1]! });
    });
  }

  /** One, two or five times a power of ten, at the depth of the camera's target. */
  private drawBar(width: number, height: number): void {
    const perPixel = this.stage.unitsPerPixel;
    const most = Math.min(kBar, width / 4) * perPixel;
    const power = 10 ** Math.floor(Math.log10(most));
    const units = Number(((most / power >= 5 ? 5 : most / power >= 2 ? 2 : 1) * power).toPrecision(1));
    const x0 = 2 * kCorner + 8;
    const x1 = x0 + units / perPixel;
    const y = height - 22;
    this.bar.setAttribute("d", `M${x0} ${y - 4}V${y}H${x1}V${y - 4}`);
    setAttributes(this.barText, { x: (x0 + x1) / 2, y: y - 8 });
    this.barText.textContent = `${short(units)}${this.unit}`;
  }

  private drawMeasured(): void {
    const { points } = this.probe;
    const places = points.map((point) => this.stage.project(point));
    this.ends.forEach((end, i) => {
      const at = places[i];
      setAttributes(end, at ? { cx: at[0], cy: at[1], visibility: "visible" } : { visibility: "hidden" });
    });
    const [a, b] = places;
    const [from, to] = points;
    const seen = a && b && from && to;
    setAttributes(this.line, seen ? { x1: a[0], y1: a[1], x2: b[0], y2: b[1], visibility: "visible" } : { visibility: "hidden" });
    this.lengthText.textContent = seen ? `${short(lengthOf(from, to))}${this.unit}` : "";
    if (seen) setAttributes(this.lengthText, { x: (a[0] + b[0]) / 2, y: (a[1] + b[1]) / 2 - 8 });
  }
}

/** The line under the picture that describes what is under the cursor. */
export function readoutLine(): HTMLElement {
  return h("output", { class: "readout", id: "readout", "aria-live": "polite" });
}
