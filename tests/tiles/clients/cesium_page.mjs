// A page that shows tilesets by Cesium, for clients_test.mjs. The script of Cesium defines window.Cesium.
const { Cesium } = window;
Cesium.Ion.defaultAccessToken = undefined;

const box = document.createElement("div");
Object.assign(box.style, { width: "400px", height: "300px" });
document.body.append(box);
const widget = new Cesium.CesiumWidget(box, {
  baseLayer: false,
  globe: false,
  skyBox: false,
  skyAtmosphere: false,
  scene3DOnly: true,
  useDefaultRenderLoop: false,
  msaaSamples: 1,
  contextOptions: { webgl: { preserveDrawingBuffer: true } },
});
widget.resize();
const { scene } = widget;
if (scene.sun) scene.sun.show = false;
if (scene.moon) scene.moon.show = false;
scene.backgroundColor = Cesium.Color.MAGENTA;
scene.screenSpaceCameraController.enableInputs = false;
scene.light = new Cesium.DirectionalLight({ direction: new Cesium.Cartesian3(-0.4, 1, -0.8) });
const faults = [];
scene.renderError.addEventListener((_, error) => faults.push(String(error)));

const frame = () => new Promise((resolve) => requestAnimationFrame(resolve));
const { Cartesian2, Cartesian3, Matrix4 } = Cesium;

class View {
  async open(url, { errorTarget = 1 } = {}) {
    scene.primitives.removeAll();
    this.failures = [];
    this.tileset = await Cesium.Cesium3DTileset.fromUrl(url, {
      maximumScreenSpaceError: errorTarget,
      dynamicScreenSpaceError: false,
      foveatedScreenSpaceError: false,
      cullRequestsWhileMoving: false,
      enablePick: true,
    });
    this.tileset.tileFailed.addEventListener(({ url: at, message }) => this.failures.push(`${at}: ${message}`));
    this.loaded = 0;
    this.tileset.tileLoad.addEventListener(() => ++this.loaded);
    scene.primitives.add(this.tileset);
    const sphere = this.tileset.boundingSphere;
    const place = Cesium.Cartographic.fromCartesian(sphere.center);
    return {
      center: [sphere.center.x, sphere.center.y, sphere.center.z],
      radius: sphere.radius,
      place: place && [Cesium.Math.toDegrees(place.longitude), Cesium.Math.toDegrees(place.latitude), place.height],
    };
  }

  /** The mesh in a .glb with y up, for comparison. */
  async addFull(url) {
    this.full = await Cesium.Model.fromGltfAsync({ url, upAxis: Cesium.Axis.Y, forwardAxis: Cesium.Axis.X, cull: false });
    this.full.show = false;
    scene.primitives.add(this.full);
    for (let i = 0; !this.full.ready; ++i) {
      if (i > 2000) throw new Error("the full mesh was not loaded");
      scene.render();
      await frame();
    }
  }

  look(from, at, up = [0, 0, 1]) {
    const eye = new Cartesian3(...from);
    const direction = Cartesian3.normalize(Cartesian3.subtract(new Cartesian3(...at), eye, new Cartesian3()), new Cartesian3());
    const right = Cartesian3.normalize(Cartesian3.cross(direction, new Cartesian3(...up), new Cartesian3()), new Cartesian3());
    scene.camera.setView({ destination: eye, orientation: { direction, up: Cartesian3.cross(right, direction, new Cartesian3()) }, endTransform: Matrix4.IDENTITY });
  }

  async rest(timeout = 60_000) {
    const end = performance.now() + timeout;
    for (let frames = 0, still = 0; ; ++frames) {
      scene.render();
      await frame();
      still = this.tileset.tilesLoaded ? still + 1 : 0;
      if (still >= 4) return frames;
      if (performance.now() > end) throw new Error(`not at rest: ${JSON.stringify(this.tileset.statistics)}, ${this.failures}`);
    }
  }

  counts() {
    const shown = this.tileset._selectedTiles;
    const levels = {};
    let worst = 0;
    for (const tile of shown) {
      const level = Number(/tiles\/(\d+)\//.exec(tile.content.url)[1]);
      levels[level] = (levels[level] ?? 0) + 1;
      if (tile.children.length > 0) worst = Math.max(worst, tile._screenSpaceError);
    }
    const { selected, numberOfTrianglesSelected, numberOfFeaturesSelected } = this.tileset.statistics;
    return { tiles: selected, levels, triangles: numberOfTrianglesSelected, features: numberOfFeaturesSelected, worst, loaded: this.loaded, failures: [...this.failures, ...faults] };
  }

  /** Which pixels are covered. */
  covered() {
    scene.render();
    const { canvas } = scene;
    const copy = document.createElement("canvas");
    [copy.width, copy.height] = [canvas.width, canvas.height];
    const context = copy.getContext("2d");
    context.drawImage(canvas, 0, 0);
    const { data } = context.getImageData(0, 0, copy.width, copy.height);
    const mask = new Uint8Array(copy.width * copy.height);
    for (let i = 0; i < mask.length; ++i) mask[i] = data[4 * i] > 250 && data[4 * i + 1] < 5 && data[4 * i + 2] > 250 ? 0 : 1;
    return { mask, width: copy.width, height: copy.height };
  }

  /** Pixels that one of the pictures covers, and the other one nowhere in the 9 pixels around. */
  async compare() {
    const tiles = this.covered();
    [this.tileset.show, this.full.show] = [false, true];
    for (let i = 0; i < 3; ++i) {
      scene.render();
      await frame();
    }
    const full = this.covered();
    [this.tileset.show, this.full.show] = [true, false];
    scene.render();
    const missing = ({ mask, width, height }, part) => {
      const found = { covered: 0, uncovered: 0 };
      for (let y = 1; y + 1 < height; ++y) {
        for (let x = 1; x + 1 < width; ++x) {
          if (!mask[y * width + x]) continue;
          ++found.covered;
          let any = 0;
          for (let j = -1; j <= 1; ++j) for (let i = -1; i <= 1; ++i) any |= part.mask[(y + j) * width + x + i];
          if (!any) ++found.uncovered;
        }
      }
      return found;
    };
    return { full: missing(full, tiles), tiles: missing(tiles, full) };
  }

  /** The feature at a place in the world. */
  pick(at) {
    scene.render();
    const pixel = scene.cartesianToCanvasCoordinates(new Cartesian3(...at), new Cartesian2());
    const found = scene.pick(pixel);
    if (!found?.getProperty) return null;
    return { data: Object.fromEntries(found.getPropertyIds().map((name) => [name, found.getProperty(name)])) };
  }

  /** All rows of the tables of the tiles that are shown. */
  features() {
    const all = this.tileset._selectedTiles.flatMap(({ content }) => Array.from({ length: content.featuresLength }, (_, i) => content.getFeature(i)));
    return all.map((one) => Object.fromEntries(one.getPropertyIds().map((name) => [name, one.getProperty(name)])));
  }

  draw() {
    scene.render();
    return scene.canvas.toDataURL("image/png");
  }
}

window.clients = { View };
