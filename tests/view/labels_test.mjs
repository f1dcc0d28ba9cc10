// Tests the page of `isonest view` for labels in Chromium. usage: labels_test.mjs ISONEST
//
// Meshes are compared with those of `isonest extract`, the list with the voxels of the volume.
// Exit code 77 with a message: no browser is available.
import assert from "node:assert/strict";
import { writeFile } from "node:fs/promises";
import { join } from "node:path";
import { after, before, test as anyTest } from "node:test";
import { idle, lacks, openPage, run, startBrowser, startServer, temporaryFolder } from "../../tools/view/web/drive.mjs";
import { canvas, commandOf, differing, header, open, setRange, state, withPage } from "./pages.mjs";
import { serveFiles } from "./static_server.mjs";

const [, , program] = process.argv;
const reason = lacks() ?? (/^ +view /m.test(await run(program, "--help")) ? null : "the program was built without isonest view");
if (reason) {
  console.log(`skipped: ${reason}`);
  process.exit(77);
}
const canPublish = !/only\s+checks\s+servers/.test(await run(program, "publish", "--help"));

const test = (name, body, options = {}) => anyTest(name, { timeout: 240_000, ...options }, body);
let folder, browser, atlas, server;

const kNodes = 40;
/** Balls of labels 2 to 9 around the corners of a cube, in label 1. */
function atlasValues() {
  const values = new Uint16Array(kNodes ** 3).fill(1);
  for (let i = 0; i < values.length; ++i) {
    const at = [i % kNodes, Math.floor(i / kNodes) % kNodes, Math.floor(i / kNodes ** 2)];
    const corner = at.map((part) => (part < kNodes / 2 ? 0 : 1));
    const radius = Math.hypot(...at.map((part, axis) => part - (corner[axis] === 0 ? 10 : 29)));
    if (radius < 7) values[i] = 2 + corner[0] + 2 * corner[1] + 4 * corner[2];
  }
  return values;
}

before(async () => {
  folder = await temporaryFolder();
  atlas = join(folder.path, "atlas.isonest");
  const table = join(folder.path, "atlas.txt");
  await writeFile(join(folder.path, "atlas.raw"), Buffer.from(atlasValues().buffer));
  await writeFile(table, "2 Left-Kidney 255 0 0 255\n3 Right-Kidney 0 200 0 255\n4 Liver 0 0 255 255\n12 Spleen 9 9 9 255\n");
  await run(program, "preprocess", join(folder.path, "atlas.raw"), "--dims", `${kNodes},${kNodes},${kNodes}`, "--type", "u2", "--unit", "mm", "--labels", "--label-names", table, "-o", atlas);
  server = await startServer(program, atlas, "--port", "0");
  browser = await startBrowser();
});
after(async () => {
  await browser?.close();
  if (server) assert.equal((await server.end()).code, 0);
  await folder?.end();
  setTimeout(() => process.exit(process.exitCode ?? 1), 10_000).unref();
});

const onPage = (url, use) => withPage(browser, url, use);
const rows = (page) => page.$$eval("#labels li", (items) => items.map((item) => [item.querySelector(".label-name").textContent, item.querySelector(".label-size").textContent, item.querySelector("input").checked]));
const layers = (page) => page.evaluate(() => window.isonest.layers());
/** Triangles of a label's smooth mesh. */
const trianglesOf = async (label) => JSON.parse(await run(program, "extract", atlas, "--label", String(label), "--smooth", "--json", "-o", join(folder.path, "one.ply"))).triangles;

test("all labels are listed with their names and numbers of voxels, and found by a search", async () => {
  const counts = new Map();
  for (const label of atlasValues()) counts.set(label, (counts.get(label) ?? 0) + 1);
  const names = { 2: "Left-Kidney", 3: "Right-Kidney", 4: "Liver" };
  const expected = [...counts].sort(([a], [b]) => a - b).map(([label, count]) => [names[label] ?? `Label ${label}`, count.toLocaleString("en"), label === 2]);
  await onPage(server.url, async (page) => {
    assert.deepEqual(await rows(page), expected, "a name without voxels is not listed");
    await page.fill("#label-search", "kidney");
    assert.deepEqual((await rows(page)).map(([name]) => name), ["Left-Kidney", "Right-Kidney"]);
    await page.fill("#label-search", "7");
    assert.deepEqual((await rows(page)).map(([name]) => name), ["Label 7"]);
    await page.fill("#label-search", "nothing");
    assert.match(await page.$eval("#label-note", (note) => note.textContent), /^No label has this name/);
  });
});

