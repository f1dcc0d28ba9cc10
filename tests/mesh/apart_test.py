"""Joining vertices by position gives the same mesh: no two have the same position, and no edge has more than two
triangles, even if nodes have the isovalue. Joined by numpy, and by VTK's STL reader.

Usage: apart_test.py ISONEST PLUGIN_FOLDER
"""
import json
import pathlib
import sys
import tempfile
import xml.etree.ElementTree as ElementTree
import zipfile

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served  # noqa: E402

import numpy as np
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkIOGeometry import vtkSTLReader
from vtkmodules.vtkIOPLY import vtkPLYReader

isonest = sys.argv[1]
KINDS = {"u1": "uint8", "i2": "int16", "f4": "float"}


def run(*arguments):
    done = served.run([isonest, *map(str, arguments)], capture_output=True, text=True)
    assert done.returncode == 0, (arguments, done.returncode, done.stderr)
    return json.loads(done.stdout) if "--json" in arguments else done.stderr


def write_volume(path, values, spacing=(1, 1, 1), origin=(0, 0, 0), axes=np.eye(3)):
    """`values`: z, y, x. `axes`: unit vectors."""
    directions = " ".join("(" + ",".join(repr(float(s * x)) for x in axis) + ")" for axis, s in zip(axes, spacing))
    head = (f"NRRD0004\ntype: {KINDS[values.dtype.str[1:]]}\ndimension: 3\nspace dimension: 3\n"
            f"sizes: {' '.join(map(str, values.shape[::-1]))}\nspace directions: {directions}\n"
            f"space origin: ({','.join(map(repr, origin))})\nencoding: raw\nendian: little\n\n")
    path.write_bytes(head.encode() + values.tobytes())


def vtk_mesh(reader, path):
    reader.SetFileName(str(path))
    reader.Update()
    data = reader.GetOutput()
    if data.GetNumberOfPoints() == 0:
        return np.zeros((0, 3), "f4"), np.zeros((0, 3), int)
    return (vtk_to_numpy(data.GetPoints().GetData()),
            vtk_to_numpy(data.GetPolys().GetConnectivityArray()).reshape(-1, 3))


def three_mf(path):
    with zipfile.ZipFile(path) as z:
        model = ElementTree.fromstring(z.read("3D/3dmodel.model"))
    core = "{http://schemas.microsoft.com/3dmanufacturing/core/2015/02}"
    return (np.array([[float(v.get(a)) for a in "xyz"] for v in model.iter(core + "vertex")], "f4").reshape(-1, 3),
            np.array([[int(t.get(a)) for a in ("v1", "v2", "v3")] for t in model.iter(core + "triangle")],
                     int).reshape(-1, 3))


def edge_counts(triangles):
    edges = np.sort(np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1)
    return np.unique(edges, axis=0, return_counts=True)[1]


def joined(points, triangles):
    """The number of vertices with a position of their own, and the triangles by position."""
    places, of = np.unique(points + np.float32(0), axis=0, return_inverse=True)
    return len(places), of.reshape(-1)[triangles]


def require_apart(points, triangles, what):
    places, by_place = joined(points, triangles)
    assert places == len(points), (what, len(points) - places, "vertices lie in the places of others")
    counts = edge_counts(by_place)
    assert len(counts) == 0 or counts.max() <= 2, (what, np.bincount(counts))
    return counts


def noise(shape, levels, seed, kind="u1"):
    return np.random.default_rng(seed).integers(0, levels, shape).astype(kind)


def touching_balls():
    """Balls of radius 4 whose surfaces share nodes: values are exact."""
    z, y, x = np.mgrid[:17, :19, :33].astype("f4")
    return np.maximum(16 - (x - 8) ** 2 - (y - 9) ** 2 - (z - 8) ** 2,
                      16 - (x - 16) ** 2 - (y - 9) ** 2 - (z - 8) ** 2).astype("f4")


