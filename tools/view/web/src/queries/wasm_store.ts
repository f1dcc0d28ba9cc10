// isonest.wasm (tools/web): stores and their queries. Independent of the network: the creator provides the bytes.

/** The bytes of the store. Errors of both methods are shown to the user. */
export interface ObjectBytes {
  /** For messages: without secrets. */
  readonly name: string;
  readonly size: number;
  /** Milliseconds from a small request to its answer. */
  readonly roundTrip: number;
  /** Stops waiting once `isCancelled()`. */
  read(offset: number, size: number, isCancelled: () => boolean): Promise<Uint8Array>;
  /** The same, synchronously; throws. */
  readNow(offset: number, size: number): Uint8Array;
}

export interface WasmAnswer {
  readonly status: number;
  readonly type: string;
  readonly body: ArrayBuffer;
  /** Of an answer to "/arrays/...": positions, normals, values, indices; otherwise each is empty. */
  readonly arrays: ArrayBuffer[];
}

/** The module that isonest.mjs creates. */
interface Module {
  readonly HEAPU8: Uint8Array;
  readonly HEAPF64: Float64Array;
  _malloc(size: number): number;
  _free(at: number): void;
  _isonest_begin(url: number, size: number, memory: number): number;
  _isonest_round_trip(milliseconds: number): void;
  _isonest_put(offset: number, bytes: number, size: number): void;
  _isonest_open(mayUnwind: number): number;
  _isonest_ask(target: number, mayUnwind: number): number;
  _isonest_needed_count(): number;
  _isonest_needed(): number;
  _isonest_answer_status(): number;
  _isonest_answer_type(): number;
  _isonest_answer_body(): number;
  _isonest_answer_size(): number;
  _isonest_array_count(): number;
  _isonest_array(which: number): number;
  _isonest_array_bytes(which: number): number;
  _isonest_answer_done(): void;
}

export type Loader = (options: object) => Promise<Module>;

/** The answer is no longer wanted. */
export class Cancelled extends Error {}
/** Bytes could not be fetched. */
export class NotFetched extends Error {}
/** The object is not a store, or not one that can be opened. */
export class NotOpened extends Error {
  constructor(
    message: string,
    readonly kind: string,
  ) {
    super(message);
  }
}

const kPage = 65536;
/** How often a query may start again; after that it waits for each of its requests. */
const kMaxRuns = 64;
const kNeedsBytes = 1;

/** Counters since it was created. */
export interface Counts {
  runs: number;
  trips: number;
}

export class WasmStore {
  readonly counts: Counts = { runs: 0, trips: 0 };

  private constructor(
    private readonly module: Module,
    /** Of the store to which requests go. */
    private bytes: ObjectBytes,
    readonly memory: WebAssembly.Memory,
    private readonly budget: number,
  ) {}

  /** Throws NotOpened with the answer's error if the object is not a store. `memory`: memory budget in bytes. */
  static async open(load: Loader, wasmBinary: ArrayBuffer | Uint8Array, bytes: ObjectBytes, memory: number): Promise<WasmStore> {
    const wasmMemory = new WebAssembly.Memory({ initial: 256, maximum: Math.max(512, Math.floor(memory / kPage)) });
    const fetchNow = (offset: number, size: number): Uint8Array | string => {
      store.counts.trips += 1;
      try {
        return store.bytes.readNow(offset, size);
      } catch (error) {
        return error instanceof Error ? error.message : String(error);
      }
    };
    const module = await load({ wasmBinary, wasmMemory, fetchNow });
    const store = new WasmStore(module, bytes, wasmMemory, memory);
    await store.turnTo(bytes);
    return store;
  }