test("several labels are shown at a time, smooth and in their colours", async () => {
  await onPage(`${server.url}#iso=2`, async (page) => {
    assert.ok((await state(page)).smooth);
    assert.equal((await header(page)).triangles, await trianglesOf(2));
    const one = await canvas(page);
    for (const name of ["Right-Kidney", "Liver", "Label 9"]) await page.check(`[aria-label="Show ${name}"]`);
    await idle(page);
    const shown = new Map(await layers(page));
    // The label that was checked last stays one of the others; the first one stays selected.
    assert.deepEqual([...shown.keys()].sort(), [3, 4, 9]);
    for (const [label, triangles] of shown) assert.equal(triangles, await trianglesOf(label));
    const all = await canvas(page);
    assert.ok(differing(one, all) > 0.01);
    const has = ({ data, channels }, test) => {
      for (let i = 0; i < data.length; i += channels) if (test(data[i], data[i + 1], data[i + 2])) return true;
      return false;
    };
    assert.ok(has(all, (r, g, b) => r > 90 && g < 20 && b < 20) && has(all, (r, g, b) => g > 70 && r < 20 && b < 20) && has(all, (r, g, b) => b > 90 && r < 20 && g < 20), "red, green and blue are to be seen");
    // Selecting another one changes what is reported, and not what is shown.
    await page.click('.label-name:text-is("Liver")');
    await idle(page);
    assert.equal((await state(page)).iso, 4);
    assert.equal((await header(page)).triangles, shown.get(4));
    assert.deepEqual((await layers(page)).map(([label]) => label).sort(), [2, 3, 9]);
    assert.ok(differing(all, await canvas(page)) < 0.002);
    await page.waitForFunction(() => /shown=/.test(location.hash));
    await onPage(page.url(), async (again) => {
      assert.deepEqual((await layers(again)).map(([label]) => label).sort(), [2, 3, 9]);
      assert.ok(differing(all, await canvas(again)) < 0.002);
    });
    await page.uncheck('[aria-label="Show Liver"]');
    await idle(page);
    assert.notEqual((await state(page)).iso, 4);
    assert.equal((await layers(page)).length, 2);
    await page.click("#labels-none");
    await idle(page);
    assert.deepEqual(await layers(page), []);
    await page.fill("#label-search", "kidney");
    await page.click("#labels-all");
    await idle(page);
    assert.match(await page.$eval("#label-note", (note) => note.textContent), /^[23] of 9 labels shown\.$/);
  });
});

test("all settings of the surface apply to all labels", async () => {
  await onPage(`${server.url}#iso=2&shown=5,6`, async (page) => {
    await page.uncheck("#smooth");
    await idle(page);
    const faces = JSON.parse(await run(program, "extract", atlas, "--label", "5", "--json", "-o", join(folder.path, "five.ply"))).triangles;
    assert.equal(new Map(await layers(page)).get(5), faces);
    await open(page, "clipping");
    await page.check("#box-on");
    await setRange(page, "box-5", 20);
    await idle(page);
    // Label 6 is beyond the box.
    assert.equal(new Map(await layers(page)).get(6), 0);
  });
});

test("a published site lists the names at once, and shows several labels", { skip: !canPublish }, async () => {
  await run(program, "publish", atlas, "-o", join(folder.path, "site"));
  const site = await serveFiles(join(folder.path, "site"));
  await onPage(`${site.url}#iso=2&shown=3`, async (page) => {
    assert.deepEqual((await rows(page)).map(([name, , checked]) => [name, checked]), [["Left-Kidney", true], ["Right-Kidney", true], ["Liver", false], ["Spleen", false]]);
    assert.deepEqual(await layers(page), [[3, await trianglesOf(3)]]);
  });
  await site.end();
});

/** A .npy file of 20^3 int64 or uint16 numbers: a cube of 7 surrounded by 1. */
function labelVolume(kind = "<i8") {
  const header = `{'descr': '${kind}', 'fortran_order': False, 'shape': (20, 20, 20)}`.padEnd(117) + "\n";
  const [numbers, one, seven] = kind === "<i8" ? [new BigInt64Array(20 ** 3), 1n, 7n] : [new Uint16Array(20 ** 3), 1, 7];
  numbers.fill(one);
  for (let i = 0; i < 20 ** 3; ++i) {
    if ([i % 20, Math.floor(i / 20) % 20, Math.floor(i / 400)].every((part) => part >= 6 && part < 14)) numbers[i] = seven;
  }
  return Buffer.concat([Buffer.from("\x93NUMPY\x01\x00v\x00", "latin1"), Buffer.from(header), Buffer.from(numbers.buffer)]);
}

test("for labels, the typed label is shown, and controls for values are hidden", async () => {
  const volume = join(folder.path, "labels.npy");
  const labels = join(folder.path, "labels.isonest");
  await writeFile(volume, labelVolume());
  await run(program, "preprocess", volume, "--labels", "-o", labels);
  const its = await startServer(program, labels, "--port", "0");
  const { page, faults, close } = await openPage(browser, `${its.url}#iso=3&smooth=0`);
  await idle(page);
  assert.equal((await header(page)).triangles, 0);
  await page.fill("#iso-number", "7");
  await page.keyboard.press("Enter");
  await idle(page);
  const report = JSON.parse(await run(program, "extract", labels, "--label", "7", "--json", "-o", join(folder.path, "label.ply")));
  assert.equal((await header(page)).triangles, report.triangles);
  assert.equal(await page.locator("#slices").count(), 0);
  await page.keyboard.press("Tab");
  await page.evaluate(() => document.activeElement.blur());
  await page.keyboard.press("v");
  await page.waitForFunction(() => /label [17]$/.test(document.querySelector("#readout").textContent));
  assert.deepEqual(faults, []);
  await close();
  await its.end();
});

