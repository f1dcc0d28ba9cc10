// A surface with more triangles than the page may show, as tiles that the server makes. Loading never blocks: what is loaded is
// drawn, and each frame chooses anew from it.
import { Matrix4, type RawShaderMaterial, Vector3, Vector4 } from "three";
import { type Api, type Parameters, ServerError } from "../api";
import type { TilesInfo, Vector } from "../protocol";
import type { Stage } from "../stage";
import { DrawnTiles, type DrawnTile } from "./drawn_tiles";
import { selectTiles, type Selection, type View } from "./selection";
import { folderOf, Tile, transformOf } from "./tileset";

/** What is wanted: the full surface, and how much of it may be shown. */
export interface TilesWish {
  /** The isovalue, and the step of a series. */
  readonly surface: Parameters;
  /** Triangles on the screen. */
  readonly most: number;
  /** Errors up to this many pixels are small enough. */
  readonly pixels: number;
}

export type TilesState = "off" | "making" | "loading" | "shown" | "unneeded" | "unusable" | "failed";

type SurfaceTile = Tile<DrawnTile>;

const kPause = 400; // milliseconds between two questions about tiles in the making
const kAtATime = 6; // tiles
const kNotFound = 404;
/** Triangles that are kept on the graphics card, as a multiple of those that may be on the screen. */
const kKept = 2;

export class TiledSurface {
  state: TilesState = "off";
  info: TilesInfo | null = null;
  /** Why there are no tiles; null: there is no reason to say. */
  trouble: string | null = null;
  readonly drawn: DrawnTiles;
  selection: Selection<DrawnTile> | null = null;
  /** Tiles that have been loaded since the beginning. */
  loads = 0;
  private wish: TilesWish | null = null;
  private abort = new AbortController();
  private axes: readonly number[] = [];
  private toTileset = new Matrix4();
  private coarsest: readonly SurfaceTile[] = [];
  private readonly loaded = new Set<SurfaceTile>();
  private readonly loading = new Set<SurfaceTile>();

  constructor(
    private readonly api: Api,
    private readonly stage: Stage,
    id: number,
    material: RawShaderMaterial,
    /** Tiles replace the mesh, from now on. */
    private readonly begin: () => void,
    /** Called when anything of the above has changed. */
    private readonly changed: () => void,
    private readonly failed: (error: Error) => void,
    /** The server has dropped the tiles in favour of others: the surface is to be shown anew. */
    private readonly dropped: () => void,
  ) {
    this.drawn = new DrawnTiles(id, material);
    stage.add(this.drawn);
    stage.onAim(() => this.choose());
  }

  /** Whether the surface is shown by tiles. */
  get isShown(): boolean {
    return this.state === "shown";
  }

  get busy(): boolean {
    return this.state === "making" || this.state === "loading" || this.loading.size > 0 || (this.isShown && (this.selection?.wanted.length ?? 0) > 0);
  }

  /** Nothing changes if the tiles of the same surface are known or on their way. */
  ask(wish: TilesWish): void {
    const same = this.wish !== null && key(this.wish) === key(wish);
    if (!same) {
      this.stop();
      this.empty();
    }
    this.wish = wish;
    if (same) return;
    this.state = "making";
    void this.make(wish, this.abort.signal);
  }

  /** Another accuracy of the same surface. */
  look(pixels: number): void {
    if (this.wish) this.wish = { ...this.wish, pixels };
    this.stage.invalidate();
  }

  /** Nothing is wanted any more. What is shown stays until clear(). */
  stop(): void {
    if (this.state === "off") return;
    if (this.state === "making") this.api.endTiles();
    this.abort.abort();
    this.abort = new AbortController();
    this.loading.clear();
    this.wish = this.info = this.trouble = this.selection = null;
    this.state = "off";
    this.changed();
  }

  /** Shows nothing, unless tiles are shown that are wanted. */
  clear(): void {
    if (!this.isShown) this.empty();
  }

  private empty(): void {
    this.drawn.show([], 0);
    for (const tile of this.loaded) if (tile.mesh) this.drawn.remove(tile.mesh);
    this.loaded.clear();
    this.coarsest = [];
    this.stage.invalidate();
  }

  private async make(wish: TilesWish, signal: AbortSignal): Promise<void> {
    try {
      for (;;) {
        const info = await this.api.tiles({ ...wish.surface, limit: wish.most });
        if (signal.aborted) return;
        this.info = info;
        if (info.state === "ready" && info.tileset !== undefined) {
          this.state = "loading";
          this.changed();
          return await this.open(info.tileset, wish, signal);
        }
        if (info.state === "unneeded") {
          this.state = "unneeded";
          return this.changed();
        }
        this.changed();
        await new Promise((resolve) => setTimeout(resolve, kPause));
        if (signal.aborted) return;
      }
    } catch (error) {
      this.fail(error as Error, signal);
    }
  }

