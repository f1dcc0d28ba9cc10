// A page that shows tilesets by 3d-tiles-renderer and three.js, for clients_test.mjs.
import {
  Color, DirectionalLight, DoubleSide, FloatType, Group, HemisphereLight, MeshStandardMaterial, NearestFilter, PerspectiveCamera,
  Raycaster, Scene, ShaderMaterial, Vector2, Vector3, WebGLRenderTarget, WebGLRenderer,
} from "three";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import { TilesRenderer } from "3d-tiles-renderer";
import { GLTFExtensionsPlugin } from "3d-tiles-renderer/plugins";
import { MeshoptDecoder } from "meshoptimizer";

const kWidth = 480;
const kHeight = 360;
const kLevelColors = ["#e8e8e8", "#4f9de8", "#e8a33d", "#d9534f", "#6abf69", "#a06cd5", "#f2d94e"];

const renderer = new WebGLRenderer({ preserveDrawingBuffer: true });
renderer.setSize(kWidth, kHeight);
document.body.append(renderer.domElement);

// For comparisons: the distance from the camera's plane at kFiner x kFiner points in each pixel; 0: nothing is there.
const kFiner = 3;
const [kColumns, kRows] = [kFiner * kWidth, kFiner * kHeight];
const target = new WebGLRenderTarget(kColumns, kRows, { type: FloatType, minFilter: NearestFilter, magFilter: NearestFilter });
const depthMaterial = new ShaderMaterial({
  side: DoubleSide,
  vertexShader: "varying float depth; void main() { vec4 at = modelViewMatrix * vec4(position, 1.0); depth = -at.z; gl_Position = projectionMatrix * at; }",
  fragmentShader: "varying float depth; void main() { gl_FragColor = vec4(depth, 0.0, 0.0, 1.0); }",
});

