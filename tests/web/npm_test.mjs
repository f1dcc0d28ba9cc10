// Tests the npm package: packs it, installs it in a separate project (consumer/), and compares the project's results in Node
// and in Chromium with the files that the program writes for the same queries.
// usage: npm_test.mjs ISONEST FOLDER-WITH-isonest.wasm
// Exit code 77 with a message: isonest.wasm was not built, or npm or the page's packages are missing.
import assert from "node:assert/strict";
import { execFile, execFileSync } from "node:child_process";
import { existsSync } from "node:fs";
import { copyFile, mkdir, readFile, stat, writeFile } from "node:fs/promises";
import { createRequire } from "node:module";
import { dirname, join } from "node:path";
import { after, before, test as anyTest } from "node:test";
import { fileURLToPath, pathToFileURL } from "node:url";
import { lacks, run, startBrowser, temporaryFolder } from "../../tools/view/web/drive.mjs";
import { kShared, serveFiles } from "../view/static_server.mjs";
import { kSlices, kSurfaces, problem } from "./consumer/queries.mjs";

const [, , program, wasmFolder] = process.argv;
const here = dirname(fileURLToPath(import.meta.url));
const root = join(here, "../..");
const web = createRequire(join(root, "tools/view/web/package.json"));
const has = (command) => {
  try {
    return Boolean(execFileSync(command, ["--version"], { stdio: ["ignore", "pipe", "ignore"] }));
  } catch {
    return false;
  }
};
const reason =
  !wasmFolder || !existsSync(join(wasmFolder, "isonest.wasm")) ? "isonest.wasm was not built: it needs emscripten and node-acorn (tools/install-deps --wasm)"
  : !has("npm") ? "npm is missing: tools/install-deps"
  : !existsSync(join(root, "tools/view/web/node_modules/esbuild")) ? "the page's packages are not installed: tools/install-deps --tests"
  : null;
if (reason) {
  console.log(`skipped: ${reason}`);
  process.exit(77);
}
const noBrowser = lacks() ?? false;
const test = (name, body, options = {}) => anyTest(name, { timeout: 300_000, ...options }, body);
const testInBrowser = (name, body) => test(name, body, { skip: noBrowser });
const MB = 2 ** 20;

let folder, project, packed, store, labels, plane, linear, open, isonest, server, browser, truth;

/** Runs a program in the project; returns its standard output. */
const inProject = (command, ...args) =>
  new Promise((resolve, reject) => {
    execFile(command, args, { cwd: project, maxBuffer: 2 ** 28 }, (error, stdout, stderr) => (error ? reject(new Error(`${args.join(" ")}: ${stderr}${stdout}`)) : resolve(stdout)));
  });

const floats = (text) => new Float32Array(new Uint8Array(Buffer.from(text, "base64")).buffer);
const numbers = (text) => new Uint32Array(new Uint8Array(Buffer.from(text, "base64")).buffer);

/** The vertices of a binary PLY, a Float32Array per property, and the corners of its triangles. */
async function readPly(path) {
  const bytes = await readFile(path);
  const begin = bytes.indexOf("end_header\n") + "end_header\n".length;
  const lines = bytes.toString("latin1", 0, begin).split("\n").map((line) => line.split(" "));
  const count = (what) => Number(lines.find(([one, name]) => one === "element" && name === what)[2]);
  const names = lines.filter(([one, type]) => one === "property" && type !== "list").map(([, type, name]) => (assert.equal(type, "float"), name));
  const columns = Object.fromEntries(names.map((name) => [name, new Float32Array(count("vertex"))]));
  let at = begin;
  for (let i = 0; i < count("vertex"); ++i) for (const name of names) (columns[name][i] = bytes.readFloatLE(at)), (at += 4);
  const corners = new Uint32Array(3 * count("face"));
  for (let i = 0; i < count("face"); ++i, at += 13) {
    assert.equal(bytes[at], 3);
    for (let k = 0; k < 3; ++k) corners[3 * i + k] = bytes.readInt32LE(at + 1 + 4 * k);
  }
  assert.equal(at, bytes.length);
  return { columns, corners };
}

