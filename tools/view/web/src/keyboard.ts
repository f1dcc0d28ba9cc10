// Keyboard shortcuts, and the dialog that lists them.
import type { CameraMoves } from "./camera_moves";
import { button, h } from "./dom";
import { reachOf } from "./geometry";
import type { HistogramPanel } from "./panels/histogram";
import type { Player } from "./player";
import type { Probe } from "./probe";
import type { StoreInfo } from "./protocol";
import { kSliceNames, type SliceName, type ViewStore } from "./state";

const kDegrees = 5;
const kShift = 0.05;
const kZoom = 0.9;
const kStep = 0.01;
const kBigStep = 0.1;

interface Key {
  /** As in KeyboardEvent.key; prefixed with Shift+ if that key must be held. */
  readonly keys: readonly string[];
  readonly shown: string;
  readonly does: string;
  readonly act: (key: string) => void;
}

export interface KeyTargets {
  readonly views: ViewStore;
  readonly store: StoreInfo;
  readonly moves: CameraMoves;
  readonly histogram: HistogramPanel;
  readonly probe: Probe;
  readonly player: Player;
  readonly dialog: HTMLDialogElement;
  savePicture(): Promise<void>;
}

function keysOf(t: KeyTargets): readonly Key[] {
  const { views, moves, histogram, probe } = t;
  const slice = (name: SliceName): void => views.setSlice(name, { on: !views.state.slices[name].on });
  let last: SliceName = "z";
  const shift = (by: number): void => {
    const name = views.state.slices[last].on ? last : kSliceNames.find((one) => views.state.slices[one].on);
    if (!name) return;
    const [least, largest] = reachOf(name, views.state, t.store);
    views.setSlice(name, { at: Math.min(Math.max(views.state.slices[name].at + by * (largest - least), least), largest) });
  };
  const turns: Readonly<Record<string, readonly [number, number]>> = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
  const along = (key: string): readonly [number, number] => turns[key.replace("Shift+", "")] ?? [0, 0];
  const arrows = Object.keys(turns);
  return [
    { keys: arrows, shown: "arrows", does: "turn the view", act: (key) => moves.turn(along(key)[0] * kDegrees, along(key)[1] * kDegrees) },
    { keys: arrows.map((key) => `Shift+${key}`), shown: "Shift + arrows", does: "shift the view", act: (key) => moves.shift(along(key)[0] * kShift, along(key)[1] * kShift) },
    { keys: ["+", "="], shown: "+", does: "nearer", act: () => moves.zoom(kZoom) },
    { keys: ["-"], shown: "−", does: "further away", act: () => moves.zoom(1 / kZoom) },
    { keys: ["0"], shown: "0", does: "the whole volume", act: () => moves.home() },
    {
      keys: ["1", "2", "3", "4", "5", "6"], shown: "1 … 6", does: "from the front, back, left, right, top, bottom",
      act: (key) => moves.from(["front", "back", "left", "right", "top", "bottom"][Number(key) - 1] ?? ""),
    },
    { keys: ["."], shown: ".", does: "a higher isovalue", act: () => histogram.step(kStep) },
    { keys: [","], shown: ",", does: "a lower isovalue", act: () => histogram.step(-kStep) },
    { keys: [">", "Shift+>"], shown: ">", does: "a much higher isovalue", act: () => histogram.step(kBigStep) },
    { keys: ["<", "Shift+<"], shown: "<", does: "a much lower isovalue", act: () => histogram.step(-kBigStep) },
    ...(t.store.series ? timeKeys(t.player) : []),
    { keys: ["s"], shown: "S", does: "show or hide the surface", act: () => views.set({ surface: !views.state.surface }) },
    { keys: ["x", "y", "z", "o"], shown: "X Y Z O", does: "show or hide a slice", act: (key) => slice((last = key as SliceName)) },
    { keys: ["PageUp", "]"], shown: "Page Up, ]", does: "move the slice that was shown last", act: () => shift(kStep) },
    { keys: ["PageDown", "["], shown: "Page Down, [", does: "move it back", act: () => shift(-kStep) },
    { keys: ["b"], shown: "B", does: "clip to a box, or not", act: () => views.set({ box: views.state.box ? null : t.store.box }) },
    { keys: ["p"], shown: "P", does: "with or without perspective", act: () => views.set({ projection: views.state.projection === "perspective" ? "orthographic" : "perspective" }) },
    { keys: ["t"], shown: "T", does: "show the triangles", act: () => views.set({ facets: !views.state.facets }) },
    { keys: ["v"], shown: "V", does: "the value in the middle of the picture", act: () => void probe.readMiddle() },
    { keys: ["m"], shown: "M", does: "mark the middle, for a distance", act: () => void probe.markMiddle() },
    { keys: ["Escape"], shown: "Escape", does: "no marks, no measuring", act: () => (probe.setMeasuring(false), probe.setPoints([])) },
    { keys: ["i"], shown: "I", does: "save the picture", act: () => void t.savePicture() },
    { keys: ["?", "Shift+?", "h"], shown: "? or H", does: "this help", act: () => t.dialog.showModal() },
  ];
}

function timeKeys(player: Player): readonly Key[] {
  return [
    { keys: ["k"], shown: "K", does: "play the series, or pause", act: () => player.toggle() },
    { keys: ["l"], shown: "L", does: "forward by one step in time", act: () => player.move(1) },
    { keys: ["j"], shown: "J", does: "back by one step", act: () => player.move(-1) },
  ];
}

/** Whether the focused element needs the key: fields need all, sliders and lists the arrow and page keys. */
function taken(target: EventTarget | null, key: string): boolean {
  if (!(target instanceof HTMLElement)) return false;
  if (target instanceof HTMLSelectElement) return true;
  const moving = /Arrow|Page|Home|End|\+|-|=/.test(key);
  if (target instanceof HTMLInputElement) return target.type === "number" || target.type === "text" || (target.type === "range" && moving);
  return moving && target.closest("#panel") !== null && !key.startsWith("+");
}

export function bindKeyboard(targets: KeyTargets): void {
  const { dialog } = targets;
  const keys = keysOf(targets);
  const rows = keys.map(({ shown, does }) => h("tr", {}, h("th", { scope: "row" }, h("kbd", {}, shown)), h("td", {}, does)));
  const mouse: readonly (readonly [string, string])[] = [
    ["drag, one finger", "turn the view; on a slice, move the slice"],
    ["right drag, two fingers", "shift the view; right drag on a slice: its window and level"],
    ["wheel, pinch", "nearer, further away"],
  ];
  const more = mouse.map(([shown, does]) => h("tr", {}, h("th", { scope: "row" }, shown), h("td", {}, does)));
  dialog.append(
    h("div", { class: "dialog-head" }, h("h2", { id: "help-title" }, "Keys, mouse and touch"), button("Close", () => dialog.close(), { autofocus: true })),
    h("table", {}, h("tbody", {}, ...rows, ...more)),
    h("p", { class: "note" }, "Everything else is in the panel, in the order of the Tab key."),
  );
  addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || dialog.open) return;
    const name = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    const key = event.shiftKey ? `Shift+${name}` : name;
    if (taken(event.target, name)) return;
    const found = keys.find((one) => one.keys.includes(key)) ?? (event.shiftKey ? keys.find((one) => one.keys.includes(name) && !/Arrow/.test(name)) : undefined);
    if (!found) return;
    event.preventDefault();
    found.act(key);
  });
}
