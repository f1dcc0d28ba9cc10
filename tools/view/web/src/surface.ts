// The surface: its requests, and what is shown about it.
import type { Api, Parameters } from "./api";
import { DrawnMesh } from "./drawn_mesh";
import type { HistogramInfo, MeshHeader, StoreInfo } from "./protocol";
import { Refiner, type Step, withFewerTriangles } from "./refiner";
import { paintByValue, surfaceMaterial } from "./shaders";
import type { Stage } from "./stage";
import { mayBeLabels, stepOf, type Key, type ViewState, type ViewStore } from "./state";
import { TiledSurface } from "./tiles/tiled_surface";

/** A change of kMoves shows another surface, a change of kLooks the same surface with another quality. */
const kMoves: readonly Key[] = ["surface", "step", "color", "iso", "box", "largest", "smooth", "moving", "most"];
const kLooks: readonly Key[] = ["target", "pixels", "error", "distance", "triangles"];
/** Smoothing steps for vertices of a smooth label: as in isonest extract. */
const kPasses = 16;
const kFirstSteps = 10; // times the triangles while moving
/** Simplified meshes are made from the whole surface at full resolution, which takes too long for larger volumes. */
const kMaxSimplified = 2 ** 28; // nodes
/** Below this distance the mesh hardly gets smaller. */
const kMinDistance = 0.25; // in distances of neighbouring nodes

export const kSurfaceId = 1;

export class Surface {
  readonly drawn = new DrawnMesh(kSurfaceId, surfaceMaterial());
  readonly refiner: Refiner;
  /** Shows the surface if it has more triangles than the page may show; null: never. */
  readonly tiled: TiledSurface | null;
  private histogram: HistogramInfo | null = null;
  /** The request for the mesh that is shown. */
  private asked: Parameters = {};

  constructor(
    api: Api,
    private readonly views: ViewStore,
    private readonly store: StoreInfo,
    private readonly stage: Stage,
    changed: () => void,
    failed: (error: Error) => void,
  ) {
    stage.add(this.drawn);
    this.refiner = new Refiner(api, {
      kind: "surface",
      stream: "surface",
      coarse: () => this.coarse(),
      steps: () => this.steps(),
      coarser: (tooLarge) => (store.labels || this.isSmooth() ? null : withFewerTriangles(tooLarge, this.basis(), views.state.most)),
      enough: (shown) => this.enough(shown),
      show: (mesh, parameters) => {
        this.asked = parameters;
        this.drawn.show(mesh);
        this.paint();
        this.tiled?.clear();
        stage.invalidate();
      },
      clear: () => {
        this.drawn.clear();
        this.tiled?.stop();
        this.tiled?.clear();
        stage.invalidate();
      },
      changed: () => {
        this.tileIfLarge();
        changed();
      },
      failed,
    });
    const mayBeTiled = api.hasServer && !store.labels && !store.remote && store.dimension === 3;
    const begin = (): void => {
      this.refiner.pause();
      this.drawn.clear();
    };
    this.tiled = mayBeTiled ? new TiledSurface(api, stage, kSurfaceId, this.drawn.material, begin, changed, failed, () => this.move()) : null;
    views.subscribe((state, keys) => {
      const { facets } = this.drawn.material.uniforms;
      if (facets) facets.value = state.facets;
      if (keys.has("colorMap") || keys.has("colorWindow")) this.paint();
      const looks = kLooks.some((key) => keys.has(key));
      if (looks && !this.tiled?.isShown && this.tilesPixels() === null) this.tiled?.stop();
      if (kMoves.some((key) => keys.has(key))) this.move();
      else if (this.tiled?.isShown) {
        if (looks && this.tilesPixels() === null) this.move();
        else this.tiled.look(this.tilesPixels() ?? 0);
      } else if (looks) this.refiner.look();
      else if (state.target === "screen" && (keys.has("eye") || keys.has("lookAt") || keys.has("projection"))) this.refiner.look();
    });
  }

  /** Called when the size of the canvas changes. */
  resized(): void {
    if (this.views.state.target === "screen" && !this.tiled?.isShown) this.refiner.look();
  }

