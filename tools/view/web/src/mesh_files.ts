// Mesh files that the page makes itself. Runs in the worker, independent of the page.
import type { Mesh } from "./decode";

export const kPageFormats = ["ply", "stl", "glb"] as const;
export type PageFormat = (typeof kPageFormats)[number];

/** World units; for a slice, PLY includes the values. Positions have the rounding of the message. */
export function meshFile(mesh: Mesh, format: PageFormat): Uint8Array<ArrayBuffer> {
  switch (format) {
    case "ply":
      return plyFile(mesh);
    case "stl":
      return stlFile(mesh);
    case "glb":
      return glbFile(mesh);
  }
}

/** Three numbers per vertex. */
function world({ header, positions }: Mesh): Float32Array<ArrayBuffer> {
  const { origin, step, vertices } = header;
  const out = new Float32Array(3 * vertices);
  for (let v = 0; v < vertices; ++v) {
    for (let c = 0; c < 3; ++c) out[3 * v + c] = origin[c]! + step[c]! * positions[4 * v + c]!;
  }
  return out;
}

/** Three numbers per vertex, of length 1; null for a slice. */
function normalsOf({ header, normals }: Mesh): Float32Array<ArrayBuffer> | null {
  if (normals.length === 0) return null;
  const out = new Float32Array(3 * header.vertices);
  for (let v = 0; v < header.vertices; ++v) {
    const [x, y, z] = [normals[4 * v]!, normals[4 * v + 1]!, normals[4 * v + 2]!];
    const length = Math.hypot(x, y, z);
    out.set(length > 0 ? [x / length, y / length, z / length] : [0, 0, 1], 3 * v);
  }
  return out;
}

function joined(...parts: readonly ArrayBufferView<ArrayBuffer>[]): Uint8Array<ArrayBuffer> {
  const out = new Uint8Array(parts.reduce((sum, part) => sum + part.byteLength, 0));
  let at = 0;
  for (const part of parts) {
    out.set(new Uint8Array(part.buffer, part.byteOffset, part.byteLength), at);
    at += part.byteLength;
  }
  return out;
}

/** Source: G. Turk, "The PLY polygon file format", 1994. */
function plyFile(mesh: Mesh): Uint8Array<ArrayBuffer> {
  const { header, indices } = mesh;
  const places = world(mesh);
  const normals = normalsOf(mesh);
  const { value_origin: least, value_step: step } = header;
  const hasValues = least !== undefined && step !== undefined;
  const names = ["x", "y", "z", ...(normals ? ["nx", "ny", "nz"] : []), ...(hasValues ? ["value"] : [])];
  const head = [
    "ply", "format binary_little_endian 1.0", "comment isonest", `element vertex ${header.vertices}`, ...names.map((name) => `property float ${name}`),
    `element face ${header.triangles}`, "property list uchar int vertex_indices", "end_header", "",
  ].join("\n");
  const vertices = new DataView(new ArrayBuffer(4 * names.length * header.vertices));
  let at = 0;
  const put = (value: number): void => {
    vertices.setFloat32(at, value, true);
    at += 4;
  };
  for (let v = 0; v < header.vertices; ++v) {
    for (let c = 0; c < 3; ++c) put(places[3 * v + c]!);
    if (normals) for (let c = 0; c < 3; ++c) put(normals[3 * v + c]!);
    if (hasValues) put(least + step * mesh.positions[4 * v + 3]!);
  }
  const faces = new DataView(new ArrayBuffer(13 * header.triangles));
  for (let t = 0; t < header.triangles; ++t) {
    faces.setUint8(13 * t, 3);
    for (let c = 0; c < 3; ++c) faces.setUint32(13 * t + 1 + 4 * c, indices[3 * t + c]!, true);
  }
  return joined(new TextEncoder().encode(head), vertices, faces);
}

/** Binary. */
function stlFile(mesh: Mesh): Uint8Array<ArrayBuffer> {
  const { header, indices } = mesh;
  const places = world(mesh);
  const kHead = 80;
  const kEach = 50;
  const out = new DataView(new ArrayBuffer(kHead + 4 + kEach * header.triangles));
  out.setUint32(kHead, header.triangles, true);
  for (let t = 0; t < header.triangles; ++t) {
    const corner = (i: number, c: number): number => places[3 * indices[3 * t + i]! + c]!;
    const edge = (i: number, c: number): number => corner(i, c) - corner(0, c);
    const cross = [0, 1, 2].map((c) => edge(1, (c + 1) % 3) * edge(2, (c + 2) % 3) - edge(1, (c + 2) % 3) * edge(2, (c + 1) % 3));
    const length = Math.hypot(...cross);
    const at = kHead + 4 + kEach * t;
    for (let c = 0; c < 3; ++c) {
      out.setFloat32(at + 4 * c, length > 0 ? cross[c]! / length : 0, true);
      for (let i = 0; i < 3; ++i) out.setFloat32(at + 12 * (i + 1) + 4 * c, corner(i, c), true);
    }
  }
  return new Uint8Array(out.buffer);
}

/** Source: Khronos Group, "glTF 2.0 Specification", section 4 (GLB). */
function glbFile(mesh: Mesh): Uint8Array<ArrayBuffer> {
  const { header, indices } = mesh;
  const places = world(mesh);
  const normals = normalsOf(mesh);
  const least = [Infinity, Infinity, Infinity];
  const largest = [-Infinity, -Infinity, -Infinity];
  for (let i = 0; i < places.length; ++i) {
    least[i % 3] = Math.min(least[i % 3]!, places[i]!);
    largest[i % 3] = Math.max(largest[i % 3]!, places[i]!);
  }
  const parts = [places, ...(normals ? [normals] : []), indices];
  const kFloat = 5126;
  const kUint32 = 5125;
  let at = 0;
  const views = parts.map((part) => {
    const view = { buffer: 0, byteOffset: at, byteLength: part.byteLength, target: part === indices ? 34963 : 34962 };
    at += part.byteLength;
    return view;
  });
  const accessors = parts.map((part, i) => ({
    bufferView: i, componentType: part === indices ? kUint32 : kFloat, count: part === indices ? indices.length : header.vertices,
    type: part === indices ? "SCALAR" : "VEC3", ...(part === places ? { min: least, max: largest } : {}),
  }));
  const json = JSON.stringify({
    asset: { version: "2.0", generator: "isonest" }, scene: 0, scenes: [header.triangles > 0 ? { nodes: [0] } : {}],
    ...(header.triangles > 0
      ? {
          nodes: [{ mesh: 0 }],
          meshes: [{ primitives: [{ attributes: { POSITION: 0, ...(normals ? { NORMAL: 1 } : {}) }, indices: parts.length - 1 }] }],
          buffers: [{ byteLength: at }], bufferViews: views, accessors,
        }
      : {}),
  });
  const text = new TextEncoder().encode(json.padEnd(Math.ceil(json.length / 4) * 4)); // all characters are ASCII
  const body = header.triangles > 0 ? at : 0;
  const words = (...values: number[]): Uint32Array<ArrayBuffer> => new Uint32Array(values);
  const kJson = 0x4e4f534a;
  const kBinary = 0x004e4942;
  const binary = body > 0 ? [words(body, kBinary), ...parts] : [];
  return joined(words(0x46546c67, 2, 20 + text.length + (body > 0 ? 8 + body : 0)), words(text.length, kJson), text, ...binary);
}
