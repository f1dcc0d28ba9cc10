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
    _isonest_begin(url: number, size: number, memory: number): void;
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
export declare class Cancelled extends Error {
}
/** Bytes could not be fetched. */
export declare class NotFetched extends Error {
}
/** The object is not a store, or not one that can be opened. */
export declare class NotOpened extends Error {
    readonly kind: string;
    constructor(message: string, kind: string);
}
/** Counters since it was created. */
export interface Counts {
    runs: number;
    trips: number;
}
export declare class WasmStore {
    private readonly module;
    private readonly bytes;
    readonly memory: WebAssembly.Memory;
    readonly counts: Counts;
    private constructor();
    /** Throws NotOpened with the answer's error if the object is not a store. `memory`: memory budget in bytes. */
    static open(load: Loader, wasmBinary: ArrayBuffer | Uint8Array, bytes: ObjectBytes, memory: number): Promise<WasmStore>;
    /** `target`: "/api/..." as in PROTOCOL.md, or "/arrays/..." as in tools/web/array_answers.h. Throws Cancelled once `isCancelled()`, which is called between two runs. */
    ask(target: string, isCancelled?: () => boolean): Promise<WasmAnswer>;
    private run;
    private fetchNeeded;
    private put;
    private answer;
    private text;
    private withText;
}
export {};
