// Tests the page without a server: all data come from a worker, with the messages of tools/view/web/README.md.
// usage: transport_test.mjs ISONEST
//
// The worker is a stand-in that passes requests on to `isonest view` and fails on demand, so that the page is tested by
// itself. publish_test.mjs tests the real worker.
// Exit code 77 with a message: no browser is available.
import assert from "node:assert/strict";
import { mkdir, readFile, writeFile } from "node:fs/promises";
import { join } from "node:path";
import { after, before, test as anyTest } from "node:test";
import { idle, lacks, openPage, run, startBrowser, startServer, temporaryFolder } from "../../tools/view/web/drive.mjs";
import { readPly } from "./meshes.mjs";
import { serveFiles } from "./static_server.mjs";

const [, , program] = process.argv;
const reason = lacks() ?? (/^ +view /m.test(await run(program, "--help")) ? null : "the program was built without isonest view");
if (reason) {
  console.log(`skipped: ${reason}`);
  process.exit(77);
}

const test = (name, body) => anyTest(name, { timeout: 240_000 }, body);
const kMemory = 256 * 2 ** 20;
const kWorker = `
  const aborts = new Map();
  let mode = "";
  self.onmessage = async ({ data }) => {
    if (data.kind === "open") {
      mode = new URL(data.url).searchParams.get("mode") ?? "";
      self.lastUrl = data.url;
      await fetch("note?" + new URLSearchParams({ url: data.url, memory: data.memory }));
      if (mode === "no-ranges") self.postMessage({ kind: "failed", message: "the server sends whole files in place of parts" });
      else self.postMessage({ kind: "opened" });
    } else if (data.kind === "cancel") {
      aborts.get(data.id)?.abort();
      fetch("cancelled?" + data.id);
    } else {
      if (mode === "dies" && data.target.includes("iso=0.7")) return setTimeout(() => { throw new Error("out of memory"); });
      if (mode === "small") { // its memory suffices only for "most" triangles
        const query = new URLSearchParams(data.target.split("?")[1]);
        const most = new URL(self.lastUrl).searchParams.get("most");
        if (/^(surface|slice)/.test(data.target) && !(Number(query.get("triangles") ?? Infinity) <= Number(most))) {
          const body = new TextEncoder().encode('{"error": {"kind": "limit", "message": "too large", "remedies": []}}').buffer;
          return self.postMessage({ kind: "answer", id: data.id, status: 413, type: "application/json", body }, [body]);
        }
      }
      const abort = new AbortController();
      aborts.set(data.id, abort);
      const silent = mode === "silent" && /iso=0.5&.*error=0(&|$)/.test(data.target);
      const response = silent ? await new Promise(() => undefined) : await fetch("api/" + data.target, { signal: abort.signal }).catch(() => null);
      if (!response) return;
      const body = await response.arrayBuffer();
      self.postMessage({ kind: "progress", id: data.id, bytes: body.byteLength });
      self.postMessage({ kind: "answer", id: data.id, status: response.status, type: response.headers.get("Content-Type"), body }, [body]);
    }
  };`;

let folder, store, server, site, browser;

function description(name, more = {}) {
  return { name, url: `stores/${name}.isonest`, title: `The ${name}`, description: "", license: "", bytes: 1, nodes: [65, 65, 65], type: "float32", unit: "um", ...more };
}
async function writeList(stores, more = {}) {
  const list = { isonest_site: 1, title: "Two <volumes>", description: "One.\n\nTwo.", license: "CC BY 4.0", memory: kMemory, stores, ...more };
  await writeFile(join(folder.path, "site", "site.json"), JSON.stringify(list));
}

before(async () => {
  folder = await temporaryFolder();
  store = join(folder.path, "bucky.isonest");
  const volume = join(folder.path, "bucky.h5");
  await run(program, "make-volume", "bucky", "--size", "65", "-o", volume);
  await run(program, "preprocess", volume, "--unit", "um", "-o", store);
  server = await startServer(program, store, "--port", "0");
  await mkdir(join(folder.path, "site"));
  for (const name of ["index.html", "main.js", "mesh_worker.js", "style.css", "licences.txt"]) {
    const text = await (await fetch(new URL(name, server.url))).text();
    const list = '<meta charset="utf-8" /><meta name="isonest-site" content="site.json" />';
    await writeFile(join(folder.path, "site", name), name === "index.html" ? text.replace('<meta charset="utf-8" />', list) : text);
  }
  await writeFile(join(folder.path, "site", "worker.js"), kWorker);
  site = await serveFiles(join(folder.path, "site"), {
    handle: async (request, response) => {
      if (/^\/(note|cancelled)\?/.test(request.url)) return response.writeHead(204).end(), true;
      if (!request.url.startsWith("/api/")) return false;
      const answer = await fetch(new URL(request.url, server.url));
      response.writeHead(answer.status, { "Content-Type": answer.headers.get("Content-Type") });
      return response.end(Buffer.from(await answer.arrayBuffer())), true;
    },
  });
  browser = await startBrowser();
});
after(async () => {
  await browser?.close();
  await site?.end();
  await server?.end();
  await folder?.end();
  setTimeout(() => process.exit(process.exitCode ?? 1), 10_000).unref();
});

