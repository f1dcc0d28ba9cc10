#!/usr/bin/env python3
"""Zarr arrays as written by the zarr package (version 2), and version 3 by its specification.

usage: zarr_input_test.py ISONEST PLUGIN_FOLDER
"""
import base64
import itertools
import json
import lzma
import pathlib
import resource
import shutil
import struct
import subprocess
import sys
import unittest
import zipfile

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served  # noqa: E402

try:
    import h5py
    import numcodecs
    import numpy as np
    from sanitized import is_sanitized
    from zarr_two import zarr
    from volume_inputs import ISONEST, RANDOM, TYPES, Input, is_read_as, numbers
    from zarr_writer import V3
except ImportError as error:
    print(f"skipped: {error}")
    sys.exit(77)


class Zarr(Input):
    def setUp(self):
        super().setUp()
        self.path = self.here / "v.zarr"

    def fresh(self):
        shutil.rmtree(self.path, ignore_errors=True)
        return self.path

    def test_types_orders_and_separators(self):
        # Every pair of a type, an order of bytes, an order of axes and a separator, in a quarter of the combinations.
        for i, (kind, ends) in enumerate(itertools.product((*TYPES, "i8", "u8", "f2", "b1"), "<>")):
            order, separator = "CF"[(i + i // 2) % 2], "./"[(i + i // 4) % 2]
            with self.subTest(kind=kind, ends=ends, order=order, separator=separator):
                data = numbers((13, 17, 19), "u1") > 99 if kind == "b1" else numbers((13, 17, 19), kind)
                a = zarr.open(str(self.fresh()), mode="w", shape=data.shape, chunks=(5, 8, 7), order=order,
                              dtype=np.dtype(kind).newbyteorder(ends), dimension_separator=separator)
                a[:] = data
                self.reads(is_read_as(data.astype("u1") if kind == "b1" else data))

    def test_compressors(self):
        data = np.cumsum(numbers((13, 17, 19)) % 5, axis=2).astype("i2")
        for codec in (None, numcodecs.Zlib(3), numcodecs.GZip(3), numcodecs.Zstd(3),
                      *(numcodecs.Blosc(c, 5, s) for c in ("lz4", "lz4hc", "blosclz", "zstd", "zlib") for s in (0, 1, 2))):
            with self.subTest(codec=codec):
                zarr.save_array(str(self.fresh()), data, chunks=(5, 8, 7), compressor=codec)
                self.reads(data)
        for codec in (numcodecs.LZ4(), numcodecs.BZ2(5), numcodecs.LZMA(), numcodecs.LZMA(format=2)):
            with self.subTest(codec=codec):
                zarr.save_array(str(self.fresh()), data, chunks=(5, 8, 7), compressor=codec)
                self.reads(data)
        zarr.save_array(str(self.fresh()), data, filters=[numcodecs.Base64()])
        self.refuses(5, "codec 'base64'", "lz4")

    def test_lzma_takes_no_more_memory_than_its_chunks(self):
        """Whatever dictionary size a header asks for, a chunk refers only to its own bytes."""
        if is_sanitized(ISONEST):
            self.skipTest("built with a sanitizer, which takes more memory")
        data = np.cumsum(numbers((33, 34, 35)) % 5, axis=2).astype("i2")
        # With this match finder the writer does not clear a table as large as the dictionary, which takes half a second.
        asks = {"preset": 9, "dict_size": 1 << 30, "mf": lzma.MF_BT2}
        large = [{"id": lzma.FILTER_LZMA2, **asks}]
        alone = [{"id": lzma.FILTER_LZMA1, **asks}]
        delta = [{"id": lzma.FILTER_DELTA, "dist": 2}, {"id": lzma.FILTER_LZMA2, "preset": 1}]

        def limited():
            """Like Input.preprocess(), with less memory for data than the dictionaries would take."""
            limit = lambda: resource.setrlimit(resource.RLIMIT_DATA, (300 << 20, 300 << 20))  # noqa: E731
            return subprocess.run([ISONEST, "preprocess", self.path, "-o", self.here / "s.isonest", "--chunk", "8", "--force", "--threads", "1",
                                   "--memory", "32M"], capture_output=True, text=True, preexec_fn=limit)

        for options in ({"filters": large}, {"filters": large, "check": lzma.CHECK_NONE}, {"filters": large, "check": lzma.CHECK_SHA256},
                        {"filters": alone, "format": lzma.FORMAT_ALONE}, {"filters": delta}, {"preset": 0}):
            with self.subTest(options=options):
                codec = numcodecs.LZMA(**{"check": -1, "preset": None, **options})
                zarr.save_array(str(self.fresh()), data, chunks=(16, 16, 16), compressor=codec)
                self.assertEqual(limited().returncode, 0, limited().stderr)
                self.reads(data)

    def test_lzma_that_is_damaged_or_has_several_blocks(self):
        blob = bytes(lzma.compress(np.zeros(4096, "i2").tobytes(), preset=9))
        zarr.save_array(str(self.fresh()), np.ones((16, 16, 16), "i2"), chunks=(16, 16, 16), compressor=numcodecs.LZMA())
        for at in range(1, len(blob), 3):
            for bad in (blob[:at], blob[:at] + bytes([blob[at] ^ 0x55]) + blob[at + 1:]):
                (self.path / "0.0.0").write_bytes(bad)
                done = self.preprocess()
                self.assertEqual(done.returncode, 4, (at, done.stderr))
        (self.path / "0.0.0").write_bytes(blob + b"behind")
        self.reads(np.zeros((16, 16, 16), "i2"))
        several = np.arange(4096, dtype="i2").reshape(16, 16, 16)
        done = subprocess.run(["xz", "--block-size=3000", "--check=crc32", "--stdout"], input=several.tobytes(), capture_output=True, check=True)
        (self.path / "0.0.0").write_bytes(done.stdout)
        self.reads(several)

    def test_filters(self):
        """Compared with zarr and numcodecs, whose numbers are those that are read, also if they are rounded."""
        F = numcodecs
        for kind, filters in (
                ("i2", [F.Delta("i2")]), ("u1", [F.Delta("u1")]), ("i4", [F.Delta("i4", "i2")]), ("u2", [F.Delta("u2", "i4")]),
                ("i8", [F.Delta("i8")]), ("f4", [F.Delta("f4")]), ("f8", [F.Delta("f8", "f4")]), (">i4", [F.Delta(">i4", "<i2")]),
                (">f8", [F.Delta(">f8")]), ("i4", [F.Shuffle(4)]), ("f8", [F.Shuffle(8), F.CRC32()]), ("i2", [F.Adler32()]),
                ("i4", [F.Delta("i4"), F.Shuffle(4), F.CRC32(), F.Adler32()]), ("i2", [F.Shuffle(0)]),
                ("f4", [F.FixedScaleOffset(1000, 10, "f4", "u2")]), ("f8", [F.FixedScaleOffset(-3.5, 0.25, "f8", "i4")]),
                ("f4", [F.FixedScaleOffset(2, 8, "f4", "f4")]), ("f4", [F.Quantize(2, "f4")]), ("f8", [F.BitRound(12)]),
                ("i4", [F.FixedScaleOffset(7, 1, "i4", "i2")])):
            for compressor, order in ((None, "C"), (F.Zlib(), "F"), (F.LZ4(), "C")):
                if order == "F" and filters[0].codec_id == "bitround" and zarr.__version__ >= "3":
                    continue  # zarr 3.0.6 writes such a chunk in the other order
                with self.subTest(kind=kind, filters=filters, compressor=compressor, order=order):
                    data = np.round(np.cumsum(RANDOM.normal(size=(9, 10, 11)), axis=2) * 9 + 60).clip(0, 255).astype(kind)
                    if np.dtype(kind).kind == "f":
                        data += RANDOM.normal(size=data.shape).astype(kind) / 8
                    zarr.save_array(str(self.fresh()), data, chunks=(5, 8, 7), compressor=compressor, filters=filters, order=order)
                    if filters[0].codec_id == "bitround":  # zarr 3 writes it but cannot read it
                        expected = filters[0].encode(data.copy()).view(kind).reshape(data.shape)
                    else:
                        expected = zarr.open(str(self.path))[:]
                    self.reads(is_read_as(expected))

    def test_sums_of_integers_wrap_around(self):
        for kind, stored in (("i1", "i1"), ("u2", "u2"), ("i8", "i8"), ("i4", "i2")):
            data = numbers((5, 6, 7), kind)
            data.flat[0] = 5  # NumPy 2 rejects numbers that do not fit into the type
            zarr.save_array(str(self.fresh()), data, filters=[numcodecs.Delta(kind, stored)])
            self.reads(is_read_as(zarr.open(str(self.path))[:]))

    def test_filters_that_cannot_be(self):
        zarr.save_array(str(self.fresh()), numbers((5, 6, 7)), compressor=None, filters=[numcodecs.Delta("i2")])
        description = json.loads((self.path / ".zarray").read_text())
        for code, filters in ((5, [{"id": "delta"}]), (5, [{"id": "delta", "dtype": "<i3"}]), (5, [{"id": "delta", "dtype": "<i2", "astype": "<f4"}]),
                              (4, [{"id": "shuffle", "elementsize": 10**9}]), (4, [{"id": "fixedscaleoffset", "dtype": "<i2", "scale": 0, "offset": 0}]),
                              (4, [{"id": "delta", "dtype": "<i2", "astype": "<i4"}]), (4, [{"id": "delta", "dtype": "<i8", "astype": "|i1"}] * 9),
                              (4, {"id": "delta"}), (4, [{"id": "delta", "dtype": "<i2"}] * 99), (4, [{"id": "crc32"}]), (5, [None]),
                              (5, [{"id": "quantize", "dtype": "<f4", "astype": "<f8"}]), (4, [{"id": "lz4"}]), (4, [{"id": "lzma"}]), (4, [{"id": "bz2"}]),
                              (5, [{"id": "lz4"}, {"id": "bz2"}]), (5, [{"id": "lzma", "format": 3}])):
            with self.subTest(filters=filters):
                (self.path / ".zarray").write_text(json.dumps({**description, "filters": filters}))
                self.refuses(code)

    def test_codecs_of_numcodecs_in_version_3(self):
        data = numbers((9, 10, 11), "i4")
        for before, after in ((["delta"], []), ([], ["lz4"]), ([], ["bz2"]), ([], ["lzma"]), (["delta"], ["shuffle", "lz4"]), ([], ["zlib"])):
            for big in (False, True):
                with self.subTest(before=before, after=after, big=big):
                    made = {"shuffle": numcodecs.Shuffle(4), "lz4": numcodecs.LZ4(), "bz2": numcodecs.BZ2(), "lzma": numcodecs.LZMA(),
                            "zlib": numcodecs.Zlib()}
                    self.fresh().mkdir()
                    array = numcodecs.Delta("i4").encode(data.ravel()) if before else data.ravel()
                    blob = array.astype(">i4" if big else "<i4").tobytes()
                    for name in after:
                        blob = bytes(made[name].encode(blob))
                    (self.path / "c/0/0").mkdir(parents=True)
                    (self.path / "c/0/0/0").write_bytes(blob)
                    (self.path / "zarr.json").write_text(json.dumps({
                        "zarr_format": 3, "node_type": "array", "shape": data.shape, "data_type": "int32", "fill_value": 0,
                        "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": data.shape}},
                        "chunk_key_encoding": {"name": "default"}, "codecs": [
                            *({"name": f"numcodecs.{n}", "configuration": {"dtype": "int32"}} for n in before),
                            {"name": "bytes", "configuration": {"endian": "big" if big else "little"}},
                            *({"name": f"numcodecs.{n}", "configuration": {"elementsize": 4}} for n in after)]}))
                    self.reads(data)

    def archive(self, folder=None, method=zipfile.ZIP_STORED):
        """Replaces `path` by a ZIP archive of it, possibly below a folder of the archive."""
        made = self.here / "v.zip"
        with zipfile.ZipFile(made, "w", method) as file:
            for one in sorted(p for p in self.path.rglob("*") if p.is_file()):
                file.write(one, pathlib.PurePosixPath(folder or "") / one.relative_to(self.path))
        self.path = made

    def test_zipped_stores(self):
        data = numbers((13, 17, 19), "f4")
        store = zarr.ZipStore(str(self.here / "z.zip"), mode="w")
        zarr.save_array(store, data, chunks=(5, 8, 7))
        store.close()
        self.path = self.here / "z.zip"
        self.reads(data)
        original = self.here / "v.zarr"
        for shards, folder, method in itertools.product((None, (8, 12, 16)), (None, "v.zarr"), (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)):
            with self.subTest(shards=shards, folder=folder, method=method):
                shutil.rmtree(original, ignore_errors=True)
                V3(original, data, (4, 4, 8), codecs=("zstd",), shards=shards)
                self.path = original
                self.archive(folder, method)
                if shards and method == zipfile.ZIP_DEFLATED:
                    self.refuses(5, "zip -0")
                else:
                    self.reads(data)

    def test_groups_and_images_in_an_archive(self):
        for version in ("0.4", "0.5"):
            data, small = self.ome(version)
            self.archive("image.zarr", zipfile.ZIP_DEFLATED)
            self.reads(data[1, 2], "--index", "t=1,c=2")
            self.lies([10, 20, 30], [0.25, 0.5, 2])
            self.reads(small[1, 2], "--index", "t=1,c=2", "--dataset", "1")
            self.refuses(3, "there is no array", options=("--dataset", "7"))
            self.refuses(3, options=("--dataset", "../0"))
            self.path = self.here / "v.zarr"

    def test_damaged_archives(self):
        V3(self.fresh(), np.zeros((9, 10, 11), "i2"), (4, 4, 8))
        self.archive(method=zipfile.ZIP_DEFLATED)
        whole = self.path.read_bytes()
        for i in range(80):
            data = bytearray(whole)
            for _ in range(RANDOM.integers(1, 4)):
                data[RANDOM.integers(len(data))] = RANDOM.integers(256)
            if i % 4 == 0:
                del data[RANDOM.integers(len(data)):]
            self.path.write_bytes(data)
            done = self.preprocess("--memory", "256M")
            self.assertIn(done.returncode, (0, 2, 3, 4, 5, 6, 7), (i, done.stderr))
            if i % 4 == 0:
                self.assertNotEqual(done.returncode, 0)
        # The checksum of a chunk that is stored without compression.
        self.path = self.here / "v.zarr"
        V3(self.fresh(), numbers((9, 10, 11)), (9, 10, 11))
        self.archive()
        data = bytearray(self.path.read_bytes())
        data[data.index(b"c/0/0/0") + 100] ^= 1
        self.path.write_bytes(data)
        self.refuses(4, "checksum")

    def test_a_chunk_that_is_a_link_to_nothing_is_not_missing(self):
        for version in (2, 3):
            with self.subTest(version=version):
                data = numbers((7, 8, 9), "u1")
                if version == 2:
                    zarr.save_array(str(self.fresh()), data, chunks=(4, 4, 9), compressor=None)
                    chunk = self.path / "1.0.0"
                else:
                    V3(self.fresh(), data, (2, 4, 9), shards=(4, 4, 9))
                    chunk = self.path / "c/1/0/0"
                self.reads(data)
                chunk.unlink()
                chunk.symlink_to(self.here / "nothing")
                self.refuses(3, str(chunk), "No such file")

    def test_chunks_that_are_missing_have_the_fill_value(self):
        for kind, fill in (("i2", -7), ("f4", np.nan), ("f8", np.inf), ("u1", 255), ("f4", None), ("i8", 2**50), ("f2", 0)):
            data = np.full((13, 17, 19), 0 if fill is None else fill, kind)
            data[:5, 8:16, 7:14] = numbers((5, 8, 7), "u1")
            a = zarr.open(str(self.fresh()), mode="w", shape=data.shape, chunks=(5, 8, 7), dtype=kind, fill_value=fill)
            a[:5, 8:16, 7:14] = data[:5, 8:16, 7:14]
            self.assertEqual(len([p for p in self.path.iterdir() if p.name[0].isdigit()]), 1)
            self.reads(is_read_as(data))

    def test_half_floats_of_chunks_that_are_missing(self):
        for fill in (1.5, -1.5, 6.103515625e-05, 5.9604644775390625e-08, 1000 / 1024 * 2**-14, 65504.0, -0.0, np.inf, -np.inf, np.nan):
            with self.subTest(fill=fill):
                data = np.full((13, 17, 19), fill, "f2")
                data[:5, 8:16, 7:14] = numbers((5, 8, 7), "f2")
                a = zarr.open(str(self.fresh()), mode="w", shape=data.shape, chunks=(5, 8, 7), dtype="f2", fill_value=fill)
                a[:5, 8:16, 7:14] = data[:5, 8:16, 7:14]
                self.reads(data.astype("f4"))
        description = json.loads((self.path / ".zarray").read_text())
        for fill in (0.1, 1 + 2**-11, 1 + 3 * 2**-11, 65519.0, 65520.0, 1e300, 2**-25, 3 * 2**-26, 2047.5 * 2**-10):
            (self.path / ".zarray").write_text(json.dumps({**description, "fill_value": fill}))
            with np.errstate(over="ignore"):
                data[-1] = np.float16(fill)
            self.assertTrue(np.array_equal(zarr.open(str(self.path))[-1], data[-1]))
            self.reads(data[-1].astype("f4"), "--crop", ":,:,12:")

    def test_several_checksums(self):
        data = numbers((9, 10, 11))
        for codecs in (("crc32c", "crc32c"), ("zstd", "crc32c", "crc32c"), ("crc32c", "gzip", "crc32c"), ("blosc", "crc32c", "crc32c", "crc32c")):
            with self.subTest(codecs=codecs):
                V3(self.fresh(), data, (4, 4, 8), codecs=codecs)
                self.reads(data)
        V3(self.fresh(), data, (4, 4, 8), codecs=("zstd", "gzip"))
        self.refuses(5, "compressed twice")

    def test_version_3(self):
        data = numbers((13, 17, 19))
        data[:8, :8] = 0  # chunks that are not stored
        for options in ({}, {"codecs": ("gzip",)}, {"codecs": ("zstd", "crc32c")}, {"codecs": ("blosc",)},
                        {"codecs": ("crc32c",)}, {"order": (2, 0, 1)}, {"order": (2, 1, 0), "codecs": ("zstd",)},
                        {"big": True}, {"separator": "."}, {"encoding": "v2", "separator": "."}):
            with self.subTest(options=options):
                V3(self.fresh(), data, (4, 4, 8), **options)
                self.reads(data)

    def test_shards(self):
        data = numbers((13, 17, 19), "f4")
        data[:8, :8] = 0
        for options in ({}, {"index_at": "start"}, {"index_checksum": False}, {"codecs": ("zstd",)},
                        {"codecs": ("blosc", "crc32c"), "index_at": "start"}, {"order": (2, 0, 1)}, {"big": True}):
            with self.subTest(options=options):
                V3(self.fresh(), data, (4, 4, 4), shards=(8, 12, 16), **options)
                self.reads(data)
                # Damage in the index and in a chunk.
                shard = self.path / "c/1/1/0"
                whole = shard.read_bytes()
                for cut in (3, 100, len(whole) - 4):
                    shard.write_bytes(whole[:cut])
                    self.assertIn(self.preprocess().returncode, (4,))

    def test_types_of_version_3(self):
        for kind in ("uint8", "int8", "uint16", "int16", "uint32", "int32", "int64", "uint64", "float16", "float32",
                     "float64"):
            data = numbers((5, 6, 7), kind)
            V3(self.fresh(), data, (4, 4, 8), big=kind == "int32")
            self.reads(is_read_as(data))

    def ome(self, version, axes="tczyx", sizes=(2, 3, 9, 10, 11), extra=True):
        data = numbers(sizes, "u2")
        self.fresh().mkdir()
        scale = [1.0] * (len(axes) - 3) + [2, 0.5, 0.25]
        transformations = [{"type": "scale", "scale": scale}]
        if extra:
            transformations.append({"type": "translation", "translation": [0.0] * (len(axes) - 3) + [30, 20, 10]})
        kinds = {"t": "time", "c": "channel"}
        image = {"version": version, "name": "v",
                 "axes": [{"name": a, "type": kinds.get(a, "space")} for a in axes],
                 "datasets": [{"path": "0", "coordinateTransformations": transformations},
                              {"path": "1", "coordinateTransformations": [
                                  {"type": "scale", "scale": scale[:-3] + [4, 1, 0.5]}]}]}
        small = np.ascontiguousarray(data[..., ::2, ::2, ::2])
        for level, values in (("0", data), ("1", small)):
            if version == "0.5":
                V3(self.path / level, values, (1,) * (len(axes) - 3) + (4, 4, 4), codecs=("zstd",))
            else:
                zarr.save_array(str(self.path / level), values, chunks=(1,) * (len(axes) - 3) + (4, 4, 4),
                                dimension_separator="/")
        if version == "0.5":
            (self.path / "zarr.json").write_text(json.dumps(
                {"zarr_format": 3, "node_type": "group", "attributes": {"ome": {"version": version, "multiscales": [image]}}}))
        else:
            (self.path / ".zgroup").write_text('{"zarr_format": 2}')
            (self.path / ".zattrs").write_text(json.dumps({"multiscales": [image]}))
        return data, small

    def test_ome(self):
        for version in ("0.4", "0.5"):
            data, small = self.ome(version)
            self.refuses(5, "axis 't'", "t 2, c 3, z 9, y 10, x 11")
            self.reads(np.ascontiguousarray(data[1, 2]), "--index", "t=1,c=2")
            self.lies([10, 20, 30], [0.25, 0.5, 2])
            self.reads(np.ascontiguousarray(data[0, 1]), "--index", "0,1,:,:,:")
            self.reads(np.ascontiguousarray(small[1, 0]), "--index", "t=1,c=0", "--dataset", "1")
            self.lies([0, 0, 0], [0.5, 1, 4])
            self.refuses(3, "\n  0\n  1", options=("--dataset", "2"))
            data, _ = self.ome(version, "zyx", (9, 10, 11))
            self.reads(data)
            # In a group of groups, as written by bioformats2raw.
            inside = self.path
            self.path = self.here / "outer.zarr"
            shutil.rmtree(self.path, ignore_errors=True)
            shutil.copytree(inside, self.path / "0")
            (self.path / ".zgroup").write_text('{"zarr_format": 2}')
            self.reads(data)
            self.reads(np.ascontiguousarray(data[::2, ::2, ::2]), "--dataset", "0/1")
            self.path = inside

    def test_axes_of_ome_are_those_of_the_world_by_their_names(self):
        for version, axes in itertools.product(("0.4", "0.5"), ("xyz", "cyzx", "zxy", "xy")):
            sizes = {"c": 2, "x": 9, "y": 10, "z": 11}
            self.fresh().mkdir()
            data = numbers([sizes[a] for a in axes], "u2")
            image = {"version": version, "axes": [{"name": a, "type": "channel" if a == "c" else "space"} for a in axes],
                     "datasets": [{"path": "0", "coordinateTransformations": [
                         {"type": "scale", "scale": [{"c": 1, "x": 0.25, "y": 0.5, "z": 2}[a] for a in axes]},
                         {"type": "translation", "translation": [{"c": 0, "x": 10, "y": 20, "z": 30}[a] for a in axes]}]}]}
            if version == "0.5":
                V3(self.path / "0", data, (4,) * len(axes))
                (self.path / "zarr.json").write_text(json.dumps(
                    {"zarr_format": 3, "node_type": "group", "attributes": {"ome": {"version": version, "multiscales": [image]}}}))
            else:
                zarr.save_array(str(self.path / "0"), data, chunks=(4,) * len(axes))
                (self.path / ".zgroup").write_text('{"zarr_format": 2}')
                (self.path / ".zattrs").write_text(json.dumps({"multiscales": [image]}))
            with self.subTest(version=version, axes=axes):
                index = ("--index", "c=1") if "c" in axes else ()
                data = data[1] if "c" in axes else data
                names = axes.replace("c", "")
                right = np.ascontiguousarray(data.transpose([names.index(a) for a in "zyx" if a in names]))
                self.reads(right, *index)
                self.lies([10, 20, 30 if "z" in axes else 0], [0.25, 0.5, 2 if "z" in axes else 1])
                self.reads(np.ascontiguousarray(right[..., 2:5, 1:8]), *index, "--crop", "1:8,2:5,:" if "z" in axes else "1:8,2:5")

    def test_groups_of_arrays(self):
        data, other = numbers((5, 6, 7)), numbers((4, 5), "f4")
        group = zarr.open_group(str(self.path), mode="w")
        group.create_dataset("a/volume", data=data)
        self.reads(data)
        group.create_dataset("b", data=other)
        self.reads(data)  # the only one with the largest number of axes
        group.create_dataset("c", data=data[None, ::-1])
        self.refuses(2, "a/volume", "b", "c", "--dataset")
        self.reads(np.ascontiguousarray(data[::-1]), "--dataset", "c")
        self.reads(data, "--dataset", "a/volume")
        self.reads(other, "--dataset", "/b")
        self.refuses(3, "a/volume", options=("--dataset", "d"))
        self.refuses(3, options=("--dataset", "../v.zarr/b/.."))

    def test_what_xarray_writes(self):
        try:
            import xarray
        except ImportError:
            self.skipTest("no xarray")
        data = np.round(RANDOM.normal(20, 5, (4, 5, 6)), 2)
        data[1, 2, 3] = np.nan
        x = xarray.Dataset({"t": (("z", "y", "x"), data)})
        x.to_zarr(self.fresh(), encoding={"t": {"dtype": "i2", "scale_factor": 0.01, "add_offset": 15,
                                                "_FillValue": -32768}})
        expected = xarray.open_zarr(self.path, consolidated=False).t.values
        found, _ = self.read_values()
        np.testing.assert_allclose(found, expected, rtol=1e-6)

    def read_values(self, *options):
        """The values of the store, and the notes."""
        done = self.preprocess("--json", *options)
        self.assertEqual(done.returncode, 0, done.stderr)
        served.run([ISONEST, "export", self.here / "s.isonest", "--field", "values", "-o", self.here / "s.npy",
                    "--force"], check=True, capture_output=True)
        return np.load(self.here / "s.npy"), json.loads(done.stdout)["notes"]

    def test_coordinates_that_xarray_writes_place_the_volume(self):
        try:
            import xarray
        except ImportError:
            self.skipTest("no xarray")
        data = numbers((3, 4, 5, 6), "f4")
        at = {"time": np.arange("2020-01-01", "2020-01-04", dtype="M8[D]").astype("M8[ns]"), "z": [10, 30, 50, 70],
              "y": [40.0, 38, 36, 34, 32], "x": (np.arange(6) * 0.25 - 7).astype("f4")}
        x = xarray.Dataset({"t": (("time", "z", "y", "x"), data), "mask": (("y", "x"), numbers((5, 6), "u1"))}, coords=at)
        x.to_zarr(self.fresh(), encoding={"x": {"dtype": "i2", "scale_factor": 0.25, "add_offset": -7.0,
                                                "_FillValue": -32768}})
        self.refuses(5, "time 3, z 4, y 5, x 6")  # the only array with four axes
        found, notes = self.read_values("--index", "time=1")
        np.testing.assert_array_equal(found, data[1, :, ::-1])
        self.lies([-7, 32, 10], [0.25, 2, 20])
        self.assertEqual([n for n in notes if "even" in n], [])
        self.assertEqual(self.preprocess("--index", "time=1", "--spacing", "1,2,3").returncode, 0)
        self.lies([-7, 32, 10], [1, 2, 3])
        x.assign_coords(z=[1, 2, 4, 8]).to_zarr(self.fresh())
        self.read_values("--index", "time=0")
        self.lies([-7, 32, 1], [0.25, 2, 7 / 3])
        with h5py.File(self.here / "s.isonest") as store:
            self.assertEqual(list(store.attrs["offsets_z"]), [0, 1, 3, 7])
        _, notes = self.read_values("--index", "time=0", "--spacing", "0.25,2,2")
        self.assertIn("up to 1 away", "".join(notes))
        self.lies([-7, 32, 1], [0.25, 2, 2])

    def test_what_xarray_writes_in_version_3(self):
        stored = numbers((4, 5, 6), "i2")
        stored[1, 2, 3] = -9
        packed = base64.b64encode(struct.pack("<d", -9.0)).decode()
        for attributes, kind, fill in (({"scale_factor": 0.5, "add_offset": 10.0, "_FillValue": -9}, "i2", 0),
                                       ({"_FillValue": packed}, "f4", 0), ({"missing_value": -9}, "f8", -9)):
            with self.subTest(attributes=attributes):
                V3(self.fresh() / "t", stored.astype(kind), (4, 4, 4), fill=fill, names=["z", "y", "x"],
                   attributes=attributes)
                for name, at in (("z", np.arange(4) * 2 + 1), ("y", np.arange(5)[::-1]), ("x", np.arange(6) / 4)):
                    V3(self.path / name, at, (len(at),), names=[name])
                (self.path / "zarr.json").write_text('{"zarr_format": 3, "node_type": "group"}')
                found, notes = self.read_values()
                expected = stored * attributes.get("scale_factor", 1.0) + attributes.get("add_offset", 0.0)
                expected[1, 2, 3] = np.nan
                np.testing.assert_array_equal(found, expected[:, ::-1])
                self.lies([0, 0, 1], [0.25, 1, 2])
                self.assertIn("-9", "".join(notes))

    def test_what_cannot_be_is_refused(self):
        data = numbers((5, 6, 7))
        zarr.save_array(str(self.path), data, chunks=(4, 4, 4))
        description = json.loads((self.path / ".zarray").read_text())
        for code, changes in ((4, {"shape": [5, 6]}), (4, {"shape": [0, 6, 7]}), (4, {"chunks": [2**30, 2**30, 2**30]}),
                              (7, {"chunks": [2**10, 2**10, 2**10]}), (5, {"dtype": "<c8"}), (5, {"zarr_format": 1}),
                              (4, {"shape": "x"}), (4, {"shape": [-5, 6, 7]}), (5, {"fill_value": "abc"}),
                              (5, {"fill_value": 1e9}), (5, {"dtype": [["a", "<i2"]]}), (4, {"chunks": [3, 4, 4]}),
                              (5, {"shape": [2**40, 2**40, 2**40]})):
            with self.subTest(changes=changes):
                (self.path / ".zarray").write_text(json.dumps({**description, **changes}))
                self.refuses(code, options=("--memory", "256M"))
        for text in ("", "{", "[" * 1000, "null", "[]", '{"zarr_format": 2}'):
            (self.path / ".zarray").write_text(text)
            self.assertIn(self.preprocess().returncode, (2, 3, 4, 5), text)

    def test_a_description_that_would_take_much_memory(self):
        V3(self.fresh(), numbers((9, 10, 11)), (4, 4, 4))
        whole = json.loads((self.path / "zarr.json").read_text())
        for hostile, code in (([0] * 3000000, 5), ([{}] * 2000000, 5), ([0] * 300000, 0), ({str(i): i for i in range(300000)}, 0)):
            (self.path / "zarr.json").write_text(json.dumps({**whole, "attributes": {"a": hostile}}, separators=(",", ":")))
            done = self.preprocess("--memory", "64M")
            self.assertEqual(done.returncode, code, done.stderr)
            self.assertIn("MiB of memory" if code else "", done.stderr)

    def test_damaged_files(self):
        for options in ({"codecs": ("zstd",)}, {"codecs": ("blosc",), "shards": (8, 8, 8)}, {"codecs": ("gzip",)}):
            V3(self.fresh(), numbers((9, 10, 11)), (4, 4, 4), **options)
            files = [p for p in self.path.rglob("*") if p.is_file()]
            for i in range(60):
                file = files[RANDOM.integers(len(files))] if i % 2 else self.path / "zarr.json"
                whole = file.read_bytes()
                data = bytearray(whole)
                for _ in range(RANDOM.integers(1, 4)):
                    data[RANDOM.integers(len(data))] = RANDOM.integers(256)
                if i % 4 == 0:
                    del data[RANDOM.integers(len(data)):]
                file.write_bytes(data)
                done = self.preprocess("--memory", "256M")
                self.assertIn(done.returncode, (0, 2, 3, 4, 5, 6, 7), (i, done.stderr))
                file.write_bytes(whole)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
