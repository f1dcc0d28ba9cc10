// The Web Worker that decodes meshes, so that the page never waits for it.
import { decodeMesh } from "./decode";

export interface DecodeRequest {
  readonly id: number;
  readonly buffer: ArrayBuffer;
}

const scope = self as unknown as {
  onmessage: ((event: MessageEvent<DecodeRequest>) => void) | null;
  postMessage(message: unknown, transfer?: Transferable[]): void;
};

scope.onmessage = (event) => {
  const { id, buffer } = event.data;
  decodeMesh(buffer).then(
    (mesh) => scope.postMessage({ id, mesh }, [mesh.positions.buffer, mesh.normals.buffer, mesh.indices.buffer]),
    (error: unknown) => scope.postMessage({ id, error: error instanceof Error ? error.message : String(error) }),
  );
};
