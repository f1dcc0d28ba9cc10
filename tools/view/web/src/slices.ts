// The slices: three along the data's axes and an oblique one, with their colours.
import type { Api, Parameters } from "./api";
import { DrawnMesh } from "./drawn_mesh";
import { planeOf } from "./geometry";
import type { MeshHeader, StoreInfo } from "./protocol";
import { Refiner, type Step, withFewerTriangles } from "./refiner";
import { paintByValue, sliceMaterial } from "./shaders";
import type { Stage } from "./stage";
import { kSliceNames, type SliceName, stepOf, type ViewStore } from "./state";

const kMovingTriangles = 30_000;
const kPixels = 2; // colours are linear between vertices
const kMaxTriangles = 1_000_000;
const kShades = 512; // fraction of the window (1 / this) below which values are not refined

/** Ids of the slices' DrawnMesh; 1 is the surface. */
export function sliceOf(id: number): SliceName | null {
  return kSliceNames[id - 2] ?? null;
}

export class Slice {
  readonly drawn: DrawnMesh;
  readonly refiner: Refiner;

  constructor(
    readonly name: SliceName,
    api: Api,
    private readonly views: ViewStore,
    private readonly store: StoreInfo,
    private readonly stage: Stage,
    changed: () => void,
    failed: (error: Error) => void,
  ) {
    this.drawn = new DrawnMesh(kSliceNames.indexOf(name) + 2, sliceMaterial());
    stage.add(this.drawn);
    this.refiner = new Refiner(api, {
      kind: "slice",
      stream: `slice-${name}`,
      coarse: () => this.coarse(),
      steps: () => this.steps(),
      coarser: (tooLarge) => withFewerTriangles(tooLarge, this.basis(), kMaxTriangles),
      enough: (shown) => this.enough(shown),
      show: (mesh) => {
        this.drawn.show(mesh);
        this.paint();
        stage.invalidate();
      },
      clear: () => {
        this.drawn.clear();
        stage.invalidate();
      },
      changed,
      failed,
    });
    let plane = "";
    let on = false;
    views.subscribe((state, keys) => {
      const now = planeOf(name, state, store).join(",");
      const moved = state.slices[name].on !== on || (state.slices[name].on && (now !== plane || keys.has("box") || keys.has("step")));
      plane = now;
      on = state.slices[name].on;
      if (moved) this.refiner.move();
      else if (["eye", "lookAt", "projection", "window"].some((key) => keys.has(key as "eye"))) this.refiner.look();
      if (keys.has("map") || keys.has("window")) this.paint();
    });
  }

  /** The parameters that make the mesh that is shown. */
  asSeen(): Parameters | null {
    const { header } = this.drawn;
    return header && { ...this.basis(), error: header.error_bound ?? header.tolerance };
  }

  /** While something moves; null: it is not shown. */
  coarse(): Parameters | null {
    const { views, store } = this;
    if (!views.state.slices[this.name].on || store.labels) return null;
    if (store.first_error !== null) return { ...this.basis(), error: store.first_error, limit: kMovingTriangles };
    return { ...this.basis(), triangles: kMovingTriangles };
  }

  private basis(): Parameters {
    const { state } = this.views;
    return {
      ...stepOf(this.store, state),
      plane: planeOf(this.name, state, this.store).map((part) => Number(part.toPrecision(12))).join(","),
      ...(state.box ? { box: state.box.join(",") } : {}),
    };
  }

  private get error(): number {
    const [low, high] = this.views.state.window;
    return (high - low) / kShades;
  }

  private steps(): readonly Step[] {
    const limit = Math.min(kMaxTriangles, this.views.state.most);
    const camera = [...this.stage.seen, kPixels].map((part) => Number(part.toPrecision(9))).join(",");
    return [{ parameters: { ...this.basis(), camera, error: this.error, limit }, aim: "to the screen's resolution" }];
  }

  private enough(shown: MeshHeader): boolean {
    return shown.full_resolution || (shown.error_bound !== null && shown.error_bound <= this.error);
  }

  private paint(): void {
    const { map, window } = this.views.state;
    paintByValue(this.drawn.material, this.drawn.header, map, window, true);
    this.stage.invalidate();
  }
}
