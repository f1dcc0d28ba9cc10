// Asks the server. One of the newest request of a stream is under way; older ones are aborted.
import type { Mesh } from "./decode";
import type { MeshDecoder } from "./mesh_decoder";
import type { ErrorBody, HistogramInfo, LabelInfo, StatusInfo, StoreInfo, ValueInfo } from "./protocol";

export type Parameters = Readonly<Record<string, string | number>>;

/** What the server refused, or that it does not answer (status 0). */
export class ServerError extends Error {
  constructor(
    readonly status: number,
    message: string,
  ) {
    super(message);
  }
  /** A newer request took its place, or the page gave it up: nothing to tell anybody. */
  get superseded(): boolean {
    return this.status === 409;
  }
}

const kBusy = 503;
const kBusyPause = 250; // milliseconds
const kBusyTries = 20;

export class Api {
  private readonly token = new URLSearchParams(location.search).get("token");
  /** Two pages of one server do not end each other's requests. */
  private readonly page = crypto.getRandomValues(new Uint32Array(2)).reduce((name, part) => name + part.toString(36), "p");
  private readonly aborts = new Map<string, AbortController>();
  /** Of all answers so far. */
  received = 0;

  constructor(private readonly decoder: MeshDecoder) {}

  /** Path and query, with the token; also for links. */
  url(path: string, parameters: Parameters = {}): string {
    const query = new URLSearchParams();
    for (const [name, value] of Object.entries(parameters)) query.set(name, String(value));
    if (this.token !== null) query.set("token", this.token);
    const text = query.toString().replaceAll("%2C", ",");
    return `api/${path}${text === "" ? "" : `?${text}`}`;
  }

  store(): Promise<StoreInfo> {
    return this.json("store");
  }
  /** Coarse: of the levels that are there soon after the opening. */
  histogram(coarse: boolean): Promise<HistogramInfo> {
    return this.json("histogram", coarse ? { coarse: 1 } : {});
  }
  status(): Promise<StatusInfo> {
    return this.json("status");
  }
  command(parameters: Parameters): Promise<{ readonly command: string }> {
    return this.json("command", parameters, "command");
  }
  label(id: number): Promise<LabelInfo> {
    return this.json("label", { id }, "label");
  }
  value(at: readonly number[]): Promise<ValueInfo> {
    return this.json("value", { at: at.join(",") }, "value");
  }

  /** `progress` is told the bytes received so far. Rejects with ServerError, superseded if a newer one was asked for. */
  async mesh(kind: "surface" | "slice", stream: string, parameters: Parameters, progress: (bytes: number) => void): Promise<Mesh> {
    const abort = this.begin(stream);
    try {
      const response = await this.fetch(kind, { ...parameters, stream: `${this.page}-${stream}` }, abort.signal);
      const bytes = await readAll(response, progress);
      this.received += bytes.byteLength;
      const mesh = await this.decoder.decode(bytes);
      if (abort.signal.aborted) throw new ServerError(409, "superseded");
      return mesh;
    } catch (error) {
      throw asServerError(error, abort.signal);
    } finally {
      if (this.aborts.get(stream) === abort) this.aborts.delete(stream);
    }
  }

  /** Ends what is under way for the stream, here and, by closing the connection, at the server. */
  cancel(stream: string): void {
    this.aborts.get(stream)?.abort();
    this.aborts.delete(stream);
  }

  private begin(stream: string): AbortController {
    this.cancel(stream);
    const abort = new AbortController();
    this.aborts.set(stream, abort);
    return abort;
  }

  private async json<T>(path: string, parameters: Parameters = {}, stream?: string): Promise<T> {
    const abort = stream === undefined ? new AbortController() : this.begin(stream);
    try {
      const response = await this.fetch(path, parameters, abort.signal);
      return (await response.json()) as T;
    } catch (error) {
      throw asServerError(error, abort.signal);
    }
  }

  private async fetch(path: string, parameters: Parameters, signal: AbortSignal): Promise<Response> {
    for (let tries = 1; ; ++tries) {
      const response = await fetch(this.url(path, parameters), { signal, cache: "no-store" });
      if (response.ok) return response;
      if (response.status !== kBusy || tries === kBusyTries) throw await refusal(response);
      await new Promise((resolve) => setTimeout(resolve, kBusyPause));
    }
  }
}

async function refusal(response: Response): Promise<ServerError> {
  try {
    const { error } = (await response.json()) as { error: ErrorBody };
    return new ServerError(response.status, error.message);
  } catch {
    return new ServerError(response.status, `the server answered ${response.status} ${response.statusText}`);
  }
}

function asServerError(error: unknown, signal: AbortSignal): Error {
  if (signal.aborted) return new ServerError(409, "superseded");
  if (error instanceof TypeError) return new ServerError(0, "The server does not answer.");
  return error instanceof Error ? error : new Error(String(error));
}

async function readAll(response: Response, progress: (bytes: number) => void): Promise<ArrayBuffer> {
  if (!response.body) return response.arrayBuffer();
  const parts: Uint8Array[] = [];
  let length = 0;
  for (const reader = response.body.getReader(); ; ) {
    const { done, value } = await reader.read();
    if (done) break;
    parts.push(value);
    length += value.length;
    progress(length);
  }
  const all = new Uint8Array(length);
  let at = 0;
  for (const part of parts) {
    all.set(part, at);
    at += part.length;
  }
  return all.buffer;
}
