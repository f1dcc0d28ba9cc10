// The worker of a page without a server: answers requests as in PROTOCOL.md, one after the other.
import { UrlBytes } from "./url_bytes";
import { Cancelled, type Loader, NotFetched, WasmStore } from "./wasm_store";

/** From the page. `target`: the part of PROTOCOL.md's requests after `api/`. */
type Order =
  | { readonly kind: "open"; readonly url: string; readonly memory: number }
  | { readonly kind: "request"; readonly id: number; readonly target: string }
  | { readonly kind: "cancel"; readonly id: number };

interface Waiting {
  readonly id: number;
  readonly target: string;
  readonly stream: string | null;
  cancelled: boolean;
}

const waiting: Waiting[] = [];
let running: Waiting | null = null;
let bytesOfRunning = 0;
let store: Promise<WasmStore> | null = null;

const scope = self as unknown as {
  onmessage: ((event: MessageEvent<Order>) => void) | null;
  postMessage(message: unknown, transfer?: Transferable[]): void;
};

function send(message: object, transfer: Transferable[] = []): void {
  scope.postMessage(message, transfer);
}

function told(error: unknown): string {
  return error instanceof Error ? error.message : String(error);
}

async function open(url: string, memory: number): Promise<WasmStore> {
  const beside = new URL("./", location.href);
  const object = UrlBytes.open(url, (count) => {
    bytesOfRunning += count;
    if (running) send({ kind: "progress", id: running.id, bytes: bytesOfRunning });
  });
  object.catch(() => {}); // awaited below
  const loader = (await import(/* the build leaves it alone */ new URL("isonest.mjs", beside).href)) as { default: Loader };
  const code = await fetch(new URL("isonest.wasm", beside));
  if (!code.ok) throw new Error(`isonest.wasm, a part of this page, cannot be loaded: the server answers ${code.status}.`);
  return WasmStore.open(loader.default, await code.arrayBuffer(), await object, memory);
}

/** Like the server's errors. */
function answerError(id: number, status: number, kind: string, message: string): void {
  const body = new TextEncoder().encode(`${JSON.stringify({ error: { kind, message, remedies: [] } })}\n`).buffer;
  send({ kind: "answer", id, status, type: "application/json", body }, [body]);
}

function answerCancelled(id: number): void {
  answerError(id, 409, "cancelled", "cancelled");
}

function cancel(which: (request: Waiting) => boolean): void {
  for (let i = waiting.length - 1; i >= 0; --i) {
    const request = waiting[i];
    if (request && which(request)) {
      waiting.splice(i, 1);
      answerCancelled(request.id);
    }
  }
  if (running && which(running)) running.cancelled = true;
}

async function work(): Promise<void> {
  if (running || !store) return;
  for (let next = waiting.shift(); next; next = waiting.shift()) {
    const request = next;
    running = request;
    bytesOfRunning = 0;
    try {
      const answer = await (await store).ask(`/api/${request.target}`, () => request.cancelled);
      const { status, type, body } = answer;
      send({ kind: "answer", id: request.id, status, type, body }, [body]);
    } catch (error) {
      if (error instanceof Cancelled) {
        answerCancelled(request.id);
      } else if (error instanceof NotFetched) {
        answerError(request.id, 500, "io", error.message);
      } else {
        running = null; // the store did not open, or its memory is in an unknown state
        send({ kind: "failed", message: told(error) });
        return;
      }
    }
    // Processes messages that have arrived before the next request.
    await new Promise((go) => setTimeout(go, 0));
  }
  running = null;
}

scope.onmessage = (event) => {
  const order = event.data;
  switch (order.kind) {
    case "open":
      store = open(order.url, order.memory);
      store.then(
        () => send({ kind: "opened" }),
        (error) => send({ kind: "failed", message: told(error) }),
      );
      break;
    case "request": {
      const stream = new URLSearchParams(order.target.split("?")[1] ?? "").get("stream");
      if (stream !== null) cancel((other) => other.stream === stream);
      waiting.push({ id: order.id, target: order.target, stream, cancelled: false });
      void work();
      break;
    }
    case "cancel":
      cancel((other) => other.id === order.id);
      break;
  }
};
