// The worker of a store: answers one request after the other, in Node and in browsers.
import { Cancelled, type Loader, type ObjectBytes, WasmStore } from "../../../view/web/src/queries/wasm_store";
import loadLoader from "isonest:loader";
import type { Message, Order, WorkerSource } from "./store.js";

/** The worker's interface to the thread that opened the store. */
export interface Opener {
  send(message: Message, transfer: ArrayBuffer[]): void;
}

/** What differs between Node and browsers. */
export interface Place {
  readonly opener: Opener;
  wasm(): Promise<ArrayBuffer | Uint8Array>;
  bytes(source: WorkerSource): Promise<ObjectBytes>;
}

interface Waiting {
  readonly id: number;
  readonly target: string;
  cancelled: boolean;
}

/** Bytes in memory. */
export class MemoryBytes implements ObjectBytes {
  readonly roundTrip = 0;
  readonly size: number;
  constructor(
    private readonly bytes: Uint8Array,
    readonly name: string,
  ) {
    this.size = bytes.length;
  }
  readNow(offset: number, size: number): Uint8Array {
    return this.bytes.subarray(offset, offset + size);
  }
  async read(offset: number, size: number): Promise<Uint8Array> {
    return this.readNow(offset, size);
  }
}

function told(error: unknown): { kind: string; message: string } {
  const message = error instanceof Error ? error.message : String(error);
  const kind = (error as { kind?: unknown } | null)?.kind;
  return { kind: typeof kind === "string" ? kind : "io", message };
}

/** Returns the function that handles orders. */
export function serve(place: Place): (order: Order) => void {
  const { opener } = place;
  const waiting: Waiting[] = [];
  let running: Waiting | null = null;
  let store: Promise<WasmStore> | null = null;

  const answerError = (id: number, error: unknown): void => {
    const body = new TextEncoder().encode(JSON.stringify({ error: told(error) })).buffer;
    opener.send({ kind: "answer", id, status: 500, body, arrays: [] }, [body]);
  };

  const work = async (): Promise<void> => {
    if (running || !store) return;
    for (let next = waiting.shift(); next; next = waiting.shift()) {
      const request = next;
      running = request;
      try {
        const { status, body, arrays } = await (await store).ask(request.target, () => request.cancelled);
        opener.send({ kind: "answer", id: request.id, status, body, arrays }, [body, ...arrays]);
      } catch (error) {
        if (error instanceof WebAssembly.RuntimeError) {
          // Its memory is in an unknown state.
          opener.send({ kind: "failed", error: { kind: "limit", message: `isonest.wasm failed (${error.message}): open the store again, with more memory` } }, []);
          return;
        }
        if (!(error instanceof Cancelled)) answerError(request.id, error);
      }
      // Processes waiting messages, one of which may cancel the next request.
      await new Promise((go) => setTimeout(go, 0));
    }
    running = null;
  };

  const open = async (source: WorkerSource, memory: number): Promise<WasmStore> => {
    const [bytes, wasm] = await Promise.all([place.bytes(source), place.wasm()]);
    return WasmStore.open(loadLoader as Loader, wasm, bytes, memory);
  };

  return (order) => {
    switch (order.kind) {
      case "open":
        store = open(order.source, order.memory);
        store.then(
          () => opener.send({ kind: "opened" }, []),
          (error) => opener.send({ kind: "failed", error: told(error) }, []),
        );
        break;
      case "ask":
        waiting.push({ id: order.id, target: order.target, cancelled: false });
        void work();
        break;
      case "cancel": {
        const at = waiting.findIndex(({ id }) => id === order.id);
        if (at >= 0) waiting.splice(at, 1);
        else if (running?.id === order.id) running.cancelled = true;
        break;
      }
    }
  };
}
