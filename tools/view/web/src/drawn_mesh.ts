// One mesh on the graphics card, for drawing and picking. The page keeps no copy of uploaded arrays.
import { BufferAttribute, BufferGeometry, Mesh as Object3, type RawShaderMaterial, type Scene, Sphere, Vector3 } from "three";
import type { Mesh } from "./decode";
import type { Measure } from "./measure";
import type { MeshHeader } from "./protocol";
import { pickMaterial } from "./shaders";
import type { Drawn } from "./stage";

const kMiddle = 65535 / 2;
/** A sphere that contains every quantised position. */
const kAll = new Sphere(new Vector3(kMiddle, kMiddle, kMiddle), Math.sqrt(3) * kMiddle);

export class DrawnMesh implements Drawn {
  header: MeshHeader | null = null;
  /** Of the surface that is shown. */
  measure: Measure | null = null;
  readonly object: Object3;
  readonly picked: Object3;
  private inPage = 0;
  private onCard = 0;

  /** `id`, 1 to 255, identifies the mesh when picking. */
  constructor(
    readonly id: number,
    readonly material: RawShaderMaterial,
  ) {
    this.object = new Object3(new BufferGeometry(), material);
    this.picked = new Object3(this.object.geometry, pickMaterial(id));
    for (const object of [this.object, this.picked]) {
      object.frustumCulled = false;
      object.matrixAutoUpdate = false;
      object.visible = false;
    }
  }

  addTo(scene: Scene, pickScene: Scene): void {
    scene.add(this.object);
    pickScene.add(this.picked);
  }

  removeFrom(scene: Scene, pickScene: Scene): void {
    scene.remove(this.object);
    pickScene.remove(this.picked);
    this.material.dispose();
    (this.picked.material as RawShaderMaterial).dispose();
  }

  beforePick(near: number, far: number): void {
    this.picked.visible = this.object.visible;
    const { reach } = (this.picked.material as RawShaderMaterial).uniforms;
    if (reach) reach.value = [near, far];
  }

  /** Replaces the previous mesh. */
  show(mesh: Mesh): void {
    this.clear();
    const { header } = mesh;
    this.header = header;
    this.measure = mesh.measure;
    if (header.triangles === 0) return;
    const geometry = new BufferGeometry();
    const hold = (array: Uint16Array | Int8Array | Uint32Array, size: number, normalized: boolean): BufferAttribute => {
      const attribute = new BufferAttribute(array, size, normalized);
      const { byteLength } = array;
      this.inPage += byteLength;
      this.onCard += byteLength;
      attribute.onUpload(() => {
        (attribute as { array: unknown }).array = null; // never read again; the count stays
        if (this.object.geometry === geometry) this.inPage -= byteLength;
      });
      return attribute;
    };
    geometry.setAttribute("position", hold(mesh.positions, 4, false));
    if (mesh.normals.length > 0) geometry.setAttribute("normal", hold(mesh.normals, 4, true));
    geometry.setIndex(hold(mesh.indices, 1, false));
    geometry.boundingSphere = kAll; // can no longer be computed from the vertices
    for (const object of [this.object, this.picked]) {
      object.geometry = geometry;
      object.matrix.makeScale(...header.step).setPosition(...header.origin);
      object.visible = true;
    }
  }

  clear(): void {
    this.object.geometry.dispose();
    this.object.visible = this.picked.visible = false;
    this.header = this.measure = null;
    this.inPage = this.onCard = 0;
  }

  get triangles(): number {
    return this.header?.triangles ?? 0;
  }
  /** Bytes of arrays that the page still holds, and of buffers on the graphics card. */
  get bytes(): { readonly page: number; readonly card: number } {
    return { page: this.inPage, card: this.onCard };
  }
}
