// Runs isonest.wasm in Node, with files in place of URLs.
import { openSync, readSync, fstatSync, closeSync } from "node:fs";
import { readFile } from "node:fs/promises";
import { createRequire } from "node:module";
import { dirname, join } from "node:path";
import { fileURLToPath, pathToFileURL } from "node:url";

const web = join(dirname(fileURLToPath(import.meta.url)), "../../tools/view/web");

class FileBytes {
  constructor(path, roundTrip, name = path) {
    this.name = name;
    this.roundTrip = roundTrip;
    this.file = openSync(path);
    this.size = fstatSync(this.file).size;
    this.fetched = 0;
    this.fail = null;
  }
  readNow(offset, size) {
    if (this.fail) throw new Error(this.fail);
    const bytes = new Uint8Array(size);
    if (readSync(this.file, bytes, 0, size, offset) !== size) throw new Error(`${this.name}: is shorter than it was`);
    this.fetched += size;
    return bytes;
  }
  async read(offset, size) {
    return this.readNow(offset, size);
  }
}

/**
 * Returns `open(path, memory, {roundTrip})`, which opens a WasmStore. Its property `fail` sets an error message that
 * reading its bytes throws from then on. `bytesOf(path, name)`: the bytes of another store, under this name.
 */
export async function wasmStores(wasmFolder, scratch) {
  const { build } = await import(pathToFileURL(createRequire(join(web, "package.json")).resolve("esbuild")).href);
  const script = join(scratch, "wasm_store.mjs");
  await build({ entryPoints: [join(web, "src/queries/wasm_store.ts")], outfile: script, bundle: true, format: "esm", logLevel: "warning" });
  const { WasmStore } = await import(pathToFileURL(script).href);
  // The loader expects the globals of a worker.
  globalThis.self ??= globalThis;
  globalThis.location ??= { href: pathToFileURL(wasmFolder).href };
  const { default: load } = await import(pathToFileURL(join(wasmFolder, "isonest.mjs")).href);
  const binary = await readFile(join(wasmFolder, "isonest.wasm"));
  const open = async (path, memory, { roundTrip = 20 } = {}) => {
    const bytes = new FileBytes(path, roundTrip);
    try {
      const store = await WasmStore.open(load, binary, bytes, memory);
      Object.defineProperty(store, "fail", { set: (message) => (bytes.fail = message) });
      store.fetched = () => bytes.fetched;
      return store;
    } catch (error) {
      closeSync(bytes.file);
      throw error;
    }
  };
  return { open, bytesOf: (path, name) => new FileBytes(path, 20, name) };
}
