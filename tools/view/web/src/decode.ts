// Decodes a mesh of the protocol for drawing. Runs in the worker, independent of the page.
import { MeshoptDecoder } from "meshoptimizer/decoder";
import { type Measure, measureOf } from "./measure";
import type { MeshHeader, Section } from "./protocol";

export interface Mesh {
  readonly header: MeshHeader;
  /** Four per vertex: the position's three coordinates, and a slice's value. */
  readonly positions: Uint16Array<ArrayBuffer>;
  /** Four per vertex; empty for a slice. */
  readonly normals: Int8Array<ArrayBuffer>;
  /** Three per triangle. */
  readonly indices: Uint32Array<ArrayBuffer>;
  /** Bytes of the answer as received. */
  readonly bytes: number;
  /** Of a surface; null for a slice. */
  readonly measure: Measure | null;
}

const kAlignment = 16;

/** Throws Error if the bytes are not a mesh of version 1. */
export async function decodeMesh(buffer: ArrayBuffer): Promise<Mesh> {
  await MeshoptDecoder.ready;
  if (buffer.byteLength < kAlignment) throw new Error("the answer is too short to be a mesh");
  const fixed = new DataView(buffer);
  if (fixed.getUint32(0, true) !== 0x564f5349) throw new Error("the answer is not a mesh");
  if (fixed.getUint32(4, true) !== 1) throw new Error("the mesh is of another version of the protocol: reload the page");
  const length = fixed.getUint32(8, true);
  if (kAlignment + length > buffer.byteLength) throw new Error("the mesh is cut off");
  const text = new TextDecoder("utf-8", { fatal: true }).decode(new Uint8Array(buffer, kAlignment, length));
  const header = JSON.parse(text) as MeshHeader;
  const sections = new Map<string, Uint8Array<ArrayBuffer>>();
  let at = kAlignment + length;
  for (const section of header.sections) {
    if (at + section.bytes > buffer.byteLength) throw new Error("the mesh is cut off");
    sections.set(section.name, decodeSection(section, new Uint8Array(buffer, at, section.bytes)));
    at += Math.ceil(section.bytes / kAlignment) * kAlignment;
  }
  const positions = sections.get("positions") ?? new Uint8Array();
  const normals = sections.get("normals") ?? new Uint8Array();
  const indices = sections.get("indices") ?? new Uint8Array();
  if (positions.length !== 8 * header.vertices || indices.length !== 12 * header.triangles) {
    throw new Error("the mesh does not match its header");
  }
  const mesh = { header, positions: new Uint16Array(positions.buffer), normals: new Int8Array(normals.buffer), indices: new Uint32Array(indices.buffer) };
  const isSurface = normals.length > 0;
  return { ...mesh, bytes: buffer.byteLength, measure: isSurface ? measureOf(mesh.positions, mesh.indices, header.step) : null };
}

/** In a separate buffer. */
function decodeSection(section: Section, source: Uint8Array): Uint8Array<ArrayBuffer> {
  const target = new Uint8Array(section.count * section.stride);
  switch (section.encoding) {
    case "raw":
      if (source.length !== target.length) throw new Error(`the section ${section.name} has the wrong length`);
      target.set(source);
      break;
    case "meshopt_vertex":
      MeshoptDecoder.decodeVertexBuffer(target, section.count, section.stride, source);
      break;
    case "meshopt_index":
      MeshoptDecoder.decodeIndexBuffer(target, section.count, section.stride, source);
      break;
    default:
      throw new Error(`the section ${section.name} is encoded as '${section.encoding}', which this page does not know`);
  }
  return target;
}
