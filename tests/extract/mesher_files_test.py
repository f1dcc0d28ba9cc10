#!/usr/bin/env python3
"""Interfaces of labels as input of gmsh (.msh) and tetgen (.smesh), and the tetrahedra that these make.

The triangles are those of the .ply file of the same interfaces. The connected parts of the labels are found here with
scipy, in the voxels. The tetrahedra's volumes are compared with those of the closed meshes of the labels.

usage: mesher_files_test.py ISONEST PLUGIN_FOLDER
"""
import json
import os
import pathlib
import re
import shutil
import struct
import subprocess
import sys
import tempfile
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served  # noqa: E402
from label_volumes import cells  # noqa: E402

import numpy as np
from scipy import ndimage

ISONEST = sys.argv[1]
os.environ["HDF5_PLUGIN_PATH"] = sys.argv[2]
RANDOM = np.random.default_rng(606)


def run(*arguments, code=0):
    done = served.run([ISONEST, *map(str, arguments)], capture_output=True, text=True)
    assert done.returncode == code, (arguments, done.returncode, done.stderr)
    return done


def tool(folder, *command):
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0 and "Error" not in done.stdout + done.stderr, (command, done.stdout[-2000:], done.stderr)
    return done.stdout


def read_interfaces(path):
    """Points, triangles and their labels of a .ply file."""
    data = path.read_bytes()
    end = data.index(b"end_header\n") + 11
    count = [int(line.split()[2]) for line in data[:end].decode().splitlines() if line.startswith("element")]
    points = np.frombuffer(data, "<f4", 3 * count[0], end).reshape(-1, 3)
    faces = np.frombuffer(data, [("n", "u1"), ("corners", "<i4", 3), ("sides", "<i4", 2)], count[1], end + points.nbytes)
    return points, faces["corners"].astype(int), faces["sides"].astype(int)


class Msh:
    """A binary .msh 4.1 file, read by the reference manual of gmsh."""

    def __init__(self, path):
        self.data, self.at = path.read_bytes(), 0
        self.expect(b"$MeshFormat\n4.1 1 8\n")
        assert self.take("i") == (1,)
        self.expect(b"\n$EndMeshFormat\n$PhysicalNames\n")
        self.names = {}
        for _ in range(int(self.line())):
            dimension, tag, name = self.line().split(" ", 2)
            self.names[int(dimension), int(tag)] = json.loads(name)
        self.expect(b"$EndPhysicalNames\n$Entities\n")
        points, curves, surfaces, volumes = self.take("4Q")
        assert (points, curves, volumes) == (0, 0, 0)
        self.surfaces = {}
        for _ in range(surfaces):
            tag, *box = self.take("i6d")
            assert self.take("Q") == (1,)
            physical, = self.take("i")
            assert self.take("Q") == (0,)
            self.surfaces[tag] = physical, np.reshape(box, (2, 3))
        self.expect(b"\n$EndEntities\n$Nodes\n")
        blocks, count, first, last = self.take("4Q")
        assert (blocks, first, last) == (1, 1, count)
        assert self.take("3iQ") == (2, 1, 0, count)
        assert self.take(f"{count}Q") == tuple(range(1, count + 1))
        self.points = np.frombuffer(self.data, "<f8", 3 * count, self.at).reshape(-1, 3)
        self.at += self.points.nbytes
        self.expect(b"\n$EndNodes\n$Elements\n")
        blocks, count, first, last = self.take("4Q")
        assert (blocks, first, last) == (surfaces, 1, count)
        self.triangles = {}
        for _ in range(blocks):
            dimension, tag, kind, rows = self.take("3iQ")
            assert (dimension, kind) == (2, 2)
            self.triangles[tag] = np.frombuffer(self.data, "<u8", 4 * rows, self.at).reshape(-1, 4)[:, 1:].astype(int) - 1
            self.at += 32 * rows
        self.expect(b"\n$EndElements\n")
        assert self.at == len(self.data)

    def take(self, form):
        values = struct.unpack_from("<" + form, self.data, self.at)
        self.at += struct.calcsize("<" + form)
        return values

    def line(self):
        end = self.data.index(b"\n", self.at)
        text = self.data[self.at:end].decode()
        self.at = end + 1
        return text

    def expect(self, text):
        assert self.data[self.at:self.at + len(text)] == text, (text, self.data[self.at:self.at + 40])
        self.at += len(text)


