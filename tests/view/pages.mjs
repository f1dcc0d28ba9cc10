// What tests do with a page of the viewer.
import assert from "node:assert/strict";
import { idle, openPage, readPng } from "../../tools/view/web/drive.mjs";

/** Calls `use` with the page once it is at rest; nothing may have failed on it by the end. */
export async function withPage(browser, url, use) {
  const { page, faults, close } = await openPage(browser, url);
  try {
    await page.waitForFunction(() => window.isonest);
    await idle(page);
    await use(page);
    assert.deepEqual(faults, []);
  } finally {
    await close();
  }
}

export const state = (page) => page.evaluate(() => window.isonest.state());
export const header = (page, slice) => page.evaluate((name) => window.isonest.header(name), slice);
export const setRange = (page, id, value) =>
  page.$eval(`#${id}`, (input, text) => {
    input.value = text;
    input.dispatchEvent(new Event("input", { bubbles: true }));
  }, String(value));
export const open = (page, id) => page.$eval(`#${id}`, (section) => (section.open = true));

/** The pixels of the canvas, without text drawn over it. */
export async function canvas(page) {
  await page.$eval(".overlay", (overlay) => overlay.setAttribute("visibility", "hidden"));
  const picture = await readPng(await page.locator("#canvas").screenshot());
  await page.$eval(".overlay", (overlay) => overlay.removeAttribute("visibility"));
  return picture;
}
export function differing(a, b, by = 24) {
  assert.deepEqual([a.width, a.height], [b.width, b.height]);
  let count = 0;
  for (let i = 0; i < a.width * a.height; ++i) {
    const [p, q] = [i * a.channels, i * b.channels];
    if ([0, 1, 2].some((c) => Math.abs(a.data[p + c] - b.data[q + c]) > by)) ++count;
  }
  return count / (a.width * a.height);
}

/** The command displayed by the page, with another output. */
export async function commandOf(page, output) {
  await open(page, "export");
  await page.waitForFunction(() => /^isonest /.test(document.querySelector("#command").textContent));
  const text = await page.$eval("#command", (element) => element.textContent);
  const [name, ...parts] = text.trim().split(" "); // no argument contains a space
  assert.equal(name, "isonest");
  return [...parts.slice(0, parts.lastIndexOf("-o")), "-o", output];
}
