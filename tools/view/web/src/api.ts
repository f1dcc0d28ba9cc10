// Requests answers. For each stream, only the newest request is in progress; older ones are aborted.
import type { Mesh } from "./decode";
import type { MeshDecoder } from "./mesh_decoder";
import type { PageFormat } from "./mesh_files";
import { type Answer, type Transport, Unanswered } from "./site/transport";
import type { ErrorBody, HistogramInfo, LabelInfo, ListedLabel, StatusInfo, StoreInfo, TilesInfo, ValueInfo } from "./protocol";
import type { TileMesh } from "./tiles/decode_tile";
import type { TilesetJson } from "./tiles/tileset";

export type Parameters = Readonly<Record<string, string | number>>;

/** A refused request. If there is no answer at all, the error is Unanswered. */
export class ServerError extends Error {
  constructor(
    readonly status: number,
    message: string,
  ) {
    super(message);
  }
  /** A newer request replaced it, or the page cancelled it: not shown to the user. */
  get superseded(): boolean {
    return this.status === 409;
  }
  /** There is not enough memory for it. */
  get tooLarge(): boolean {
    return this.status === 413;
  }
}

const kBusy = 503;
const kBusyPause = 250; // milliseconds
const kBusyTries = 20;

export class Api {
  /** So that two pages of one server do not abort each other's requests. */
  private readonly page = crypto.getRandomValues(new Uint32Array(2)).reduce((name, part) => name + part.toString(36), "p");
  private readonly aborts = new Map<string, AbortController>();
  /** Of all answers so far. */
  received = 0;

  constructor(
    private readonly transport: Transport,
    private readonly decoder: MeshDecoder,
  ) {}

  /** Whether there is a server, which also makes files and command lines. */
  get hasServer(): boolean {
    return this.transport.hasServer;
  }

  store(): Promise<StoreInfo> {
    return this.json("store");
  }
  /** Coarse: uses the levels that are available soon after the opening. `step`: as in stepOf() (state.ts), also below. */
  histogram(coarse: boolean, step: Parameters): Promise<HistogramInfo> {
    return this.json("histogram", { ...(coarse ? { coarse: 1 } : {}), ...step }, "histogram");
  }
  status(): Promise<StatusInfo> {
    return this.json("status");
  }
  command(parameters: Parameters): Promise<{ readonly command: string }> {
    return this.json("command", parameters, "command");
  }
  label(id: number, step: Parameters): Promise<LabelInfo> {
    return this.json("label", { id, ...step }, "label");
  }
  /** `named`: only labels with a name or a colour, which takes no time. */
  async labels(named: boolean, step: Parameters): Promise<readonly ListedLabel[]> {
    return (await this.json<{ readonly labels: readonly ListedLabel[] }>("labels", { ...(named ? { named: 1 } : {}), ...step }, "labels")).labels;
  }
  value(at: readonly number[], step: Parameters): Promise<ValueInfo> {
    return this.json("value", { at: at.join(","), ...step }, "value");
  }

  /** `progress` gets the bytes received so far. Rejects with ServerError, superseded if there is a newer request. */
  mesh(kind: "surface" | "slice", stream: string, parameters: Parameters, progress: (bytes: number) => void): Promise<Mesh> {
    return this.inStream(stream, async (signal) => this.decoder.decode(await this.bytes(kind, stream, parameters, signal, progress)));
  }

  /** Lets the source of answers fetch what this mesh needs, so that a later request is answered sooner. Never rejects. */
  async prepare(kind: "surface" | "slice", stream: string, parameters: Parameters): Promise<void> {
    await this.inStream(stream, (signal) => this.ask(kind, parameters, signal, () => undefined)).catch(() => undefined);
  }

  /** A mesh as a file that the page makes, in a separate stream. Rejects with ServerError. */
  meshFile(kind: "surface" | "slice", parameters: Parameters, format: PageFormat): Promise<ArrayBuffer> {
    const stream = "file";
    return this.inStream(stream, async (signal) => this.decoder.file(await this.bytes(kind, stream, parameters, signal, () => undefined), format));
  }

