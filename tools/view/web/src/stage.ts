// The canvas: renderer, cameras, one frame after each change, and picking.
import {
  Color, Frustum, LinearSRGBColorSpace, Matrix4, NearestFilter, OrthographicCamera, PerspectiveCamera, Scene, Vector3, WebGLRenderer, WebGLRenderTarget,
} from "three";
import { centreOf, dot, lengthOf, lengthToBall, radiusOf } from "./geometry";
import type { Box, StoreInfo, Vector } from "./protocol";
import { kFieldOfView, type ViewState } from "./state";

export interface Hit {
  /** Id of the DrawnMesh. */
  readonly id: number;
  readonly at: Vector;
}

/** What can be drawn, and found when picking. */
export interface Drawn {
  addTo(scene: Scene, pickScene: Scene): void;
  removeFrom(scene: Scene, pickScene: Scene): void;
  /** Shows in the picking scene what is shown in the other one; `near`, `far`: of the camera. */
  beforePick(near: number, far: number): void;
}

/** The picture's part of the protocol's `camera=`. */
export type Seen = readonly [x: number, y: number, z: number, fov: number, height: number];

const kMaxPixelRatio = 2;
const kMaxPicture = 8192;

export class Stage {
  readonly scene = new Scene();
  readonly pickScene = new Scene();
  readonly perspective = new PerspectiveCamera(kFieldOfView);
  readonly renderer: WebGLRenderer;
  frames = 0;
  private readonly orthographic = new OrthographicCamera();
  private readonly target = new WebGLRenderTarget(1, 1, { minFilter: NearestFilter, magFilter: NearestFilter });
  private readonly meshes: Drawn[] = [];
  private readonly afterResize: (() => void)[] = [];
  private readonly afterFrame: (() => void)[] = [];
  private readonly beforeFrame: (() => void)[] = [];
  private asked = 0;
  /** Of a picture of another size, while it is drawn. */
  private pictureAspect: number | null = null;
  private readonly box: Box;
  private state!: ViewState;

  /** Throws Error without WebGL 2. */
  constructor(
    readonly canvas: HTMLCanvasElement,
    store: StoreInfo,
  ) {
    this.box = store.box;
    this.renderer = new WebGLRenderer({ canvas, antialias: true, powerPreference: "high-performance" });
    this.renderer.debug.checkShaderErrors = false; // it would wait for the graphics card
    this.renderer.outputColorSpace = LinearSRGBColorSpace; // the shaders output the final colours
    // z is up, except for data in a plane across z.
    const lies = store.dimension === 2 && store.nodes[2] === 1;
    for (const camera of [this.perspective, this.orthographic]) camera.up.set(0, lies ? 1 : 0, lies ? 0 : 1);
    this.resize();
    new ResizeObserver(() => this.resize()).observe(canvas);
  }

  add(mesh: Drawn): void {
    this.meshes.push(mesh);
    mesh.addTo(this.scene, this.pickScene);
  }
  remove(mesh: Drawn): void {
    this.meshes.splice(this.meshes.indexOf(mesh), 1);
    mesh.removeFrom(this.scene, this.pickScene);
    this.invalidate();
  }
  /** Called before each frame, when the camera is set. */
  onAim(action: () => void): void {
    this.beforeFrame.push(action);
  }
  /** Called after each frame. */
  onFrame(action: () => void): void {
    this.afterFrame.push(action);
  }

  /** Three numbers, 0 to 1. */
  setBackground(color: readonly [number, number, number]): void {
    this.renderer.setClearColor(new Color().setRGB(...color, LinearSRGBColorSpace), 1);
    this.invalidate();
  }

  /** Called when the size of the canvas changes. */
  onResize(action: () => void): void {
    this.afterResize.push(action);
  }

  setView(state: ViewState): void {
    this.state = state;
    this.invalidate();
  }

  /** Requests a frame. */
  invalidate(): void {
    if (this.asked !== 0) return;
    this.asked = requestAnimationFrame(() => {
      this.asked = 0;
      this.draw();
    });
  }
  get pending(): boolean {
    return this.asked !== 0;
  }

