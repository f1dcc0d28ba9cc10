// Tests that real clients show tilesets: glTF validator, 3d-tiles-renderer with three.js, and Cesium, of npm, in Chromium.
// usage: clients_test.mjs ISONEST
// Exit code 77 with a message: Chromium, the page's packages, npm or its registry are missing.
// ISONEST_PICTURES=FOLDER: pictures of what the clients show are written there.
import assert from "node:assert/strict";
import { execFile } from "node:child_process";
import { existsSync } from "node:fs";
import { mkdir, mkdtemp, readFile, readdir, rename, rm, stat, symlink, writeFile } from "node:fs/promises";
import { createRequire } from "node:module";
import { tmpdir, userInfo } from "node:os";
import { dirname, join } from "node:path";
import { after, before, test as anyTest } from "node:test";
import { fileURLToPath, pathToFileURL } from "node:url";
import { lacks, run, startBrowser, temporaryFolder } from "../../tools/view/web/drive.mjs";
import { serveFiles } from "../view/static_server.mjs";

const kPackages = { "3d-tiles-renderer": "0.5.3", cesium: "1.145.0", meshoptimizer: "1.3.0", three: "0.187.0" };

const [, , program] = process.argv;
const here = dirname(fileURLToPath(import.meta.url));
const web = createRequire(join(here, "../../tools/view/web/package.json"));
const pictures = process.env.ISONEST_PICTURES;

function skip(reason) {
  console.log(`skipped: ${reason}`);
  process.exit(77);
}

/** The folder node_modules with the clients, which is kept for the next run. */
async function clientModules() {
  const names = Object.entries(kPackages).map(([name, version]) => `${name}@${version}`);
  const folder = join(tmpdir(), `isonest-clients-${userInfo().uid}-${Object.values(kPackages).join("-")}`);
  const found = await stat(folder).catch(() => null);
  if (found && found.uid !== userInfo().uid) skip(`${folder} is another user's`);
  if (!found) {
    const fresh = await mkdtemp(`${folder}-`);
    await writeFile(join(fresh, "package.json"), JSON.stringify({ private: true }));
    const failed = await new Promise((resolve) => {
      const options = ["--ignore-scripts", "--no-audit", "--no-fund", "--loglevel=error", "--fetch-retries=1"];
      execFile("npm", ["install", ...options, ...names], { cwd: fresh, timeout: 240_000 }, (error, _, stderr) => resolve(error && (stderr || error.message)));
    });
    if (failed) {
      await rm(fresh, { recursive: true, force: true });
      skip(`npm gave no ${names.join(", ")}: ${failed.trim().split("\n")[0]}`);
    }
    // Another run may have been faster.
    await rename(fresh, folder).catch(() => rm(fresh, { recursive: true, force: true }));
  }
  return join(folder, "node_modules");
}

const missing = lacks() ?? ["esbuild", "gltf-validator"].map((name) => (existsSync(join(here, "../../tools/view/web/node_modules", name)) ? null : `${name} is not installed: tools/install-deps --tests`)).find(Boolean);
if (missing) skip(missing);
const modules = await clientModules();

const test = (name, body) => anyTest(name, { timeout: 300_000 }, body);

let folder, server, browser, fullTriangles;

/** The tilesets, and what the program said of them. */
const sites = {};

async function makeSite(name, ...options) {
  sites[name] = JSON.parse(await run(program, "extract", ...options, "--format", "3dtiles", "-o", join(folder.path, name), "--json"));
}

