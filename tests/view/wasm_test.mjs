// Tests the queries of a page without a server in Node: isonest.wasm gives the answers of `isonest view`, stays within
// its memory budget, and reports invalid stores. usage: wasm_test.mjs ISONEST FOLDER-WITH-isonest.wasm
// Exit code 77 with a message: isonest.wasm was not built.
import assert from "node:assert/strict";
import { existsSync } from "node:fs";
import { readdir, readFile, stat, writeFile } from "node:fs/promises";
import { dirname, join, resolve } from "node:path";
import { after, before, test } from "node:test";
import { fileURLToPath, pathToFileURL } from "node:url";
import { run, startServer, temporaryFolder } from "../../tools/view/web/drive.mjs";
import { wasmStores } from "./wasm_stores.mjs";

const [, , program, wasmFolder] = process.argv;
const here = dirname(fileURLToPath(import.meta.url));
if (!wasmFolder || !existsSync(join(wasmFolder, "isonest.wasm"))) {
  console.log("skipped: isonest.wasm was not built: it needs emscripten and node-acorn (tools/install-deps --wasm)");
  process.exit(77);
}

const MB = 2 ** 20;
const kMemory = 256 * MB; // the budget of a page
let folder, open, bytesOf, servers;

/** A mesh's header, without times and counts of reading, and its bytes; for other answers, the JSON. */
function parsed(answer) {
  const bytes = Buffer.from(answer.body);
  if (answer.type !== "application/octet-stream") {
    const said = JSON.parse(bytes.toString());
    // These depend on the memory budget, and on whether the store is a file.
    for (const name of ["most_triangles", "memory", "first_error", "remote"]) delete said[name];
    return { status: answer.status, said, text: bytes.toString() };
  }
  const size = bytes.readUInt32LE(8);
  const header = JSON.parse(bytes.subarray(16, 16 + size).toString());
  delete header.seconds;
  delete header.chunks_read;
  delete header.bytes_read;
  return { status: answer.status, header, sections: bytes.subarray(16 + size) };
}

async function fromServer(server, target) {
  const response = await fetch(new URL(`api/${target}`, server.url));
  const type = response.headers.get("content-type").split(";")[0];
  return { status: response.status, type, body: await response.arrayBuffer() };
}

/** Asserts that the answers of isonest.wasm and the server are equal; returns the header of a mesh. */
async function same(server, store, target) {
  const [theirs, ours] = [parsed(await fromServer(server, target)), parsed(await store.ask(`/api/${target}`))];
  assert.deepEqual(ours.header, theirs.header, target);
  assert.deepEqual(ours.said, theirs.said, target);
  assert.equal(ours.status, theirs.status, `${target}: ${ours.text}`);
  if (ours.sections) assert.ok(ours.sections.equals(theirs.sections), `${target}: other bytes`);
  return ours.header ?? ours.text;
}

async function madeStore(name, volume, ...options) {
  const store = join(folder.path, `${name}.isonest`);
  await run(program, "preprocess", volume, ...options, "-o", store, "-q");
  const server = await startServer(program, store, "--port", "0");
  servers.push(server);
  return { store, server };
}

let bucky, labels, plane;
before(async () => {
  folder = await temporaryFolder();
  servers = [];
  ({ open, bytesOf } = await wasmStores(wasmFolder, folder.path));
  const volume = (name, ...options) => run(program, "make-volume", ...options, "-o", join(folder.path, name), "-q").then(() => join(folder.path, name));
  bucky = await madeStore("bucky", await volume("bucky.h5", "bucky", "--size", "65"), "--unit", "um");
  plane = await madeStore("plane", await volume("plane.h5", "cahn-hilliard", "--size", "129,97"));
  const raw = Buffer.alloc(40 * 36 * 33);
  for (let z = 0; z < 33; ++z) for (let y = 0; y < 36; ++y) for (let x = 0; x < 40; ++x) raw[(z * 36 + y) * 40 + x] = Math.hypot(x - 19, y - 17, z - 15) < 12 ? 3 : x > 30 ? 7 : 0;
  await writeFile(join(folder.path, "labels.raw"), raw);
  labels = await madeStore("labels", join(folder.path, "labels.raw"), "--dims", "40,36,33", "--type", "uint8", "--labels");
});
after(async () => {
  for (const server of servers ?? []) await server.end();
  await folder?.end();
});

