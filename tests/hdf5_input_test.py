#!/usr/bin/env python3
"""Volumes in HDF5 as other programs write them: what is read are the numbers that h5py reads.

usage: hdf5_input_test.py ISONEST PLUGIN_FOLDER
"""
import pathlib
import subprocess
import sys
import tempfile
import unittest

try:
    import h5py
    import numpy as np
except ImportError as error:
    print(f"skipped: {error}")
    sys.exit(77)

ISONEST = sys.argv[1]
RANDOM = np.random.default_rng(3)


class Hdf5Input(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory(prefix="isonest-test-")
        self.addCleanup(self.folder.cleanup)
        self.here = pathlib.Path(self.folder.name)
        self.path = self.here / "v.h5"

    def preprocess(self, *options):
        return subprocess.run([ISONEST, "preprocess", self.path, "-o", self.here / "s.isonest",
                               "--chunk", "8", "--force", *options], capture_output=True, text=True)

    def reads(self, data, *options):
        """The store has these numbers, [z, y, x]."""
        done = self.preprocess(*options)
        self.assertEqual(done.returncode, 0, done.stderr)
        subprocess.run([ISONEST, "export", self.here / "s.isonest", "--field", "values", "-o",
                        self.here / "s.raw", "--force"], check=True, capture_output=True)
        found = np.fromfile(self.here / "s.raw", data.dtype)
        np.testing.assert_array_equal(found, data.ravel())

    def refuses(self, code, *words):
        done = self.preprocess()
        self.assertEqual(done.returncode, code, done.stderr)
        for word in words:
            self.assertIn(word, done.stderr)

    def write(self, **datasets):
        with h5py.File(self.path, "w") as file:
            for name, data in datasets.items():
                file[name] = data

    def test_half_precision_is_read_as_float32(self):
        data = RANDOM.normal(size=(9, 10, 11)).astype(np.float16)
        data[1, 2, 3] = np.nan
        self.write(v=data)
        self.reads(data.astype(np.float32))

    def test_truth_values_and_enumerations_are_read_as_their_integers(self):
        mask = RANDOM.random((9, 10, 11)) < 0.3
        self.write(v=mask)
        self.reads(mask.astype(np.int8))
        kinds = h5py.enum_dtype({"air": 0, "bone": 700}, basetype=np.uint16)
        data = (mask * 700).astype(np.uint16)
        with h5py.File(self.path, "w") as file:
            file.create_dataset("v", data=data.astype(kinds), dtype=kinds, chunks=(4, 4, 4))
        self.reads(data)

    def test_foreign_byte_order_is_read(self):
        for kind in (">i2", ">u4", ">f4", ">f8", "<i4"):
            data = RANDOM.integers(0, 30000, (5, 9, 7)).astype(kind)
            with self.subTest(kind=kind):
                self.write(v=data)
                self.reads(data.astype(data.dtype.newbyteorder("=")))

    def test_64_bit_integers_are_read_as_float64_if_it_holds_them(self):
        for kind in (np.int64, np.uint64):
            data = RANDOM.integers(0, 2**53, (9, 10, 11)).astype(kind)
            data[3, 4, 5] = 2**53
            with self.subTest(kind=kind):
                self.write(v=data)
                self.reads(data.astype(np.float64))
                data[8, 9, 10] = 2**53 + 1
                self.write(v=data)
                self.refuses(5, "/v: planes", "2^53")
                self.assertEqual(sorted(p.name for p in self.here.iterdir()),
                                 ["s.isonest", "s.raw", "v.h5"])

    def test_axes_of_length_1_beyond_three_are_left_out(self):
        data = RANDOM.integers(0, 99, (20, 11, 9)).astype(np.uint8)
        for shape, chunks in (((1, 20, 11, 9), None), ((1, 1, 20, 11, 9), (1, 1, 7, 11, 5)),
                              ((20, 11, 9, 1), (6, 4, 3, 1)), ((20, 1, 11, 1, 9), (5, 1, 11, 1, 9)),
                              ((1, 20, 1, 11, 1, 9, 1), None)):
            with self.subTest(shape=shape):
                with h5py.File(self.path, "w") as file:
                    file.create_dataset("v", data=data.reshape(shape), chunks=chunks,
                                        compression="gzip" if chunks else None)
                self.reads(data)
        self.write(v=data[:1].reshape(1, 1, 11, 9))  # three are left: flat, as [1, 11, 9] is
        self.reads(data[:1])
        self.write(v=data.reshape(2, 10, 11, 9))
        self.refuses(3, "no dataset that is a volume", "/v [2, 10, 11, 9] uint8")

    def test_an_axis_that_can_grow_may_have_longer_chunks_than_it_is(self):
        data = RANDOM.integers(0, 99, (12, 11, 9)).astype(np.uint8)
        with h5py.File(self.path, "w") as file:
            file.create_dataset("v", data=data[None], chunks=(4, 16, 16, 16),
                                maxshape=(None, None, None, None))
        self.reads(data)

    def test_the_only_dataset_with_the_most_axes_is_the_volume(self):
        data = RANDOM.integers(0, 99, (6, 5, 7)).astype(np.uint8)
        self.write(**{"entry/x": np.arange(7.0), "entry/mean": data[0], "entry/data": data,
                      "title": "scan"})
        self.reads(data)
        self.reads(data[0], "--dataset", "/entry/mean")
        with h5py.File(self.path, "a") as file:
            file["entry/flat"] = data[:1]
        self.refuses(2, "several volumes", "/entry/x [7] float64", "/entry/flat [1, 5, 7] uint8")

    def test_a_virtual_dataset_is_read_where_all_of_its_sources_are(self):
        data = RANDOM.integers(0, 99, (8, 5, 7)).astype(np.uint8)
        layout = h5py.VirtualLayout((8, 5, 7), np.uint8)
        for i in range(2):
            with h5py.File(self.here / f"part{i}.h5", "w") as file:
                file["part"] = data[4 * i:4 * i + 4]
            layout[4 * i:4 * i + 4] = h5py.VirtualSource(f"part{i}.h5", "part", (4, 5, 7))
        with h5py.File(self.path, "w") as file:
            file.create_virtual_dataset("v", layout, fillvalue=7)
        self.reads(data)
        with h5py.File(self.here / "part1.h5", "a") as file:
            file.move("part", "other")
        self.refuses(3, "part1.h5:part", "fill value")
        (self.here / "part1.h5").unlink()
        self.refuses(3, "part1.h5:part", "fill value")


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
