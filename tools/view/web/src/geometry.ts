// Vectors, boxes and planes of the world.
import type { Box, StoreInfo, Vector } from "./protocol";
import type { SliceName, ViewState } from "./state";

export function dot(a: readonly number[], b: readonly number[]): number {
  return a.reduce((sum, part, i) => sum + part * (b[i] ?? 0), 0);
}
export function centreOf(box: Box): Vector {
  return [(box[0] + box[3]) / 2, (box[1] + box[4]) / 2, (box[2] + box[5]) / 2];
}
/** Of the ball around the box; never 0. */
export function radiusOf(box: Box): number {
  return Math.hypot(box[3] - box[0], box[4] - box[1], box[5] - box[2]) / 2 || 1;
}
export function lengthOf(a: Vector, b: Vector): number {
  return Math.hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
}

/** From a place to the ball around the box: 0 from within. */
export function lengthToBall(from: Vector, box: Box): number {
  return Math.max(lengthOf(from, centreOf(box)) - radiusOf(box), 0);
}

/** The slice's unit normal: an axis of the data, or the oblique one's. */
export function normalOf(name: SliceName, state: ViewState, store: StoreInfo): Vector {
  if (name !== "o") return store.direction[name === "x" ? 0 : name === "y" ? 1 : 2];
  const turn = (state.turn * Math.PI) / 180;
  const tilt = (state.tilt * Math.PI) / 180;
  return [Math.cos(turn) * Math.cos(tilt), Math.sin(turn) * Math.cos(tilt), Math.sin(tilt)];
}

/** nx, ny, nz, d of the plane that the slice lies in. */
export function planeOf(name: SliceName, state: ViewState, store: StoreInfo): readonly [number, number, number, number] {
  const normal = normalOf(name, state, store);
  const offset = name === "o" ? dot(normal, centreOf(store.box)) : 0;
  return [...normal, state.slices[name].at + offset];
}

/** The least and the largest `at` for which the plane meets the volume. */
export function reachOf(name: SliceName, state: ViewState, store: StoreInfo): readonly [number, number] {
  const normal = normalOf(name, state, store);
  const places = cornersOf(store).map((corner) => dot(normal, corner));
  const offset = name === "o" ? dot(normal, centreOf(store.box)) : 0;
  return [Math.min(...places) - offset, Math.max(...places) - offset];
}

/** The eight corners of the data, which may stand askew in the world. */
export function cornersOf(store: StoreInfo): Vector[] {
  return [0, 1, 2, 3, 4, 5, 6, 7].map((corner) => {
    const place: [number, number, number] = [...store.origin];
    for (const axis of [0, 1, 2] as const) {
      const reach = (corner >> axis) & 1 ? (store.nodes[axis] - 1) * store.spacing[axis] : 0;
      for (const i of [0, 1, 2] as const) place[i] += store.direction[axis][i] * reach;
    }
    return place;
  });
}
