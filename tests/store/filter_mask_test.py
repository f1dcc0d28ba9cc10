"""Chunks without the shuffle (store/FORMAT.md, section 6): the table, HDF5's filter masks and the elements agree,
whatever the volume, the number of threads and how a run ended; contradictions are found.

Usage: filter_mask_test.py ISONEST PLUGIN_FOLDER
"""
import ctypes
import os
import pathlib
import shutil
import sys
import tempfile
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served  # noqa: E402

isonest, plugins = sys.argv[1:3]
os.environ["HDF5_PLUGIN_PATH"] = plugins

import h5py  # noqa: E402  (the plugin path must be set first)
import numpy as np  # noqa: E402

xxhash = ctypes.CDLL("libxxhash.so.0")
xxhash.XXH64.restype = ctypes.c_uint64
xxhash.XXH64.argtypes = [ctypes.c_char_p, ctypes.c_size_t, ctypes.c_uint64]
zstd = ctypes.CDLL("libzstd.so.1")
zstd.ZSTD_decompress.restype = ctypes.c_size_t
zstd.ZSTD_decompress.argtypes = [ctypes.c_char_p, ctypes.c_size_t, ctypes.c_char_p, ctypes.c_size_t]
RNG = np.random.default_rng(7)
SMOOTH = np.add.outer(np.add.outer(np.arange(40) ** 2, np.arange(37) * 30), np.arange(43) * 7)
# 8 bits in 32: zstd finds repeated numbers, but not repeated bytes.
EIGHT_BITS = (RNG.integers(0, 200, (40, 37, 43)) / 255).astype("<f4")
SKIPS = 32  # bit 5 of the header's flags


def sum_of(data):
    return np.uint64(xxhash.XXH64(data, len(data), 0))


def seal(f):
    """Updates the checksums of the header and of the table."""
    f.attrs.modify("xxh64", sum_of(b"".join(np.asarray(f.attrs[name]).tobytes() for name in (
        "version", "flags", "nodes", "spacing", "origin", "value_type", "chunk", "compression", "exact", "fields",
        "range", "has_missing"))))
    f["chunks"].attrs.modify("xxh64", sum_of(f["chunks"][...].tobytes()))


