// The parts of the page that several tests read and use.
import assert from "node:assert/strict";
import { readPng } from "../../tools/view/web/drive.mjs";

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
/** The fraction of pixels that differ by more than `by` in a colour. */
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

/** Runs in the page: the WCAG contrast of each text with its background. */
export function faintTexts() {
  const context = new OffscreenCanvas(1, 1).getContext("2d", { willReadFrequently: true });
  const over = (color, below) => {
    context.globalCompositeOperation = "copy";
    context.fillStyle = `rgb(${below.join(" ")})`;
    context.fillRect(0, 0, 1, 1);
    context.globalCompositeOperation = "source-over";
    context.fillStyle = color;
    context.fillRect(0, 0, 1, 1);
    return [...context.getImageData(0, 0, 1, 1).data.slice(0, 3)];
  };
  const light = (color) => {
    const [r, g, b] = color.map((part) => (part / 255 <= 0.04045 ? part / 255 / 12.92 : ((part / 255 + 0.055) / 1.055) ** 2.4));
    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
  };
  const background = (element) => {
    if (!element) return [255, 255, 255];
    return over(getComputedStyle(element).backgroundColor, background(element.parentElement));
  };
  const faint = [];
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  for (let node = walker.nextNode(); node; node = walker.nextNode()) {
    const element = node.parentElement;
    if (!node.textContent.trim() || !element.checkVisibility() || element.closest("svg")) continue;
    const behind = background(element);
    const [low, high] = [light(behind), light(over(getComputedStyle(element).color, behind))].sort((a, b) => a - b);
    if ((high + 0.05) / (low + 0.05) < 4.5) faint.push(`${node.textContent}: ${((high + 0.05) / (low + 0.05)).toFixed(2)}`);
  }
  return faint;
}
