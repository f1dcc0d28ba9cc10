// Tests sites written by `isonest publish` in Chromium, from a plain file server. usage: publish_test.mjs ISONEST
//
// The meshes shown by the page are compared byte by byte with the answers of `isonest view`.
// Exit code 77 with a message: no browser is available, or the program cannot write sites.
import assert from "node:assert/strict";
import { readFile, writeFile } from "node:fs/promises";
import { dirname, join } from "node:path";
import { after, before, test as anyTest } from "node:test";
import { fileURLToPath } from "node:url";
import { idle, lacks, openPage, run, startBrowser, startServer, temporaryFolder } from "../../tools/view/web/drive.mjs";
import { kShared, serveFiles } from "./static_server.mjs";
import { wander } from "./wander.mjs";

const [, , program] = process.argv;
const reason = lacks() ?? (/only\s+checks\s+servers/.test(await run(program, "publish", "--help")) ? "the program was built without emscripten" : null);
if (reason) {
  console.log(`skipped: ${reason}`);
  process.exit(77);
}

const kBudget = 256 * 2 ** 20;
const kWander = Number(process.env.ISONEST_VIEW_SECONDS ?? 5);
/** A large store for the random input, in place of the test's own. */
const kLarge = process.env.ISONEST_PUBLISHED_STORE;
const kTimeout = 240_000;
const test = (name, body, timeout = kTimeout) => anyTest(name, { timeout }, body);
let folder, store, labels, view, site, browser;

/** Publishes a site and serves it. */
async function publish(name, stores, options = [], how = {}) {
  const path = join(folder.path, name);
  await run(program, "publish", ...stores, "-o", path, "--force", ...options);
  return serveFiles(path, how);
}

before(async () => {
  folder = await temporaryFolder();
  store = join(folder.path, "bucky.isonest");
  labels = join(folder.path, "ball.isonest");
  const volume = join(folder.path, "v.h5");
  await run(program, "make-volume", "bucky", "--size", "65", "-o", volume);
  await run(program, "preprocess", volume, "--unit", "um", "-o", store);
  await run(program, "make-volume", "sphere", "--size", "33", "--type", "uint8", "-o", volume, "--force");
  await run(program, "preprocess", volume, "-o", labels);
  view = await startServer(program, store, "--port", "0");
  site = await publish("site", [store], ["--title", "A bucky ball", "--license", "CC0"]);
  browser = await startBrowser("--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1");
});
after(async () => {
  await browser?.close();
  await site?.end();
  await view?.end();
  await folder?.end();
  setTimeout(() => process.exit(process.exitCode ?? 1), 10_000).unref();
});

const header = (page) => page.evaluate(() => window.isonest.header());
/** Waits until the page shows its store. */
async function ready(page) {
  await page.waitForFunction(() => window.isonest || document.querySelector("#banner:not([hidden])"), undefined, { timeout: 120_000 });
  if (!(await page.evaluate(() => Boolean(window.isonest)))) throw new Error(`the page says: ${await banner(page)}`);
  await idle(page);
}
const banner = (page) => page.$eval("#banner", (element) => element.textContent);
async function setIso(page, value) {
  await page.$eval("#iso", (input, text) => {
    input.value = text;
    input.dispatchEvent(new Event("input", { bubbles: true }));
  }, String(value));
}

/** Collects violations of the content security policy. */
async function watchPolicy(context) {
  await context.addInitScript(() => {
    window.violations = [];
    document.addEventListener("securitypolicyviolation", (event) => window.violations.push(`${event.violatedDirective} ${event.blockedURI}`));
  });
}

