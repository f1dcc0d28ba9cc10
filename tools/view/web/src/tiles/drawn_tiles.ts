// The tiles on the graphics card, for drawing and picking. The page keeps no copy of uploaded arrays.
import { BufferAttribute, BufferGeometry, Group, Matrix4, Mesh as Object3, type RawShaderMaterial, type Scene, Sphere, Vector3 } from "three";
import { pickMaterial } from "../shaders";
import type { Drawn } from "../stage";
import type { TileMesh } from "./decode_tile";

/** A sphere that contains every position; what is not seen is not drawn anyway. */
const kAll = new Sphere(new Vector3(), 1e6);

export interface DrawnTile {
  readonly object: Object3;
  readonly picked: Object3;
  /** Bytes of arrays that the page still holds, and of buffers on the graphics card. */
  page: number;
  card: number;
}

export class DrawnTiles implements Drawn {
  private readonly objects = new Group();
  private readonly picked = new Group();
  private readonly pick: RawShaderMaterial;
  private shown: readonly DrawnTile[] = [];
  private readonly tiles = new Set<DrawnTile>();
  /** On the screen. */
  triangles = 0;

  /** `id`, 1 to 255, identifies the surface when picking; `material`: shared with others. */
  constructor(
    id: number,
    private readonly material: RawShaderMaterial,
  ) {
    this.pick = pickMaterial(id);
    for (const group of [this.objects, this.picked]) group.matrixAutoUpdate = group.visible = false;
  }

  addTo(scene: Scene, pickScene: Scene): void {
    scene.add(this.objects);
    pickScene.add(this.picked);
  }
  removeFrom(scene: Scene, pickScene: Scene): void {
    scene.remove(this.objects);
    pickScene.remove(this.picked);
    this.pick.dispose();
  }
  beforePick(near: number, far: number): void {
    this.picked.visible = this.objects.visible;
    const { reach } = this.pick.uniforms;
    if (reach) reach.value = [near, far];
  }

  /** From the tileset's coordinates to the world, by columns. */
  setTransform(matrix: readonly number[]): void {
    for (const group of [this.objects, this.picked]) group.matrix.fromArray([...matrix]);
  }

  /** Invisible until show() names it. */
  add(mesh: TileMesh): DrawnTile {
    const geometry = new BufferGeometry();
    const matrix = new Matrix4().makeScale(...mesh.step).setPosition(...mesh.origin);
    const made = (material: RawShaderMaterial): Object3 => {
      const object = new Object3(geometry, material);
      object.frustumCulled = object.matrixAutoUpdate = object.visible = false;
      object.matrix.copy(matrix);
      return object;
    };
    const object = made(this.material);
    const picked = made(this.pick);
    const tile: DrawnTile = { object, picked, page: 0, card: 0 };
    const hold = (array: Uint16Array | Int8Array | Uint32Array, size: number, normalized: boolean): BufferAttribute => {
      const attribute = new BufferAttribute(array, size, normalized);
      const { byteLength } = array;
      tile.page += byteLength;
      tile.card += byteLength;
      attribute.onUpload(() => {
        (attribute as { array: unknown }).array = null; // never read again; the count stays
        tile.page -= byteLength;
      });
      return attribute;
    };
    geometry.setAttribute("position", hold(mesh.positions, 4, false));
    geometry.setAttribute("normal", hold(mesh.normals, 4, true));
    geometry.setIndex(hold(mesh.indices, 1, false));
    geometry.boundingSphere = kAll;
    this.objects.add(object);
    this.picked.add(picked);
    this.tiles.add(tile);
    return tile;
  }

  remove(tile: DrawnTile): void {
    const { object, picked } = tile;
    this.tiles.delete(tile);
    object.geometry.dispose();
    this.objects.remove(object);
    this.picked.remove(picked);
  }

  /** Only these are drawn. */
  show(tiles: readonly DrawnTile[], triangles: number): void {
    for (const { object, picked } of this.shown) object.visible = picked.visible = false;
    for (const { object, picked } of tiles) object.visible = picked.visible = true;
    this.shown = tiles;
    this.triangles = triangles;
    this.objects.visible = tiles.length > 0;
  }

  get bytes(): { readonly page: number; readonly card: number } {
    const sum = { page: 0, card: 0 };
    for (const { page, card } of this.tiles) {
      sum.page += page;
      sum.card += card;
    }
    return sum;
  }
}
