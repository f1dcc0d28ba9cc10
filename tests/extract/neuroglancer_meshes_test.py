#!/usr/bin/env python3
"""Neuroglancer's meshes with several levels of detail, read by their specification and compared with .ply meshes.

Fragments are decoded by draco_decoder. Distances are measured by isonest_mesh_distance, a program that shares no code
with the library.

usage: neuroglancer_meshes_test.py ISONEST PLUGIN_FOLDER
"""
import collections
import json
import os
import pathlib
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served  # noqa: E402
from label_volumes import cells  # noqa: E402
from mesh_data import write_ply  # noqa: E402
from windings import windings  # noqa: E402

import numpy as np
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkIOPLY import vtkPLYReader

ISONEST = pathlib.Path(sys.argv[1])
os.environ["HDF5_PLUGIN_PATH"] = sys.argv[2]
RANDOM = np.random.default_rng(33)
MOST = 65535
MIDDLE = 32768  # where Neuroglancer places the middle plane of a fragment
EXTRACT = ("--labels", "all", "--format", "neuroglancer-multilod")

Level = collections.namedtuple("Level", "scale cells sizes fragments")  # a fragment: corners in the cell, triangles


def run(*arguments, code=0):
    done = served.run([ISONEST, *map(str, arguments)], capture_output=True, text=True)
    assert done.returncode == code, (arguments, done.returncode, done.stderr)
    return done


def read_ply(path):
    reader = vtkPLYReader()
    reader.SetFileName(str(path))
    reader.Update()
    data = reader.GetOutput()
    return vtk_to_numpy(data.GetPoints().GetData()).astype(float), vtk_to_numpy(data.GetPolys().GetConnectivityArray()).reshape(-1, 3)


def unpack(raw, folder):
    """The corners of a fragment as integers, and its triangles."""
    (folder / "f.drc").write_bytes(raw)
    subprocess.run(["draco_decoder", "-i", folder / "f.drc", "-o", folder / "f.ply"], check=True, capture_output=True)
    head, body = (folder / "f.ply").read_bytes().split(b"end_header\n", 1)
    words = head.decode().split()
    assert words.count("int") == 4 and "float" not in words, head  # Draco did not scale the positions
    vertices, faces = (int(words[words.index("element", at) + 2]) for at in (0, words.index("element") + 1))
    corners = np.frombuffer(body, "<i4", 3 * vertices).reshape(-1, 3)
    rows = np.frombuffer(body, np.dtype([("n", "u1"), ("v", "<i4", 3)]), faces, 12 * vertices)
    assert (rows["n"] == 3).all() and len(body) == 12 * vertices + 13 * faces
    return corners.astype(int), rows["v"].astype(int)


def z_order(cell):
    return sum((int(cell[axis]) >> bit & 1) << (3 * bit + axis) for bit in range(21) for axis in range(3))


class Mesh:
    """A label's mesh, in all levels of detail."""

    def __init__(self, folder, label, scratch):
        raw = (folder / f"{label}.index").read_bytes()
        self.chunk, self.origin = np.frombuffer(raw, "<f4", 6).astype(float).reshape(2, 3)
        count = int(np.frombuffer(raw, "<u4", 1, 24)[0])
        scales = np.frombuffer(raw, "<f4", count, 28)
        self.moved = np.frombuffer(raw, "<f4", 3 * count, 28 + 4 * count).reshape(count, 3)
        nodes = np.frombuffer(raw, "<u4", count, 28 + 16 * count)
        data, at, start = (folder / str(label)).read_bytes(), 28 + 20 * count, 0
        self.levels = []
        for scale, n in zip(scales, nodes.tolist()):
            cells_ = np.frombuffer(raw, "<u4", 3 * n, at).reshape(3, n).T.astype(int)
            sizes = np.frombuffer(raw, "<u4", n, at + 12 * n).tolist()
            at += 16 * n
            fragments = []
            for size in sizes:
                fragments.append(unpack(data[start:start + size], scratch) if size else None)
                start += size
            self.levels.append(Level(float(scale), cells_, sizes, fragments))
        assert at == len(raw) and start == len(data)

    def whole(self, level):
        """A whole level: corners in 1/65535 of its cells from the grid's origin, without duplicates, and triangles."""
        corners, faces, first = [], [], 0
        for cell, fragment in zip(self.levels[level].cells, self.levels[level].fragments):
            if fragment:
                corners.append(fragment[0] + cell * MOST)
                faces.append(fragment[1] + first)
                first += len(fragment[0])
        if not corners:
            return np.zeros((0, 3), int), np.zeros((0, 3), int)
        points, number = np.unique(np.concatenate(corners), axis=0, return_inverse=True)
        return points, number[np.concatenate(faces)]

    def placed(self, level):
        """The same with corners in units of the node distance."""
        corners, faces = self.whole(level)
        return self.origin + self.moved[level] + self.chunk * 2**level * (corners / MOST), faces


