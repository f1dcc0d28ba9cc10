#!/usr/bin/env python3
"""NumPy files as written by NumPy, and parts of volumes.

usage: volume_parts_test.py ISONEST PLUGIN_FOLDER
"""
import gzip
import itertools
import pathlib
import struct
import subprocess
import sys
import unittest
import warnings

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served  # noqa: E402

try:
    import h5py
    import nibabel
    import numpy as np
    from volume_inputs import ISONEST, TYPES, DamagedFiles, Input, is_read_as, numbers
except ImportError as error:
    print(f"skipped: {error}")
    sys.exit(77)

warnings.filterwarnings("ignore")


class NumPyFiles(DamagedFiles, Input):
    def setUp(self):
        super().setUp()
        self.path = self.here / "v.npy"

    def test_types_orders_and_strides(self):
        for kind, order, ends in itertools.product((*TYPES, "i8", "u8", "f2", "b1"), "CF", "<>"):
            with self.subTest(kind=kind, order=order, ends=ends):
                data = numbers((5, 6, 7), "u1") > 100 if kind == "b1" else numbers((5, 6, 7), kind)
                np.save(self.path, np.asarray(data, dtype=data.dtype.newbyteorder(ends), order=order))
                self.reads(is_read_as(data.astype("u1") if kind == "b1" else data))

    def test_headers_that_other_programs_write(self):
        data = numbers((3, 1, 14))

        def write(text, pack=bytes):
            head = b"\x93NUMPY\2\0" + struct.pack("<I", len(text)) + text.encode()
            self.path.write_bytes(pack(head + data.tobytes("F" if "True" in text else "C")))
        for text in ("{'descr': '<i2', 'fortran_order': False, 'shape': (3, 1, 14), }\n",
                     '{"shape":(3,1,14),"descr":"<i2","fortran_order":True}', "{'shape': ( 3L , 1L, 14L\t) ,\n'descr' : '<i2' , 'fortran_order': True }\n"):
            with self.subTest(text=text):
                write(text)
                np.testing.assert_array_equal(np.load(self.path), data)
                self.reads(data)
        write("{'descr': '<i2', 'fortran_order': False, 'shape': (3, 1, 14), }" + " " * 5000 + "\n", gzip.compress)
        self.reads(data)
        write("{'descr': '<i2', 'fortran_order': maybe, 'shape': (3, 1, 14), }")
        self.refuses(4, "fortran_order")

    def test_arrays_of_one_to_six_axes(self):
        for shape, index, part in (((9,), (), ...), ((5, 6), (), ...), ((1, 5, 6, 1), (), (0, slice(None), slice(None), 0)),
                                   ((2, 3, 4, 5), ("--index", "1,:,:,:"), 1),
                                   ((4, 5, 6, 3), ("--index", ":,:,:,-1"), (..., -1)),
                                   ((2, 4, 5, 3, 6, 2), ("--index", "1,:,:,0,:,1"), (1, slice(None), slice(None), 0,
                                                                                      slice(None), 1))):
            for order in "CF":
                data = numbers(shape)
                np.save(self.path, np.asarray(data, order=order))
                self.reads(np.ascontiguousarray(data[part]), *index)
        self.refuses(5, "6 axes", "2, 4, 5, 3, 6, 2")

    def test_archives(self):
        data, other = numbers((5, 6, 7)), numbers((4, 5), "f4")
        self.path = self.here / "v.npz"
        for save in (np.savez, np.savez_compressed):
            save(self.path, volume=data)
            self.reads(data)
            save(self.path, volume=data, other=other)
            self.refuses(2, "volume", "other", "--dataset")
            self.reads(data, "--dataset", "volume")
            self.reads(other, "--dataset", "other")
            self.refuses(3, "volume", options=("--dataset", "third"))
            self.damaged(self.path.read_bytes(), 30)

    def test_a_packed_array(self):
        data = numbers((5, 6, 7))
        np.save(self.path, data)
        packed = gzip.compress(self.path.read_bytes())
        self.path = self.here / "v.npy.gz"
        self.path.write_bytes(packed)
        self.reads(data)

    def test_what_cannot_be_read_is_refused(self):
        for code, data in ((5, np.zeros((3, 4), "c8")), (5, np.zeros(3, [("a", "i2")])), (2, np.zeros((0, 3))),
                           (5, np.array(["a"])), (5, np.array([2**60, 1]))):
            np.save(self.path, data)
            self.refuses(code)

    def test_damaged_files(self):
        np.save(self.path, numbers((5, 6, 7)))
        self.damaged(self.path.read_bytes())


