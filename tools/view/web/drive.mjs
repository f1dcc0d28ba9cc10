// Starts `isonest view` and opens it in a real Chromium; for tests/view.
import { execFile, spawn } from "node:child_process";
import { existsSync } from "node:fs";
import { mkdtemp, readFile, rm } from "node:fs/promises";
import { createRequire } from "node:module";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { inflateSync } from "node:zlib";

const kChromium = process.env.ISONEST_CHROMIUM ?? "/usr/bin/chromium";
const kTimeout = 120_000; // milliseconds, for any step; the machine may be busy

/** Why there is no browser to drive; otherwise null. */
export function lacks() {
  try {
    createRequire(import.meta.url).resolve("playwright-core");
  } catch {
    return "the page's packages are not installed: tools/install-deps --tests";
  }
  return existsSync(kChromium) ? null : `${kChromium} is missing: tools/install-deps --tests`;
}

/** The program's standard output; rejects with its error message. */
export function run(program, ...args) {
  return new Promise((resolve, reject) => {
    execFile(program, args, { maxBuffer: 1 << 28 }, (error, stdout, stderr) => (error ? reject(new Error(`${args.join(" ")}: ${stderr || error}`)) : resolve(stdout)));
  });
}

/** A temporary folder, removed by end(). */
export async function temporaryFolder() {
  const path = await mkdtemp(join(tmpdir(), "isonest-view-"));
  return { path, end: () => rm(path, { recursive: true, force: true }) };
}

/** `isonest view`, with .url, .pid and end(), which gives the exit code and the standard error output. */
export async function startServer(program, store, ...options) {
  const child = spawn(program, ["view", store, "--json", ...options], { stdio: ["ignore", "pipe", "pipe"] });
  let errors = "";
  let output = "";
  child.stderr.on("data", (data) => (errors += data));
  const ended = new Promise((resolve) => child.on("close", (code, signal) => resolve({ code: code ?? signal, errors })));
  const url = await new Promise((resolve, reject) => {
    child.stdout.on("data", (data) => {
      output += data;
      if (output.includes("\n")) resolve(JSON.parse(output.slice(0, output.indexOf("\n"))).url);
    });
    ended.then(({ code }) => reject(new Error(`isonest view ended with ${code}: ${errors}`)));
  });
  return {
    url,
    pid: child.pid,
    end: (signal = "SIGINT") => {
      child.kill(signal);
      return ended;
    },
  };
}

/** Chromium with software rendering. The caller closes it. */
export async function startBrowser(...more) {
  const { chromium } = await import("playwright-core");
  return chromium.launch({
    executablePath: kChromium,
    timeout: kTimeout,
    args: [
      "--no-sandbox", "--disable-gpu", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-quic", "--no-first-run",
      "--disable-background-networking", "--disable-component-update", "--disable-sync", "--enable-precise-memory-info", ...more,
    ],
  });
}

/** A page of the server. `faults` collects what must not happen: errors, requests to other servers, policy violations. */
export async function openPage(browser, url, options = {}) {
  const context = await browser.newContext({ viewport: { width: 880, height: 560 }, acceptDownloads: true, ...options });
  const page = await context.newPage();
  page.setDefaultTimeout(kTimeout);
  const faults = [];
  const origin = new URL(url).origin;
  page.on("pageerror", (error) => faults.push(`error: ${error.message}`));
  page.on("console", (message) => {
    if (message.type() === "error" && !/status of 4(09|10)|ERR_ABORTED|ERR_CONNECTION/.test(message.text())) faults.push(`console: ${message.text()}`);
  });
  page.on("request", (request) => {
    if (!request.url().startsWith(origin) && !/^(data|blob):/.test(request.url())) faults.push(`request: ${request.url()}`);
  });
  await page.goto(url);
  await page.waitForFunction(() => window.isonest || document.querySelector("#banner:not([hidden]), #no-webgl"));
  return { page, faults, close: () => context.close() };
}

/** Waits until nothing is in progress and the picture is up to date. */
export async function idle(page) {
  await page.evaluate(() => window.isonest.idle());
}

/** A PNG with 8 bits and 3 or 4 channels: {width, height, channels, data}. */
export async function readPng(fileOrBuffer) {
  const bytes = typeof fileOrBuffer === "string" ? await readFile(fileOrBuffer) : fileOrBuffer;
  let at = 8;
  let header = null;
  const parts = [];
  while (at < bytes.length) {
    const length = bytes.readUInt32BE(at);
    const name = bytes.toString("latin1", at + 4, at + 8);
    const body = bytes.subarray(at + 8, at + 8 + length);
    if (name === "IHDR") header = { width: body.readUInt32BE(0), height: body.readUInt32BE(4), depth: body[8], type: body[9], interlaced: body[12] };
    if (name === "IDAT") parts.push(body);
    at += 12 + length;
  }
  const channels = { 2: 3, 6: 4 }[header.type];
  if (header.depth !== 8 || !channels || header.interlaced) throw new Error("a PNG that is not read here");
  const raw = inflateSync(Buffer.concat(parts));
  const { width, height } = header;
  const row = width * channels;
  const data = new Uint8Array(row * height);
  for (let y = 0; y < height; ++y) {
    const filter = raw[y * (row + 1)];
    for (let i = 0; i < row; ++i) {
      const left = i >= channels ? data[y * row + i - channels] : 0;
      const up = y > 0 ? data[(y - 1) * row + i] : 0;
      const corner = y > 0 && i >= channels ? data[(y - 1) * row + i - channels] : 0;
      const guess = [0, left, up, (left + up) >> 1, paeth(left, up, corner)][filter];
      data[y * row + i] = raw[y * (row + 1) + 1 + i] + guess;
    }
  }
  return { width, height, channels, data };
}

function paeth(left, up, corner) {
  const guess = left + up - corner;
  const [a, b, c] = [left, up, corner].map((one) => Math.abs(guess - one));
  return a <= b && a <= c ? left : b <= c ? up : corner;
}
