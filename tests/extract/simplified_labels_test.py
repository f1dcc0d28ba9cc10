#!/usr/bin/env python3
"""Simplified smooth labels: within the distance, nodes stay on their sides, neighbours share the simplified interface.

Distances are measured by isonest_mesh_distance, a program that shares no code with the library; which nodes are inside
is determined by counting where lattice lines cross triangles.

usage: simplified_labels_test.py ISONEST PLUGIN_FOLDER
"""
import json
import os
import pathlib
import subprocess
import sys
import tempfile
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served  # noqa: E402
from label_volumes import cells, cyclic, single_nodes  # noqa: E402
from mesh_data import write_ply  # noqa: E402
from windings import windings  # noqa: E402

import numpy as np
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkIOPLY import vtkPLYReader
from vtkmodules.vtkIOXML import vtkXMLPolyDataReader

ISONEST = pathlib.Path(sys.argv[1])
os.environ["HDF5_PLUGIN_PATH"] = sys.argv[2]
RANDOM = np.random.default_rng(90)


def run(*arguments, code=0):
    done = served.run([ISONEST, *map(str, arguments)], capture_output=True, text=True)
    assert done.returncode == code, (arguments, done.returncode, done.stderr)
    return done


def read(path):
    """Points, triangles, and the labels on both sides if present."""
    reader = vtkXMLPolyDataReader() if path.suffix == ".vtp" else vtkPLYReader()
    reader.SetFileName(str(path))
    reader.Update()
    data = reader.GetOutput()
    sides = data.GetCellData().GetArray("BoundaryLabels")
    return (vtk_to_numpy(data.GetPoints().GetData()), vtk_to_numpy(data.GetPolys().GetConnectivityArray()).reshape(-1, 3),
            None if sides is None else vtk_to_numpy(sides))


def cut(faces, sides, label):
    return np.concatenate([faces[sides[:, 0] == label], faces[sides[:, 1] == label][:, [0, 2, 1]]])


def volumes():
    yield "noise", RANDOM.integers(0, 3, (11, 9, 13))
    yield "two by two", RANDOM.integers(0, 3, (2, 2, 19))
    sheets = np.zeros((12, 33, 34), int)
    sheets[5], sheets[:, 17], sheets[2, :, 13] = 1, 2, 3
    yield "thin sheets", sheets
    yield "single nodes", single_nodes()
    box = np.ones((20, 21, 22), int)
    box[4:15, 5:16, 6:17] = 2
    yield "a box", box
    yield "cells", cells(RANDOM, (31, 28, 34), 9, 6)
    yield "many cells", cells(RANDOM, (34, 44, 40), 40, 14)


