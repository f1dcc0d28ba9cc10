// The consumer project in TypeScript: compiled, not run.
import { IsonestError, open, type Slice, type Store, type Surface, vtkCells } from "isonest";

export async function shown(file: File): Promise<[Float32Array, Uint32Array]> {
  const store: Store = await open(file, { memory: 64 * 2 ** 20 });
  const [low, high] = store.info.range ?? [0, 1];
  const surface: Surface = await store.surface({ iso: (low + high) / 2, distance: "0.5voxel", effort: "fast" });
  const slice: Slice = await store.slice({ axis: "z", index: 3, error: 0.1 });
  const flat: Slice = await store.slice({ plane: [0, 0, 1, 2] });
  const image = await store.sliceImage({ axis: "x", position: 1.5, width: 100, error: "1%", space: "ras" });
  const cells: Uint32Array = vtkCells(flat);
  const bound: number = surface.bound + (image.errorBound ?? 0);
  const normals: Float32Array | null = surface.normals;
  await store.surface({ label: 5n, smooth: 16 }).catch((error: unknown) => error instanceof IsonestError && error.kind);
  store.close();
  return [slice.values, normals === null || bound > 1 ? cells : surface.indices];
}

export async function wrong(store: Store): Promise<void> {
  // @ts-expect-error an unknown effort
  await store.surface({ iso: 1, effort: "fastest" });
  // @ts-expect-error a distance with an unknown unit
  await store.surface({ iso: 1, distance: "1mile" });
  // @ts-expect-error an unknown option
  await store.surface({ iso: 1, errr: 3 });
  // @ts-expect-error no plane
  await store.slice({ error: 1 });
  // @ts-expect-error no width
  await store.sliceImage({ axis: "z", index: 1 });
  // @ts-expect-error not a source
  await open(5);
}
