"""A writer of TIFF by the specification (TIFF 6.0, BigTIFF, technical notes 1 to 3), with what other writers do not use."""
import lzma
import struct
import zlib

import numcodecs
import numpy as np

SIZES = {1: 1, 2: 1, 3: 2, 4: 4, 5: 8, 11: 4, 12: 8, 13: 4, 16: 8, 18: 8}
LETTERS = {1: "B", 3: "H", 4: "I", 11: "f", 12: "d", 13: "I", 16: "Q", 18: "Q"}
NONE, LZW, DEFLATE, OLD_DEFLATE, PACKBITS, LZMA, ZSTD = 1, 5, 8, 32946, 32773, 34925, 50000
FORMATS = {"u": 1, "i": 2, "f": 3, "c": 6}


def packbits(row):
    """Runs and literal parts, of one row."""
    out, at = bytearray(), 0
    while at < len(row):
        run = 1
        while at + run < len(row) and run < 128 and row[at + run] == row[at]:
            run += 1
        if run > 1:
            out += bytes([257 - run, row[at]])
            at += run
            continue
        end = at + 1
        while end < len(row) and end - at < 128 and (end + 1 >= len(row) or row[end] != row[end + 1]):
            end += 1
        out += bytes([end - at - 1]) + row[at:end]
        at = end
    return bytes(out)


def lzw(data):
    """Codes of 9 to 12 bits, the most significant bit first, after section 13 of TIFF 6.0."""
    bits, held, out = 0, 0, bytearray()
    table, width = {bytes([i]): i for i in range(256)}, 9
    following = 258

    def put(code):
        nonlocal bits, held
        held = held << width | code
        bits += width
        while bits >= 8:
            bits -= 8
            out.append(held >> bits & 0xFF)
        held &= (1 << bits) - 1
    put(256)
    word = b""
    for value in data:
        more = word + bytes([value])
        if more in table:
            word = more
            continue
        put(table[word])
        table[more] = following
        following += 1
        width = 10 if following == 512 else 11 if following == 1024 else 12 if following == 2048 else width
        if following == 4094:
            put(256)
            table, following, width = {bytes([i]): i for i in range(256)}, 258, 9
        word = bytes([value])
    if word:
        put(table[word])
        following += 1
        width = 10 if following == 512 else 11 if following == 1024 else 12 if following == 2048 else width
    put(257)
    if bits:
        out.append(held << (8 - bits) & 0xFF)
    return bytes(out)


def packed(compression, data, row_bytes):
    if compression == NONE:
        return data
    if compression == PACKBITS:
        return b"".join(packbits(data[at:at + row_bytes]) for at in range(0, len(data), row_bytes))
    return {LZW: lzw, DEFLATE: zlib.compress, OLD_DEFLATE: zlib.compress, LZMA: lambda b: lzma.compress(b, lzma.FORMAT_XZ),
            ZSTD: lambda b: numcodecs.Zstd(1).encode(b)}[compression](data)


def predicted(block, predictor, order):
    """Bytes of [rows, columns, samples] of numbers in the file's order."""
    rows, columns, samples = block.shape
    size = block.dtype.itemsize
    if predictor == 2:
        whole = block.view(f"u{size}")
        differences = whole.copy()
        differences[:, 1:] -= whole[:, :-1]
        return differences.astype(f"{order}u{size}").tobytes()
    if predictor == 3:
        # Bytes of the same significance lie together, the most significant ones first.
        planes = block.astype(block.dtype.newbyteorder(">")).reshape(rows, columns * samples).view("u1")
        planes = np.ascontiguousarray(planes.reshape(rows, columns * samples, size).transpose(0, 2, 1)).reshape(rows, -1)
        differences = planes.copy()
        differences[:, samples:] -= planes[:, :-samples]
        return differences.tobytes()
    return np.ascontiguousarray(block.astype(block.dtype.newbyteorder(order))).tobytes()


