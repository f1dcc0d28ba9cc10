// Bundles the page. usage: node build.mjs [FOLDER]   (default: dist, beside this file)
import { build } from "esbuild";
import { copyFile, mkdir, readFile, rm, writeFile } from "node:fs/promises";
import { dirname, join, resolve } from "node:path";
import { fileURLToPath } from "node:url";

const here = dirname(fileURLToPath(import.meta.url));
const out = resolve(process.argv[2] ?? join(here, "dist"));

/** The program's own colour maps, as {name: six hexadecimal digits per colour}. */
const colorMaps = {
  name: "color-maps",
  setup(bundle) {
    bundle.onResolve({ filter: /^isonest:color-maps$/ }, (args) => ({ path: args.path, namespace: "isonest" }));
    bundle.onLoad({ filter: /.*/, namespace: "isonest" }, async () => {
      const table = await readFile(join(here, "../../drawing/color_map_tables.inc"), "utf8");
      const maps = {};
      for (const [, name, digits] of table.matchAll(/\{"([^"]+)",((?:\s*"[0-9a-f]+")+)\}/g)) {
        maps[name] = digits.replace(/[^0-9a-f]/g, "");
      }
      if (!maps.viridis || !maps.gray) throw new Error("color_map_tables.inc: no colour maps found");
      return { contents: JSON.stringify(maps), loader: "json" };
    });
  },
};

/** What is bundled, with its licence notice. */
async function licences() {
  const parts = [];
  for (const [name, file] of [["three", "LICENSE"], ["meshoptimizer", "LICENSE.md"]]) {
    const folder = join(here, "node_modules", name);
    const { version } = JSON.parse(await readFile(join(folder, "package.json"), "utf8"));
    const text = (await readFile(join(folder, file), "utf8")).trim();
    parts.push(`${name} ${version}\n${"-".repeat(name.length + version.length + 1)}\n${text}\n`);
  }
  return "The page contains these libraries.\n\n" + parts.join("\n\n");
}

await rm(out, { recursive: true, force: true });
await mkdir(out, { recursive: true });
await build({
  absWorkingDir: here,
  entryPoints: { main: "src/main.ts", mesh_worker: "src/mesh_worker.ts", worker: "src/queries/query_worker.ts" },
  outdir: out,
  bundle: true,
  format: "iife",
  target: "es2022",
  minify: true,
  legalComments: "none", // licences.txt contains the notices
  plugins: [colorMaps],
  logLevel: "warning",
});
for (const name of ["index.html", "style.css"]) await copyFile(join(here, name), join(out, name));
await writeFile(join(out, "licences.txt"), await licences());