before(async () => {
  folder = await temporaryFolder();
  const at = (name) => join(folder.path, name);
  await run(program, "make-volume", "bucky", "--size", "193", "-o", at("bucky.h5"), "-q");
  await run(program, "preprocess", at("bucky.h5"), "-o", at("bucky.isonest"), "-q");
  await makeSite("bucky", at("bucky.isonest"), "--iso", "0.5", "--normals");
  await makeSite("several", at("bucky.isonest"), "--iso", "0.3,0.8", "--distance", "0.4");
  fullTriangles = JSON.parse(await run(program, "extract", at("bucky.isonest"), "--iso", "0.5", "--normals", "--up", "y", "-o", at("full.glb"), "--json")).triangles;

  // A ball, a box and a cylinder.
  const n = 97;
  const labels = Buffer.alloc(n * n * n);
  for (let z = 0, i = 0; z < n; ++z) {
    for (let y = 0; y < n; ++y) {
      for (let x = 0; x < n; ++x, ++i) {
        if (Math.hypot(x - 30, y - 48, z - 48) < 24) labels[i] = 3;
        if (Math.abs(x - 74) < 16 && Math.abs(y - 48) < 20 && Math.abs(z - 48) < 24) labels[i] = 250;
        if (Math.hypot(y - 48, z - 12) < 8 && x > 5 && x < 90) labels[i] = 7;
      }
    }
  }
  await writeFile(at("labels.raw"), labels);
  await writeFile(at("names.txt"), kLabels.map(({ label, name, color }) => `${label} ${name} ${color.join(" ")} 255\n`).join(""));
  await run(program, "preprocess", at("labels.raw"), "--dims", "97,97,97", "--type", "uint8", "--labels", "--label-names", at("names.txt"), "-o", at("labels.isonest"), "-q");
  await makeSite("labels", at("labels.isonest"), "--labels", "all", "--smooth");
  await makeSite("globe", at("labels.isonest"), "--labels", "all", "--smooth", "--georeference", "8.5,47.4,400");

  // A snake so long that its octree is in several tilesets.
  const snake = new Float32Array(4200 * 10 * 10);
  for (let z = 0, i = 0; z < 10; ++z) {
    for (let y = 0; y < 10; ++y) for (let x = 0; x < 4200; ++x, ++i) snake[i] = Math.hypot(y - 4.5 - 1.5 * Math.sin(x / 20), z - 4.5);
  }
  await writeFile(at("snake.raw"), snake);
  await makeSite("snake", at("snake.raw"), "--dims", "4200,10,10", "--type", "float32", "--iso", "2");
  await run(program, "extract", at("snake.raw"), "--dims", "4200,10,10", "--type", "float32", "--iso", "2", "--up", "y", "-o", at("snake.glb"), "-q");

  const { build } = web("esbuild");
  await build({ entryPoints: [join(here, "clients/three_page.mjs")], outfile: at("three.js"), bundle: true, format: "esm", nodePaths: [modules], logLevel: "error" });
  await writeFile(at("three.html"), '<!doctype html><meta charset="utf-8"><link rel="icon" href="data:,"><style>body { margin: 0 }</style><script type="module" src="three.js"></script>');
  await symlink(join(modules, "cesium/Build/Cesium"), at("cesium"));
  await build({ entryPoints: [join(here, "clients/cesium_page.mjs")], outfile: at("cesium_page.js"), bundle: true, format: "esm", logLevel: "error" });
  await writeFile(
    at("cesium.html"),
    '<!doctype html><meta charset="utf-8"><link rel="icon" href="data:,"><style>body { margin: 0 } .cesium-widget, canvas { width: 100%; height: 100% }</style>' +
      '<script>window.CESIUM_BASE_URL = "/cesium/"</script><script src="/cesium/Cesium.js"></script><script type="module" src="cesium_page.js"></script>',
  );
  server = await serveFiles(folder.path);
  browser = await startBrowser("--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1");
});
after(async () => {
  await browser?.close();
  await server?.end();
  await folder?.end();
});

const kLabels = [
  { label: 3, name: "Leber", color: [200, 10, 20], seen: [30, 24, 48] },
  { label: 7, name: "Röhre", color: [20, 200, 20], seen: [48, 40, 12] },
  { label: 250, name: "Milz", color: [10, 20, 200], seen: [74, 28, 48] },
];
const linear = (shown) => ((shown / 255 + 0.055) / 1.055) ** 2.4;
const plain = (row) => ({ ...row, label: Number(row.label) });

async function keep(name, url) {
  if (!pictures) return;
  await mkdir(pictures, { recursive: true });
  await writeFile(join(pictures, `${name}.png`), Buffer.from(url.slice(url.indexOf(",") + 1), "base64"));
}