/** x, y, z, x, ... of three columns. */
function together(columns, names) {
  const rows = new Float32Array(3 * columns[names[0]].length);
  names.forEach((name, axis) => columns[name].forEach((value, i) => (rows[3 * i + axis] = value)));
  return rows;
}

/** The program's result for a query: its report and its mesh. */
async function native(command, path, asked) {
  const { axis, index, position, plane: of, triangles, normals = true, ...rest } = asked;
  const words = [command, path, "--json", "-o", join(folder.path, "native.ply"), "--space", "as-stored"];
  for (const [name, value] of Object.entries(rest)) words.push(`--${name}=${Array.isArray(value) ? value.join(",") : value}`);
  if (command === "slice") words.push(`--plane=${of ?? [...["x", "y", "z"].map((one) => (one === axis ? 1 : 0)), index ?? position]}`);
  else if (!("effort" in asked) && (asked.error || asked.distance || triangles)) words.push("--effort=fast");
  if (triangles) words.push(`--triangles=${triangles}`);
  if (command === "extract" && normals && !("smooth" in asked)) words.push("--normals");
  return { report: JSON.parse(await run(program, ...words)), ...(await readPly(join(folder.path, "native.ply"))) };
}

/** Asserts that a mesh of the package, with its arrays in base64, is that of the program. */
function same(mesh, expected, what) {
  const { report, columns, corners } = expected;
  assert.deepEqual(numbers(mesh.indices), corners, what);
  assert.deepEqual(floats(mesh.positions), together(columns, ["x", "y", "z"]), what);
  if (mesh.normals) assert.deepEqual(floats(mesh.normals), together(columns, ["nx", "ny", "nz"]), what);
  if (mesh.values) assert.deepEqual(floats(mesh.values), columns.value, what);
  assert.equal(mesh.corners, 3);
  const bounds = { errorBound: report.error_bound, distanceBound: report.distance_bound };
  const bound = mesh.distanceBound === null ? "errorBound" : "distanceBound";
  assert.equal(mesh[bound], bounds[bound], what);
  assert.equal(mesh.bound, mesh[bound], what);
}

/** Asserts that all results of a consumer are those of the program. */
function sameAll(got, what) {
  assert.equal(got.surfaces.length, kSurfaces.length);
  got.surfaces.forEach((mesh, i) => same(mesh, truth.surfaces[i], `${what}: surface ${JSON.stringify(kSurfaces[i])}`));
  got.slices.forEach((mesh, i) => same(mesh, truth.slices[i], `${what}: slice ${JSON.stringify(kSlices[i])}`));
  assert.equal(got.surfaces[4].normals, null);
  assert.deepEqual(got.info.dims, [65, 65, 65]);
  assert.equal(got.info.unit, "um");
  assert.ok(got.histogram.suggested.length > 0 && got.histogram.bins.length > 10);
}

