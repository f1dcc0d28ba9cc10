// The Web Worker that decodes meshes and makes mesh files, so that the page never blocks.
import { decodeMesh } from "./decode";
import { meshFile, type PageFormat } from "./mesh_files";

export interface DecodeRequest {
  readonly id: number;
  readonly buffer: ArrayBuffer;
  /** If present, a file is requested instead of the mesh. */
  readonly format?: PageFormat;
}

const scope = self as unknown as {
  onmessage: ((event: MessageEvent<DecodeRequest>) => void) | null;
  postMessage(message: unknown, transfer?: Transferable[]): void;
};

async function answer({ id, buffer, format }: DecodeRequest): Promise<void> {
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