def plateaus():
    """Planes, lines and nodes at the isovalue 2, with 1 and 3 on their sides."""
    v = np.ones((9, 12, 10), "u1")
    v[4] = 2                    # a plane with nothing on either side
    v[6:, 3, :] = 2
    v[1, 5, 2:8] = 2            # a line
    v[2, 8, 8] = 2              # a node
    v[7:, 6:10, 4:7] = 3
    v[0, :, :] = 2              # the border
    v[:, 0, 0] = 2
    return v


with tempfile.TemporaryDirectory(dir=served.MEMORY) as name:
    folder = pathlib.Path(name)
    count = 0

    def extracted(store, iso, *options, end="ply"):
        global count
        count += 1
        path = folder / f"m{count}.{end}"
        report = run("extract", store, "--iso", iso, *options, "--json", "-o", path)
        mesh = {"ply": lambda: vtk_mesh(vtkPLYReader(), path), "3mf": lambda: three_mf(path),
                "stl": lambda: vtk_mesh(vtkSTLReader(), path)}[end]()
        path.unlink()
        return mesh, report

    def extracted_slice(store, plane):
        path = folder / "slice.ply"
        report = run("slice", store, "--plane", plane, "--error", 0, "--json", "-o", path)
        return vtk_mesh(vtkPLYReader(), path), report

    with_nan = noise((8, 9, 10), 4, 5, "f4")
    with_nan[3, 4, 5:] = np.nan
    NEAR = (1, 1, 1), (0, 0, 0)
    volumes = {
        "two nodes along each axis": (noise((2, 2, 2), 3, 1), 1, *NEAR),
        "three levels": (noise((11, 13, 18), 3, 2), 1, *NEAR),
        "five levels, signed": (noise((16, 17, 15), 5, 3, "i2") - np.int16(2), 0, (0.5, 0.7, 1.1), (-3, 100, 7)),
        "plateaus": (plateaus(), 2, *NEAR),
        "touching balls": (touching_balls(), 0, *NEAR),
        "missing values": (with_nan, 2, *NEAR),
        "two values": (noise((12, 12, 12), 2, 4), 1, *NEAR),
        "far from 0": (noise((10, 11, 12), 3, 6), 1, (0.25, 0.25, 0.25), (100000, 0, -70000)),
    }
    volume, store = folder / "v.nrrd", folder / "s"
    moved = 0
    for what, (values, iso, spacing, origin) in volumes.items():
        write_volume(volume, values, spacing, origin)
        run("preprocess", volume, "-o", store, "--force", "--indicators",
            "linf_bar,linf_plus,deviation_bar,hex_deviation")
        voxel = min(spacing)
        box = ",".join(f"{o + s * (n - 1) * share:.17g}" for share in (0.21, 0.77)
                       for o, s, n in zip(origin, spacing, values.shape[::-1]))
        whole = ["--error", 0]
        for options in (whole, [*whole, "--cells", "hex"], [*whole, "--close"], [*whole, "--close", "--cells", "hex"],
                        [*whole, "--close", "--cells", "hex", "--box", box],
                        [*whole, "--close=above"], [*whole, "--box", box], [*whole, "--box", box, "--close"],
                        ["--error", 0.7, "--effort", "none"], ["--error", 0.7, "--cells", "hex", "--effort", "none"],
                        ["--error", 0.7], ["--error", 0.7, "--cells", "tet"],
                        ["--error", 0.7, "--close"], ["--error", 0.7, "--vertices", "exact"],
                        ["--distance", 0.3 * voxel], ["--distance", 0.3 * voxel, "--effort", "fast"],
                        ["--distance", 0.3 * voxel, "--cells", "tet"], ["--distance", 0.6 * voxel, "--close"],
                        ["--distance", 0.6 * voxel, "--effort", "none"], ["--triangles", 3000]):
            (points, triangles), report = extracted(store, iso, *options)
            case = (what, options)
            counts = require_apart(points, triangles, case)
            assert report["together_vertices"] == 0, case
            assert report["distance_bound"] <= options[1] if "--distance" in options else True, (case, report)
            moved += report["apart_vertices"]
            if "--close" in options and what != "missing values":
                assert (counts == 2).all(), case
    assert moved > 1000, moved

    # Formats: joined by their readers, and as they print numbers.
    write_volume(volume, noise((14, 15, 16), 3, 7), (0.5, 0.5, 0.7), (-12.3, 45.6, 0.1))
    run("preprocess", volume, "-o", store, "--force")
    for options in (["--error", 0], ["--error", 0, "--close"], ["--distance", 0.2, "--cells", "hex"]):
        (points, triangles), _ = extracted(store, 1, *options)
        counts = np.bincount(require_apart(points, triangles, options))
        for end in ("3mf", "stl"):
            (p, t), _ = extracted(store, 1, *options, end=end)
            assert len(p) == len(points) and len(t) == len(triangles), (options, end, len(p), len(points))
            assert np.array_equal(np.bincount(edge_counts(t)), counts), (options, end)
            assert np.array_equal(np.unique(p, axis=0), np.unique(points, axis=0)), (options, end)

    # Moves are small and as reported, and all other vertices stay where they are. Slightly beside the isovalue every
    # vertex has a position of its own, almost the same as at the isovalue.
    write_volume(volume, noise((12, 13, 14), 3, 8))
    run("preprocess", volume, "-o", store, "--force")
    for cells in ("tet", "hex"):
        (points, _), report = extracted(store, 1, "--error", 0, "--cells", cells)
        assert report["apart_vertices"] > 100 and 2 ** -16 <= report["coordinate_rounding"] < 5 * 2 ** -16, report
        off = np.abs(points.astype("f8") * 2 - np.round(points.astype("f8") * 2)).max(1)  # nodes, midpoints of edges
        off = np.minimum(off, np.abs(points.astype("f8") * 3 - np.round(points.astype("f8") * 3)).max(1))  # centres
        moved = (off > 2 ** -17) & (off < 2 ** -10)
        assert abs(moved.sum() - report["apart_vertices"]) <= 0.1 * report["apart_vertices"], (moved.sum(), report)
        _, report = extracted(store, 1.5, "--error", 0, "--cells", cells)
        assert report["apart_vertices"] == 0 and report["coordinate_rounding"] < 2 ** -20, report

    # The same bytes for any threads, memory and chunks.
    write_volume(volume, noise((40, 33, 50), 4, 9))
    small = folder / "small"
    run("preprocess", volume, "-o", store, "--force")
    run("preprocess", volume, "-o", small, "--force", "--chunk", 16)
    for options in (["--error", 0], ["--error", 0, "--cells", "hex"], ["--error", 0, "--close"],
                    ["--error", 1.2, "--effort", "none"]):
        meshes = set()
        for of, more in ((store, []), (store, ["--threads", 1]), (small, ["--threads", 7]),
                         (small, ["--memory", "40M", "--threads", 2])):
            path = folder / "bytes.ply"
            run("extract", of, "--iso", 2, *options, *more, "-o", path)
            meshes.add(path.read_bytes())
        assert len(meshes) == 1, options

    # A mesh that is rotated into the world's axes is rounded once more.
    c, s = np.cos(0.3), np.sin(0.3)
    axes = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) @ np.array([[1, 0, 0], [0, c, s], [0, -s, c]])
    for origin in ((0, 0, 0), (-2000, 3000, 10)):
        write_volume(volume, noise((14, 15, 16), 3, 10), (0.5, 0.5, 0.7), origin, axes)
        run("preprocess", volume, "-o", small, "--force")
        for options in (["--error", 0], ["--error", 0, "--close"], ["--distance", 0.2]):
            (points, triangles), report = extracted(small, 1, *options)
            require_apart(points, triangles, ("turned", origin, options))
            assert report["apart_vertices"] > 100 and report["together_vertices"] == 0, report

    # Slices through nodes, and labels that touch at edges and corners.
    for plane in ("0,0,1,3", "1,0,0,4.5", "1,1,0,20"):
        (points, triangles), _ = extracted_slice(store, plane)
        require_apart(points, triangles, plane)
    for label in (0, 1, 3):
        path = folder / "label.ply"
        run("extract", store, "--label", label, "-o", path)
        require_apart(*vtk_mesh(vtkPLYReader(), path), f"label {label}")
print("vertices joined by position make the same mesh")
