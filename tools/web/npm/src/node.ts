// The package in Node. The worker asks this thread for the bytes of URLs and blobs, because it has no way to wait for
// them while WebAssembly runs.
import { Worker } from "node:worker_threads";
import { UrlBytes } from "../../../view/web/src/queries/url_bytes";
import type { ObjectBytes } from "../../../view/web/src/queries/wasm_store";
import { IsonestError, type Message, type OpenOptions, type Port, type Source, Store, type WorkerSource } from "./store.js";

export * from "./store.js";

/** Bytes that this thread reads for the worker. */
type ServedBytes = Omit<ObjectBytes, "readNow">;

function ofBlob(blob: Blob): ServedBytes {
  const name = (blob as { name?: string }).name ?? "the blob";
  const read = async (offset: number, size: number): Promise<Uint8Array> => new Uint8Array(await blob.slice(offset, offset + size).arrayBuffer());
  return { name, size: blob.size, roundTrip: 0, read };
}

async function sourceOf(source: Source): Promise<{ own: WorkerSource } | { served: ServedBytes }> {
  if (source instanceof Blob) return { served: ofBlob(source) };
  if (source instanceof ArrayBuffer) return { own: { bytes: new Uint8Array(source), name: "the bytes" } };
  if (source instanceof Uint8Array) return { own: { bytes: source, name: "the bytes" } };
  const text = String(source);
  if (/^https?:/i.test(text)) return { served: await UrlBytes.open(text, () => {}) };
  return { own: { path: text } };
}

/** Puts bytes, or the text of an error, where the worker waits for them. */
function answerShared(shared: SharedArrayBuffer, bytes: Uint8Array | string): void {
  const state = new Int32Array(shared, 0, 2);
  const room = new Uint8Array(shared, 8);
  const given = typeof bytes === "string" ? new TextEncoder().encode(bytes).subarray(0, room.length) : bytes;
  room.set(given);
  state[1] = given.length;
  Atomics.store(state, 0, typeof bytes === "string" ? 2 : 1);
  Atomics.notify(state, 0);
}

/**
 * Opens a store: a file, bytes, or a URL, from which only the data that queries need are fetched, by range
 * requests.
 *
 * Throws IsonestError if this is not a store, or cannot be read.
 */
export async function open(source: Source, options: OpenOptions = {}): Promise<Store> {
  const found = await sourceOf(source).catch((error: Error) => {
    throw new IsonestError(error.message, "io");
  });
  const served = "served" in found ? found.served : null;
  const start = (received: (message: Message) => void, broken: (message: string) => void): Port => {
    // Options of this process, such as --input-type, are not for the worker.
    const worker = new Worker(new URL("./node_worker.js", import.meta.url), { execArgv: [] });
    let ended = false;
    const read = async ({ id, offset, size, shared }: Extract<Message, { kind: "read" }>): Promise<void> => {
      let bytes: Uint8Array | string;
      try {
        if (!served) throw new Error("nothing is read here");
        bytes = await served.read(offset, size, () => ended);
      } catch (error) {
        bytes = error instanceof Error ? error.message : String(error);
      }
      if (shared) answerShared(shared, bytes);
      else worker.postMessage({ kind: "bytes", id, bytes });
    };
    worker.on("message", (message: Message) => void (message.kind === "read" ? read(message) : received(message)));
    worker.on("error", (error: Error) => broken(error.message));
    return {
      post: (order) => worker.postMessage(order),
      busy: (is) => (is ? worker.ref() : worker.unref()),
      end: () => {
        ended = true;
        void worker.terminate();
      },
    };
  };
  const own: WorkerSource = served ? { served: { name: served.name, size: served.size, roundTrip: served.roundTrip } } : (found as { own: WorkerSource }).own;
  return Store._open(start, own, options.memory);
}
