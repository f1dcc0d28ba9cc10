// The box that clips surface and slices: its sliders, and its outline in the picture.
import { BufferAttribute, BufferGeometry, LineBasicMaterial, LineSegments } from "three";
import { button, checkbox, h, section } from "../dom";
import { cornersOf } from "../geometry";
import type { Box, StoreInfo, Vector } from "../protocol";
import { Slider } from "./slider";
import type { Stage } from "../stage";
import type { ViewStore } from "../state";

const kMinPart = 1e-3; // fraction of the volume along an axis

export class ClippingPanel {
  readonly element: HTMLElement;
  private readonly lines = new LineBasicMaterial();
  private readonly outline = new LineSegments(new BufferGeometry(), this.lines);
  private readonly clip = new LineSegments(new BufferGeometry(), this.lines);

  constructor(
    private readonly views: ViewStore,
    private readonly store: StoreInfo,
    private readonly stage: Stage,
  ) {
    const sliders: Slider[] = [];
    const { box } = store;
    for (const axis of [0, 1, 2] as const) {
      if (!(box[axis] < box[axis + 3]!)) continue;
      for (const end of [0, 1] as const) {
        const label = `${"xyz"[axis]} ${end === 0 ? "from" : "to"}`;
        const options = { id: `box-${axis + 3 * end}`, label, least: box[axis], largest: box[axis + 3]! };
        const slider = new Slider(options, (value) => this.cut(axis + 3 * end, value));
        sliders.push(slider);
        views.subscribe((state) => slider.set((state.box ?? box)[axis + 3 * end]!));
      }
    }
    const on = checkbox("Clip to a box", (clip) => views.set({ box: clip ? box : null }), { id: "box-on" });
    const whole = button("Whole volume", () => views.set({ box }), { id: "box-whole" });
    this.element = section("clipping", "Clipping", false, on.row, ...sliders.map((slider) => slider.row), h("div", { class: "buttons" }, whole));
    stage.scene.add(this.outline, this.clip);
    this.outline.geometry = edges(cornersOf(store));
    views.subscribe((state, changed) => {
      on.set(state.box !== null);
      for (const slider of sliders) slider.row.hidden = state.box === null;
      whole.hidden = state.box === null;
      if (!changed.has("box") && !changed.has("outline")) return;
      this.clip.geometry.dispose();
      this.clip.geometry = edges(cornersOfBox(state.box ?? box));
      this.clip.visible = state.outline && state.box !== null;
      this.outline.visible = state.outline;
      stage.invalidate();
    });
  }

  setColor(color: readonly [number, number, number]): void {
    this.lines.color.setRGB(...color);
    this.stage.invalidate();
  }

  private cut(index: number, value: number): void {
    const { box: all } = this.store;
    const next = [...(this.views.state.box ?? all)];
    const axis = index % 3;
    const gap = kMinPart * (all[axis + 3]! - all[axis]!);
    next[index] = index < 3 ? Math.min(value, next[axis + 3]! - gap) : Math.max(value, next[axis]! + gap);
    this.views.set({ box: next as unknown as Box });
  }
}

function cornersOfBox(box: Box): Vector[] {
  return [0, 1, 2, 3, 4, 5, 6, 7].map((corner) => [box[corner & 1 ? 3 : 0], box[corner & 2 ? 4 : 1], box[corner & 4 ? 5 : 2]]);
}

/** The twelve edges, between corners whose numbers differ in one bit. */
function edges(corners: readonly Vector[]): BufferGeometry {
  const ends: number[] = [];
  for (let corner = 0; corner < 8; ++corner) {
    for (const bit of [1, 2, 4]) if ((corner & bit) === 0) ends.push(...corners[corner]!, ...corners[corner | bit]!);
  }
  return new BufferGeometry().setAttribute("position", new BufferAttribute(new Float32Array(ends), 3));
}