  /** Loads the coarsest tiles, then shows them. */
  private async open(tileset: string, wish: TilesWish, signal: AbortSignal): Promise<void> {
    const list = await this.api.tileList(tileset, "tileset.json", signal);
    const transform = transformOf(list);
    this.axes = transform.slice(0, 12);
    const matrix = new Matrix4().fromArray([...transform]);
    this.toTileset = matrix.clone().invert();
    this.drawn.setTransform(transform);
    const root: SurfaceTile = new Tile(list.root, "");
    const coarsest = await this.coarsestOf(root, wish.most, signal);
    if (signal.aborted) return;
    if (coarsest === null) {
      this.state = "unusable";
      this.trouble = "This surface cannot be simplified to tiles that are few enough.";
      return this.changed();
    }
    await Promise.all(coarsest.map((tile) => this.load(tile, signal)));
    if (signal.aborted || coarsest.some(({ mesh }) => mesh === null)) return;
    this.coarsest = coarsest;
    this.state = "shown";
    this.choose();
    this.begin();
    this.stage.invalidate();
  }

  /** The coarsest tiles with meshes; null if these have too many triangles. */
  private async coarsestOf(root: SurfaceTile, most: number, signal: AbortSignal): Promise<readonly SurfaceTile[] | null> {
    const found: SurfaceTile[] = [];
    let triangles = 0;
    for (let open = [root]; open.length > 0; ) {
      const next: SurfaceTile[] = [];
      for (const tile of open) {
        if (tile.list !== null && tile.triangles === 0) await this.load(tile, signal);
        if (tile.triangles > 0) found.push(tile);
        else next.push(...tile.children);
        triangles += tile.triangles;
        if (triangles > most) return null;
      }
      open = next;
    }
    for (const tile of found) if (tile.list !== null) await this.load(tile, signal);
    return found;
  }

  /** Before each frame: what of the loaded tiles is shown, and what is to be loaded. */
  private choose(): void {
    const { wish, stage } = this;
    if (!this.isShown || !wish) return;
    const before = this.selection;
    const selection = selectTiles(this.coarsest, this.view(wish.pixels), wish.most, stage.frames);
    this.selection = selection;
    this.drawn.show(selection.drawn.flatMap(({ mesh }) => (mesh ? [mesh] : [])), selection.triangles);
    this.loadWanted();
    const isSame = before?.triangles === selection.triangles && before.pixels === selection.pixels && before.wanted.length === selection.wanted.length;
    if (!isSame) this.changed();
  }

  /** What the last choice wants, without waiting for the next frame. */
  private loadWanted(): void {
    for (const tile of this.selection?.wanted ?? []) {
      if (this.loading.size >= kAtATime) return;
      if (tile.mesh === null && !this.loading.has(tile)) void this.load(tile, this.abort.signal);
    }
  }

  private view(pixels: number): View {
    const { stage, toTileset } = this;
    const eye = stage.camera.position.clone().applyMatrix4(toTileset);
    // A plane's numbers are multiplied by the inverse's transpose, which here is that of the tileset's own matrix.
    const turn = toTileset.clone().invert().transpose();
    const planes = stage.sides.map((side) => new Vector4(...side).applyMatrix4(turn).toArray() as [number, number, number, number]);
    return { eye: vectorOf(eye), planes, unseen: (distance) => stage.unseenAt(distance), pixels };
  }

  /** Reads the tile's list, then its mesh. */
  private async load(tile: SurfaceTile, signal: AbortSignal): Promise<void> {
    const tileset = this.info?.tileset;
    if (tileset === undefined) return;
    this.loading.add(tile);
    try {
      if (tile.list !== null) {
        const { root } = await this.api.tileList(tileset, tile.list, signal);
        tile.take(root, folderOf(tile.list));
      }
      if (tile.content !== null && tile.mesh === null) {
        const mesh = await this.api.tile(tileset, tile.content, this.axes, signal);
        if (signal.aborted) return;
        tile.mesh = this.drawn.add(mesh);
        tile.used = this.stage.frames;
        this.loaded.add(tile);
        ++this.loads;
        this.evict();
      }
    } catch (error) {
      this.fail(error as Error, signal);
    }
    if (signal.aborted) return;
    this.loading.delete(tile);
    this.loadWanted();
    this.stage.invalidate();
    this.changed();
  }

  /** Frees tiles that have not been needed for longest, if there are too many. */
  private evict(): void {
    const most = kKept * (this.wish?.most ?? 0);
    let triangles = [...this.loaded].reduce((sum, tile) => sum + tile.triangles, 0);
    if (triangles <= most) return;
    const idle = [...this.loaded].filter(({ used }) => used + 1 < this.stage.frames).sort((a, b) => a.used - b.used);
    for (const tile of idle) {
      if (triangles <= most) return;
      if (this.coarsest.includes(tile) || !tile.mesh) continue;
      this.drawn.remove(tile.mesh);
      tile.mesh = null;
      this.loaded.delete(tile);
      triangles -= tile.triangles;
    }
  }

  private fail(error: Error, signal: AbortSignal): void {
    if (signal.aborted || (error instanceof ServerError && error.superseded)) return;
    if (error instanceof ServerError && error.status === kNotFound) return this.dropped();
    this.abort.abort();
    this.abort = new AbortController();
    this.loading.clear();
    const wasShown = this.isShown;
    this.state = "failed";
    this.trouble = error.message;
    if (wasShown || !(error instanceof ServerError)) this.failed(error);
    this.changed();
  }
}

function key({ surface, most }: TilesWish): string {
  return JSON.stringify([surface, most]);
}

function vectorOf({ x, y, z }: Vector3): Vector {
  return [x, y, z];
}
