// Types of modules that have none: the loader made by emscripten, and the parts of Node that are used.
declare module "isonest:loader" {
  const load: (options: object) => Promise<unknown>;
  export default load;
}
declare module "node:worker_threads" {
  export class Worker {
    constructor(script: URL, options: { readonly execArgv: string[] });
    on(event: string, listener: (value: never) => void): void;
    postMessage(message: unknown): void;
    ref(): void;
    unref(): void;
    terminate(): Promise<number>;
  }
  export const parentPort: {
    on(event: "message", listener: (value: never) => void): void;
    postMessage(message: unknown, transfer?: readonly ArrayBuffer[]): void;
  } | null;
}
declare module "node:fs" {
  export function openSync(path: string | URL, flags: string): number;
  export function fstatSync(file: number): { size: number };
  export function readSync(file: number, bytes: Uint8Array, offset: number, size: number, position: number): number;
}
declare module "node:fs/promises" {
  export function readFile(path: URL): Promise<Uint8Array>;
}
