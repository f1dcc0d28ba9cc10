// Shading of surfaces and slices. The surface is lit like in `isonest picture`.
import { DataTexture, DoubleSide, GLSL3, LinearFilter, RawShaderMaterial, RGBAFormat, Vector3 } from "three";
import maps from "isonest:color-maps";
import type { MeshHeader } from "./protocol";

const kHead = `precision highp float;
precision highp int;
`;

const kVertex = `${kHead}
uniform mat4 modelViewMatrix, projectionMatrix, viewMatrix;
in vec4 position; // in quantisation steps; w: a slice's value
in vec4 normal;
uniform float missingStep; // that of a missing value
out vec3 toEye, turned;
out float value, missing;
void main() {
  vec4 place = modelViewMatrix * vec4(position.xyz, 1.0);
  toEye = -place.xyz;
  turned = mat3(viewMatrix) * normal.xyz;
  value = position.w;
  missing = position.w == missingStep ? 1.0 : 0.0;
  gl_Position = projectionMatrix * place;
}`;

const kSurface = `${kHead}
uniform bool facets, colored;
uniform vec3 front, back;
uniform sampler2D map;
uniform vec2 window; // as for slices
in vec3 toEye, turned;
in float value, missing;
out vec4 color;
void main() {
  vec3 across = cross(dFdx(toEye), dFdy(toEye)); // faces the eye
  vec3 n = facets || dot(turned, turned) < 1e-6 ? normalize(across) : normalize(gl_FrontFacing ? turned : -turned);
  // A strong light from the upper left, a weak one from the right, and ambient light.
  float strong = max(dot(n, normalize(vec3(-0.45, 0.65, 0.9))), 0.0);
  float weak = max(dot(n, normalize(vec3(0.8, -0.1, 0.5))), 0.0);
  vec3 light = vec3(0.30, 0.30, 0.32) + 0.72 * strong + 0.2 * weak;
  vec3 own = gl_FrontFacing ? front : back;
  if (colored) {
    float t = clamp(value * window.x + window.y, 0.0, 1.0);
    own = missing > 0.0 ? vec3(0.55) : texture(map, vec2((t * 255.0 + 0.5) / 256.0, 0.5)).rgb;
  }
  color = vec4(min(own * light, 1.0), 1.0);
}`;

const kSlice = `${kHead}
uniform sampler2D map;
uniform vec2 window; // maps a quantised value (times x, plus y) to 0 at the first colour and 1 at the last
in float value;
out vec4 color;
void main() {
  float t = clamp(value * window.x + window.y, 0.0, 1.0);
  color = vec4(texture(map, vec2((t * 255.0 + 0.5) / 256.0, 0.5)).rgb, 1.0);
}`;

/** The depth, from 0 at the near to 1 at the far plane, in 24 bits, and the id of the mesh. */
const kPick = `${kHead}
uniform vec2 reach;
uniform float id;
in vec3 toEye;
out vec4 color;
void main() {
  float t = clamp((toEye.z - reach.x) / (reach.y - reach.x), 0.0, 1.0) * 16777215.0;
  float high = floor(t / 65536.0);
  float middle = floor((t - high * 65536.0) / 256.0);
  color = vec4(high, middle, t - high * 65536.0 - middle * 256.0, id) / 255.0;
}`;

function material(fragmentShader: string, uniforms: RawShaderMaterial["uniforms"]): RawShaderMaterial {
  return new RawShaderMaterial({ glslVersion: GLSL3, vertexShader: kVertex, fragmentShader, uniforms, side: DoubleSide });
}

const kFront = [110 / 255, 156 / 255, 204 / 255] as const; // the side with smaller values

/** Colour of the side with smaller values; null: the default. */
export function setSurfaceColor(surface: RawShaderMaterial, color: readonly [number, number, number] | null): void {
  const front = color ?? kFront;
  const warm = [0.85, 0.72, 0.6] as const;
  const back = warm.map((part, i) => 0.75 * part + 0.25 * (front[i] ?? 0)) as [number, number, number];
  surface.uniforms.front = { value: new Vector3(...front) };
  surface.uniforms.back = { value: new Vector3(...back) };
}

export function surfaceMaterial(): RawShaderMaterial {
  const made = material(kSurface, {
    facets: { value: false }, front: { value: new Vector3() }, back: { value: new Vector3() },
    colored: { value: false }, map: { value: null }, window: { value: [0, 0] }, missingStep: { value: -1 },
  });
  setSurfaceColor(made, null);
  return made;
}

export function sliceMaterial(): RawShaderMaterial {
  const made = material(kSlice, { map: { value: null }, window: { value: [0, 0] }, missingStep: { value: -1 } });
  // Draws it in front where it coincides with a surface.
  made.polygonOffset = true;
  made.polygonOffsetFactor = -1;
  made.polygonOffsetUnits = -1;
  return made;
}

export function pickMaterial(id: number): RawShaderMaterial {
  return material(kPick, { reach: { value: [0, 1] }, id: { value: id }, missingStep: { value: -1 } });
}

/** Colours a mesh by its vertices' values: from the first to the last colour over `window`. `colored`: it has values. */
export function paintByValue(surface: RawShaderMaterial, header: MeshHeader | null, map: string, window: readonly [number, number], colored: boolean): void {
  const { uniforms } = surface;
  const texture = uniforms.map;
  if (texture && texture.value?.name !== map) {
    texture.value?.dispose();
    texture.value = mapTexture(map);
    texture.value.name = map;
  }
  const { value_origin = 0, value_step = 0, value_missing = -1 } = header ?? {};
  const width = window[1] - window[0];
  if (uniforms.window) uniforms.window.value = [value_step / width, (value_origin - window[0]) / width];
  if (uniforms.missingStep) uniforms.missingStep.value = value_missing;
  if (uniforms.colored) uniforms.colored.value = colored;
}

export const kMapNames: readonly string[] = Object.keys(maps);

/** Red, green, blue, 0 to 255 each; `t` from 0 to 1. */
export function colorOf(map: string, t: number): [number, number, number] {
  const digits = maps[map] ?? maps.gray ?? "";
  const last = digits.length / 6 - 1;
  const place = Math.min(Math.max(t, 0), 1) * last;
  const i = Math.min(Math.floor(place), last - 1);
  const channel = (index: number, c: number): number => parseInt(digits.substr(6 * index + 2 * c, 2), 16);
  const mixed = (c: number): number => channel(i, c) + (place - i) * (channel(i + 1, c) - channel(i, c));
  return [mixed(0), mixed(1), mixed(2)];
}

export function mapTexture(map: string): DataTexture {
  const data = new Uint8Array(4 * 256);
  for (let i = 0; i < 256; ++i) data.set([...colorOf(map, i / 255).map(Math.round), 255], 4 * i);
  const texture = new DataTexture(data, 256, 1, RGBAFormat);
  texture.magFilter = texture.minFilter = LinearFilter;
  texture.needsUpdate = true;
  return texture;
}