test("meshes of a volume are those of the server", async () => {
  const store = await open(bucky.store, kMemory);
  const { min_value: low, max_value: high, box } = JSON.parse(new TextDecoder().decode((await store.ask("/api/store")).body));
  const iso = low + 0.45 * (high - low);
  const part = box.map((x, i) => (i < 3 ? x + 10 : x - 20)).join(",");
  const full = await same(bucky.server, store, `surface?iso=${iso}&error=0`);
  assert.ok(full.triangles > 1000 && full.full_resolution);
  const coarse = await same(bucky.server, store, `surface?iso=${iso}&error=${0.05 * (high - low)}&stream=a`);
  assert.ok(coarse.triangles > 100 && coarse.triangles < full.triangles);
  await same(bucky.server, store, `surface?iso=${iso}&error=${0.01 * (high - low)}&box=${part}`);
  await same(bucky.server, store, `surface?iso=${iso}&error=0&components=largest`);
  await same(bucky.server, store, `surface?iso=${iso}&camera=${box[3] * 2},${box[4]},${box[5]},40,600,4`);
  const near = await same(bucky.server, store, `surface?iso=${iso}&distance=1.5&effort=fast`);
  assert.ok(near.distance_bound <= 1.5 && near.triangles < full.triangles / 2);
  await same(bucky.server, store, `surface?iso=${iso}&distance=0.7&box=${part}`);
  await same(bucky.server, store, `slice?plane=0,0,1,${(box[2] + box[5]) / 2}&error=0`);
  await same(bucky.server, store, `slice?plane=1,2,3,${box[3] * 2.5}&error=${0.05 * (high - low)}`);
});

test("the description of a volume is the server's", async () => {
  const store = await open(bucky.store, kMemory);
  for (const target of ["store", "histogram", "value?at=20,21.5,30.25", "value?at=-1,0,0", "label?id=4", "surface?error=0", "surface?iso=1&nothing=2", "value", "nowhere"]) {
    await same(bucky.server, store, target);
  }
  for (const target of ["export?iso=1", "command?iso=1"]) {
    assert.equal((await store.ask(`/api/${target}`)).status, 501, target);
  }
  assert.equal((await store.ask("/api/status")).status, 200);
});

test("labels, and data in a plane", async () => {
  const ofLabels = await open(labels.store, kMemory);
  await same(labels.server, ofLabels, "store");
  assert.deepEqual(JSON.parse(await same(labels.server, ofLabels, "labels")).labels.map(({ id }) => id), [0, 3, 7]);
  await same(labels.server, ofLabels, "labels?named=1");
  assert.ok((await same(labels.server, ofLabels, "surface?label=3&error=0")).triangles > 500);
  assert.ok((await same(labels.server, ofLabels, "surface?label=3&smooth=8&error=0")).smooth_bound > 0);
  await same(labels.server, ofLabels, "surface?label=7&distance=1&effort=fast");
  await same(labels.server, ofLabels, "value?at=19,17,15");
  await same(labels.server, ofLabels, "slice?plane=0,0,1,15&error=0");
  const ofPlane = await open(plane.store, kMemory);
  await same(plane.server, ofPlane, "store");
  await same(plane.server, ofPlane, "slice?plane=0,0,1,0&error=0.05");
  await same(plane.server, ofPlane, "surface?iso=0&error=0"); // refused with the same message
});

test("one library turns from one store to another, and keeps those that were used last", async () => {
  const store = await open(bucky.store, kMemory);
  const others = Array.from({ length: 12 }, (_one, i) => ({ server: [labels, plane][i % 2].server, bytes: bytesOf([labels, plane][i % 2].store, `copy ${i}`) }));
  const target = ["surface?label=3&error=0", "slice?plane=0,0,1,0&error=0"];
  const visit = async ({ server, bytes }, i) => {
    await store.turnTo(bytes);
    await same(server, store, target[i % 2]);
  };
  for (const [i, other] of others.entries()) await visit(other, i);
  const before = others.map(({ bytes }) => bytes.fetched);
  await visit(others[11], 11);
  await visit(others[9], 9);
  assert.deepEqual(others.map(({ bytes }) => bytes.fetched), before, "a store that was open was read again");
  await visit(others[0], 0); // was closed
  assert.ok(others[0].bytes.fetched > before[0]);
  // What cannot be opened is said, and the other stores are still there.
  await assert.rejects(store.turnTo(bytesOf(join(folder.path, "labels.raw"), "no store")), /not a store|footer|HDF5/);
  await visit(others[11], 11);
});

