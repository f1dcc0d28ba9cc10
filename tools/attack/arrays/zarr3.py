"""A writer of Zarr arrays of version 3 by the specification, with what it allows and other writers do not use.

https://zarr-specs.readthedocs.io/en/latest/v3/core/index.html and .../v3/codecs/index.html
"""
import json
import math
import struct

import numcodecs
import numpy as np

NAMES = {"b1": "bool", "u1": "uint8", "i1": "int8", "u2": "uint16", "i2": "int16", "u4": "uint32", "i4": "int32", "u8": "uint64",
         "i8": "int64", "f2": "float16", "f4": "float32", "f8": "float64"}
ABSENT = 2**64 - 1
BLOSC = ("blosclz", "lz4", "lz4hc", "zlib", "zstd")


def _table():
    table = np.zeros(256, "u4")
    for i in range(256):
        crc = i
        for _ in range(8):
            crc = (crc >> 1) ^ (0x82F63B78 if crc & 1 else 0)
        table[i] = crc
    return [int(n) for n in table]


TABLE = _table()


def crc32c(data):
    """Castagnoli's polynomial, reflected (RFC 3720, B.4)."""
    crc = 0xFFFFFFFF
    for byte in data:
        crc = TABLE[(crc ^ byte) & 0xFF] ^ (crc >> 8)
    return struct.pack("<I", crc ^ 0xFFFFFFFF)


def _gzip(c, b):
    return numcodecs.GZip(c["level"]).encode(b)


def _zstd(c, b):
    return numcodecs.Zstd(c["level"]).encode(b)


def _blosc(c, b):
    shuffle = {"noshuffle": 0, "shuffle": 1, "bitshuffle": 2}[c["shuffle"]]
    size = c["typesize"] if len(b) % c["typesize"] == 0 else 1
    return numcodecs.Blosc(c["cname"], c["clevel"], shuffle, c["blocksize"]).encode(np.frombuffer(b, f"V{size}"))


PACK = {"gzip": _gzip, "zstd": _zstd, "blosc": _blosc, "crc32c": lambda c, b: bytes(b) + crc32c(b)}


def random_packers(one, kind, most=2):
    """Codecs from bytes to bytes: at most one that compresses, with checksums around it."""
    codecs = []
    for _ in range(int(one.random.integers(0, most + 1))):
        name = one.pick("gzip", "zstd", "blosc", "crc32c")
        if name == "crc32c":
            codecs.append({"name": name} if one.chance(0.5) else {"name": name, "configuration": {}})
        elif not any(c["name"] != "crc32c" for c in codecs):
            size = np.dtype(kind).itemsize
            codecs.append({"name": name, "configuration": {
                "gzip": lambda: {"level": one.pick(0, 1, 9)},
                "zstd": lambda: {"level": one.pick(-5, 0, 3, 19), "checksum": False},
                "blosc": lambda: {"cname": one.pick(*BLOSC), "clevel": one.pick(0, 1, 5, 9), "typesize": size,
                                  "shuffle": one.pick("noshuffle", "shuffle", "bitshuffle"), "blocksize": one.pick(0, 0, 64, 256)},
            }[name]()})
    return codecs


def random_bytes(one, kind):
    if np.dtype(kind).itemsize == 1 and one.chance(0.7):
        return {"name": "bytes"}
    return {"name": "bytes", "configuration": {"endian": one.pick("little", "big")}}


def random_transposes(one, axes, most=2):
    return [{"name": "transpose", "configuration": {"order": [int(i) for i in one.random.permutation(axes)]}}
            for _ in range(int(one.random.integers(0, most + 1)))]


def random_shards(one, kind, shape):
    """A sharding codec for shards of a shape; its chunks divide it."""
    inner = [int(one.pick(*[d for d in range(1, n + 1) if n % d == 0])) for n in shape]
    index = [{"name": "bytes", "configuration": {"endian": "little"}}] + ([{"name": "crc32c"}] if one.chance(0.7) else [])
    configuration = {"chunk_shape": inner, "index_codecs": index,
                     "codecs": [*random_transposes(one, len(shape), 1), random_bytes(one, kind), *random_packers(one, kind)]}
    if one.chance(0.7):
        configuration["index_location"] = one.pick("start", "end")
    return {"name": "sharding_indexed", "configuration": configuration}


class Writer:
    """Of one array. `codecs` as in its zarr.json; fill: a number of the array's type."""

    def __init__(self, one, codecs, fill):
        self.one, self.codecs, self.fill = one, codecs, fill

    def encode(self, values, codecs):
        """The bytes of a chunk."""
        blob = None
        for codec in codecs:
            name, configuration = codec["name"], codec.get("configuration", {})
            if name == "transpose":
                values = values.transpose(configuration["order"])
            elif name == "bytes":
                order = ">" if configuration.get("endian") == "big" else "<"
                blob = np.ascontiguousarray(values).astype(values.dtype.newbyteorder(order)).tobytes()
            elif name == "sharding_indexed":
                blob = self.shard(values, configuration)
            else:
                blob = PACK[name](configuration, blob)
        return blob

    def is_fill(self, values):
        fill = np.asarray(self.fill, values.dtype)
        return bool(((values == fill) | ((values != values) & (fill != fill))).all())

    def shard(self, values, configuration):
        """Chunks in any order, with unused bytes between them."""
        one = self.one
        inner = configuration["chunk_shape"]
        count = [n // i for n, i in zip(values.shape, inner)]
        entries = np.full((*count, 2), ABSENT, "<u8")
        checksum = 4 * any(c["name"] == "crc32c" for c in configuration["index_codecs"])
        size = 16 * math.prod(count) + checksum
        starts = configuration.get("index_location", "end") == "start"
        body = b""
        places = list(np.ndindex(*count))
        if one.chance(0.5):
            one.random.shuffle(places)
        for place in places:
            chunk = values[tuple(slice(p * i, (p + 1) * i) for p, i in zip(place, inner))]
            if self.is_fill(chunk) and one.chance(0.8):
                continue
            if one.chance(0.1):
                body += b"unused"
            blob = self.encode(chunk, configuration["codecs"])
            entries[tuple(place)] = (len(body) + (size if starts else 0), len(blob))
            body += blob
        index = entries.tobytes()
        index += crc32c(index) if checksum else b""
        return index + body if starts else body + index

    def write(self, folder, data, outer, keys, description):
        """keys: (name of the encoding, separator, or None for its own)."""
        folder.mkdir(parents=True, exist_ok=True)
        name, separator = keys
        encoding = {"name": name}
        if separator:
            encoding["configuration"] = {"separator": separator}
        separator = separator or ("/" if name == "default" else ".")
        (folder / "zarr.json").write_text(json.dumps({
            "zarr_format": 3, "node_type": "array", "shape": data.shape, "data_type": NAMES[data.dtype.str[1:]],
            "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": list(outer)}}, "chunk_key_encoding": encoding,
            "codecs": self.codecs, **description}))
        for place in np.ndindex(*[-(-n // c) for n, c in zip(data.shape, outer)]):
            part = data[tuple(slice(p * c, (p + 1) * c) for p, c in zip(place, outer))]
            if self.is_fill(part) and self.one.chance(0.8):
                continue
            whole = np.full(outer, self.fill, data.dtype)
            if self.one.chance(0.2):  # what lies beyond the array means nothing
                whole[...] = self.one.random.integers(0, 2, outer)
            whole[tuple(slice(0, n) for n in part.shape)] = part
            words = [str(p) for p in place]
            file = folder / separator.join((["c"] if name == "default" else []) + (words or ([] if name == "default" else ["0"])))
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(self.encode(whole, self.codecs))
