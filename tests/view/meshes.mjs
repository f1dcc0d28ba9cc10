// Meshes for the tests: reads PLY files, and computes the camera that `isonest picture` uses.
import { readFile } from "node:fs/promises";

/** Reads a binary little-endian PLY file with float x, y, z as the first properties. */
export async function readPly(path) {
  const bytes = await readFile(path);
  const begin = bytes.indexOf("end_header\n") + "end_header\n".length;
  const lines = bytes.toString("latin1", 0, begin).split("\n");
  const vertices = Number(lines.find((line) => line.startsWith("element vertex")).split(" ")[2]);
  const properties = lines.slice(lines.findIndex((line) => line.startsWith("element vertex")) + 1, lines.findIndex((line) => line.startsWith("element face")));
  if (!properties.every((line) => line.startsWith("property float "))) throw new Error(`${path}: a PLY that is not read here`);
  const stride = 4 * properties.length;
  const at = (i) => [0, 4, 8].map((offset) => bytes.readFloatLE(begin + i * stride + offset));
  return {
    vertices,
    at,
    /** The vertex that is farthest in a direction. */
    nearestTo(direction) {
      let best = at(0);
      for (let i = 1; i < vertices; ++i) if (dot(at(i), direction) > dot(best, direction)) best = at(i);
      return best;
    },
  };
}

const kFieldOfView = 30; // degrees, as in the page
const kMargin = 0.05; // on each side, relative to the picture

/** The camera for the picture of `isonest picture --view`: see tools/drawing/picture_frame.cpp, gl_canvas.cpp. */
export function pictureView(mesh, view, [width, height]) {
  const towardEye = unit(view);
  const right = unit(cross([0, 0, 1], towardEye));
  const up = cross(towardEye, right);
  const axes = [right, up, towardEye];
  const low = [Infinity, Infinity, Infinity];
  const high = [-Infinity, -Infinity, -Infinity];
  for (let i = 0; i < mesh.vertices; ++i) {
    axes.forEach((axis, k) => {
      const place = dot(mesh.at(i), axis);
      low[k] = Math.min(low[k], place);
      high[k] = Math.max(high[k], place);
    });
  }
  const half = [0, 1].map((k) => ((high[k] - low[k]) / 2) * (1 + 2 * kMargin));
  const halfHeight = Math.max(half[0], (half[1] * width) / height) * (height / width);
  const lookAt = [0, 1, 2].map((i) => axes.reduce((sum, axis, k) => sum + (axis[i] * (low[k] + high[k])) / 2, 0));
  const distance = halfHeight / Math.tan((kFieldOfView / 2) * (Math.PI / 180));
  return { eye: lookAt.map((part, i) => part + towardEye[i] * distance), lookAt };
}

function dot(a, b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}
function cross(a, b) {
  return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
}
function unit(a) {
  const length = Math.hypot(...a);
  return a.map((part) => part / length);
}