test("ranges are fetched together, and a query ends with any memory budget", async () => {
  const iso = 0.5;
  const few = await open(bucky.store, kMemory, { roundTrip: 1e9 }); // running again is always cheaper
  const first = parsed(await few.ask(`/api/surface?iso=${iso}&error=0`));
  const trips = few.counts.trips;
  assert.ok(trips < 12, `${trips} round trips`);
  assert.deepEqual(parsed(await few.ask(`/api/surface?iso=${iso}&error=0`)), first);
  assert.equal(few.counts.trips, trips, "what was fetched is kept");
  const none = await open(bucky.store, kMemory, { roundTrip: 0 }); // running again is never cheaper
  assert.deepEqual(parsed(await none.ask(`/api/surface?iso=${iso}&error=0`)), first);
  assert.ok(none.counts.runs <= 3);
  const little = await open(bucky.store, 128 * MB, { roundTrip: 1e9 });
  assert.deepEqual(parsed(await little.ask(`/api/surface?iso=${iso}&error=0`)).sections, first.sections);
  assert.ok(little.memory.buffer.byteLength <= 128 * MB);
});

test("too little memory gives an error answer", async () => {
  const store = await open(bucky.store, 33 * MB);
  const answer = parsed(await store.ask("/api/surface?iso=0.5&error=0"));
  assert.ok(answer.status === 413 || answer.status === 200, answer.text);
  assert.ok(store.memory.buffer.byteLength <= 33 * MB);
});

test("failed fetches and a changed object are errors; the next request is answered", async () => {
  const store = await open(bucky.store, kMemory, { roundTrip: 0 });
  store.fail = "x.isonest: was replaced since it was opened";
  const answer = parsed(await store.ask("/api/surface?iso=0.5&error=0"));
  assert.equal(answer.status, 500);
  assert.match(answer.text, /was replaced/);
  store.fail = null;
  assert.equal((await store.ask("/api/surface?iso=0.5&error=0")).status, 200);
});

test("invalid and incomplete stores give messages", async () => {
  const golden = resolve(here, "../store/golden");
  let refused = 0;
  for (const name of await readdir(golden)) {
    if (!name.endsWith(".store")) continue;
    try {
      const store = await open(join(golden, name), kMemory);
      await store.ask("/api/surface?iso=0.5&error=0");
      await store.ask("/api/histogram");
    } catch (error) {
      assert.ok(!(error instanceof WebAssembly.RuntimeError), `${name}: ${error.stack}`);
      assert.ok(error.message.length > 20 && !/internal/.test(error.message), `${name}: ${error.message}`);
      ++refused;
    }
  }
  assert.ok(refused > 20);
  assert.equal((await (await open(join(golden, "2.9.store"), kMemory)).ask("/api/histogram")).status, 200);
  const bytes = await readFile(bucky.store);
  const hostile = join(folder.path, "hostile.isonest");
  let seed = 7;
  const random = (most) => (seed = (seed * 1103515245 + 12345) % 2 ** 31) % most;
  let [whole, answered] = [0, 0];
  for (let round = 0; round < 150; ++round) {
    const bad = Buffer.from(bytes);
    const from = round % 2 ? bad.length - 4000 : 0;
    for (let k = 0; k < 1 + (round % 5); ++k) bad[from + random(bad.length - from)] ^= 1 << random(8);
    await writeFile(hostile, round % 11 === 3 ? bad.subarray(0, random(bad.length)) : bad);
    try {
      const store = await open(hostile, kMemory);
      for (const target of ["surface?iso=0.5&error=0.02", "histogram", "value?at=20,20,20"]) {
        const answer = parsed(await store.ask(`/api/${target}`));
        assert.ok(answer.status === 200 || /"kind":"corrupt"/.test(answer.text), answer.text);
        answer.status === 200 ? ++whole : ++answered;
      }
    } catch (error) {
      assert.ok(!(error instanceof WebAssembly.RuntimeError) && error.message, `round ${round}: ${error.stack}`);
    }
  }
  assert.ok(whole > 5 && answered > 5, `${whole} and ${answered}`);
});
