#!/usr/bin/env python3
"""Stacks of PNG and BMP slices as written by Pillow and libpng, and files by a writer in this test.

usage: slices_input_test.py ISONEST PLUGIN_FOLDER
"""
import pathlib
import shutil
import struct
import subprocess
import sys
import unittest
import zlib

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served  # noqa: E402

try:
    import numpy as np
    from PIL import Image
    from volume_inputs import ISONEST, RANDOM, DamagedFiles, Input, numbers
except ImportError as error:
    print(f"skipped: {error}")
    sys.exit(77)


def png(data, color, bits, interlaced=False, chunks=()):
    """A PNG file by its specification. data: rows of samples, all channels of a pixel together."""
    def chunk(kind, body):
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    def rows(part):
        lines = b""
        for row in part:
            if bits == 16:
                packed = row.astype(">u2").tobytes()
            elif bits == 8:
                packed = row.astype("u1").tobytes()
            else:
                text = "".join(format(v, f"0{bits}b") for v in row.ravel())
                packed = int(text.ljust(-(-len(text) // 8) * 8, "0"), 2).to_bytes(-(-len(text) // 8), "big")
            lines += b"\0" + packed
        return lines
    passes = [(0, 0, 8, 8), (0, 4, 8, 8), (4, 0, 8, 4), (0, 2, 4, 4), (2, 0, 4, 2), (0, 1, 2, 2), (1, 0, 2, 1)] if interlaced else [(0, 0, 1, 1)]
    body = b"".join(rows(data[y::dy, x::dx]) for y, x, dy, dx in passes if data[y::dy, x::dx].size)
    return (b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", data.shape[1], data.shape[0], bits, color, 0, 0, interlaced)) +
            b"".join(chunk(*c) for c in chunks) + chunk(b"IDAT", zlib.compress(body)) + chunk(b"IEND", b""))


def bmp(data, bits=8, palette=None, top_down=False, header=40, compression=0, gap=0, used=0):
    """A BMP file by its definition. data: rows of numbers, or of blue, green, red (and one more)."""
    palette = b"" if bits > 8 else np.repeat(np.arange(2**bits), 4).astype("u1").tobytes() if palette is None else palette
    rows = b""
    for row in data if top_down else data[::-1]:
        if bits < 8:
            text = "".join(format(v, f"0{bits}b") for v in row)
            packed = int(text.ljust(-(-len(text) // 8) * 8, "0"), 2).to_bytes(-(-len(text) // 8), "big")
        else:
            packed = row.astype("u1").tobytes()
        rows += packed + b"\7" * (-len(packed) % 4)
    start = 14 + header + len(palette) + gap
    size = -len(data) if top_down else len(data)
    head = struct.pack("<2sIHHI", b"BM", start + len(rows), 0, 0, start)
    info = struct.pack("<IiiHHIIiiII", header, len(data[0]), size, 1, bits, compression, len(rows), 2835, 2835, used, 0)
    return head + info + bytes(header - 40) + palette + bytes(gap) + rows


class Slices(DamagedFiles, Input):
    def stack(self, images, ending, name=lambda i: f"s{i}"):
        """A folder of files, each given as bytes or as an image of Pillow's."""
        folder = self.here / "stack"
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
        for i, image in enumerate(images):
            path = folder / f"{name(i)}.{ending}"
            path.write_bytes(image) if isinstance(image, bytes) else image.save(path)
        self.path = folder
        return sorted(folder.iterdir())

    def test_stacks_of_pillows(self):
        for kind, ending in (("u1", "png"), ("u2", "png"), ("u1", "bmp")):
            with self.subTest(kind=kind, ending=ending):
                data = numbers((12, 7, 9), kind)
                files = self.stack([Image.fromarray(plane) for plane in data], ending)
                for i, plane in enumerate(data):
                    np.testing.assert_array_equal(np.asarray(Image.open(self.path / f"s{i}.{ending}")), plane)
                done = self.reads(data)
                self.assertIn("the file does not give the spacing;", done.stdout + done.stderr)
                self.lies((0, 0, 0), (1, 1, 1))
                done = served.run([ISONEST, "preprocess", *files, "-o", self.here / "s.isonest", "--chunk", "8", "--force"],
                                  capture_output=True, text=True)
                self.assertEqual(done.returncode, 0, done.stderr)
                done = served.run([ISONEST, "check", self.here / "s.isonest", "--source", self.path], capture_output=True, text=True)
                self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
                before = files[3].read_bytes()
                self.assertEqual(self.preprocess(store=files[3]).returncode, 2)
                self.assertEqual(files[3].read_bytes(), before)
                (self.path / "s5.txt").write_text("notes")
                self.reads(np.ascontiguousarray(data[2:9, 1:, :-2]), "--crop", ":-2,1:,2:9")
                self.path = files[0]
                self.reads(data[:1])

    def test_pngs_of_all_kinds(self):
        for bits in (1, 2, 4, 8, 16):
            for color, channels in ((0, 1), (4, 2), (2, 3), (6, 4)):
                if bits < 8 and color:
                    continue
                for interlaced, width in ((False, 9), (True, 9), (True, 1), (False, 1), (True, 3)):
                    with self.subTest(bits=bits, color=color, interlaced=interlaced, width=width):
                        data = RANDOM.integers(0, 2**bits, (3, 11, width)).astype("u2" if bits == 16 else "u1")
                        pixels = np.stack([np.repeat(plane[..., None], channels, -1) for plane in data])
                        if color >= 4:
                            pixels[..., -1] = 2**bits - 1
                        self.stack([png(plane, color, bits, interlaced) for plane in pixels], "png")
                        self.reads(data)
                        if color:
                            pixels[1, 5, width - 1, -1] ^= 1  # coloured, or not opaque
                            self.stack([png(plane, color, bits, interlaced) for plane in pixels], "png")
                            self.refuses(5, "s1.png", f"pixel ({width - 1}, 5)", "convert")
        # Gamma, transparency and the print resolution do not change the numbers.
        extra = ((b"gAMA", struct.pack(">I", 45455)), (b"pHYs", struct.pack(">IIB", 2835, 2835, 1)), (b"tRNS", struct.pack(">H", 3)))
        data = numbers((2, 5, 6), "u1")
        self.stack([png(plane, 0, 8, chunks=extra) for plane in data], "png")
        self.reads(data)
        self.lies((0, 0, 0), (1, 1, 1))

    def test_slices_that_were_stored_with_fewer_bits(self):
        """A program that minimises files stores a plane of 0 and 255 with one bit."""
        data = numbers((4, 5, 6), "u1")
        data[1], data[2], data[3] = (data[1] > 99) * 255, data[2] % 4 * 85, data[3] % 16 * 17
        self.stack([png(plane // factor, 0, bits) for plane, bits, factor in zip(data, (8, 1, 2, 4), (1, 255, 85, 17))], "png")
        for i, plane in enumerate(data):
            np.testing.assert_array_equal(np.asarray(Image.open(self.path / f"s{i}.png").convert("L")), plane)
        done = self.reads(data)
        self.assertIn("scaled to 0 to 255", done.stdout + done.stderr)

    def test_bmps_of_all_kinds(self):
        for bits in (1, 4, 8, 24, 32):
            for top_down in (False, True):
                for header, width in ((40, 1), (108, 5), (124, 8), (40, 9)):
                    with self.subTest(bits=bits, top_down=top_down, header=header, width=width):
                        if bits > 8:
                            grey = RANDOM.integers(0, 256, (3, 7, width)).astype("u1")
                            rows = np.repeat(grey[..., None], bits // 8, -1)
                            files = [bmp(plane, bits, top_down=top_down, header=header) for plane in rows]
                        else:
                            rows = RANDOM.integers(0, 2**bits, (3, 7, width))
                            table = RANDOM.integers(0, 256, 2**bits).astype("u1")
                            palette = np.stack([table] * 3 + [table * 0], -1).tobytes()
                            grey = table[rows]
                            files = [bmp(plane, bits, palette, top_down, header, gap=3) for plane in rows]
                        self.stack(files, "bmp")
                        if bits != 32:
                            np.testing.assert_array_equal(np.asarray(Image.open(self.path / "s1.bmp").convert("L")), grey[1])
                        self.reads(grey)
                        if bits > 8:
                            rows[2, 3, 0, 1] ^= 1
                            self.stack([bmp(plane, bits, top_down=top_down, header=header) for plane in rows], "bmp")
                            self.refuses(5, "s2.bmp", "pixel (0, 3)")

    def test_what_is_no_stack_of_one_size_is_refused(self):
        data = numbers((4, 5, 6), "u1")
        good = [Image.fromarray(plane) for plane in data]
        for other in (Image.fromarray(data[0, :4]), Image.fromarray(data[0, :, :5]), Image.fromarray(data[0].astype("u2"))):
            self.stack([*good[:2], other, good[3]], "png")
            self.refuses(5, "s2.png", "same size and type")
        self.stack([*good, Image.fromarray(data[0]).convert("P")], "png")
        self.refuses(5, "s4.png", "palette", "convert")
        self.stack([*good, png(data[0], 0, 8)[:-30]], "png")
        self.refuses(4, "s4.png", "cut short")
        self.stack([*good, b"not a picture"], "png")
        self.refuses(4, "s4.png")
        self.refuses(2, "'index'", options=("--index", "z=1"))
        whole = bmp(data[0])
        colours = np.arange(1024).astype("u1").tobytes()
        for file, code, word in ((bmp(data[0], palette=colours), 5, "palette is not grey"), (bmp(data[0], compression=1), 5, "compression 1"),
                                 (bmp(data[0], header=64), 5, "header of 64"), (whole[:-1], 4, "beyond the end"), (whole[:40], 4, "cut short"),
                                 (bmp(data[0], used=257), 4, "palette of 257"), (bmp(data[0] % 4, used=3), 4, "not in the palette"),
                                 (whole[:10] + struct.pack("<I", 100) + whole[14:], 4, "beyond the end"),
                                 (whole[:18] + struct.pack("<i", -6) + whole[22:], 4, "pixels"),
                                 (whole[:22] + struct.pack("<i", -2**31) + whole[26:], 4, "pixels"),
                                 (whole[:28] + struct.pack("<H", 16) + whole[30:], 5, "16 bits")):
            with self.subTest(word=word):
                self.stack([whole, file], "bmp")
                self.refuses(code, "s1.bmp", word)
        self.stack([png(np.zeros((3000, 3000), "u1"), 0, 8)], "png")
        self.refuses(7, "does not fit in memory", options=("--memory", "24M"))

    def test_damaged_files(self):
        data = numbers((20, 17), "u1")
        self.path = self.here / "v.png"
        self.damaged(png(data, 0, 8))
        self.path = self.here / "v.bmp"
        self.damaged(bmp(data))

    def test_pngs_of_other_programs(self):
        if shutil.which("pnmtopng") is None:
            self.skipTest("no pnmtopng (Debian: netpbm)")
        data = numbers((7, 9), "u2")
        (self.here / "v.pgm").write_bytes(b"P5 9 7 65535\n" + data.astype(">u2").tobytes())
        self.path = self.here / "v.png"
        self.path.write_bytes(subprocess.run(["pnmtopng", "-interlace", self.here / "v.pgm"], check=True, capture_output=True).stdout)
        self.reads(data[None])


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
