// Sliders for the slices, with their colours and value window.
import type { CameraMoves } from "../camera_moves";
import { button, checkbox, h, section, select } from "../dom";
import { normalOf, reachOf } from "../geometry";
import type { HistogramInfo, StoreInfo } from "../protocol";
import { colorOf, kMapNames } from "../shaders";
import { Slider } from "./slider";
import type { Slice } from "../slices";
import { kSliceNames, type SliceName, type ViewStore } from "../state";
import { allValues, namedWindows, type Window, windowOf } from "../windows";
import { short, sliceBound, whole } from "../words";

const kTitles: Readonly<Record<SliceName, string>> = { x: "Across x", y: "Across y", z: "Across z", o: "Oblique" };
export const kFirstMaps = ["gray", "viridis", "cividis", "magma", "inferno", "turbo", "coolwarm"];

export class SlicePanel {
  readonly element: HTMLElement;
  private readonly bounds = new Map<SliceName, HTMLElement>();
  private ofHistogram: Window | null = null;
  private readonly fromHistogram = button("Most values", () => this.ofHistogram && this.views.set({ window: this.ofHistogram }), {
    id: "window-histogram", title: "from the histogram, without the lowest and the highest half percent", hidden: true,
  });
  private readonly legend = h("canvas", { class: "legend", width: 256, height: 1, "aria-hidden": "true" });

  constructor(
    private readonly views: ViewStore,
    private readonly store: StoreInfo,
    private readonly slices: ReadonlyMap<SliceName, Slice>,
    private readonly moves: CameraMoves,
  ) {
    const flat = store.dimension === 2;
    const rows: HTMLElement[] = [];
    for (const name of kSliceNames) if (!flat || views.state.slices[name].on) rows.push(this.row(name, flat));
    const ends = this.windowRows();
    const maps = [...kFirstMaps.filter((name) => kMapNames.includes(name)), ...kMapNames.filter((name) => !kFirstMaps.includes(name))];
    const map = select("Colours", maps.map((name) => [name, name] as const), (choice) => views.set({ map: choice }), { id: "map" });
    views.subscribe((state, changed) => {
      map.input.value = state.map;
      if (changed.has("map")) this.paintLegend(state.map);
    });
    const hint = flat ? "" : "Drag a slice in the picture to move it. Drag on it with the right button: right and left change the window, up and down the level.";
    this.element = section("slices", flat ? "Data" : "Slices", flat, ...rows, map.row, this.legend, ...ends, h("p", { class: "note" }, hint));
  }

  /** The window that is offered from now on. */
  showHistogram(info: HistogramInfo): void {
    this.ofHistogram = windowOf(info);
    this.fromHistogram.hidden = this.ofHistogram === null;
  }

  refresh(): void {
    for (const [name, element] of this.bounds) {
      const slice = this.slices.get(name);
      const header = slice?.drawn.header;
      const more = slice?.refiner.aim != null ? (header ? ", refining…" : "Loading…") : slice?.refiner.busy && header ? ", refines when the view is still" : "";
      const short = slice?.refiner.shortOfMemory ? "; there is too little memory for a finer one" : "";
      element.textContent = header ? `${sliceBound(header)}; ${whole(header.triangles)} triangles${short}${more}` : more;
    }
  }

  private row(name: SliceName, flat: boolean): HTMLElement {
    const { views, store } = this;
    const bound = h("p", { class: "note", id: `slice-${name}-bound` });
    this.bounds.set(name, bound);
    const on = checkbox(flat ? "Show the data" : kTitles[name], (shown) => views.setSlice(name, { on: shown }), { id: `slice-${name}-on` });
    const face = button("Flat view", () => this.moves.face(normalOf(name, views.state, store)), {
      id: `slice-${name}-flat`, title: "looks straight at the slice, without perspective and surface",
    });
    const [least, largest] = reachOf(name, views.state, store);
    const at = new Slider({ id: `slice-${name}`, label: "Position", least, largest }, (value) => views.setSlice(name, { at: value }));
    const angles =
      name === "o"
        ? ([
            ["turn", new Slider({ id: "turn", label: "Turn", least: -180, largest: 180, step: 1 }, (turn) => views.set({ turn }))],
            ["tilt", new Slider({ id: "tilt", label: "Tilt", least: -90, largest: 90, step: 1 }, (tilt) => views.set({ tilt }))],
          ] as const)
        : [];
    views.subscribe((state, changed) => {
      const { on: shown, at: place } = state.slices[name];
      on.set(shown);
      if (name === "o" && (changed.has("turn") || changed.has("tilt"))) at.setReach(...reachOf(name, state, store));
      at.set(place);
      for (const [key, slider] of angles) slider.set(state[key]);
      for (const slider of [at, ...angles.map(([, slider]) => slider)]) slider.row.hidden = !shown || flat;
      bound.hidden = !shown;
      face.hidden = !shown || flat;
    });
    return h("div", { class: "slice" }, h("div", { class: "slice-head" }, on.row, face), at.row, ...angles.map(([, slider]) => slider.row), bound);
  }

  private windowRows(): HTMLElement[] {
    const { views, store } = this;
    const least = store.min_value ?? 0;
    const largest = store.max_value ?? 1;
    const range = largest - least || 1;
    const set = (level: number, width: number): void => {
      const half = Math.max(width, range * 1e-4) / 2;
      views.set({ window: [level - half, level + half] });
    };
    const middle = (): number => (views.state.window[0] + views.state.window[1]) / 2;
    const across = (): number => views.state.window[1] - views.state.window[0];
    const level = new Slider({ id: "level", label: "Level", least, largest, open: true }, (value) => set(value, across()));
    const width = new Slider({ id: "width", label: "Window", least: 0, largest: range, open: true }, (value) => set(middle(), value));
    const ends = h("p", { class: "ends" });
    views.subscribe((state) => {
      level.set(middle());
      width.set(across());
      ends.replaceChildren(h("span", {}, short(state.window[0])), h("span", {}, short(state.window[1])));
    });
    const choices = [["All values", allValues(store)] as const, ...namedWindows(store)].map(([name, window]) =>
      button(name, () => views.set({ window }), { id: `window-${(name.split(" ")[0] ?? name).toLowerCase()}` }));
    const buttons = h("div", { class: "buttons", role: "group", "aria-label": "Windows" }, ...choices, this.fromHistogram);
    return [ends, level.row, width.row, buttons];
  }

  private paintLegend(map: string): void {
    const context = this.legend.getContext("2d");
    if (!context) return;
    const image = context.createImageData(256, 1);
    for (let i = 0; i < 256; ++i) image.data.set([...colorOf(map, i / 255), 255], 4 * i);
    context.putImageData(image, 0, 0);
  }
}
