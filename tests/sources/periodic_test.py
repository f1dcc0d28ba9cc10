#!/usr/bin/env python3
"""Volumes with periodic axes, compared with arrays that NumPy repeats.

usage: periodic_test.py ISONEST PLUGIN_FOLDER
"""
import collections
import gzip
import json
import os
import pathlib
import sys
import tempfile
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served  # noqa: E402
from mesh_data import read_points  # noqa: E402

import h5py
import nibabel
import numpy as np
import tifffile

ISONEST = pathlib.Path(sys.argv[1])
os.environ["HDF5_PLUGIN_PATH"] = sys.argv[2]
RANDOM = np.random.default_rng(58)


def run(*arguments, code=0):
    done = served.run([ISONEST, *map(str, arguments)], capture_output=True, text=True)
    assert done.returncode == code, (arguments, done.returncode, done.stderr)
    return done


def repeated(values, axes, repeat=(1, 1, 1)):
    """`axes` and `repeat` along x, y, z of an array [z, y, x]."""
    for axis, name in enumerate("xyz"):
        if name in axes:
            there = 2 - axis
            values = np.concatenate([values] * repeat[axis] + [values.take([0], there)], there)
    return values


class Periodic(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory(prefix="isonest-test-", dir=served.MEMORY)
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)
        self.values = RANDOM.integers(-1000, 1000, (23, 17, 19)).astype("i2")

    def stored(self, file, *options):
        run("preprocess", file, "-o", self.folder / "s.isonest", "--force", *options)
        run("export", self.folder / "s.isonest", "-o", self.folder / "e.npy", "--force")
        return np.load(self.folder / "e.npy")

    def files(self):
        np.save(self.folder / "v.npy", self.values)
        yield self.folder / "v.npy"
        with h5py.File(self.folder / "v.h5", "w") as file:
            file.create_dataset("v", data=self.values, chunks=(8, 5, 7), compression="gzip")
        yield self.folder / "v.h5"
        tifffile.imwrite(self.folder / "v.tif", self.values, photometric="minisblack")
        yield self.folder / "v.tif"

    def test_nodes_are_those_of_a_repeated_array(self):
        for file in self.files():
            for axes, repeat in (("x", (1, 1, 1)), ("y,z", (1, 1, 1)), ("xyz", (2, 1, 3)), ("z", (1, 1, 4)), ("y", (1, 5, 1))):
                options = ["--periodic", axes] + (["--repeat", ",".join(map(str, repeat))] if max(repeat) > 1 else [])
                got = self.stored(file, *options, "--memory", "64M")
                self.assertTrue(np.array_equal(got, repeated(self.values, axes, repeat)), (file.name, axes, repeat))

    def test_a_part_is_the_period_and_missing_values_repeat(self):
        np.save(self.folder / "v.npy", self.values)
        value = int(self.values[9, 8, 7])
        got = self.stored(self.folder / "v.npy", "--periodic", "x", "--crop", "4:12,:,:", "--missing", value)
        part = self.values[:, :, 4:12].astype(float)
        part[part == value] = np.nan
        self.assertTrue(np.array_equal(got, repeated(part, "x"), equal_nan=True))

    def test_a_compressed_stream_repeats_along_x_and_y_alone(self):
        with gzip.open(self.folder / "v.nii.gz", "wb") as file:
            file.write(nibabel.Nifti1Image(np.ascontiguousarray(self.values.T), np.eye(4)).to_bytes())
        got = self.stored(self.folder / "v.nii.gz", "--periodic", "x,y", "--repeat", "2,3,1")
        self.assertTrue(np.array_equal(got, repeated(self.values, "xy", (2, 3, 1))))
        done = run("preprocess", self.folder / "v.nii.gz", "-o", self.folder / "z.isonest", "--periodic", "z", code=5)
        self.assertIn("uncompress", done.stderr)

    def test_a_surface_closes_across_the_seam(self):
        n = 24
        x, y, z = np.meshgrid(*(2 * np.pi * np.arange(n) / n,) * 3, indexing="ij")
        gyroid = np.sin(x) * np.cos(y) + np.sin(y) * np.cos(z) + np.sin(z) * np.cos(x)
        np.save(self.folder / "g.npy", gyroid.astype("f4"))
        run("extract", self.folder / "g.npy", "--iso", 0.2, "--periodic", "x,y,z", "-o", self.folder / "g.ply")
        points, faces = read_points(self.folder / "g.ply")
        edges = collections.Counter()
        for face in faces:
            for a, b in zip(face, np.roll(face, -1)):
                edges[min(a, b), max(a, b)] += 1
        border = [points[list(edge)] for edge, count in edges.items() if count == 1]
        self.assertGreater(len(border), 100)
        for axis in range(3):
            sides = [{tuple(sorted(map(tuple, np.round(np.delete(e, axis, 1), 4).tolist()))) for e in border
                      if (e[:, axis] == at).all()} for at in (0, n)]
            self.assertGreater(len(sides[0]), 10)
            self.assertEqual(sides[0], sides[1])

    def test_what_makes_no_sense_is_refused(self):
        np.save(self.folder / "v.npy", self.values)
        for options, code, text in ((["--periodic", "w"], 2, "axes"), (["--repeat", "2,1,1"], 2, "--periodic"),
                                    (["--periodic", "x", "--repeat", "1,2,1"], 2, "only periodic axes"),
                                    (["--periodic", "x", "--repeat", "900000,1,1"], 7, "nodes"),
                                    (["--periodic", "z", "--crop", ":,:,3:4"], 2, "one node")):
            done = run("preprocess", self.folder / "v.npy", "-o", self.folder / "r.isonest", *options, code=code)
            self.assertIn(text, done.stderr)
        self.assertFalse((self.folder / "r.isonest").exists())
        run("preprocess", self.folder / "v.npy", "-o", self.folder / "r.isonest")
        self.assertIn("--periodic", run("extract", self.folder / "r.isonest", "--iso", 0, "--periodic", "x", "-o",
                                        self.folder / "r.ply", code=2).stderr)
        self.assertEqual(json.loads(run("info", self.folder / "v.npy", "--periodic", "x", "--json").stdout)["nodes"][0], 20)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
