// The worker in Node.
import { fstatSync, openSync, readSync } from "node:fs";
import { readFile } from "node:fs/promises";
import { parentPort } from "node:worker_threads";
import type { ObjectBytes } from "../../../view/web/src/queries/wasm_store";
import { MemoryBytes, serve } from "./serve.js";
import type { Order, WorkerSource } from "./store.js";

class FileBytes implements ObjectBytes {
  readonly roundTrip = 0;
  readonly size: number;
  private readonly file: number;
  constructor(readonly name: string) {
    const path = /^file:/i.test(name) ? new URL(name) : name;
    try {
      this.file = openSync(path, "r");
    } catch (error) {
      const missing = (error as { code?: string }).code === "ENOENT";
      throw Object.assign(new Error(missing ? `${name}: there is no such file` : (error as Error).message), { kind: missing ? "not_found" : "io" });
    }
    this.size = fstatSync(this.file).size;
  }
  readNow(offset: number, size: number): Uint8Array {
    const bytes = new Uint8Array(size);
    if (readSync(this.file, bytes, 0, size, offset) !== size) throw new Error(`${this.name}: is shorter than it was when it was opened`);
    return bytes;
  }
  async read(offset: number, size: number): Promise<Uint8Array> {
    return this.readNow(offset, size);
  }
}

/** Bytes that the other thread reads. */
class ServedBytes implements ObjectBytes {
  roundTrip: number;
  readonly name: string;
  readonly size: number;
  private last = 0;
  readonly waiting = new Map<number, { resolve: (bytes: Uint8Array) => void; reject: (error: Error) => void }>();

  constructor({ name, size, roundTrip }: { name: string; size: number; roundTrip: number }) {
    [this.name, this.size, this.roundTrip] = [name, size, roundTrip];
  }
  read(offset: number, size: number): Promise<Uint8Array> {
    return new Promise((resolve, reject) => {
      const start = performance.now();
      const id = ++this.last;
      const got = (bytes: Uint8Array): void => {
        this.roundTrip = Math.min(this.roundTrip, performance.now() - start);
        resolve(bytes);
      };
      this.waiting.set(id, { resolve: got, reject });
      parentPort?.postMessage({ kind: "read", id, offset, size });
    });
  }
  readNow(offset: number, size: number): Uint8Array {
    const kText = 4096; // room for the text of an error
    const shared = new SharedArrayBuffer(8 + Math.max(size, kText));
    const state = new Int32Array(shared, 0, 2);
    parentPort?.postMessage({ kind: "read", id: 0, offset, size, shared });
    Atomics.wait(state, 0, 0);
    const bytes = new Uint8Array(shared, 8, state[1]).slice();
    if (state[0] === 2) throw new Error(new TextDecoder().decode(bytes));
    return bytes;
  }
  received(id: number, bytes: Uint8Array | string): void {
    const one = this.waiting.get(id);
    this.waiting.delete(id);
    if (typeof bytes === "string") one?.reject(new Error(bytes));
    else one?.resolve(bytes);
  }
}

// The loader of isonest.wasm expects these globals of a browser's worker.
Object.assign(globalThis, { self: globalThis, location: { href: import.meta.url } });

let served: ServedBytes | null = null;

async function bytesOf(source: WorkerSource): Promise<ObjectBytes> {
  if ("path" in source) return new FileBytes(source.path);
  if ("bytes" in source) return new MemoryBytes(source.bytes, source.name);
  if ("served" in source) return (served = new ServedBytes(source.served));
  throw new Error("not a source of this worker");
}

const receive = serve({
  opener: { send: (message, transfer) => parentPort?.postMessage(message, transfer) },
  wasm: () => readFile(new URL("./isonest.wasm", import.meta.url)),
  bytes: bytesOf,
});
parentPort?.on("message", (order: Order) => (order.kind === "bytes" ? served?.received(order.id, order.bytes) : receive(order)));
