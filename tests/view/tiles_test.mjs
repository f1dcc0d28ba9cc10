// Tests in Chromium that the page shows surfaces with more triangles than it may show by tiles. usage: tiles_test.mjs ISONEST
//
// The limit for triangles is the page's own setting. Errors and triangles are compared with the lists of the tileset, pictures
// with those of the full mesh. Exit code 77 with a message: no browser is available.
import assert from "node:assert/strict";
import { writeFile } from "node:fs/promises";
import { join } from "node:path";
import { after, before, test as anyTest } from "node:test";
import { idle, lacks, openPage, run, startBrowser, startServer, temporaryFolder } from "../../tools/view/web/drive.mjs";
import { canvas, differing, header, open, setRange, withPage } from "./pages.mjs";

const [, , program] = process.argv;
const reason = lacks() ?? (/^ +view /m.test(await run(program, "--help")) ? null : "the program was built without isonest view");
if (reason) {
  console.log(`skipped: ${reason}`);
  process.exit(77);
}

const test = (name, body) => anyTest(name, { timeout: 300_000 }, body);
const kNodes = 113;
const kFull = 200_000; // triangles of the surface; there are more
const kMost = 150_000;
/** The volume's axes in the world, as long as its spacing, and a place in one of its finest tiles, seen from afar. */
const kAxes = [[0.8, 0.6, 0], [-0.48, 0.64, 0.6], [0.36, -0.48, 0.8]].map((axis, i) => axis.map((part) => part * [1, 1.25, 0.9][i]));
const kPlace = [-10, 20, 30].map((part, i) => part + 30 * (kAxes[0][i] + kAxes[1][i] + kAxes[2][i]));
const kCamera = `camera=${[...kPlace.map((part, i) => part + 300 * [0.5, -0.7, 0.5][i]), ...kPlace].join(",")}`;
let folder, browser, server, store;

/** A surface with many handles in a volume whose axes are turned in the world, with other distances along each. */
before(async () => {
  folder = await temporaryFolder();
  browser = await startBrowser();
  const values = new Float32Array(kNodes ** 3);
  const w = (2 * Math.PI) / 56;
  for (let i = 0, z = 0; z < kNodes; ++z) {
    for (let y = 0; y < kNodes; ++y) {
      for (let x = 0; x < kNodes; ++x) values[i++] = Math.sin(w * x) * Math.cos(w * y) + Math.sin(w * y) * Math.cos(w * z) + Math.sin(w * z) * Math.cos(w * x);
    }
  }
  const head = `NRRD0005\ntype: float\ndimension: 3\nsizes: ${kNodes} ${kNodes} ${kNodes}\nendian: little\nencoding: raw\nspace: left-posterior-superior\nspace directions: ${kAxes.map((axis) => `(${axis.join(",")})`).join(" ")}\nspace origin: (-10,20,30)\n\n`;
  await writeFile(join(folder.path, "v.nrrd"), Buffer.concat([Buffer.from(head), Buffer.from(values.buffer)]));
  store = join(folder.path, "v.isonest");
  await run(program, "preprocess", join(folder.path, "v.nrrd"), "-o", store);
  server = await startServer(program, store, "--port", "0");
});
after(async () => {
  await browser?.close();
  if (server) assert.equal((await server.end()).code, 0);
  await folder?.end();
  setTimeout(() => process.exit(process.exitCode ?? 1), 10_000).unref();
});

const onPage = (fragment, use) => withPage(browser, `${server.url}#outline=0&${fragment}`, use);
const tiles = (page) => page.evaluate(() => window.isonest.tiles());
const triangles = (page) => page.evaluate(() => window.isonest.triangles());
const text = (page, id) => page.$eval(`#${id}`, (element) => element.textContent);
const detail = (page) => page.$eval(".state .note", (element) => element.textContent);
const ask = async (path) => (await fetch(`${server.url}api/${path}`)).json();

/** All errors in the lists of a tileset, and the number of triangles of each tile by its error. */
async function listed(tileset) {
  const all = [];
  const visit = (tile) => {
    all.push(tile);
    for (const child of tile.children ?? []) visit(child);
  };
  visit((await ask(`tileset/${tileset}/tileset.json`)).root);
  return all;
}

/** Turns the mouse wheel; the largest and smallest number of triangles in all frames until the page is at rest. */
async function fly(page, turns) {
  await page.locator("#canvas").hover();
  await page.evaluate(() => {
    window.seen = [];
    const look = () => (window.seen.push(window.isonest.triangles()), requestAnimationFrame(look));
    look();
  });
  for (let i = 0; i < Math.abs(turns); ++i) await page.mouse.wheel(0, -200 * Math.sign(turns));
  await idle(page);
  return page.evaluate(() => [Math.min(...window.seen), Math.max(...window.seen)]);
}

