#!/usr/bin/env python3
"""Edges with more than two triangles and vertices with several fans: counted in the report, and separated by --manifold.

Both are counted here with NumPy and scipy, by other means than the program: edges as sorted rows, fans as connected
components of the graph in which corners at a vertex are linked where their triangles have an edge in common.

usage: manifold_test.py ISONEST PLUGIN_FOLDER
"""
import ctypes.util
import json
import os
import pathlib
import sys
import tempfile
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served  # noqa: E402
from label_volumes import cells, corner_nodes, single_nodes  # noqa: E402
from mesh_data import read_ply, read_points  # noqa: E402

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

ISONEST = sys.argv[1]
os.environ["HDF5_PLUGIN_PATH"] = sys.argv[2]
RANDOM = np.random.default_rng(57)
LIB3MF = ctypes.CDLL(ctypes.util.find_library("3MF")) if ctypes.util.find_library("3MF") else None


def run(*arguments, code=0):
    done = served.run([ISONEST, *map(str, arguments)], capture_output=True, text=True)
    assert done.returncode == code, (arguments, done.returncode, done.stderr)
    return done


def counted(faces):
    """The number of edges with more than two triangles, of vertices with several fans, and of edges with one triangle."""
    if len(faces) == 0:
        return 0, 0, 0
    # Side k of a triangle leads from its corner k to the next one.
    sides = np.stack([faces, np.roll(faces, -1, 1)], -1).reshape(-1, 2)
    _, edge, times = np.unique(np.sort(sides, 1), axis=0, return_inverse=True, return_counts=True)
    edge = edge.reshape(-1)
    # Two corners at each end of a side: they have a side in common with all others of this edge and end.
    corner = np.arange(faces.size).reshape(-1, 3)
    ends = np.concatenate([corner.reshape(-1), np.roll(corner, -1, 1).reshape(-1)])
    vertex = faces.reshape(-1)[ends]
    _, group = np.unique(np.stack([np.concatenate([edge, edge]), vertex], 1), axis=0, return_inverse=True)
    group = group.reshape(-1) + faces.size
    size = group.max() + 1
    graph = coo_matrix((np.ones(len(ends), bool), (ends, group)), (size, size))
    fan = connected_components(graph, directed=False)[1][:faces.size]
    fans = np.unique(np.stack([faces.reshape(-1), fan], 1), axis=0)[:, 0]
    return int((times > 2).sum()), int((np.bincount(fans) > 1).sum()), int((times == 1).sum())


def reported(entry):
    return entry["nonmanifold_edges"], entry["nonmanifold_vertices"]


