// The list of labels: names, colours, check boxes, and a search.
import { type Api, ServerError } from "../api";
import { button, h, section, setAttributes, svg } from "../dom";
import { kMaxLayers, type LabelLayers } from "../labels/label_layers";
import type { ListedLabel, StoreInfo, Vector } from "../protocol";
import { labelsShown, stepOf, type ViewStore } from "../state";
import { whole } from "../words";

/** Rows in the list; more labels are found by searching. */
const kMaxRows = 300;

export class LabelPanel {
  readonly element: HTMLElement;
  /** Resolves when the list is complete, or cannot be. */
  readonly loading: Promise<void>;
  private labels: readonly ListedLabel[] = [];
  private readonly list = h("ul", { class: "labels", id: "labels", "aria-label": "Labels" });
  private readonly search = h("input", { type: "search", id: "label-search", placeholder: "Search names and numbers", "aria-label": "Search the labels" });
  private readonly note = h("p", { class: "note", id: "label-note", role: "status" }, "Looking for the labels…");
  private readonly boxes = new Map<number, HTMLInputElement>();
  /** The URL that was opened names a label. */
  private readonly isChosen = new URLSearchParams(location.hash.slice(1)).has("iso");
  private readonly names = new Map<number, HTMLButtonElement>();

  constructor(
    private readonly api: Api,
    private readonly views: ViewStore,
    private readonly store: StoreInfo,
    private readonly layers: LabelLayers,
    private readonly failed: (error: Error) => void,
  ) {
    const all = button("Show these", () => this.show([...new Set([...labelsShown(views.state), ...this.found().map(({ id }) => id).filter((id) => id !== 0)])]), {
      id: "labels-all", title: "shows all labels that the search finds, except 0",
    });
    const none = button("Only the selected one", () => this.show([Math.round(views.state.iso)]), { id: "labels-none" });
    this.element = section("label-list", "Labels", true, this.search, this.list, this.note, h("div", { class: "buttons" }, all, none));
    this.search.addEventListener("input", () => this.fill());
    views.subscribe((_state, keys) => {
      if (keys.has("shown") || keys.has("iso") || keys.has("surface")) this.mark();
    });
    this.loading = this.load();
  }

  /** Called when another mesh is shown or under way. */
  refresh(): void {
    if (this.labels.length > 0) this.note.textContent = this.summary();
  }

  /** Names and colours at once; the other labels only if that does not mean fetching the whole store. */
  private async load(): Promise<void> {
    const step = stepOf(this.store, this.views.state);
    try {
      this.take(await this.api.labels(true, step));
      if (!this.store.remote) this.take(await this.api.labels(false, step));
      else if (this.labels.length === 0) this.offer();
    } catch (error) {
      if (error instanceof ServerError && error.superseded) return;
      this.note.textContent = `The labels cannot be listed: ${(error as Error).message}`;
    }
  }

  /** The store has no names, and is at a URL. */
  private offer(): void {
    const find = button("Find the labels", () => {
      this.note.textContent = "Looking for the labels…";
      this.api.labels(false, stepOf(this.store, this.views.state)).then((labels) => this.take(labels), this.failed);
    }, { id: "labels-find" });
    this.note.replaceChildren("The labels have no names. To list them, all values have to be fetched. ", find);
  }

  private take(labels: readonly ListedLabel[]): void {
    this.labels = labels.filter(({ id }) => Number.isSafeInteger(id));
    const colors = this.labels.flatMap(({ id, color }): [number, Vector][] => (color ? [[id, color]] : []));
    this.layers.setColors(new Map(colors));
    const { iso } = this.views.state;
    const first = this.labels.find(({ id, nodes }) => id !== 0 && nodes !== 0);
    if (first && !this.isChosen && !this.labels.some(({ id }) => id === iso)) this.views.set({ iso: first.id });
    this.fill();
  }

  /** Those that the search finds. */
  private found(): readonly ListedLabel[] {
    const wanted = this.search.value.trim().toLowerCase();
    return this.labels.filter(({ id, name, nodes }) => nodes !== 0 && (wanted === "" || String(id) === wanted || (name ?? "").toLowerCase().includes(wanted)));
  }

  private fill(): void {
    const found = this.found();
    this.boxes.clear();
    this.names.clear();
    this.list.replaceChildren(...found.slice(0, kMaxRows).map((label) => this.row(label)));
    this.list.hidden = found.length === 0;
    this.mark();
    this.refresh();
  }

  private row({ id, name, nodes }: ListedLabel): HTMLElement {
    const title = name ?? `Label ${id}`;
    const box = h("input", { type: "checkbox", "aria-label": `Show ${title}` });
    box.addEventListener("change", () => {
      const others = labelsShown(this.views.state).filter((label) => label !== id);
      this.show(box.checked ? [...others, id] : others);
    });
    const [red, green, blue] = this.layers.colorOf(id);
    const swatch = svg("svg", { class: "swatch", viewBox: "0 0 10 10", "aria-hidden": "true" }, svg("rect", { width: 10, height: 10, rx: 2, fill: `rgb(${red},${green},${blue})` }));
    const choose = button(title, () => this.views.set({ iso: id, surface: true, shown: labelsShown(this.views.state).filter((label) => label !== id) }), { class: "label-name", title: name === null ? "select" : `label ${id}` });
    const size = h("span", { class: "label-size" }, nodes === null ? "" : whole(nodes));
    this.boxes.set(id, box);
    this.names.set(id, choose);
    return h("li", {}, box, swatch, choose, size);
  }

  /** Shows these labels; the selected one stays selected if it is among them. */
  private show(labels: readonly number[]): void {
    const { iso } = this.views.state;
    const selected = labels.includes(Math.round(iso)) ? Math.round(iso) : labels.at(-1);
    if (selected === undefined) this.views.set({ surface: false, shown: [] });
    else this.views.set({ surface: true, iso: selected, shown: labels.filter((label) => label !== selected) });
  }

  private mark(): void {
    const { state } = this.views;
    const shown = new Set(state.surface ? labelsShown(state) : []);
    for (const [id, box] of this.boxes) box.checked = shown.has(id);
    for (const [id, name] of this.names) setAttributes(name, { "aria-current": id === Math.round(state.iso) && state.surface ? "true" : false });
  }

  private summary(): string {
    const { state } = this.views;
    const found = this.found().length;
    const more = found > kMaxRows ? ` The list has the first ${kMaxRows} of ${whole(found)}; search for the others.` : "";
    const full = this.layers.isFull ? ` Not all chosen labels are shown: there are more than ${kMaxLayers}, or too many triangles.` : "";
    const count = state.surface ? labelsShown(state).length : 0;
    return `${found === 0 ? "No label has this name or number. " : ""}${whole(count)} of ${whole(this.labels.filter(({ nodes }) => nodes !== 0).length)} labels shown.${more}${full}`;
  }
}
