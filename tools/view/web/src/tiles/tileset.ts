// The octree of a tileset (3D Tiles, query/TILES.md), as far as its lists have been read.
import type { Vector } from "../protocol";

export interface TileJson {
  readonly boundingVolume: { readonly box: readonly number[] };
  readonly geometricError: number;
  readonly transform?: readonly number[];
  readonly content?: { readonly uri: string };
  readonly children?: readonly TileJson[];
  readonly extras?: { readonly triangles?: number };
}

export interface TilesetJson {
  readonly asset: { readonly generator?: string };
  readonly root: TileJson;
}

const kMatrix = 16;

/** The matrix of a tileset, by columns. */
export function transformOf({ root }: TilesetJson): readonly number[] {
  const { transform } = root;
  if (transform?.length !== kMatrix || !transform.every(Number.isFinite)) throw new Error("the list of tiles has no valid transform");
  return transform;
}

/** A tile with its mesh, once that is loaded. `Mesh`: what is drawn. */
export class Tile<Mesh> {
  /** Of the box around its mesh and all below; in the tileset's coordinates, along its axes. */
  readonly centre: Vector;
  readonly half: Vector;
  /** Proven distance from the full surface, world units. */
  readonly error: number;
  readonly triangles: number;
  /** Path of the file of its mesh; null: it has none, and its parts are always shown instead. */
  content: string | null = null;
  /** Path of a list with its content and children, which has not been read; null: they are known. */
  list: string | null = null;
  children: readonly Tile<Mesh>[] = [];
  mesh: Mesh | null = null;
  /** Number of the frame in which it was last needed. */
  used = 0;

  /** `folder`: to which paths are relative. Throws Error for an invalid list. */
  constructor(json: TileJson, folder: string) {
    const { box } = json.boundingVolume;
    const at = (i: number): number => box[i] ?? NaN;
    this.centre = [at(0), at(1), at(2)];
    this.half = [at(3), at(7), at(11)];
    this.error = json.geometricError;
    this.triangles = json.extras?.triangles ?? NaN;
    if (![...this.centre, ...this.half, this.error, this.triangles].every(Number.isFinite)) throw new Error("the list of tiles is not valid");
    this.take(json, folder);
  }

  /** Takes content and children from the root of its list, which is in `folder`. */
  take(json: TileJson, folder: string): void {
    const uri = json.content?.uri;
    const path = uri === undefined ? null : resolved(folder, uri);
    const isList = path?.endsWith(".json") ?? false;
    this.list = isList ? path : null;
    this.content = isList ? null : path;
    this.children = (json.children ?? []).map((child) => new Tile<Mesh>(child, folder));
  }

  /** Nothing is finer. */
  get isLeaf(): boolean {
    return this.list === null && this.children.length === 0;
  }
}

/** The folder of a file, with a slash at its end unless it is the tileset's own. */
export function folderOf(path: string): string {
  return path.slice(0, path.lastIndexOf("/") + 1);
}

function resolved(folder: string, uri: string): string {
  const parts = folder.split("/").filter((part) => part !== "");
  for (const part of uri.split("/")) {
    if (part === "..") parts.pop();
    else if (part !== ".") parts.push(part);
  }
  return parts.join("/");
}
