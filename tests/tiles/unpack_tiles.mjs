// Unpacks tiles (EXT_meshopt_compression) by meshoptimizer's own decoder, for readers that do not know the extension.
// usage: node unpack_tiles.mjs NODE_MODULES FOLDER: FOLDER/NAME.glb becomes FOLDER/NAME.glb.bin, the unpacked buffer views
// one after another, each at a multiple of 8 bytes
import fs from 'node:fs';
import path from 'node:path';
import { pathToFileURL } from 'node:url';

const [modules, folder] = process.argv.slice(2);
const { MeshoptDecoder } = await import(pathToFileURL(path.join(modules, 'meshoptimizer/index.js')).href);
await MeshoptDecoder.ready;

for (const name of fs.readdirSync(folder, { recursive: true })) {
  if (!name.endsWith('.glb')) continue;
  const file = fs.readFileSync(path.join(folder, name));
  const length = file.readUInt32LE(12);
  const head = JSON.parse(file.toString('utf8', 20, 20 + length));
  const body = file.subarray(28 + length);
  const parts = [];
  for (const view of head.bufferViews) {
    const packed = view.extensions?.EXT_meshopt_compression;
    const bytes = new Uint8Array(Math.ceil(view.byteLength / 8) * 8);
    if (packed) {
      const source = body.subarray(packed.byteOffset, packed.byteOffset + packed.byteLength);
      MeshoptDecoder.decodeGltfBuffer(bytes.subarray(0, packed.count * packed.byteStride), packed.count, packed.byteStride,
                                      source, packed.mode, packed.filter);
    } else {
      bytes.set(body.subarray(view.byteOffset, view.byteOffset + view.byteLength));
    }
    parts.push(bytes);
  }
  fs.writeFileSync(path.join(folder, `${name}.bin`), Buffer.concat(parts));
}