/** The answers of the worker and of the server of `isonest view` to a request, without times and counts. */
async function answers(page, target) {
  const mine = await page.evaluate(async ({ wanted, memory }) => {
    const { stores } = await (await fetch("site.json")).json();
    const worker = new Worker("worker.js");
    const got = await new Promise((resolve) => {
      worker.onmessage = ({ data }) => {
        if (data.kind === "failed") resolve({ status: 0, bytes: [], message: data.message });
        if (data.kind === "answer") resolve({ status: data.status, bytes: [...new Uint8Array(data.body)] });
      };
      worker.postMessage({ kind: "open", url: new URL(stores[0].url, document.baseURI).href, memory });
      worker.postMessage({ kind: "request", id: 1, target: wanted });
    });
    worker.terminate();
    return got;
  }, { wanted: target, memory: kBudget });
  const response = await fetch(new URL(`api/${target}`, view.url));
  return [{ status: mine.status, bytes: Buffer.from(mine.bytes), message: mine.message }, { status: response.status, bytes: Buffer.from(await response.arrayBuffer()) }];
}
/** A message's header, without measured values, and its sections. */
function partsOf(bytes) {
  assert.equal(bytes.toString("latin1", 0, 4), "ISOV");
  const length = bytes.readUInt32LE(8);
  const { seconds: _a, chunks_read: _b, bytes_read: _c, ...told } = JSON.parse(bytes.toString("utf8", 16, 16 + length));
  return [told, bytes.subarray(16 + length)];
}

test("every mesh has the bytes that isonest view sends", async () => {
  const { page, faults, close } = await openPage(browser, site.url);
  await ready(page);
  for (const target of [
    "surface?iso=0.5&error=0", "surface?iso=0.7&error=0.05", "surface?iso=0.5&camera=200,32,32,30,600,2&limit=100000", "surface?iso=0.5&distance=0.5&effort=fast",
    "surface?iso=0.5&error=0&box=10,10,10,40,40,40", "surface?iso=0.5&error=0&components=largest", "slice?plane=0,0,1,32&error=0", "slice?plane=1,1,1,90&error=0.01",
  ]) {
    const [mine, theirs] = await answers(page, target);
    assert.equal(mine.status, 200, `${target}: ${mine.message ?? mine.bytes}`);
    const [told, body] = partsOf(mine.bytes);
    const [expected, right] = partsOf(theirs.bytes);
    assert.deepEqual(told, expected, target);
    assert.ok(body.equals(right), `${target}: other bytes`);
    assert.ok(told.triangles > 0);
  }
  for (const target of ["histogram", "value?at=32,20,20", "value?at=-1,0,0"]) {
    const [mine, theirs] = await answers(page, target);
    assert.deepEqual(JSON.parse(mine.bytes), JSON.parse(theirs.bytes), target);
  }
  for (const target of ["surface?iso=nothing", "surface?error=0", "what"]) {
    const [mine, theirs] = await answers(page, target);
    assert.equal(mine.status, theirs.status, target);
  }
  assert.deepEqual(faults, []);
  await close();
});

test("the page shows what isonest view shows, contacts only its own server, and complies with its policy", async () => {
  const fragment = "#iso=0.5&target=error&error=0.05&slice-z=1,20";
  const theirs = await openPage(browser, view.url + fragment);
  await idle(theirs.page);
  const context = await browser.newContext();
  await watchPolicy(context);
  const page = await context.newPage();
  const elsewhere = [];
  context.on("request", (request) => request.url().startsWith(site.url) || /^(data|blob):/.test(request.url()) || elsewhere.push(request.url()));
  await page.goto(site.url + fragment);
  await ready(page);
  const strip = ({ seconds: _a, chunks_read: _b, bytes_read: _c, ...rest }) => rest;
  assert.deepEqual(strip(await header(page)), strip(await header(theirs.page)));
  // A slice keeps the resolution of its first mesh if that is fine enough, and that depends on earlier requests.
  const [slice, other] = [await page.evaluate(() => window.isonest.header("z")), await theirs.page.evaluate(() => window.isonest.header("z"))];
  assert.deepEqual([slice.origin, slice.step, slice.value_origin, slice.value_step], [other.origin, other.step, other.value_origin, other.value_step]);
  for (const { error_bound: bound, triangles } of [slice, other]) assert.ok(bound <= 0.003 && triangles > 1000, `${bound}, ${triangles}`);
  await setIso(page, 0.7);
  await idle(page);
  await page.waitForFunction(() => location.hash.includes("iso=0.7"));
  const again = await context.newPage();
  await again.goto(page.url());
  await ready(again);
  assert.deepEqual(strip(await header(again)), strip(await header(page)));
  assert.equal(await page.title(), "A bucky ball – isonest");
  assert.deepEqual([await page.evaluate(() => window.violations), elsewhere, theirs.faults], [[], [], []]);
  assert.ok(site.requests.some(({ path, range }) => path.includes("stores/bucky.isonest") && range));
  assert.ok(site.requests.filter(({ path }) => path.includes("stores/")).every(({ range, method }) => range || method === "HEAD"), "the store was asked for whole");
  await context.close();
  await theirs.close();
});