const header = (page) => page.evaluate(() => window.isonest.header());
const banner = (page) => page.$eval("#banner", (element) => element.textContent);
async function setIso(page, value) {
  await page.$eval("#iso", (input, text) => {
    input.value = text;
    input.dispatchEvent(new Event("input", { bubbles: true }));
  }, String(value));
}
const asked = (name) => site.requests.filter(({ path }) => path.startsWith(`/${name}?`)).map(({ path }) => Object.fromEntries(new URLSearchParams(path.split("?")[1])));

test("the mesh is the server's, the store's URL is from the list, and no control needs a server", async () => {
  await writeList([description("bucky", { description: "A ball.", license: "CC0" })]);
  const fragment = "#iso=0.5&target=error&error=0.05";
  const theirs = await openPage(browser, server.url + fragment);
  await idle(theirs.page);
  const { page, faults, close } = await openPage(browser, site.url + fragment);
  await idle(page);
  const { seconds: _a, chunks_read: _b, bytes_read: _c, ...shown } = await header(page);
  const { seconds: _d, chunks_read: _e, bytes_read: _f, ...expected } = await header(theirs.page);
  assert.deepEqual(shown, expected);
  assert.deepEqual(asked("note").at(-1), { url: `${site.url}stores/bucky.isonest`, memory: String(kMemory) });
  assert.equal(await page.title(), "The bucky – isonest");
  await page.$eval("#export", (section) => (section.open = true));
  assert.equal(await page.locator("#command").count(), 0);
  assert.deepEqual(await page.$$eval("#export-format option", (all) => all.map((one) => one.value)), ["ply", "stl", "glb"]);
  assert.match(await page.$eval("#about", (section) => section.textContent), /A ball\..*65 × 65 × 65 float32, um.*Licence: CC0/s);
  assert.match(await page.$eval("#memory-server", (value) => value.textContent), /of .* allowed/);
  assert.deepEqual([faults, theirs.faults], [[], []]);
  await close();
  await theirs.close();
});

test("the page saves the mesh as PLY, STL and GLB with the displayed positions", async () => {
  await writeList([description("bucky")]);
  const { page, faults, close } = await openPage(browser, `${site.url}#iso=0.5&target=error&error=0.05`);
  await idle(page);
  await page.$eval("#export", (section) => (section.open = true));
  const shown = await header(page);
  const save = async (format) => {
    await page.selectOption("#export-format", format);
    const [download] = await Promise.all([page.waitForEvent("download"), page.click("#export-mesh")]);
    assert.equal(download.suggestedFilename(), `bucky.${format}`);
    return readFile(await download.path());
  };
  const ply = await save("ply");
  const file = join(folder.path, "saved.ply");
  await writeFile(file, ply);
  const other = join(folder.path, "other.ply");
  await run(program, "extract", store, "--iso", "0.5", "--error", String(shown.tolerance), "--effort", "none", "-o", other);
  const [mine, exact] = [await readPly(file), await readPly(other)];
  assert.equal(mine.vertices, exact.vertices);
  for (const axis of [0, 1, 2]) {
    for (const sign of [-1, 1]) {
      const direction = [0, 1, 2].map((i) => (i === axis ? sign : 0));
      const off = Math.abs(mine.nearestTo(direction)[axis] - exact.nearestTo(direction)[axis]);
      assert.ok(off <= shown.position_rounding + 1e-5, `along axis ${axis} a place is ${off} off`);
    }
  }
  const stl = await save("stl");
  assert.deepEqual([stl.readUInt32LE(80), stl.length], [shown.triangles, 84 + 50 * shown.triangles]);
  const glb = await save("glb");
  assert.deepEqual([glb.toString("latin1", 0, 4), glb.readUInt32LE(4), glb.readUInt32LE(8)], ["glTF", 2, glb.length]);
  const json = JSON.parse(glb.toString("utf8", 20, 20 + glb.readUInt32LE(12)));
  assert.deepEqual(json.accessors.map(({ count }) => count), [shown.vertices, shown.vertices, 3 * shown.triangles]);
  assert.deepEqual(faults, []);
  await close();
});

