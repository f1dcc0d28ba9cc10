// The worker in a browser: fetches ranges itself.
import { UrlBytes } from "../../../view/web/src/queries/url_bytes";
import type { ObjectBytes } from "../../../view/web/src/queries/wasm_store";
import { MemoryBytes, serve } from "./serve.js";
import type { Message, Order, WorkerSource } from "./store.js";

declare class FileReaderSync {
  readAsArrayBuffer(blob: Blob): ArrayBuffer;
}

const scope = self as unknown as {
  onmessage: ((event: MessageEvent<Order>) => void) | null;
  postMessage(message: Message, transfer: Transferable[]): void;
};

/** Parts of a file chosen by the user, which is never entirely in memory. */
class BlobBytes implements ObjectBytes {
  readonly roundTrip = 0;
  readonly size: number;
  private readonly reader = new FileReaderSync();
  constructor(
    private readonly blob: Blob,
    readonly name: string,
  ) {
    this.size = blob.size;
  }
  readNow(offset: number, size: number): Uint8Array {
    try {
      return new Uint8Array(this.reader.readAsArrayBuffer(this.blob.slice(offset, offset + size)));
    } catch (error) {
      throw new Error(`${this.name}: cannot be read: ${error instanceof Error ? error.message : String(error)}`);
    }
  }
  async read(offset: number, size: number): Promise<Uint8Array> {
    return this.readNow(offset, size);
  }
}

async function bytesOf(source: WorkerSource): Promise<ObjectBytes> {
  if ("blob" in source) return new BlobBytes(source.blob, source.name);
  if ("bytes" in source) return new MemoryBytes(source.bytes, source.name);
  if ("url" in source) return UrlBytes.open(source.url, () => {});
  throw new Error("a browser opens a URL, a Blob or bytes");
}

async function wasm(): Promise<ArrayBuffer> {
  const url = new URL("./isonest.wasm", import.meta.url);
  const code = await fetch(url);
  if (!code.ok) throw new Error(`${url.href}, a part of the package isonest, cannot be loaded: the server answers ${code.status}`);
  return code.arrayBuffer();
}

const receive = serve({ opener: { send: (message, transfer) => scope.postMessage(message, transfer) }, wasm, bytes: bytesOf });
scope.onmessage = ({ data }) => receive(data);