def read_smesh(path):
    """Points, triangles, their markers, the regions' points and labels, and the names of the markers."""
    lines = path.read_text().split("\n")
    names = {int(m[1]): m[2] for m in (re.fullmatch(r"# marker (\d+): (.*)", line) for line in lines) if m}
    rows = iter([line.split() for line in lines if line and not line.startswith("#")])
    count = int(next(rows)[0])
    points = np.array([next(rows) for _ in range(count)], float)
    assert (points[:, 0] == np.arange(1, count + 1)).all()
    faces = np.array([next(rows) for _ in range(int(next(rows)[0]))], int)
    assert (faces[:, 0] == 3).all()
    assert next(rows) == ["0"]  # holes
    regions = np.array([next(rows) for _ in range(int(next(rows)[0]))], float).reshape(-1, 6)
    assert next(rows, None) is None
    return points[:, 1:], faces[:, 1:4] - 1, faces[:, 4], regions[:, 1:4], regions[:, 4].astype(int), names


def volumes_of(points, tetrahedra):
    a, b, c, d = (points[tetrahedra[:, i]] for i in range(4))
    return np.abs(np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a)) / 6


def balls():
    """Label 1 around 2, in two parts; 3 and a part of 1 in halves of a ball; 4 with a cavity in a cavity."""
    z, y, x = np.mgrid[:22, :22, :62].astype(float)
    at = lambda i: np.hypot(np.hypot(x - i, y - 10.5), z - 10.5)  # noqa: E731
    labels = np.zeros(x.shape, int)
    labels[at(10) < 8] = 1
    labels[at(11) < 4] = 2
    labels[at(30) < 7] = 1
    labels[(at(30) < 7) & (y > 11)] = 3
    labels[at(50) < 9] = 4
    labels[at(50) < 6.5] = 0
    labels[at(51) < 4.5] = 4
    labels[at(51) < 2] = 0
    return labels