test("tiles are refined as the camera nears, within the limit of triangles, with the largest error on the banner", async () => {
  await onPage(`iso=0.1&most=${kMost}&${kCamera}`, async (page) => {
    const far = await tiles(page);
    assert.equal(far.state, "shown");
    const list = await listed(far.tileset);
    const known = new Set(list.map(({ geometricError }) => geometricError));
    const full = list.filter(({ children }) => !children).reduce((sum, { extras }) => sum + extras.triangles, 0);
    assert.ok(full > kFull, `${full}`);
    const leaves = new Set(list.filter(({ children }) => !children).map(({ geometricError }) => geometricError));
    const check = async (shown) => {
      assert.ok(shown.shown > 0 && shown.errors.every((error) => known.has(error)));
      assert.equal(shown.error, Math.max(...shown.errors));
      assert.ok(shown.pixels <= 1 || shown.limited || shown.full, JSON.stringify(shown));
      const count = await triangles(page);
      assert.ok(count > 0 && count <= kMost, `${count}`);
      assert.match(await text(page, "surface-count"), new RegExp(`^${count.toLocaleString("en")} triangles on the screen, of [0-9,]+$`));
      const bound = await text(page, "surface-bound");
      const [, full, told, pixels] = /^(Full resolution, rounded by up|Within) (?:to )?([0-9.e-]+) world units(?: of the surface at full resolution, (at most a pixel|up to [0-9.,]+ pixels) on the screen)?$/.exec(bound);
      assert.ok(Number(told) >= shown.error && Number(told) <= 1.02 * shown.error, `${told} for ${shown.error}`);
      assert.equal(full === "Within", !shown.full);
      if (shown.full || shown.pixels <= 1) assert.equal(pixels, shown.full ? undefined : "at most a pixel", bound);
      else {
        const number = Number(/^up to ([0-9.,]+) pixels$/.exec(pixels)[1].replaceAll(",", ""));
        assert.ok(number >= shown.pixels && number <= 1.02 * shown.pixels, `${bound} for ${shown.pixels}`);
      }
      assert.equal(shown.full, shown.errors.every((error) => leaves.has(error)));
      assert.match(await detail(page), /area and volume are not known/);
      assert.equal(await text(page, "surface-size"), "");
    };
    await check(far);
    const [least, highest] = await fly(page, 17);
    assert.ok(least > 0 && highest <= kMost, `${least} to ${highest} triangles`);
    const near = await tiles(page);
    await check(near);
    assert.ok(near.loads > far.loads, "nothing was loaded");
    assert.ok(near.error < far.error / 10 && near.full, `${near.error} in place of ${far.error}`);
    const [fewest, most] = await fly(page, -40);
    assert.ok(fewest > 0 && most <= kMost, `${fewest} to ${most} triangles`);
    await check(await tiles(page));
  });
});

test("the picture is that of the full mesh", async () => {
  const camera = "camera=25,-60,130,20,40,70";
  const pictures = [];
  for (const limit of [kMost, 3_000_000]) {
    await onPage(`iso=0.1&target=full&most=${limit}&${camera}`, async (page) => {
      assert.equal((await tiles(page)).state === "shown", limit === kMost);
      assert.equal((await header(page))?.full_resolution ?? null, limit === kMost ? null : true);
      pictures.push(await canvas(page));
    });
  }
  const part = differing(...pictures);
  const { data, channels } = pictures[1];
  let covered = 0;
  for (let i = 0; i < data.length; i += channels) if ([0, 1, 2].some((c) => Math.abs(data[i + c] - data[c]) > 24)) ++covered;
  const share = (covered * channels) / data.length;
  assert.ok(share > 0.3, `the surface covers ${share}`);
  assert.ok(part < 0.02, `${part} of the pixels differ`);
});

test("values and places on tiles are found under the cursor, and what tiles do not show is said", async () => {
  await onPage(`iso=0.1&most=${kMost}`, async (page) => {
    const box = await page.locator("#canvas").boundingBox();
    await page.mouse.move(box.x + box.width / 2, box.y + box.height / 2);
    await page.waitForFunction(() => window.isonest.value()?.value !== undefined);
    const { error } = await tiles(page);
    const { value } = await page.evaluate(() => window.isonest.value());
    assert.ok(Math.abs(value - 0.1) <= 0.02 + 0.25 * error, `${value} within ${error}`); // the gradient is below 0.25 per world unit
    await open(page, "export");
    await page.waitForFunction(() => /cannot be saved/.test(document.querySelector("#command").textContent));
    await page.selectOption("#export-subject", "full");
    await page.waitForFunction(() => /^isonest extract .* --iso=0.1 --normals/.test(document.querySelector("#command").textContent));
    await page.check("#largest");
    await idle(page);
    assert.equal((await tiles(page)).state, "off");
    await page.selectOption("#target", "full");
    await idle(page);
    assert.match(await detail(page), /Tiles would show it, but not only the largest piece\./);
    assert.ok((await triangles(page)) <= kMost);
    await page.uncheck("#largest");
    await idle(page);
    assert.equal((await tiles(page)).state, "shown");
    await page.selectOption("#target", "error");
    await idle(page);
    assert.equal((await tiles(page)).state, "off");
    assert.equal((await header(page)).stop, "error");
  });
});

