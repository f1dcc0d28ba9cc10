"""A writer of Zarr arrays of version 3 for tests, by the specification."""
import json
import pathlib
import struct

import numcodecs
import numpy as np


def crc32c(data):
    """Bit by bit, by RFC 3720."""
    crc = 0xFFFFFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0x82F63B78 if crc & 1 else 0)
    return struct.pack("<I", crc ^ 0xFFFFFFFF)


PACK = {"gzip": lambda b: numcodecs.GZip(5).encode(b), "zstd": lambda b: numcodecs.Zstd(1).encode(b),
        "blosc": lambda b: numcodecs.Blosc("zstd", 3).encode(b), "crc32c": lambda b: bytes(b) + crc32c(b)}


class V3:
    """Writes arrays of version 3 for tests: chunks, transposed or not, codecs, shards."""

    def __init__(self, folder, data, chunks, codecs=(), order=None, big=False, shards=None, index_at="end",
                 index_checksum=True, fill=0, separator="/", names=None, attributes=None, encoding="default"):
        self.folder, self.fill, self.big, self.order, self.codecs = pathlib.Path(folder), fill, big, order, codecs
        self.folder.mkdir(parents=True)
        inner = ([{"name": "transpose", "configuration": {"order": list(order)}}] if order else []) + [
            {"name": "bytes", "configuration": {"endian": "big" if big else "little"}}] + [
            {"name": c, "configuration": {}} for c in codecs]
        pipeline = inner
        if shards:
            pipeline = [{"name": "sharding_indexed", "configuration": {
                "chunk_shape": list(chunks), "codecs": inner, "index_location": index_at,
                "index_codecs": [{"name": "bytes", "configuration": {"endian": "little"}}] + (
                    [{"name": "crc32c"}] if index_checksum else [])}}]
        outer = shards or chunks
        (self.folder / "zarr.json").write_text(json.dumps({
            "zarr_format": 3, "node_type": "array", "shape": data.shape, "data_type": data.dtype.name,
            "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": list(outer)}},
            "chunk_key_encoding": {"name": encoding, "configuration": {"separator": separator}},
            "fill_value": fill, "codecs": pipeline, "dimension_names": names, "attributes": attributes or {}}))
        for index in np.ndindex(*[-(-n // c) for n, c in zip(data.shape, outer)]):
            part = self.part(data, index, outer)
            if not shards:
                blob = self.chunk(part)
            else:
                blobs, entries, at = [], [], 0
                size = 16 * int(np.prod([o // c for o, c in zip(outer, chunks)])) + 4 * index_checksum
                for i in np.ndindex(*[o // c for o, c in zip(outer, chunks)]):
                    one = self.chunk(self.part(part, i, chunks))
                    blobs.append(one or b"")
                    entries.append((2**64 - 1,) * 2 if one is None else (at + (size if index_at == "start" else 0), len(one)))
                    at += len(one or b"")
                table = b"".join(struct.pack("<QQ", *e) for e in entries)
                table += crc32c(table) if index_checksum else b""
                blob = (table if index_at == "start" else b"") + b"".join(blobs) + (table if index_at == "end" else b"")
                blob = None if at == 0 else blob
            if blob is not None:
                name = separator.join(map(str, index))
                file = self.folder / (("c" + separator if encoding == "default" else "") + name)
                file.parent.mkdir(parents=True, exist_ok=True)
                file.write_bytes(blob)

    def part(self, data, index, size):
        whole = np.full(size, self.fill, data.dtype)
        part = data[tuple(slice(i * n, (i + 1) * n) for i, n in zip(index, size))]
        whole[tuple(slice(0, n) for n in part.shape)] = part
        return whole

    def chunk(self, values):
        """None if all values are the fill value."""
        if (values == self.fill).all():
            return None
        values = values.transpose(self.order) if self.order else values
        blob = np.ascontiguousarray(values).astype(values.dtype.newbyteorder(">" if self.big else "<")).tobytes()
        for codec in self.codecs:
            blob = PACK[codec](blob)
        return blob