/** A page of a client. `faults`: what must not happen in it. */
async function openClient(path) {
  const page = await (await browser.newContext({ viewport: { width: 1000, height: 800 } })).newPage();
  page.setDefaultTimeout(120_000);
  const faults = [];
  page.on("pageerror", (error) => faults.push(error.message));
  page.on("console", (message) => message.type() === "error" && faults.push(message.text()));
  page.on("request", (request) => !request.url().startsWith(server.url) && !/^(data|blob):/.test(request.url()) && faults.push(request.url()));
  await page.goto(`${server.url}${path}`);
  await page.waitForFunction(() => window.clients);
  return { page, faults, close: () => page.context().close() };
}

/** Cameras that look at a place, nearer and nearer. */
function approach(at, from, distances) {
  const length = Math.hypot(...from);
  return distances.map((distance) => ({ distance, at, from: at.map((x, axis) => x + (from[axis] / length) * distance) }));
}

const finest = ({ levels }) => Math.min(...Object.keys(levels).map(Number));
const say = (what, distance, { tiles, levels, triangles, loaded, worst }) =>
  console.log(`# ${what}, from ${distance}: ${tiles} tiles (${Object.entries(levels).map(([level, count]) => `level ${level}: ${count}`).join(", ")}), ${triangles} triangles, ${loaded} loaded, ${worst.toFixed(2)} pixels`);

/** Asserts that a client at rest shows what it should: within its error target, more the nearer it is. */
function checkSteps(steps, levels, errorTarget) {
  steps.forEach((now, i) => {
    assert.deepEqual(now.failures, []);
    assert.ok(now.tiles > 0 && now.worst <= errorTarget, JSON.stringify(now));
    if (i > 0) assert.ok(finest(now) <= finest(steps[i - 1]) && now.loaded >= steps[i - 1].loaded, JSON.stringify(now));
  });
  assert.equal(steps[0].tiles, 1, "from far away, the root is enough");
  assert.equal(finest(steps[0]), levels - 1);
  assert.equal(finest(steps.at(-1)), 0);
  assert.ok(Math.max(...steps.map(({ triangles }) => triangles)) > 3 * steps[0].triangles);
}

const kBuckyCenter = [96, 96, 96];
const kBuckySteps = approach(kBuckyCenter, [0.5, -0.8, 0.33], [1500, 500, 350, 250, 160, 90]);
const kDistance = 400;
const kLabelStep = { at: [50, 48, 48], from: [50, -110, 48] };

test("every tile is packed as the extension says, and valid for Khronos' validator", async () => {
  const validator = web("gltf-validator");
  // The decoder that takes nothing but what the extension specifies.
  const { MeshoptDecoder } = await import(pathToFileURL(join(modules, "meshoptimizer/meshopt_decoder_reference.js")).href);
  // What the validator says of extensions that it does not know, and of the parts of a file that only these use.
  const known = (head) => {
    const tables = head.extensions?.EXT_structural_metadata.propertyTables ?? [];
    const views = tables.flatMap(({ properties }) => Object.values(properties).flatMap(({ values, stringOffsets }) => [values, stringOffsets]));
    return [
      ...["EXT_meshopt_compression", "EXT_mesh_features", "EXT_structural_metadata"].map((one) => `UNSUPPORTED_EXTENSION Cannot validate an extension as it is not supported by the validator: '${one}'.`),
      ...(head.buffers.length > 1 ? ["UNUSED_OBJECT /buffers/0"] : []),
      ...views.map((view) => `UNUSED_OBJECT /bufferViews/${view}`),
    ];
  };
  const said = async (bytes) => {
    const { issues } = await validator.validateBytes(bytes, { maxIssues: 0 });
    return issues.messages.map(({ severity, code, message, pointer }) => ({ severity, text: `${code} ${code === "UNSUPPORTED_EXTENSION" ? message : pointer}` }));
  };
  let count = 0;
  for (const name of Object.keys(sites)) {
    const counted = {};
    for (const path of await readdir(join(folder.path, name), { recursive: true })) {
      if (!path.endsWith(".glb")) continue;
      ++count;
      const bytes = new Uint8Array(await readFile(join(folder.path, name, path)));
      for (const file of [bytes, unpacked(bytes, MeshoptDecoder)]) {
        const expected = known(headOf(file));
        for (const { severity, text } of await said(file)) {
          assert.ok(severity >= 2 && expected.includes(text), `${name}/${path}${file === bytes ? "" : ", unpacked"}: ${severity} ${text}`);
          const short = text.replace(/\d+$/, "N").replace(/ Cannot.*: /, " ");
          counted[short] = (counted[short] ?? 0) + 1;
        }
      }
    }
    console.log(`# ${name}: ${JSON.stringify(counted)}`);
  }
  console.log(`# ${count} tiles`);
  assert.equal(count, Object.values(sites).reduce((sum, { tileset }) => tileset.levels.reduce((all, { tiles }) => all + tiles, sum), 0));
});

