// The histogram above the isovalue slider: the frequency of values, the amount of surface per isovalue, suggestions.
import { button, h, setAttributes, svg } from "../dom";
import type { HistogramInfo, StoreInfo } from "../protocol";
import { niceStep } from "./slider";
import type { ViewStore } from "../state";
import { short, whole } from "../words";

const kWidth = 256;
const kHeight = 72;

export class HistogramPanel {
  readonly element: HTMLElement;
  private readonly range = h("input", { type: "range", id: "iso", "aria-describedby": "iso-help" });
  private readonly number = h("input", { type: "number", id: "iso-number", step: "any", inputmode: "decimal" });
  private readonly plot = svg("svg", {
    class: "histogram", viewBox: `0 0 ${kWidth} ${kHeight}`, preserveAspectRatio: "none", role: "img", "aria-label": "Histogram: not read yet",
  });
  private readonly marks = h("div", { class: "marks", role: "group", "aria-label": "Suggested isovalues" });
  private readonly cursor = svg("line", { class: "cursor", y1: 0, y2: kHeight, "vector-effect": "non-scaling-stroke" });
  private readonly note = h("p", { class: "note", id: "iso-help" }, "Reading the values…");
  private readonly least: number;
  private readonly largest: number;

  constructor(
    private readonly views: ViewStore,
    private readonly store: StoreInfo,
  ) {
    this.least = store.min_value ?? 0;
    this.largest = store.max_value ?? 1;
    const name = store.labels ? "Label" : "Isovalue";
    setAttributes(this.range, {
      min: this.least, max: this.largest, step: niceStep(this.largest - this.least), "aria-label": name,
    });
    setAttributes(this.number, { "aria-label": `${name}, as a number`, ...(store.labels ? { step: 1 } : {}) });
    const label = h("label", { class: "iso-label", for: "iso-number" }, name);
    this.element = h(
      "div", { class: "iso" },
      h("div", { class: "iso-head" }, label, this.number),
      h("div", { class: "plot" }, this.plot), this.range, this.marks, this.note,
    );
    if (store.labels) {
      // Labels are names: neither their order nor values between them have a meaning.
      for (const element of this.element.querySelectorAll<HTMLElement>(".plot, .marks, #iso")) element.hidden = true;
      this.showLabel("");
    }
    this.range.addEventListener("input", () => views.set({ iso: this.range.valueAsNumber }));
    this.number.addEventListener("change", () => {
      if (store.labels && Math.abs(this.number.valueAsNumber) > Number.MAX_SAFE_INTEGER) {
        this.number.valueAsNumber = views.state.iso;
        this.note.textContent = "Labels beyond 2^53 cannot be selected on this page; use isonest extract --label.";
      } else if (Number.isFinite(this.number.valueAsNumber)) views.set({ iso: this.number.valueAsNumber });
      else this.number.valueAsNumber = views.state.iso;
    });
    this.plot.addEventListener("pointerdown", (event) => this.choose(event));
    this.plot.addEventListener("pointermove", (event) => {
      if (event.buttons === 1) this.choose(event);
    });
    views.subscribe((state, changed) => {
      if (!changed.has("iso")) return;
      this.range.valueAsNumber = state.iso;
      this.range.setAttribute("aria-valuetext", short(state.iso));
      if (document.activeElement !== this.number || this.number.valueAsNumber !== state.iso) this.number.valueAsNumber = store.labels ? state.iso : Number(state.iso.toPrecision(9));
      setAttributes(this.cursor, { x1: this.place(state.iso), x2: this.place(state.iso) });
    });
  }

  /** Moves by a fraction of the range; for integers by at least half a number. */
  step(part: number): void {
    if (this.store.labels) {
      this.views.set({ iso: Math.round(this.views.state.iso) + Math.sign(part) });
      return;
    }
    const least = this.store.integer ? 0.5 : 0;
    const by = Math.sign(part) * Math.max(Math.abs(part) * (this.largest - this.least), least);
    const iso = Math.min(Math.max(this.views.state.iso + by, this.least), this.largest);
    this.views.set({ iso });
  }

  /** The name of the label; empty if it has none. */
  showLabel(name: string): void {
    this.note.textContent = `${name === "" ? "The surface of this label is shown." : `The surface of ${name} is shown.`} Point at the data to see their labels.`;
  }

  fail(message: string): void {
    this.note.textContent = `There is no histogram: ${message}`;
  }

  show(info: HistogramInfo): void {
    this.plot.replaceChildren(this.bars(info), ...this.curve(info), this.cursor);
    this.marks.replaceChildren();
    for (const { isovalue } of info.suggested) {
      const mark = button("", () => this.views.set({ iso: isovalue }), { class: "mark", "aria-label": `Isovalue ${short(isovalue)}, suggested`, title: `suggested: ${short(isovalue)}` });
      mark.append(h("span", { "aria-hidden": "true" }, short(isovalue)));
      this.marks.append(mark);
      this.plot.append(svg("line", { class: "suggested", x1: this.place(isovalue), x2: this.place(isovalue), y1: 0, y2: kHeight, "vector-effect": "non-scaling-stroke" }));
    }
    const suggested = info.suggested.map(({ isovalue }) => short(isovalue)).join(", ");
    this.plot.setAttribute(
      "aria-label",
      `Histogram of values from ${short(this.least)} to ${short(this.largest)}, logarithmic, with the surface that each isovalue has. ` +
        (suggested ? `Suggested: ${suggested}.` : "No isovalue is suggested."),
    );
    const missing = info.missing > 0 ? `; ${whole(info.missing)} values are missing` : "";
    this.note.textContent =
      (info.level > 0 ? `Bars: values of every ${2 ** info.level}th node` : "Bars: values") +
      (info.cube_level === null ? ", logarithmic" : ", logarithmic; line: surface of each isovalue") + `${suggested ? "; marks: suggested" : ""}${missing}.`;
  }

  private choose(event: PointerEvent): void {
    const { left, width } = this.plot.getBoundingClientRect();
    const iso = this.least + (Math.min(Math.max(event.clientX - left, 0), width) / width) * (this.largest - this.least);
    const step = Number(this.range.step);
    this.views.set({ iso: Number((Math.round(iso / step) * step).toPrecision(9)) });
  }

  private place(value: number): number {
    const part = (value - this.least) / (this.largest - this.least || 1);
    return kWidth * Math.min(Math.max(part, 0), 1);
  }

  private bars(info: HistogramInfo): SVGPathElement {
    const most = Math.log1p(Math.max(...info.bins.map((bin) => bin.nodes), 1));
    let path = "";
    info.bins.forEach((bin, k) => {
      if (bin.nodes === 0) return;
      const left = this.place(bin.low);
      const right = this.place(info.bins[k + 1]?.low ?? info.end ?? this.largest);
      const top = kHeight * (1 - Math.max(Math.log1p(bin.nodes) / most, 0.02));
      path += `M${left.toFixed(2)} ${kHeight}V${top.toFixed(2)}H${Math.max(right, left + 0.5).toFixed(2)}V${kHeight}Z`;
    });
    return svg("path", { class: "bars", d: path });
  }

  private curve(info: HistogramInfo): SVGPathElement[] {
    const most = Math.max(...info.bins.map((bin) => bin.cubes ?? 0));
    if (most === 0) return [];
    const points = info.bins.map((bin) => `${this.place(bin.low).toFixed(2)} ${(kHeight * (1 - (0.96 * (bin.cubes ?? 0)) / most)).toFixed(2)}`);
    return [svg("path", { class: "curve", d: `M${points.join("L")}`, "vector-effect": "non-scaling-stroke" })];
  }
}
