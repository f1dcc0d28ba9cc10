#!/usr/bin/env python3
"""Components of smooth labels: the expected ones by flood fill of the volume's nodes, those kept by a search of whole
meshes.

usage: label_parts_test.py ISONEST PLUGIN_FOLDER
"""
import json
import pathlib
import tempfile
import unittest

import numpy as np
from scipy.ndimage import label as filled
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

import smooth_labels_test as nets
from mesh_data import read_points

run = nets.run
CORNERS = np.ones((3, 3, 3))  # nodes with a common cell are connected


def held_by(wall):
    """The nodes inside a set of nodes, and those of the set itself."""
    others, _ = filled(~wall, CORNERS)
    return others != others[0, 0, 0]


def parts_of(nodes):
    """The boundaries between the connected components of some nodes and those of all others: for each, the number of
    triangles, the nodes inside it, and whether the nodes are on that side."""
    nodes = np.pad(nodes, 1)
    own, _ = filled(nodes, CORNERS)
    other, _ = filled(~nodes, CORNERS)
    faces = {}
    for axis in range(3):
        low, high = nets.sliced(axis, slice(0, -1)), nets.sliced(axis, slice(1, None))
        for a, b in ((low, high), (high, low)):
            crossed = nodes[a] & ~nodes[b]
            for pair in zip(own[a][crossed].tolist(), other[b][crossed].tolist()):
                faces[pair] = faces.get(pair, 0) + 1
    parts = []
    for (i, j), count in faces.items():
        solid, void = held_by(own == i), other == j
        is_solid = not solid[void].any()
        inside = solid if is_solid else held_by(void)
        parts.append((2 * count, inside[1:-1, 1:-1, 1:-1], is_solid))
    return parts


def components_of(points, faces):
    """For a mesh: the component number of each triangle, in the order of their lowest vertices; and the number of
    components."""
    edges = np.concatenate([faces[:, :2], faces[:, 1:]])
    count, number = connected_components(coo_matrix((np.ones(len(edges)), edges.T), (len(points),) * 2), directed=False)
    _, first = np.unique(number, return_index=True)
    rank = np.empty(count, int)
    rank[np.argsort(first)] = np.arange(count)
    return rank[number][faces[:, 0]], count


def volumes_of(points, faces, component, count):
    """Volumes by the divergence theorem; infinite for components with a border."""
    t = points.astype(float)[faces]
    volume = np.abs(np.bincount(component, (t[:, 0] * np.cross(t[:, 1], t[:, 2])).sum(1) / 6, count))
    steps = np.concatenate([faces[:, [i, (i + 1) % 3]] for i in range(3)])
    forth, times = np.unique(steps, axis=0, return_counts=True)
    back, others = np.unique(steps[:, ::-1], axis=0, return_counts=True)
    passed = {tuple(k): n for k, n in zip(forth.tolist(), times)}
    returned = {tuple(k): n for k, n in zip(back.tolist(), others)}
    of_vertex = np.zeros(len(points), int)
    of_vertex[faces.ravel()] = np.repeat(component, 3)
    for key, n in passed.items():
        if returned.get(key, 0) != n:
            volume[of_vertex[key[0]]] = np.inf
    return volume


def hollow():
    """A solid with two voids, one of them with a grain inside, and specks, two of which touch at a corner."""
    data = np.zeros((14, 16, 30), "u1")
    data[2:12, 2:12, 2:20] = 1
    data[4:9, 4:9, 4:9] = 0
    data[6, 6, 6] = 1
    data[5:8, 5:8, 12:14] = 2
    data[3, 3, 25] = data[4, 4, 26] = data[9, 3, 25] = 1
    data[0, 14, 28:] = 2
    return data