test("the policy blocks all other requests", async () => {
  const other = await serveFiles(folder.path, { headers: kShared });
  const context = await browser.newContext();
  await watchPolicy(context);
  const page = await context.newPage();
  await page.goto(site.url);
  await ready(page);
  assert.equal(await page.evaluate((url) => fetch(url).then(() => "came", () => "refused"), other.url), "refused");
  assert.ok((await page.evaluate(() => window.violations)).some((text) => text.startsWith("connect-src")));
  assert.deepEqual(other.requests, []);
  await context.close();
  await other.end();
});

test("a link chooses one of several stores", async () => {
  const several = await publish("several", [store, labels], ["--title", "Bucky", "--title", "Ball"]);
  const context = await browser.newContext();
  const page = await context.newPage();
  await page.goto(several.url);
  await page.waitForSelector("#stores");
  assert.match(await page.$eval("#stores", (list) => list.textContent), /Bucky.*65 × 65 × 65 float32, um.*Ball.*33 × 33 × 33 uint8/s);
  assert.ok(several.requests.every(({ path }) => !path.includes("stores/")), "no store is opened for a list");
  await page.click("text=Ball");
  await ready(page);
  assert.ok((await header(page)).triangles > 0);
  assert.ok(several.requests.every(({ path }) => !path.includes("bucky")));
  await context.close();
  await several.end();
});

test("a store on another server is shown if CORS permits; otherwise the page explains the problem", async () => {
  const data = await serveFiles(folder.path, { headers: kShared });
  const linked = await publish("linked", [store], ["--link", data.url]);
  const opened = await browser.newContext();
  await watchPolicy(opened);
  const page = await opened.newPage();
  await page.goto(`${linked.url}#iso=0.5&target=error&error=0.05`);
  await ready(page);
  assert.ok((await header(page)).triangles > 0);
  assert.ok(data.requests.length > 0 && data.requests.every(({ path }) => path === "/bucky.isonest"));
  assert.deepEqual(await page.evaluate(() => window.violations), []);
  await opened.close();
  await linked.end();
  await data.end();
  for (const [how, told] of [
    [{ headers: {} }, /Access-Control|CORS|other (server|pages|origin)|--check/i],
    [{ headers: kShared, ranges: false }, /range|part/i],
  ]) {
    const wrong = await serveFiles(folder.path, how);
    const its = await publish("wrong", [store], ["--link", wrong.url]);
    const context = await browser.newContext();
    const lost = await context.newPage();
    await lost.goto(its.url);
    await lost.waitForSelector("#banner:not([hidden])");
    assert.match(await banner(lost), told);
    await context.close();
    await its.end();
    await wrong.end();
  }
});

test("requests to a busy server are repeated after the time it names, a limited number of times", async () => {
  let left = 0;
  let wait = null;
  let status = 503;
  const times = [];
  const busy = await publish("busy", [store], [], {
    handle: (request, response) => {
      if (!request.url.includes("stores/") || left === 0) return false;
      left -= 1;
      times.push(Date.now());
      response.writeHead(status, wait === null ? {} : { "Retry-After": wait }).end();
      return true;
    },
  });
  const open = async (count, how, after) => {
    [left, status, wait] = [count, how, after];
    times.length = 0;
    const context = await browser.newContext();
    const page = await context.newPage();
    await page.goto(`${busy.url}#iso=0.5&target=error&error=0.05`);
    return { context, page };
  };
  for (const [count, how, after] of [[2, 503, "1"], [3, 429, null], [1, 502, new Date(Date.now() + 1000).toUTCString()]]) {
    const { context, page } = await open(count, how, after);
    await ready(page);
    assert.ok((await header(page)).triangles > 0);
    assert.equal(await page.evaluate(() => window.isonest.banner()), null);
    assert.equal(left, 0);
    for (let i = 1; i < count && count === 2; ++i) assert.ok(times[i] - times[i - 1] >= 990, `asked again after ${times[i] - times[i - 1]} ms`);
    // The same for range requests while the page is open.
    [left, status, wait] = [3, 503, null];
    await setIso(page, 0.61);
    await idle(page);
    assert.equal(await page.evaluate(() => window.isonest.banner()), null);
    await context.close();
  }
  for (const [after, told, most] of [["3600", /answers 503, and asks to wait: 3600/, 1], [null, /answers 503 \(asked 6 times\)/, 6]]) {
    const { context, page } = await open(1000, 503, after);
    await page.waitForSelector("#banner:not([hidden])", { timeout: 60_000 });
    assert.match(await banner(page), told);
    assert.equal(times.length, most);
    left = 0;
    await context.close();
  }
  await busy.end();
});

