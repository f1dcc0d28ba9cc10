// The package in a browser.
import { type Message, type OpenOptions, type Port, type Source, Store, type WorkerSource } from "./store.js";

export * from "./store.js";

/** The base of relative addresses; a worker has no document. */
function base(): string {
  return typeof document === "undefined" ? location.href : document.baseURI;
}

function sourceOf(source: Source): WorkerSource {
  if (source instanceof Blob) return { blob: source, name: (source as { name?: string }).name ?? "the blob" };
  if (source instanceof ArrayBuffer) return { bytes: new Uint8Array(source), name: "the bytes" };
  if (source instanceof Uint8Array) return { bytes: source, name: "the bytes" };
  return { url: new URL(source, base()).href };
}

/** Browsers only start workers of the page's own origin; such a worker then imports a script of another origin. */
function startWorker(folder: string | URL | undefined): Worker {
  const here = new URL("./", import.meta.url);
  if (folder === undefined && here.origin === location.origin) return new Worker(new URL("./worker.js", import.meta.url), { type: "module" });
  const files = folder === undefined ? here : new URL(String(folder).replace(/\/?$/, "/"), base());
  const script = new URL("worker.js", files);
  if (script.origin === location.origin) return new Worker(script, { type: "module" });
  const url = URL.createObjectURL(new Blob([`import ${JSON.stringify(script.href)};`], { type: "text/javascript" }));
  return new Worker(url, { type: "module" });
}

/**
 * Opens a store. From a URL, only the data that queries need are fetched, by range requests.
 *
 * Throws IsonestError if this is not a store, or cannot be read.
 */
export function open(source: Source, options: OpenOptions = {}): Promise<Store> {
  const start = (received: (message: Message) => void, broken: (message: string) => void): Port => {
    const worker = startWorker(options.files);
    worker.onmessage = ({ data }: MessageEvent<Message>) => received(data);
    worker.onerror = (event) => broken(event.message || "the package's worker.js cannot be loaded: say where it is with the option files");
    return { post: (order) => worker.postMessage(order), busy: () => {}, end: () => worker.terminate() };
  };
  return Store._open(start, sourceOf(source), options.memory);
}