before(async () => {
  folder = await temporaryFolder();
  const make = async (name, volume, ...options) => {
    const path = join(folder.path, `${name}.isonest`);
    await run(program, "preprocess", volume, ...options, "-o", path, "-q");
    return path;
  };
  const volume = async (name, ...options) => {
    await run(program, "make-volume", ...options, "-o", join(folder.path, name), "-q");
    return join(folder.path, name);
  };
  store = await make("bucky", await volume("bucky.h5", "bucky", "--size", "65"), "--unit", "um");
  plane = await make("plane", await volume("plane.h5", "cahn-hilliard", "--size", "129,97"));
  const raw = Buffer.alloc(40 * 36 * 33);
  for (let z = 0; z < 33; ++z) for (let y = 0; y < 36; ++y) for (let x = 0; x < 40; ++x) raw[(z * 36 + y) * 40 + x] = Math.hypot(x - 19, y - 17, z - 15) < 12 ? 3 : x > 30 ? 7 : 0;
  await writeFile(join(folder.path, "labels.raw"), raw);
  await writeFile(join(folder.path, "names.txt"), "3 ball 255 0 0 255\n7 slab 0 255 0 255\n");
  labels = await make("labels", join(folder.path, "labels.raw"), "--dims", "40,36,33", "--type", "uint8", "--labels", "--label-names", join(folder.path, "names.txt"));
  // x + 2 y + 4 z at the nodes, of a volume that is rotated, in LPS.
  const values = new Float32Array(20 * 18 * 16);
  for (let z = 0; z < 16; ++z) for (let y = 0; y < 18; ++y) for (let x = 0; x < 20; ++x) values[(z * 18 + y) * 20 + x] = x + 2 * y + 4 * z;
  const header = "NRRD0005\ntype: float\ndimension: 3\nspace: left-posterior-superior\nsizes: 20 18 16\nspace directions: (0,0.5,0) (-1,0,0) (0,0,2)\nspace origin: (10,20,30)\nencoding: raw\nendian: little\n\n";
  await writeFile(join(folder.path, "linear.nrrd"), Buffer.concat([Buffer.from(header), Buffer.from(values.buffer)]));
  linear = await make("linear", join(folder.path, "linear.nrrd"));

  packed = execFileSync(process.execPath, [join(root, "tools/web/npm/build.mjs"), wasmFolder, join(folder.path, "npm")]).toString().trim();
  project = join(folder.path, "project");
  await mkdir(project);
  await writeFile(join(project, "package.json"), JSON.stringify({ name: "consumer", private: true, type: "module" }));
  await inProject("npm", "install", "--offline", "--ignore-scripts", "--no-audit", "--no-fund", packed);
  for (const name of ["queries.mjs", "main.mjs", "page.mjs", "types.ts"]) await copyFile(join(here, "consumer", name), join(project, name));
  isonest = await import(pathToFileURL(join(project, "node_modules/isonest/node.js")).href);
  open = isonest.open;
  server = await serveFiles(folder.path, { headers: kShared });
  truth = { surfaces: [], slices: [] };
  for (const asked of kSurfaces) truth.surfaces.push(await native("extract", store, asked));
  for (const asked of kSlices) truth.slices.push(await native("slice", store, asked));
  if (!noBrowser) browser = await startBrowser("--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1");
});
after(async () => {
  await browser?.close();
  await server?.end();
  await folder?.end();
});

test("the package holds what it needs, and the version of the program", async () => {
  const inside = join(project, "node_modules/isonest");
  const about = JSON.parse(await readFile(join(inside, "package.json"), "utf8"));
  assert.equal(about.version, (await run(program, "--version")).match(/\d+\.\d+\.\d+/)[0]);
  assert.equal(about.dependencies, undefined);
  for (const name of ["index.js", "node.js", "worker.js", "node_worker.js", "isonest.wasm", "index.d.ts", "store.d.ts", "README.md", "LICENSE", "licences.txt"]) {
    assert.ok((await stat(join(inside, name))).size > 100, name);
  }
  assert.match(await readFile(join(inside, "licences.txt"), "utf8"), /zstd[\s\S]*xxhash[\s\S]*emscripten/i);
  console.log(`# ${packed.split("/").pop()}: ${(await stat(packed)).size} bytes`);
});

test("in Node, a file, a URL, bytes and a blob give the program's meshes", async () => {
  const sources = [`source:${store}`, `source:${pathToFileURL(store)}`, `source:${server.url}bucky.isonest`, `bytes:${store}`, `blob:${store}`];
  const lines = (await inProject(process.execPath, "main.mjs", ...sources)).trim().split("\n");
  assert.equal(lines.length, sources.length);
  lines.forEach((line, i) => {
    const got = JSON.parse(line);
    sameAll(got, sources[i]);
    console.log(`# Node, ${sources[i].split(":")[0]} ${i}: ${got.first.toFixed(0)} ms to the first surface`);
  });
});

test("of a store at a URL, only ranges are fetched", async () => {
  const own = await serveFiles(folder.path);
  const one = await open(`${own.url}bucky.isonest`);
  const coarse = await one.surface({ iso: 0.5, error: "20%", effort: "none" });
  assert.ok(coarse.indices.length > 100);
  const fetched = own.requests.reduce((sum, { bytes }) => sum + bytes, 0);
  assert.ok(own.requests.length > 1 && own.requests.every(({ method, range }) => method === "HEAD" || range !== null));
  assert.ok(fetched < (await stat(store)).size / 2, `${fetched} bytes`);
  one.close();
  await own.end();
});

