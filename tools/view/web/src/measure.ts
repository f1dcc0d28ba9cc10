// Area and volume of a mesh.
import type { Vector } from "./protocol";

export interface Measure {
  /** In square world units. */
  readonly area: number;
  /** Enclosed, in cubic world units; null if the mesh is not closed. */
  readonly volume: number | null;
}

/**
 * `positions`: four per vertex, in quantisation steps. A mesh is closed if each of its edges is passed as often in one direction
 * as in the other. This is found from two sums of 32 bits over hashes of the edges, with opposite signs in opposite directions,
 * which are both 0; a table of all edges would take more memory than the mesh. A mesh that is open by chance has sums of 0 in
 * one of 2^64 cases.
 */
export function measureOf(positions: Uint16Array, indices: Uint32Array, step: Vector): Measure {
  const [sx, sy, sz] = step;
  let area = 0;
  let volume = 0;
  let first = 0;
  let second = 0;
  const pass = (from: number, to: number): void => {
    const [low, high, sign] = from < to ? [from, to, 1] : [to, from, -1];
    let hash = Math.imul(low, 0x9e3779b1) ^ Math.imul(high ^ (high >>> 15), 0x85ebca6b);
    hash = Math.imul(hash ^ (hash >>> 16), 0x21f0aaad);
    first = (first + sign * (hash ^ (hash >>> 15))) | 0;
    hash = Math.imul(high, 0xc2b2ae35) ^ Math.imul(low ^ (low >>> 13), 0x27d4eb2f);
    hash = Math.imul(hash ^ (hash >>> 15), 0x735a2d97);
    second = (second + sign * (hash ^ (hash >>> 16))) | 0;
  };
  for (let i = 0; i + 2 < indices.length; i += 3) {
    const [a, b, c] = [indices[i]!, indices[i + 1]!, indices[i + 2]!];
    const [ax, ay, az] = [positions[4 * a]! * sx, positions[4 * a + 1]! * sy, positions[4 * a + 2]! * sz];
    const [ux, uy, uz] = [positions[4 * b]! * sx - ax, positions[4 * b + 1]! * sy - ay, positions[4 * b + 2]! * sz - az];
    const [vx, vy, vz] = [positions[4 * c]! * sx - ax, positions[4 * c + 1]! * sy - ay, positions[4 * c + 2]! * sz - az];
    const [nx, ny, nz] = [uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx];
    area += Math.sqrt(nx * nx + ny * ny + nz * nz);
    volume += ax * nx + ay * ny + az * nz;
    pass(a, b);
    pass(b, c);
    pass(c, a);
  }
  return { area: area / 2, volume: first === 0 && second === 0 ? Math.abs(volume) / 6 : null };
}
