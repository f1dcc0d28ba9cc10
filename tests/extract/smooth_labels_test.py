#!/usr/bin/env python3
"""Smooth surfaces of labels: no node on the wrong side, near the voxels' faces, shared by neighbours.

The expected mesh is computed here by a slow implementation on whole arrays (Net); which nodes are inside is determined
by counting where lattice lines cross its triangles.

usage: smooth_labels_test.py ISONEST PLUGIN_FOLDER
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
from windings import windings  # noqa: E402

import numpy as np

ISONEST = sys.argv[1]
os.environ["HDF5_PLUGIN_PATH"] = sys.argv[2]

RANDOM = np.random.default_rng(33)
OUTSIDE = -1  # label of nodes beyond the border; labels here are not negative
MOST_MOVED = np.float32(0.5 - 1 / 32)


def run(*arguments, code=0):
    done = served.run([ISONEST, *map(str, arguments)], capture_output=True, text=True)
    assert done.returncode == code, (arguments, done.returncode, done.stderr)
    return done


def sliced(axis, at):
    index = [slice(None)] * 3
    index[axis] = at
    return tuple(index)


class Net:
    """The surface net of a volume of labels, [z, y, x], with all cells in arrays."""

    def __init__(self, labels, passes):
        self.nodes = np.pad(labels.astype(np.int64), 1, constant_values=OUTSIDE)
        self.cells = tuple(n - 1 for n in self.nodes.shape)
        low = [slice(0, -1), slice(1, None)]
        corners = np.stack([self.nodes[low[k], low[j], low[i]] for k in (0, 1) for j in (0, 1) for i in (0, 1)])
        self.crossed = (corners != corners[0]).any(0)
        # For the face between a cell and the next one along an axis: the number of its sides that connect different
        # labels.
        self.sides = []
        for axis in range(3):
            u, v = [a for a in range(3) if a != axis]
            face = [corners.reshape(2, 2, 2, *self.cells)[tuple(self.corner(axis, u, v, i, j))]
                    for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))]
            self.sides.append(sum((face[n] != face[n - 1]).astype(int) for n in range(4)))
        self.least, self.most = self.limits()
        self.moved = self.smoothed(passes)

    def limits(self):
        """The interval in which each vertex may be moved, z, y, x."""
        different = []  # for each node, whether both neighbours along the axis have other labels
        for axis in range(3):
            other = np.zeros(self.nodes.shape, bool)
            here = self.nodes[sliced(axis, slice(1, -1))]
            other[sliced(axis, slice(1, -1))] = ((here != self.nodes[sliced(axis, slice(0, -2))]) &
                                                 (here != self.nodes[sliced(axis, slice(2, None))]))
            different.append(other)
        slim = np.array(different) & (sum(d.astype(int) for d in different) > 1) & (self.nodes != OUTSIDE)
        least, most = np.full((3, *self.cells), -MOST_MOVED), np.full((3, *self.cells), MOST_MOVED)
        for corner in np.ndindex(2, 2, 2):
            at = tuple(slice(i, i + n) for i, n in zip(corner, self.cells))
            for axis in range(3):
                if corner[axis] == 0:
                    least[axis][slim[axis][at]] = np.float32(-0.25)
                else:
                    most[axis][slim[axis][at]] = np.float32(0.25)
        return least, most

    @staticmethod
    def corner(axis, u, v, i, j):
        at = [1, 1, 1]
        at[u], at[v] = i, j
        return at

    def smoothed(self, passes):
        lines = [s > 2 for s in self.sides]
        joined = [s > 0 for s in self.sides]
        count = sum(self.neighbours(lines, axis, step)[0].astype(int) for axis in range(3) for step in (-1, 1))
        along_line = count > 1
        moved = np.zeros((3, *self.cells), np.float32)  # z, y, x
        for k in range(passes):
            weight = np.float32(-3) * np.float32(0.6) if k % 4 == 3 and k + 2 < passes else np.float32(0.6)
            total = np.zeros_like(moved)
            count = np.zeros(self.cells, int)
            for axis in (2, 1, 0):  # x first
                for step in (-1, 1):
                    on_line, there = self.neighbours(lines, axis, step)
                    linked = np.where(along_line, on_line, self.neighbours(joined, axis, step)[0])
                    total += np.where(linked, moved[(slice(None), *np.moveaxis(there, -1, 0))], np.float32(0))
                    total[axis] += np.where(linked, np.float32(step), np.float32(0))
                    count += linked
            share = np.float32(1) / np.maximum(count, 1).astype(np.float32)
            to = moved + weight * (total * share - moved)
            to = np.where(count > 0, np.clip(to, self.least, self.most), moved)
            for axis in range(3):
                for end in (0, -1):
                    to[(axis, *sliced(axis, end))] = 0
            moved = np.where(self.crossed, to, np.float32(0))
        return moved

    def neighbours(self, faces, axis, step):
        """Whether each cell has a neighbour across this face, and which cell that is."""
        is_there = np.zeros(self.cells, bool)
        face = faces[axis][sliced(axis, slice(0, -1))]
        is_there[sliced(axis, slice(0, -1) if step > 0 else slice(1, None))] = face
        there = np.stack(np.indices(self.cells), -1)
        there[..., axis] = np.clip(there[..., axis] + step, 0, self.cells[axis] - 1)
        return is_there, there

    def positions(self, cells, spacing, origin):
        """Positions of vertices, x, y, z as float32."""
        moved = np.stack([self.moved[axis][tuple(cells.T)] for axis in (2, 1, 0)], 1).astype(float)
        return (np.array(origin) + np.array(spacing) * (cells[:, ::-1] - 0.5 + moved)).astype(np.float32)

    def quads(self, label, closed):
        """The four cells around each edge from the label to another one, sorted, as one number each."""
        found = []
        for axis in range(3):
            u, v = [a for a in range(3) if a != axis]
            a = self.nodes[sliced(axis, slice(0, -1))]
            b = self.nodes[sliced(axis, slice(1, None))]
            of_label = (a != b) & ((a == label) | (b == label))
            if not closed:
                of_label &= (a != OUTSIDE) & (b != OUTSIDE)
            edges = np.argwhere(of_label)
            around = np.repeat(edges[:, None], 4, 1)
            around[:, :, u] -= [0, 1, 0, 1]
            around[:, :, v] -= [0, 0, 1, 1]
            found.append(np.sort(np.ravel_multi_index(np.moveaxis(around, -1, 0), self.cells), 1))
        return np.concatenate(found)


def sorted_rows(rows):
    return rows[np.lexsort(rows.T[::-1])]


def area_of(points, faces):
    t = points.astype(float)[faces]
    return np.linalg.norm(np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0]), axis=1) / 2


def reversed_key(key):
    return key[:12] + key[24:] + key[12:24]


def volumes():
    """Volumes of labels, with their names."""
    yield "two labels in noise", RANDOM.integers(0, 2, (11, 9, 13))
    yield "many labels in noise", RANDOM.integers(0, 40, (9, 12, 10))
    yield "few nodes in noise", (RANDOM.random((12, 13, 14)) < 0.05) * RANDOM.integers(1, 4, (12, 13, 14))
    yield "two by two", RANDOM.integers(0, 3, (2, 2, 19))
    yield "two nodes thick", RANDOM.integers(0, 3, (14, 15, 2))
    sheets = np.zeros((12, 13, 14), int)
    sheets[5], sheets[:, 7], sheets[2, :, 3] = 1, 2, 3
    yield "thin sheets", sheets
    yield "nodes that touch by corners", corner_nodes()
    yield "single nodes", single_nodes()
    yield "cells up to the border", cells(RANDOM, (21, 18, 24), 9, 5)
    yield "one label alone", np.full((4, 5, 6), 3)
    # Several pieces, and blocks, along each axis.
    yield "several pieces", cells(RANDOM, (40, 70, 75), 60, 12)


class LabelMeshes(unittest.TestCase):
    """Writes stores and reads meshes, in a folder that is removed after the test."""

    def setUp(self):
        folder = tempfile.TemporaryDirectory(prefix="isonest-test-", dir=served.MEMORY)
        self.addCleanup(folder.cleanup)
        self.here = pathlib.Path(folder.name)

    def store(self, data, *options, name="s", chunk=8):
        np.save(self.here / f"{name}.npy", data)
        run("preprocess", self.here / f"{name}.npy", "-o", self.here / f"{name}.isonest", "--chunk", chunk, "--force",
            *options)
        return self.here / f"{name}.isonest"

    def meshes(self, store, *options, labels="0-100", folder="m"):
        """Points and triangles by label, and the list."""
        run("extract", store, "--labels", labels, "-o", self.here / folder, *options)
        listed = json.loads((self.here / folder / "labels.json").read_text())["labels"]
        return {entry["id"]: read_points(self.here / folder / entry["mesh"]) for entry in listed}, listed


class SmoothLabels(LabelMeshes):
    def test_no_node_is_on_the_wrong_side_and_all_is_as_computed_on_whole_arrays(self):
        for name, data in volumes():
            for passes, spacing in ((0, (1, 1, 1)), (1, (1, 1, 1)), (5, (0.5, 1, 4)), (16, (1, 1, 1)), (23, (2, 0.25, 1))):
                with self.subTest(volume=name, passes=passes):
                    origin = tuple(64 * s for s in spacing)  # makes all differences exact in float32
                    store = self.store(data.astype("u1"), "--spacing", ",".join(map(str, spacing)), "--origin",
                                       ",".join(map(str, origin)))
                    net = Net(data, passes)
                    meshes, listed = self.meshes(store, f"--smooth={passes}", "--close")
                    self.assertEqual(sorted(meshes), np.unique(data).tolist())
                    half = np.linalg.norm(spacing) / 2
                    for entry in listed:
                        points, faces = meshes[entry["id"]]
                        lattice = (points.astype(float) - origin) / spacing
                        # Promise 1: nodes are on the right side.
                        np.testing.assert_array_equal(windings(lattice, faces, data.shape), data == entry["id"])
                        # Promise 2.
                        at = np.floor(lattice).astype(int)[:, ::-1] + 1
                        moved = np.linalg.norm((lattice - (at[:, ::-1] - 0.5)) * spacing, axis=1)
                        self.assertLessEqual(moved.max(), entry["smooth_bound"])
                        self.assertLess(entry["smooth_bound"], half)
                        # Everything else must be exactly equal.
                        self.assertEqual(len(np.unique(at, axis=0)), len(at))
                        np.testing.assert_array_equal(points, net.positions(at, spacing, origin))
                        number = np.ravel_multi_index(tuple(at.T), net.cells)[faces].reshape(-1, 6)
                        quads = np.array([sorted(set(row)) for row in number.tolist()])
                        np.testing.assert_array_equal(sorted_rows(quads), sorted_rows(net.quads(entry["id"], True)))
                        self.assertEqual(entry["smooth_passes"], passes)

    def test_labels_that_touch_have_the_same_triangles(self):
        for name, data in volumes():
            with self.subTest(volume=name):
                store = self.store(data.astype("u2"), "--spacing", "0.7,1.1,0.3", "--origin", "-3,1000,0.1")
                closed, listed = self.meshes(store, "--smooth", "--close")
                opened, _ = self.meshes(store, "--smooth", folder="o")
                times = {}
                for label, mesh in closed.items():
                    for key in cyclic(*mesh):
                        times.setdefault(key, []).append(label)
                self.assertEqual({len(labels) for labels in times.values()}, {1})  # from one side once
                shared = {key for key in times if reversed_key(key) in times}
                caps = len(times) - len(shared)
                z, y, x = data.shape
                self.assertEqual(caps, 4 * (x * y + y * z + z * x))
                # The list says who the neighbours are, and the common areas.
                owner = {key: labels[0] for key, labels in times.items()}
                areas = {entry["id"]: {} for entry in listed}
                for label, mesh in closed.items():
                    for key, area in zip(cyclic(*mesh), area_of(*mesh)):
                        if (other := owner.get(reversed_key(key))) is not None:
                            areas[label][other] = areas[label].get(other, 0) + area
                for entry in listed:
                    self.assertEqual([n["id"] for n in entry["neighbours"]], sorted(areas[entry["id"]]))
                    for neighbour in entry["neighbours"]:
                        expected = areas[entry["id"]][neighbour["id"]]
                        self.assertAlmostEqual(neighbour["area"] / expected, 1, 9)
                # Open at the border: the same without the caps.
                for label, mesh in opened.items():
                    self.assertEqual(sorted(cyclic(*mesh)),
                                     sorted(key for key in cyclic(*closed[label]) if key in shared))
                    self.assertEqual(len(np.unique(mesh[1])), len(mesh[0]))  # there are no unused vertices

    def test_a_mesh_is_closed_and_has_the_volume_that_it_says(self):
        data = cells(RANDOM, (20, 22, 24), 12, 6).astype("u1")
        _, listed = self.meshes(self.store(data), "--smooth=0", "--close")
        done = json.loads(run("extract", self.here / "s.isonest", "--label", listed[0]["id"], "--smooth=0", "--close", "-o",
                              self.here / "a.ply", "--json").stdout)
        self.assertIn("closed at the outer faces", run("extract", self.here / "s.isonest", "--label", listed[0]["id"], "--smooth", "--close",
                                     "-o", self.here / "a.ply").stdout)
        self.assertEqual(done["volume"], (data == listed[0]["id"]).sum())
        self.assertEqual(done["border_vertices"], 0)
        self.assertEqual(done["zero_area_triangles"], 0)
        self.assertEqual((done["smooth_passes"], done["closed"]), (0, "below"))

    def test_bytes_depend_on_neither_threads_memory_chunks_nor_the_list(self):
        data = cells(RANDOM, (70, 45, 90), 80, 30).astype("u2")
        data[20:40, 20:30, 30:60] = RANDOM.integers(0, 5, (20, 10, 30))
        stores = [self.store(data, name=f"s{chunk}", chunk=chunk) for chunk in (8, 16, 64)]
        first = {}
        for store, options in ((stores[0], ("--threads", 1)), (stores[1], ("--threads", 3)),
                               (stores[2], ("--threads", 2, "--memory", "40M")), (stores[0], ("--memory", "24M"))):
            for passes in (3, 16):
                run("extract", store, "--labels", "0-100", f"--smooth={passes}", "-o", self.here / "m", *options)
                for path in (self.here / "m").glob("*.ply"):
                    self.assertEqual(first.setdefault((path.name, passes), path.read_bytes()), path.read_bytes(),
                                     (path.name, options))
        run("extract", stores[0], "--labels", "3,7-9", "--smooth", "-o", self.here / "some")
        for label in (3, 7, 8, 9):
            self.assertEqual((self.here / "some" / f"{label}.ply").read_bytes(), first[f"{label}.ply", 16])
            run("extract", stores[1], "--label", label, "--smooth", "-o", self.here / "one.ply")
            self.assertEqual((self.here / "one.ply").read_bytes(), first[f"{label}.ply", 16])

    def test_a_sphere_looks_like_one_and_a_box_keeps_its_faces(self):
        for centre in ((28, 28, 28), (27.63, 28.21, 27.9)):
            z, y, x = np.mgrid[:56, :56, :56]
            ball = (z - centre[0]) ** 2 + (y - centre[1]) ** 2 + (x - centre[2]) ** 2 <= 22 ** 2
            points, faces = self.meshes(self.store(ball.astype("u1")), "--smooth", labels="1")[0][1]
            t = points.astype(float)[faces]
            normal = np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0])
            out = t.mean(1) - np.array(centre)[::-1]
            cosine = (normal * out).sum(1) / np.linalg.norm(normal, axis=1) / np.linalg.norm(out, axis=1)
            angle = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
            self.assertLess(angle.mean(), 5)
            self.assertLess(np.percentile(angle, 99), 15)
            volume = (t[:, 0] * np.cross(t[:, 1], t[:, 2])).sum() / 6
            self.assertLess(abs(volume / (4 / 3 * np.pi * 22 ** 3) - 1), 0.01)
        box = np.zeros((40, 50, 60), "u1")
        box[8:28, 10:36, 12:45] = 1
        points, faces = self.meshes(self.store(box), "--smooth", labels="1")[0][1]
        t = points.astype(float)[faces]
        normal = np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0])
        area = np.linalg.norm(normal, axis=1)
        flat = np.abs(normal).max(1) > np.cos(np.radians(2)) * area
        self.assertGreater(area[flat].sum() / area.sum(), 0.7)

    def test_a_rod_of_one_node_keeps_half_of_its_width_and_a_slanted_sheet_is_smooth(self):
        rod = np.zeros((9, 9, 30), "u1")
        rod[4, 4, 4:26] = 1
        points, _ = self.meshes(self.store(rod), "--smooth", labels="1")[0][1]
        middle = points[np.abs(points[:, 0] - 15) < 5]
        np.testing.assert_allclose(np.abs(middle[:, 1:] - 4), 0.25)
        z, _, x = np.mgrid[:40, :12, :60]
        sheet = (z >= 10 + x // 4) & (z <= 10 + (x + 1) // 4)  # one node thick, two at its steps
        points, faces = self.meshes(self.store(sheet.astype("u1")), "--smooth", labels="1")[0][1]
        t = points.astype(float)[faces]
        t = t[np.abs(t[:, :, 0].mean(1) - 30) < 12]
        normal = np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0])
        cosine = np.abs(normal @ [-1, 0, 4]) / np.sqrt(17) / np.linalg.norm(normal, axis=1)
        self.assertLess(np.degrees(np.arccos(np.clip(cosine, -1, 1))).mean(), 5)

    def test_labels_of_other_types_missing_values_and_turned_volumes(self):
        data = cells(RANDOM, (20, 17, 22), 14, 6)
        expected, _ = self.meshes(self.store(data.astype("u1")), "--smooth")
        for kind in ("i2", "u4", "f4", "f8", "i4"):
            found, _ = self.meshes(self.store(data.astype(kind)), "--smooth")
            for label, (points, faces) in expected.items():
                np.testing.assert_array_equal(found[label][0], points)
                np.testing.assert_array_equal(found[label][1], faces)
        found, _ = self.meshes(self.store(data.astype("u8"), "--labels"), "--smooth")
        np.testing.assert_array_equal(found[3][0], expected[3][0])
        # A volume with axes that are not aligned with the world's.
        axes = np.array([[0.6, 0.8, 0], [-0.8, 0.6, 0], [0, 0, 1]])
        origin = np.array([5, -7, 3])
        (self.here / "turned.nrrd").write_bytes(
            (f"NRRD0004\ntype: uint8\ndimension: 3\nspace dimension: 3\nsizes: {' '.join(map(str, data.shape[::-1]))}\n"
             f"space directions: {' '.join('({},{},{})'.format(*axis) for axis in axes)}\n"
             f"space origin: ({','.join(map(str, origin))})\nencoding: raw\n\n").encode() + data.astype("u1").tobytes())
        run("preprocess", self.here / "turned.nrrd", "-o", self.here / "turned.isonest")
        found, _ = self.meshes(self.here / "turned.isonest", "--smooth")
        for label, (points, faces) in expected.items():
            np.testing.assert_allclose(found[label][0], points @ axes + origin, atol=1e-5)
            np.testing.assert_array_equal(found[label][1], faces)
        # Missing nodes are a label that gets no mesh.
        missing = np.where(data == 2, np.nan, data)
        found, _ = self.meshes(self.store(missing.astype("f4")), "--smooth")
        self.assertNotIn(2, found)
        for label, (points, faces) in found.items():
            np.testing.assert_array_equal(points, expected[label][0])
            np.testing.assert_array_equal(faces, expected[label][1])

    def test_what_makes_no_sense_is_refused(self):
        store = self.store(cells(RANDOM, (9, 9, 9), 4, 9).astype("u1"))
        for smooth in ("-1", "65", "x", "1.5"):
            self.assertIn("smooth", run("extract", store, "--labels", "all", f"--smooth={smooth}", "-o", self.here / "m",
                                        code=2).stderr)
        self.assertIn("--label", run("extract", store, "--iso", 1, "--smooth", "-o", self.here / "a.ply", code=2).stderr)
        for options in (("--box", "0,0,0,3,3,3"), ("--cells", "tet"), ("--cells", "hex"), ("--normals",), ("--close=above",),
                        ("--vertex-values", store)):
            self.assertIn("smooth", run("extract", store, "--label", 3, "--smooth", "-o", self.here / "a.ply", *options,
                                        code=2).stderr)
        self.assertIn("uint8", run("extract", store, "--label", 300, "--smooth", "-o", self.here / "a.ply", code=2).stderr)
        self.assertIn("has the label 77", run("extract", store, "--label", 77, "--smooth", "-o", self.here / "a.ply").stdout)
        amounts = self.store(RANDOM.normal(size=(9, 9, 9)), name="amounts")
        for options in (("--labels", "all", "-o", self.here / "n"), ("--label", 0, "-o", self.here / "n.ply")):
            self.assertIn("not a label", run("extract", amounts, *options, "--smooth", code=5).stderr)
        far = self.store(cells(RANDOM, (9, 9, 9), 4, 9).astype("u1"), "--origin", "1e6,0,0", name="far")
        self.assertIn("too far", run("extract", far, "--label", 3, "--smooth", "-o", self.here / "a.ply", code=7).stderr)
        self.assertIn("memory", run("extract", store, "--label", 3, "--smooth=64", "--memory", "11M", "-o",
                                    self.here / "a.ply", code=7).stderr)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