  /** On the screen. */
  get triangles(): number {
    return this.tiled?.isShown ? this.tiled.drawn.triangles : this.drawn.triangles;
  }

  /** Starts again after an error. */
  again(): void {
    this.move();
  }

  /** Called with each histogram. */
  know(histogram: HistogramInfo): void {
    this.histogram = histogram;
    this.tileIfLarge();
  }

  private move(): void {
    this.tiled?.stop();
    this.refiner.move();
  }

  /** Errors that tiles may have, in pixels; null: the state asks for what tiles do not show. */
  private tilesPixels(): number | null {
    const { target, pixels } = this.views.state;
    // As for a distance that is not seen.
    return this.cannotBeTiled !== "" ? null : target === "screen" ? pixels / 2 : target === "full" ? 0 : null;
  }

  /** What is wanted that tiles do not show, in words; empty: nothing. */
  get cannotBeTiled(): string {
    const { box, largest } = this.views.state;
    const wanted = [
      [box !== null, "clipping"], [largest, "only the largest piece"], [this.isSmooth(), "smooth labels"], [this.color !== "", `colours by ${this.color}`],
    ] as const;
    return wanted.flatMap(([is, name]) => (is ? [name] : [])).join(", ");
  }

  /** The mesh at rest is coarser than wanted, because of the limit for triangles. */
  get limited(): boolean {
    const { header } = this.drawn;
    const { target, error } = this.views.state;
    if (!header || header.full_resolution || this.refiner.busy) return false;
    if (target === "screen") return header.stop === "error";
    return target === "full" || (target === "error" && header.tolerance > error);
  }

  /** Asks for tiles of a surface at rest that probably has too many triangles. The server counts them. */
  private tileIfLarge(): void {
    const { header } = this.drawn;
    const { iso, most } = this.views.state;
    const pixels = this.tilesPixels();
    if (!this.tiled || this.tiled.isShown || this.refiner.busy || pixels === null || !header || header.full_resolution) return;
    const expected = this.histogram ? trianglesAt(this.histogram, iso) : 0;
    if (this.limited || expected > most) this.tiled.ask({ surface: { ...stepOf(this.store, this.views.state), iso }, most, pixels });
  }

  /** The parameters that make the mesh that is shown, for an export or the command line; null if there is none. */
  asSeen(): Parameters | null {
    const { header } = this.drawn;
    if (!header) return null;
    const { step, camera, iso, label, box, components, smooth, effort, color } = this.asked;
    const same: Record<string, string | number> = {};
    for (const [name, value] of Object.entries({ step, iso, label, box, components, smooth, color })) if (value !== undefined) same[name] = value;
    if (header.stop === "distance") return { ...same, distance: header.tolerance, ...(effort === undefined ? {} : { effort }) };
    if (header.stop === "camera" && camera !== undefined) return { ...same, camera };
    return { ...same, error: header.tolerance };
  }

  /** For the surface of this label, as good as that of the selected one at rest. */
  parametersOf(label: number): Parameters {
    const { target, distance } = this.views.state;
    return { ...this.basis(label), ...(target === "distance" && !this.isSmooth() ? { distance } : { error: 0 }) };
  }

  /** At full resolution. */
  inFull(): Parameters {
    return { ...this.basis(), error: 0 };
  }

  /** While something moves; null: no surface is shown. */
  coarse(): Parameters | null {
    const { views, store } = this;
    if (!views.state.surface) return null;
    // Labels have no errors from which to choose a number of triangles.
    if (store.labels || this.isSmooth()) return { ...this.basis(), error: 0 };
    // For a remote store: what needs nothing more from the network.
    if (store.first_error !== null) return { ...this.basis(), error: store.first_error, limit: views.state.moving };
    return { ...this.basis(), triangles: views.state.moving };
  }

