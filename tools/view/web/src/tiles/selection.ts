// Which tiles are shown: from the coarsest on, always the one with the largest error on the screen is replaced by its parts,
// until all errors are small enough, or no more triangles are allowed. A tile stays until all of its parts are loaded.
import type { Vector } from "../protocol";
import type { Tile } from "./tileset";

/** What the camera sees, in the tileset's coordinates. */
export interface View {
  readonly eye: Vector;
  /** Sides of the picture: a, b, c, d with ax + by + cz + d >= 0 in it, and a, b, c of length 1. */
  readonly planes: readonly (readonly [number, number, number, number])[];
  /** World units that are at most a pixel at this distance from the eye. */
  readonly unseen: (distance: number) => number;
  /** Errors up to this many pixels are small enough. */
  readonly pixels: number;
}

export interface Selection<Mesh> {
  /** Tiles with meshes; together they have `triangles` triangles. */
  readonly drawn: readonly Tile<Mesh>[];
  readonly triangles: number;
  /** The largest error of what is drawn: in world units, and on the screen. */
  readonly error: number;
  readonly pixels: number;
  /** Nothing is finer than what is drawn. */
  readonly full: boolean;
  /** What is to be loaded, the most urgent first: tiles without their mesh, or without their list. */
  readonly wanted: readonly Tile<Mesh>[];
  /** A tile is not finer because of the limit for triangles. */
  readonly limited: boolean;
}

/** An upper bound of its error on the screen, in pixels. */
export function pixelsOf<Mesh>({ centre, half, error }: Tile<Mesh>, { eye, unseen }: View): number {
  const away = ([0, 1, 2] as const).map((i) => Math.max(Math.abs(eye[i] - centre[i]) - half[i], 0));
  return error / unseen(Math.hypot(...away));
}

export function isSeen<Mesh>({ centre, half }: Tile<Mesh>, { planes }: View): boolean {
  return planes.every(([a, b, c, d]) => {
    const reach = Math.abs(a) * half[0] + Math.abs(b) * half[1] + Math.abs(c) * half[2];
    return a * centre[0] + b * centre[1] + c * centre[2] + d >= -reach;
  });
}

/** `coarsest`: tiles with meshes that together cover the surface, all loaded. `most`: limit for triangles. `frame`: its number. */
export function selectTiles<Mesh>(coarsest: readonly Tile<Mesh>[], view: View, most: number, frame: number): Selection<Mesh> {
  const queue = new Queue<Tile<Mesh>>();
  const drawn: Tile<Mesh>[] = [];
  const wanted: Tile<Mesh>[] = [];
  let triangles = 0;
  let reserved = 0; // for tiles that are being loaded
  let error = 0;
  let pixels = 0;
  let limited = false;
  const add = (tile: Tile<Mesh>): void => {
    tile.used = frame;
    if (isSeen(tile, view)) queue.add(tile, pixelsOf(tile, view));
  };
  const draw = (tile: Tile<Mesh>, inPixels: number): void => {
    drawn.push(tile);
    error = Math.max(error, tile.error);
    pixels = Math.max(pixels, inPixels);
  };
  for (const tile of coarsest) add(tile);
  triangles = queue.items.reduce((sum, tile) => sum + tile.triangles, 0);
  for (let next = queue.take(); next; next = queue.take()) {
    const [tile, inPixels] = next;
    if (inPixels <= view.pixels || tile.isLeaf) {
      draw(tile, inPixels);
      continue;
    }
    const parts = tile.children.filter((child) => isSeen(child, view));
    const more = parts.reduce((sum, { triangles }) => sum + triangles, 0) - tile.triangles;
    const missing = tile.list === null ? tile.children.filter(({ mesh }) => mesh === null) : [tile];
    if (tile.list === null && triangles + reserved + more > most) {
      limited = true;
      draw(tile, inPixels);
    } else if (missing.length > 0) {
      reserved += Math.max(more, 0);
      for (const part of tile.children) part.used = frame; // those that are loaded stay
      wanted.push(...missing);
      draw(tile, inPixels);
    } else {
      triangles += more;
      for (const part of tile.children) add(part);
    }
  }
  return { drawn, triangles, error, pixels, full: drawn.every(({ isLeaf }) => isLeaf), wanted, limited };
}

/** A priority queue. */
class Queue<T> {
  private readonly heap: (readonly [T, number])[] = [];

  get items(): readonly T[] {
    return this.heap.map(([item]) => item);
  }

  add(item: T, priority: number): void {
    const { heap } = this;
    heap.push([item, priority]);
    for (let i = heap.length - 1; i > 0; ) {
      const up = (i - 1) >> 1;
      if (heap[up]![1] >= heap[i]![1]) return;
      [heap[up], heap[i]] = [heap[i]!, heap[up]!];
      i = up;
    }
  }

  /** The item with the highest priority, and that priority. */
  take(): readonly [T, number] | null {
    const { heap } = this;
    const first = heap[0];
    const last = heap.pop();
    if (!first || !last) return null;
    if (heap.length === 0) return first;
    heap[0] = last;
    for (let i = 0; ; ) {
      let high = i;
      for (const down of [2 * i + 1, 2 * i + 2]) if (down < heap.length && heap[down]![1] > heap[high]![1]) high = down;
      if (high === i) return first;
      [heap[high], heap[i]] = [heap[i]!, heap[high]!];
      i = high;
    }
  }
}
