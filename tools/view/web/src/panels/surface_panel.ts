// Options for the surface, and its current quality in plain words.
import { checkbox, h, numberField, section, select } from "../dom";
import type { StoreInfo } from "../protocol";
import type { Surface } from "../surface";
import { mayBeLabels, type Target, type ViewStore } from "../state";
import { bytes, rounding, short, sizeText, surfaceBound, unitOf, whole } from "../words";

const kTargets: readonly (readonly [Target, string])[] = [
  ["screen", "to the screen's pixels"],
  ["full", "to full resolution"],
  ["error", "to an error in values"],
  ["distance", "to a distance"],
  ["triangles", "to a number of triangles"],
];
/** Errors and cameras only apply to values, not to labels. */
const kOfLabels: readonly Target[] = ["full", "distance"];

export class SurfacePanel {
  /** The current quality of the surface. */
  readonly state: HTMLElement;
  readonly choices: HTMLElement;
  private readonly bound = h("p", { class: "bound", id: "surface-bound" });
  private readonly count = h("p", { class: "count", id: "surface-count" });
  private readonly size = h("p", { class: "count", id: "surface-size" });
  private readonly detail = h("p", { class: "note" });
  private readonly progress = h("p", { class: "progress", id: "surface-progress" });
  private readonly unit: string;

  constructor(
    private readonly views: ViewStore,
    store: StoreInfo,
    private readonly surface: Surface,
  ) {
    this.unit = unitOf(store);
    const shown = checkbox("Show the surface", (on) => views.set({ surface: on }), { id: "surface-on" });
    const target = select(
      "Refine", kTargets.filter(([name]) => !store.labels || kOfLabels.includes(name)), (choice) => views.set({ target: choice }), { id: "target" },
    );
    const pixels = numberField("Pixels", (value) => views.set({ pixels: value }), { id: "pixels", min: 0.25, max: 64 });
    const error = numberField("Error", (value) => views.set({ error: value }), { id: "error", min: 0 });
    const distance = numberField(`Distance, ${this.unit}`, (value) => views.set({ distance: value }), { id: "distance", min: 0 });
    const triangles = numberField("Triangles", (value) => views.set({ triangles: Math.round(value) }), { id: "triangles", min: 100, max: 100_000_000 });
    const moving = numberField("Triangles while moving", (value) => views.set({ moving: Math.round(value) }), { id: "moving", min: 100, max: 10_000_000 });
    const most = numberField("Triangles at most", (value) => views.set({ most: Math.round(value) }), { id: "most", min: 100, max: store.most_triangles });
    const largest = checkbox("Only the largest piece", (on) => views.set({ largest: on }), { id: "largest" });
    const smooth = checkbox("Smooth surface of the label", (on) => views.set({ smooth: on }), { id: "smooth" });
    const facets = checkbox("Show the triangles", (on) => views.set({ facets: on }), { id: "facets" });
    this.state = h("div", { class: "state", role: "group", "aria-label": "The surface now" }, this.bound, this.count, this.size, this.progress, this.detail);
    this.choices = section(
      "surface", "Surface", true,
      shown.row, smooth.row, target.row, pixels.row, error.row, distance.row, triangles.row, moving.row, most.row, largest.row, facets.row,
    );
    views.subscribe((state) => {
      shown.set(state.surface);
      largest.set(state.largest);
      smooth.set(state.smooth);
      facets.set(state.facets);
      target.input.value = state.target;
      pixels.set(state.pixels);
      error.set(Number(state.error.toPrecision(9)));
      distance.set(Number(state.distance.toPrecision(9)));
      triangles.set(state.triangles);
      moving.set(state.moving);
      most.set(state.most);
      const isSmooth = mayBeLabels(store) && state.smooth;
      smooth.row.hidden = !mayBeLabels(store);
      target.row.hidden = isSmooth;
      moving.row.hidden = most.row.hidden = store.labels || isSmooth;
      for (const [name, { row }] of Object.entries({ screen: pixels, error, distance, triangles })) row.hidden = state.target !== name || target.row.hidden;
    });
  }

  /** Called when another mesh is shown or in progress. */
  refresh(): void {
    const { header } = this.surface.drawn;
    this.bound.textContent = this.sentence();
    this.count.textContent = header ? `${whole(header.triangles)} triangles on the screen` : "";
    const { measure } = this.surface.drawn;
    this.size.textContent = header && header.triangles > 0 && measure ? sizeText(measure, this.unit) : "";
    this.progress.textContent = this.underWay();
    this.state.hidden = !header && this.progress.textContent === "";
    this.progress.classList.toggle("active", this.surface.refiner.busy && header !== null);
    const short = this.surface.refiner.shortOfMemory ? "There is too little memory for a finer surface. " : "";
    const limited = header && !short && this.limited() ? `The requested accuracy needs more than ${whole(this.views.state.most)} triangles. ` : "";
    const uncut = header?.stop === "smooth" && this.views.state.box ? "Smooth surfaces are not clipped to the box. " : "";
    this.detail.textContent = header ? `${short}${limited}${uncut}${rounding(header, this.unit)}` : "";
  }

  /** The bound as part of a sentence, without a full stop; empty if there is no surface. */
  sentence(): string {
    const { header } = this.surface.drawn;
    if (!header) return "";
    if (header.triangles === 0) return header.full_resolution ? "No surface: nothing has this value here" : "No surface at this error; a smaller error may show some";
    const text = surfaceBound(header, this.unit);
    return text[0]?.toUpperCase() + text.slice(1);
  }

  private underWay(): string {
    const { aim, received, step, busy } = this.surface.refiner;
    const { header } = this.surface.drawn;
    if (aim !== null) {
      const which = step[1] > 1 ? ` (step ${step[0]} of ${step[1]})` : "";
      const got = received > 0 ? `, ${bytes(received)} received` : "";
      return header && step[1] > 0 ? `Refining ${aim}${which}${got}…` : `Loading ${short(this.views.state.iso)}${got}…`;
    }
    if (busy) return "Refines when the view is still.";
    return header ? "Not being refined." : "";
  }

  private limited(): boolean {
    const { header, refiner } = { header: this.surface.drawn.header, refiner: this.surface.refiner };
    const { target } = this.views.state;
    if (!header || header.full_resolution || refiner.busy) return false;
    if (target === "screen") return header.stop === "error";
    return target === "full" || (target === "error" && header.tolerance > this.views.state.error);
  }
}