const headOf = (glb) => JSON.parse(Buffer.from(glb).toString("utf8", 20, 20 + Buffer.from(glb).readUInt32LE(12)));

/** A tile without EXT_meshopt_compression, so that the validator sees its vertices and indices. */
function unpacked(glb, decoder) {
  const file = Buffer.from(glb);
  const head = headOf(glb);
  const body = file.subarray(28 + file.readUInt32LE(12));
  const parts = [];
  let at = 0;
  for (const view of head.bufferViews) {
    const packed = view.extensions?.EXT_meshopt_compression;
    const bytes = new Uint8Array(Math.ceil(view.byteLength / 8) * 8);
    if (packed) {
      const source = body.subarray(packed.byteOffset, packed.byteOffset + packed.byteLength);
      decoder.decodeGltfBuffer(bytes.subarray(0, packed.count * packed.byteStride), packed.count, packed.byteStride, source, packed.mode, packed.filter);
      delete view.extensions;
    } else {
      bytes.set(body.subarray(view.byteOffset, view.byteOffset + view.byteLength));
    }
    [view.buffer, view.byteOffset] = [0, at];
    at += bytes.length;
    parts.push(bytes);
  }
  head.buffers = [{ byteLength: at }];
  for (const list of ["extensionsUsed", "extensionsRequired"]) head[list] = head[list].filter((name) => name !== "EXT_meshopt_compression");
  let json = JSON.stringify(head);
  json += " ".repeat((8 - ((Buffer.byteLength(json) + 28) % 8)) % 8);
  const start = Buffer.alloc(20);
  start.write("glTF");
  const size = Buffer.byteLength(json);
  [2, 28 + size + at, size].forEach((number, i) => start.writeUInt32LE(number, 4 + 4 * i));
  start.write("JSON", 16);
  const middle = Buffer.alloc(8);
  middle.writeUInt32LE(at);
  middle.write("BIN\0", 4);
  return new Uint8Array(Buffer.concat([start, Buffer.from(json), middle, ...parts]));
}

/** Opens a tileset in a page of 3d-tiles-renderer, and a mesh for comparison. */
const openThree = (page, name, full) =>
  page.evaluate(async ([url, mesh]) => {
    const view = (window.clients.view = new window.clients.View(url));
    return mesh ? view.addFull(mesh) : 0;
  }, [`${server.url}${name}/tileset.json`, full && `${server.url}${full}`]);

async function stepThree(page, { from, at }) {
  return page.evaluate(async ([eye, place]) => {
    const { view } = window.clients;
    view.look(eye, place);
    await view.rest();
    return view.counts();
  }, [from, at]);
}

/** Asserts that the picture of the tiles is the full mesh's, within a pixel, and in depth, which changes fast at edges. */
async function checkPicture(page, what, { distance }, { geometricError }) {
  const pixel = (distance * 2 * Math.tan((25 * Math.PI) / 180)) / 360;
  const compared = await page.evaluate((tolerance) => window.clients.view.compare(tolerance), geometricError + 3 * pixel);
  console.log(`# ${what}: ${JSON.stringify(compared)}`);
  assert.ok(compared.full.covered > 50);
  for (const { uncovered, elsewhere } of [compared.full, compared.tiles]) assert.deepEqual([uncovered, elsewhere], [0, 0], what);
}