test("a query ends with little memory, or says how much it needs", async () => {
  const full = await native("extract", store, { iso: 0.5, effort: "none" });
  for (const source of [store, `${server.url}bucky.isonest`]) {
    const one = await open(source, { memory: 96 * MB });
    const mesh = await one.surface({ iso: 0.5, effort: "none" });
    assert.deepEqual(mesh.indices, full.corners, source);
    const image = await problem(one.sliceImage({ axis: "z", index: 3, width: 4000 }));
    assert.ok(image.kind === "limit" && /4000 x 4000 pixels/.test(image.message), JSON.stringify(image));
    assert.deepEqual((await one.surface({ iso: 0.5, effort: "none" })).indices, full.corners, "the next query is answered");
    one.close();
  }
  const small = await open(store, { memory: 32 * MB });
  const { kind, message } = await problem(small.surface({ iso: 0.5 }));
  const [, advised] = /memory: (\d+) \* 2 \*\* 20/.exec(message) ?? [];
  assert.ok(kind === "limit" && Number(advised) > 32 && !/--/.test(message), message);
  small.close();
  const enough = await open(store, { memory: Number(advised) * MB });
  assert.deepEqual((await enough.surface({ iso: 0.5 })).indices, truth.surfaces[0].corners);
  enough.close();
  for (const memory of [1, 2 ** 40, Number.NaN]) await assert.rejects(open(store, { memory }), RangeError);
});

test("labels, their smooth surfaces, and data in a plane", async () => {
  const one = await open(labels);
  assert.equal(one.info.labels, true);
  const mesh = await one.surface({ label: 3 });
  const expected = await native("extract", labels, { label: 3 });
  assert.deepEqual(mesh.indices, expected.corners);
  assert.deepEqual((await one.surface({ label: 3n })).positions, mesh.positions);
  const smooth = await one.surface({ label: 3, smooth: 8 });
  const smoothed = await native("extract", labels, { label: 3, smooth: 8 });
  assert.deepEqual(smooth.positions, together(smoothed.columns, ["x", "y", "z"]));
  assert.ok(smooth.normals === null && smooth.smoothBound > 0 && smooth.bound === smooth.smoothBound);
  assert.equal(await one.value([19, 17, 15]), 3);
  assert.equal(await one.value([-5, 0, 0]), null);
  one.close();
  const flat = await open(plane);
  assert.equal(flat.info.dimension, 2);
  const lines = await flat.surface({ iso: 0 });
  assert.ok(lines.corners === 2 && lines.indices.length > 100 && lines.area === null);
  assert.equal(isonest.vtkCells(lines).length, (lines.indices.length / 2) * 3);
  const image = await flat.sliceImage({ axis: "z", index: 0, width: 64 });
  assert.ok(image.height === 48 && image.values.every(Number.isFinite));
  flat.close();
});

test("pixels have the values of the data, within the bound", async () => {
  const one = await open(store);
  const [low, high] = one.info.range;
  for (const [asked, most] of [[{ axis: "z", index: 20 }, 1e-5 * (high - low)], [{ axis: "x", position: 31.3, error: "5%" }, 0.05 * (high - low)], [{ plane: [1, 2, 3, 190] }, 1e-5 * (high - low)]]) {
    const image = await one.sliceImage({ ...asked, width: 37 });
    assert.equal(image.values.length, 37 * image.height);
    assert.ok(image.errorBound <= most, `${image.errorBound}`);
    let inside = 0;
    for (let j = 1; j < image.height; j += 7) {
      for (let i = 1; i < 37; i += 5) {
        const at = image.origin.map((x, axis) => x + i * image.right[axis] + j * image.down[axis]);
        const [expected, pixel] = [await one.value(at), image.values[j * 37 + i]];
        if (expected === null) continue;
        ++inside;
        assert.ok(Math.abs(pixel - expected) <= image.errorBound + 1e-5 * (high - low), `${JSON.stringify(asked)} ${i} ${j}: ${pixel}, ${expected}`);
      }
    }
    assert.ok(inside > 15, `${inside}`);
    if (asked.axis) assert.ok(image.values.every(Number.isFinite));
    else assert.ok(image.values.some(Number.isNaN));
  }
  const { kind } = await problem(one.sliceImage({ axis: "z", index: 2, width: 10, box: [100, 100, 100, 101, 101, 101] }));
  assert.equal(kind, "invalid_argument");
  one.close();
});

