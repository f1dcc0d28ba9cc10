// Converts the view to the URL's fragment and back. Default values are omitted.
import type { Box, Vector } from "./protocol";
import { kSliceNames, type ViewState, type ViewStore } from "./state";

const kTargets = ["screen", "full", "error", "distance", "triangles"] as const;
const kNumbers = ["step", "iso", "pixels", "error", "distance", "triangles", "moving", "most", "turn", "tilt"] as const;
const kFlags = ["surface", "largest", "smooth", "facets", "outline"] as const;
const kThemes = ["auto", "light", "dark"] as const;
const kProjections = ["perspective", "orthographic"] as const;
const kRest = 300; // milliseconds without a change before the URL is updated

export function toFragment(state: ViewState, start: ViewState): string {
  const parts: string[] = [];
  const add = (name: string, value: string, standard: string): void => {
    if (value !== standard) parts.push(`${name}=${encodeURIComponent(value).replaceAll("%2C", ",")}`);
  };
  for (const key of kNumbers) add(key, String(state[key]), key === "iso" ? "" : String(start[key]));
  for (const key of kFlags) add(key, state[key] ? "1" : "0", start[key] ? "1" : "0");
  for (const key of ["target", "map", "color", "colorMap", "theme", "projection"] as const) add(key, state[key], start[key]);
  add("shown", state.shown.join(","), "");
  add("box", state.box?.join(",") ?? "", "");
  for (const name of kSliceNames) {
    const text = ({ on, at }: { on: boolean; at: number }): string => `${on ? 1 : 0},${at}`;
    add(`slice-${name}`, text(state.slices[name]), text(start.slices[name]));
  }
  add("window", state.window.join(","), start.window.join(","));
  add("colorWindow", state.colorWindow.join(","), start.colorWindow.join(","));
  add("camera", [...state.eye, ...state.lookAt].map(short).join(","), [...start.eye, ...start.lookAt].map(short).join(","));
  return parts.join("&");
}

/** Invalid values are replaced by the defaults. `steps`: the number of steps of the series, 1 for one store. */
export function fromFragment(fragment: string, start: ViewState, steps: number): ViewState {
  const query = new URLSearchParams(fragment.replace(/^#/, ""));
  const state: { -readonly [K in keyof ViewState]: ViewState[K] } = { ...start };
  const numbers = (name: string, count: number): number[] | null => {
    const list = query.get(name)?.split(",").map((part) => (part.trim() === "" ? NaN : Number(part)));
    return list?.length === count && list.every(Number.isFinite) ? list : null;
  };
  const choice = <T extends string>(name: string, choices: readonly T[], standard: T): T =>
    choices.find((one) => one === query.get(name)) ?? standard;
  for (const key of kNumbers) state[key] = numbers(key, 1)?.[0] ?? start[key];
  for (const key of ["pixels", "triangles", "moving", "most"] as const) if (!(state[key] > 0)) state[key] = start[key];
  for (const key of ["error", "distance"] as const) if (!(state[key] >= 0)) state[key] = start[key];
  if (!(Number.isInteger(state.step) && state.step >= 0 && state.step < steps)) state.step = start.step;
  for (const key of kFlags) if (query.has(key)) state[key] = query.get(key) === "1";
  state.target = choice("target", kTargets, start.target);
  state.theme = choice("theme", kThemes, start.theme);
  state.projection = choice("projection", kProjections, start.projection);
  for (const key of ["map", "color", "colorMap"] as const) state[key] = query.get(key) ?? start[key];
  const shown = query.get("shown")?.split(",").map(Number) ?? [];
  state.shown = shown.every(Number.isSafeInteger) ? shown : [];
  const box = numbers("box", 6) as unknown as Box | null;
  state.box = box && box[0] < box[3] && box[1] < box[4] && box[2] < box[5] ? box : null;
  const slices = { ...start.slices };
  for (const name of kSliceNames) {
    const slice = numbers(`slice-${name}`, 2);
    if (slice) slices[name] = { on: slice[0] === 1, at: slice[1] ?? 0 };
  }
  state.slices = slices;
  for (const key of ["window", "colorWindow"] as const) {
    const window = numbers(key, 2) as [number, number] | null;
    if (window && window[0] < window[1]) state[key] = window;
  }
  const camera = numbers("camera", 6);
  const eye = camera?.slice(0, 3) as unknown as Vector | undefined;
  const lookAt = camera?.slice(3) as unknown as Vector | undefined;
  if (eye && lookAt && Math.hypot(eye[0] - lookAt[0], eye[1] - lookAt[1], eye[2] - lookAt[2]) > 0) {
    state.eye = eye;
    state.lookAt = lookAt;
  }
  return state;
}

/** Seven digits are precise enough for a camera. */
function short(value: number): string {
  return String(Number(value.toPrecision(7)));
}

/** Keeps URL and view in sync. Each choice is a history entry for "back", except camera moves and the time. */
export function bindFragment(store: ViewStore, start: ViewState, steps: number): void {
  let timer = 0;
  let step = false;
  let reading = false;
  let first = true;
  const write = (): void => {
    const url = `${location.pathname}${location.search}#${toFragment(store.state, start)}`;
    const pushes = step && !first;
    first = step = false;
    if (url === location.pathname + location.search + location.hash) return;
    if (pushes) history.pushState(null, "", url);
    else history.replaceState(null, "", url);
  };
  store.subscribe((_state, changed) => {
    if (reading) return;
    step ||= [...changed].some((key) => key !== "eye" && key !== "lookAt" && key !== "step");
    clearTimeout(timer);
    timer = setTimeout(write, kRest);
  });
  addEventListener("popstate", () => {
    clearTimeout(timer);
    reading = true;
    store.set(fromFragment(location.hash, start, steps));
    reading = false;
  });
}
