#!/usr/bin/env python3
"""Interfaces of labels: each occurs once, with the labels on both sides, and together they make the labels' meshes.

The expected labels beside a triangle are read from the volume: a quad surrounds the edge between two nodes, which
follows from its four cells. Files are read by VTK, h5py, and a parser of PLY's header.

usage: interfaces_test.py ISONEST PLUGIN_FOLDER
"""
import json
import os
import pathlib
import sys
import tempfile
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served  # noqa: E402
from label_volumes import cells, corner_nodes, cyclic, single_nodes  # noqa: E402
from mesh_data import read_points  # noqa: E402

import h5py
import numpy as np
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkIOPLY import vtkPLYReader
from vtkmodules.vtkIOXML import vtkXMLPolyDataReader

ISONEST = sys.argv[1]
os.environ["HDF5_PLUGIN_PATH"] = sys.argv[2]

RANDOM = np.random.default_rng(71)
OUTSIDE = -1


def run(*arguments, code=0):
    done = served.run([ISONEST, *map(str, arguments)], capture_output=True, text=True)
    assert done.returncode == code, (arguments, done.returncode, done.stderr)
    return done


def read_vtp(path):
    """Points, triangles and the labels of both sides."""
    reader = vtkXMLPolyDataReader()
    reader.SetFileName(str(path))
    reader.Update()
    data = reader.GetOutput()
    if data.GetNumberOfCells() == 0:
        return np.zeros((0, 3), "f4"), np.zeros((0, 3), int), np.zeros((0, 2), int)
    sides = data.GetCellData().GetArray("BoundaryLabels")
    assert sides.GetNumberOfComponents() == 2 and sides.GetDataTypeSize() == 8
    return (vtk_to_numpy(data.GetPoints().GetData()),
            vtk_to_numpy(data.GetPolys().GetConnectivityArray()).reshape(-1, 3), vtk_to_numpy(sides))


def read_vtkhdf(path):
    with h5py.File(path) as file:
        root = file["VTKHDF"]
        sides = root["CellData/BoundaryLabels"]
        assert sides.dtype == np.dtype("<i8") and root["NumberOfPoints"][0] == len(root["Points"])
        ends = root["Polygons/Offsets"][:]
        assert (ends == 3 * np.arange(len(sides) + 1)).all()
        return root["Points"][:], root["Polygons/Connectivity"][:].reshape(-1, 3), sides[:].reshape(-1, 2)


def read_ply(path):
    """Parses the file by its header, without other knowledge of it."""
    kinds = {"float": "<f4", "double": "<f8", "int": "<i4", "uint": "<u4", "uchar": "u1"}
    data = path.read_bytes()
    head, _, body = data.partition(b"end_header\n")
    lines = [line.split() for line in head.decode().splitlines()]
    assert lines[:2] == [["ply"], ["format", "binary_little_endian", "1.0"]]
    tables, at = {}, 0
    for line in lines:
        if line[0] == "element":
            tables[line[1]] = (int(line[2]), [])
        elif line[:2] == ["property", "list"]:
            list(tables.values())[-1][1].extend([(line[4] + "_count", kinds[line[2]]), (line[4], kinds[line[3]], 3)])
        elif line[0] == "property":
            list(tables.values())[-1][1].append((line[2], kinds[line[1]]))
    rows = {}
    for name, (count, fields) in tables.items():
        rows[name] = np.frombuffer(body, fields, count, at)
        at += rows[name].nbytes
    assert at == len(body)
    vertex, face = rows["vertex"], rows["face"]
    assert (face["vertex_indices_count"] == 3).all()
    return (np.stack([vertex[a] for a in "xyz"], 1), face["vertex_indices"].astype(int),
            np.stack([face["label_behind"], face["label_in_front"]], 1).astype(int))


READERS = {"vtp": read_vtp, "vtkhdf": read_vtkhdf, "ply": read_ply}


