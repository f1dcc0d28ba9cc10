// Tests in Chromium what is seen of scans and of several quantities: windows, flat views with the patient's sides, area and
// volume, pictures of a chosen size, surfaces coloured by a quantity. usage: looks_test.mjs ISONEST
//
// All data are formulas, so the expected numbers are known. Exit code 77 with a message: no browser is available.
import assert from "node:assert/strict";
import { writeFile } from "node:fs/promises";
import { join } from "node:path";
import { after, before, test as anyTest } from "node:test";
import { idle, lacks, readPng, run, startBrowser, startServer, temporaryFolder } from "../../tools/view/web/drive.mjs";
import { canvas, commandOf, differing, header, open, setRange, state, withPage } from "./pages.mjs";

const [, , program] = process.argv;
const reason = lacks() ?? (/^ +view /m.test(await run(program, "--help")) ? null : "the program was built without isonest view");
if (reason) {
  console.log(`skipped: ${reason}`);
  process.exit(77);
}

const test = (name, body) => anyTest(name, { timeout: 240_000 }, body);
let folder, browser;
const servers = [];

/** Starts a server for the values of a formula at each node. */
async function serve(name, nodes, type, value, preprocess = [], view = []) {
  const store = await makeStore(name, nodes, type, value, preprocess);
  const server = await startServer(program, store, "--port", "0", ...view);
  servers.push(server);
  return server.url;
}
async function makeStore(name, nodes, type, value, preprocess = []) {
  const values = new { i2: Int16Array, f4: Float32Array }[type](nodes ** 3);
  for (let i = 0, z = 0; z < nodes; ++z) for (let y = 0; y < nodes; ++y) for (let x = 0; x < nodes; ++x) values[i++] = value(x, y, z);
  const store = join(folder.path, `${name}.isonest`);
  await writeFile(join(folder.path, `${name}.raw`), Buffer.from(values.buffer));
  await run(program, "preprocess", join(folder.path, `${name}.raw`), "--dims", `${nodes},${nodes},${nodes}`, "--type", type, ...preprocess, "-o", store);
  return store;
}

before(async () => {
  folder = await temporaryFolder();
  browser = await startBrowser();
});
after(async () => {
  await browser?.close();
  for (const server of servers) assert.equal((await server.end()).code, 0);
  await folder?.end();
  setTimeout(() => process.exit(process.exitCode ?? 1), 10_000).unref();
});

const onPage = (url, use) => withPage(browser, url, use);

/** Air around a body of water-like tissue with a denser bone inside, and a few values of metal: as in a CT. */
function ct(x, y, z) {
  const radius = Math.hypot(x - 24, y - 24, z - 24);
  return x === 24 && y === 24 && z === 24 ? 30000 : radius < 6 ? 900 : radius < 20 ? 40 + x : -1000;
}

/** The mean brightness of the picture's pixels around a point of the world. */
async function brightness(page, at) {
  const [x, y] = await page.evaluate((place) => window.isonest.project(place), at);
  const { data, width, channels } = await canvas(page);
  let sum = 0;
  for (let j = -3; j <= 3; ++j) for (let i = -3; i <= 3; ++i) sum += data[((Math.round(y) + j) * width + Math.round(x) + i) * channels];
  return sum / 49;
}

test("a CT starts with the window of soft tissue, and has those of bone and lung", async () => {
  const url = await serve("ct", 49, "i2", ct, ["--unit", "mm", "--frame", "lps"]);
  await onPage(`${url}#surface=0&slice-z=1,20`, async (page) => {
    assert.deepEqual((await state(page)).window, [-150, 250]);
    const tissue = [24 + 12, 24, 20]; // 76
    assert.ok(Math.abs((await brightness(page, tissue)) - (255 * (76 + 150)) / 400) < 12, `${await brightness(page, tissue)}`);
    await open(page, "slices");
    for (const [id, window] of [["bone", [-500, 1300]], ["lung", [-1350, 150]], ["brain", [0, 80]], ["all", [-1000, 30000]], ["soft", [-150, 250]]]) {
      await page.click(`#window-${id}`);
      await idle(page);
      assert.deepEqual((await state(page)).window, window);
      const expected = 255 * Math.min(Math.max((76 - window[0]) / (window[1] - window[0]), 0), 1);
      assert.ok(Math.abs((await brightness(page, tissue)) - expected) < 12, `${id}: ${await brightness(page, tissue)} in place of ${expected}`);
    }
    await page.click("#window-histogram");
    const [low, high] = (await state(page)).window;
    assert.ok(low <= -900 && high >= 880 && high < 2000, `most values are from ${low} to ${high}`);
  });
  await onPage(`${url}#surface=0&slice-z=1,20&window=0,100`, async (page) => assert.deepEqual((await state(page)).window, [0, 100]));
});

