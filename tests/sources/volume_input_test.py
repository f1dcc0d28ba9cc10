#!/usr/bin/env python3
"""Volumes in HDF5 and NRRD as other programs write them: the numbers, and their positions in the world.

usage: volume_input_test.py ISONEST PLUGIN_FOLDER
"""
import gzip
import itertools
import json
import os
import pathlib
import subprocess
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
        self.refuses(3, "parts/1.h5:v: is a virtual dataset", "0.h5:v", "fill value")

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


class NrrdInput(Input):
    def setUp(self):
        super().setUp()
        self.path = self.here / "v.nrrd"
        self.data = RANDOM.integers(0, 30000, (6, 7, 9)).astype(np.int16)

    def write(self, *lines, data=None, encoding="raw", sizes=None):
        data = self.data if data is None else data
        sizes = sizes or data.shape[::-1]
        header = ["NRRD0005", "type: int16", f"dimension: {len(sizes)}",
                  "sizes: " + " ".join(map(str, sizes)), f"encoding: {encoding}", "endian: little",
                  *lines]
        numbers = data.astype("<i2").tobytes()
        self.path.write_bytes(("\n".join(header) + "\n\n").encode() +
                              (gzip.compress(numbers) if encoding == "gzip" else numbers))

    def test_an_axis_that_runs_backward_is_turned_around(self):
        """World positions are preserved: node i of an axis with step d is at o + i d."""
        for signs in itertools.product((1, -1), repeat=3):
            step = np.array([2, 0.5, 3]) * signs
            origin = np.array([10, 20, 30])
            vectors = " ".join(f"({','.join(map(str, row))})" for row in np.diag(step))
            turned = self.data[tuple(slice(None, None, s) for s in signs[::-1])]
            low = [o + min(0, d * (n - 1)) for o, d, n in zip(origin, step, (9, 7, 6))]
            for lines in ((f"space directions: {vectors}", "space origin: (10,20,30)"),
                          (f"spacings: {' '.join(map(str, step))}", "space origin: (10,20,30)")):
                for encoding in ("raw", "gzip"):
                    with self.subTest(lines=lines, encoding=encoding):
                        self.write(*lines, encoding=encoding)
                        if encoding == "gzip" and signs[2] < 0:
                            self.refuses(5, "z axis runs backward", "encoding: raw")
                            continue
                        self.reads(turned)
                        self.lies(low, abs(step))

    def test_a_backward_axis_is_turned_in_space_on_disk_too(self):
        data = RANDOM.integers(0, 30000, (30, 500, 500)).astype(np.int16)
        for encoding, z in (("raw", -1), ("gzip", 1)):
            with self.subTest(encoding=encoding):
                self.write(f"spacings: -1 -1 {z}", data=data, encoding=encoding)
                turned = data[::z, ::-1, ::-1]
                done = self.reads(turned, "--memory", "18M", "--threads", "1", "--json")
                self.assertTrue(json.loads(done.stdout)["input_on_disk"])

    def test_missing_values_and_check_see_the_turned_volume(self):
        self.data[2, 3, 4] = -5
        self.write("spacings: 1 -1 -1")
        turned = self.data[::-1, ::-1].astype(np.float32)
        turned[turned == -5] = np.nan
        self.reads(turned, "--missing", "-5")
        done = served.run([ISONEST, "check", self.here / "s.isonest", "--source", self.path,
                           "--missing", "-5"], capture_output=True, text=True)
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)

    def test_axes_without_a_direction_are_not_the_volumes(self):
        vectors = "none (2,0,0) (0,-0.5,0) (0,0,3)"
        self.write(f"space directions: {vectors}", "space origin: (10,20,30)", sizes=(1, 9, 7, 6))
        self.reads(self.data[:, ::-1])
        self.lies([10, 17, 30], [2, 0.5, 3])
        self.write("spacings: nan 2 0.5 3", sizes=(1, 9, 7, 6))
        self.reads(self.data)
        self.lies([0, 0, 0], [2, 0.5, 3])

    def test_samples_lie_between_the_ends_of_their_axes(self):
        ends = ("axis mins: 10 20 30", "axis maxs: 28 16.5 48")
        for centers, low, step in ((None, (11, 16.75, 31.5), (2, 0.5, 3)),
                                   ("cell cell ???", (11, 16.75, 31.5), (2, 0.5, 3)),
                                   ("node node node", (10, 16.5, 30), (18 / 8, 3.5 / 6, 18 / 5)),
                                   ("cell node cell", (11, 16.5, 31.5), (2, 3.5 / 6, 3))):
            with self.subTest(centers=centers):
                self.write(*ends, *([] if centers is None else [f"centers: {centers}"]))
                self.reads(self.data[:, ::-1])
                self.lies(low, step)
        self.write("axis mins: 10 nan 30", "spacings: 2 0.5 nan", "centerings: node node node")
        self.reads(self.data)
        self.lies([10, 0, 30], [2, 0.5, 1])
        self.write("axis mins: 10 20 30", "space origin: (1,2,3)", "spacings: 2 0.5 3")
        self.reads(self.data)
        self.lies([1, 2, 3], [2, 0.5, 3])
        for line in ("axis mins: 1 2", "axis maxs: 1 2 3 4"):
            self.write("axis mins: 1 2 3" if "maxs" in line else "spacings: 1 1 1", line)
            self.refuses(4, line.split(":")[0])

    def test_a_picture_in_space_has_the_spacing_of_its_two_axes(self):
        self.write("space directions: (2,0,0) (0,3,0)", "space origin: (10,20,30)",
                   data=self.data[0])
        self.reads(self.data[:1])
        self.lies([10, 20, 30], [2, 3, 1])

    def test_oblique_axes_are_kept_or_ignored(self):
        for vectors, turned in (("(0,1,0) (0,0,1) (1,0,0)", 1), ("(0,1,0) (1,0,0) (0,0,1)", -1),
                                ("(0.7,0.7,0) (-0.7,0.7,0) (0,0,1)", 1)):
            with self.subTest(vectors=vectors):
                self.write(f"space directions: {vectors}")
                self.reads(self.data[:, :, ::turned])
                self.reads(self.data, "--spacing", "1,2,3")
                self.lies([0, 0, 0], [1, 2, 3])
        for vectors, code, word in (("(1,0,0) (0,0,0) (0,0,1)", 4, "step"), ("(1,0,0) (0,nan,0) (0,0,1)", 4, "step"),
                                    ("(1,0,0) (1,1e-5,0) (0,0,1)", 5, "nearly in one plane")):
            with self.subTest(vectors=vectors):
                self.write(f"space directions: {vectors}")
                self.refuses(code, word, "--spacing")
                self.reads(self.data, "--spacing", "1,2,3")
                self.lies([0, 0, 0], [1, 2, 3])
        self.write("space directions: (1,0,0) (0,1,0)")
        self.refuses(4, "'space directions' and 'sizes' do not agree")
        self.write("spacings: 1 2")
        self.refuses(4, "'spacings' and 'sizes' do not agree")
        vectors = "(0.7,0.7,0) (-0.7,0.7,0) (0,0,1)"
        self.write(f"space directions: {vectors}", "space origin: (10,20,30)")
        self.reads(self.data, "--spacing", "1,2,3")
        self.lies([10, 20, 30], [1, 2, 3])
        self.reads(self.data, "--spacing", "1,2,3", "--origin", "4,5,6")
        self.lies([4, 5, 6], [1, 2, 3])

    def test_directions_are_aligned_if_they_lead_less_than_a_tenth_of_a_voxel_astray(self):
        """Over 9 x 7 x 6 nodes; a voxel is 2 x 0.5 x 3."""
        def vectors(tilt):
            return f"(2,{tilt},0) (0,0.5,0) (0,0,3)"
        self.write(f"space directions: {vectors(0.049 / 8)}")
        self.reads(self.data)
        straight = self.directions()
        self.write(f"space directions: {vectors(0.051 / 8)}")
        self.reads(self.data)
        self.assertNotEqual(self.directions(), straight)
        self.write("space directions: (2,0.003,0) (0,0.5,0) (0,0.0053,3)")
        self.reads(self.data)
        self.assertNotEqual(self.directions(), straight)
        for sheared in ("(2,0,0.05) (0,0.5,0) (0,0,3)", "(2,0,0) (0.05,0.5,0) (0,0,3)"):
            self.write(f"space directions: {sheared}")
            self.reads(self.data)
            self.assertTrue(self.info()["sheared"])
        self.write("space directions: (2,0,0.1) (0,0.5,0)", data=self.data[0])
        self.reads(self.data[:1])
        self.assertNotEqual(self.directions(), straight)

    def test_another_spacing_leaves_the_first_sample_where_it_is(self):
        """For a reversed axis that is the position of the last node."""
        self.write("space directions: (-2,0,0) (0,0.5,0) (0,0,3)", "space origin: (10,20,30)")
        self.reads(self.data[:, :, ::-1], "--spacing", "1,2,3")
        self.lies([10 - 8 * 1, 20, 30], [1, 2, 3])
        self.write("axis mins: 10 20 30", "axis maxs: -8 23.5 48")
        self.reads(self.data[:, :, ::-1], "--spacing", "1,2,4")
        self.lies([10 - 0.5 - 8, 21, 32], [1, 2, 4])

    def test_skips_are_honoured_in_any_order(self):
        """Lines of the file, then bytes of the data decompressed from there."""
        numbers = self.data.tobytes()
        for encoding, detached, lines, skip, first in itertools.product(
                ("raw", "gzip"), (False, True), (0, 1, 3), (0, 100, -1), ("line", "byte")):
            fields = [f"line skip: {lines}", f"byte skip: {skip}"][::1 if first == "line" else -1]
            front = b"some text\n\n\x1f\x8b\x08\n"[:(0, 10, 0, 15)[lines]] + b""
            body = b"x\n" * 50 * (skip != 0) + numbers
            stored = front + (gzip.compress(body) if encoding == "gzip" else body)
            header = "\n".join(["NRRD0005", "type: int16", "dimension: 3", "sizes: 9 7 6",
                                f"encoding: {encoding}", "endian: little", *fields])
            with self.subTest(encoding=encoding, detached=detached, fields=fields):
                if detached:
                    (self.here / "v.data").write_bytes(stored)
                    self.path.write_text(header + "\ndata file: v.data\n")
                else:
                    self.path.write_bytes(header.encode() + b"\n\n" + stored)
                if encoding == "gzip" and skip == -1:
                    self.refuses(5, "byte skip: -1", *(["v.data: ", f"{self.path})"] if detached else []))
                else:
                    self.reads(self.data)
        for field, code in (("line skip: 1000000", 4), ("line skip: -1", 4), ("byte skip: -2", 4),
                            ("byte skip: 1e3", 4), ("byte skip: 1", 2),
                            (f"byte skip: {2**63 - 1}", 2), (f"byte skip: {2**63}", 4)):
            self.write(field)
            self.refuses(code)
        self.write("byte skip: -1", sizes=(9, 7, 7))  # would start in the header
        self.refuses(2, "bytes")

    def test_the_encoding_and_the_bytes_must_agree(self):
        noise = RANDOM.integers(-2**15, 2**15, self.data.shape).astype(np.int16)
        self.write(encoding="gzip", data=noise)
        whole = self.path.read_bytes()
        start = whole.index(b"\n\n") + 2
        for at in range(3):
            damaged = bytearray(whole)
            damaged[start + at] ^= 4
            self.path.write_bytes(damaged)
            self.refuses(4, "gzip")
        self.path.write_bytes(whole.replace(b"encoding: gzip", b"encoding: raw"))
        self.refuses(4, "encoding raw")
        noise.ravel()[:2] = -29921, 8  # like the start of gzip: 1F 8B 08 00
        self.write(data=noise)
        self.reads(noise)

    def test_axes_that_are_no_places_are_named(self):
        colour = ("kinds: RGB-color domain domain", "kinds: domain space 3-vector",
                  "kinds: domain list domain", "kinds: ??? none covariant-vector")
        for lines, (name, axis) in zip(colour, (("c", 0), ("c", 2), ("list", 1), ("c", 2))):
            for sizes in ((9, 7, 6), (9, 7, 6, 1)):
                self.write(lines + (" stub" if len(sizes) > 3 else ""), sizes=sizes)
                self.refuses(5, f"{sizes[axis]} volumes along axis '{name}'", f"--index {name}=0")
                self.reads(np.ascontiguousarray(np.take(self.data, 3, 2 - axis)), "--index", f"{name}=3")
        for lines in ("kinds: space DOMAIN time", "kinds: ??? none domain"):
            self.write(lines)
            self.reads(self.data)
        self.write("kinds: scalar domain domain domain", sizes=(1, 9, 7, 6))
        self.reads(self.data)
        self.write("kinds: domain domain")
        self.refuses(4, "'kinds' and 'sizes' do not agree")

    def test_numbers_that_are_none_or_out_of_range_are_refused(self):
        for line in ("spacings: 1e400 1 1", "spacings: 1e-400 1 1", "spacings: 1,1,1",
                     "spacings: 1 2 3mm", "spacings: 1 - 1", "space origin: (1,2,x)",
                     "space origin: 1 2 3", "space directions: (1,0,0) (0,1e999,0) (0,0,1)",
                     "space directions: (1,0,0) (0,1) (0,0,1)", "space directions: (1 0 0) none none",
                     "axis mins: 0 0 0x", "byte skip: 0.5", "byte skip: 1e400", "byte skip: 1 2",
                     "byte skip: "):
            with self.subTest(line=line):
                self.write(line)
                self.refuses(4, line.split(":")[0])
        for sizes in ("9 7 6.5", "9 7 6e400", "9 7 -6", "9 7 0", "9x7x6", "9 7 99999999999999999999"):
            with self.subTest(sizes=sizes):
                self.write()
                self.path.write_bytes(self.path.read_bytes().replace(b"9 7 6", sizes.encode()))
                self.refuses(4, "'sizes'")
        self.write("spacings: +1 2e0 NaN")
        self.reads(self.data)
        self.lies([0, 0, 0], [1, 2, 1])

    def test_a_carriage_return_in_the_middle_of_a_line_is_refused(self):
        for line in ("byte skip:=4\rbyte skip: 0", "# a comment\rbyte skip: 0"):
            with self.subTest(line=line):
                self.write(line)
                self.refuses(4, "carriage return")

    def test_fields_that_come_twice_or_are_not_known_are_refused(self):
        for lines, words in ((("byte skip: 0", "byte skip: 0"), ("'byte skip' comes twice", "line 8")),
                             (("byteskip: 0", "Byte Skip: 0"), ("duplicate field",)),
                             (("centers: cell cell cell", "centerings: node node node"), ("duplicate field",)),
                             (("type: int16",), ("'type' comes twice",)),
                             (("bytes skip: 8",), ("line 7", "'bytes skip: 8'")),
                             (("byte skip:8",), ("line 7",)), (("so be it",), ("line 7",)),
                             (("  ",), ("line 7",)),
                             (("spacings: 1 1 1", "space directions: (1,0,0) (0,1,0) (0,0,1)"),
                              ("both 'spacings' and 'space directions'",))):
            with self.subTest(lines=lines):
                self.write(*lines)
                self.refuses(4, *words)
        self.write("# byte skip: 4", "byte skip:=4", "byte skip:=8", "key:=sizes: 1 1 1", "units: ",
                   "labels: \"a: b\" \"\" \"\"")
        self.reads(self.data)

    def test_a_header_ends_with_an_empty_line(self):
        self.write()
        whole = self.path.read_bytes()
        head, numbers = whole.split(b"\n\n", 1)
        for end in (b"\n", b"\r\n"):
            self.path.write_bytes(head.replace(b"\n", end) + end + end + numbers)
            self.reads(self.data)
        self.path.write_bytes(head + b"\n" + b"# x\n" * 40000 + b"\n" + numbers)
        self.reads(self.data)
        self.path.write_bytes(head + b"\n" + b"# x\n" * (1 << 20) + b"\n" + numbers)
        self.refuses(5, "empty line")
        self.path.write_bytes(head + b"\n# " + numbers.translate(None, b"\r\n"))
        self.refuses(4, "empty line")
        self.path.write_bytes(whole.replace(b"NRRD0005", b"NRRD0006"))
        self.refuses(5, "NRRD0006")

    def test_options_that_do_not_go_with_the_format_are_errors(self):
        raw_only = (("--dims", "9,7,6"), ("--type", "int16"), ("--endian", "little"), ("--offset", "0"))
        self.write()
        for option in (*raw_only, ("--dataset", "v")):
            self.refuses(2, option[0], "NRRD", options=option)
        self.path = self.here / "v.h5"
        with h5py.File(self.path, "w") as file:
            file["v"] = self.data
        for option in raw_only:
            self.refuses(2, option[0], "HDF5", options=option)
        self.path = self.here / "v.raw"
        self.data.tofile(self.path)
        self.refuses(2, "--dataset", "raw",
                     options=("--dims", "9,7,6", "--type", "int16", "--dataset", "v"))


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