class Tiff:
    """A file that is written from front to back, and its directories linked at the end."""

    def __init__(self, one, order, big):
        self.one, self.order, self.big = one, order, big
        self.out = bytearray((b"II" if order == "<" else b"MM") + (
            struct.pack(order + "HHHQ", 43, 8, 0, 0) if big else struct.pack(order + "HI", 42, 0)))

    def number(self, letter, value):
        return struct.pack(self.order + letter, value)

    def align(self):
        if len(self.out) % 2 or self.one.chance(0.1):
            self.out += b"\0" * (2 - len(self.out) % 2)

    def blocks(self, page):
        """Offsets and lengths of the strips or tiles of [height, width, samples]."""
        data, rows, columns = page["data"], page["rows"], page.get("columns")
        height, width, samples = data.shape
        parts = []
        for plane in ([data[..., s:s + 1] for s in range(samples)] if page["planar"] == 2 else [data]):
            for y in range(0, height, min(rows, height)):
                for x in range(0, width, columns or width):
                    block = plane[y:y + rows, x:x + (columns or width)]
                    if columns:
                        whole = np.zeros((rows, columns, plane.shape[2]), data.dtype)
                        if self.one.chance(0.5):
                            whole[...] = 1
                        whole[:block.shape[0], :block.shape[1]] = block
                        block = whole
                    parts.append(np.ascontiguousarray(block))
        places = [None] * len(parts)
        order = list(range(len(parts)))
        if self.one.chance(0.3):
            self.one.random.shuffle(order)
        for i in order:
            blob = predicted(parts[i], page["predictor"], self.order)
            blob = packed(page["compression"], blob, len(blob) // parts[i].shape[0])
            if page.get("fill_order") == 2:
                blob = bytes(int(f"{b:08b}"[::-1], 2) for b in blob)
            self.align()
            places[i] = (len(self.out), len(blob))
            self.out += blob
        return [p[0] for p in places], [p[1] for p in places]

    def tags(self, page, places):
        """{tag: (type, numbers or bytes)}. What is the default may be left out."""
        pick, data = self.one.pick, page["data"]
        height, width, samples = data.shape
        size = lambda: pick(3, 4)  # noqa: E731
        offset = pick(4, 16) if self.big else 4
        count = lambda most: pick(3, 4) if most < 65536 else 4  # noqa: E731
        offsets, lengths = places
        tags = {256: (size(), [width]), 257: (size(), [height]), 258: (3, [8 * data.dtype.itemsize] * samples),
                262: (3, [page["photometric"]])}
        optional = {259: (3, [page["compression"]], 1), 277: (3, [samples], 1), 284: (3, [page["planar"]], 1),
                    317: (3, [page["predictor"]], 1), 266: (3, [page.get("fill_order", 1)], 1), 254: (4, [page.get("kind", 0)], 0),
                    274: (3, [page.get("orientation", 1)], 1)}
        for tag, (kind, values, default) in optional.items():
            if values != [default] or self.one.chance(0.5):
                tags[tag] = (kind, values)
        sample_format = page.get("format", FORMATS[data.dtype.kind])
        if sample_format != 1 or self.one.chance(0.5):
            tags[339] = (3, [sample_format] * samples)
        if samples > (3 if page["photometric"] == 2 else 1):
            tags[338] = (3, [0] * (samples - (3 if page["photometric"] == 2 else 1)))
        if page.get("columns"):
            tags[322], tags[323] = (size(), [page["columns"]]), (size(), [page["rows"]])
            tags[324], tags[325] = (offset, offsets), (count(max(lengths)), lengths)
        else:
            tags[273], tags[279] = (offset, offsets), (count(max(lengths)), lengths)
            if page["rows"] < height or self.one.chance(0.7):
                tags[278] = (4, [page["rows"]]) if page["rows"] > 65535 else (size(), [page["rows"]])
        if page["photometric"] == 3:
            tags[320] = (3, self.one.random.integers(0, 65536, 3 * 2 ** (8 * data.dtype.itemsize)).tolist())
        for tag, value in page.get("tags", {}).items():
            tags[tag] = value
        return tags

    def directory(self, page, places):
        """Writes one; its offset, and where the next one's is to be."""
        tags = self.tags(page, places)
        if page.get("below"):
            offsets = [self.directory(p, self.blocks(p))[0] for p in page["below"]]
            tags[330] = (self.one.pick(13, 4) if not self.big else self.one.pick(18, 16), offsets)
        entries = b""
        inline = 8 if self.big else 4
        for tag in sorted(tags):
            kind, values = tags[tag]
            if kind == 5:
                value = b"".join(struct.pack(self.order + "II", *v) for v in values)
                number = len(values)
            elif isinstance(values, bytes):
                value, number = values, len(values)
            else:
                value = struct.pack(f"{self.order}{len(values)}{LETTERS[kind]}", *values)
                number = len(values)
            if len(value) > inline:
                self.align()
                at = len(self.out)
                self.out += value
                value = self.number("Q" if self.big else "I", at)
            entries += struct.pack(self.order + ("HHQ" if self.big else "HHI"), tag, kind, number) + value.ljust(inline, b"\0")
        self.align()
        at = len(self.out)
        self.out += self.number("Q" if self.big else "H", len(tags)) + entries
        following = len(self.out)
        self.out += self.number("Q" if self.big else "I", 0)
        return at, following

    def write(self, path, pages):
        """Directories behind or before their numbers, in any order in the file."""
        places = [None] * len(pages)
        if self.one.chance(0.5):
            for i, page in enumerate(pages):
                places[i] = self.blocks(page)
        order = list(range(len(pages)))
        if self.one.chance(0.3):
            self.one.random.shuffle(order)
        written = {}
        for i in order:
            written[i] = self.directory(pages[i], places[i] or self.blocks(pages[i]))
        letter = "Q" if self.big else "I"
        link = 8 if self.big else 4
        for i in range(len(pages)):
            at, following = written[i]
            struct.pack_into(self.order + letter, self.out, link, at)
            link = following
        path.write_bytes(self.out)
