"""Stacks of PNG and BMP files: by Pillow, and by writers after the specifications. Pillow judges each file."""
import struct
import zlib

import numpy as np
from PIL import Image

import attack
from arrays.expect import check
from arrays.tiff_files import natural_names

ADAM7 = [(0, 0, 8, 8), (0, 4, 8, 8), (4, 0, 8, 4), (0, 2, 4, 4), (2, 0, 4, 2), (0, 1, 2, 2), (1, 0, 2, 1)]


def bits_of(row, bits):
    """Numbers of 1, 2, 4, 8 or 16 bits, the highest bit first."""
    if bits >= 8:
        return row.astype(">u2" if bits == 16 else "u1").tobytes()
    text = "".join(format(int(v), f"0{bits}b") for v in row.ravel())
    size = -(-len(text) // 8)
    return int(text.ljust(size * 8, "0"), 2).to_bytes(size, "big") if size else b""


def filtered(one, rows, step):
    """PNG's filters 0 to 4, another one for each row."""
    out, above = b"", None
    for row in rows:
        row = np.frombuffer(row, "u1").astype(int)
        above = np.zeros_like(row) if above is None else above
        left, corner = (np.concatenate([np.zeros(min(step, len(row)), int), part[:-step]])[:len(row)] for part in (row, above))
        near = left + above - corner
        a, b, c = abs(near - left), abs(near - above), abs(near - corner)
        paeth = np.where((a <= b) & (a <= c), left, np.where(b <= c, above, corner))
        way = int(one.random.integers(5))
        out += bytes([way]) + ((row - (0 * row, left, above, (left + above) // 2, paeth)[way]) % 256).astype("u1").tobytes()
        above = row
    return out


def png(one, grey, bits, channels):
    """grey: [height, width]. channels: 1, 2 (solid), 3 or 4."""
    def chunk(kind, body):
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))
    pixels = np.repeat(grey[..., None], channels, -1)
    if channels in (2, 4):
        pixels[..., -1] = 2**bits - 1
    interlaced = one.chance(0.3)
    step = max(1, channels * bits // 8)
    body = b"".join(filtered(one, [bits_of(row, bits) for row in part], step) for part in
                    (pixels[y::dy, x::dx] for y, x, dy, dx in (ADAM7 if interlaced else [(0, 0, 1, 1)])) if part.size)
    body = zlib.compress(body, one.pick(0, 1, 9))
    cut = int(one.random.integers(len(body) + 1))
    parts = [(b"gAMA", struct.pack(">I", 45455)), (b"pHYs", struct.pack(">IIB", 2835, 100, 1)), (b"tEXt", b"Title\0words")]
    middle = b"".join(chunk(*part) for part in parts if one.chance(0.2))
    return (b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", grey.shape[1], grey.shape[0], bits, {1: 0, 2: 4, 3: 2, 4: 6}[channels],
                                                             0, 0, interlaced)) + middle
            + (chunk(b"IDAT", body[:cut]) + chunk(b"IDAT", body[cut:]) if one.chance(0.5) else chunk(b"IDAT", body)) + chunk(b"IEND", b""))


def bmp(one, grey, bits):
    """grey: [height, width] of bytes, or for less than 9 bits numbers of a palette, whose greys come back."""
    palette, shown = b"", grey
    if bits <= 8:
        table = one.random.integers(0, 256, 2**bits).astype("u1") if one.chance(0.5) else (np.arange(2**bits) * 255 // (2**bits - 1)).astype("u1")
        shown = table[grey]
        palette = np.stack([table] * 3 + [table * 0], -1).tobytes()
    top_down, header, gap = one.chance(0.3), one.pick(40, 40, 108, 124), one.pick(0, 0, 2, 100)
    rows = b""
    for row in grey if top_down else grey[::-1]:
        packed = bits_of(row, bits) if bits <= 8 else np.repeat(row[:, None], bits // 8, -1).astype("u1").tobytes()
        rows += packed + one.random.bytes(-len(packed) % 4)
    start = 14 + header + len(palette) + gap
    height = -len(grey) if top_down else len(grey)
    return (struct.pack("<2sIHHI", b"BM", start + len(rows), 0, 0, start)
            + struct.pack("<IiiHHIIiiII", header, grey.shape[1], height, 1, bits, 0, one.pick(0, len(rows)), 2835, 2835, one.pick(0, 2**bits if bits <= 8 else 0), 0)
            + bytes(header - 40) + palette + bytes(gap) + rows), shown


def sizes(one):
    return int(one.random.integers(1, 8)), int(one.random.integers(1, one.pick(4, 20))), int(one.random.integers(1, one.pick(4, 20)))


def store_of(one, images, shown, ending, refused):
    """Writes the files, in a folder or a list, and compares."""
    folder = one.folder / one.pick("stack", "a b", "x.png")
    folder.mkdir()
    files = [folder / (name + ending) for name in natural_names(one, len(images))]
    for file, image in zip(files, images):
        file.write_bytes(image)
    if one.chance(0.3):
        (folder / "notes.txt").write_text("words")
        (folder / f".hidden{ending}").write_bytes(b"nothing")
    order = [files[i] for i in one.random.permutation(len(files))]
    path = folder if one.chance(0.5) else order if len(order) > 1 else order[0]
    return files, check(one, path, shown, refused=refused)


def png_slices(one):
    shape = sizes(one)
    channels = one.pick(1, 1, 1, 2, 3, 4)
    bits = one.pick(8, 8, 16) if channels > 1 else one.pick(1, 2, 4, 8, 8, 16)
    data = one.random.integers(0, 2**bits, shape)
    images, shown, refused = [png(one, plane, bits, channels) for plane in data], data.astype("u2" if bits == 16 else "u1"), None
    what = one.pick("good", "good", "good", "good", "few bits", "size", "palette", "pillow")
    at = int(one.random.integers(len(data)))
    if what == "few bits" and bits == 8 and channels == 1 and len(data) > 1:
        images[at], shown[at] = png(one, data[at] % 2, 1, 1), data[at] % 2 * 255
    elif what == "size" and len(data) > 1:
        images[at], refused = png(one, np.concatenate([data[at], data[at][-1:]]), bits, channels), "one size and type"
    elif what == "palette" or what == "pillow":
        images = []
        for i, plane in enumerate(shown if bits == 8 else shown.astype("u1")):
            image = Image.fromarray(plane)
            file = one.folder / "one.png"
            (image.convert("P") if what == "palette" and i == at else image).save(file)
            images.append(file.read_bytes())
        shown, refused = shown.astype("u1"), "palette" if what == "palette" else None
    if refused is None:
        for image, plane in zip(images, shown):
            judge(one, image, plane, bits)
    return store_of(one, images, shown, one.pick(".png", ".PNG"), refused)[1]


def judge(one, image, plane, bits):
    """Pillow shows most numbers of less than 8 bits in the range of 8."""
    file = one.folder / "judged"
    file.write_bytes(image)
    found = np.asarray(Image.open(file))
    file.unlink()
    found = (found[..., 0] if found.ndim == 3 else found).astype(int)
    # Colours of 16 bits become those of 8, and truth values are 0 and 1.
    factors = [1] + ([255] if plane.max(initial=0) > 1 else []) + ([1 / (255 // (2**bits - 1))] if bits < 8 else [])
    if not any(np.array_equal(found * factor, plane) for factor in factors) and not (bits == 16 and np.array_equal(found, plane >> 8)):
        raise AssertionError(f"Pillow reads {found.ravel()[:9]}, not {plane.ravel()[:9]}")


def bmp_slices(one):
    shape = sizes(one)
    bits = one.pick(1, 4, 8, 8, 24, 32)
    data = one.random.integers(0, 2**min(bits, 8), shape)
    made = [bmp(one, plane, bits) for plane in data]
    images, shown = [image for image, _ in made], np.stack([grey for _, grey in made]).astype("u1")
    for image, plane in zip(images, shown):
        if bits != 32:
            file = one.folder / "judged"
            file.write_bytes(image)
            np.testing.assert_array_equal(np.asarray(Image.open(file).convert("L")), plane)
    refused, at = None, int(one.random.integers(len(data)))
    if one.chance(0.15):
        broken = bytearray(images[at])
        what = one.pick("compression", "cut", "size")
        if what == "compression":
            broken[30] = one.pick(1, 2)
        elif what == "cut":
            del broken[-1 - int(one.random.integers(4)):]
        else:
            broken[18] += 1
        images[at] = bytes(broken)
        refused = {"compression": "compression", "cut": "do not lie", "size": ""}[what]
        if what == "size" and len(data) == 1:
            refused = "may: "
    return store_of(one, images, shown, one.pick(".bmp", ".BMP"), refused)[1] if refused != "may: " else attack.SAME
