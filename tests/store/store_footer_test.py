"""Reads stores by their footer alone, without HDF5, following store/FORMAT.md; another process reads the same with
h5py.

Usage: store_footer_test.py ISONEST PLUGIN_FOLDER
"""
import ctypes
import hashlib
import json
import os
import pathlib
import struct
import subprocess
import sys
import tempfile

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served  # noqa: E402

zstd, xxhash = ctypes.CDLL("libzstd.so.1"), ctypes.CDLL("libxxhash.so.0")
zstd.ZSTD_decompress.restype = ctypes.c_size_t
zstd.ZSTD_decompress.argtypes = [ctypes.c_char_p, ctypes.c_size_t, ctypes.c_char_p, ctypes.c_size_t]
xxhash.XXH64.restype = ctypes.c_uint64
xxhash.XXH64.argtypes = [ctypes.c_char_p, ctypes.c_size_t, ctypes.c_uint64]
ROW = np.dtype([("offset", "<u8"), ("bytes", "<u4"), ("flags", "<u4"), ("checksum", "<u8"), ("min", "<f8"), ("max", "<f8")])


def sum_of(data):
    return xxhash.XXH64(data, len(data), 0)


class Store:
    """A store without HDF5. `read(offset, size)` returns bytes of the file, whose size is `size`."""

    def __init__(self, read, size):
        self.read = read
        tail = read(size - min(size, 65536), min(size, 65536))
        footer = tail[-64:]
        assert footer[56:] == b"IsoNest\n" and struct.unpack_from("<IIQ", footer, 40) == (1, 64, sum_of(footer[:48]))
        begin, count, digest, self.hdf5_end, whole = struct.unpack_from("<5Q", footer)
        assert whole == size
        catalogue = tail[begin - size:begin - size + count] if begin >= size - len(tail) else read(begin, count)
        assert sum_of(catalogue) == digest
        self.attributes, self.ranges, self.names, self.pages, self.unshuffled = {}, {}, None, {}, False
        while catalogue:
            tag, detail, count = struct.unpack_from("<IIQ", catalogue)
            content, catalogue = catalogue[16:16 + count], catalogue[16 + -(-count // 8) * 8:]
            numbers = np.frombuffer(content[:count // 8 * 8], "<u8").tolist()
            if tag == 1:
                self.attributes[content[:32].rstrip(b"\0").decode()] = (detail, content[32:])
            elif tag == 2:
                self.table, self.page_sums = numbers[:6], numbers[6:6 + numbers[4]]
            elif tag == 3:
                self.ranges[detail] = numbers[:2], numbers[3:3 + numbers[2]]
            elif tag == 4:
                self.names = numbers[:4]
            elif tag == 5:
                self.totals = np.frombuffer(content, [("first", "<u8"), ("chunks", "<u8"), ("bytes", "<u8"),
                                                      ("min", "<f8"), ("max", "<f8")])
        covered = b"".join(self.attributes[name][1] for name in (
            "version", "flags", "nodes", "spacing", "origin", "value_type", "chunk", "compression", "exact", "fields",
            "range", "has_missing"))
        assert sum_of(covered) == self.attribute("xxh64")[0]
        assert self.attribute("format") == "isonest" and self.attribute("complete")[0] == 1
        self.nodes = [int(n) for n in self.attribute("nodes")[::-1]]
        self.fields = self.attribute("fields").split(",")
        self.chunk, self.exact = int(self.attribute("chunk")[0]), self.attribute("exact")[0] == 1
        self.lay_out()

    def attribute(self, name):
        kind, data = self.attributes[name]
        return data.rstrip(b"\0").decode() if kind == 4 else np.frombuffer(data, {1: "<u4", 2: "<u8", 3: "<f8"}[kind])

    def lay_out(self):
        """For each array: shape, chunk, type, first row (sections 1, 3, 4 and 6)."""
        self.arrays, row, level = {}, 0, 0
        flat = [n == 1 for n in self.nodes[::-1]]
        centre = sum(b for b, f in zip((1, 2, 4), flat) if not f) - 1
        while True:
            shape = [-(-(n - 1) // 2**level) + 1 for n in self.nodes]
            sources = {}
            for name in ["values", *(self.fields if level else [])]:
                k = self.chunk if name == "values" else self.chunk // 2
                chunk, kind, slots = [min(k, s) for s in shape], np.dtype(self.attribute("value_type")), []
                if name != "values":
                    kind = np.dtype("<f4" if self.exact else "<u2")
                    alone = name.startswith("hex_") or level == 1 and name.startswith(("linf", "deviation"))
                    slots = [1 if alone else centre + 1]
                alias = name.replace("deviation", "linf") if level == 1 and name.startswith("deviation") else name
                if alias != name and alias in sources:
                    self.arrays[level, name] = sources[alias]
                    continue
                self.arrays[level, name] = sources[name] = shape, chunk, kind, slots, row
                row += int(np.prod([-(-s // c) for s, c in zip(shape, chunk)]))
            if max(shape) <= 2:
                break
            level += 1
        self.top = level
        assert row == self.table[1]

    def row(self, number):
        offset, rows, row_bytes, of_page, _, _ = self.table
        page = number // of_page
        if page not in self.pages:
            data = self.read(offset + page * of_page * row_bytes, min(of_page, rows - page * of_page) * row_bytes)
            assert sum_of(data) == self.page_sums[page]
            self.pages[page] = np.frombuffer(data, ROW)
        return self.pages[page][number % of_page]

    def array(self, level, name):
        shape, chunk, kind, slots, first = self.arrays[level, name]
        grid = [-(-s // c) for s, c in zip(shape, chunk)]
        out = np.zeros([g * c for g, c in zip(grid, chunk)] + slots, kind)
        for i, at in enumerate(np.ndindex(*grid)):
            row = self.row(first + i)
            stored = self.read(int(row["offset"]), int(row["bytes"]))
            assert sum_of(stored) == row["checksum"]
            size = int(np.prod(chunk + slots)) * kind.itemsize
            raw = ctypes.create_string_buffer(size)
            assert zstd.ZSTD_decompress(raw, size, stored, len(stored)) == size
            data = raw.raw
            if not (int(self.attribute("flags")[0]) & 32 and row["flags"] & 2):
                data = np.frombuffer(data, "u1").reshape(kind.itemsize, -1).T.tobytes()  # undoes the shuffle
            self.unshuffled |= kind.itemsize > 1 and int(row["flags"]) & 2 > 0
            out[tuple(slice(a * c, a * c + c) for a, c in zip(at, chunk))] = np.frombuffer(data, kind).reshape(chunk + slots)
        out = out[tuple(slice(s) for s in shape)]
        return (out.astype("<u4") << 16).view("<f4") if kind == "<u2" and name != "values" else out

    def cube_ranges(self, level):
        (offset, size), sums = self.ranges[level]
        data, cells = self.read(offset, size), [s - 1 for s in self.arrays[level, "values"][0]]
        plane = len(data) // cells[0]
        assert sums == [sum_of(data[z * plane:(z + 1) * plane]) for z in range(cells[0])]
        value = np.dtype(self.attribute("value_type"))
        return np.frombuffer(data, value if value.itemsize <= 2 else "<f4").reshape(cells + [2])

    def label_names(self):
        offset, rows, row_bytes, digest = self.names
        data = self.read(offset, rows * row_bytes)
        assert sum_of(data) == digest
        kind = np.dtype([("id", "<i8"), ("flags", "u1"), ("color", "u1", 3), ("name", f"S{row_bytes - 12}")])
        return [(int(r["id"]), int(r["flags"]), r["color"].tolist(), r["name"].decode()) for r in np.frombuffer(data, kind)]


def digest(array):
    return [list(array.shape), hashlib.sha256(np.ascontiguousarray(array).tobytes()).hexdigest()]


def by_footer(path):
    with open(path, "rb") as file:
        reads = []

        def read(offset, size):
            reads.append((offset, size))
            file.seek(offset)
            return file.read(size)

        store = Store(read, os.path.getsize(path))
        assert len(reads) == 1, reads
        found = {"attributes": {name: hashlib.sha256(data).hexdigest() for name, (_, data) in store.attributes.items()},
                 "arrays": {f"{level}/{name}": digest(store.array(level, name)) for level, name in store.arrays},
                 "ranges": {str(level): digest(store.cube_ranges(level)) for level in store.ranges},
                 "names": store.label_names() if store.names else None}
        for first, chunks, size, low, high in store.totals.tolist():
            rows = [store.row(first + i) for i in range(chunks)]
            assert size == sum(int(r["bytes"]) for r in rows)
            assert (low, high) == (min(r["min"] for r in rows), max(r["max"] for r in rows))
    assert not any("h5py" in name for name in sys.modules)
    assert store.unshuffled == (int(store.attribute("flags")[0]) & 32 > 0)
    return found, store.unshuffled


def by_hdf5(path):
    import h5py
    with h5py.File(path) as f:
        names = f["label_names"][...] if "label_names" in f else None
        found = {"attributes": {name: hashlib.sha256(np.asarray(f.attrs.get(name)).tobytes()).hexdigest() for name in f.attrs},
                 "arrays": {}, "ranges": {},
                 "names": names if names is None else [
                     (int(r["id"]), int(r["flags"]), r["color"].tolist(), r["name"].decode()) for r in names]}
        for level in f["levels"]:
            for name, array in f["levels"][level].items():
                if name == "cube_ranges":
                    found["ranges"][level] = digest(array[...])
                elif name != "cube_range_sums":
                    data = array[...]
                    found["arrays"][f"{level}/{name}"] = digest(data if name == "values" else data.astype("<f4"))
    return found


if sys.argv[1] == "--hdf5":
    print(json.dumps(by_hdf5(sys.argv[2])))
    sys.exit()

isonest, plugins = sys.argv[1:3]
with tempfile.TemporaryDirectory() as folder:
    rng = np.random.default_rng(3)
    labels = rng.integers(0, 5, (9, 12, 20)).astype("u1")
    holes = rng.random((19, 26, 33)).astype("<f4")
    holes[3, 4, 5:9] = np.nan
    pathlib.Path(f"{folder}/names.txt").write_text('3 Übergang 255 0 10 255\n4 b\n')
    volumes = {
        "eight bits": ((rng.integers(0, 200, (37, 30, 45)) / 255).astype("<f4"), ["--chunk", "16"]),
        "floats": (rng.random((37, 30, 45)).astype("<f4"), ["--chunk", "16", "--unit", "mm", "--frame", "lps", "--spacing", "1,2,0.5"]),
        "labels": (labels, ["--chunk", "8", "--labels", "--label-names", f"{folder}/names.txt"]),
        "many": (rng.integers(-900, 900, (70, 66, 61)).astype("<i2"), ["--chunk", "8", "--indicators", "linf_bar"]),
        "holes": (holes, ["--chunk", "8", "--exact", "--indicators", "linf_plus,deviation_plus,hex_linf,normal_bar"]),
        "plane": (rng.random((1, 50, 40)), ["--chunk", "16"])}
    for name, (values, options) in volumes.items():
        np.save(f"{folder}/{name}.npy", values)
        store = f"{folder}/{name}.isonest"
        done = served.run([isonest, "preprocess", f"{folder}/{name}.npy", "-o", store, *options],
                          capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        found, unshuffled = by_footer(store)
        found = json.loads(json.dumps(found))
        assert unshuffled or name != "eight bits", name
        assert found["arrays"]["0/values"] == json.loads(json.dumps(digest(values))), name
        done = subprocess.run([sys.executable, __file__, "--hdf5", store], capture_output=True, text=True,
                              env={**os.environ, "HDF5_PLUGIN_PATH": plugins})
        assert done.returncode == 0, done.stderr
        expected = json.loads(done.stdout)
        for part in expected:
            assert found[part] == expected[part], (name, part, found[part], expected[part])
        print(f"{name}: the same without HDF5: {len(found['arrays'])} arrays, {len(found['ranges'])} levels of ranges")
