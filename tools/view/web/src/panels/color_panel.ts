// The quantity that colours the surface: its choice, its colours and their window.
import { button, h, section, select } from "../dom";
import type { MeshHeader, StoreInfo } from "../protocol";
import { colorOf, kMapNames } from "../shaders";
import { rangeOf, type ViewStore } from "../state";
import { short, shortBound, whole } from "../words";
import { kFirstMaps } from "./slice_panel";
import { Slider } from "./slider";

export class ColorPanel {
  readonly element: HTMLElement;
  private readonly legend = h("canvas", { class: "legend", width: 256, height: 1, "aria-hidden": "true" });
  private readonly note = h("p", { class: "note", id: "color-note" });

  constructor(
    views: ViewStore,
    private readonly store: StoreInfo,
    private readonly shown: () => MeshHeader | null,
  ) {
    const { quantities } = store;
    const choices = [["", "nothing"] as const, ...quantities.map(({ name }) => [name, name] as const)];
    const color = select("Colour by", choices, (name) => views.set({ color: name, colorWindow: this.range(name) }), { id: "color" });
    const maps = [...kFirstMaps.filter((name) => kMapNames.includes(name)), ...kMapNames.filter((name) => !kFirstMaps.includes(name))];
    const map = select("Colours", maps.map((name) => [name, name] as const), (choice) => views.set({ colorMap: choice }), { id: "color-map" });
    const ends = h("p", { class: "ends" });
    const [least, largest] = this.range(views.state.color);
    const gap = (largest - least) * 1e-4;
    const from = new Slider({ id: "color-from", label: "From", least, largest, open: true }, (value) => views.set({ colorWindow: [value, Math.max(views.state.colorWindow[1], value + gap)] }));
    const to = new Slider({ id: "color-to", label: "To", least, largest, open: true }, (value) => views.set({ colorWindow: [Math.min(views.state.colorWindow[0], value - gap), value] }));
    const all = button("All values", () => views.set({ colorWindow: this.range(views.state.color) }), { id: "color-all" });
    const rows = [map.row, this.legend, ends, from.row, to.row, h("div", { class: "buttons" }, all), this.note];
    this.element = section("colors", "Colours of the surface", true, color.row, ...rows);
    views.subscribe((state, changed) => {
      color.input.value = state.color;
      map.input.value = state.colorMap;
      for (const row of rows) row.hidden = state.color === "";
      if (changed.has("color")) for (const slider of [from, to]) slider.setReach(...this.range(state.color), undefined, true);
      from.set(state.colorWindow[0]);
      to.set(state.colorWindow[1]);
      ends.replaceChildren(h("span", {}, short(state.colorWindow[0])), h("span", {}, short(state.colorWindow[1])));
      if (changed.has("colorMap")) this.paintLegend(state.colorMap);
    });
  }

  /** Called when another mesh is shown. */
  refresh(): void {
    const header = this.shown();
    if (header?.color === undefined) {
      this.note.textContent = "";
      return;
    }
    const { color_bound: bound = null, uncolored_triangles: without = 0, value_rounding: rounding = 0 } = header;
    const between = bound === null ? "" : `Between vertices, the values shown as colours are within ${shortBound(bound + rounding)} of ${header.color}.`;
    this.note.textContent = `${between}${without > 0 ? ` ${whole(without)} triangles are next to missing values, without this bound.` : ""}${header.value_missing === undefined ? "" : " Gray: no value."}`.trim();
  }

  private range(name: string): readonly [number, number] {
    return rangeOf(this.store.quantities.find((one) => one.name === name));
  }

  private paintLegend(map: string): void {
    const context = this.legend.getContext("2d");
    if (!context) return;
    const image = context.createImageData(256, 1);
    for (let i = 0; i < 256; ++i) image.data.set([...colorOf(map, i / 255), 255], 4 * i);
    context.putImageData(image, 0, 0);
  }
}
