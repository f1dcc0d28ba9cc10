// Options for the surface, and its current quality in plain words.
import { checkbox, h, numberField, section, select } from "../dom";
import type { StoreInfo } from "../protocol";
import type { Surface } from "../surface";
import { mayBeLabels, type Target, type ViewStore } from "../state";
import type { TiledSurface } from "../tiles/tiled_surface";
import { bytes, rounding, short, sizeText, surfaceBound, tilesBound, unitOf, whole } from "../words";

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
    const { tiled } = this.surface;
    if (tiled?.isShown && tiled.selection) {
      this.showTiles(tiled, tiled.selection);
      return;
    }
    const { header } = this.surface.drawn;
    this.bound.textContent = this.sentence();
    this.count.textContent = header ? `${whole(header.triangles)} triangles on the screen` : "";
    const { measure } = this.surface.drawn;
    this.size.textContent = header && header.triangles > 0 && measure ? sizeText(measure, this.unit) : "";
    this.progress.textContent = this.underWay();
    this.state.hidden = !header && this.progress.textContent === "";
    this.progress.classList.toggle("active", this.surface.refiner.busy && header !== null);
    const short = this.surface.refiner.shortOfMemory ? "There is too little memory for a finer surface. " : "";
    const limited = header && !short && this.surface.limited ? `The requested accuracy needs more than ${whole(this.views.state.most)} triangles. ` : "";
    const uncut = header?.stop === "smooth" && this.views.state.box ? "Smooth surfaces are not clipped to the box. " : "";
    this.detail.textContent = header ? `${short}${limited}${limited ? this.aboutTiles() : ""}${uncut}${rounding(header, this.unit)}` : "";
  }

  private showTiles(tiled: TiledSurface, { triangles, wanted, limited }: NonNullable<TiledSurface["selection"]>): void {
    this.state.hidden = false;
    this.bound.textContent = this.sentence();
    this.count.textContent = `${whole(triangles)} triangles on the screen, of ${whole(tiled.info?.triangles ?? 0)}`;
    this.size.textContent = "";
    const isLoading = wanted.length > 0;
    this.progress.textContent = isLoading ? "Loading tiles…" : "Not being refined.";
    this.progress.classList.toggle("active", isLoading);
    const more = limited && !isLoading ? `A finer surface needs more than ${whole(this.views.state.most)} triangles. ` : "";
    this.detail.textContent = `${more}Shown by tiles, for which area and volume are not known.`;
  }

  /** Why a surface beyond the limit for triangles is not shown by tiles, or how far they are. */
  private aboutTiles(): string {
    const { tiled, cannotBeTiled } = this.surface;
    if (!tiled) return "";
    if (cannotBeTiled !== "") return `Tiles would show it, but not ${cannotBeTiled}. `;
    return tiled.trouble === null ? "" : `No tiles: ${tiled.trouble} `;
  }

  /** The bound as part of a sentence, without a full stop; empty if there is no surface. */
  sentence(): string {
    const { tiled } = this.surface;
    if (tiled?.isShown && tiled.selection) return tilesBound(tiled.selection, tiled.info?.data_tolerance ?? 0, this.unit);
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
    const { tiled } = this.surface;
    if (tiled?.state === "loading") return "Loading tiles…";
    if (tiled?.state === "making") {
      const { phase, part = 0 } = tiled.info ?? {};
      return phase ? `Making tiles: ${phase}, ${whole(Math.floor(100 * part))} %…` : "Waiting for tiles to be made…";
    }
    return header ? "Not being refined." : "";
  }
}