class LabelParts(nets.LabelMeshes):
    def test_components_are_those_of_the_nodes_and_no_other_nodes_change_sides(self):
        for name, data in [*nets.volumes(), ("hollow", hollow())]:
            store = self.store(data.astype("u1"))
            parts = {label: parts_of(data == label) for label in np.unique(data).tolist()}
            sizes = sorted({part[0] for some in parts.values() for part in some})
            least = sizes[len(sizes) // 2]
            for passes, choice, keeps in (
                    (0, ("--components", "all"), lambda part: True),
                    (5, ("--min-component", least), lambda part: part[0] >= least),
                    (16, ("--min-component", sizes[-1] + 1), lambda part: False),
                    # With 0 passes the mesh is the faces of the voxels, and its volume is their number.
                    (0, ("--min-volume", 2.5), lambda part: part[1].sum() > 2)):
                with self.subTest(volume=name, choice=choice):
                    meshes, listed = self.meshes(store, f"--smooth={passes}", "--close", *choice)
                    for entry in listed:
                        own = parts[entry["id"]]
                        dropped = [part for part in own if not keeps(part)]
                        self.assertEqual(entry["components"], len(own))
                        self.assertEqual(entry["dropped_components"], len(dropped))
                        self.assertEqual(entry["dropped_triangles"], sum(part[0] for part in dropped))
                        self.assertEqual(entry["largest_dropped"], max((part[0] for part in dropped), default=0))
                        inside = sum((np.where(solid, 1, -1) * held for _, held, solid in own if
                                      keeps((_, held, solid))), np.zeros(data.shape, int))
                        points, faces = meshes[entry["id"]]
                        np.testing.assert_array_equal(nets.windings(points, faces, data.shape), inside)

    def test_what_is_kept_is_as_with_all(self):
        for name, data in [*nets.volumes(), ("hollow", hollow())]:
            store = self.store(data.astype("u1"), "--spacing", "0.5,1,2", "--origin", "3,-8,0.25")
            for close in ((), ("--close",)):
                whole, _ = self.meshes(store, "--smooth", *close, folder="whole")
                for options in ({"--components": "largest"}, {"--components": 2}, {"--min-volume": 3.3},
                                {"--components": 1, "--min-component": 13, "--min-volume": 1.1}):
                    with self.subTest(volume=name, options=options, close=close):
                        choice = [word for pair in options.items() for word in pair]
                        meshes, listed = self.meshes(store, "--smooth", *close, *choice)
                        for entry in listed:
                            points, faces = whole[entry["id"]]
                            component, count = components_of(points, faces)
                            sizes = np.bincount(component, minlength=count)
                            keeps = sizes >= options.get("--min-component", 0)
                            if "--min-volume" in options:
                                keeps &= volumes_of(points, faces, component, count) >= options["--min-volume"]
                            if "--components" in options:
                                most = {"largest": 1}.get(options["--components"], options["--components"])
                                order = sorted(np.flatnonzero(keeps), key=lambda i: (-sizes[i], i))
                                keeps = np.isin(np.arange(count), order[:most])
                            kept = faces[keeps[component]]
                            found = meshes[entry["id"]]
                            np.testing.assert_array_equal(found[0][found[1]], points[kept])
                            self.assertEqual(len(found[0]), len(np.unique(kept)))
                            self.assertEqual(entry["components"], count)
                            self.assertEqual(entry["dropped_components"], count - keeps.sum())
                            self.assertEqual(entry["triangles"], len(kept))

    def test_bytes_depend_on_neither_threads_nor_memory_and_are_the_same_where_nothing_is_dropped(self):
        data = nets.cells(nets.RANDOM, (40, 45, 60), 80, 30).astype("u2")
        data[20:30, 20:30, 30:50] = nets.RANDOM.integers(0, 5, (10, 10, 20))
        stores = [self.store(data, name=f"s{chunk}", chunk=chunk) for chunk in (8, 16)]
        first = {}
        for store, options in ((stores[0], ("--threads", 1)), (stores[1], ("--threads", 3)),
                               (stores[0], ("--memory", "24M")), (stores[1], ("--threads", 2, "--memory", "40M"))):
            run("extract", store, "--labels", "0-100", "--smooth", "--components", 2, "-o", self.here / "m", *options)
            for path in (self.here / "m").iterdir():
                if path.suffix == ".ply":
                    self.assertEqual(first.setdefault(path.name, path.read_bytes()), path.read_bytes(), path.name)
        run("extract", stores[0], "--labels", "0-100", "--smooth", "-o", self.here / "whole")
        run("extract", stores[0], "--labels", "0-100", "--smooth", "--components", "all", "-o", self.here / "all")
        differ = 0
        for name, content in first.items():
            whole = (self.here / "whole" / name).read_bytes()
            self.assertEqual((self.here / "all" / name).read_bytes(), whole)
            differ += content != whole
        self.assertGreater(differ, 2)
        run("extract", stores[1], "--label", 3, "--smooth", "--components", 2, "-o", self.here / "one.ply")
        self.assertEqual((self.here / "one.ply").read_bytes(), first["3.ply"])

    def test_the_report_says_what_was_dropped(self):
        store = self.store(hollow())
        one = ("extract", store, "--label", 1, "--smooth", "--close")
        done = json.loads(run(*one, "--components", "largest", "-o", self.here / "a.ply", "--json").stdout)
        # The solid's outside; the two voids, the grain, two specks that touch, and one more.
        self.assertEqual((done["components"], done["dropped_components"]), (6, 5))
        self.assertGreater(done["volume"], 10 * 10 * 17)  # without the voids
        self.assertEqual(done["border_vertices"], 0)
        self.assertIn("dropped 5 of 6 components", run(*one, "--components", 1, "-o", self.here / "a.ply").stdout)
        self.assertIn("all components of the surface were dropped",
                      run(*one, "--min-component", 10 ** 6, "-o", self.here / "a.ply").stdout)
        self.assertEqual(len(read_points(self.here / "a.ply")[0]), 0)
        several = ("extract", store, "--labels", "all", "--smooth", "-o", self.here / "m")
        whole, said = run(*several).stdout, run(*several, "--components", 1).stdout
        self.assertRegex(said, "8 components.*6 .*dropped")
        self.assertIn("of dropped components", said)
        self.assertNotIn("of dropped components", whole)
        # With an origin and rotated axes: the volume is that of the mesh in the volume's own axes.
        (self.here / "turned.nrrd").write_bytes(
            b"NRRD0004\ntype: uint8\ndimension: 3\nspace dimension: 3\nsizes: 30 16 14\n"
            b"space directions: (0.6,0.8,0) (-0.8,0.6,0) (0,0,1)\nspace origin: (5,-7,3)\nencoding: raw\n\n" +
            hollow().tobytes())
        run("preprocess", self.here / "turned.nrrd", "-o", self.here / "turned.isonest")
        turned = json.loads(run("extract", self.here / "turned.isonest", *one[2:], "--components", "largest", "-o",
                                self.here / "t.ply", "--json").stdout)
        self.assertAlmostEqual(turned["volume"] / done["volume"], 1, 5)
        self.assertEqual((turned["components"], turned["triangles"]), (6, done["triangles"]))


if __name__ == "__main__":
    unittest.main(argv=nets.sys.argv[:1])