test("a turned volume: planes along its own axes, and RAS or LPS", async () => {
  const one = await open(linear);
  assert.equal(one.info.frame, "LPS");
  const image = await one.sliceImage({ axis: "z", index: 5, width: 19 });
  assert.deepEqual([image.width, image.height], [19, 34]); // 9.5 x 17 world units
  image.values.forEach((value, n) => {
    const at = [0, 1, 2].map((axis) => image.origin[axis] + (n % 19) * image.right[axis] + Math.floor(n / 19) * image.down[axis]);
    const [x, y] = [(at[1] - 20) / 0.5, -(at[0] - 10)];
    assert.ok(Math.abs(value - (x + 2 * y + 20)) < 1e-4 && Math.abs(at[2] - 40) < 1e-9, `${n}: ${value}`);
  });
  const [stored, ras, lps] = await Promise.all([undefined, "ras", "lps"].map((space) => one.surface({ iso: 50.5, space })));
  assert.deepEqual(lps.positions, stored.positions);
  assert.deepEqual(ras.positions, stored.positions.map((x, i) => (i % 3 < 2 ? -x : x)));
  assert.deepEqual(ras.normals, stored.normals.map((x, i) => (i % 3 < 2 ? -x : x)));
  const turned = await one.sliceImage({ axis: "z", index: 5, width: 19, space: "ras" });
  assert.deepEqual([turned.origin[0], turned.origin[2]], [-image.origin[0], image.origin[2]]);
  assert.deepEqual(turned.values, image.values);
  one.close();
  const other = await open(store);
  assert.match((await problem(other.surface({ iso: 0.5, space: "ras" }))).message, /patient axes .* unknown/);
  other.close();
});

test("errors have the library's message and kind", async () => {
  const bytes = await readFile(store);
  const broken = Buffer.from(bytes);
  for (let i = 5000; i < broken.length - 20_000; i += 101) broken[i] ^= 0x55;
  await writeFile(join(folder.path, "broken.isonest"), broken);
  for (const source of [broken, join(folder.path, "broken.isonest"), `${server.url}broken.isonest`]) {
    const said = await problem((async () => (await open(source)).surface({ iso: 0.5 }))());
    assert.equal(said?.kind, "corrupt", JSON.stringify(said));
    assert.ok(said.name === "IsonestError" && said.message.length > 20);
  }
  assert.equal((await problem(open(bytes.subarray(0, 3000))))?.name, "IsonestError");
  assert.equal((await problem(open(join(folder.path, "nothing.isonest")))).kind, "not_found");
  assert.match((await problem(open(`${server.url}nothing.isonest`))).message, /no such file/);
  const whole = await serveFiles(folder.path, { ranges: false });
  assert.match((await problem(open(`${whole.url}bucky.isonest`).then((one) => one.surface({ iso: 0.5 })))).message, /ranges/);
  await whole.end();
  assert.match((await problem(open(`${whole.url}bucky.isonest`))).message, /cannot be reached\.$/);
  const one = await open(store);
  assert.match((await problem(one.surface({ error: 1 }))).message, /iso is missing/);
  assert.match((await problem(one.surface({ iso: 1, error: 1, distance: 1 }))).message, /give one of/);
  await assert.rejects(one.surface({ iso: 1, error: "much" }), RangeError);
  await assert.rejects(one.surface({ iso: 1, distance: "1mile" }), RangeError);
  assert.ok((await one.surface({ iso: 0.5, error: "5%" })).indices.length > 0, "the next query is answered");
  one.close();
  await assert.rejects(one.surface({ iso: 0.5 }), /closed/);
});

