"""From an array to surfaces, slices and files, in cells (# %%) that an editor can run one by one.

usage: first_surface.py [FOLDER]   (output folder; default: the current folder)
"""
# %% A volume: two metaballs in 16-bit integers, like a scan, coarser along z.
import pathlib
import sys

import numpy as np

import isonest

folder = pathlib.Path(sys.argv[1] if len(sys.argv) > 1 else ".")
spacing = (2.0, 1.0, 1.0)
z, y, x = np.mgrid[-40:41:2, -40:41, -60:61].astype(np.float32)
field = sum(1 / ((x - a) ** 2 + y**2 + z**2 + 1) for a in (-22.0, 22.0))
volume = np.clip(field * 500_000, 0, 60_000).astype(np.uint16)

# %% Make the store, once. An existing file is replaced.
report = isonest.preprocess(volume, folder / "balls.isonest", spacing=spacing, replace=True)
print(report)
store = isonest.open(folder / "balls.isonest")

# %% The values, and suggested isovalues.
histogram = store.histogram()
print(f"{len(histogram.counts)} bins from {histogram.edges[0]:g} to {histogram.edges[-1]:g};",
      "suggested:", [f"{value:g}" for value, _ in histogram.suggested])

# %% The surface at full resolution, and with an error of at most 5 % of the isovalue.
level = 900.0
full = store.isosurface(level)
coarse = store.isosurface(level, error=0.05 * level)
print(f"full resolution: {len(full.faces)} triangles; "
      f"within {coarse.report.error_bound:.3g}: {len(coarse.faces)}")


# %% The enclosed volume: positive, because faces are oriented outward in world coordinates.
def volume_of(mesh: isonest.Mesh) -> float:
    a, b, c = (mesh.vertices[mesh.faces[:, i]].astype(float) for i in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


print(f"space within: {volume_of(full.in_world()):.0f}, coarse: {volume_of(coarse.in_world()):.0f}")

# %% A small mesh for a file, nowhere further than half a voxel from the full surface.
small = store.isosurface(level, distance="0.5voxel")
print(f"within {small.report.distance_bound:.3g}: {len(small.faces)} triangles")
np.savez(folder / "balls.npz", vertices=small.vertices, faces=small.faces)
small.save(folder / "balls.ply")

# %% The largest piece, closed at the faces of the volume, for 3D printing.
solid = store.isosurface(level, distance="0.5voxel", close=True, components="largest")
solid.save(folder / "ball.stl")
print(f"{solid.report.components} pieces, {len(solid.faces)} triangles in the largest")

# %% A slice through the middle, with the data at its vertices.
middle = store.slice((0, 1, 0), 40.0, error=200)
print(f"slice: {len(middle.faces)} triangles, values {middle.values.min():g} to {middle.values.max():g}")

# %% Conversion for other libraries.
try:
    small.to_meshio().write(folder / "balls.vtu")
    print("balls.vtu written")
except ImportError:
    print("meshio is not installed")