test("closing the tab cancels its requests", async () => {
  const slow = await publish("slow", [store], [], { rate: 20_000 });
  const context = await browser.newContext();
  const page = await context.newPage();
  await page.goto(slow.url, { waitUntil: "commit" }).catch(() => undefined);
  while (!slow.requests.some(({ path }) => path.includes("main.js"))) await new Promise((resolve) => setTimeout(resolve, 50));
  await context.close();
  await new Promise((resolve) => setTimeout(resolve, 500));
  const { length } = slow.requests;
  await new Promise((resolve) => setTimeout(resolve, 1500));
  assert.equal(slow.requests.length, length);
  assert.ok(slow.requests.some(({ aborted }) => aborted));
  await slow.end();
});

test("invalid, damaged and truncated stores give a message", async () => {
  const its = await publish("hostile", [store]);
  const file = join(folder.path, "hostile", "stores", "bucky.isonest");
  const whole = await readFile(file);
  const golden = join(dirname(fileURLToPath(import.meta.url)), "../store/golden");
  const bad = ["catalogue-damaged", "catalogue-lacks", "cut", "damaged-chunk", "footer-cut", "footer-damaged"];
  const cases = [["empty", Buffer.alloc(0)], ["zeros", Buffer.alloc(100_000)], ["cut", whole.subarray(0, whole.length / 2)]];
  for (const name of bad) cases.push([name, await readFile(join(golden, `2.9-${name}.store`))]);
  const flipped = Buffer.from(whole);
  for (let at = 5000; at < whole.length - 20_000; at += 97) flipped[at] ^= 0xff;
  cases.push(["flipped", flipped]);
  for (const [name, bytes] of cases) {
    await writeFile(file, bytes);
    const context = await browser.newContext();
    const page = await context.newPage();
    const errors = [];
    page.on("pageerror", (error) => errors.push(error.message));
    await page.goto(`${its.url}#iso=0.5&target=full`);
    await page.waitForFunction(() => document.querySelector("#banner:not([hidden])") || window.isonest, undefined, { timeout: 60_000 });
    if (await page.evaluate(() => Boolean(window.isonest))) await idle(page);
    const told = await banner(page);
    assert.ok(told.length > 10, `${name}: nothing is told`);
    assert.deepEqual(errors, [], name);
    await context.close();
  }
  await its.end();
});

test(`${kWander} seconds of random input keep memory within the displayed budget`, async () => {
  const wide = kLarge ? await publish("large", [kLarge]) : site;
  const { page, faults, close } = await openPage(browser, `${wide.url}${kLarge ? "" : "#iso=0.5&most=400000"}`);
  await ready(page);
  const seen = await wander(page, kWander, 29);
  console.log(JSON.stringify(seen));
  assert.ok(seen.actions > 5);
  assert.ok(seen.mostServer > 0 && seen.mostServer <= kBudget, `the library holds ${seen.mostServer} bytes`);
  assert.ok(seen.mostHeap <= 300e6, `the page's heap has grown to ${seen.mostHeap} bytes`);
  assert.equal(await page.evaluate(() => window.isonest.banner()), null);
  assert.deepEqual(faults, []);
  await close();
  if (kLarge) await wide.end();
}, kTimeout + 2000 * kWander);