  /** Lets the server make tiles of a surface, and says how far it is. */
  tiles(parameters: Parameters): Promise<TilesInfo> {
    return this.json("tiles", { ...parameters, stream: `${this.page}-tiles` });
  }
  /** Nothing more is wanted from tiles(). */
  endTiles(): void {
    this.transport.cancel(`${this.page}-tiles`);
  }
  /** A list of tiles. `path`: of a file of the tileset, also below. Rejects with ServerError. */
  async tileList(tileset: string, path: string, signal: AbortSignal): Promise<TilesetJson> {
    return parsed(await this.ask(`tileset/${tileset}/${path}`, {}, signal, () => undefined)) as TilesetJson;
  }
  /** `axes`: as for decodeTile(). */
  async tile(tileset: string, path: string, axes: readonly number[], signal: AbortSignal): Promise<TileMesh> {
    const { body } = await this.ask(`tileset/${tileset}/${path}`, {}, signal, () => undefined);
    this.received += body.byteLength;
    return this.decoder.tile(body, axes);
  }

  /** Cancels the stream's work here and, by closing the connection, at the server. */
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

  private async inStream<T>(stream: string, work: (signal: AbortSignal) => Promise<T>): Promise<T> {
    const abort = this.begin(stream);
    try {
      const result = await work(abort.signal);
      if (abort.signal.aborted) throw new ServerError(409, "superseded");
      return result;
    } catch (error) {
      throw asError(error, abort.signal);
    } finally {
      if (this.aborts.get(stream) === abort) this.aborts.delete(stream);
    }
  }

  private async bytes(kind: string, stream: string, parameters: Parameters, signal: AbortSignal, progress: (bytes: number) => void): Promise<ArrayBuffer> {
    const { body } = await this.ask(kind, { ...parameters, stream: `${this.page}-${stream}` }, signal, progress);
    this.received += body.byteLength;
    return body;
  }

  private async json<T>(path: string, parameters: Parameters = {}, stream?: string): Promise<T> {
    const abort = stream === undefined ? new AbortController() : this.begin(stream);
    try {
      return parsed(await this.ask(path, parameters, abort.signal, () => undefined)) as T;
    } catch (error) {
      throw asError(error, abort.signal);
    }
  }

  private async ask(path: string, parameters: Parameters, signal: AbortSignal, progress: (bytes: number) => void): Promise<Answer> {
    for (let tries = 1; ; ++tries) {
      const answer = await this.transport.ask(targetOf(path, parameters), signal, progress);
      if (answer.status === 200) return answer;
      if (answer.status !== kBusy || tries === kBusyTries) throw refusal(answer);
      await new Promise((resolve) => setTimeout(resolve, kBusyPause));
    }
  }
}

/** The part of PROTOCOL.md's requests after `api/`: path and query. */
export function targetOf(path: string, parameters: Parameters = {}): string {
  const query = new URLSearchParams();
  for (const [name, value] of Object.entries(parameters)) query.set(name, String(value));
  const text = query.toString().replaceAll("%2C", ",");
  return `${path}${text === "" ? "" : `?${text}`}`;
}

function parsed(answer: Answer): unknown {
  return JSON.parse(new TextDecoder().decode(answer.body));
}

function refusal(answer: Answer): ServerError {
  try {
    const { error } = parsed(answer) as { error: ErrorBody };
    return new ServerError(answer.status, error.message);
  } catch {
    return new ServerError(answer.status, `the answer has the status ${answer.status}`);
  }
}

function asError(error: unknown, signal: AbortSignal): Error {
  if (signal.aborted && !(error instanceof Unanswered)) return new ServerError(409, "superseded");
  return error instanceof Error ? error : new Error(String(error));
}