def open_edges(faces):
    """The edges that triangles traverse more often in one direction than in the other."""
    edges = collections.Counter()
    for a, b in np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]).tolist():
        edges[a, b] += 1
        edges[b, a] -= 1
    return [edge for edge, count in edges.items() if count]


def area_and_volume(points, faces):
    a, b, c = points[faces].swapaxes(0, 1)
    return np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2, (a * np.cross(b, c)).sum() / 6


class NeuroglancerMeshes(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory(prefix="isonest-test-")
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)

    def store(self, labels, *options):
        np.save(self.folder / "s.npy", labels.astype("u2"))
        run("preprocess", self.folder / "s.npy", "-o", self.folder / "s.isonest", "--chunk", 16, "--labels", "--force", *options)
        return self.folder / "s.isonest"

    def extract(self, store, *options):
        """The folder, and the report on the labels."""
        shutil.rmtree(self.folder / "m", ignore_errors=True)
        run("extract", store, *EXTRACT, "-o", self.folder / "m", *options)
        listed = json.loads((self.folder / "m" / "labels.json").read_text())
        return self.folder / "m", listed["labels"]

    def require_tree(self, mesh):
        """Traverses the octree as Neuroglancer does: from the top, nodes in the order of the Z-curve."""
        for level, (scale, cells_, sizes, fragments) in enumerate(mesh.levels):
            self.assertGreater(scale, 0)
            order = [z_order(cell) for cell in cells_]
            self.assertEqual(order, sorted(set(order)))
            if level > 0:
                self.assertEqual(scale, 2 * mesh.levels[level - 1].scale)
                here = {*map(tuple, cells_.tolist())}
                below = {*map(tuple, mesh.levels[level - 1].cells.tolist())}
                self.assertLessEqual({(x // 2, y // 2, z // 2) for x, y, z in below}, here)
            for cell, fragment in zip(cells_, fragments):
                if fragment is None:
                    continue
                corners, faces = fragment
                self.assertTrue((corners >= 0).all() and (corners <= MOST).all())
                self.assertTrue((np.sort(faces, 1)[:, 1:] != np.sort(faces, 1)[:, :-1]).all())
                if level > 0:
                    least, most = corners[faces].min(1), corners[faces].max(1)
                    self.assertFalse(((least < MIDDLE) & (most > MIDDLE)).any())
                    # Each eighth into which this fragment reaches has a node on the finer level, possibly an empty one.
                    eighths = {*map(tuple, (cell * 2 + (most > MIDDLE)).tolist())}
                    self.assertLessEqual(eighths, below)

    def distance(self, a, b):
        """Distance of two meshes, in both directions."""
        for name, mesh in (("a", a), ("b", b)):
            write_ply(self.folder / f"{name}.ply", *mesh)
        found = json.loads(subprocess.run(
            [ISONEST.with_name("isonest_mesh_distance"), self.folder / "a.ply", self.folder / "b.ply", "--max-only",
             "--epsilon", "0.01"], check=True, capture_output=True).stdout)
        return max(found[side]["max"] for side in ("a_to_b", "b_to_a"))

    def require_near(self, labels, spacing, *options, closed=True, smooth="--smooth"):
        """Compares all levels of all labels with the .ply of the full net."""
        store = self.store(labels + 1, "--spacing", ",".join(map(str, spacing)))
        close = ("--close",) if closed else ()
        folder, listed = self.extract(store, smooth, *close, *options)
        run("extract", store, "--labels", "all", smooth, *close, "-o", self.folder / "p")
        info = json.loads((folder / "info").read_text())
        self.assertEqual((info["@type"], info["vertex_quantization_bits"]), ("neuroglancer_multilod_draco", 16))
        transform = np.reshape(info["transform"], (3, 4))
        np.testing.assert_array_equal(transform, np.hstack([np.diag(spacing), np.zeros((3, 1))]))
        counts = []
        for entry in listed:
            mesh = Mesh(folder, entry["mesh"], self.folder)
            self.require_tree(mesh)
            full = read_ply(self.folder / "p" / f"{entry['id']}.ply")
            self.assertEqual(len(mesh.levels), len(entry["levels"]))
            for number, (level, said) in enumerate(zip(mesh.levels, entry["levels"])):
                whole, faces = mesh.placed(number)
                whole = whole * spacing
                self.assertEqual(said["triangles"], len(faces))
                self.assertEqual(said["fragments"], sum(size > 0 for size in level.sizes))
                self.assertEqual(said["bytes"], sum(level.sizes))
                # The scale is in units of the largest node distance, and does not include the rounding.
                step = mesh.chunk[0] * 2**number / MOST / 2 * np.linalg.norm(spacing)
                self.assertLessEqual(said["distance_bound"], level.scale * max(spacing) + step if number else np.inf)
                # Coordinates in a .ply file are rounded, too.
                room = 4 * np.spacing(np.float32(np.abs(full[0]).max(initial=1)))
                self.assertLessEqual(self.distance(full, (whole, faces)), said["distance_bound"] * (1 + 1e-5) + room)
                if closed:
                    self.assertEqual(open_edges(faces), [])
            counts.append([said["triangles"] for said in entry["levels"]])
            whole, faces = mesh.placed(0)
            if not options:
                # The plain mesh, rounded.
                area, volume = area_and_volume(whole * spacing, faces)
                plain_area, plain_volume = area_and_volume(*full)
                self.assertAlmostEqual(area / plain_area, 1, delta=1e-3)
                self.assertAlmostEqual(entry["area"] / plain_area, 1, delta=1e-6)
                if closed:
                    self.assertAlmostEqual(volume / plain_volume, 1, delta=1e-3)
                    inside = windings(np.round(whole * 2**20) / 2**20, faces, labels.shape)
                    np.testing.assert_array_equal(inside, labels + 1 == entry["id"])
        return counts

    def test_large_labels_lie_in_several_cells(self):
        labels = cells(RANDOM, (30, 70, 150), 5, 3)
        counts = self.require_near(labels, (1, 1, 1))
        self.assertTrue(all(len(levels) > 1 and levels[1] < levels[0] / 4 for levels in counts), counts)

    def test_shards_have_the_files_of_labels(self):
        """Read by the specification of neuroglancer_uint64_sharded_v1."""
        labels = np.kron(RANDOM.permutation(4 * 8 * 10).reshape(4, 8, 10), np.ones((4, 4, 4), int)) * 3
        store = self.store(labels + 1)
        folder, listed = self.extract(store, "--smooth")
        run("extract", store, "--labels", "all", "--smooth", "--format", "neuroglancer-sharded", "-o", self.folder / "s")
        info = json.loads((self.folder / "s" / "info").read_text())
        sharding = info.pop("sharding")
        self.assertEqual(info, json.loads((folder / "info").read_text()))
        self.assertEqual((sharding["@type"], sharding["hash"]), ("neuroglancer_uint64_sharded_v1", "identity"))
        bits, mini, shift = (sharding[name] for name in ("shard_bits", "minishard_bits", "preshift_bits"))
        self.assertEqual((sharding["data_encoding"], sharding["minishard_index_encoding"]), ("raw", "raw"))
        self.assertGreater(bits, 0)
        found, files = {}, sorted((self.folder / "s").glob("*.shard"))
        self.assertLessEqual(len(files), 2**bits)
        for file in files:
            raw, head = file.read_bytes(), 16 << mini
            for at, (start, end) in enumerate(np.frombuffer(raw, "<u8", 2 << mini).reshape(-1, 2).tolist()):
                ids, starts, sizes = np.frombuffer(raw[head + start:head + end], "<u8").reshape(3, -1).astype(int)
                place = 0
                for label, skip, size in zip(np.cumsum(ids).tolist(), starts.tolist(), sizes.tolist()):
                    place += skip
                    hashed = label >> shift
                    self.assertEqual((hashed >> mini) % 2**bits, int(file.stem, 16))
                    self.assertEqual(hashed % 2**mini, at)
                    self.assertEqual(len(file.stem), -(-bits // 4))
                    manifest = raw[head + place:head + place + size]
                    levels = int(np.frombuffer(manifest, "<u4", 1, 24)[0])
                    nodes = np.frombuffer(manifest, "<u4", levels, 28 + 16 * levels).tolist()
                    row, fragments = 28 + 20 * levels, 0
                    for n in nodes:
                        fragments += int(np.frombuffer(manifest, "<u4", n, row + 12 * n).sum())
                        row += 16 * n
                    found[label] = (manifest, raw[head + place - fragments:head + place])
                    place += size
        self.assertEqual(sorted(found), sorted(entry["id"] for entry in listed))
        for label, (manifest, fragments) in found.items():
            self.assertEqual(manifest, (folder / f"{label}.index").read_bytes())
            self.assertEqual(fragments, (folder / str(label)).read_bytes())
        listed = json.loads((self.folder / "s" / "labels.json").read_text())["labels"]
        self.assertLessEqual({entry["mesh"] for entry in listed}, {file.name for file in files})

    def test_anisotropic_ones(self):
        self.require_near(cells(RANDOM, (20, 40, 100), 6, 4), (0.75, 1.5, 3))

    def test_noise(self):
        self.require_near(RANDOM.integers(0, 3, (9, 10, 70)), (1, 2, 1))

    def test_open_at_the_border(self):
        self.require_near(cells(RANDOM, (20, 30, 90), 6, 4), (2, 1, 1), closed=False)

    def test_faces_of_voxels_that_lie_in_planes_of_the_grid(self):
        labels = np.zeros((8, 9, 134), int)
        labels[3:6, 1:, 2:130] = 1
        labels[1:3, 2:8, 60:70] = 2
        self.require_near(labels, (1, 1, 1), smooth="--smooth=0")

    def test_level_0_is_within_a_distance(self):
        labels = cells(RANDOM, (14, 16, 90), 30, 3)
        for options in (("--distance", 0.02), ("--distance", 0.1, "--keep-nodes"), ("--triangles", 5000)):
            counts = self.require_near(labels, (1, 1, 1.5), *options)
            self.assertTrue(all(len(levels) > 1 for levels in counts), counts)

    def test_places_in_the_world(self):
        """Units of nanometres, and rotated axes."""
        labels = cells(RANDOM, (20, 24, 70), 4, 3)
        (self.folder / "t.nrrd").write_bytes(
            b"NRRD0004\ntype: uint16\ndimension: 3\nsizes: 70 24 20\nendian: little\nspace dimension: 3\n"
            b'space units: "um" "um" "um"\nspace directions: (0.3,0.4,0) (-0.4,0.3,0) (0,0,1)\nspace origin: (1,-2,3)\n'
            b"encoding: raw\n\n" + (labels + 1).astype("<u2").tobytes())
        store = self.folder / "t.isonest"
        run("preprocess", self.folder / "t.nrrd", "-o", store, "--labels")
        folder, listed = self.extract(store, "--smooth")
        run("extract", store, "--labels", "all", "--smooth", "-o", self.folder / "p")
        transform = np.reshape(json.loads((folder / "info").read_text())["transform"], (3, 4))
        for entry in listed:
            whole, faces = Mesh(folder, entry["mesh"], self.folder).placed(0)
            points = whole @ transform[:, :3].T + transform[:, 3]
            full, full_faces = read_ply(self.folder / "p" / f"{entry['id']}.ply")
            self.assertLess(self.distance((points / 1000, faces), (full, full_faces)), 1e-3)

    def test_over_a_precomputed_volume_voxels_begin_at_their_corners(self):
        """A box of voxels covers the same space as in the volume: voxel i extends from i to i + 1 resolutions."""
        labels = np.zeros((9, 8, 7), int)
        labels[2:6, 3:5, 1:6] = 5  # z, y, x
        spacing, origin = np.array((4, 8, 2)), np.array((40, 0, -6))
        store = self.store(labels, "--spacing", "4,8,2", "--origin", "40,0,-6", "--unit", "nm")
        low, high = origin + spacing * (1, 3, 2), origin + spacing * (6, 5, 6)
        for over, moved in ((("--over", "precomputed"), 0), (("--over", "zarr"), -0.5), ((), -0.5)):
            expected = np.array((low, high)) + moved * spacing
            folder, _ = self.extract(store, "--smooth=0", *over)
            transform = np.reshape(json.loads((folder / "info").read_text())["transform"], (3, 4))
            points = Mesh(folder, 5, self.folder).placed(0)[0] @ transform[:, :3].T + transform[:, 3]
            self.assertLess(np.abs(np.array((points.min(0), points.max(0))) - expected).max(), 0.01, over)
            for smooth in (("--smooth=0",), ()):
                shutil.rmtree(self.folder / "n", ignore_errors=True)
                run("extract", store, "--labels", "all", "--format", "neuroglancer", *smooth, *over, "-o", self.folder / "n")
                raw = (self.folder / "n" / "5.ngmesh").read_bytes()
                points = np.frombuffer(raw, "<f4", 3 * int.from_bytes(raw[:4], "little"), 4).reshape(-1, 3)
                self.assertLess(np.abs(np.array((points.min(0), points.max(0))) - expected).max(), 1e-4, (over, smooth))
        for wrong in (("--format", "ply", "--over", "zarr"), ("--over", "precomputed"), ("--format", "neuroglancer", "--over", "nrrd")):
            self.assertIn("--over", run("extract", store, "--labels", "all", *wrong, "-o", self.folder / "no", code=2).stderr)

    def test_same_bytes(self):
        store = self.store(cells(RANDOM, (20, 30, 90), 9, 7) + 1)
        files = None
        for options in (("--threads", 1), ("--threads", 3), ("--memory", "150M", "--threads", 2)):
            folder, _ = self.extract(store, "--smooth", *options)
            found = {path.name: path.read_bytes() for path in folder.iterdir()}
            found["labels.json"] = b""  # it contains times
            self.assertEqual(files or found, found)
            files = found

    def test_what_a_stopped_run_leaves_is_whole(self):
        store = self.store(cells(RANDOM, (40, 60, 90), 60, 60) + 1)
        for number in (signal.SIGTERM, signal.SIGKILL):
            folder = self.folder / f"stopped{number}"
            with subprocess.Popen([ISONEST, "extract", store, *EXTRACT, "--smooth", "-o", folder, "--threads", "1", "-q"],
                                  stderr=subprocess.DEVNULL) as process:
                while process.poll() is None and not any(folder.glob("*.index")):
                    time.sleep(0.001)
                process.send_signal(number)
                stopped = process.wait() != 0
            names = {path.name for path in folder.iterdir() if not path.name.startswith(".")}
            if number == signal.SIGTERM:
                self.assertEqual(sorted(path.name for path in folder.glob(".*")), [])
            if stopped:
                self.assertFalse({"info", "labels.json"} & names)
            self.assertLessEqual({name.removesuffix(".index") for name in names}, names)
            for name in names:
                if name.endswith(".index"):
                    Mesh(folder, name.removesuffix(".index"), self.folder)

    def test_names(self):
        (self.folder / "names").write_text("1 back\\slash 255 0 0 255\n2 bone 0 255 0 255\n")
        labels = cells(RANDOM, (12, 12, 12), 9, 3) + 1
        store = self.store(labels, "--label-names", self.folder / "names")
        folder, listed = self.extract(store, "--smooth")
        place = json.loads((folder / "info").read_text())["segment_properties"]
        properties = json.loads((folder / place / "info").read_text())
        self.assertEqual(properties["@type"], "neuroglancer_segment_properties")
        self.assertEqual(properties["inline"]["ids"], [str(entry["id"]) for entry in listed])
        self.assertEqual(properties["inline"]["properties"],
                         [{"id": "label", "type": "label", "values": [entry.get("name", "") for entry in listed]}])
        self.assertIn("bone", properties["inline"]["properties"][0]["values"])
        run("extract", store, "--labels", "all", "--format", "neuroglancer", "-o", self.folder / "legacy")
        self.assertEqual(json.loads((self.folder / "legacy" / "info").read_text()),
                         {"@type": "neuroglancer_legacy_mesh", "segment_properties": "segment_properties"})
        self.assertEqual(json.loads((self.folder / "legacy" / "segment_properties" / "info").read_text()), properties)
        for place in (folder, self.folder / "legacy"):
            self.assertEqual(json.loads((place / "segment_colors.json").read_text()),
                             {"segmentColors": {"1": "#ff0000", "2": "#00ff00"}})
        run("extract", self.store(labels), "--labels", "all", "--format", "neuroglancer", "-o", self.folder / "plain")
        self.assertFalse((self.folder / "plain" / "segment_colors.json").exists())

    def test_a_label_without_a_surface(self):
        store = self.store(np.ones((8, 8, 8), int))
        folder, listed = self.extract(store, "--smooth")
        mesh = Mesh(folder, listed[0]["mesh"], self.folder)
        self.assertEqual([(level.cells.tolist(), level.sizes) for level in mesh.levels], [([[0, 0, 0]], [0])])

    def test_what_makes_no_sense_is_refused(self):
        store = self.store(cells(RANDOM, (12, 12, 12), 4, 3) + 1)
        for options, words, code in (((), "smooth", 2), (("--smooth", "--components", "largest"), "levels of detail", 2),
                                     (("--smooth", "--memory", "40M"), "--memory", 7)):
            error = run("extract", store, *EXTRACT, "-o", self.folder / "none", *options, code=code).stderr
            self.assertIn(words, error)
            self.assertEqual([path.name for path in (self.folder / "none").iterdir()], [])
        np.save(self.folder / "n.npy", np.arange(64, dtype="i2").reshape(4, 4, 4) // 8 - 3)
        run("preprocess", self.folder / "n.npy", "-o", self.folder / "n.isonest")
        self.assertIn("negative labels", run("extract", self.folder / "n.isonest", *EXTRACT, "--smooth", "-o", self.folder / "none",
                                     code=2).stderr)


class WithoutDraco(unittest.TestCase):
    def test_it_is_said(self):
        with tempfile.TemporaryDirectory(prefix="isonest-test-") as folder:
            np.save(f"{folder}/s.npy", np.arange(64, dtype="u1").reshape(4, 4, 4) // 8)
            run("preprocess", f"{folder}/s.npy", "-o", f"{folder}/s.isonest")
            self.assertIn("libdraco-dev", run("extract", f"{folder}/s.isonest", *EXTRACT, "--smooth", "-o", f"{folder}/m",
                                              code=5).stderr)


def has_draco():
    with tempfile.TemporaryDirectory(prefix="isonest-test-") as folder:
        np.save(f"{folder}/s.npy", np.arange(64, dtype="u1").reshape(4, 4, 4) // 8)
        run("preprocess", f"{folder}/s.npy", "-o", f"{folder}/s.isonest")
        return served.run([ISONEST, "extract", f"{folder}/s.isonest", *EXTRACT, "--smooth", "-o", f"{folder}/m"],
                          capture_output=True).returncode != 5


if __name__ == "__main__":
    if not has_draco():
        unittest.main(argv=[sys.argv[0], "WithoutDraco"])
    if not shutil.which("draco_decoder"):
        print("skipped: draco_decoder is missing (Debian's draco)")
        sys.exit(77)
    unittest.main(argv=[sys.argv[0], "NeuroglancerMeshes"])