def beside(nodes, cells):
    """The labels at both ends of the edges that quads surround, and the axes of these edges.

    nodes: [z, y, x], with a layer around the volume. cells: (quads, 4, 3), z, y, x; number 0 is the first one of the
    layer.
    """
    low = cells.min(1)
    across = cells.max(1) - low  # 0 along the edge, 1 along the others
    assert (np.sort(across, 1) == [0, 1, 1]).all()
    axis = across.argmin(1)
    first = low + 1  # the node between the four cells, along the axes across the edge
    first[np.arange(len(first)), axis] = low[np.arange(len(first)), axis]
    second = first.copy()
    second[np.arange(len(first)), axis] += 1
    return np.stack([nodes[tuple(first.T)], nodes[tuple(second.T)]], 1), axis


def volumes():
    """Volumes of labels, with their names."""
    yield "two labels in noise", RANDOM.integers(0, 2, (11, 9, 13))
    yield "many labels in noise", RANDOM.integers(0, 40, (9, 12, 10))
    yield "two by two", RANDOM.integers(0, 3, (2, 2, 19))
    yield "two nodes thick", RANDOM.integers(0, 3, (14, 15, 2))
    yield "nodes that touch by corners", corner_nodes()
    yield "single nodes", single_nodes()
    yield "one label alone", np.full((4, 5, 6), 3)
    # Several pieces, and blocks, along each axis.
    yield "several pieces", cells(RANDOM, (40, 70, 75), 60, 12)