class MesherFiles(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory(prefix="isonest-test-", dir=served.MEMORY)
        cls.addClassCleanup(folder.cleanup)
        cls.here = pathlib.Path(folder.name)

    def store(self, labels, *options):
        np.save(self.here / "l.npy", labels.astype("i2"))
        store = self.here / "l.isonest"
        run("preprocess", "--labels", self.here / "l.npy", "-o", store, "--force", *options)
        return store

    def interfaces(self, store, to, *options, labels="all"):
        return run("extract", store, "--labels", labels, "--interfaces", "-o", self.here / to, *options)

    def test_files(self):
        """The triangles of the .ply file, sorted by the labels on their sides; a part for each in the voxels."""
        random = (RANDOM.random((9, 10, 11)) < 0.4).astype(int) + (RANDOM.random((9, 10, 11)) < 0.3)
        for labels, wanted in ((balls(), "all"), (cells(RANDOM, (14, 15, 16), 30, 5), "all"), (random, "all"),
                               (balls(), "1,4"), (random, "2")):
            store = self.store(labels)
            for options in (("--smooth=0", "--close"), ("--smooth", "--close")):
                self.interfaces(store, "i.ply", *options, labels=wanted)
                text = self.interfaces(store, "i.msh", *options, labels=wanted).stdout
                self.assertIn("gmsh -3", text)
                self.assertIn("tetgen -pA", self.interfaces(store, "i.smesh", *options, labels=wanted).stdout)
                points, faces, sides = read_interfaces(self.here / "i.ply")
                pairs = np.unique(sides, axis=0)
                names = {i + 1: f"{a} | {b}" for i, (a, b) in enumerate(pairs)}
                msh = Msh(self.here / "i.msh")
                self.assertEqual(msh.names, {(2, tag): name for tag, name in names.items()})
                np.testing.assert_array_equal(msh.points, points)
                for i, pair in enumerate(pairs):
                    tags = [tag for tag, (physical, _) in msh.surfaces.items() if physical == i + 1]
                    own = np.concatenate([msh.triangles[tag] for tag in tags])
                    expected = faces[(sides == pair).all(1)]
                    np.testing.assert_array_equal(own[np.lexsort(own.T)], expected[np.lexsort(expected.T)])
                    for tag in tags:
                        corners = points[msh.triangles[tag].ravel()]
                        np.testing.assert_array_equal(msh.surfaces[tag][1], [corners.min(0), corners.max(0)])
                smesh = read_smesh(self.here / "i.smesh")
                np.testing.assert_array_equal(smesh[0].astype("f4"), points)
                np.testing.assert_array_equal(smesh[1], faces)
                np.testing.assert_array_equal(pairs[smesh[2] - 1], sides)
                self.assertEqual(smesh[5], names)
                self.check_parts(labels, wanted, smesh[3], smesh[4], options)
                self.check_script(labels, wanted, msh)

    def check_parts(self, labels, wanted, points, ids, options):
        for label in np.unique(labels)[1:] if wanted == "all" else map(int, wanted.split(",")):
            part, count = ndimage.label(labels == label)
            self.assertEqual((ids == label).sum(), count, (label, options))
            if options[0] == "--smooth=0":  # the faces of the voxels
                z, y, x = np.rint(points[ids == label]).astype(int).T[::-1]
                self.assertEqual(sorted(part[z, y, x]), list(range(1, count + 1)))

    def check_script(self, labels, wanted, msh):
        """Each volume is closed: every edge of its surfaces has an even number of triangles."""
        script = (self.here / "i.geo").read_text()
        loops = {int(m[1]): [int(i) for i in m[2].split(",")]
                 for m in re.finditer(r"Surface Loop\((\d+)\) = \{([\d, ]+)\};\nVolume\(\1\) = \{\1\};", script)}
        groups = {int(m[2]): m[3].split(",") for m in re.finditer(r'Physical Volume\("(\d+)", (\d+)\) = \{([\d, ]+)\};', script)}
        self.assertEqual(sorted(groups), sorted(np.unique(labels)[1:]) if wanted == "all" else
                         [int(i) for i in wanted.split(",")])
        self.assertEqual(sum(map(len, groups.values())), len(loops))
        for tags in loops.values():
            faces = np.concatenate([msh.triangles[tag] for tag in tags])
            edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), 1)
            self.assertTrue((np.unique(edges, axis=0, return_counts=True)[1] % 2 == 0).all())

    def expected_volumes(self, store, *options):
        out = self.here / "closed"
        listed = json.loads(run("extract", store, "--labels", "all", *options, "-o", out, "--json").stdout)["labels"]
        return {entry["id"]: entry["volume"] for entry in listed}

    CASES = (("--smooth", "--close"), ("--smooth", "--close", "--distance", "0.2voxel"))

    @unittest.skipUnless(shutil.which("gmsh"), "gmsh is not installed")
    def test_gmsh(self):
        store = self.store(balls())
        for options in self.CASES:
            self.interfaces(store, "g.msh", *options)
            with open(self.here / "g.geo", "a") as script:
                script.write("Mesh.Binary = 0;\n")  # reading a binary file has set it
            tool(self.here, "gmsh", "-3", "g.geo", "-format", "msh2", "-o", "tet.msh")
            lines = (self.here / "tet.msh").read_text().split("\n")
            at = lines.index("$Nodes") + 2
            nodes = np.array([line.split() for line in lines[at:at + int(lines[at - 1])]], float)
            points = np.zeros((int(nodes[:, 0].max()) + 1, 3))
            points[nodes[:, 0].astype(int)] = nodes[:, 1:]
            at = lines.index("$Elements") + 2
            rows = [line.split() for line in lines[at:at + int(lines[at - 1])]]
            tetrahedra = np.array([row for row in rows if row[1] == "4"], int)  # number, type, 2, physical, entity, nodes
            self.compare(tetrahedra[:, 3], volumes_of(points, tetrahedra[:, 5:9]), self.expected_volumes(store, *options))
            # The surfaces are as they were.
            kept = np.sort(np.array([row[5:8] for row in rows if row[1] == "2"], int), 1)
            given = np.sort(np.concatenate(list(Msh(self.here / "g.msh").triangles.values())) + 1, 1)
            np.testing.assert_array_equal(np.unique(kept, axis=0), np.unique(given, axis=0))

    @unittest.skipUnless(shutil.which("tetgen"), "tetgen is not installed")
    def test_tetgen(self):
        store = self.store(balls())
        for options in self.CASES:
            self.interfaces(store, "t.smesh", *options)
            tool(self.here, "tetgen", "-pAY", "t.smesh")
            read = lambda end: np.array([line.split() for line in (self.here / f"t.1.{end}").read_text().split("\n")[1:]  # noqa: E731
                                         if line and not line.startswith("#")], float)
            nodes, tetrahedra = read("node"), read("ele").astype(int)
            self.assertEqual((nodes[:, 0] == np.arange(1, len(nodes) + 1)).all(), True)
            points = np.concatenate([np.zeros((1, 3)), nodes[:, 1:4]])
            volumes = volumes_of(points, tetrahedra[:, 1:5])
            expected = self.expected_volumes(store, *options)
            wanted = np.isin(tetrahedra[:, 5], list(expected))  # the cavities get other numbers
            self.compare(tetrahedra[wanted, 5], volumes[wanted], expected)

    def compare(self, ids, volumes, expected):
        self.assertEqual(set(ids), set(expected))
        for label, volume in expected.items():
            self.assertAlmostEqual(volumes[ids == label].sum() / volume, 1, 5, label)
        self.assertGreater(volumes.min(), 0)

    def test_names_bytes_and_frames(self):
        names = self.here / "names.txt"
        names.write_text('1 liver 40 50 60 255\n2 left\\kidney 10 20 30 255\n')
        store = self.store(cells(RANDOM, (12, 13, 14), 20, 4), "--label-names", names, "--frame", "lps", "--spacing",
                           "0.5,0.6,0.7")
        for end in ("msh", "smesh"):
            made = []
            for limits in (("--threads", 1), ("--threads", 3, "--memory", "50M")):
                self.interfaces(store, f"n.{end}", "--smooth", "--close", *limits)
                made.append((self.here / f"n.{end}").read_bytes())
            self.assertEqual(*made)
        msh = Msh(self.here / "n.msh")
        self.assertIn("1 liver | 2 left/kidney", msh.names.values())
        self.assertIn('Physical Volume("1 liver", 1)', (self.here / "n.geo").read_text())
        self.interfaces(store, "n.ply", "--smooth", "--close")  # both are RAS
        np.testing.assert_array_equal(msh.points, read_interfaces(self.here / "n.ply")[0])
        self.interfaces(store, "n.msh", "--smooth", "--close", "--space", "lps")
        np.testing.assert_array_equal(Msh(self.here / "n.msh").points, msh.points * (-1, -1, 1))
        # Numbers that gmsh does not have: by their order, with the label in the name.
        self.interfaces(store, "n.msh", "--smooth", "--close", labels="0-3")
        self.assertIn('Physical Volume("0", 1)', (self.here / "n.geo").read_text())

    def test_refused(self):
        store = self.store(cells(RANDOM, (12, 13, 14), 20, 4))
        for end in ("msh", "smesh"):
            to = self.here / f"no.{end}"
            open_ = run("extract", store, "--labels", "all", "--smooth", "--interfaces", "-o", to, code=2).stderr
            self.assertIn("is not closed", open_)
            self.assertIn(to.name, open_)
            self.assertFalse(to.exists())
            for options in (("--label", 1), ("--iso", 0.5)):
                self.assertIn("must end with", run("extract", store, *options, "-o", to, code=2).stderr)
            values = run("extract", store, "--labels", "all", "--smooth", "--interfaces", "--close", "--vertex-values",
                         f"v={store}", "-o", to, code=2).stderr
            self.assertIn("values at the vertices", values)
            self.assertFalse(to.exists())


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