const frame = () => new Promise((resolve) => requestAnimationFrame(resolve));
const isLeaf = (tile) => !(tile.children?.length > 0);
const levelOf = (tile) => Number(/tiles\/(\d+)\//.exec(tile.content.uri)[1]);

function trianglesOf(object) {
  let count = 0;
  object.traverse((one) => one.isMesh && (count += one.geometry.index.count / 3));
  return count;
}

function lit() {
  const scene = new Scene();
  scene.background = new Color("#20262e");
  const sun = new DirectionalLight("white", 2.5);
  sun.position.set(0.4, -1, 0.8);
  scene.add(sun, new HemisphereLight("white", "#404040", 1));
  return scene;
}

/** One tileset. Tilesets have z up, as their cameras here. */
class View {
  constructor(url, { errorTarget = 1 } = {}) {
    this.scene = lit();
    this.camera = new PerspectiveCamera(50, kWidth / kHeight, 0.1, 1e6);
    this.camera.up.set(0, 0, 1);
    this.failures = [];
    this.loaded = 0;
    this.tiles = new TilesRenderer(url);
    this.tiles.errorTarget = errorTarget;
    this.tiles.registerPlugin(new GLTFExtensionsPlugin({ meshoptDecoder: MeshoptDecoder, autoDispose: false }));
    this.tiles.addEventListener("load-error", ({ error, url: at }) => this.failures.push(`${at}: ${error.message}`));
    this.tiles.addEventListener("load-model", () => ++this.loaded);
    this.tiles.setCamera(this.camera);
    this.tiles.setResolution(this.camera, kWidth, kHeight);
    this.scene.add(this.tiles.group);
  }

  /** The mesh in a .glb with y up, for comparison. */
  async addFull(url) {
    this.full = new Group();
    const { scene } = await new GLTFLoader().loadAsync(url);
    scene.rotation.x = Math.PI / 2;
    this.full.add(scene);
    this.full.updateMatrixWorld(true);
    return trianglesOf(scene);
  }

  look(from, at) {
    this.camera.position.set(...from);
    this.camera.lookAt(...at);
    this.camera.updateMatrixWorld(true);
  }

  /** Waits until everything that the camera needs is shown; how many frames that took. */
  async rest(timeout = 60_000) {
    const end = performance.now() + timeout;
    let before = "";
    for (let frames = 0, still = 0; ; ++frames) {
      this.tiles.update();
      await frame();
      const { stats } = this.tiles;
      const now = [...this.tiles.visibleTiles].map((tile) => tile.content.uri).sort().join();
      const busy = !this.tiles.root || stats.queued + stats.downloading + stats.parsing > 0;
      still = busy || now !== before ? 0 : still + 1;
      before = now;
      if (still >= 8) return frames;
      if (performance.now() > end) throw new Error(`not at rest: ${JSON.stringify(stats)}, ${this.failures}`);
    }
  }

  /** What is shown. */
  counts() {
    const shown = [...this.tiles.visibleTiles];
    const levels = {};
    let triangles = 0;
    let worst = 0; // largest error in pixels of a tile that could be finer
    let geometricError = 0;
    for (const tile of shown) {
      levels[levelOf(tile)] = (levels[levelOf(tile)] ?? 0) + 1;
      triangles += trianglesOf(tile.engineData.scene);
      geometricError = Math.max(geometricError, tile.geometricError);
      if (!isLeaf(tile)) worst = Math.max(worst, tile.traversal.error);
    }
    return { tiles: shown.length, levels, triangles, worst, geometricError, loaded: this.loaded, failures: this.failures };
  }

  depths(which) {
    const scene = new Scene();
    const parent = which.parent;
    scene.add(which);
    scene.overrideMaterial = depthMaterial;
    renderer.setRenderTarget(target);
    renderer.setClearColor(0, 0);
    renderer.clear();
    renderer.render(scene, this.camera);
    const pixels = new Float32Array(4 * kColumns * kRows);
    renderer.readRenderTargetPixels(target, 0, 0, kColumns, kRows, pixels);
    renderer.setRenderTarget(null);
    parent?.add(which);
    return pixels.filter((_, i) => i % 4 === 0);
  }

  /**
   * Compares the picture with the full mesh's: counts the points of each that the other does not cover within a pixel, and
   * those that it covers at other depths only. Depths may differ by `tolerance` from the range of those within a pixel. At
   * edges depths are not compared: what is behind may peep out there, thinner than a point.
   */
  compare(tolerance) {
    const tiles = this.depths(this.tiles.group);
    const full = this.depths(this.full);
    const isInside = (whole, x, y) => {
      const near = [-1, 0, 1].flatMap((j) => [-1, 0, 1].map((i) => whole[(y + j) * kColumns + x + i]));
      return Math.min(...near) > 0 && Math.max(...near) - Math.min(...near) <= tolerance;
    };
    const missing = (whole, part) => {
      const found = { covered: 0, uncovered: 0, elsewhere: 0 };
      for (let y = kFiner; y + kFiner < kRows; ++y) {
        for (let x = kFiner; x + kFiner < kColumns; ++x) {
          const depth = whole[y * kColumns + x];
          if (depth === 0) continue;
          ++found.covered;
          const here = part[y * kColumns + x];
          if (here > 0 && Math.abs(here - depth) <= tolerance) continue;
          let [low, high] = [Infinity, 0];
          for (let j = -kFiner; j <= kFiner; ++j) {
            for (let i = -kFiner; i <= kFiner; ++i) {
              const other = part[(y + j) * kColumns + x + i];
              if (other > 0) [low, high] = [Math.min(low, other), Math.max(high, other)];
            }
          }
          if (high === 0) ++found.uncovered;
          else if ((depth < low - tolerance || depth > high + tolerance) && isInside(whole, x, y)) ++found.elsewhere;
        }
      }
      return found;
    };
    return { full: missing(full, tiles), tiles: missing(tiles, full) };
  }

  /** The same while one tile is hidden: the one in front at most of 24 x 18 points of the picture. */
  compareWithoutOne() {
    const scenes = [...this.tiles.visibleTiles].map((tile) => tile.engineData.scene);
    const ray = new Raycaster();
    const seen = new Map();
    this.tiles.group.updateMatrixWorld(true);
    for (let y = 0; y < 18; ++y) {
      for (let x = 0; x < 24; ++x) {
        ray.setFromCamera(new Vector2((x + 0.5) / 12 - 1, (y + 0.5) / 9 - 1), this.camera);
        let [front] = ray.intersectObjects(scenes, true).map((hit) => hit.object);
        while (front && !scenes.includes(front)) front = front.parent;
        if (front) seen.set(front, (seen.get(front) ?? 0) + 1);
      }
    }
    const [[hidden]] = [...seen].sort((a, b) => b[1] - a[1]);
    hidden.visible = false;
    const compared = this.compare(1);
    hidden.visible = true;
    return compared;
  }

  /** The feature that is seen in the direction of a place, as in the tile's table. */
  pick(place) {
    const ray = new Raycaster();
    const { x, y } = new Vector3(...place).project(this.camera);
    ray.setFromCamera(new Vector2(x, y), this.camera);
    this.tiles.group.updateMatrixWorld(true);
    const [hit] = ray.intersectObject(this.tiles.group, true);
    if (!hit) return null;
    const { meshFeatures, structuralMetadata } = hit.object.userData;
    const [row] = meshFeatures.getFeatures(hit.faceIndex, hit.barycoord);
    const [{ propertyTable }] = meshFeatures.getFeatureInfo();
    const data = structuralMetadata.getPropertyTableData(propertyTable, row);
    const color = hit.object.geometry.getAttribute("color");
    const corner = hit.face.a;
    return {
      data: Object.fromEntries(Object.entries(data).map(([name, value]) => [name, typeof value === "bigint" ? Number(value) : value])),
      color: color ? [color.getX(corner), color.getY(corner), color.getZ(corner)] : null,
      at: hit.point.toArray(),
    };
  }

  /** All rows of the tables of the tiles that are shown. */
  features() {
    const rows = [];
    this.tiles.group.traverse((one) => {
      if (!one.userData.structuralMetadata || !one.isMesh) return;
      const [{ propertyTable, featureCount }] = one.userData.meshFeatures.getFeatureInfo();
      for (let row = 0; row < featureCount; ++row) rows.push(one.userData.structuralMetadata.getPropertyTableData(propertyTable, row));
    });
    return rows;
  }

  /** A picture on the canvas: of the tiles, of tiles in the colours of their levels, or of the full mesh. */
  draw(how = "tiles") {
    const scene = lit();
    const which = how === "full" ? this.full : this.tiles.group;
    const parent = which.parent;
    const kept = [];
    if (how === "levels") {
      for (const tile of this.tiles.visibleTiles) {
        tile.engineData.scene.traverse((one) => {
          if (!one.isMesh) return;
          kept.push([one, one.material]);
          one.material = new MeshStandardMaterial({ color: kLevelColors[levelOf(tile) % kLevelColors.length], side: DoubleSide, roughness: 0.7 });
        });
      }
    }
    scene.add(which);
    renderer.render(scene, this.camera);
    parent?.add(which);
    for (const [one, material] of kept) one.material = material;
    return renderer.domElement.toDataURL("image/png");
  }

  end() {
    this.tiles.dispose();
  }
}

window.clients = { View };
