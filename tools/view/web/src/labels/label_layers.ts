// The surfaces of labels that are shown besides the selected one.
import { type Api, ServerError } from "../api";
import { DrawnMesh } from "../drawn_mesh";
import type { Vector } from "../protocol";
import { paintByValue, setSurfaceColor, surfaceMaterial } from "../shaders";
import type { Stage } from "../stage";
import { type Key, labelsShown, type ViewStore } from "../state";
import type { Surface } from "../surface";

/** Ids of DrawnMesh from here on; smaller ones are the surface's and the slices'. */
const kFirstId = 6;
export const kMaxLayers = 250;
/** Requests under way, so that other requests are not kept waiting. */
const kRequests = 2;
/** Of all layers together. */
const kMaxTriangles = 12_000_000;
/** A change of these asks for all surfaces again. */
const kChanges: readonly Key[] = ["step", "box", "largest", "smooth", "target", "distance", "color"];

interface Layer {
  readonly drawn: DrawnMesh;
  /** The generation of its mesh; -1: there is none yet. */
  made: number;
}

export class LabelLayers {
  /** There are too many triangles, or labels, to show all that are chosen. */
  isFull = false;
  private readonly layers = new Map<number, Layer>();
  private readonly freeIds = Array.from({ length: kMaxLayers }, (_one, i) => kFirstId + kMaxLayers - 1 - i);
  private readonly colors = new Map<number, Vector>();
  private generation = 0;
  private running = 0;

  constructor(
    private readonly api: Api,
    private readonly views: ViewStore,
    private readonly stage: Stage,
    private readonly surface: Surface,
    /** Called when another mesh is shown or under way. */
    private readonly changed: () => void,
    private readonly failed: (error: Error) => void,
  ) {
    views.subscribe((state, keys) => {
      for (const { drawn } of this.layers.values()) if (drawn.material.uniforms.facets) drawn.material.uniforms.facets.value = state.facets;
      if (keys.has("colorMap") || keys.has("colorWindow")) for (const drawn of this.drawn) this.paint(drawn);
      if (kChanges.some((key) => keys.has(key))) ++this.generation;
      if (kChanges.some((key) => keys.has(key)) || keys.has("shown") || keys.has("iso") || keys.has("surface")) this.update();
      stage.invalidate();
    });
  }

  get busy(): boolean {
    return this.running > 0;
  }
  get drawn(): readonly DrawnMesh[] {
    return [...this.layers.values()].map((layer) => layer.drawn);
  }
  get triangles(): number {
    return this.drawn.reduce((sum, { triangles }) => sum + triangles, 0);
  }
  labelOf(id: number): number | null {
    for (const [label, { drawn }] of this.layers) if (drawn.id === id) return label;
    return null;
  }

  /** From now on; 0 to 255 each. */
  setColors(colors: ReadonlyMap<number, Vector>): void {
    for (const [label, color] of colors) this.colors.set(label, color);
    for (const [label, { drawn }] of this.layers) setSurfaceColor(drawn.material, fractions(this.colorOf(label)));
    this.stage.invalidate();
  }
  colorOf(label: number): Vector {
    return this.colors.get(label) ?? ownColor(label);
  }

  /** Starts again after an error. */
  again(): void {
    ++this.generation;
    this.update();
  }

  private update(): void {
    const { state } = this.views;
    const wanted = state.surface ? labelsShown(state).filter((label) => label !== Math.round(state.iso)) : [];
    for (const [label, layer] of this.layers) {
      if (wanted.includes(label)) continue;
      layer.drawn.clear();
      this.stage.remove(layer.drawn);
      this.freeIds.push(layer.drawn.id);
      this.layers.delete(label);
    }
    this.isFull = false;
    for (const label of wanted) {
      if (this.layers.has(label)) continue;
      const id = this.freeIds.pop();
      if (id === undefined) {
        this.isFull = true;
        break;
      }
      const drawn = new DrawnMesh(id, surfaceMaterial());
      setSurfaceColor(drawn.material, fractions(this.colorOf(label)));
      if (drawn.material.uniforms.facets) drawn.material.uniforms.facets.value = state.facets;
      this.stage.add(drawn);
      this.layers.set(label, { drawn, made: -1 });
    }
    this.pump();
    this.changed();
  }

  private paint(drawn: DrawnMesh): void {
    const { colorMap, colorWindow } = this.views.state;
    paintByValue(drawn.material, drawn.header, colorMap, colorWindow, drawn.header?.color !== undefined);
  }

  private pump(): void {
    for (const [label, layer] of this.layers) {
      if (this.running >= kRequests) return;
      if (layer.made === this.generation) continue;
      if (this.triangles > kMaxTriangles) {
        this.isFull = true;
        return;
      }
      layer.made = this.generation;
      void this.make(label, layer);
    }
  }

  private async make(label: number, layer: Layer): Promise<void> {
    ++this.running;
    const { generation } = this;
    try {
      const mesh = await this.api.mesh("surface", `label-${layer.drawn.id}`, this.surface.parametersOf(label), () => undefined);
      if (this.layers.get(label) === layer && generation === this.generation) {
        layer.drawn.show(mesh);
        this.paint(layer.drawn);
        this.stage.invalidate();
      }
    } catch (error) {
      if (!(error instanceof ServerError && error.superseded)) this.failed(error as Error);
    }
    --this.running;
    this.pump();
    this.changed();
  }
}

function fractions(color: Vector): Vector {
  return [color[0] / 255, color[1] / 255, color[2] / 255];
}

/** Of a label without a colour: neighbouring numbers get hues that are far apart. */
function ownColor(label: number): Vector {
  const hue = (((label * 0.618034) % 1) + 1) % 1;
  const channel = (shift: number): number => Math.round(255 * (0.62 + 0.28 * Math.cos(2 * Math.PI * (hue - shift))));
  return [channel(0), channel(1 / 3), channel(2 / 3)];
}