  /** What selects the surface; that of `label`, if given, instead of the state's. */
  private basis(label?: number): Parameters {
    const { iso, box, largest } = this.views.state;
    const smooth = this.isSmooth();
    return {
      ...stepOf(this.store, this.views.state),
      ...(this.store.labels || smooth ? { label: label ?? Math.round(iso) } : { iso }),
      ...(box && !smooth ? { box: box.join(",") } : {}),
      ...(smooth ? { smooth: kPasses } : {}),
      ...(largest ? { components: "largest" } : {}),
      ...(this.color === "" ? {} : { color: this.color }),
    };
  }

  /** The quantity that colours the surface; empty: none. */
  private get color(): string {
    const { color } = this.views.state;
    return this.store.quantities.some(({ name }) => name === color) ? color : "";
  }

  private paint(): void {
    const { colorMap, colorWindow } = this.views.state;
    paintByValue(this.drawn.material, this.drawn.header, colorMap, colorWindow, this.drawn.header?.color !== undefined);
  }

  /** A label's smooth surface is wanted: it is made as a whole, without refinement. */
  private isSmooth(): boolean {
    return mayBeLabels(this.store) && this.views.state.smooth;
  }

  private camera(pixels: number): string {
    return [...this.stage.seen, pixels].map((part) => Number(part.toPrecision(9))).join(",");
  }

  /** An invisible distance, for meshes within a distance: half of `pixels` of the screen, like a camera's triangles. */
  private unseenDistance(): number | null {
    const { store } = this;
    const { pixels, box } = this.views.state;
    const unseen = (pixels / 2) * this.stage.leastUnitsPerPixel(box ?? store.box);
    const nodes = store.nodes.reduce((product, count) => product * count, 1);
    if (!(unseen >= kMinDistance * Math.min(...store.spacing)) || nodes > kMaxSimplified) return null;
    return 2 ** (Math.floor(2 * Math.log2(unseen)) / 2); // in steps, so that small moves have no effect
  }

  private steps(): readonly Step[] {
    const state: ViewState = this.views.state;
    const { most: limit, pixels } = state;
    const basis = this.basis();
    if (this.isSmooth() || (this.store.labels && state.target !== "distance")) return [];
    const first: Step = {
      parameters: { ...basis, triangles: Math.min(kFirstSteps * state.moving, limit) },
      aim: "with more triangles",
    };
    switch (state.target) {
      case "screen": {
        const distance = this.unseenDistance();
        const within: Parameters = distance === null ? { camera: this.camera(pixels) } : { distance, effort: "fast" };
        return [
          { parameters: { ...basis, camera: this.camera(4 * pixels), limit }, aim: `to ${4 * pixels} pixels` },
          { parameters: { ...basis, ...within, limit }, aim: "to the screen's resolution" },
        ];
      }
      case "full":
        return [first, { parameters: { ...basis, error: 0, limit }, aim: "to full resolution" }];
      case "error":
        return [first, { parameters: { ...basis, error: state.error, limit }, aim: "to the chosen error" }];
      case "distance":
        return [{ parameters: { ...basis, distance: state.distance }, aim: "to the chosen distance" }];
      case "triangles":
        return [{ parameters: { ...basis, triangles: Math.min(state.triangles, limit) }, aim: "to the chosen number of triangles" }];
    }
  }

  private enough(shown: MeshHeader): boolean {
    const { target, error, moving } = this.views.state;
    if (shown.stop === "smooth") return true;
    const unseen = target === "screen" ? this.unseenDistance() : null;
    if (target === "screen" && shown.stop === "distance") {
      return unseen !== null && shown.tolerance <= unseen && shown.tolerance > unseen / 4;
    }
    if (unseen !== null && shown.triangles > moving) return false; // fewer triangles look the same
    if (shown.full_resolution && target !== "distance") return true;
    return target === "error" && shown.error_bound !== null && shown.error_bound <= error && shown.tolerance >= error;
  }
}

/** Triangles of a surface at full resolution, roughly; 0 if nothing is known about them. */
function trianglesAt({ bins, cube_level: level }: HistogramInfo, iso: number): number {
  const bin = bins.findLast(({ low }) => low <= iso);
  const kInCube = 4 * 4 ** (level ?? 0);
  return bin?.cubes ? bin.cubes * kInCube : 0;
}