  /**
   * Further requests go to the store with these bytes, which is opened unless it is open: those used last stay open. Throws
   * NotOpened with the answer's error if it is not a store, and Cancelled.
   */
  async turnTo(bytes: ObjectBytes, isCancelled: () => boolean = () => false): Promise<void> {
    this.bytes = bytes;
    if (this.withText(bytes.name, (at) => this.module._isonest_begin(at, bytes.size, this.budget)) !== 0) return;
    const answer = await this.run((mayUnwind) => this.module._isonest_open(mayUnwind), isCancelled);
    if (answer.status !== 200) throw new NotOpened(...problemOf(answer));
  }

  /** `target`: "/api/..." as in PROTOCOL.md, or "/arrays/..." as in tools/web/array_answers.h. Throws Cancelled once `isCancelled()`, which is called between two runs. */
  async ask(target: string, isCancelled: () => boolean = () => false): Promise<WasmAnswer> {
    return this.run((mayUnwind) => this.withText(target, (at) => this.module._isonest_ask(at, mayUnwind)), isCancelled);
  }

  private async run(query: (mayUnwind: number) => number, isCancelled: () => boolean): Promise<WasmAnswer> {
    for (let runs = 1; ; ++runs) {
      this.module._isonest_round_trip(this.bytes.roundTrip);
      this.counts.runs += 1;
      if (query(runs < kMaxRuns ? 1 : 0) !== kNeedsBytes) return this.answer();
      await this.fetchNeeded(isCancelled);
      if (isCancelled()) throw new Cancelled();
    }
  }

  private async fetchNeeded(isCancelled: () => boolean): Promise<void> {
    const { module } = this;
    const first = module._isonest_needed() / Float64Array.BYTES_PER_ELEMENT;
    const needed = module.HEAPF64.slice(first, first + module._isonest_needed_count());
    const asked: Promise<void>[] = [];
    for (let i = 0; i < needed.length; i += 2) {
      const [offset, size] = [needed[i] ?? 0, needed[i + 1] ?? 0];
      asked.push(this.bytes.read(offset, size, isCancelled).then((bytes) => this.put(offset, bytes)));
    }
    this.counts.trips += 1;
    try {
      await Promise.all(asked);
    } catch (error) {
      if (isCancelled()) throw new Cancelled();
      throw new NotFetched(error instanceof Error ? error.message : String(error));
    }
  }

  private put(offset: number, bytes: Uint8Array): void {
    const at = this.module._malloc(bytes.length);
    if (at === 0) throw new Error("This page has too little memory for the data to be fetched.");
    this.module.HEAPU8.set(bytes, at);
    this.module._isonest_put(offset, at, bytes.length);
    this.module._free(at);
  }

  private answer(): WasmAnswer {
    const { module } = this;
    const copied = (from: number, size: number): ArrayBuffer => module.HEAPU8.slice(from, from + size).buffer as ArrayBuffer;
    const arrays: ArrayBuffer[] = [];
    for (let which = 0; which < module._isonest_array_count(); ++which) {
      arrays.push(copied(module._isonest_array(which), module._isonest_array_bytes(which)));
    }
    const answer = {
      status: module._isonest_answer_status(),
      type: this.text(module._isonest_answer_type()),
      body: copied(module._isonest_answer_body(), module._isonest_answer_size()),
      arrays,
    };
    module._isonest_answer_done();
    return answer;
  }

  private text(at: number): string {
    const heap = this.module.HEAPU8;
    return new TextDecoder().decode(heap.slice(at, heap.indexOf(0, at)));
  }

  private withText<T>(text: string, use: (at: number) => T): T {
    const bytes = new TextEncoder().encode(text + "\0");
    const at = this.module._malloc(bytes.length);
    if (at === 0) throw new Error("This page has too little memory.");
    this.module.HEAPU8.set(bytes, at);
    try {
      return use(at);
    } finally {
      this.module._free(at);
    }
  }
}

/** Message and kind of an answer that is an error. */
function problemOf(answer: WasmAnswer): [string, string] {
  const text = new TextDecoder().decode(answer.body);
  try {
    const { message, kind } = (JSON.parse(text) as { error: { message: string; kind: string } }).error;
    return [message, kind];
  } catch {
    return [text, "io"];
  }
}