  /** The largest width and height of a picture. */
  get mostPixels(): number {
    return Math.min(this.renderer.capabilities.maxTextureSize, kMaxPicture);
  }

  /** A PNG of the picture with this many pixels; 0: as many as on the screen. Null if the browser cannot make it. */
  picture(width: number, height: number): Promise<Blob | null> {
    const { renderer } = this;
    const own = [renderer.domElement.width, renderer.domElement.height] as const;
    const wide = width || (height ? height * this.aspect : own[0]);
    const [x, y] = [Math.round(wide), Math.round(height || wide / this.aspect)];
    const isOwn = x === own[0] && y === own[1];
    const ratio = renderer.getPixelRatio();
    if (!isOwn) {
      renderer.setPixelRatio(1);
      renderer.setSize(x, y, false);
    }
    this.pictureAspect = x / y;
    this.aim();
    for (const action of this.beforeFrame) action();
    renderer.render(this.scene, this.camera);
    this.pictureAspect = null;
    const made = new Promise<Blob | null>((resolve) => this.canvas.toBlob(resolve, "image/png"));
    // In the same task, so that the screen never shows the other size.
    if (!isOwn) {
      renderer.setPixelRatio(ratio);
      renderer.setSize(this.canvas.clientWidth, this.canvas.clientHeight, false);
    }
    this.draw();
    return made;
  }

  draw(): void {
    this.aim();
    for (const action of this.beforeFrame) action();
    this.renderer.render(this.scene, this.camera);
    ++this.frames;
    for (const action of this.afterFrame) action();
  }

  get camera(): PerspectiveCamera | OrthographicCamera {
    return this.state.projection === "perspective" ? this.perspective : this.orthographic;
  }

  /** Width of the picture divided by its height. */
  get aspect(): number {
    return this.pictureAspect ?? this.canvas.clientWidth / Math.max(this.canvas.clientHeight, 1);
  }

  /** World units per CSS pixel at the camera's target. */
  get unitsPerPixel(): number {
    const { eye, lookAt } = this.state;
    return (2 * lengthOf(eye, lookAt) * Math.tan((kFieldOfView / 2) * (Math.PI / 180))) / Math.max(this.canvas.clientHeight, 1);
  }

  /** World units per pixel where the sphere around the box is nearest to the eye; 0 if the eye is inside. */
  leastUnitsPerPixel(box: Box): number {
    return this.unitsPerPixelAt(lengthToBall(this.state.eye, box));
  }

  /** A movement by so much is seen as at most a pixel, at this distance from the eye or farther away, also in the picture's corners. */
  unseenAt(distance: number): number {
    if (this.state.projection !== "perspective") return this.unitsPerPixelAt(distance);
    const tangent = Math.tan((kFieldOfView / 2) * (Math.PI / 180)) * Math.hypot(1, this.aspect);
    return this.unitsPerPixelAt(Math.max(distance, this.perspective.near)) / (1 + tangent ** 2);
  }

  /** World units per pixel in the middle of the picture at this distance; without perspective everywhere the same. */
  private unitsPerPixelAt(distance: number): number {
    const { eye, lookAt, projection } = this.state;
    const away = projection === "perspective" ? distance : lengthOf(eye, lookAt);
    return (2 * away * Math.tan((kFieldOfView / 2) * (Math.PI / 180))) / Math.max(this.renderer.domElement.height, 1);
  }

  /** The planes through the picture's four sides, in the world: a, b, c, d with ax + by + cz + d >= 0 in the picture. */
  get sides(): readonly (readonly [number, number, number, number])[] {
    const matrix = new Matrix4().multiplyMatrices(this.camera.projectionMatrix, this.camera.matrixWorldInverse);
    return new Frustum().setFromProjectionMatrix(matrix).planes.slice(0, 4).map(({ normal, constant }) => [normal.x, normal.y, normal.z, constant] as const);
  }

