// Reads an object at a URL by range requests: always the same version of it, or an error.
import { Patience, waitNow } from "./patience";
import type { ObjectBytes } from "./wasm_store";

/** In Node, only the package isonest (tools/web/npm) uses this file. */
const kIsPage = typeof XMLHttpRequest !== "undefined";
const kOpenAgain = kIsPage ? "reload the page" : "open the store again";

/** How often a waiting request checks whether its answer is still wanted. */
const kLook = 100; // milliseconds

/** The headers that identify the version of the object. Other origins may hide the first. */
interface State {
  readonly etag: string | null;
  readonly modified: string | null;
}

/** From fetch() or XMLHttpRequest. */
type HeaderOf = (name: string) => string | null;

function stateOf(header: HeaderOf): State {
  return { etag: header("ETag"), modified: header("Last-Modified") };
}

function isSame(a: State, b: State): boolean {
  const differ = (x: string | null, y: string | null): boolean => x !== null && y !== null && x !== y;
  return !differ(a.etag, b.etag) && !differ(a.modified, b.modified);
}

export class UrlBytes implements ObjectBytes {
  /** `name`: the URL without user, query and fragment. */
  private constructor(
    private readonly url: string,
    readonly name: string,
    readonly size: number,
    private readonly state: State,
    public roundTrip: number,
    private readonly received: (bytes: number) => void,
  ) {}

  /** `received` gets the number of bytes of each answer. */
  static async open(url: string, received: (bytes: number) => void): Promise<UrlBytes> {
    const absolute = new URL(url, kIsPage ? location.href : undefined);
    const name = absolute.origin + absolute.pathname;
    const start = performance.now();
    const [response, tried] = await asked(name, () => fetch(absolute, { method: "HEAD", cache: "no-cache" }), () => false);
    if (response.status === 404) throw new Error(`${name}: there is no such file.`);
    if (!response.ok) throw new Error(answers(name, response.status, (header) => response.headers.get(header), tried));
    const size = Number(response.headers.get("Content-Length") ?? Number.NaN);
    if (!Number.isSafeInteger(size)) throw new Error(`${name}: the server does not report the size of the file.`);
    const state = stateOf((header) => response.headers.get(header));
    return new UrlBytes(absolute.href, name, size, state, performance.now() - start, received);
  }

  async read(offset: number, size: number, isCancelled: () => boolean): Promise<Uint8Array> {
    const start = performance.now();
    // If the browser's cache has an older version, requests it again, once.
    for (const cache of ["default", "reload"] as const) {
      const [response, tried] = await asked(this.name, () => fetch(this.url, { headers: { Range: rangeOf(offset, size) }, cache }), isCancelled);
      const header: HeaderOf = (name) => response.headers.get(name);
      if (cache === "default" && response.status === 206 && !isSame(stateOf(header), this.state)) continue;
      this.require(response.status, header, tried);
      const bytes = new Uint8Array(await response.arrayBuffer());
      this.roundTrip = Math.min(this.roundTrip, performance.now() - start);
      return this.whole(bytes, size);
    }
    throw new Error(`${this.name}: cannot be read.`);
  }

  readNow(offset: number, size: number): Uint8Array {
    const patience = new Patience();
    const request = new XMLHttpRequest();
    const header: HeaderOf = (name) => request.getResponseHeader(name);
    for (let wait: number | null = 0; wait !== null; wait = patience.wait(request.status, header("Retry-After"))) {
      if (wait > 0) waitNow(wait);
      request.open("GET", this.url, false);
      request.responseType = "arraybuffer";
      request.setRequestHeader("Range", rangeOf(offset, size));
      try {
        request.send();
      } catch {
        throw new Error(unreachable(this.name));
      }
    }
    this.require(request.status, header, patience.tried);
    return this.whole(new Uint8Array(request.response as ArrayBuffer), size);
  }

  private require(status: number, header: HeaderOf, tried: string): void {
    if (status === 200) {
      throw new Error(`${this.name}: the server answers range requests with the whole file; ${kIsPage ? "a page can only read stores" : "stores are read only"} from servers that support ranges.`);
    }
    if (status === 404 || status === 416) throw new Error(`${this.name}: was removed or replaced since it was opened: ${kOpenAgain}.`);
    if (status !== 206) throw new Error(answers(this.name, status, header, tried));
    if (!isSame(stateOf(header), this.state)) {
      throw new Error(`${this.name}: was replaced since it was opened: ${kOpenAgain}.`);
    }
  }

  private whole(bytes: Uint8Array, size: number): Uint8Array {
    if (bytes.length !== size) throw new Error(`${this.name}: the server sent ${bytes.length} bytes of a range of ${size}.`);
    this.received(size);
    return bytes;
  }
}

function rangeOf(offset: number, size: number): string {
  return `bytes=${offset}-${offset + size - 1}`;
}

function unreachable(name: string): string {
  return !kIsPage ? `${name}: cannot be reached.` : `${name}: cannot be reached, or its server does not let this page read it (CORS: it has to send Access-Control-Allow-Origin).`;
}

function answers(name: string, status: number, header: HeaderOf, tried: string): string {
  const after = header("Retry-After");
  return `${name}: the server answers ${status}${tried}${after === null ? "" : `, and asks to wait: ${after}`}.`;
}

/** Returns the answer after any retries, and the number of tries, in words. */
async function asked(name: string, ask: () => Promise<Response>, isCancelled: () => boolean): Promise<[Response, string]> {
  const patience = new Patience();
  for (;;) {
    let response: Response;
    try {
      response = await ask();
    } catch {
      throw new Error(unreachable(name));
    }
    const wait = patience.wait(response.status, response.headers.get("Retry-After"));
    if (wait === null) return [response, patience.tried];
    response.body?.cancel().catch(() => undefined); // otherwise it may keep its connection
    for (const end = performance.now() + wait; performance.now() < end && !isCancelled(); ) {
      await new Promise((go) => setTimeout(go, Math.min(kLook, end - performance.now())));
    }
    if (isCancelled()) return [response, patience.tried];
  }
}