class Manifold(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory(prefix="isonest-test-", dir=served.MEMORY)
        cls.addClassCleanup(folder.cleanup)
        cls.here = pathlib.Path(folder.name)
        # A hole between two nodes of a solid, which touches itself along an edge. Both sides of the edge are connected at
        # either end of it, so that copies of its ends alone do not separate them.
        ring = np.zeros((9, 8, 8), int)
        ring[3:6, 3, 3] = ring[3:6, 4, 4] = ring[3, 3, 4] = ring[5, 3, 4] = 1
        cls.volumes = {
            "noise": RANDOM.integers(0, 3, (14, 15, 16)), "two": (RANDOM.random((17, 13, 12)) < 0.5).astype(int),
            "sparse": (RANDOM.random((18, 17, 16)) < 0.2).astype(int), "cells": cells(RANDOM, (20, 19, 18), 40, 5),
            "corners": corner_nodes(), "nodes": single_nodes(), "ring": ring}
        cls.stores = {}
        for name, labels in cls.volumes.items():
            np.save(cls.here / f"{name}.npy", labels.astype("u1"))
            cls.stores[name] = cls.here / f"{name}.isonest"
            run("preprocess", "--labels", cls.here / f"{name}.npy", "-o", cls.stores[name])

    def meshes(self, store, *options):
        """The entry of labels.json and the mesh of each label."""
        out = self.here / "out"
        text = json.loads(run("extract", store, "--labels", "all", "-o", out, "--json", *options).stdout)
        for entry in text["labels"]:
            yield entry, *read_points(out / entry["mesh"])

    def check(self, name, *options):
        """Returns how many edges and vertices were found and separated."""
        found = np.zeros(2, int)
        whole = list(self.meshes(self.stores[name], *options))
        separate = list(self.meshes(self.stores[name], *options, "--manifold"))
        for (entry, points, faces), (own, moved, apart) in zip(whole, separate):
            with self.subTest(volume=name, options=options, label=entry["id"]):
                self.assertEqual(entry["id"], own["id"])
                edges, vertices, border = counted(faces)
                self.assertEqual(counted(apart)[:2], (0, 0))
                copies = own["split_vertices"]
                if "--smooth" in options or "--smooth=0" in options:
                    self.assertEqual(reported(entry), (edges, vertices))
                    self.assertEqual(entry["split_vertices"], 0)
                else:
                    self.assertNotIn("nonmanifold_edges", entry)
                self.assertEqual(reported(own), (0, 0))
                # The same triangles, with copies of vertices behind the others.
                self.assertEqual(len(moved), len(points) + copies)
                self.assertEqual(own["vertices"], len(moved))
                np.testing.assert_array_equal(points, moved[:len(points)])
                np.testing.assert_array_equal(points[faces], moved[apart])
                self.assertEqual(len(np.unique(apart)), len(moved))
                self.assertEqual(copies > 0, edges + vertices > 0)
                # No border arises, and none is closed.
                self.assertEqual(counted(apart)[2], border)
                if "--close" in options:
                    self.assertEqual(border, 0)
                self.assertEqual(own["volume"], entry["volume"])
                self.assertEqual(own["area"], entry["area"])
                found += edges, vertices
        return found

    def test_smooth_labels(self):
        for name in self.volumes:
            for options in ((), ("--close",), ("--distance", "0.4voxel", "--close"),
                            ("--min-component", "20"), ("--distance", "1voxel", "--keep-nodes")):
                found = self.check(name, "--smooth", *options)
                if name in ("noise", "two", "ring"):
                    self.assertGreater(found[0], 0, (name, options))
        self.assertGreater(self.check("two", "--smooth=0", "--close")[0], 50)
        self.assertGreater(self.check("sparse", "--smooth", "--close")[1], 0)

    def test_plain_labels_and_isosurfaces_are_manifold(self):
        for name in ("noise", "two", "corners", "ring"):
            self.check(name)
            self.check(name, "--distance", "0.4voxel")
            for options in ((), ("--close",), ("--cells", "tet"), ("--distance", "0.5voxel")):
                mesh = self.here / "one.ply"
                plain = json.loads(run("extract", self.stores[name], "--label", 1, "-o", mesh, "--quality", "--json",
                                       *options).stdout)
                self.assertEqual(reported(plain), counted(read_points(mesh)[1])[:2])
                self.assertEqual(reported(plain), (0, 0))
        # Integers at an isovalue that nodes have: sheets meet in nodes and along edges.
        values = self.here / "values.npy"
        np.save(values, RANDOM.integers(0, 4, (13, 12, 14)).astype("u1"))
        store = self.here / "values.isonest"
        run("preprocess", values, "-o", store)
        for source in (values, store):
            for options in (("--iso", 2), ("--iso", 2, "--close"), ("--iso", 2, "--cells", "tet", "--normals"),
                            ("--iso", 1, "--error", 1), ("--iso", 2, "--distance", "0.5voxel")):
                mesh = self.here / "iso.ply"
                found = json.loads(run("extract", source, *options, "-o", mesh, "--quality", "--json").stdout)
                self.assertEqual(reported(found), counted(read_ply(mesh)[1].astype(int))[:2])
                bytes_of = mesh.read_bytes()
                run("extract", source, *options, "-o", mesh, "--manifold")
                if reported(found) == (0, 0):
                    self.assertEqual(mesh.read_bytes(), bytes_of)
                self.assertEqual(counted(read_ply(mesh)[1].astype(int))[:2], (0, 0))

    def test_same_bytes(self):
        """Independent of threads and memory, in formats with shared vertices and in files of several objects."""
        store = self.stores["two"]
        for end in ("ply", "obj", "vtp", "vtkhdf", "3mf", "glb"):
            made = []
            for limits in (("--threads", 1), ("--threads", 3, "--memory", "40M")):
                mesh = self.here / f"same.{end}"
                run("extract", store, "--label", 1, "--smooth", "--manifold", "-o", mesh, *limits)
                made.append(mesh.read_bytes())
            self.assertEqual(*made)
        both = self.here / "both.glb"
        text = json.loads(run("extract", self.stores["noise"], "--labels", "all", "--smooth", "--manifold", "-o", both,
                              "--json").stdout)
        for entry in text["labels"]:
            self.assertEqual(reported(entry), (0, 0))
            self.assertGreater(entry["split_vertices"], 0)

    def test_text(self):
        store = self.stores["two"]
        mesh = self.here / "t.ply"
        whole = run("extract", store, "--label", 1, "--smooth", "-o", mesh).stdout
        edges, vertices, _ = counted(read_points(mesh)[1])
        self.assertIn(f"touches itself in {edges} edges with more than two triangles and {vertices} vertices; --manifold",
                      whole)
        before = len(read_points(mesh)[0])
        text = run("extract", store, "--label", 1, "--smooth", "--manifold", "-o", mesh).stdout
        self.assertIn(f"{len(read_points(mesh)[0]) - before} vertices were added where the surface touches itself", text)
        self.assertNotIn("more than two triangles", text)

    def test_refused(self):
        store = self.stores["two"]
        for options, says, to in ((("--labels", "all", "--smooth", "--interfaces"), "interfaces of labels", "i.vtp"),
                                  (("--labels", "all", "--smooth", "--format", "neuroglancer-multilod"),
                                   "levels of detail", "n"),
                                  (("--labels", "all", "--smooth", "--format", "stl"), ".stl", "s"),
                                  (("--label", "1", "--smooth"), ".stl", "s.stl"),
                                  (("--label", "1", "--format", "3dtiles"), "3D Tiles", "tiles")):
            error = run("extract", store, *options, "--manifold", "-o", self.here / to, code=2).stderr
            self.assertIn(says, error)
            self.assertFalse((self.here / to).exists() and not (self.here / to).is_dir())
        np.save(self.here / "plane.npy", np.arange(64.0).reshape(8, 8))
        run("preprocess", self.here / "plane.npy", "-o", self.here / "plane.isonest")
        error = run("extract", self.here / "plane.isonest", "--iso", 20.5, "--manifold", "-o", self.here / "l.vtp",
                    code=2).stderr
        self.assertIn("isolines", error)

    @unittest.skipUnless(hasattr(LIB3MF, "lib3mf_reader_readfromfileutf8"), "version 1 of lib3mf is not installed")
    def test_lib3mf_accepts_it(self):
        """It refuses to print objects that are no manifold."""
        def is_manifold(path):
            """Of each object."""
            model, reader, objects, one = (ctypes.c_void_p() for _ in range(4))
            more, good = ctypes.c_int(), ctypes.c_int()
            found = []
            self.assertEqual(LIB3MF.lib3mf_createmodel(ctypes.byref(model)), 0)
            self.assertEqual(LIB3MF.lib3mf_model_queryreader(model, b"3mf", ctypes.byref(reader)), 0)
            self.assertEqual(LIB3MF.lib3mf_reader_readfromfileutf8(reader, str(path).encode()), 0)
            self.assertEqual(LIB3MF.lib3mf_model_getmeshobjects(model, ctypes.byref(objects)), 0)
            while LIB3MF.lib3mf_resourceiterator_movenext(objects, ctypes.byref(more)) == 0 and more.value:
                LIB3MF.lib3mf_resourceiterator_getcurrent(objects, ctypes.byref(one))
                self.assertEqual(LIB3MF.lib3mf_meshobject_ismanifoldandoriented(one, ctypes.byref(good)), 0)
                found.append(bool(good.value))
            return found

        for options, good in (((), False), (("--manifold",), True)):
            mesh = self.here / "print.3mf"
            run("extract", self.stores["two"], "--label", 1, "--smooth", "--close", *options, "-o", mesh)
            self.assertEqual(is_manifold(mesh), [good])


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
