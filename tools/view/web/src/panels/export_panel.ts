// Exports what is shown: the mesh, the picture, and the command line that makes the same mesh. Without a server, the
// page makes the files, and there is no command line.
import { type Api, type Parameters, ServerError, targetOf } from "../api";
import { button, h, section, select } from "../dom";
import { kPageFormats, type PageFormat } from "../mesh_files";
import type { StoreInfo } from "../protocol";
import type { ServerTransport } from "../site/server_transport";
import type { Slice } from "../slices";
import type { Stage } from "../stage";
import type { SliceName, ViewStore } from "../state";
import { kSliceNames } from "../state";
import type { Surface } from "../surface";

const kServerFormats = ["ply", "stl", "obj", "vtp", "vtkhdf", "glb", "3mf"] as const;
const kPause = 400; // milliseconds between the last change and the request for the command line

const kTiles = "The surface is shown by tiles, which cannot be saved: choose the surface at full resolution.";

type Subject = "seen" | "full" | SliceName;

export class ExportPanel {
  readonly element: HTMLDetailsElement;
  private readonly command = h("pre", { class: "command", id: "command", tabindex: 0, "aria-label": "Command line" });
  private readonly copied = h("span", { class: "note", role: "status" });
  private readonly subject: ReturnType<typeof select<Subject>>;
  private readonly format: ReturnType<typeof select<(typeof kServerFormats)[number]>>;
  /** Width and height of a picture; empty: as on the screen, or in proportion to the other one. */
  private readonly pixels: readonly HTMLInputElement[];
  private timer = 0;
  private last = "";

  constructor(
    private readonly views: ViewStore,
    private readonly store: StoreInfo,
    private readonly api: Api,
    /** Null if there is none. */
    private readonly server: ServerTransport | null,
    private readonly stage: Stage,
    private readonly surface: Surface,
    private readonly slices: ReadonlyMap<SliceName, Slice>,
    private readonly failed: (error: Error) => void,
  ) {
    const flat = store.dimension === 2;
    const names = ["across x", "across y", "across z", "oblique"];
    const subjects: (readonly [Subject, string])[] = flat ? [] : [["seen", "the surface as it is seen"], ["full", "the surface at full resolution"]];
    kSliceNames.forEach((name, i) => {
      if (!store.labels && (!flat || views.state.slices[name].on)) subjects.push([name, flat ? "the data as they are seen" : `the slice ${names[i]}`]);
    });
    this.subject = select("Mesh", subjects, () => this.refresh(), { id: "export-subject" });
    const formats: readonly (typeof kServerFormats)[number][] = server ? kServerFormats : kPageFormats;
    this.format = select("Format", formats.map((one) => [one, `.${one}`] as const), () => undefined, { id: "export-format" });
    const save = button("Save the mesh", () => void this.saveMesh(), { id: "export-mesh" });
    const picture = button("Save the picture", () => void this.savePicture(), { id: "export-picture" });
    this.pixels = ["width", "height"].map((name) =>
      h("input", { type: "number", id: `picture-${name}`, min: 16, max: stage.mostPixels, step: 1, placeholder: "as shown", "aria-label": `The picture's ${name} in pixels` }));
    const size = h("div", { class: "field picture-size" }, h("span", {}, "Pixels"), this.pixels[0]!, "×", this.pixels[1]!);
    const copy = button("Copy", () => void this.copy(), { id: "copy-command", "aria-label": "Copy the command line" });
    this.element = section(
      "export", "Export", false,
      this.subject.row, this.format.row, h("div", { class: "buttons" }, save), size, h("div", { class: "buttons" }, picture),
      ...(server
        ? [h("p", { class: "note" }, "The same mesh by the command line:"), this.command, h("div", { class: "buttons" }, copy, this.copied)]
        : [h("p", { class: "note" }, "The mesh has the positions shown, rounded as stated above.")]),
    );
    this.element.addEventListener("toggle", () => this.refresh());
  }

  /** Called when something else is shown. */
  refresh(): void {
    clearTimeout(this.timer);
    if (this.server && this.element.open) this.timer = setTimeout(() => void this.ask(), kPause);
  }

  async savePicture(): Promise<void> {
    const [width = 0, height = 0] = this.pixels.map((field) => (field.validity.valid && field.valueAsNumber > 0 ? field.valueAsNumber : 0));
    const blob = await this.stage.picture(width, height);
    if (!blob) return this.failed(new Error("The picture could not be made."));
    this.save(blob, `${this.name}.png`);
  }

  private get name(): string {
    const { series, name } = this.store;
    const time = series ? `-${series.times[this.views.state.step]}` : "";
    return name.replace(/^.*\//, "").replace(/\.isonest$/, "") + time;
  }

  private get isTiled(): boolean {
    return this.subject.input.value === "seen" && (this.surface.tiled?.isShown ?? false);
  }

  private parameters(): Parameters | null {
    const subject = this.subject.input.value as Subject;
    if (subject === "seen") return this.surface.asSeen();
    if (subject === "full") return this.surface.inFull();
    return this.slices.get(subject)?.asSeen() ?? null;
  }

  private async saveMesh(): Promise<void> {
    const parameters = this.parameters();
    if (!parameters) return this.failed(new Error(this.isTiled ? kTiles : "Nothing to save: the selected mesh is not shown."));
    const format = this.format.input.value;
    const name = `${this.name}.${format}`;
    // Downloaded by the browser directly to disk, because a mesh may exceed the page's memory.
    if (this.server) return this.download(this.server.url(targetOf("export", { ...parameters, format })), name);
    try {
      const kind = "plane" in parameters ? "slice" : "surface";
      this.save(new Blob([await this.api.meshFile(kind, parameters, format as PageFormat)]), name);
    } catch (error) {
      if (!(error instanceof ServerError && error.superseded)) this.failed(error as Error);
    }
  }

  private save(blob: Blob, name: string): void {
    const url = URL.createObjectURL(blob);
    this.download(url, name);
    setTimeout(() => URL.revokeObjectURL(url), 10_000);
  }

  private download(url: string, name: string): void {
    const link = h("a", { href: url, download: name });
    document.body.append(link);
    link.click();
    link.remove();
  }

  private async ask(): Promise<void> {
    const parameters = this.parameters();
    const key = JSON.stringify([parameters, this.isTiled]);
    if (key === this.last) return;
    this.last = key;
    this.copied.textContent = "";
    if (!parameters) {
      this.command.textContent = this.isTiled ? kTiles : "The selected mesh is not shown.";
      return;
    }
    try {
      this.command.textContent = (await this.api.command(parameters)).command;
    } catch (error) {
      if (this.last === key) this.last = "";
      this.failed(error as Error);
    }
  }

  private async copy(): Promise<void> {
    try {
      await navigator.clipboard.writeText(this.command.textContent ?? "");
      this.copied.textContent = "Copied.";
    } catch {
      getSelection()?.selectAllChildren(this.command);
      this.copied.textContent = "Selected; press Ctrl+C: the browser does not allow the page to copy it.";
    }
  }
}
