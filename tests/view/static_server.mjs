// A plain web server for files, with ranges and media types. It records the requests.
import { createReadStream } from "node:fs";
import { readFile, stat } from "node:fs/promises";
import { createServer } from "node:http";
import { extname, join, normalize } from "node:path";
import { Readable } from "node:stream";
import { gzipSync } from "node:zlib";

const kTypes = {
  ".html": "text/html; charset=utf-8", ".js": "text/javascript", ".mjs": "text/javascript", ".css": "text/css", ".wasm": "application/wasm",
  ".json": "application/json", ".txt": "text/plain",
};
export const kShared = {
  "Access-Control-Allow-Origin": "*", "Access-Control-Expose-Headers": "ETag", "Access-Control-Allow-Headers": "Range",
};

const kPiece = 16384;

function* piecesOf(bytes) {
  for (let at = 0; at < bytes.length; at += kPiece) yield bytes.subarray(at, at + kPiece);
}

/**
 * Serves `folder`. Returns .url, .requests (a list of {method, path, range, host, closed}), and end(). `headers`: added
 * to all answers; `ranges`: supports range requests; `compressed`: sends files of known types as gzip; `delay`:
 * milliseconds before each answer; `rate`: bytes per second of all answers together; `handle(request, response)`:
 * returns true if it has answered the request itself.
 */
export async function serveFiles(folder, { headers = {}, ranges = true, compressed = false, delay = 0, rate = 0, handle } = {}) {
  const requests = [];
  let free = 0; // time at which the simulated line is free
  const pass = async (bytes) => {
    if (rate === 0) return;
    free = Math.max(free, Date.now()) + (1000 * bytes) / rate;
    await new Promise((resolve) => setTimeout(resolve, free - Date.now()));
  };
  const answer = async (request, response, note) => {
    const path = normalize(decodeURIComponent(new URL(request.url, "http://any").pathname));
    for (const [name, value] of Object.entries(headers)) response.setHeader(name, value);
    if (await handle?.(request, response, note)) return;
    if (delay > 0) await new Promise((resolve) => setTimeout(resolve, delay));
    if (request.method === "OPTIONS") return response.writeHead(headers["Access-Control-Allow-Headers"] ? 204 : 405).end();
    const file = join(folder, path.endsWith("/") ? `${path}index.html` : path);
    const found = await stat(file).catch(() => null);
    if (!found?.isFile()) return response.writeHead(404).end("nothing here");
    response.setHeader("Content-Type", kTypes[extname(file)] ?? "application/octet-stream");
    response.setHeader("ETag", `"${found.mtimeMs.toString(36)}-${found.size}"`);
    const [, from, to] = (ranges && /^bytes=(\d*)-(\d*)$/.exec(request.headers.range ?? "")) || [];
    let [first, last] = [0, found.size - 1];
    if (from !== undefined) {
      first = from === "" ? Math.max(0, found.size - Number(to)) : Number(from);
      last = from === "" || to === "" ? last : Math.min(Number(to), last);
      if (first > last) return response.writeHead(416, { "Content-Range": `bytes */${found.size}` }).end();
      response.setHeader("Content-Range", `bytes ${first}-${last}/${found.size}`);
    }
    const packed = compressed && from === undefined && kTypes[extname(file)] && /gzip/.test(request.headers["accept-encoding"] ?? "") ? gzipSync(await readFile(file)) : null;
    if (packed) response.setHeader("Content-Encoding", "gzip");
    response.writeHead(from === undefined ? 200 : 206, { "Content-Length": packed?.length ?? last + 1 - first });
    if (request.method === "HEAD") return response.end();
    const pieces = packed ? piecesOf(packed) : createReadStream(file, { start: first, end: last, highWaterMark: kPiece });
    for await (const piece of Readable.from(pieces)) {
      if (response.destroyed) return;
      await pass(piece.length);
      note.bytes += piece.length;
      response.write(piece);
    }
    response.end();
  };
  const server = createServer((request, response) => {
    const note = { method: request.method, path: request.url, range: request.headers.range ?? null, host: request.headers.host, bytes: 0, aborted: false };
    requests.push(note);
    response.on("close", () => (note.aborted = !response.writableFinished));
    answer(request, response, note).catch((error) => response.destroy(error));
  });
  await new Promise((resolve) => server.listen(0, "127.0.0.1", resolve));
  return {
    url: `http://127.0.0.1:${server.address().port}/`,
    requests,
    end: () => new Promise((resolve) => (server.close(resolve), server.closeAllConnections())),
  };
}
