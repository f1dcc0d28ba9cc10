// The worker of a page without a server: answers requests as in PROTOCOL.md, one after the other.
import { UrlBytes } from "./url_bytes";
import { Cancelled, type Loader, NotFetched, NotOpened, WasmStore } from "./wasm_store";

/**
 * From the page. `steps`: the URLs of all steps of a series, of which `url` is the first. `target`: the part of
 * PROTOCOL.md's requests after `api/`.
 */
type Order =
  | { readonly kind: "open"; readonly url: string; readonly steps?: readonly string[]; readonly memory: number }
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

function bytesOf(url: string): Promise<UrlBytes> {
  return UrlBytes.open(url, (count) => {
    bytesOfRunning += count;
    if (running) send({ kind: "progress", id: running.id, bytes: bytesOfRunning });
  });
}

/** The bytes of the steps of a series; empty for one store. */
class Steps {
  private readonly opened = new Map<number, Promise<UrlBytes>>();

  constructor(
    private readonly urls: readonly string[],
    first: Promise<UrlBytes>,
  ) {
    this.opened.set(0, first);
  }

  get last(): number {
    return Math.max(this.urls.length - 1, 0);
  }

  /** Rejects with NotFetched. */
  async bytes(step: number): Promise<UrlBytes> {
    const opened = this.opened.get(step) ?? bytesOf(this.urls[step] ?? "");
    this.opened.set(step, opened);
    try {
      return await opened;
    } catch (error) {
      this.opened.delete(step); // the next request tries again
      throw new NotFetched(told(error));
    }
  }
}
let steps: Steps | null = null;

async function open(object: Promise<UrlBytes>, memory: number): Promise<WasmStore> {
  const beside = new URL("./", location.href);
  object.catch(() => {}); // awaited below
  const loader = (await import(/* the build leaves it alone */ new URL("isonest.mjs", beside).href)) as { default: Loader };
  const code = await fetch(new URL("isonest.wasm", beside));
  if (!code.ok) throw new Error(`isonest.wasm, a part of this page, cannot be loaded: the server answers ${code.status}.`);
  return WasmStore.open(loader.default, await code.arrayBuffer(), await object, memory);
}

/** The request's step, which the library does not know, and the rest. */
function stepOf(target: string): readonly [number, string] {
  const [path = "", text = ""] = target.split("?");
  const query = new URLSearchParams(text);
  const step = Number(query.get("step") ?? 0);
  query.delete("step");
  return [step, text === "" ? path : `${path}?${query.toString().replaceAll("%2C", ",")}`];
}

async function answerTo(request: Waiting): Promise<void> {
  const opened = await store!;
  const [step, target] = stepOf(request.target);
  const last = steps!.last;
  if (!Number.isInteger(step) || step < 0 || step > last) return answerError(request.id, 400, "invalid_argument", `step '${step}' is not an integer from 0 to ${last}`);
  try {
    await opened.turnTo(await steps!.bytes(step), () => request.cancelled);
  } catch (error) {
    if (error instanceof NotOpened) return answerError(request.id, 500, error.kind, error.message);
    throw error;
  }
  const { status, type, body } = await opened.ask(`/api/${target}`, () => request.cancelled);
  send({ kind: "answer", id: request.id, status, type, body }, [body]);
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
      await answerTo(request);
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
    case "open": {
      const object = bytesOf(order.url);
      steps = new Steps(order.steps ?? [], object);
      store = open(object, order.memory);
      store.then(
        () => send({ kind: "opened" }),
        (error) => send({ kind: "failed", message: told(error) }),
      );
      break;
    }
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