def chunks_of(f):
    """(path, the chunk's first element, row of the table, HDF5's description) of all chunks."""
    for level in f["levels"]:
        seen = set()
        for name, array in f["levels"][level].items():
            place = h5py.h5o.get_info(array.id).addr
            if array.chunks is None or place in seen:
                continue
            seen.add(place)
            grid = [-(-s // c) for s, c in zip(array.shape[:3], array.chunks[:3])]
            for i in range(array.id.get_num_chunks()):
                info = array.id.get_chunk_info(i)
                at = [o // c for o, c in zip(info.chunk_offset[:3], array.chunks[:3])]
                row = int(array.attrs["first_chunk_row"]) + (at[0] * grid[1] + at[1]) * grid[2] + at[2]
                yield f"levels/{level}/{name}", info.chunk_offset, row, info


class FilterMask(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)

    def run_isonest(self, *arguments, code=0):
        done = served.run([isonest, *map(str, arguments)], capture_output=True, text=True)
        self.assertEqual(done.returncode, code, done.stdout + done.stderr)
        return done.stdout + done.stderr

    def store_of(self, values, *options):
        np.save(self.folder / "v.npy", values)
        store = self.folder / "v.isonest"
        self.run_isonest("preprocess", self.folder / "v.npy", "-o", store, "--chunk", 16, "--force", *options)
        return store

    def masks(self, store):
        """The filter mask of each chunk, by row; checked against the table, and the frames against the elements."""
        raw, masks = store.read_bytes(), {}
        with h5py.File(store) as f:
            table = f["chunks"][...]
            for path, at, row, info in chunks_of(f):
                array = f[path]
                coded = not path.endswith("/values") and f.attrs["exact"] == 0
                kind = np.dtype("<u2") if coded else array.dtype
                self.assertEqual(info.filter_mask, int(table["flags"][row]) >> 1, (path, at))
                self.assertIn(info.filter_mask, (0, 1) if kind.itemsize > 1 else (0,))
                masks[row] = info.filter_mask
                size = int(np.prod(array.chunks)) * kind.itemsize
                plain = ctypes.create_string_buffer(size)
                frame = raw[info.byte_offset:info.byte_offset + info.size]
                self.assertEqual(zstd.ZSTD_decompress(plain, size, frame, len(frame)), size)
                elements = plain.raw
                if info.filter_mask == 0:
                    elements = np.frombuffer(elements, "u1").reshape(kind.itemsize, -1).T.tobytes()
                whole = np.frombuffer(elements, kind).reshape(array.chunks)
                if coded:
                    whole = (whole.astype("<u4") << 16).view("<f4")
                part = array[tuple(slice(o, o + c) for o, c in zip(at, array.chunks))].astype(whole.dtype)
                np.testing.assert_array_equal(whole[tuple(slice(s) for s in part.shape)], part, path)
            self.assertEqual(len(masks), len(table))
            skips = any(masks.values())
            self.assertEqual(int(f.attrs["flags"]) & SKIPS, SKIPS if skips else 0)
            self.assertEqual(list(f.attrs["version"]), [2, 13] if skips else [2, 10])
        self.run_isonest("check", "--deep", store)
        return masks

    def test_the_choice_is_said_everywhere(self):
        for values, options, some, all_shuffled in (
                (EIGHT_BITS, (), True, False), (EIGHT_BITS.astype("<f8"), ("--exact",), True, False),
                (EIGHT_BITS[0], (), False, False),
                (SMOOTH.astype("<u2"), ("--indicators", "deviation_bar"), False, False),
                (np.zeros((20, 20, 20), "u1"), (), False, True)):
            with self.subTest(kind=values.dtype, shape=values.shape, options=options):
                store = self.store_of(values, *options)
                masks = self.masks(store)
                if some:
                    self.assertIn(1, masks.values())
                if all_shuffled:
                    self.assertNotIn(1, masks.values())
                with h5py.File(store) as f:
                    np.testing.assert_array_equal(f["levels/0/values"][...].reshape(values.shape), values)
                self.run_isonest("export", store, "-o", self.folder / "w.npy", "--force")
                np.testing.assert_array_equal(np.load(self.folder / "w.npy").reshape(values.shape), values)

    def test_vtk_reads_them(self):
        try:
            import vtk
            from vtk.util import numpy_support
        except ImportError:
            self.skipTest("vtk is not installed")
        store = self.store_of(EIGHT_BITS)
        reader = vtk.vtkHDFReader()
        reader.SetFileName(str(store))
        reader.Update()
        array = numpy_support.vtk_to_numpy(reader.GetOutputDataObject(0).GetPointData().GetArray("values"))
        np.testing.assert_array_equal(array.reshape(EIGHT_BITS.shape), EIGHT_BITS)

    def test_both_kinds_in_one_array(self):
        mixed = np.where(np.arange(43) < 16, EIGHT_BITS, (SMOOTH + RNG.random(SMOOTH.shape)).astype("<f4"))
        store = self.store_of(mixed, "--indicators", "deviation_bar")
        masks = self.masks(store)
        with h5py.File(store) as f:
            of_values = [masks[row] for path, _, row, _ in chunks_of(f) if path == "levels/0/values"]
        self.assertEqual(set(of_values), {0, 1})

    def test_bytes_do_not_depend_on_threads(self):
        stores = [self.store_of(EIGHT_BITS, "--threads", threads).read_bytes() for threads in (1, 2, 5)]
        self.assertEqual(stores[0], stores[1])
        self.assertEqual(stores[0], stores[2])

    def forged(self, store, change):
        copy = self.folder / "forged.isonest"
        shutil.copyfile(store, copy)
        with h5py.File(copy, "r+") as f:
            change(f)
            seal(f)
        return copy

    def test_contradictions_are_found(self):
        store = self.store_of(EIGHT_BITS)

        def first_of(f, mask):
            return next(c for c in chunks_of(f) if c[3].filter_mask == mask and c[0] == "levels/0/values")

        def write_with(f, path, at, mask, row):
            """The same bytes with another mask, and the row's new place."""
            array = f[path].id
            _, data = array.read_direct_chunk(at)
            array.write_direct_chunk(at, data + b"\0", mask)  # HDF5 keeps the mask of a chunk that keeps its size
            array.write_direct_chunk(at, data, mask)
            info = array.get_chunk_info_by_coord(at)
            table = f["chunks"][...]
            table["offset"][row], table["bytes"][row] = info.byte_offset, info.size
            f["chunks"][...] = table

        def mask_cleared(f):
            path, at, row, _ = first_of(f, 1)
            write_with(f, path, at, 0, row)

        def mask_of_all_filters(f):
            path, at, row, _ = first_of(f, 1)
            write_with(f, path, at, 3, row)

        for change, words in ((mask_cleared, "reverses a shuffle"), (mask_of_all_filters, "skips a filter")):
            text = self.run_isonest("check", "--deep", self.forged(store, change), code=4)
            self.assertIn(words, text)

        def row_cleared(f):
            table = f["chunks"][...]
            table["flags"][first_of(f, 1)[2]] = 0
            f["chunks"][...] = table

        text = self.run_isonest("check", "--deep", self.forged(store, row_cleared), code=4)
        self.assertIn("the chunk holds", text)

        # Without bit 5 a reader undoes the shuffle of all chunks, as in 2.12, so check finds other values than were written.
        text = self.run_isonest("check", "--deep", self.forged(store, lambda f: f.attrs.modify("flags", np.uint32(0))), code=4)
        self.assertIn("reserved flags", text)

    def test_the_bit_exists_since_2_13(self):
        store = self.store_of(EIGHT_BITS)
        for minor, code in ((9, 5), (10, 5), (12, 5), (13, 0), (99, 0)):
            copy = self.forged(store, lambda f: f.attrs.modify("version", np.array([2, minor], "<u4")))
            text = self.run_isonest("info", copy, code=code)
            if code:
                self.assertIn("header flags", text)
        # Allowed for a store whose chunks are all shuffled, although no writer sets it.
        store = self.store_of(np.zeros((20, 20, 20), "u1"))

        def bit_alone(f):
            f.attrs.modify("version", np.array([2, 13], "<u4"))
            f.attrs.modify("flags", np.uint32(SKIPS))
        self.run_isonest("check", "--deep", self.forged(store, bit_alone))


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