test("a failed read while a query runs is an error, and the next query is answered", async () => {
  let fails = false;
  const own = await serveFiles(folder.path, { handle: (request, response) => fails && (response.writeHead(403).end(), true) });
  const one = await open(`${own.url}bucky.isonest`);
  fails = true;
  const said = await problem(one.surface({ iso: 0.5 }));
  assert.ok(said.kind === "io" && /403/.test(said.message), JSON.stringify(said));
  fails = false;
  assert.deepEqual((await one.surface({ iso: 0.5 })).indices, truth.surfaces[0].corners);
  one.close();
  await own.end();
});

test("queries can be dropped, stores used together, and a process ends that forgot to close", async () => {
  const [one, other] = await Promise.all([open(store), open(labels)]);
  const stop = new AbortController();
  const asked = [one.surface({ iso: 0.5 }), one.surface({ iso: 0.6, signal: stop.signal }), other.surface({ label: 3 }), one.surface({ iso: 0.7 })];
  stop.abort(new Error("not needed"));
  const got = await Promise.allSettled(asked);
  assert.deepEqual(got.map(({ status }) => status), ["fulfilled", "rejected", "fulfilled", "fulfilled"]);
  assert.match(got[1].reason.message, /not needed/);
  await assert.rejects(one.surface({ iso: 0.5, signal: AbortSignal.abort(new Error("too late")) }), /too late/);
  const waiting = one.surface({ iso: 0.5 });
  one.close();
  await assert.rejects(waiting, /closed/);
  other.close();
  const script = `import { open } from "isonest"; const s = await open(${JSON.stringify(store)}); console.log((await s.surface({ iso: 0.5 })).corners)`;
  assert.equal((await inProject(process.execPath, "--input-type=module", "-e", script)).trim(), "3");
});

test("arrays fit three.js and vtk.js", async () => {
  const { BufferAttribute, BufferGeometry } = await import(pathToFileURL(join(root, "tools/view/web/node_modules/three/build/three.module.js")).href);
  const one = await open(store);
  const surface = await one.surface({ iso: 0.5 });
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(surface.positions, 3));
  geometry.setAttribute("normal", new BufferAttribute(surface.normals, 3));
  geometry.setIndex(new BufferAttribute(surface.indices, 1));
  geometry.computeBoundingBox();
  const { min, max } = geometry.boundingBox;
  assert.ok(min.x >= 0 && max.x <= 64 && max.x - min.x > 10);
  const kept = surface.normals.slice();
  geometry.computeVertexNormals(); // by three.js, from the triangles: the same side
  let alike = 0;
  const own = geometry.getAttribute("normal").array;
  for (let i = 0; i < kept.length; i += 3) alike += kept[i] * own[i] + kept[i + 1] * own[i + 1] + kept[i + 2] * own[i + 2] > 0.5;
  assert.ok(alike > 0.95 * (kept.length / 3), `${alike} of ${kept.length / 3}`);
  const cells = isonest.vtkCells(surface);
  assert.equal(cells.length, (surface.indices.length / 3) * 4);
  for (let i = 0; i < cells.length; i += 4) assert.ok(cells[i] === 3 && cells[i + 1] === surface.indices[(i / 4) * 3]);
  one.close();
});

test("types are right, and wrong options are errors", async () => {
  const compiler = join(root, "tools/view/web/node_modules/.bin/tsc");
  for (const [module, resolution] of [["nodenext", "nodenext"], ["esnext", "bundler"]]) {
    const compilerOptions = { noEmit: true, strict: true, target: "es2022", lib: ["es2022", "dom"], types: [], module, moduleResolution: resolution };
    await writeFile(join(project, "tsconfig.json"), JSON.stringify({ compilerOptions, files: ["types.ts"] }));
    await inProject(process.execPath, compiler, "-p", ".");
  }
});