class SimplifiedLabels(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory(prefix="isonest-test-")
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)

    def store(self, labels, spacing, origin=(0, 0, 0)):
        np.save(self.folder / "v.npy", labels.astype("u2"))
        run("preprocess", self.folder / "v.npy", "-o", self.folder / "s", "--labels", "--spacing",
            ",".join(map(str, spacing)), "--origin", ",".join(map(str, origin)), "--force")
        return self.folder / "s"

    def interfaces(self, store, *more):
        out = self.folder / "i.vtp"
        report = json.loads(run("extract", store, "--labels", "all", "--smooth", "--interfaces", "--close", *more, "-o",
                                out, "--json").stdout)
        return (*read(out), report)

    def check(self, labels, spacing, distance, keeps, origin=(0, 0, 0)):
        store = self.store(labels + 1, spacing, origin)
        full_points, full_faces, full_sides, _ = self.interfaces(store)
        points, faces, sides, report = self.interfaces(store, "--distance", distance,
                                                       *(["--keep-nodes"] if keeps else []))
        self.assertLessEqual(report["distance_bound"], distance)
        self.assertLess(len(faces), len(full_faces))
        self.assertEqual(report["nodes_beyond"], 0 if keeps else report["distance_bound"])
        # Each interface in both directions; if there are very many, all of them as one.
        pairs = {*map(tuple, sides.tolist())}
        self.assertEqual(pairs, {*map(tuple, full_sides.tolist())})
        parts = [((full_sides == pair).all(1), (sides == pair).all(1)) for pair in pairs]
        if len(parts) > 12:
            parts = [(np.ones(len(full_faces), bool), np.ones(len(faces), bool))]
        for of_full, of_left in parts:
            write_ply(self.folder / "a.ply", full_points, full_faces[of_full])
            write_ply(self.folder / "b.ply", points, faces[of_left])
            found = json.loads(subprocess.run(
                [ISONEST.with_name("isonest_mesh_distance"), self.folder / "a.ply", self.folder / "b.ply", "--max-only",
                 "--epsilon", "0.01"], check=True, capture_output=True).stdout)
            for side in ("a_to_b", "b_to_a"):
                self.assertLessEqual(found[side]["max"], report["distance_bound"] * (1 + 1e-6))
        lattice = (points.astype(float) - origin) / spacing
        wrong = np.zeros(labels.shape, bool)
        for label in np.unique(labels + 1):
            own = cut(faces, sides, label)
            directed = {}
            for a, b in np.concatenate([own[:, [0, 1]], own[:, [1, 2]], own[:, [2, 0]]]).tolist():
                directed[a, b] = directed.get((a, b), 0) + 1
            self.assertTrue(all(directed.get((b, a), 0) == n for (a, b), n in directed.items()))
            wrong |= windings(lattice, own, labels.shape) != (labels + 1 == label)
        if keeps:
            self.assertEqual(wrong.sum(), 0)
        else:
            self.require_near(np.argwhere(wrong)[:, ::-1] * spacing + origin, full_points[full_faces],
                              report["distance_bound"])
        return len(faces), int(wrong.sum())

    def require_near(self, nodes, triangles, most):
        """Checks that each node is within that distance of a triangle, by samples on the triangles."""
        steps = 10
        weights = np.array([(i, j, steps - i - j) for i in range(steps + 1) for j in range(steps + 1 - i)]) / steps
        for node in nodes:
            near = triangles[(np.abs(triangles - node).max((1, 2)) < most + 3)].astype(float)
            samples = np.einsum("sk,tkx->tsx", weights, near)
            self.assertLessEqual(np.linalg.norm(samples - node, axis=2).min(initial=np.inf), most + 0.15)

    def test_each_interface_is_within_the_distance_and_nodes_are_on_their_sides(self):
        changed = 0
        for name, labels in volumes():
            for spacing, distance in (((1, 1, 1), 0.3), ((0.5, 1, 1.5), 1.1)):
                with self.subTest(name, spacing=spacing, distance=distance):
                    fewest, wrong = self.check(labels, spacing, distance, False)
                    more, _ = self.check(labels, spacing, distance, True)
                    self.assertLessEqual(fewest, 1.05 * more + 20)
                    changed += wrong
        self.assertGreater(changed, 0)  # so that keeping nodes has an effect

    def test_nodes_are_on_their_sides_far_from_the_origin_too(self):
        labels = cells(RANDOM, (24, 26, 28), 30, 8)
        for origin in ((1000, -2000, 500), (30_000, -70_000, 110_000)):
            with self.subTest(origin=origin):
                more, _ = self.check(labels, (0.5, 1, 1.5), 1.1, True, origin)
                fewest, _ = self.check(labels, (0.5, 1, 1.5), 1.1, False, origin)
                self.assertLess(fewest, more)

    def test_labels_are_cut_from_their_interfaces_and_are_the_same_for_any_threads_and_memory(self):
        store = self.store(cells(RANDOM, (40, 90, 75), 60, 30) + 1, (1, 1, 2))
        points, faces, sides, _ = self.interfaces(store, "--distance", "0.5voxel")
        kept = None
        for threads, memory in ((1, "1G"), (2, "80M"), (7, "500M")):
            out = self.folder / f"m{threads}"
            run("extract", store, "--labels", "all", "--smooth", "--close", "--distance", "0.5voxel", "-o", out, "--threads",
                threads, "--memory", memory)
            files = {path.name: path.read_bytes() for path in out.glob("*.ply")}
            self.assertEqual(kept or files, files)
            kept = files
        listed = json.loads((out / "labels.json").read_text())["labels"]
        for one in listed:
            own_points, own_faces, _ = read(out / one["mesh"])
            self.assertEqual(sorted(cyclic(own_points, own_faces)),
                             sorted(cyclic(points, cut(faces, sides, one["id"]))))
            self.assertGreater(one["full_volume"], 0)
            for other in one["neighbours"]:
                back = [n["area"] for m in listed if m["id"] == other["id"] for n in m["neighbours"] if n["id"] == one["id"]]
                self.assertAlmostEqual(back[0], other["area"], delta=1e-9 * other["area"])

    def test_a_number_of_triangles_is_met_by_all_interfaces_together(self):
        store = self.store(cells(RANDOM, (40, 50, 45), 20, 20) + 1, (1, 1, 1))
        full = self.interfaces(store)[3]["triangles"]
        for asked in (full // 4, full // 12):
            report = self.interfaces(store, "--triangles", asked)[3]
            self.assertLessEqual(report["triangles"], asked)
            self.assertGreater(report["triangles"], 0.85 * asked)
        text = run("extract", store, "--labels", "all", "--smooth", "--interfaces", "--triangles", 20, "-o",
                   self.folder / "no.vtp", code=7).stderr
        self.assertIn("fewest", text)
        self.assertFalse((self.folder / "no.vtp").exists())

    def test_what_does_not_go_together_is_told(self):
        store = self.store(cells(RANDOM, (9, 9, 9), 4, 4) + 1, (1, 1, 1))
        for options, says, code in ((["--smooth", "--keep-nodes"], "--distance", 2),
                                    (["--keep-nodes", "--distance", "1"], "--smooth", 2),
                                    (["--smooth", "--distance", "1", "--components", "1"], "components", 2),
                                    (["--smooth", "--distance", "1e-9"], "round", 7)):
            text = run("extract", store, "--label", 2, *options, "-o", self.folder / "no.ply", code=code).stderr
            self.assertIn(says, text)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
