// Tests the slider of time in Chromium: of `isonest view SERIES`, and of a published series. usage: time_test.mjs ISONEST
//
// The series is a ball that grows: its radius at each time is known. Meshes are compared with those of the step's own
// store. Exit code 77 with a message: no browser is available.
import assert from "node:assert/strict";
import { join } from "node:path";
import { after, before, test as anyTest } from "node:test";
import { idle, lacks, openPage, run, startBrowser, startServer, temporaryFolder } from "../../tools/view/web/drive.mjs";
import { serveFiles } from "./static_server.mjs";
import { writeFile } from "node:fs/promises";

const [, , program] = process.argv;
const reason = lacks() ?? (/^ +view /m.test(await run(program, "--help")) ? null : "the program was built without isonest view");
if (reason) {
  console.log(`skipped: ${reason}`);
  process.exit(77);
}
const canPublish = !/only\s+checks\s+servers/.test(await run(program, "publish", "--help"));

const kTimes = [0, 0.5, 2, 7.25, 8, 9];
const kNodes = 49;
const kTimeout = 240_000;
const test = (name, body, options = {}) => anyTest(name, { timeout: kTimeout, ...options }, body);
let folder, series, server, site, browser;

/** The radius of the surface at isovalue 0. */
const radiusAt = (time) => 8 + time;

before(async () => {
  folder = await temporaryFolder();
  series = join(folder.path, "run.isonest");
  const steps = [];
  for (const [step, time] of kTimes.entries()) {
    const values = new Float32Array(kNodes ** 3);
    const c = (kNodes - 1) / 2;
    for (let i = 0, z = 0; z < kNodes; ++z) for (let y = 0; y < kNodes; ++y) for (let x = 0; x < kNodes; ++x) values[i++] = radiusAt(time) - Math.hypot(x - c, y - c, z - c);
    const name = join(folder.path, `step_${step}.raw`);
    await writeFile(name, Buffer.from(values.buffer));
    steps.push(name);
  }
  await run(program, "preprocess", ...steps, "--dims", `${kNodes},${kNodes},${kNodes}`, "--type", "f4", "--times", kTimes.join(","), "-o", series);
  server = await startServer(program, series, "--port", "0");
  if (canPublish) {
    await run(program, "publish", series, "-o", join(folder.path, "site"), "--title", "A growing ball");
    site = await serveFiles(join(folder.path, "site"));
  }
  browser = await startBrowser();
});
after(async () => {
  await browser?.close();
  await site?.end();
  if (server) assert.equal((await server.end()).code, 0, "Ctrl-C ends the server cleanly");
  await folder?.end();
  setTimeout(() => process.exit(process.exitCode ?? 1), 10_000).unref();
});

const state = (page) => page.evaluate(() => window.isonest.state());
const header = (page, slice) => page.evaluate((name) => window.isonest.header(name), slice);
const setRange = (page, id, value) =>
  page.$eval(`#${id}`, (input, text) => {
    input.value = text;
    input.dispatchEvent(new Event("input", { bubbles: true }));
  }, String(value));
const without = ({ seconds: _a, chunks_read: _b, bytes_read: _c, ...rest }) => rest;

/** Runs `use` on pages of the server and of the site, then checks that no faults occurred. */
async function onPages(fragment, use) {
  for (const [url, kind] of [[server.url, "view"], ...(site ? [[site.url, "publish"]] : [])]) {
    const { page, faults, close } = await openPage(browser, `${url}#${fragment}`);
    try {
      await page.waitForFunction(() => window.isonest);
      await idle(page);
      await use(page, kind);
      assert.deepEqual(faults, [], kind);
      assert.equal(await page.evaluate(() => window.isonest.banner()), null, kind);
    } finally {
      await close();
    }
  }
}

/** The radius of the mesh, from its extent in the header: positions use all of its 16 bits. */
function radiusOf({ step }) {
  return (Math.max(...step) * 65535) / 2;
}