test("3d-tiles-renderer: tiles refine as the camera nears, and nothing is missing", async () => {
  const { page, faults, close } = await openClient("three.html");
  assert.equal(await openThree(page, "bucky", "full.glb"), fullTriangles);
  const steps = [];
  for (const step of kBuckySteps) {
    const began = Date.now();
    const now = await stepThree(page, step);
    say(`3d-tiles-renderer, ${Date.now() - began} ms`, step.distance, now);
    await checkPicture(page, `from ${step.distance}`, step, now);
    for (const how of ["tiles", "levels", "full"]) await keep(`three-bucky-${step.distance}-${how}`, await page.evaluate((way) => window.clients.view.draw(way), how));
    steps.push(now);
  }
  checkSteps(steps, sites.bucky.tileset.levels.length, 1);
  const without = await page.evaluate(() => window.clients.view.compareWithoutOne());
  assert.ok(without.full.uncovered + without.full.elsewhere > 1000, `a hidden tile is missed: ${JSON.stringify(without)}`);
  assert.deepEqual(faults, []);
  await close();
});

test("3d-tiles-renderer: features have their labels, names and colours", async () => {
  const { page, faults, close } = await openClient("three.html");
  await openThree(page, "labels");
  const counts = await stepThree(page, kLabelStep);
  say("3d-tiles-renderer, labels", 158, counts);
  assert.ok(counts.tiles > 1);
  await keep("three-labels", await page.evaluate(() => window.clients.view.draw()));
  for (const { label, name, color, seen } of kLabels) {
    const found = await page.evaluate((place) => window.clients.view.pick(place), seen);
    assert.deepEqual(found.data, { label, name });
    found.color.forEach((value, i) => assert.ok(Math.abs(value - linear(color[i])) < 1e-3, `${found.color}`));
    assert.ok(Math.hypot(...found.at.map((x, axis) => x - seen[axis])) < 2, `${found.at}`);
  }
  await openThree(page, "several");
  say("3d-tiles-renderer, isovalues", kDistance, await stepThree(page, approach(kBuckyCenter, [0.5, -0.8, 0.33], [kDistance])[0]));
  const values = await page.evaluate(() => window.clients.view.features().map(({ isovalue }) => isovalue));
  assert.deepEqual([...new Set(values)].sort(), [0.3, 0.8]);
  await keep("three-isovalues", await page.evaluate(() => window.clients.view.draw()));
  assert.deepEqual(faults, []);
  await close();
});

const kSnakeSteps = approach([2100, 4.5, 4.5], [0.1, -1, 0.3], [30_000, 5000, 1500, 400, 100]);

test("3d-tiles-renderer: an octree in several tilesets", async () => {
  const { page, faults, close } = await openClient("three.html");
  await openThree(page, "snake", "snake.glb");
  const steps = [];
  for (const step of kSnakeSteps) {
    const now = await stepThree(page, step);
    say("3d-tiles-renderer, snake", step.distance, now);
    // From further away it is thinner than a pixel.
    if (step.distance <= 1500) await checkPicture(page, `snake, from ${step.distance}`, step, now);
    steps.push(now);
  }
  await keep("three-snake-levels", await page.evaluate(() => window.clients.view.draw("levels")));
  checkSteps(steps, sites.snake.tileset.levels.length, 1);
  assert.deepEqual(faults, []);
  await close();
});

async function stepCesium(page, { from, at, up }) {
  return page.evaluate(async ([eye, place, upwards]) => {
    const { view } = window.clients;
    view.look(eye, place, upwards);
    await view.rest();
    return view.counts();
  }, [from, at, up]);
}

const openCesium = (page, name) =>
  page.evaluate((url) => {
    window.clients.view = new window.clients.View();
    return window.clients.view.open(url);
  }, `${server.url}${name}/tileset.json`);