test("several stores are listed, links contain only a store's name, and the fragment is the view", async () => {
  await writeList([description("bucky"), description("other", { license: "CC BY-SA 4.0" })]);
  const opened = await browser.newContext();
  const page = await opened.newPage();
  await page.goto(site.url);
  await page.waitForSelector("#stores");
  assert.deepEqual(await page.$$eval("#stores h3", (all) => all.map((one) => one.textContent)), ["The bucky", "The other"]);
  assert.match(await page.$eval("#stores", (list) => list.innerHTML), /Two &lt;volumes&gt;.*<p>One\.<\/p><p>Two\.<\/p>.*Licence: CC BY 4\.0.*65 × 65 × 65 float32, um, 1 B.*Licence: CC BY-SA 4\.0/s);
  const before = site.requests.length;
  await page.click("text=The other");
  await page.waitForFunction(() => window.isonest);
  await idle(page);
  assert.equal(asked("note").at(-1).url, `${site.url}stores/other.isonest`);
  await setIso(page, 0.6);
  await page.waitForFunction(() => /\?store=other#.*iso=0\.6/.test(location.href));
  await page.reload();
  await page.waitForFunction(() => window.isonest);
  assert.equal(await page.evaluate(() => window.isonest.state().iso), 0.6);
  assert.ok(site.requests.length > before);
  for (const hostile of ["?store=https://example.org/x.isonest", "?store=stores/bucky.isonest", "?store=../x", "?url=https://example.org/x.isonest", "#store=https://example.org/x"]) {
    const count = asked("note").length;
    await page.goto(new URL(hostile, site.url).href);
    await page.waitForSelector("#stores");
    if (hostile.startsWith("?store")) assert.match(await banner(page), /This site has no store/);
    assert.equal(asked("note").length, count, hostile);
  }
  await opened.close();
});

test("a missing or damaged list is reported", async () => {
  for (const [text, told] of [["{", /list of stores/], ["{}", /list of stores/], [JSON.stringify({ isonest_site: 2 }), /publish the folder again/],
    [JSON.stringify({ isonest_site: 1, title: "", description: "", license: "", memory: 1, stores: [description("x", { url: "javascript:alert(1)" })] }), /damaged/]]) {
    await writeFile(join(folder.path, "site", "site.json"), text);
    const { page, close } = await openPage(browser, site.url);
    assert.match(await banner(page), told, text);
    await close();
  }
});

test("the page reports why a worker cannot open the store or has died", async () => {
  await writeList([description("bucky", { url: "stores/bucky.isonest?mode=no-ranges" })]);
  const first = await openPage(browser, site.url);
  assert.match(await banner(first.page), /^The server sends whole files in place of parts/);
  await first.close();
  await writeList([description("bucky", { url: "stores/bucky.isonest?mode=dies" })]);
  const second = await openPage(browser, `${site.url}#iso=0.5`);
  await idle(second.page);
  await setIso(second.page, 0.7);
  await second.page.waitForSelector("#reload");
  assert.match(await banner(second.page), /failed: .*out of memory/);
  assert.equal(await second.page.evaluate(() => window.isonest.banner()), "server");
  await second.close();
  await writeFile(join(folder.path, "site", "worker.js"), "this is no script");
  const third = await openPage(browser, site.url);
  assert.match(await banner(third.page), /worker, which reads the store/i);
  await third.close();
  await writeFile(join(folder.path, "site", "worker.js"), kWorker);
});

test("if memory is too small for a mesh, a coarser one is shown with a notice", async () => {
  await writeList([description("bucky", { url: "stores/bucky.isonest?mode=small&most=9000" })]);
  const { page, faults, close } = await openPage(browser, `${site.url}#iso=0.5&target=full&slice-z=1,20`);
  await idle(page);
  const shown = await header(page);
  assert.ok(shown.triangles > 1000 && shown.triangles <= 9000, `${shown.triangles} triangles`);
  assert.ok(shown.error_bound > 0 && !shown.full_resolution);
  assert.match(await page.$eval("body", (body) => body.textContent), /too little memory for a finer surface/);
  assert.ok((await page.evaluate(() => window.isonest.header("z"))).triangles <= 9000);
  assert.match(await page.$eval("#slice-z-bound", (text) => text.textContent), /too little memory for a finer one/);
  assert.equal(await page.evaluate(() => window.isonest.banner()), null);
  assert.deepEqual(faults, []);
  await close();
  await writeList([description("bucky", { url: "stores/bucky.isonest?mode=small&most=1" })]);
  const none = await openPage(browser, `${site.url}#iso=0.5`);
  await none.page.waitForFunction(() => document.querySelector("#banner:not([hidden])"));
  assert.match(await banner(none.page), /too large/i);
  await none.close();
});

test("abandoned requests are cancelled in the worker", async () => {
  await writeList([description("bucky", { url: "stores/bucky.isonest?mode=silent" })]);
  const { page, faults, close } = await openPage(browser, `${site.url}#iso=0.5&target=full`);
  const count = site.requests.filter(({ path }) => path.startsWith("/cancelled")).length;
  await page.waitForFunction(() => /Refining to full resolution/.test(document.querySelector("#surface-progress").textContent));
  await setIso(page, 0.8);
  await idle(page);
  assert.equal((await header(page)).full_resolution, true);
  assert.equal(await page.evaluate(() => window.isonest.state().iso), 0.8);
  assert.equal(site.requests.filter(({ path }) => path.startsWith("/cancelled")).length, count + 1);
  assert.deepEqual(faults, []);
  await close();
});