class GzipInput(Input):
    """Like gzip(1), except that input about which it warns is refused."""

    def setUp(self):
        super().setUp()
        self.data = RANDOM.integers(0, 30000, (6, 7, 9)).astype(np.int16)
        self.numbers = self.data.tobytes()

    def each(self, stored):
        """As raw numbers, and after and next to NRRD headers."""
        header = (b"NRRD0005\ntype: int16\ndimension: 3\nsizes: 9 7 6\nendian: little\n"
                  b"encoding: gzip\n")
        self.path = self.here / "v.raw.gz"
        self.path.write_bytes(stored)
        yield ("--dims", "9,7,6", "--type", "int16")
        self.path = self.here / "v.nhdr"
        self.path.write_bytes(header + b"data file: v.raw.gz\n")
        yield ()
        self.path = self.here / "v.nrrd"
        self.path.write_bytes(header + b"\n" + stored)
        yield ()

    def gzip_says(self, stored):
        """Runs gzip(1): the exit status, and the output."""
        done = subprocess.run(["gzip", "-dc"], input=stored, capture_output=True)
        return done.returncode, done.stdout

    def test_a_cut_trailer_is_refused(self):
        whole = gzip.compress(self.numbers)
        for cut in (*range(1, 10), 100):
            self.assertEqual(self.gzip_says(whole[:-cut])[0], 1)
            for options in self.each(whole[:-cut]):
                with self.subTest(cut=cut, path=self.path.name):
                    self.refuses(4, "gzip", "cut short", options=options)

    def test_a_wrong_checksum_or_length_is_refused(self):
        for at in range(-8, 0):
            damaged = bytearray(gzip.compress(self.numbers))
            damaged[at] ^= 1
            self.assertEqual(self.gzip_says(bytes(damaged))[0], 1)
            for options in self.each(bytes(damaged)):
                with self.subTest(at=at, path=self.path.name):
                    self.refuses(4, "gzip", options=options)

    def test_several_members_are_one_stream(self):
        parts = [gzip.compress(self.numbers[i:i + 97]) for i in range(0, len(self.numbers), 97)]
        empty = gzip.compress(b"")
        for stored in (b"".join(parts), empty + b"".join(parts) + empty, empty.join(parts)):
            self.assertEqual(self.gzip_says(stored), (0, self.numbers))
            for options in self.each(stored):
                self.reads(self.data, *options)
            for options in self.each(stored[:-1]):
                self.refuses(4, "cut short", options=options)

    def test_zeros_may_follow_and_nothing_else(self):
        whole = gzip.compress(self.numbers)
        for behind in (b"\0", bytes(512), bytes(300000)):
            self.assertEqual(self.gzip_says(whole + behind), (0, self.numbers))
            for options in self.each(whole + behind):
                self.reads(self.data, *options)
        for behind in (b"x", bytes(512) + b"x", b"\x1f", b"\x1f\x8b", whole[:1], bytes(3) + whole):
            self.assertNotEqual(self.gzip_says(whole + behind)[0], 0)
            for options in self.each(whole + behind):
                with self.subTest(behind=behind[:4], path=self.path.name):
                    self.refuses(4, "gzip", options=options)

    def test_bytes_behind_the_data_are_read_for_the_checksum(self):
        stored = gzip.compress(self.numbers + bytes(RANDOM.integers(0, 256, 5000, np.uint8)))
        for options in self.each(stored):
            if options:
                self.refuses(2, "more than the", options=options)
            else:
                self.reads(self.data)
        for options in self.each(stored[:-1]):
            self.refuses(4, "cut short", options=options)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