test("the slider changes the time and nothing else, and the meshes are those of the step", async () => {
  await onPages("iso=0&target=full&moving=200&slice-z=1,24&box=0,0,0,48,48,40", async (page, kind) => {
    const before = await state(page);
    assert.deepEqual(await page.$eval("#time", ({ min, max, value }) => [min, max, value]), ["0", "5", "0"]);
    for (const step of [3, 1, 5]) {
      await setRange(page, "time", step);
      await idle(page);
      const now = await state(page);
      assert.deepEqual(now, { ...before, step });
      const shown = await header(page);
      assert.ok(Math.abs(radiusOf(shown) - radiusAt(kTimes[step])) < 0.05, `${kind}, step ${step}: radius ${radiusOf(shown)}`);
      const mesh = join(folder.path, "own.ply");
      const own = JSON.parse(await run(program, "extract", join(series, `step_00000${step}.isonest`), "--iso", "0", "--box", "0,0,0,48,48,40", "--json", "-o", mesh));
      assert.equal(shown.triangles, own.triangles);
      assert.ok(shown.full_resolution);
      // The slice is of this time, too: its largest value is that of the ball's centre.
      const slice = await header(page, "z");
      assert.ok(Math.abs(slice.value_origin + slice.value_step * 65535 - radiusAt(kTimes[step])) < 0.01, kind);
      assert.equal(await page.$eval("#time-number", (field) => field.valueAsNumber), kTimes[step]);
      assert.match(await page.$eval("#time", (range) => range.getAttribute("aria-valuetext")), new RegExp(`^${kTimes[step]}, step ${step + 1} of 6$`));
    }
  });
});

test("a step of the server and of the site have the same mesh", async () => {
  const shown = [];
  await onPages("iso=0&target=full&moving=200&step=4", async (page) => shown.push(without(await header(page))));
  if (shown.length > 1) assert.deepEqual(shown[1], shown[0]);
  assert.ok(Math.abs(radiusOf(shown[0]) - radiusAt(8)) < 0.1);
});

test("buttons, keys and the field move by steps, and stop at the ends", async () => {
  await onPages("iso=0&step=3", async (page) => {
    const at = async () => (await state(page)).step;
    await page.click("#time-forth");
    assert.equal(await at(), 4);
    await page.locator("#canvas").focus();
    await page.keyboard.press("l");
    await page.keyboard.press("l");
    assert.equal(await at(), 5, "beyond the last step");
    assert.ok(await page.$eval("#time-forth", (button) => button.disabled));
    await page.keyboard.press("j");
    assert.equal(await at(), 4);
    await page.click("#time-back");
    assert.equal(await at(), 3);
    await page.fill("#time-number", "1.9");
    await page.keyboard.press("Enter");
    assert.equal(await at(), 2, "the nearest time is 2");
    assert.equal(await page.$eval("#time-number", (field) => field.valueAsNumber), 2);
    await page.locator("#time").focus();
    await page.keyboard.press("Home");
    assert.equal(await at(), 0);
    await page.waitForFunction(() => !/step=/.test(location.hash));
    await idle(page);
    assert.ok(Math.abs(radiusOf(await header(page)) - radiusAt(0)) < 0.5);
  });
});

test("it plays: every step is shown in its order, and it pauses", async () => {
  await onPages("iso=0", async (page, kind) => {
    await page.evaluate(() => {
      window.seen = [];
      const look = () => {
        const { step } = window.isonest.state();
        const header = window.isonest.header();
        if (header) window.seen.push([step, (Math.max(...header.step) * 65535) / 2]);
        requestAnimationFrame(look);
      };
      look();
    });
    await page.locator("#canvas").focus();
    await page.keyboard.press("k");
    await page.waitForFunction(() => new Set(window.seen.map(([step]) => step)).size === 6 && window.seen.at(-1)[0] === 0);
    assert.match(await page.$eval("#time-play", (button) => button.textContent), /Pause/);
    await page.click("#time-play");
    assert.match(await page.$eval("#time-play", (button) => button.textContent), /Play/);
    const stopped = (await state(page)).step;
    await page.waitForTimeout(600);
    assert.equal((await state(page)).step, stopped);
    const seen = await page.evaluate(() => window.seen);
    const steps = seen.map(([step]) => step).filter((step, i, all) => step !== all[i - 1]);
    steps.forEach((step, i) => assert.ok(i === 0 || step === (steps[i - 1] + 1) % 6, `${kind}: ${steps}`));
    for (const [step, time] of kTimes.entries()) {
      const last = Math.min(...seen.filter(([one]) => one === step).map(([, radius]) => Math.abs(radius - radiusAt(time))));
      assert.ok(last < 0.8, `${kind}: step ${step} was passed without its mesh: ${last}`);
    }
  });
});

