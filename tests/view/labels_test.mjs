// Tests the page of `isonest view` with stores of labels, in Chromium. usage: labels_test.mjs ISONEST
//
// The store has a cube of label 7 surrounded by label 1. The page is compared with `isonest extract`.
// Exit code 77 with a message: no browser is available.
import assert from "node:assert/strict";
import { writeFile } from "node:fs/promises";
import { join } from "node:path";
import { after, before, test as anyTest } from "node:test";
import { idle, lacks, openPage, run, startBrowser, startServer, temporaryFolder } from "../../tools/view/web/drive.mjs";
import { canvas, commandOf, differing, header, open, setRange } from "./page_parts.mjs";

const [, , program] = process.argv;
const reason = lacks() ?? (/^ +view /m.test(await run(program, "--help")) ? null : "the program was built without isonest view");
if (reason) {
  console.log(`skipped: ${reason}`);
  process.exit(77);
}

const test = (name, body) => anyTest(name, { timeout: 240_000 }, body);
let folder, browser;

before(async () => {
  folder = await temporaryFolder();
  browser = await startBrowser();
});
after(async () => {
  await browser?.close();
  await folder?.end();
  // Ends this program even if a failed test has left something running.
  setTimeout(() => process.exit(process.exitCode ?? 1), 10_000).unref();
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
  const { page, faults, close } = await openPage(browser, `${its.url}#iso=3`);
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

for (const kind of ["<i8", "<u2"]) test(`a switch shows smooth labels (${kind}), also in the URL`, async () => {
  const volume = join(folder.path, "smooth.npy");
  const labels = join(folder.path, "smooth.isonest");
  await writeFile(volume, labelVolume(kind));
  await run(program, "preprocess", volume, "--labels", "--unit", "um", "--frame", "lps", "-o", labels, "--force");
  const its = await startServer(program, labels, "--port", "0");
  const { page, faults, close } = await openPage(browser, `${its.url}#iso=7&target=full`);
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
  await page.waitForFunction(() => /[#&]smooth=1(&|$)/.test(location.hash) && !location.hash.includes("box="));
  const again = await openPage(browser, page.url());
  await idle(again.page);
  assert.deepEqual((await header(again.page)).smooth_bound, shown.smooth_bound);
  // Waits for the page's first URL, as earlier changes are not separate history entries.
  await again.page.waitForTimeout(1500);
  // Waits for the bound only: the number of triangles depends on the target chosen meanwhile.
  const becomes = (bound) => again.page.waitForFunction((b) => window.isonest?.header()?.smooth_bound === b, bound);
  await again.page.uncheck("#smooth");
  await becomes(null);
  await again.page.waitForFunction(() => !location.hash.includes("smooth"));
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
