import type { ObjectBytes } from "./wasm_store";
export declare class UrlBytes implements ObjectBytes {
    private readonly url;
    readonly name: string;
    readonly size: number;
    private readonly state;
    roundTrip: number;
    private readonly received;
    /** `name`: the URL without user, query and fragment. */
    private constructor();
    /** `received` gets the number of bytes of each answer. */
    static open(url: string, received: (bytes: number) => void): Promise<UrlBytes>;
    read(offset: number, size: number, isCancelled: () => boolean): Promise<Uint8Array>;
    readNow(offset: number, size: number): Uint8Array;
    private require;
    private whole;
}
