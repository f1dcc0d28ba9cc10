#!/usr/bin/env python3
"""OpenVDB files as written by pyopenvdb.

usage: vdb_input_test.py ISONEST PLUGIN_FOLDER
"""
import pathlib
import sys
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served  # noqa: E402

try:
    import numpy as np
    import pyopenvdb as vdb
    from volume_inputs import ISONEST, RANDOM, DamagedFiles, Input, Module
except ImportError as error:
    print(f"skipped: {error}")
    sys.exit(77)
if b"libopenvdb-dev" in served.run([ISONEST, "--version"], capture_output=True).stdout:
    print("skipped: this build does not read OpenVDB (Debian: libopenvdb-dev)")
    sys.exit(77)


class OpenVdb(DamagedFiles, Module, Input):
    def setUp(self):
        super().setUp()
        self.path = self.here / "v.vdb"
        self.data = RANDOM.normal(size=(9, 11, 14)).astype("f4")
        # Sparse: two corners and a few more.
        sparse = RANDOM.random(self.data.shape) < 0.05
        sparse[0, 0, 0] = sparse[-1, -1, -1] = True
        self.data[~sparse] = 3

    def grid(self, name="density", transform=None, kind=vdb.FloatGrid, at=(-3, 5, 100)):
        grid = kind(3)
        # Grids are [x, y, z]; values equal to the background are not active.
        grid.copyFromArray(np.ascontiguousarray(self.data.T).astype("f8" if kind is not vdb.FloatGrid else "f4"), ijk=at,
                           tolerance=0)
        grid.name = name
        if transform is not None:
            grid.transform = vdb.createLinearTransform(transform)
        return grid

    def test_the_box_of_active_values_with_the_background(self):
        vdb.write(str(self.path), grids=[self.grid()])
        self.reads(self.data)
        self.lies([-3, 5, 100], [1, 1, 1])
        # Row vectors: index * matrix.
        vdb.write(str(self.path), grids=[self.grid(transform=[[0.5, 0, 0, 0], [0, 0.25, 0, 0], [0, 0, 2, 0], [1, 2, 3, 1]])])
        self.reads(self.data)
        self.lies([1 - 1.5, 2 + 1.25, 3 + 200], [0.5, 0.25, 2])
        self.reads(self.data[2:7, :, ::2].copy()[:, ::2], "--crop", ":,:,2:7", "--every", "2,2,1")

    def test_without_its_module_it_is_told_of(self):
        vdb.write(str(self.path), grids=[self.grid()])
        self.needs_module(self.moved_program(), "isonest_openvdb.so", "isonest-openvdb")

    def test_turned_grids(self):
        turn, _ = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))
        turn *= np.linalg.det(turn)
        matrix = np.eye(4)
        matrix[:3, :3] = turn * 0.5
        vdb.write(str(self.path), grids=[self.grid(transform=matrix.tolist())])
        self.reads(self.data)
        np.testing.assert_allclose(np.array(self.directions()).reshape(3, 3), turn, atol=1e-8)
        self.lies(np.array([-3, 5, 100]) @ turn * 0.5, [0.5] * 3)

    def test_a_grid_is_chosen_by_its_name(self):
        vdb.write(str(self.path), grids=[self.grid("a"), self.grid("b", at=(0, 0, 0))])
        self.refuses(2, "--dataset", "a (float)", "b (float)")
        self.reads(self.data, "--dataset", "b")
        self.lies([0, 0, 0], [1, 1, 1])
        self.refuses(3, "no grid c", options=("--dataset", "c"))
        other = self.grid("a", at=(1, 2, 3))
        vdb.write(str(self.path), grids=[self.grid("a"), self.grid("b"), other])
        self.refuses(2, "a[0] (float)", "a[1] (float)", "b (float)", options=("--dataset", "a"))
        self.reads(self.data, "--dataset", "a[1]")
        self.lies([1, 2, 3], [1, 1, 1])
        self.reads(self.data, "--dataset", "a[0]")
        self.lies([-3, 5, 100], [1, 1, 1])
        empty = vdb.FloatGrid(1)
        empty.name = "empty"
        vdb.write(str(self.path), grids=[empty])
        self.refuses(5, "no active values")

    def test_damaged_files(self):
        vdb.write(str(self.path), grids=[self.grid()])
        whole = self.path.read_bytes()
        for cut in range(8, len(whole), max(len(whole) // 25, 1)):
            self.path.write_bytes(whole[:cut])
            self.assertIn(self.preprocess("--memory", "256M").returncode, (4, 5, 7), cut)

    def test_files_that_were_cut_short(self):
        # OpenVDB itself reads some of these, with other values.
        vdb.write(str(self.path), grids=[self.grid("a"), self.grid("density")])
        whole = self.path.read_bytes()
        self.reads(self.data, "--dataset", "density")
        for cut in (1, 2, 5, 17, 60, 200, 900):
            self.path.write_bytes(whole[:-cut])
            for name in ("a", "density"):
                self.refuses(4, "cut short", options=("--dataset", name))


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