for (const kind of ["<i8", "<u2"]) test(`a switch shows labels smooth or by their voxels (${kind}), also in the URL`, async () => {
  const volume = join(folder.path, "smooth.npy");
  const labels = join(folder.path, "smooth.isonest");
  await writeFile(volume, labelVolume(kind));
  await run(program, "preprocess", volume, "--labels", "--unit", "um", "--frame", "lps", "-o", labels, "--force");
  const its = await startServer(program, labels, "--port", "0");
  const { page, faults, close } = await openPage(browser, `${its.url}#iso=7&target=full&smooth=0`);
  await idle(page);
  assert.deepEqual(await page.$$eval(".axis-name", (names) => names.map((name) => name.textContent)), ["x L", "y P", "z S"]);
  const plain = await canvas(page);
  const steps = await header(page);
  assert.equal(steps.smooth_bound, null);
  await page.check("#smooth");
  await idle(page);
  const shown = await header(page);
  const mesh = join(folder.path, "smooth.ply");
  const command = await commandOf(page, mesh);
  assert.ok(command.includes("--smooth=16"), command.join(" "));
  const report = JSON.parse(await run(program, ...command, "--json"));
  assert.equal(shown.triangles, report.triangles);
  assert.equal(shown.smooth_bound, report.smooth_bound + shown.position_rounding);
  const told = await page.$eval("#surface-bound", (element) => element.textContent);
  assert.ok(Number(/^Smooth, within ([0-9.e-]+) µm of the faces of the voxels$/.exec(told)[1]) >= shown.smooth_bound, told);
  assert.ok(differing(plain, await canvas(page)) > 0.001, "the smooth surface looks as the other one");
  assert.ok(!(await page.isVisible("#target")));
  // The box does not clip a smooth surface, and the panel says so.
  await open(page, "clipping");
  await page.check("#box-on");
  await setRange(page, "box-3", 10);
  await idle(page);
  assert.equal((await header(page)).triangles, shown.triangles);
  assert.match(await page.$eval("#side", (element) => element.textContent), /not clipped to the box/);
  await page.uncheck("#box-on");
  // 64-bit labels start smooth; other whole numbers may be values.
  const inUrl = ([on, is64]) => (is64 ? (on ? !/smooth=/.test(location.hash) : /smooth=0/.test(location.hash)) : on === /smooth=1/.test(location.hash));
  await page.waitForFunction(inUrl, [true, kind === "<i8"]);
  await page.waitForFunction(() => !location.hash.includes("box="));
  const again = await openPage(browser, page.url());
  await idle(again.page);
  assert.deepEqual((await header(again.page)).smooth_bound, shown.smooth_bound);
  // Waits for the page's first URL, as earlier changes are not separate history entries.
  await again.page.waitForTimeout(1500);
  // Waits for the bound only: the number of triangles depends on the target chosen meanwhile.
  const becomes = (bound) => again.page.waitForFunction((b) => window.isonest?.header()?.smooth_bound === b, bound);
  await again.page.uncheck("#smooth");
  await becomes(null);
  await again.page.waitForFunction(inUrl, [false, kind === "<i8"]);
  await again.page.goBack();
  await becomes(shown.smooth_bound);
  await idle(again.page);
  assert.equal((await header(again.page)).triangles, shown.triangles);
  assert.deepEqual([faults, again.faults], [[], []]);
  await again.close();
  await close();
  await its.end();
});

test("a label is shown with its name and colour", async () => {
  const volume = join(folder.path, "named.npy");
  const table = join(folder.path, "named.txt");
  const named = join(folder.path, "named.isonest");
  await writeFile(volume, labelVolume());
  await writeFile(table, "7 Übergang 255 0 0 255\n");
  await run(program, "preprocess", volume, "--labels", "--label-names", table, "-o", named);
  const its = await startServer(program, named, "--port", "0");
  const { page, faults, close } = await openPage(browser, `${its.url}#iso=7`);
  const says = (words) => page.waitForFunction((text) => document.querySelector("#iso-help").textContent.includes(text), words);
  /** The fraction of red pixels, in any shade. */
  const red = async () => {
    await idle(page);
    const { data, width, height, channels } = await canvas(page);
    let count = 0;
    for (let i = 0; i < width * height * channels; i += channels) if (data[i] > 60 && data[i + 1] < data[i] / 4 && data[i + 2] < data[i] / 4) ++count;
    return count / (width * height);
  };
  await says("The surface of Übergang is shown.");
  assert.ok((await red()) > 0.01, `${await red()}`);
  await page.evaluate(() => document.activeElement.blur());
  await page.keyboard.press("v");
  await page.waitForFunction(() => /label (1|7 \(Übergang\))$/.test(document.querySelector("#readout").textContent));
  await page.fill("#iso-number", "1");
  await page.keyboard.press("Enter");
  await says("The surface of this label is shown.");
  assert.equal((await red()), 0);
  assert.deepEqual(faults, []);
  await close();
  await its.end();
});