test("few values far from all others do not make the slices black", async () => {
  const url = await serve("outlier", 33, "f4", (x, y, z) => (x === 3 && y === 3 && z === 3 ? 1e6 : x));
  await onPage(`${url}#surface=0&slice-z=1,16`, async (page) => {
    const [low, high] = (await state(page)).window;
    assert.ok(low >= 0 && high < 1e6 / 2, `${low} to ${high}`);
  });
  const even = await serve("even", 33, "f4", (x) => x);
  await onPage(`${even}#surface=0&slice-z=1,16`, async (page) => assert.deepEqual((await state(page)).window, [0, 32]));
});

for (const [frame, sides] of [
  // The patient's sides at the left, right, top and bottom. Axial from the feet, coronal from the front, sagittal from the left.
  ["lps", { z: ["R", "L", "A", "P"], y: ["R", "L", "H", "F"], x: ["A", "P", "H", "F"] }],
  ["ras", { z: ["R", "L", "A", "P"], y: ["R", "L", "H", "F"], x: ["A", "P", "H", "F"] }],
]) {
  test(`flat views show the patient's sides as in radiology (${frame})`, async () => {
    const url = await serve(`sides-${frame}`, 33, "f4", (x, y, z) => x + 2 * y + 4 * z, ["--unit", "mm", "--frame", frame]);
    await onPage(`${url}#iso=100&slice-x=1,16&slice-y=1,16&slice-z=1,16`, async (page) => {
      const marks = () => page.$$eval(".side-mark", (texts) => texts.map((text) => text.textContent));
      assert.deepEqual(await marks(), ["", "", "", ""], "between the axes there are none");
      await open(page, "slices");
      for (const [name, expected] of Object.entries(sides)) {
        await page.click(`#slice-${name}-flat`);
        await idle(page);
        assert.deepEqual(await marks(), expected, name);
        const { projection, surface } = await state(page);
        assert.deepEqual([projection, surface], ["orthographic", false]);
        // Independent of the marks: in LPS x grows to the left of the patient, y to the back, z to the head; in RAS x and y are reversed.
        const [ox, oy] = await page.evaluate(() => window.isonest.project([16, 16, 16]));
        const sign = frame === "lps" ? 1 : -1;
        const side = { L: [8 * sign, 0, 0], P: [0, 8 * sign, 0], H: [0, 0, 8] };
        for (const [letter, [dx, dy, dz]] of Object.entries(side)) {
          const [x, y] = await page.evaluate((at) => window.isonest.project(at), [16 + dx, 16 + dy, 16 + dz]);
          const at = expected.indexOf(letter);
          if (at === -1) continue;
          const moved = [[-1, 0], [1, 0], [0, -1], [0, 1]][at];
          assert.ok((x - ox) * moved[0] + (y - oy) * moved[1] > 10, `${name}: ${letter} is not where its mark is`);
        }
      }
    });
  });
}

test("area and volume of the surface are those of the ball", async () => {
  const radius = (x, y, z) => Math.hypot(x - 24, y - 24, z - 24);
  const url = await serve("ball", 49, "f4", (x, y, z) => 20 - radius(x, y, z), ["--unit", "mm", "--spacing", "0.5,0.5,0.5"]);
  const number = (text) => Number(text.replaceAll(",", ""));
  await onPage(`${url}#iso=4&target=full`, async (page) => {
    const [, area, volume] = /^Area ([0-9.,]+) mm², volume ([0-9.,]+) mm³$/.exec(await page.$eval("#surface-size", (element) => element.textContent));
    assert.ok(Math.abs(number(area) / (4 * Math.PI * 8 ** 2) - 1) < 0.01, area);
    assert.ok(Math.abs(number(volume) / ((4 / 3) * Math.PI * 8 ** 3) - 1) < 0.01, volume);
    await open(page, "clipping");
    await page.check("#box-on");
    await setRange(page, "box-5", 12);
    await idle(page);
    const [, half] = /^Area ([0-9.,]+) mm², it is open$/.exec(await page.$eval("#surface-size", (element) => element.textContent));
    assert.ok(Math.abs(number(half) / (2 * Math.PI * 8 ** 2) - 1) < 0.01, half);
  });
});