class Parts(Input):
    """--crop, --every, standard input."""

    def setUp(self):
        super().setUp()
        self.path = self.here / "v.npy"
        self.data = numbers((13, 17, 19))

    def test_a_part_is_what_numpy_slices_of_any_source(self):
        names = {"v.npy": None, "v.npy.gz": None, "f.npy": None, "v.nii": None}
        np.save(self.here / "v.npy", self.data)
        (self.here / "v.npy.gz").write_bytes(gzip.compress((self.here / "v.npy").read_bytes()))
        np.save(self.here / "f.npy", np.asfortranarray(self.data))
        nibabel.save(nibabel.Nifti1Image(self.data.T, np.diag([1, 1, 1, 1])), self.here / "v.nii")
        for name in names:
            self.path = self.here / name
            for crop, every, part in ((":,:,:", "2", np.s_[::2, ::2, ::2]), ("3:10,:,-4:", "1", np.s_[-4:, :, 3:10]),
                                      ("3:10,2:-2,5:6", "3,2,1", np.s_[5:6, 2:-2:2, 3:10:3]),
                                      (":,16:,:", "1x1x5", np.s_[::5, 16:, :]), (":,:,:", "99", np.s_[:1, :1, :1])):
                with self.subTest(name=name, crop=crop, every=every):
                    self.reads(np.ascontiguousarray(self.data[part]), "--crop", crop, "--every", every)
        self.lies([0, 0, 0], [99, 99, 99])
        for crop in ("5:5,:,:", "0:20,:,:", "-20:,:,:"):
            self.refuses(2, "nodes 0 to 18", options=("--crop", crop))

    def test_chunked_hdf5_and_little_memory(self):
        self.path = self.here / "v.h5"
        data = numbers((40, 50, 60))
        with h5py.File(self.path, "w") as file:
            file.create_dataset("v", data=data, chunks=(16, 16, 16), compression="gzip")
        self.reads(np.ascontiguousarray(data[5:33:2, 3::3, 1:-1]), "--crop", "1:-1,3:,5:33", "--every", "1,3,2")

    def test_the_place_of_a_part(self):
        np.save(self.path, self.data)
        self.reads(np.ascontiguousarray(self.data[2::2, 1:, ::3]), "--crop", ":,1:,2:", "--every", "3,1,2",
                   "--spacing", "1,2,3", "--origin", "10,20,30")
        self.lies([10, 22, 36], [3, 2, 6])
        done = served.run([ISONEST, "check", self.here / "s.isonest", "--source", self.path, "--crop", ":,1:,2:",
                           "--every", "3,1,2"], capture_output=True, text=True)
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)

    def test_standard_input(self):
        np.save(self.path, self.data)
        whole = self.path.read_bytes()
        done = subprocess.run([ISONEST, "preprocess", "-", "-o", self.here / "s.isonest", "--chunk", "8"], input=whole,
                              capture_output=True)
        self.assertEqual(done.returncode, 0, done.stderr)
        served.run([ISONEST, "export", self.here / "s.isonest", "--field", "values", "-o", self.here / "s.raw"],
                   check=True, capture_output=True)
        np.testing.assert_array_equal(np.fromfile(self.here / "s.raw", "i2"), self.data.ravel())
        # HDF5 can only open files by name.
        with h5py.File(self.here / "v.h5", "w") as file:
            file.create_dataset("a", data=self.data, chunks=(4, 4, 4), compression="gzip")
            file["b"] = self.data[::-1]
        for dataset, data in (("a", self.data), ("b", self.data[::-1])):
            with open(self.here / "v.h5", "rb") as file:
                done = subprocess.run([ISONEST, "preprocess", "-", "-o", self.here / "s.isonest", "--chunk", "8", "--force",
                                       "--dataset", dataset], stdin=file, capture_output=True)
            self.assertEqual(done.returncode, 0, done.stderr)
            served.run([ISONEST, "export", self.here / "s.isonest", "--field", "values", "-o", self.here / "s.raw",
                        "--force"], check=True, capture_output=True)
            np.testing.assert_array_equal(np.fromfile(self.here / "s.raw", "i2"), data.ravel())
        with open(self.here / "v.h5", "rb") as file:
            done = subprocess.run([ISONEST, "preprocess", "-", "-o", self.here / "t.isonest"], stdin=file, capture_output=True)
        self.assertEqual(done.returncode, 2, done.stderr)
        self.assertNotIn(b"scratch", done.stderr)
        self.assertEqual([p.name for p in self.here.iterdir() if "scratch" in p.name], [])
        for code, data, options in ((2, b"", ()), (2, b"abc", ()), (2, whole, ("--resume",)), (2, whole[:-3], ())):
            done = subprocess.run([ISONEST, "preprocess", "-", "-o", self.here / "t.isonest", *options], input=data,
                                  capture_output=True, text=False)
            self.assertEqual(done.returncode, code, done.stderr)
            self.assertNotIn(b"/proc", done.stderr)
            self.assertEqual([p.name for p in self.here.glob("*t.isonest*")], [])

    def test_numbers_as_people_write_them(self):
        self.path = self.here / "v.raw"
        self.path.write_bytes(self.data.astype(">i2").tobytes())
        for options in (("--type", ">i2"), ("--type", "i2", "--endian", "big"), ("--type", "short", "--endian", "big")):
            self.reads(self.data, "--dims", "19x17x13", *options)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
