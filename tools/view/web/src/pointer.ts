// Mouse and touch on the canvas: rotation, dragging slices and their value window, marking points.
import { MOUSE, Vector3 } from "three";
import { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
import { normalOf, reachOf } from "./geometry";
import type { Probe } from "./probe";
import type { StoreInfo, Vector } from "./protocol";
import { sliceOf } from "./slices";
import type { Hit, Stage } from "./stage";
import type { SliceName, ViewStore } from "./state";

const kStill = 4; // pixels: smaller moves are clicks
const kWindowPixels = 300; // for the whole range of values

type Drag = { readonly id: number; readonly move: (dx: number, dy: number) => void };

export class Pointer {
  readonly controls: OrbitControls;
  private readonly canvas: HTMLCanvasElement;
  private drag: Drag | null = null;
  private down: { readonly x: number; readonly y: number; readonly button: number } | null = null;
  private last: readonly [number, number] = [0, 0];

  constructor(
    private readonly views: ViewStore,
    private readonly store: StoreInfo,
    private readonly stage: Stage,
    private readonly probe: Probe,
  ) {
    this.canvas = stage.canvas;
    // Registered before the controls, so that they do not react when a slice is dragged.
    this.canvas.addEventListener("pointerdown", (event) => this.onDown(event));
    this.canvas.addEventListener("pointermove", (event) => this.onMove(event));
    for (const end of ["pointerup", "pointercancel"]) this.canvas.addEventListener(end, (event) => this.onEnd(event as PointerEvent));
    this.canvas.addEventListener("pointerleave", () => probe.leave());
    this.canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    this.controls = new OrbitControls(stage.perspective, this.canvas);
    this.controls.enableRotate = store.dimension === 3;
    if (store.dimension === 2) this.controls.mouseButtons = { LEFT: MOUSE.PAN, MIDDLE: MOUSE.DOLLY, RIGHT: MOUSE.PAN };
    this.controls.addEventListener("change", () => {
      const { position } = stage.perspective;
      const { target } = this.controls;
      views.set({ eye: [position.x, position.y, position.z], lookAt: [target.x, target.y, target.z] });
    });
    views.subscribe((state, changed) => {
      if (changed.has("eye") || changed.has("lookAt")) {
        this.controls.target.set(...state.lookAt);
        stage.perspective.position.set(...state.eye);
      }
      stage.setView(state);
    });
  }

  private onDown(event: PointerEvent): void {
    const { offsetX: x, offsetY: y } = event;
    this.down = event.isPrimary ? { x, y, button: event.button } : null; // a second finger is not a click
    this.last = [x, y];
    if (!event.isPrimary || this.drag) return;
    const known = this.probe.hovered;
    if (event.pointerType === "mouse" && known && Math.hypot(known.x - x, known.y - y) < kStill) {
      this.grab(event, known.hit);
      return;
    }
    // Without a preceding hover the graphics card is asked; until it answers, the view rotates.
    void this.stage.pick(x, y).then((hit) => {
      if (this.down?.x === x && this.down.y === y) this.grab(event, hit);
    });
  }

  private grab(event: PointerEvent, hit: Hit | null): void {
    const name = hit && sliceOf(hit.id);
    if (!hit || !name || this.store.dimension === 2 || event.ctrlKey || event.shiftKey || event.metaKey) return;
    if (event.button !== 0 && event.button !== 2) return;
    this.drag = { id: event.pointerId, move: event.button === 0 ? this.sliceDrag(name, hit.at) : this.windowDrag() };
    this.controls.enabled = false;
    this.canvas.setPointerCapture(event.pointerId);
  }

  private onMove(event: PointerEvent): void {
    const { offsetX: x, offsetY: y } = event;
    if (this.drag?.id === event.pointerId) this.drag.move(x - this.last[0], y - this.last[1]);
    else if (event.buttons === 0) this.probe.hover(x, y);
    this.last = [x, y];
  }

  private onEnd(event: PointerEvent): void {
    const { offsetX: x, offsetY: y } = event;
    if (this.down && this.probe.measuring && this.down.button === 0 && Math.hypot(x - this.down.x, y - this.down.y) < kStill) {
      void this.probe.mark(x, y);
    }
    if (this.drag?.id === event.pointerId) {
      this.drag = null;
      this.controls.enabled = true;
    }
    this.down = null;
  }

  /** Along the slice's normal as seen on the screen; if seen from its tip, up is toward the eye. */
  private sliceDrag(name: SliceName, at: Vector): Drag["move"] {
    const normal = normalOf(name, this.views.state, this.store);
    const unit = 50 * this.stage.unitsPerPixel;
    const here = this.stage.project(at);
    const there = this.stage.project([at[0] + normal[0] * unit, at[1] + normal[1] * unit, at[2] + normal[2] * unit]);
    let along: readonly [number, number] = here && there ? [(there[0] - here[0]) / unit, (there[1] - here[1]) / unit] : [0, 0];
    const least = 0.2 / this.stage.unitsPerPixel;
    if (Math.hypot(...along) < least) {
      const { eye, lookAt } = this.views.state;
      const toEye = new Vector3(...eye).sub(new Vector3(...lookAt)).dot(new Vector3(...normal));
      along = [0, (toEye < 0 ? 1 : -1) / this.stage.unitsPerPixel];
    }
    const square = along[0] ** 2 + along[1] ** 2;
    return (dx, dy) => {
      const [low, high] = reachOf(name, this.views.state, this.store);
      const moved = this.views.state.slices[name].at + (dx * along[0] + dy * along[1]) / square;
      this.views.setSlice(name, { at: Math.min(Math.max(moved, low), high) });
    };
  }

  /** As in radiology: horizontally for the window, vertically for the level. */
  private windowDrag(): Drag["move"] {
    const range = (this.store.max_value ?? 1) - (this.store.min_value ?? 0) || 1;
    return (dx, dy) => {
      const [low, high] = this.views.state.window;
      const level = (low + high) / 2 - (dy / kWindowPixels) * range;
      const half = Math.max((high - low) / 2 + (dx / kWindowPixels) * (range / 2), range * 1e-4);
      this.views.set({ window: [level - half, level + half] });
    };
  }
}
