// The Web Worker that decodes meshes and tiles and makes mesh files, so that the page never blocks.
import { decodeMesh } from "./decode";
import { meshFile, type PageFormat } from "./mesh_files";
import { decodeTile } from "./tiles/decode_tile";

export interface DecodeRequest {
  readonly id: number;
  readonly buffer: ArrayBuffer;
  /** If present, a file is requested instead of the mesh. */
  readonly format?: PageFormat;
  /** If present, the buffer is a tile; as for decodeTile(). */
  readonly axes?: readonly number[];
}

const scope = self as unknown as {
  onmessage: ((event: MessageEvent<DecodeRequest>) => void) | null;
  postMessage(message: unknown, transfer?: Transferable[]): void;
};

async function answer({ id, buffer, format, axes }: DecodeRequest): Promise<void> {
  if (axes !== undefined) {
    const tile = await decodeTile(buffer, axes);
    scope.postMessage({ id, result: tile }, [tile.positions.buffer, tile.normals.buffer, tile.indices.buffer]);
    return;
  }
  const mesh = await decodeMesh(buffer);
  if (format !== undefined) {
    const result = meshFile(mesh, format).buffer;
    scope.postMessage({ id, result }, [result]);
  } else {
    scope.postMessage({ id, result: mesh }, [mesh.positions.buffer, mesh.normals.buffer, mesh.indices.buffer]);
  }
}

scope.onmessage = (event) => {
  answer(event.data).catch((error: unknown) => scope.postMessage({ id: event.data.id, error: error instanceof Error ? error.message : String(error) }));
};