test("the value under the cursor, the histogram and the announcement are of the time shown", async () => {
  await onPages("surface=0&slice-z=1,24", async (page, kind) => {
    const bars = () => page.$eval(".histogram .bars", (path) => path.getAttribute("d"));
    const first = await bars();
    await setRange(page, "time", 4);
    await idle(page);
    assert.notEqual(await bars(), first, "the histogram is that of the first step");
    const [x, y] = await page.evaluate(() => window.isonest.project([24, 24, 24]));
    await page.locator("#canvas").hover({ position: { x, y } });
    await page.waitForFunction(() => window.isonest.value() !== null);
    const { value, world } = await page.evaluate(() => window.isonest.value());
    assert.ok(Math.abs(value - (radiusAt(8) - Math.hypot(...world.map((part) => part - 24)))) < 0.3, `${kind}: ${value} at ${world}`);
  });
  await onPages("iso=0&step=2", async (page) => {
    await page.waitForFunction(() => /^Time 2\. /.test(document.querySelector("#live").textContent));
  });
});

test("moving the time is as quick as moving the isovalue", async () => {
  await onPages("iso=0&target=full", async (page, kind) => {
    const median = (list) => list.toSorted((a, b) => a - b)[Math.floor(list.length / 2)];
    const measured = async (move) => {
      const from = (await page.evaluate(() => window.isonest.latencies())).length;
      for (let i = 0; i < 12; ++i) {
        await move(i);
        await page.waitForTimeout(60);
      }
      await idle(page);
      return median((await page.evaluate(() => window.isonest.latencies())).slice(from));
    };
    const iso = await measured((i) => setRange(page, "iso", i * 0.1));
    await setRange(page, "iso", 0);
    const first = await measured((i) => setRange(page, "time", i % 6)); // opens the steps
    const time = await measured((i) => setRange(page, "time", (i + 3) % 6));
    console.log(`# ${kind}: milliseconds from a move to its mesh, median: isovalue ${iso.toFixed(0)}, time ${first.toFixed(0)} at first, then ${time.toFixed(0)}`);
    assert.ok(time < 3 * iso + 60, `${kind}: isovalue ${iso} ms, time ${time} ms`);
  });
});

test("a site opens only the steps that are shown and those next to them", { skip: !canPublish }, async () => {
  site.requests.length = 0;
  const { page, close } = await openPage(browser, `${site.url}#iso=0&step=2`);
  await page.waitForFunction(() => window.isonest);
  await idle(page);
  await page.waitForTimeout(1500);
  const asked = new Set(site.requests.flatMap(({ path }) => /step_00000(\d)/.exec(path)?.[1] ?? []).map(Number));
  assert.deepEqual([...asked].toSorted(), [0, 1, 2, 3], "the first step describes the series; 1 and 3 are next to the one that is shown");
  const before = site.requests.length;
  await setRange(page, "time", 3);
  await page.waitForFunction(() => Math.abs((Math.max(...window.isonest.header().step) * 65535) / 2 - 15.25) < 1);
  await close();
  assert.ok(before > 0);
});

test("a step that cannot be read is reported, and the others are shown", { skip: !canPublish }, async () => {
  const broken = await serveFiles(join(folder.path, "site"), { handle: (request, response) => /step_000003/.test(request.url) && (response.writeHead(404).end(), true) });
  const { page, close } = await openPage(browser, `${broken.url}#iso=0`);
  await page.waitForFunction(() => window.isonest);
  await idle(page);
  await setRange(page, "time", 3);
  await page.waitForSelector("#banner:not([hidden])");
  assert.match(await page.$eval("#banner", (element) => element.textContent), /step_000003.*no such file/);
  await setRange(page, "time", 4);
  await idle(page);
  assert.ok(Math.abs(radiusOf(await header(page)) - radiusAt(8)) < 0.5);
  await close();
  await broken.end();
});
