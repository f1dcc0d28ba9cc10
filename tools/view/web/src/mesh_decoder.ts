// The page's interface to the worker that decodes meshes.
import type { Mesh } from "./decode";
import type { PageFormat } from "./mesh_files";
import type { TileMesh } from "./tiles/decode_tile";

type Result = Mesh | ArrayBuffer | TileMesh;
type Answer = { readonly id: number; readonly result?: Result; readonly error?: string };
type Waiting = { readonly resolve: (result: Result) => void; readonly reject: (error: Error) => void };

export class MeshDecoder {
  private readonly worker = new Worker("mesh_worker.js");
  private readonly waiting = new Map<number, Waiting>();
  private next = 0;

  constructor() {
    this.worker.onmessage = (event: MessageEvent<Answer>) => {
      const { id, result, error } = event.data;
      const waiting = this.waiting.get(id);
      this.waiting.delete(id);
      if (result) waiting?.resolve(result);
      else waiting?.reject(new Error(error ?? "the mesh could not be decoded"));
    };
    this.worker.onerror = () => {
      for (const { reject } of this.waiting.values()) reject(new Error("the page's mesh decoder failed: reload the page"));
      this.waiting.clear();
    };
  }

  /** Transfers the buffer from the caller. Rejects with Error if it contains no mesh. */
  decode(buffer: ArrayBuffer): Promise<Mesh> {
    return this.ask({ buffer }, buffer) as Promise<Mesh>;
  }

  /** `axes`: as for decodeTile(). Otherwise like decode(). */
  tile(buffer: ArrayBuffer, axes: readonly number[]): Promise<TileMesh> {
    return this.ask({ buffer, axes }, buffer) as Promise<TileMesh>;
  }

  /** The bytes of a file in this format. Otherwise like decode(). */
  file(buffer: ArrayBuffer, format: PageFormat): Promise<ArrayBuffer> {
    return this.ask({ buffer, format }, buffer) as Promise<ArrayBuffer>;
  }

  private ask(request: object, buffer: ArrayBuffer): Promise<Result> {
    const id = this.next++;
    return new Promise((resolve, reject) => {
      this.waiting.set(id, { resolve, reject });
      this.worker.postMessage({ id, ...request }, [buffer]);
    });
  }
}