  /** Without perspective, that of a very distant camera. */
  get seen(): Seen {
    const { eye, lookAt, projection } = this.state;
    const height = this.renderer.domElement.height;
    if (projection === "perspective") return [...eye, kFieldOfView, height];
    const distance = lengthOf(eye, lookAt);
    const away = (100 * radiusOf(this.box)) / distance;
    const fov = 2 * Math.atan(Math.tan((kFieldOfView / 2) * (Math.PI / 180)) / away) * (180 / Math.PI);
    const far = (i: 0 | 1 | 2): number => lookAt[i] + (eye[i] - lookAt[i]) * away;
    return [far(0), far(1), far(2), fov, height];
  }

  /** In CSS pixels, from the canvas's upper left corner; null behind the eye. */
  project(at: Vector): readonly [number, number] | null {
    const p = new Vector3(...at).project(this.camera);
    if (!(p.z > -1 && p.z < 1)) return null;
    return [((p.x + 1) / 2) * this.canvas.clientWidth, ((1 - p.y) / 2) * this.canvas.clientHeight];
  }

  /** What is drawn at this point, if anything. Does not wait for the graphics card. */
  async pick(x: number, y: number): Promise<Hit | null> {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (width === 0 || height === 0) return null;
    this.aim();
    const camera = this.camera.clone();
    camera.setViewOffset(width, height, x - 0.5, y - 0.5, 1, 1);
    camera.updateProjectionMatrix();
    for (const mesh of this.meshes) mesh.beforePick(camera.near, camera.far);
    const color = this.renderer.getClearColor(new Color());
    this.renderer.setRenderTarget(this.target);
    this.renderer.setClearColor(0, 0);
    this.renderer.render(this.pickScene, camera);
    this.renderer.setRenderTarget(null);
    this.renderer.setClearColor(color, 1);
    const bytes = new Uint8Array(4);
    await this.renderer.readRenderTargetPixelsAsync(this.target, 0, 0, 1, 1, bytes);
    const [high = 0, middle = 0, low = 0, id = 0] = bytes;
    if (id === 0) return null;
    const depth = camera.near + ((high * 65536 + middle * 256 + low) / 16777215) * (camera.far - camera.near);
    const clip = new Vector3(0, 0, -depth).applyMatrix4(camera.projectionMatrix);
    const at = new Vector3(0, 0, clip.z).unproject(camera);
    return { id, at: [at.x, at.y, at.z] };
  }

  private resize(): void {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (width === 0 || height === 0) return;
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, kMaxPixelRatio));
    const before = this.renderer.domElement.height;
    this.renderer.setSize(width, height, false);
    this.invalidate();
    if (this.renderer.domElement.height !== before) for (const action of this.afterResize) action();
  }

  /** Sets the cameras from the state, with near and far planes as close to the volume as possible. */
  private aim(): void {
    const { eye, lookAt } = this.state;
    const { aspect } = this;
    const distance = lengthOf(eye, lookAt);
    const half = distance * Math.tan((kFieldOfView / 2) * (Math.PI / 180));
    const radius = radiusOf(this.box) * 1.01;
    const forward = [0, 1, 2].map((i) => ((lookAt[i] ?? 0) - (eye[i] ?? 0)) / distance);
    const depth = dot(forward, centreOf(this.box).map((part, i) => part - (eye[i] ?? 0)));
    for (const camera of [this.perspective, this.orthographic]) {
      camera.position.set(...eye);
      camera.lookAt(...lookAt);
      camera.far = Math.max(depth + radius, radius * 1e-2);
    }
    this.perspective.near = Math.max(depth - radius, radius * 1e-3);
    this.perspective.aspect = aspect;
    this.orthographic.near = depth - radius;
    Object.assign(this.orthographic, { left: -half * aspect, right: half * aspect, top: half, bottom: -half });
    for (const camera of [this.perspective, this.orthographic]) {
      camera.updateProjectionMatrix();
      camera.updateMatrixWorld();
    }
  }
}