test("Cesium: tiles refine as the camera nears, and nothing is missing", async () => {
  const { page, faults, close } = await openClient("cesium.html");
  await openCesium(page, "bucky");
  await page.evaluate((url) => window.clients.view.addFull(url), `${server.url}full.glb`);
  const steps = [];
  for (const step of kBuckySteps) {
    const began = Date.now();
    const now = await stepCesium(page, step);
    say(`Cesium, ${Date.now() - began} ms`, step.distance, now);
    await keep(`cesium-bucky-${step.distance}`, await page.evaluate(() => window.clients.view.draw()));
    const compared = await page.evaluate(() => window.clients.view.compare());
    console.log(`# from ${step.distance}: ${JSON.stringify(compared)}`);
    assert.ok(compared.full.covered > 50);
    assert.deepEqual([compared.full.uncovered, compared.tiles.uncovered], [0, 0]);
    steps.push(now);
  }
  checkSteps(steps, sites.bucky.tileset.levels.length, 1);
  assert.deepEqual(faults, []);
  await close();
});

test("Cesium: an octree in several tilesets, and isovalues", async () => {
  const { page, faults, close } = await openClient("cesium.html");
  await openCesium(page, "snake");
  const steps = [];
  for (const step of kSnakeSteps) {
    steps.push(await stepCesium(page, step));
    say("Cesium, snake", step.distance, steps.at(-1));
  }
  checkSteps(steps, sites.snake.tileset.levels.length, 1);
  await openCesium(page, "several");
  say("Cesium, isovalues", kDistance, await stepCesium(page, approach(kBuckyCenter, [0.5, -0.8, 0.33], [kDistance])[0]));
  const values = await page.evaluate(() => window.clients.view.features().map(({ isovalue }) => isovalue));
  assert.deepEqual([...new Set(values)].sort(), [0.3, 0.8]);
  assert.deepEqual(faults, []);
  await close();
});

test("Cesium: features have their labels and names, on a globe too", async () => {
  const { page, faults, close } = await openClient("cesium.html");
  const check = async (what, world, up) => {
    const counts = await stepCesium(page, { at: world(kLabelStep.at), from: world(kLabelStep.from), up });
    say(`Cesium, ${what}`, 158, counts);
    assert.ok(counts.tiles > 1 && counts.features >= 3);
    assert.deepEqual(counts.failures, []);
    await keep(`cesium-${what}`, await page.evaluate(() => window.clients.view.draw()));
    for (const { label, name, seen } of kLabels) {
      const found = await page.evaluate((place) => window.clients.view.pick(place), world(seen));
      assert.deepEqual(found && plain(found.data), { label, name }, what);
    }
  };
  await openCesium(page, "labels");
  await check("labels", (at) => at, [0, 0, 1]);
  const { place } = await openCesium(page, "globe");
  // Its centre is 100 m at most from the origin.
  assert.ok(Math.abs(place[0] - 8.5) < 1e-3 && Math.abs(place[1] - 47.4) < 1e-3 && Math.abs(place[2] - 448) < 20, `${place}`);
  const [longitude, latitude] = [8.5, 47.4].map((degrees) => (degrees * Math.PI) / 180);
  const [cosLon, sinLon, cosLat, sinLat] = [Math.cos(longitude), Math.sin(longitude), Math.cos(latitude), Math.sin(latitude)];
  const normal = 6378137 / Math.sqrt(1 - 0.0066943799901413165 * sinLat ** 2); // WGS 84
  const origin = [(normal + 400) * cosLat * cosLon, (normal + 400) * cosLat * sinLon, (normal * (1 - 0.0066943799901413165) + 400) * sinLat];
  const up = [cosLat * cosLon, cosLat * sinLon, sinLat];
  const [east, north] = [[-sinLon, cosLon, 0], [-sinLat * cosLon, -sinLat * sinLon, cosLat]];
  await check("globe", ([x, y, z]) => origin.map((base, i) => base + x * east[i] + y * north[i] + z * up[i]), up);
  assert.deepEqual(faults, []);
  await close();
});
