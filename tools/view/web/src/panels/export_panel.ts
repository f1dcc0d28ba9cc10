// What is seen as a file: the mesh, the picture, and the command line that makes the same mesh.
import type { Api, Parameters } from "../api";
import { button, h, section, select } from "../dom";
import type { StoreInfo } from "../protocol";
import type { Slice } from "../slices";
import type { Stage } from "../stage";
import type { SliceName, ViewStore } from "../state";
import { kSliceNames } from "../state";
import type { Surface } from "../surface";

const kFormats = ["ply", "stl", "obj", "vtp", "vtkhdf", "glb", "3mf"] as const;
const kPause = 400; // milliseconds, between the last change and the question for the command line

type Subject = "seen" | "full" | SliceName;

export class ExportPanel {
  readonly element: HTMLDetailsElement;
  private readonly command = h("pre", { class: "command", id: "command", tabindex: 0, "aria-label": "Command line" });
  private readonly copied = h("span", { class: "note", role: "status" });
  private readonly subject: ReturnType<typeof select<Subject>>;
  private readonly format: ReturnType<typeof select<(typeof kFormats)[number]>>;
  private timer = 0;
  private last = "";

  constructor(
    views: ViewStore,
    private readonly store: StoreInfo,
    private readonly api: Api,
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
    this.format = select("Format", kFormats.map((one) => [one, `.${one}`] as const), () => undefined, { id: "export-format" });
    const save = button("Save the mesh", () => this.saveMesh(), { id: "export-mesh" });
    const picture = button("Save the picture", () => this.savePicture(), { id: "export-picture" });
    const copy = button("Copy", () => void this.copy(), { id: "copy-command", "aria-label": "Copy the command line" });
    this.element = section(
      "export", "Export", false,
      this.subject.row, this.format.row, h("div", { class: "buttons" }, save, picture),
      h("p", { class: "note" }, "The same mesh by the command line:"), this.command, h("div", { class: "buttons" }, copy, this.copied),
    );
    this.element.addEventListener("toggle", () => this.refresh());
  }

  /** What is shown has changed. */
  refresh(): void {
    clearTimeout(this.timer);
    if (this.element.open) this.timer = setTimeout(() => void this.ask(), kPause);
  }

  savePicture(): void {
    this.stage.draw(); // in this same task, so that the canvas still has it
    this.stage.canvas.toBlob((blob) => {
      if (!blob) return this.failed(new Error("The picture could not be made."));
      const url = URL.createObjectURL(blob);
      this.download(url, `${this.name}.png`);
      setTimeout(() => URL.revokeObjectURL(url), 10_000);
    }, "image/png");
  }

  private get name(): string {
    return this.store.name.replace(/^.*\//, "").replace(/\.isonest$/, "");
  }

  private parameters(): Parameters | null {
    const subject = this.subject.input.value as Subject;
    if (subject === "seen") return this.surface.asSeen();
    if (subject === "full") return this.surface.inFull();
    return this.slices.get(subject)?.asSeen() ?? null;
  }

  /** By the browser, straight to the disk: a mesh may be larger than a page may hold. */
  private saveMesh(): void {
    const parameters = this.parameters();
    if (!parameters) return this.failed(new Error("There is nothing to save: what was chosen is not shown."));
    const format = this.format.input.value;
    this.download(this.api.url("export", { ...parameters, format }), `${this.name}.${format}`);
  }

  private download(url: string, name: string): void {
    const link = h("a", { href: url, download: name });
    document.body.append(link);
    link.click();
    link.remove();
  }

  private async ask(): Promise<void> {
    const parameters = this.parameters();
    const key = JSON.stringify(parameters);
    if (key === this.last) return;
    this.last = key;
    this.copied.textContent = "";
    if (!parameters) {
      this.command.textContent = "What was chosen is not shown.";
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
      this.copied.textContent = "Selected; copy it by hand: the browser does not let the page do it.";
    }
  }
}
