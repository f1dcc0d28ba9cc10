// Asks for answers. One of the newest request of a stream is under way; older ones are aborted.
import type { Mesh } from "./decode";
import type { MeshDecoder } from "./mesh_decoder";
import type { PageFormat } from "./mesh_files";
import { type Answer, type Transport, Unanswered } from "./site/transport";
import type { ErrorBody, HistogramInfo, LabelInfo, StatusInfo, StoreInfo, ValueInfo } from "./protocol";

export type Parameters = Readonly<Record<string, string | number>>;

/** What was refused. Where nobody answers at all, it is Unanswered. */
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
  /** The memory is too small for it. */
  get tooLarge(): boolean {
    return this.status === 413;
  }
}

const kBusy = 503;
const kBusyPause = 250; // milliseconds
const kBusyTries = 20;

export class Api {
  /** Two pages of one server do not end each other's requests. */
  private readonly page = crypto.getRandomValues(new Uint32Array(2)).reduce((name, part) => name + part.toString(36), "p");
  private readonly aborts = new Map<string, AbortController>();
  /** Of all answers so far. */
  received = 0;

  constructor(
    private readonly transport: Transport,
    private readonly decoder: MeshDecoder,
  ) {}

  /** Whether a server answers, which makes files and command lines, too. */
  get hasServer(): boolean {
    return this.transport.hasServer;
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
  mesh(kind: "surface" | "slice", stream: string, parameters: Parameters, progress: (bytes: number) => void): Promise<Mesh> {
    return this.inStream(stream, async (signal) => this.decoder.decode(await this.bytes(kind, stream, parameters, signal, progress)));
  }

  /** A mesh as a file that the page makes; of a stream of its own. Rejects with ServerError. */
  meshFile(kind: "surface" | "slice", parameters: Parameters, format: PageFormat): Promise<ArrayBuffer> {
    const stream = "file";
    return this.inStream(stream, async (signal) => this.decoder.file(await this.bytes(kind, stream, parameters, signal, () => undefined), format));
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

/** What PROTOCOL.md has behind `api/`: path and query. */
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
