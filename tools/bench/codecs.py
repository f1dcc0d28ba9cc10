"""What other ways to store the indicators would cost, on the chunks of a store.

usage: codecs.py STORE [CHUNKS_PER_LEVEL] (60)   with HDF5_PLUGIN_PATH at the zstd plugin's folder

Bytes after zstd 1 for levels 1 to 3, against what the store does (16-bit codes, the seven slots of a
node side by side, shuffled): planes of one slot each, 8-bit codes (3 bits of mantissa below the
level's largest, rounded up, a lower octave for each 8), differences along x, and differences to
linf_bar. Numbers depend on zstd's version a little.
"""
import ctypes
import sys

import needs

needs.arguments(1, __doc__, 2)
needs.require(needs.module("h5py"), needs.module("numpy"), needs.library("zstd", "libzstd.so.1"),
              needs.file(sys.argv[1], "a store"))
needs.require(needs.zstd_filter())
import h5py
import numpy as np

zstd = ctypes.CDLL("libzstd.so.1")
zstd.ZSTD_compress.restype = ctypes.c_size_t
zstd.ZSTD_compress.argtypes = [ctypes.c_void_p, ctypes.c_size_t, ctypes.c_char_p, ctypes.c_size_t,
                               ctypes.c_int]


def packed(array):
    """Bytes of an array, shuffled if its elements have more than one, after zstd 1."""
    size = array.dtype.itemsize
    raw = np.ascontiguousarray(array).view(np.uint8).reshape(-1, size).T.tobytes()
    room = ctypes.create_string_buffer(len(raw) + len(raw) // 100 + 1024)
    return zstd.ZSTD_compress(room, len(room), raw, len(raw), 1)


def planes(codes):
    return np.ascontiguousarray(np.moveaxis(codes, -1, 0))


def short(codes, largest):
    upper = (codes.astype(np.int64) + 15) >> 4
    return np.where(codes == 0, 0, np.maximum(upper - (((largest + 15) >> 4) - 255), 1)).astype("u1")


def along_x(codes):
    difference = codes.copy()
    difference[..., 1:] -= codes[..., :-1]
    return difference


def main():
    many = int(sys.argv[2]) if len(sys.argv) > 2 else 60
    rng = np.random.default_rng(1)
    with h5py.File(sys.argv[1]) as store:
        for level in (1, 2, 3):
            group = store[f"levels/{level}"]
            fields = [n for n in ("linf_bar", "linf_plus", "deviation_bar") if n in group
                      and (level > 1 or n != "deviation_bar")]
            edge, shape = group[fields[0]].chunks[0], group[fields[0]].shape
            chunks = [(z, y, x) for z in range(0, shape[0], edge) for y in range(0, shape[1], edge)
                      for x in range(0, shape[2], edge)]
            if len(chunks) > many:
                chunks = [chunks[i] for i in rng.choice(len(chunks), many, replace=False)]
            codes = {f: [(np.ascontiguousarray(group[f][z:z + edge, y:y + edge, x:x + edge])
                          .view("u4") >> 16).astype("u2") for z, y, x in chunks] for f in fields}
            largest = {f: max(int(c.max()) for c in codes[f]) for f in fields}
            print(f"level {level}, {len(chunks)} chunks")
            for f in fields:
                row = {}
                for i, c in enumerate(codes[f]):
                    s = short(c, largest[f])
                    sizes = {"stored": packed(c), "planes": packed(planes(c)),
                             "8 bit": packed(s), "8 bit planes": packed(planes(s)),
                             "8 bit planes, along x": packed(along_x(planes(s)))}
                    if f != "linf_bar":
                        bar = codes["linf_bar"][i]
                        sizes["planes, less linf_bar"] = packed(planes(c) - planes(bar))
                    for name, size in sizes.items():
                        row[name] = row.get(name, 0) + size
                print(f"  {f:14s}", ", ".join(f"{n} {v / 1000:.0f} kB ({v / row['stored']:.2f})"
                                             for n, v in row.items()))


if __name__ == "__main__":
    main()
