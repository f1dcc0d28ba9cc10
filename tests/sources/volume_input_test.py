#!/usr/bin/env python3
"""Volumes in HDF5 as other programs write them: the numbers, and their positions in the world.

usage: volume_input_test.py ISONEST PLUGIN_FOLDER
"""
import gzip
import itertools
import os
import pathlib
import sys
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served  # noqa: E402

os.environ["HDF5_PLUGIN_PATH"] = sys.argv[2]
try:
    import h5py
    import numpy as np
    from volume_inputs import ISONEST, Input
except ImportError as error:
    print(f"skipped: {error}")
    sys.exit(77)

RANDOM = np.random.default_rng(3)


class Hdf5Input(Input):
    def setUp(self):
        super().setUp()
        self.path = self.here / "v.h5"

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
        self.write(v=data[:1].reshape(1, 1, 11, 9))  # three remain: flat, like [1, 11, 9]
        self.reads(data[:1])
        self.write(v=data.reshape(2, 10, 11, 9))
        self.refuses(5, "4 axes", "2, 10, 11, 9", "--index")

    def test_an_axis_that_can_grow_may_have_longer_chunks_than_it_is(self):
        data = RANDOM.integers(0, 99, (12, 11, 9)).astype(np.uint8)
        with h5py.File(self.path, "w") as file:
            file.create_dataset("v", data=data[None], chunks=(4, 16, 16, 16),
                                maxshape=(None, None, None, None))
        self.reads(data)

    def test_chunks_are_decoded_as_h5py_decodes_them(self):
        filters = ({}, {"compression": "gzip"}, {"compression": "gzip", "shuffle": True},
                   {"compression": 32015, "shuffle": True}, {"compression": 32015},
                   {"shuffle": True}, {"compression": "gzip", "fletcher32": True},
                   {"scaleoffset": 0})
        shapes = itertools.cycle(((64, 64, 64), (4, 5, 6), (1, 18, 35)))
        for kind in (np.uint8, np.int16, np.float32, np.float64, ">i4"):
            data = RANDOM.integers(0, 99, (21, 18, 35)).astype(kind)
            for options in filters:
                if "scaleoffset" in options and data.dtype.kind == "f":
                    continue
                chunks = next(shapes)
                with self.subTest(kind=kind, options=options, chunks=chunks):
                    with h5py.File(self.path, "w") as file:
                        file.create_dataset("v", data=data, maxshape=(None, None, None),
                                            chunks=chunks, **options)
                    self.reads(data.astype(data.dtype.newbyteorder("=")))

    def test_where_a_volume_lies_does_not_depend_on_how_it_is_stored(self):
        data = RANDOM.integers(0, 99, (6, 5, 7))
        for kind in ("<u2", ">u2", ">f8"):
            for options in ({}, {"chunks": (4, 4, 4)}, {"chunks": (4, 4, 4), "compression": "gzip"}):
                with self.subTest(kind=kind, options=options):
                    with h5py.File(self.path, "w") as file:
                        volume = file.create_dataset("v", data=data.astype(kind), **options)
                        volume.attrs.update(spacing=[1.0, 2.0, 3.0], origin=[4.0, 5.0, 6.0], unit="mm")
                    self.reads(data.astype(kind).astype(np.dtype(kind).newbyteorder("=")))
                    info = self.info()
                    self.assertEqual((info["spacing"], info["origin"], info["unit"]),
                                     ([1.0, 2.0, 3.0], [4.0, 5.0, 6.0], "mm"))

    def test_the_store_does_not_depend_on_how_the_input_is_stored(self):
        data = RANDOM.integers(0, 99, (61, 58, 55)).astype(np.float32)
        stores = set()
        for options in ({}, {"chunks": (16, 16, 16), "compression": "gzip", "shuffle": True},
                        {"chunks": (7, 58, 9), "compression": 32015}, {"chunks": (5, 6, 7)}):
            for more in ((), ("--threads", "1", "--memory", "20M")):
                with h5py.File(self.path, "w") as file:
                    file.create_dataset("v", data=data, **options)
                self.reads(data, *more)
                stores.add((self.here / "s.isonest").read_bytes())
        self.assertEqual(len(stores), 1)

    def test_chunks_that_were_never_written_hold_the_fill_value(self):
        data = np.full((20, 30, 40), -3, np.int32)
        data[5:9, 8:17, 3:31] = 11
        for options in ({"compression": "gzip", "shuffle": True}, {}):
            with h5py.File(self.path, "w") as file:
                v = file.create_dataset("v", data.shape, np.int32, chunks=(8, 8, 8), fillvalue=-3,
                                        **options)
                v[5:9, 8:17, 3:31] = 11
            self.reads(data)

    def test_a_chunk_may_have_skipped_a_filter(self):
        data = RANDOM.integers(0, 30000, (8, 8, 16)).astype(np.int16)
        with h5py.File(self.path, "w") as file:
            v = file.create_dataset("v", data=data, chunks=(8, 8, 8), shuffle=True,
                                    compression="gzip")
            v.id.write_direct_chunk((0, 0, 8), data[:, :, 8:].tobytes(), filter_mask=3)
        self.reads(data)

    def test_a_damaged_chunk_is_named(self):
        data = RANDOM.integers(0, 30000, (16, 16, 16)).astype(np.int16)
        for options, damage in (({"compression": "gzip", "shuffle": True}, lambda b: b[:-9]),
                                ({"compression": "gzip"}, lambda b: bytes(len(b))),
                                ({"compression": 32015}, lambda b: b[:40] + b"x" + b[41:-1]),
                                ({"shuffle": True}, lambda b: b + b),
                                ({"shuffle": True}, lambda b: b[:100]),
                                ({"compression": "gzip"}, lambda b: gzip.zlib.compress(bytes(99999))),
                                ({"compression": "gzip"}, lambda b: gzip.zlib.compress(bytes(99)))):
            with self.subTest(options=options):
                with h5py.File(self.path, "w") as file:
                    v = file.create_dataset("v", data=data, chunks=(8, 8, 8), **options)
                    _, whole = v.id.read_direct_chunk((8, 0, 8))
                    v.id.write_direct_chunk((8, 0, 8), damage(bytes(whole)))
                self.refuses(4, "/v: chunk at node 8 0 8")
                self.assertFalse((self.here / "s.isonest").exists())

    def test_the_only_dataset_with_the_most_axes_is_the_volume(self):
        data = RANDOM.integers(0, 99, (6, 5, 7)).astype(np.uint8)
        self.write(**{"entry/x": np.arange(7.0), "entry/mean": data[0], "entry/data": data,
                      "title": "scan"})
        self.reads(data)
        self.reads(data[0], "--dataset", "/entry/mean")
        with h5py.File(self.path, "a") as file:
            file["entry/flat"] = data[:1]
        self.refuses(2, "several volumes", "/entry/x [7] float64", "/entry/flat [1, 5, 7] uint8")

    def test_numbers_that_were_never_written_are_the_fill_value(self):
        for block in (0, 512, 4096):
            with h5py.File(self.path, "w", userblock_size=block) as file:
                file.create_dataset("v", (7, 24, 1), "i1")
            self.reads(np.zeros((7, 24, 1), np.int8))
        # An array that shrank along its last axis and grew again, which HDF5 1.10 indexes incorrectly.
        for libver in ("earliest", "latest"):
            with h5py.File(self.path, "w", libver=libver) as file:
                data = file.create_dataset("v", (1, 2, 7), "f4", maxshape=(1, 5, None), chunks=(1, 3, 3), compression="gzip", fillvalue=7)
                data[...] = np.arange(100, 114).reshape(1, 2, 7)
                data.resize(4, axis=2)
                data.resize(7, axis=2)
                expected = data[()]
            self.assertEqual((expected == 7).sum(), 6)
            self.reads(expected)

    def test_a_row_or_an_image_beside_an_array_of_four_axes_is_not_the_volume(self):
        data = RANDOM.integers(0, 99, (2, 6, 5, 7)).astype(np.uint8)
        for beside in (np.arange(7.0), data[0, 0]):
            self.write(beside=beside, data=data)
            self.refuses(5, "/data", "2, 6, 5, 7", "--index")
            self.reads(data[1], "--index", "1,:,:,:")
            self.reads(beside.reshape((1, -1, 7)), "--dataset", "/beside")
        self.write(beside=data[0, 0], data=data, more=data)
        self.refuses(2, "several volumes", "/data [2, 6, 5, 7]", "/more [2, 6, 5, 7]")
        self.write(volume=data[0], data=data)
        self.reads(data[0])

    def test_attributes_place_the_volume_and_what_cannot_be_is_refused(self):
        for data, spacing, origin in ((RANDOM.random((4, 5, 6)), (1, 2, 3), (-7, 8, 9)),
                                      (RANDOM.random((5, 6)), (1, 2), (-7, 8)),
                                      (RANDOM.random((1, 5, 6)), (1, 2, 3), (-7, 8, 9))):
            self.write(v=data)
            with h5py.File(self.path, "a") as file:
                file["v"].attrs.update({"spacing": spacing, "origin": origin})
            self.reads(data.reshape((-1, *data.shape[-2:])))
            self.lies([*origin, 0][:3], [*spacing, 1][:3])
        for name, value in (("spacing", (1, -2, 3)), ("spacing", (1, 2, 0)),
                            ("spacing", (np.nan, 2, 3)), ("origin", (0, np.inf, 0))):
            with self.subTest(name=name, value=value):
                self.write(v=RANDOM.random((4, 5, 6)))
                with h5py.File(self.path, "a") as file:
                    file["v"].attrs[name] = value
                self.refuses(2, "v.h5:/v: spacing", "--spacing")

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

    def test_a_virtual_dataset_of_virtual_datasets_is_followed_to_the_last(self):
        data = RANDOM.integers(0, 99, (8, 5, 7)).astype(np.uint8)
        (self.here / "parts").mkdir()
        with h5py.File(self.here / "parts/0.h5", "w") as file:
            file["v"] = data
        for i, place in ((1, self.here / "parts/1.h5"), (2, self.path)):
            layout = h5py.VirtualLayout(data.shape, np.uint8)
            layout[:] = h5py.VirtualSource("0.h5" if i == 1 else "parts/1.h5", "v", data.shape)
            with h5py.File(place, "w") as file:
                file.create_virtual_dataset("v", layout, fillvalue=7)
        self.reads(data)
        (self.here / "parts/0.h5").unlink()
        self.refuses(3, "parts/1.h5:v", "virtual dataset", "0.h5:v", "fill value")

    def test_the_other_files_of_a_dataset_are_inputs_too(self):
        data = RANDOM.integers(0, 99, (8, 5, 7)).astype(np.uint8)
        part, raw = self.here / "part.h5", self.here / "part.raw"
        with h5py.File(part, "w") as file:
            file["part"] = data
        layout = h5py.VirtualLayout(data.shape, np.uint8)
        layout[:] = h5py.VirtualSource(str(part), "part", data.shape)
        for other in (part, raw):
            with h5py.File(self.path, "w") as file:
                if other == part:
                    file.create_virtual_dataset("v", layout)
                else:
                    file.create_dataset("v", data=data, external=[(str(raw), 0, data.nbytes)])
            self.reads(data)
            before = other.read_bytes()
            done = self.preprocess(store=other)
            self.assertEqual(done.returncode, 2, done.stderr)
            self.assertIn(other.name, done.stderr)
            self.assertEqual(other.read_bytes(), before)
            other.unlink()
            self.refuses(3, other.name)

    def test_external_links_lead_to_the_file_that_holds_the_values(self):
        data = RANDOM.integers(0, 30000, (8, 9, 10)).astype(np.int16)
        last, middle = self.here / "last.h5", self.here / "middle.h5"
        with h5py.File(last, "w") as file:
            file["g/v"] = data
        with h5py.File(middle, "w") as file:
            file["g"] = h5py.ExternalLink("last.h5", "/g")
        with h5py.File(self.path, "w") as file:
            file["pad"] = np.arange(100000, dtype="i2")
            file["v"] = h5py.ExternalLink("middle.h5", "/g/v")
            file["s"] = h5py.SoftLink("/v")
        for name in ("v", "s", "/v"):
            self.reads(data, "--dataset", name)
        for other in (last, middle):
            before = other.read_bytes()
            done = self.preprocess("--dataset", "s", store=other)
            self.assertEqual(done.returncode, 2, done.stderr)
            self.assertEqual(other.read_bytes(), before)
        last.unlink()
        os.mkfifo(last)
        done = self.preprocess("--dataset", "s")
        self.assertEqual(done.returncode, 2, done.stderr)
        self.assertIn("not a regular file", done.stderr)
        last.unlink()
        done = self.preprocess("--dataset", "s")
        self.assertEqual(done.returncode, 3, done.stderr)
        self.assertIn("last.h5", done.stderr)

    def test_external_storage_that_is_too_short_is_refused(self):
        data = RANDOM.integers(0, 30000, (8, 9, 10)).astype(np.int16)
        raw = self.here / "part.raw"
        with h5py.File(self.path, "w") as file:
            file.create_dataset("v", data=data, external=[(str(raw), 4, data.nbytes)])
        self.reads(data)
        raw.write_bytes(raw.read_bytes()[:-1])
        self.refuses(4, "part.raw", "zeros")

    def test_a_virtual_dataset_that_is_its_own_source_is_refused(self):
        layout = h5py.VirtualLayout((4, 5, 6), "u1")
        layout[:] = h5py.VirtualSource(".", "v", (4, 5, 6))
        with h5py.File(self.path, "w") as file:
            file.create_virtual_dataset("v", layout)
        self.refuses(4, "its own source")

    def test_a_virtual_datasets_source_that_has_become_smaller_is_refused(self):
        data = RANDOM.integers(1, 99, (4, 5, 6)).astype(np.uint8)
        layout = h5py.VirtualLayout((4, 5, 6), "u1")
        layout[:] = h5py.VirtualSource("part.h5", "v", (4, 5, 6))
        with h5py.File(self.path, "w") as file:
            file.create_virtual_dataset("v", layout)
        for n in (4, 3):
            with h5py.File(self.here / "part.h5", "w") as file:
                file["v"] = data[:n]
            if n == 4:
                self.reads(data)
            else:
                self.refuses(4, "part.h5:v has fewer")

    def test_all_datasets_are_looked_at(self):
        data = RANDOM.integers(0, 99, (6, 5, 7)).astype(np.uint8)
        with h5py.File(self.path, "w") as file:
            file["a"] = data[0]
            for i in range(1100):
                file[f"b/{i:04}"] = 1.0
            file["c"] = data
        self.reads(data)
        with h5py.File(self.path, "a") as file:
            file["d"] = data
        self.refuses(2, "several volumes", "/c [6, 5, 7] uint8", "/d [6, 5, 7] uint8", "more")

    def test_a_file_behind_a_user_block_is_read(self):
        data = RANDOM.integers(0, 30000, (6, 5, 7)).astype(np.int16)
        for options in ({}, {"chunks": (4, 4, 4), "compression": "gzip"}):
            with h5py.File(self.path, "w", userblock_size=512) as file:
                file.create_dataset("v", data=data, **options)
            with open(self.path, "r+b") as file:
                file.write(b"MATLAB 7.3 MAT-file")
            self.reads(data)

    def test_what_cannot_be_read_is_refused_with_the_reason(self):
        data = RANDOM.integers(0, 99, (6, 5, 7)).astype(np.uint8)
        with h5py.File(self.path, "w") as file:
            file.create_dataset("v", data=data, chunks=(6, 5, 7), compression="lzf")
        # An unknown filter: its number is 8 bytes before its name.
        stored = bytearray(self.path.read_bytes())
        at = stored.index(b"lzf\0")
        self.assertEqual(stored[at - 8:at - 6], (32000).to_bytes(2, "little"))
        stored[at - 8:at - 6] = (32999).to_bytes(2, "little")
        self.path.write_bytes(stored)
        self.refuses(5, "filter 32999 (lzf)", "plugin")
        with h5py.File(self.path, "w", libver="latest") as file:
            file["v"] = data
            file.swmr_mode = True
            file.flush()
            self.refuses(6, "another program", "h5clear")

    def test_a_wrong_checksum_of_a_chunk_is_found(self):
        data = RANDOM.integers(0, 99, (6, 5, 7)).astype(np.uint8)
        with h5py.File(self.path, "w") as file:
            v = file.create_dataset("v", data=data, chunks=(6, 5, 7), fletcher32=True)
            _, whole = v.id.read_direct_chunk((0, 0, 0))
            v.id.write_direct_chunk((0, 0, 0), bytes([whole[0] ^ 1]) + whole[1:])
        self.refuses(4, "checksum")


