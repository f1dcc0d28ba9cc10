#!/usr/bin/python3
"""How smooth a sphere of voxels becomes: isonest's smooth labels compared with a plain surface net and VTK.

usage: smooth_sphere.py ISONEST PLUGIN_FOLDER [--radius R] [--picture OUT.png]

A markdown table: for a ball with a radius of R (22) voxels, with its centre at a node and elsewhere, the angles between
facets' normals and the sphere's, in degrees; the volume relative to the sphere's; and how many nodes are on the wrong
side of the mesh.

plain net  Gibson's surface net, 16 passes by half the distance to the mean of the neighbours, each vertex kept in its
           cell; quads are cut along the shorter diagonal: the algorithm of vtkSurfaceNets3D (VTK 9.3 and newer), in NumPy.
VTK        vtkDiscreteFlyingEdges3D and vtkWindowedSincPolyDataFilter, 15 iterations.

OUT.png shows the second of these balls unsmoothed, smooth, and by VTK with the pass band 0.1, with flat triangles.
"""
import argparse
import os
import pathlib
import subprocess
import sys
import tempfile

import needs

CENTRES = ((0, 0, 0), (-0.37, 0.21, -0.1))  # relative to the central node


def ball(radius, shift):
    import numpy as np
    size = 2 * int(radius) + 12
    centre = np.array(shift) + size // 2
    nodes = np.indices((size,) * 3) - centre[:, None, None, None]  # z, y, x
    return ((nodes ** 2).sum(0) <= radius ** 2).astype("u1"), centre[::-1]


def plain_net(data, passes=16, weight=0.5):
    """Points, x, y, z, and triangles whose normals point outward."""
    import numpy as np
    inside = data > 0
    cells = tuple(n - 1 for n in inside.shape)
    corner = np.array([inside[k:k + cells[0], j:j + cells[1], i:i + cells[2]] for k in (0, 1) for j in (0, 1) for i in (0, 1)])
    crossed = corner.any(0) & ~corner.all(0)
    number = np.full(cells, -1)
    number[crossed] = np.arange(crossed.sum())
    at = np.argwhere(crossed)
    middle = at + 0.5
    place = middle.copy()
    joined = []  # pairs of neighbours across a face whose corners differ
    for axis in range(3):
        face = corner.reshape(2, 2, 2, *cells).take(1, axis).reshape(4, *cells)
        one = np.argwhere(face.any(0) & ~face.all(0))
        one = one[one[:, axis] < cells[axis] - 1]
        joined.append(np.stack([number[tuple(one.T)], number[tuple((one + np.eye(3, dtype=int)[axis]).T)]], 1))
    joined = np.concatenate(joined)
    joined = np.concatenate([joined, joined[:, ::-1]])
    count = np.bincount(joined[:, 0], minlength=len(at))[:, None]
    for _ in range(passes):
        total = np.stack([np.bincount(joined[:, 0], place[joined[:, 1], axis], len(at)) for axis in range(3)], 1)
        place = np.clip(place + weight * (total / count - place), middle - 0.5, middle + 0.5)
    quads = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        low, high = [slice(None)] * 3, [slice(None)] * 3
        low[axis], high[axis] = slice(0, -1), slice(1, None)
        a, b = inside[tuple(low)], inside[tuple(high)]
        for crossing, turned in ((a & ~b, False), (b & ~a, True)):
            edge = np.argwhere(crossing)
            ring = []
            for i, j in ((1, 1), (0, 1), (0, 0), (1, 0)):
                cell = edge.copy()
                cell[:, u] -= i
                cell[:, v] -= j
                ring.append(number[tuple(cell.T)])
            ring = np.stack(ring, 1)
            # Axes are z, y, x: a right-handed turn in them is a left-handed one in x, y, z.
            quads.append(ring if turned else ring[:, ::-1])
    q = np.concatenate(quads)
    longer = (np.linalg.norm(place[q[:, 0]] - place[q[:, 2]], axis=1) >
              np.linalg.norm(place[q[:, 1]] - place[q[:, 3]], axis=1))[:, None]
    triangles = np.where(longer[:, None], q[:, [[0, 1, 3], [1, 2, 3]]], q[:, [[0, 1, 2], [0, 2, 3]]])
    return place[:, ::-1], triangles.reshape(-1, 3)


def vtk_mesh(data, band):
    import vtk
    from vtk.util.numpy_support import numpy_to_vtk, vtk_to_numpy
    image = vtk.vtkImageData()
    image.SetDimensions(*data.shape[::-1])
    image.GetPointData().SetScalars(numpy_to_vtk(data.ravel()))
    edges = vtk.vtkDiscreteFlyingEdges3D()
    edges.SetInputData(image)
    edges.SetValue(0, 1)
    sinc = vtk.vtkWindowedSincPolyDataFilter()
    sinc.SetInputConnection(edges.GetOutputPort())
    sinc.SetNumberOfIterations(15)
    sinc.SetPassBand(band)
    sinc.BoundarySmoothingOff()
    sinc.FeatureEdgeSmoothingOff()
    sinc.NonManifoldSmoothingOn()
    sinc.NormalizeCoordinatesOn()
    sinc.Update()
    mesh = sinc.GetOutput()
    return (vtk_to_numpy(mesh.GetPoints().GetData()).astype(float),
            vtk_to_numpy(mesh.GetPolys().GetConnectivityArray()).reshape(-1, 3))


def read_ply(path):
    """Reads isonest's PLY without attributes."""
    import numpy as np
    content = path.read_bytes()
    head, body = content.split(b"end_header\n", 1)
    vertices, faces = (int(line.split()[2]) for line in head.decode().splitlines() if line.startswith("element"))
    points = np.frombuffer(body, "<f4", 3 * vertices).reshape(-1, 3)
    rows = np.frombuffer(body, np.dtype([("n", "u1"), ("corner", "<u4", 3)]), faces, 12 * vertices)
    return points.astype(float), rows["corner"].astype(int)