test("a picture has the chosen size, and shows the same", async () => {
  const url = await serve("picture", 33, "f4", (x, y, z) => 12 - Math.hypot(x - 16, y - 16, z - 16));
  await onPage(`${url}#iso=2&target=full&outline=0`, async (page) => {
    await open(page, "export");
    const save = async () => {
      const [download] = await Promise.all([page.waitForEvent("download"), page.click("#export-picture")]);
      return readPng(await download.path());
    };
    const plain = await canvas(page);
    const part = ({ data, width, height, channels }) => {
      const { 0: r, 1: g, 2: b } = data; // the background
      let count = 0;
      for (let i = 0; i < data.length; i += channels) if (Math.abs(data[i] - r) + Math.abs(data[i + 1] - g) + Math.abs(data[i + 2] - b) > 20) ++count;
      return count / (height * height); // the height shows the same part of the world
    };
    const own = await save();
    assert.deepEqual([own.width, own.height], [plain.width, plain.height]);
    await page.fill("#picture-width", "1200");
    await page.fill("#picture-height", "900");
    const large = await save();
    assert.deepEqual([large.width, large.height], [1200, 900]);
    assert.ok(Math.abs(part(large) / part(plain) - 1) < 0.03, `${part(large)}, ${part(plain)}`);
    await page.fill("#picture-height", "");
    const wide = await save();
    assert.deepEqual([wide.width, wide.height], [1200, Math.round((1200 * plain.height) / plain.width)]);
    assert.ok(differing(plain, await canvas(page)) === 0, "the page shows the same as before");
  });
});

test("a second quantity colours the surface, is shown under the cursor, and goes into the command", async () => {
  const height = await makeStore("height", 17, "f4", (x, y, z) => 100 + 2 * z, ["--spacing", "2,2,2"]); // another lattice: 100 + z in the world
  const url = await serve("shape", 33, "f4", (x, y, z) => 12 - Math.hypot(x - 16, y - 16, z - 16), [], ["--vertex-values", `height=${height}`]);
  await onPage(`${url}#iso=2&target=full&outline=0&camera=16,-60,16,16,16,16`, async (page) => {
    assert.equal((await state(page)).color, "height");
    const shown = await header(page);
    assert.equal(shown.color, "height");
    assert.ok(shown.color_bound < 1e-3, `linear in the world, so exact: ${shown.color_bound}`);
    assert.ok(Math.abs(shown.value_origin - 106) < 0.1 && Math.abs(shown.value_origin + 65535 * shown.value_step - 126) < 0.1);
    await open(page, "colors");
    await page.selectOption("#color-map", "gray");
    await page.fill("#color-from-number", "106");
    await page.keyboard.press("Enter");
    await page.fill("#color-to-number", "126");
    await page.keyboard.press("Enter");
    await idle(page);
    const [low, high] = [await brightness(page, [16, 6.6, 13]), await brightness(page, [16, 6.6, 19])];
    assert.ok(high > low + 20, `from ${low} to ${high}`);
    const [x, y] = await page.evaluate(() => window.isonest.project([16, 6.6, 19]));
    await page.locator("#canvas").hover({ position: { x, y } });
    await page.waitForFunction(() => window.isonest.value() !== null);
    const found = await page.evaluate(() => window.isonest.value());
    assert.ok(Math.abs(found.quantities.height - (100 + found.world[2])) < 0.01, `${found.quantities.height} at ${found.world}`);
    assert.match(await page.$eval("#readout", (element) => element.textContent), /; height 1\d\d/);
    const command = await commandOf(page, join(folder.path, "colored.ply"));
    assert.ok(command.includes("--vertex-values"), command.join(" "));
    const report = JSON.parse(await run(program, ...command, "--json"));
    assert.equal(report.triangles, shown.triangles);
    assert.equal(report.vertex_fields[0].linear_bound, shown.color_bound);
    const colored = await canvas(page);
    await page.selectOption("#color", "");
    await idle(page);
    assert.equal((await header(page)).color, undefined);
    assert.ok(differing(colored, await canvas(page)) > 0.05);
  });
});
