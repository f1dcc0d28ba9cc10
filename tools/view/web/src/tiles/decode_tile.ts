// Decodes the glTF file of a tile, as query/tiles/tile_glb.cpp writes it. Runs in the worker.
import { MeshoptDecoder } from "meshoptimizer/decoder";
import type { Vector } from "../protocol";

export interface TileMesh {
  /** Four per vertex: the position's three coordinates, in steps, and 0. */
  readonly positions: Uint16Array<ArrayBuffer>;
  /** Four per vertex, in the world. */
  readonly normals: Int8Array<ArrayBuffer>;
  readonly indices: Uint16Array<ArrayBuffer> | Uint32Array<ArrayBuffer>;
  /** A position is origin + step * coordinates, in the tileset's coordinates. */
  readonly origin: Vector;
  readonly step: Vector;
}

interface Packed {
  readonly byteOffset?: number;
  readonly byteLength: number;
  readonly byteStride: number;
  readonly count: number;
  readonly mode: string;
  readonly filter?: string;
}

interface Head {
  readonly nodes: readonly { readonly translation: readonly number[]; readonly scale: readonly number[]; readonly rotation: readonly number[] }[];
  readonly meshes: readonly { readonly primitives: readonly { readonly attributes: Readonly<Record<string, number>>; readonly indices: number }[] }[];
  readonly accessors: readonly { readonly bufferView: number; readonly count: number; readonly componentType: number }[];
  readonly bufferViews: readonly {
    readonly byteOffset?: number;
    readonly byteLength: number;
    readonly byteStride?: number;
    readonly extensions?: { readonly EXT_meshopt_compression?: Packed };
  }[];
}

const kHeader = 20;
const kChunk = 8;
const kShort = 5123;
const kQuarterTurn = Math.SQRT1_2;

/** `axes`: the first 12 numbers of the tileset's transform, whose directions turn normals into the world. Throws Error if the bytes are no tile. */
export async function decodeTile(buffer: ArrayBuffer, axes: readonly number[]): Promise<TileMesh> {
  await MeshoptDecoder.ready;
  const view = new DataView(buffer);
  if (buffer.byteLength < kHeader + kChunk || view.getUint32(0, true) !== 0x46546c67) throw new Error("the answer is not a tile");
  const length = view.getUint32(12, true);
  const start = kHeader + length + kChunk;
  if (start > buffer.byteLength || view.getUint32(8, true) !== buffer.byteLength) throw new Error("the tile is cut off");
  const head = JSON.parse(new TextDecoder("utf-8", { fatal: true }).decode(new Uint8Array(buffer, kHeader, length))) as Head;
  const node = head.nodes[0];
  const primitive = head.meshes[0]?.primitives[0];
  // In the file y is up: a quarter of a turn, which is undone here.
  const turn = node?.rotation ?? [];
  if (!node || !primitive || Math.abs((turn[0] ?? 0) + kQuarterTurn) > 1e-9 || Math.abs((turn[3] ?? 0) - kQuarterTurn) > 1e-9) {
    throw new Error("the tile was not made by isonest");
  }
  const rows = (accessor: number | undefined, stride: number): Uint8Array<ArrayBuffer> => {
    const { bufferView, count } = head.accessors[accessor ?? -1] ?? { bufferView: -1, count: 0 };
    const found = head.bufferViews[bufferView];
    const packed = found?.extensions?.EXT_meshopt_compression;
    const part = packed ?? found;
    if (!part || (part.byteStride ?? stride) !== stride) throw new Error("the tile has other numbers than expected");
    const source = new Uint8Array(buffer, start + (part.byteOffset ?? 0), part.byteLength);
    const target = new Uint8Array(count * stride);
    if (packed) MeshoptDecoder.decodeGltfBuffer(target, packed.count, packed.byteStride, source, packed.mode, packed.filter);
    else target.set(source.subarray(0, target.length));
    return target;
  };
  const positions = new Uint16Array(rows(primitive.attributes.POSITION, 8).buffer);
  const vertices = positions.length / 4;
  const normals = primitive.attributes.NORMAL === undefined ? new Int8Array(4 * vertices) : new Int8Array(rows(primitive.attributes.NORMAL, 4).buffer);
  turnNormals(normals, axes);
  const isShort = head.accessors[primitive.indices]?.componentType === kShort;
  const corners = rows(primitive.indices, isShort ? 2 : 4).buffer;
  const [x = 0, y = 0, z = 0] = node.translation;
  const [sx = 0, sy = 0, sz = 0] = node.scale;
  return { positions, normals, indices: isShort ? new Uint16Array(corners) : new Uint32Array(corners), origin: [x, -z, y], step: [sx, sy, sz] };
}

function turnNormals(normals: Int8Array, axes: readonly number[]): void {
  const [xx = 1, xy = 0, xz = 0, , yx = 0, yy = 1, yz = 0, , zx = 0, zy = 0, zz = 1] = axes;
  if (xx === 1 && yy === 1 && zz === 1) return;
  for (let i = 0; i < normals.length; i += 4) {
    const [a, b, c] = [normals[i]!, normals[i + 1]!, normals[i + 2]!];
    normals[i] = Math.round(xx * a + yx * b + zx * c);
    normals[i + 1] = Math.round(xy * a + yy * b + zy * c);
    normals[i + 2] = Math.round(xz * a + yz * b + zz * c);
  }
}
