// Makes the npm package: OUT/isonest/ and OUT/isonest-VERSION.tgz. usage: node build.mjs WASM_FOLDER OUT
// WASM_FOLDER: made by tools/build-wasm. The bundler and the TypeScript compiler are those of tools/view/web (npm ci there).
import { execFileSync } from "node:child_process";
import { copyFile, mkdir, readFile, rm, writeFile } from "node:fs/promises";
import { createRequire } from "node:module";
import { dirname, join, resolve } from "node:path";
import { fileURLToPath } from "node:url";

const here = dirname(fileURLToPath(import.meta.url));
const root = resolve(here, "../../..");
const web = join(root, "tools/view/web");
const [wasm, out] = process.argv.slice(2).map((path) => resolve(path));
if (!out) throw new Error("usage: node build.mjs WASM_FOLDER OUT");
const { build } = createRequire(join(web, "package.json"))("esbuild");

/** The Debian packages of the libraries in isonest.wasm; their copyright files contain the licences. */
const kContained = ["libzstd-dev", "libxxhash-dev", "libmeshoptimizer-dev", "libfmt-dev", "nlohmann-json3-dev", "robin-map-dev", "emscripten"];

/** The version of the project; this is the only place that states it. */
async function version() {
  const [, found] = /^project\(isonest VERSION ([0-9.]+)/m.exec(await readFile(join(root, "CMakeLists.txt"), "utf8")) ?? [];
  if (!found) throw new Error("CMakeLists.txt states no version");
  return found;
}

async function licences() {
  const parts = ["isonest.wasm contains parts of the libraries below. Each is followed by the copyright file of its Debian package."];
  for (const name of kContained) parts.push(`${name}\n${"-".repeat(name.length)}\n${(await readFile(`/usr/share/doc/${name}/copyright`, "utf8")).trim()}`);
  return `${parts.join("\n\n\n")}\n`;
}

const loader = {
  name: "loader",
  setup(bundle) {
    bundle.onResolve({ filter: /^isonest:loader$/ }, () => ({ path: join(wasm, "isonest.mjs") }));
  },
};

const folder = join(out, "isonest");
await rm(folder, { recursive: true, force: true });
await mkdir(folder, { recursive: true });
const common = { absWorkingDir: here, outdir: folder, bundle: true, format: "esm", target: "es2022", legalComments: "none", logLevel: "warning", plugins: [loader] };
await build({ ...common, entryPoints: { index: "src/index.ts", worker: "src/worker.ts" } });
await build({ ...common, entryPoints: { node: "src/node.ts", node_worker: "src/node_worker.ts" }, platform: "node" });
const types = join(out, "types");
execFileSync(process.execPath, [join(web, "node_modules/.bin/tsc"), "-p", here, "--noEmit", "false", "--declaration", "--emitDeclarationOnly", "--outDir", types], { stdio: "inherit" });
const declarations = join(types, "web/npm/src");
for (const name of ["index.d.ts", "store.d.ts"]) await copyFile(join(declarations, name), join(folder, name));
await rm(types, { recursive: true });
await copyFile(join(wasm, "isonest.wasm"), join(folder, "isonest.wasm"));
await copyFile(join(root, "LICENSE"), join(folder, "LICENSE"));
await copyFile(join(here, "README.md"), join(folder, "README.md"));
await writeFile(join(folder, "licences.txt"), await licences());
const { name, ...rest } = JSON.parse(await readFile(join(here, "package.json"), "utf8"));
const stated = await version();
await writeFile(join(folder, "package.json"), `${JSON.stringify({ name, version: stated, ...rest }, null, 2)}\n`);
const packed = JSON.parse(execFileSync("npm", ["pack", "--json", "--ignore-scripts", "--pack-destination", out], { cwd: folder, stdio: ["ignore", "pipe", "inherit"] }).toString());
console.log(join(out, packed[0].filename));