/** A page of the project at this server, and the faults that occur in it. `imports`: where the package is. */
async function openProject(origin, script = '<script type="module" src="/project/page.mjs"></script>', imports = "/project/node_modules/isonest/index.js") {
  const map = `<script type="importmap">{"imports": {"isonest": "${imports}"}}</script>`;
  const name = `page${Math.random()}.html`;
  await writeFile(join(folder.path, name), `<!doctype html><meta charset="utf-8"><link rel="icon" href="data:,">${map}${script}`);
  const page = await (await browser.newContext()).newPage();
  const faults = [];
  page.on("pageerror", (error) => faults.push(error.message));
  await page.goto(`${origin.url}${name}`);
  await page.waitForFunction(() => window.consumer, undefined, { timeout: 60_000 });
  return { page, faults, close: () => page.context().close() };
}

testInBrowser("in Chromium, a URL, a blob and bytes give the program's meshes", async () => {
  const { page, faults, close } = await openProject(server);
  for (const how of ["run", "runBlob", "runBytes"]) {
    const got = await page.evaluate(([name, url]) => window.consumer[name](url), [how, "/bucky.isonest"]);
    sameAll(got, `Chromium, ${how}`);
    console.log(`# Chromium, ${how}: ${got.first.toFixed(0)} ms to the first surface`);
  }
  const image = await page.evaluate(() => window.consumer.image("/linear.isonest", { axis: "z", index: 5, width: 19 }));
  const one = await open(linear);
  assert.deepEqual(floats(image.values), (await one.sliceImage({ axis: "z", index: 5, width: 19 })).values);
  one.close();
  // The page's own worker has no document.
  const inWorker = await page.evaluate(() => new Promise((resolve) => {
    const script = `import { open } from "${location.origin}/project/node_modules/isonest/index.js";
      import { run } from "${location.origin}/project/queries.mjs";
      run(open, "${location.origin}/bucky.isonest").then((got) => postMessage(got), (error) => postMessage(error.message));`;
    new Worker(URL.createObjectURL(new Blob([script], { type: "text/javascript" })), { type: "module" }).onmessage = ({ data }) => resolve(data);
  }));
  sameAll(inWorker, "Chromium, in a worker");
  const little = await page.evaluate((memory) => window.consumer.run("/bucky.isonest", { memory }), 192 * MB);
  sameAll(little, "Chromium, little memory");
  assert.deepEqual(faults, []);
  await close();
});

testInBrowser("in Chromium, errors have the library's message and kind", async () => {
  const { page, close } = await openProject(server);
  const said = await page.evaluate(() => window.consumer.problem("/project/main.mjs"));
  assert.ok(said.name === "IsonestError" && said.kind !== "io", JSON.stringify(said));
  assert.match((await page.evaluate(() => window.consumer.problem("/nothing.isonest"))).message, /no such file/);
  const closed = await serveFiles(folder.path); // without CORS
  assert.match((await page.evaluate((url) => window.consumer.problem(url), `${closed.url}bucky.isonest`)).message, /Access-Control-Allow-Origin/);
  await closed.end();
  assert.match((await page.evaluate(() => window.consumer.problem("/bucky.isonest", { files: "/nowhere" }))).message, /worker\.js/);
  await close();
});

testInBrowser("in Chromium, the package can come from another server, or from a bundle", async () => {
  const other = await serveFiles(folder.path, { headers: kShared });
  const far = await openProject(server, undefined, `${other.url}project/node_modules/isonest/index.js`);
  sameAll(await far.page.evaluate(() => window.consumer.run("/bucky.isonest")), "from another server");
  await far.close();
  await other.end();
  const { build } = web("esbuild");
  await build({ entryPoints: [join(project, "page.mjs")], outfile: join(folder.path, "bundle/app.js"), bundle: true, format: "esm", logLevel: "error" });
  await mkdir(join(folder.path, "assets"));
  for (const name of ["worker.js", "isonest.wasm"]) await copyFile(join(project, "node_modules/isonest", name), join(folder.path, "assets", name));
  const bundled = await openProject(server, '<script type="module" src="/bundle/app.js"></script>');
  sameAll(await bundled.page.evaluate(() => window.consumer.run("/bucky.isonest", { files: "/assets" })), "from a bundle");
  await bundled.close();
});