class PlaceOfInput(Input):
    def test_spacings_and_origins_that_cannot_be_are_refused_with_what_can(self):
        """For every format, whether the file or an option says so."""
        data = RANDOM.random((6, 7, 9)).astype(np.float32)

        def raw(spacing, origin):
            self.path = self.here / "v.raw"
            data.tofile(self.path)
            return ("--dims", "9,7,6", "--type", "float32", "--spacing", f"{spacing},1,1",
                    "--origin", f"{origin},0,0")

        def hdf5(spacing, origin):
            self.path = self.here / "v.h5"
            with h5py.File(self.path, "w") as file:
                file["v"] = data
                file["v"].attrs.update({"spacing": (float(spacing), 1, 1),
                                        "origin": (float(origin), 0, 0)})
            return ()

        def nrrd(spacing, origin):
            self.path = self.here / "v.nrrd"
            self.path.write_bytes((f"NRRD0005\ntype: float\ndimension: 3\nsizes: 9 7 6\n"
                                   f"endian: little\nencoding: raw\nspacings: {spacing} 1 1\n"
                                   f"space origin: ({origin},0,0)\n\n").encode() + data.tobytes())
            return ()

        for form in (raw, hdf5, nrrd):
            for spacing, origin, words in (
                    ("1e-300", "0", "spacings from 1e-30 to 1e+100"),
                    ("1e300", "0", "spacings from 1e-30 to 1e+100"),
                    ("1e-47", "0", "spacings from 1e-30 to 1e+100"),
                    ("1", "1e111", "coordinates from -1e+110 to 1e+110"),
                    ("1", "-1e300", "coordinates from -1e+110 to 1e+110"),
                    ("0.001", "1e9", "all 9 coordinates of x"),
                    ("1e-9", "-1", "all 9 coordinates of x")):
                with self.subTest(form=form.__name__, spacing=spacing, origin=origin):
                    options = form(spacing, origin)
                    self.refuses(2, self.path.name, words, "--spacing", options=options)
                    self.assertFalse((self.here / "s.isonest").exists())
            for spacing in ("1e-30", "1e100", "0.25"):
                with self.subTest(form=form.__name__, spacing=spacing):
                    self.reads(data, *form(spacing, "0"), "--indicators", "all")
                    self.lies([0, 0, 0], [float(spacing), 1, 1])
                    served.run([ISONEST, "check", self.here / "s.isonest"], check=True,
                               capture_output=True)
                    (self.here / "s.isonest").unlink()
        nrrd("0", "0")
        self.refuses(2, "spacing 0 1 1")
        nrrd("inf", "0")
        self.refuses(2, "spacing inf 1 1")


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