class Interfaces(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory(prefix="isonest-test-", dir=served.MEMORY)
        self.addCleanup(folder.cleanup)
        self.here = pathlib.Path(folder.name)

    def store(self, data, *options, name="s", chunk=8):
        np.save(self.here / f"{name}.npy", data)
        run("preprocess", self.here / f"{name}.npy", "-o", self.here / f"{name}.isonest", "--chunk", chunk, "--force",
            *options)
        return self.here / f"{name}.isonest"

    def interfaces(self, store, *options, labels="0-100", end="vtp", smooth="--smooth"):
        """The mesh, and the program's report."""
        path = self.here / f"i.{end}"
        done = run("extract", store, "--labels", labels, smooth, "--interfaces", "-o", path, "--json", *options)
        return READERS[end](path), json.loads(done.stdout)

    def meshes(self, store, *options, labels="0-100", smooth="--smooth"):
        """Points and triangles by label."""
        run("extract", store, "--labels", labels, smooth, "-o", self.here / "m", *options)
        listed = json.loads((self.here / "m" / "labels.json").read_text())["labels"]
        return {entry["id"]: read_points(self.here / "m" / entry["mesh"]) for entry in listed}

    def check_cut(self, mesh, meshes, wanted=None):
        """Each label's mesh consists of the interfaces that have it behind them and, reversed, those that have it in
        front."""
        points, faces, sides = mesh
        self.assertEqual(len(np.unique(faces)), len(points))  # there are no unused vertices
        self.assertEqual(len(np.unique(np.ascontiguousarray(points).view("V12"))), len(points))
        own = np.array(cyclic(points, faces), object)
        turned = np.array(cyclic(points, faces[:, ::-1]), object)
        self.assertEqual(len(set(own.tolist()) | set(turned.tolist())), 2 * len(faces))  # each triangle occurs once
        for label, (their_points, their_faces) in meshes.items():
            cut = own[sides[:, 0] == label].tolist() + turned[sides[:, 1] == label].tolist()
            self.assertEqual(sorted(cut), sorted(cyclic(their_points, their_faces)), label)
        beside_wanted = np.isin(sides, list(meshes if wanted is None else wanted)).any(1)
        self.assertTrue(beside_wanted.all())

    def check_sides(self, mesh, data, spacing, origin, missing=None):
        """The labels are those of the two nodes, and the triangles face from the first to the second."""
        points, faces, sides = mesh
        nodes = np.pad(data.astype(np.int64), 1, constant_values=OUTSIDE)
        if missing is not None:
            nodes[1:-1, 1:-1, 1:-1][missing] = OUTSIDE
        cell = np.floor((points.astype(float) - origin) / spacing).astype(int)[:, ::-1] + 1
        pairs = faces.reshape(-1, 6)  # the two triangles of a quad are consecutive
        four = np.array([sorted(set(row)) for row in pairs.tolist()], int).reshape(-1, 4)
        ends, axis = beside(nodes, cell[four])
        found = sides.reshape(-1, 2, 2)
        np.testing.assert_array_equal(found[:, 0], found[:, 1])
        is_last = ends == OUTSIDE
        swapped = np.where(is_last.any(1), is_last[:, 0], ends[:, 0] > ends[:, 1])
        np.testing.assert_array_equal(found[:, 0], np.where(swapped[:, None], ends[:, ::-1], ends))
        self.assertTrue((found[:, 0, 0] != found[:, 0, 1]).all())
        # The area vector of a quad along its edge points from the first label to the second.
        at = points.astype(float)[faces]
        normal = np.cross(at[:, 1] - at[:, 0], at[:, 2] - at[:, 0])[:, ::-1].reshape(-1, 2, 3).sum(1)
        along = normal[np.arange(len(axis)), axis]
        self.assertTrue((np.sign(along) == np.where(swapped, -1, 1)).all())

    def test_each_is_there_once_with_the_labels_of_the_nodes_on_both_sides_and_meshes_are_cut_from_it(self):
        for name, data in volumes():
            for passes, spacing in ((0, (1, 1, 1)), (5, (0.5, 1, 4)), (16, (2, 0.25, 1))):
                for close in ((), ("--close",)):
                    with self.subTest(volume=name, passes=passes, close=close):
                        origin = tuple(64 * s for s in spacing)
                        store = self.store(data.astype("u1"), "--spacing", ",".join(map(str, spacing)), "--origin",
                                           ",".join(map(str, origin)))
                        mesh, done = self.interfaces(store, *close, smooth=f"--smooth={passes}")
                        self.assertEqual((done["vertices"], done["triangles"]), (len(mesh[0]), len(mesh[1])))
                        self.check_cut(mesh, self.meshes(store, *close, smooth=f"--smooth={passes}"))
                        self.check_sides(mesh, data, spacing, origin)
                        self.assertEqual((mesh[2] == OUTSIDE).any(), bool(close))
                        self.check_report(mesh, done)

    def check_report(self, mesh, done):
        points, faces, sides = mesh
        self.assertEqual(done["outside"], OUTSIDE)
        pairs = [tuple(one["labels"]) for one in done["interfaces"]]
        self.assertEqual(len(pairs), done["interface_count"])
        self.assertEqual(sorted(pairs), sorted({tuple(row) for row in sides.tolist()}))
        t = points.astype(float)[faces]
        area = np.linalg.norm(np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0]), axis=1) / 2
        for one in done["interfaces"]:
            self.assertAlmostEqual(area[(sides == one["labels"]).all(1)].sum() / one["area"], 1, 9)
        self.assertAlmostEqual(done["area"], area.sum(), delta=1e-9 * (1 + area.sum()))

    def test_some_labels_have_the_interfaces_that_they_have_among_all(self):
        data = cells(RANDOM, (40, 70, 75), 60, 12)
        store = self.store(data.astype("u2"))
        (points, faces, sides), _ = self.interfaces(store, "--close")
        every = dict(zip(cyclic(points, faces), map(tuple, sides.tolist())))
        for labels, wanted in (("3", [3]), ("2,7-9", [2, 7, 8, 9]), ("all", list(range(1, 12)))):
            mesh, done = self.interfaces(store, "--close", labels=labels)
            self.assertEqual(dict(zip(cyclic(*mesh[:2]), map(tuple, mesh[2].tolist()))),
                             {key: pair for key, pair in every.items() if set(pair) & set(wanted)})
            self.check_cut(mesh, self.meshes(store, "--close", labels=labels))
            self.check_report(mesh, done)

    def test_missing_nodes_are_outside_and_a_negative_label_moves_its_number(self):
        data = cells(RANDOM, (20, 17, 22), 14, 6)
        missing = (data == 2) | (RANDOM.random(data.shape) < 0.05)
        store = self.store(np.where(missing, np.nan, data).astype("f4"), "--origin", "64,64,64")
        for close in ((), ("--close",)):
            mesh, done = self.interfaces(store, *close)
            self.check_cut(mesh, self.meshes(store, *close))
            self.check_sides(mesh, data, (1, 1, 1), (64, 64, 64), missing)
            self.check_report(mesh, done)
        low, done = self.interfaces(self.store((data - 3).astype("i2")), "--close", labels="-3--1,0-9")
        self.assertEqual(done["outside"], -4)
        self.assertEqual(set(np.unique(low[2])), {-4, *np.unique(data - 3)})
        known = low[2] != -4
        self.assertTrue((low[2][known.all(1), 0] < low[2][known.all(1), 1]).all() and known[:, 0].all())
        # Also if the negative label is not requested.
        one, done = self.interfaces(self.store((data - 3).astype("i2")), "--close", labels="2")
        self.assertEqual(done["outside"], -4)
        self.assertIn(-4, one[2])

    def test_a_turned_volume_has_turned_interfaces(self):
        data = cells(RANDOM, (20, 17, 22), 14, 6)
        (points, faces, sides), straight = self.interfaces(self.store(data.astype("u1"), "--origin", "5,-7,3"), "--close")
        axes = np.array([[0.6, 0.8, 0], [-0.8, 0.6, 0], [0, 0, 1]])
        origin = np.array([5, -7, 3])
        (self.here / "turned.nrrd").write_bytes(
            (f"NRRD0004\ntype: uint8\ndimension: 3\nspace dimension: 3\nsizes: {' '.join(map(str, data.shape[::-1]))}\n"
             f"space directions: {' '.join('({},{},{})'.format(*axis) for axis in axes)}\n"
             f"space origin: ({','.join(map(str, origin))})\nencoding: raw\n\n").encode() + data.astype("u1").tobytes())
        run("preprocess", self.here / "turned.nrrd", "-o", self.here / "turned.isonest")
        found, done = self.interfaces(self.here / "turned.isonest", "--close")
        np.testing.assert_allclose(found[0], (points - origin) @ axes + origin, atol=1e-5)
        np.testing.assert_array_equal(found[1], faces)
        np.testing.assert_array_equal(found[2], sides)
        self.assertAlmostEqual(done["area"] / straight["area"], 1, 5)
        self.check_cut(found, self.meshes(self.here / "turned.isonest", "--close"))

    def test_all_formats_have_the_same_mesh(self):
        data = cells(RANDOM, (40, 45, 50), 40, 12)
        store = self.store(data.astype("u2"))
        first, _ = self.interfaces(store, "--close")
        self.assertGreater(len(first[1]), 20000)
        for end in ("vtkhdf", "ply"):
            again, _ = self.interfaces(store, "--close", end=end)
            for one, other in zip(first, again):
                np.testing.assert_array_equal(one, other)
        reader = vtkPLYReader()  # which does not know about labels
        reader.SetFileName(str(self.here / "i.ply"))
        reader.Update()
        np.testing.assert_array_equal(
            vtk_to_numpy(reader.GetOutput().GetPolys().GetConnectivityArray()).reshape(-1, 3), first[1])
        # No labels at all.
        for end in READERS:
            empty, done = self.interfaces(self.store(np.full((4, 5, 6), 3, "u1"), name="one"), end=end)
            self.assertEqual((len(empty[0]), len(empty[1]), len(empty[2]), done["interface_count"]), (0, 0, 0, 0))

    def test_labels_beyond_32_bits_are_whole_or_refused(self):
        data = cells(RANDOM, (9, 10, 11), 6, 4).astype("u8")
        data[data == 3] = 2 ** 61 + 7
        store = self.store(data, "--labels")
        for end in ("vtp", "vtkhdf"):
            mesh, _ = self.interfaces(store, "--close", labels="all", end=end)
            self.assertIn(2 ** 61 + 7, mesh[2])
            self.assertTrue(np.isin(mesh[2], [-1, *np.unique(data)]).all())
        (self.here / "i.ply").unlink(missing_ok=True)
        refused = run("extract", store, "--labels", "all", "--smooth", "--interfaces", "--close", "-o",
                      self.here / "i.ply", code=7).stderr
        self.assertIn("32 bits", refused)
        self.assertIn(".vtp", refused)
        self.assertFalse((self.here / "i.ply").exists())
        for label, code in ((2 ** 31 - 1, 0), (2 ** 31, 7)):
            edge = self.store(np.where(data == 2, label, data & 3).astype("u4"), name="edge")
            run("extract", edge, "--labels", "all", "--smooth", "--interfaces", "-o", self.here / "i.ply", code=code)

    def test_bytes_depend_on_neither_threads_memory_nor_chunks(self):
        data = cells(RANDOM, (70, 45, 90), 80, 30).astype("u2")
        data[20:40, 20:30, 30:60] = RANDOM.integers(0, 5, (20, 10, 30))
        stores = [self.store(data, name=f"s{chunk}", chunk=chunk) for chunk in (8, 16, 64)]
        first = {}
        for store, options in ((stores[0], ("--threads", 1)), (stores[0], ("--threads", 2)), (stores[1], ("--threads", 7)),
                               (stores[2], ("--threads", 2, "--memory", "48M")), (stores[0], ("--memory", "26M"))):
            for end in READERS:
                for smooth in ("--smooth=3", "--smooth"):
                    path = self.here / f"i.{end}"
                    run("extract", store, "--labels", "all", smooth, "--interfaces", "-o", path, *options)
                    self.assertEqual(first.setdefault((end, smooth), path.read_bytes()), path.read_bytes(), options)

    def test_what_makes_no_sense_is_refused_with_a_way_out(self):
        data = cells(RANDOM, (9, 9, 9), 4, 9)
        data[0, 0, :2] = 3, 4
        store = self.store(data.astype("u1"))

        def refused(*options, store=store, to="i.vtp", code=2):
            path = self.here / to
            path.unlink(missing_ok=True)
            error = run("extract", store, *options, "-o", path, code=code).stderr
            self.assertFalse(path.exists())
            return error

        self.assertIn("--smooth", refused("--labels", "all", "--interfaces"))
        self.assertIn("--labels", refused("--label", 3, "--smooth", "--interfaces"))
        self.assertIn("--labels", refused("--iso", 1, "--interfaces"))
        self.assertIn("--format", refused("--labels", "all", "--smooth", "--interfaces", "--format", "ply"))
        for end in ("stl", "obj", "glb", "3mf", "ngmesh"):
            self.assertIn(".vtp, .vtkhdf or .ply", refused("--labels", "all", "--smooth", "--interfaces", to=f"i.{end}"))
        self.assertIn("components", refused("--labels", "3", "--smooth", "--interfaces", "--components", "largest"))
        for options in (("--box", "0,0,0,3,3,3"), ("--cells", "tet"), ("--cells", "hex"), ("--normals",), ("--close=above",),
                        ("--vertex-values", store)):
            self.assertIn("smooth", refused("--labels", "3", "--smooth", "--interfaces", *options))
        self.assertIn("no label 77", refused("--labels", "77", "--smooth", "--interfaces", code=3))
        self.assertIn("memory", refused("--labels", "3", "--smooth=64", "--interfaces", "--memory", "12M", code=7))


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