def write_stl(path, points, faces):
    import numpy as np
    rows = np.zeros(len(faces), np.dtype([("normal", "<f4", 3), ("corner", "<f4", (3, 3)), ("zero", "<u2")]))
    rows["corner"] = points[faces]
    path.write_bytes(b"\0" * 80 + np.uint32(len(faces)).tobytes() + rows.tobytes())


def wrong_nodes(points, faces, data):
    """The number of nodes around which the mesh does not wind once, if they are in the ball, or zero times, if not. Counts
    the triangles that the line through each node along x crosses beyond it. Lines are offset so that they meet no edge."""
    import numpy as np
    aside = np.array([1.3e-5, 2.9e-5])
    t = points[faces]
    crossings = np.zeros((*data.shape[:2], data.shape[2] + 1), int)
    low = np.ceil(t[:, :, 1:].min(1) - aside).astype(int)
    high = np.floor(t[:, :, 1:].max(1) - aside).astype(int)
    for dy, dz in np.ndindex(*((high - low).max(0) + 1)):
        line = low + (dy, dz)
        near = (line <= high).all(1)
        c, line = t[near], line[near]
        p = c[:, :, 1:] - (line + aside)[:, None]
        q = np.roll(p, -1, 1)
        side = p[:, :, 0] * q[:, :, 1] - p[:, :, 1] * q[:, :, 0]
        hit = (side > 0).all(1) | (side < 0).all(1)
        weight = np.roll(side[hit], -1, 1) / side[hit].sum(1)[:, None]
        x = (weight * c[hit][:, :, 0]).sum(1)
        np.add.at(crossings, (line[hit, 1], line[hit, 0], np.clip(np.ceil(x), 0, data.shape[2]).astype(int)),
                  np.sign(side[hit, 0]).astype(int))
    # A triangle whose normal points along x is crossed from the inside.
    turns = crossings[:, :, ::-1].cumsum(2)[:, :, ::-1][:, :, 1:]
    return int((turns != data).sum())


def figures(points, faces, data, centre, radius):
    import numpy as np
    t = points[faces]
    normal = np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0])
    out = t.mean(1) - centre
    cosine = (normal * out).sum(1) / np.maximum(np.linalg.norm(normal, axis=1) * np.linalg.norm(out, axis=1), 1e-300)
    angle = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
    volume = (t[:, 0] * np.cross(t[:, 1], t[:, 2])).sum() / 6
    return (angle.mean(), np.percentile(angle, 99), 100 * (volume / (4 / 3 * np.pi * radius ** 3) - 1),
            wrong_nodes(points, faces, data))


def draw(isonest, stls, picture):
    """Side by side, on white."""
    from PIL import Image
    side = 420
    whole = Image.new("RGB", (side * len(stls), side), "white")
    for i, stl in enumerate(stls):
        part = stl.with_suffix(".png")
        subprocess.run([isonest, "picture", stl, "-o", part, "--size", f"{side}x{side}", "--flat", "-q"], check=True)
        whole.paste(Image.open(part).convert("RGB"), (side * i, 0))
    whole.quantize(96).save(picture, optimize=True)


def main():
    given = needs.arguments(2, __doc__)
    parser = argparse.ArgumentParser(usage=__doc__)
    parser.add_argument("isonest", type=pathlib.Path)
    parser.add_argument("plugin")
    parser.add_argument("--radius", type=float, default=22)
    parser.add_argument("--picture", type=pathlib.Path)
    args = parser.parse_args(given)
    os.environ["HDF5_PLUGIN_PATH"] = args.plugin
    needs.require(needs.program(args.isonest), needs.module("numpy"), needs.module("vtk"),
                  needs.module("PIL") if args.picture else None)
    import numpy as np
    rows = {}
    with tempfile.TemporaryDirectory(prefix="isonest-sphere-") as name:
        here = pathlib.Path(name)
        for shift in CENTRES:
            data, centre = ball(args.radius, shift)
            np.save(here / "ball.npy", data)
            subprocess.run([args.isonest, "preprocess", here / "ball.npy", "--labels", "-o", here / "ball.isonest", "--force",
                            "-q"], check=True)

            def extracted(*options):
                subprocess.run([args.isonest, "extract", here / "ball.isonest", "--label", "1", *options, "-o",
                                here / "mesh.ply", "-q"], check=True)
                return read_ply(here / "mesh.ply")

            meshes = {"without smoothing": extracted(), "`--smooth`": extracted("--smooth"), "plain net": plain_net(data),
                      "VTK, pass band 0.1": vtk_mesh(data, 0.1), "VTK, pass band 0.001": vtk_mesh(data, 0.001)}
            for what, (points, faces) in meshes.items():
                rows.setdefault(what, []).append(figures(points, faces, data, centre, args.radius))
        print("| | mean angle | 99 % | volume, % | nodes on the wrong side |\n|---|---|---|---|---|")
        for what, found in rows.items():
            columns = zip(("{:.1f}", "{:.1f}", "{:+.1f}", "{}"), zip(*found))
            print(f"| {what} | " + " | ".join("; ".join(map(form.format, column)) for form, column in columns) + " |")
        if args.picture:
            shown = [meshes[what] for what in ("without smoothing", "`--smooth`", "VTK, pass band 0.1")]
            stls = [here / f"{i}.stl" for i in range(len(shown))]
            for stl, (points, faces) in zip(stls, shown):
                write_stl(stl, points, faces)
            draw(args.isonest, stls, args.picture)


if __name__ == "__main__":
    sys.exit(main())
