// Vectors, boxes and planes in world coordinates.
import type { Box, StoreInfo, Vector } from "./protocol";
import type { SliceName, ViewState } from "./state";

export function dot(a: readonly number[], b: readonly number[]): number {
  return a.reduce((sum, part, i) => sum + part * (b[i] ?? 0), 0);
}
export function centreOf(box: Box): Vector {
  return [(box[0] + box[3]) / 2, (box[1] + box[4]) / 2, (box[2] + box[5]) / 2];
}
/** Radius of the sphere around the box; never 0. */
export function radiusOf(box: Box): number {
  return Math.hypot(box[3] - box[0], box[4] - box[1], box[5] - box[2]) / 2 || 1;
}
export function lengthOf(a: Vector, b: Vector): number {
  return Math.hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
}

/** Distance from a point to the sphere around the box: 0 if inside. */
export function lengthToBall(from: Vector, box: Box): number {
  return Math.max(lengthOf(from, centreOf(box)) - radiusOf(box), 0);
}

/** The unit normal of the data's planes across an axis: the axis itself unless the axes are sheared. */
export function axisNormal(axis: 0 | 1 | 2, store: StoreInfo): Vector {
  const b = store.direction[((axis + 1) % 3) as 0 | 1 | 2];
  const c = store.direction[((axis + 2) % 3) as 0 | 1 | 2];
  const own = store.direction[axis];
  if (Math.max(Math.abs(dot(own, b)), Math.abs(dot(own, c))) < 1e-9) return own;
  const across: Vector = [b[1] * c[2] - b[2] * c[1], b[2] * c[0] - b[0] * c[2], b[0] * c[1] - b[1] * c[0]];
  const length = Math.hypot(...across);
  return [across[0] / length, across[1] / length, across[2] / length];
}

/** The slice's unit normal: that of the data's planes across an axis, or the oblique one's. */
export function normalOf(name: SliceName, state: ViewState, store: StoreInfo): Vector {
  if (name !== "o") return axisNormal(name === "x" ? 0 : name === "y" ? 1 : 2, store);
  const turn = (state.turn * Math.PI) / 180;
  const tilt = (state.tilt * Math.PI) / 180;
  return [Math.cos(turn) * Math.cos(tilt), Math.sin(turn) * Math.cos(tilt), Math.sin(tilt)];
}

/** nx, ny, nz, d of the slice's plane. */
export function planeOf(name: SliceName, state: ViewState, store: StoreInfo): readonly [number, number, number, number] {
  const normal = normalOf(name, state, store);
  const offset = name === "o" ? dot(normal, centreOf(store.box)) : 0;
  return [...normal, state.slices[name].at + offset];
}

/** The smallest and largest `at` for which the plane intersects the volume. */
export function reachOf(name: SliceName, state: ViewState, store: StoreInfo): readonly [number, number] {
  const normal = normalOf(name, state, store);
  const places = cornersOf(store).map((corner) => dot(normal, corner));
  const offset = name === "o" ? dot(normal, centreOf(store.box)) : 0;
  return [Math.min(...places) - offset, Math.max(...places) - offset];
}

/** The eight corners of the data, whose axes may be rotated in the world. */
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