test("a small surface is shown as before, and no tiles are made", async () => {
  const asked = [];
  await withPage(browser, server.url, async (page) => {
    page.on("request", (request) => asked.push(request.url()));
    for (const target of ["screen", "full"]) {
      await page.selectOption("#target", target);
      await setRange(page, "iso", 0.3);
      await idle(page);
      assert.equal((await tiles(page)).state, "off");
    }
    assert.equal((await header(page)).full_resolution, true);
  });
  assert.ok(asked.some((url) => url.includes("/api/surface")));
  assert.deepEqual(asked.filter((url) => url.includes("/api/tiles")), []);
});

test("another isovalue ends the making, and the page goes on meanwhile", async () => {
  const volume = join(folder.path, "large.h5");
  await run(program, "make-volume", "bucky", "--size", "257", "--type", "uint8", "-o", volume);
  await run(program, "preprocess", volume, "-o", join(folder.path, "large.isonest"));
  const large = await startServer(program, join(folder.path, "large.isonest"), "--port", "0");
  const status = async () => (await fetch(`${large.url}api/status`)).json();
  try {
    const first = `${large.url}#iso=128&most=20000&moving=5000&target=full`;
    const context = await browser.newContext();
    const page = await context.newPage();
    await page.goto(first);
    await page.waitForFunction(() => /^Making tiles: .* %…$/.test(document.querySelector("#surface-progress")?.textContent ?? ""), null, { timeout: 120_000 });
    assert.equal((await status()).file, 1);
    const drawn = await page.evaluate(() => window.isonest.frames());
    await page.locator("#canvas").hover();
    await page.mouse.wheel(0, -100);
    await page.waitForFunction((before) => window.isonest.frames() > before, drawn);
    await setRange(page, "iso", 250);
    const began = Date.now();
    while ((await status()).file !== 0) {
      assert.ok(Date.now() - began < 120_000, "it goes on");
      await new Promise((resolve) => setTimeout(resolve, 20));
    }
    const again = await (await fetch(`${large.url}api/tiles?iso=128&limit=20000&stream=other`)).json();
    assert.ok(["waiting", "making"].includes(again.state), "it was not ended but finished");
    assert.equal((await fetch(`${large.url}api/cancel?stream=other`, { method: "POST" })).status, 204);
    await page.evaluate(() => window.isonest.idle());
    assert.ok((await page.evaluate(() => window.isonest.triangles())) <= 20_000);
    await setRange(page, "iso", 128);
    await page.evaluate(() => window.isonest.idle());
    assert.equal((await page.evaluate(() => window.isonest.tiles())).state, "shown");
    await context.close();
  } finally {
    assert.equal((await large.end()).code, 0);
  }
});

test("tiles that the server has dropped are made again", async () => {
  // The browser itself reports the 404.
  const { page, faults, close } = await openPage(browser, `${server.url}#outline=0&iso=0.15&most=${kMost}&${kCamera}`);
  try {
    await idle(page);
    const before = await tiles(page);
    assert.equal(before.state, "shown");
    for (const iso of [0.2, 0.25, 0.3, 0.35]) {
      for (let state = ""; state !== "ready"; ({ state } = await ask(`tiles?iso=${iso}&limit=1000&stream=other`))) await new Promise((resolve) => setTimeout(resolve, 50));
    }
    assert.equal((await fetch(`${server.url}api/tileset/${before.tileset}/tileset.json`)).status, 404);
    await page.locator("#canvas").hover();
    for (let i = 0; i < 17; ++i) await page.mouse.wheel(0, -200);
    await page.waitForFunction((old) => window.isonest.tiles().state === "shown" && window.isonest.tiles().tileset !== old, before.tileset);
    await idle(page);
    assert.ok((await triangles(page)) > 0);
    assert.deepEqual(faults.filter((fault) => !/status of 404/.test(fault)), []);
  } finally {
    await close();
  }
});

test("without enough memory the page says so, and shows what it did before", async () => {
  const little = await startServer(program, store, "--port", "0", "--memory", "512M");
  try {
    const context = await browser.newContext();
    const page = await context.newPage();
    await page.goto(`${little.url}#iso=0.1&most=${kMost}&target=full`);
    await page.waitForFunction(() => window.isonest?.tiles()?.state === "failed", null, { timeout: 120_000 });
    await idle(page);
    assert.match(await detail(page), /No tiles: .*too little memory for tiles.*--memory/);
    assert.equal(await page.evaluate(() => window.isonest.banner()), null);
    const count = await triangles(page);
    assert.ok(count > 0 && count <= kMost, `${count}`);
    await context.close();
  } finally {
    assert.equal((await little.end()).code, 0);
  }
});
