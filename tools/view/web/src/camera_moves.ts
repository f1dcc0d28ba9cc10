// Camera moves by keys and buttons.
import { Spherical, Vector3 } from "three";
import { centreOf, lengthOf } from "./geometry";
import type { StoreInfo, Vector } from "./protocol";
import type { Stage } from "./stage";
import { eyeFor, homeEye, type ViewStore } from "./state";

/** Directions from the volume toward the eye. */
export const kDirections: Readonly<Record<string, Vector>> = {
  front: [0, -1, 0], back: [0, 1, 0], left: [-1, 0, 0], right: [1, 0, 0], top: [0, 0, 1], bottom: [0, 0, -1],
};
const kUp = Math.PI / 2;
const kTilt = 1e-4;

export class CameraMoves {
  constructor(
    private readonly views: ViewStore,
    private readonly store: StoreInfo,
    private readonly stage: Stage,
  ) {}

  home(): void {
    this.views.set({ eye: homeEye(this.store, this.stage.aspect), lookAt: centreOf(this.store.box) });
  }
  from(direction: string): void {
    const toward = kDirections[direction];
    if (toward) this.views.set({ eye: eyeFor(this.store.box, toward, this.stage.aspect), lookAt: centreOf(this.store.box) });
  }

  /**
   * Straight at a plane with this normal, without perspective and without the surface. A patient is seen as in radiology: from
   * the feet, the front or the left side, with the front, or the head, at the top.
   */
  face(normal: Vector): void {
    const { frame, box } = this.store;
    const main = ([0, 1, 2] as const).reduce((most, i) => (Math.abs(normal[i]) > Math.abs(normal[most]) + 1e-9 ? i : most), 0 as 0 | 1 | 2);
    const ofPatient: Vector = frame === "LPS" ? [1, -1, -1] : [-1, 1, -1];
    const side = (frame === null ? ([1, -1, 1] as const) : ofPatient)[main];
    const sign = Math.sign(normal[main]) * side;
    const toward: [number, number, number] = [normal[0] * sign, normal[1] * sign, normal[2] * sign];
    // Up is z. A view along z is tilted a little, which decides what is at the top.
    if (Math.hypot(toward[0], toward[1]) < kTilt) toward[1] = -kTilt * (frame === "LPS" ? -1 : 1) * toward[2];
    this.views.set({ eye: eyeFor(box, toward, this.stage.aspect), lookAt: centreOf(box), projection: "orthographic", surface: false });
  }

  /** In degrees: to the right around z, and upward. */
  turn(right: number, up: number): void {
    if (this.store.dimension === 2) return;
    const { eye, lookAt } = this.views.state;
    const away = new Vector3(...eye).sub(new Vector3(...lookAt));
    const ball = new Spherical().setFromVector3(away.applyAxisAngle(new Vector3(1, 0, 0), -kUp)); // its pole is y
    ball.theta += (right * Math.PI) / 180;
    ball.phi -= (up * Math.PI) / 180;
    ball.makeSafe();
    away.setFromSpherical(ball).applyAxisAngle(new Vector3(1, 0, 0), kUp);
    this.views.set({ eye: [lookAt[0] + away.x, lookAt[1] + away.y, lookAt[2] + away.z] });
  }

  /** As fractions of the picture's height. */
  shift(right: number, up: number): void {
    const { eye, lookAt } = this.views.state;
    const by = this.stage.unitsPerPixel * this.stage.canvas.clientHeight;
    const e = this.stage.camera.matrixWorld.elements;
    const along = (i: 0 | 1 | 2): number => by * (right * e[i]! + up * e[4 + i]!);
    this.views.set({
      eye: [eye[0] + along(0), eye[1] + along(1), eye[2] + along(2)],
      lookAt: [lookAt[0] + along(0), lookAt[1] + along(1), lookAt[2] + along(2)],
    });
  }

  /** Factors below 1 move nearer. */
  zoom(factor: number): void {
    const { eye, lookAt } = this.views.state;
    if (!(lengthOf(eye, lookAt) > 0)) return;
    const place = (i: 0 | 1 | 2): number => lookAt[i] + (eye[i] - lookAt[i]) * factor;
    this.views.set({ eye: [place(0), place(1), place(2)] });
  }
}
