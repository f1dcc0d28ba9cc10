"""`isonest picture`: what it draws.

Usage: cli_pictures_test.py ISONEST PLUGIN_FOLDER
"""
import base64
import json
import os
import pathlib
import re
import struct
import sys
import unittest
import zlib

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
from cli_case import CliCase, run  # noqa: E402


def read_png(path):
    """(width, height, rows of RGB bytes) of an 8-bit RGB PNG; checks every checksum."""
    data = path.read_bytes()
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    at, pixels = 8, b""
    while at < len(data):
        size, kind = struct.unpack(">I4s", data[at:at + 8])
        body = data[at + 8:at + 8 + size]
        assert zlib.crc32(kind + body) == struct.unpack(">I", data[at + 8 + size:at + 12 + size])[0]
        if kind == b"IHDR":
            width, height, depth, color = struct.unpack(">IIBB", body[:10])
            assert (depth, color) == (8, 2)
        if kind == b"IDAT":
            pixels += body
        at += 12 + size
    raw, rows, stride = zlib.decompress(pixels), [], 3 * width
    above = bytearray(stride)
    for y in range(height):
        kind, row = raw[y * (stride + 1)], bytearray(raw[y * (stride + 1) + 1:(y + 1) * (stride + 1)])
        for i in range(stride):
            a = row[i - 3] if i >= 3 else 0
            b, c = above[i], above[i - 3] if i >= 3 else 0
            p = a + b - c
            paeth = min((abs(p - a), 0, a), (abs(p - b), 1, b), (abs(p - c), 2, c))[2]
            row[i] = (row[i] + (0, a, b, (a + b) // 2, paeth)[kind]) & 255
        rows.append(bytes(row))
        above = row
    return width, height, rows


def colours(rows):
    return {row[i:i + 3] for row in rows for i in range(0, len(row), 3)}


class Pictures(CliCase):
    def test_a_picture_shows_the_mesh_in_its_middle(self):
        self.ok("picture", "b.ply", "-o", "p.png", "--size", "120x90")
        width, height, rows = read_png(self.here / "p.png")
        self.assertEqual((width, height), (120, 90))
        background = rows[0][:3]
        self.assertGreater(min(background), 200)
        ink = [(x, y) for y, row in enumerate(rows) for x in range(width)
               if row[3 * x:3 * x + 3] != background]
        self.assertGreater(len(colours(rows)), 50)  # it is shaded
        for axis, size in ((0, width), (1, height)):
            lo, hi = (f(p[axis] for p in ink) for f in (min, max))
            self.assertAlmostEqual(lo + hi, size - 1, delta=0.08 * size)
            self.assertGreater(lo, 0)
            self.assertLess(hi, size - 1)
        self.assertGreater(max(p[1] for p in ink) - min(p[1] for p in ink), 0.8 * height)
        first = (self.here / "p.png").read_bytes()
        self.ok("picture", "b.ply", "-o", "p.png", "--size", "120x90")
        self.assertEqual((self.here / "p.png").read_bytes(), first)
        for option in ("--wireframe", "--flat", "--view=0,0,-1", "--color=250,10,10"):
            self.ok("picture", "b.ply", "-o", "p.png", "--size", "120x90", option)
            self.assertNotEqual((self.here / "p.png").read_bytes(), first, option)
        (self.here / "p.png").unlink()

    def test_every_mesh_format_is_drawn_alike(self):
        options = ["--size", "90x70", "--plain"]
        self.ok("picture", "b.ply", "-o", "p.png", *options)
        smooth = (self.here / "p.png").read_bytes()
        self.ok("picture", "b.ply", "-o", "p.png", *options, "--flat")
        flat = (self.here / "p.png").read_bytes()
        for end in ("obj", "glb", "3mf", "vtp", "vtkhdf", "ngmesh", "stl"):
            mesh = self.here / f"m.{end}"
            self.ok("extract", "b.isonest", "--iso", "0.5", "-o", mesh)
            before = set(self.here.iterdir())
            self.ok("picture", mesh, "-o", "p.png", *options)
            self.assertEqual((self.here / "p.png").read_bytes(), flat if end == "stl" else smooth, end)
            self.assertEqual(set(self.here.iterdir()), before)
            whole = mesh.read_bytes()
            for cut in (0, 3, 20, 200, len(whole) // 2, len(whole) - 100):
                mesh.write_bytes(whole[:cut])
                done = run("picture", mesh, "-o", "p.png", *options, cwd=self.here)
                # A text format that ends at the end of a line is complete for its reader; so are numbers.
                fine = (0, 4, 5) if end in ("obj", "ngmesh") else (2, 4, 5)
                self.assertIn(done.returncode, fine, (end, cut, done.stderr))
            mesh.unlink()
        # As written by versions before 0.5.
        self.ok("extract", "b.isonest", "--iso", "0.5", "-o", "m.vtp")
        text, appended = (self.here / "m.vtp").read_text(), b""
        for array in re.findall(r'format="binary">\n.*?</DataArray>', text, re.DOTALL):
            text = text.replace(array, f'format="appended" offset="{len(appended)}"/>')
            appended += base64.b64decode(array.split("\n")[1])
        head, tail = text.split("</VTKFile>")
        (self.here / "m.vtp").write_bytes(f'{head}<AppendedData encoding="raw">\n_'.encode() + appended +
                                          f"\n</AppendedData>\n</VTKFile>{tail}".encode())
        self.ok("picture", "m.vtp", "-o", "p.png", *options)
        self.assertEqual((self.here / "p.png").read_bytes(), smooth)
        (self.here / "m.vtp").unlink()
        for end in ("ply", "glb", "vtp", "vtkhdf"):
            self.ok("extract", "b.isonest", "--iso", "0.5", "--error", "0.05", "-o", f"v.{end}", "--vertex-values", "b.isonest")
            shown = self.json("picture", f"v.{end}", "-o", "p.png", *options)
            self.assertEqual(shown.get("range"), self.json("picture", "v.ply", "-o", "p.png", *options).get("range"), end)
        for file in self.here.glob("v.*"):
            file.unlink()
        (self.here / "p.png").unlink()

    def test_hostile_meshes_take_little_memory(self):
        mesh = self.here / "h.glb"
        for text, words in ((b"[" * 3000000, "64 levels"), (b'{"a":[' + b"0," * 2000000 + b"0]}", "1000000 values")):
            mesh.write_bytes(b"glTF" + struct.pack("<III", 2, len(text) + 20, len(text)) + b"JSON" + text)
            self.assertIn(words, self.fails(4, "picture", "h.glb", "-o", "p.png"))
        mesh.unlink()
        mesh = self.here / "h.obj"
        for face in (b"c" * (8 << 20), b"f " + b"1 " * (4 << 20)):
            mesh.write_bytes(b"v 0 0 0\n" * 3 + face + b"\n")
            self.assertIn("line 4 has more than 1048576", self.fails(4, "picture", "h.obj", "-o", "p.png"))
        mesh.unlink()

    def test_a_mesh_that_is_no_file_is_not_waited_for(self):
        for name in ("p.ply", "p.stl", "p.obj", "p.glb", "p.3mf", "p.vtp"):
            os.mkfifo(self.here / name)
            self.assertIn(f"{name}: not a regular file", self.fails(2, "picture", name, "-o", "p.png"))

    def test_larger_pictures_have_a_scale_bar_and_directions(self):
        pictures = []
        for options in ((), ("--plain",)):
            self.ok("picture", "b.ply", "-o", "p.png", "--size", "260x250", *options)
            pictures.append(read_png(self.here / "p.png")[2])
        noted, plain = pictures
        background = plain[0][:3]
        corner = [[row[3 * x:3 * x + 3] for row in picture[200:] for x in range(50)] for picture in pictures]
        self.assertEqual(set(corner[1]), {background})
        self.assertGreater(len([pixel for pixel in corner[0] if pixel != background]), 40)
        (self.here / "p.png").unlink()

    def test_views_by_name_and_by_angles_are_directions(self):
        def picture(view):
            self.ok("picture", "b.ply", "-o", "p.png", "--size", "60x50", "--view=" + view)
            return (self.here / "p.png").read_bytes()

        for name, angles, direction in (("front", "0,0", "0,-1,0"), ("right", "90,0", "1,0,0"), ("back", "180,0", "0,1,0"),
                                        ("left", "-90,0", "-1,0,0"), ("top", "0,90", "0,0,1"),
                                        ("bottom", "0,-90", "0,0,-1")):
            self.assertEqual(picture(name), picture(direction), name)
            if name in ("front", "top", "bottom"):  # cosines of right angles are not exactly 0
                self.assertEqual(picture(name), picture(angles), name)
        self.assertNotEqual(picture("front"), picture("iso"))
        self.fails(2, "picture", "b.ply", "-o", "p.png", "--view", "sideways")
        (self.here / "p.png").unlink()

    def test_a_turntable_begins_with_the_view_at_one_scale(self):
        self.ok("picture", "b.ply", "-o", "t.png", "--size", "60x50", "--turntable", "5", "--view", "10,20")
        names = [self.here / f"t_{i:03}.png" for i in range(5)]
        self.assertFalse((self.here / "t.png").exists())
        self.assertEqual(len({name.read_bytes() for name in names}), 5)
        for name in names:
            self.assertEqual(read_png(name)[:2], (60, 50))
            name.unlink()

    def test_values_and_colours_of_vertices_are_seen(self):
        def ply(name, properties, dtype, columns):
            rows = [(0, 0, 0), (1, 0, 0), (1, 0, 1), (0, 0, 1)]
            body = b"".join(struct.pack("<fff" + dtype, *row, *column) for row, column in zip(rows, columns))
            faces = b"".join(struct.pack("<Biii", 3, *f) for f in ((0, 1, 2), (0, 2, 3)))
            header = ("ply\nformat binary_little_endian 1.0\nelement vertex 4\nproperty float x\nproperty float y\n"
                      f"property float z\n{properties}element face 2\nproperty list uchar int vertex_indices\nend_header\n")
            (self.here / name).write_bytes(header.encode() + body + faces)

        def corners(name, *options):
            self.ok("picture", name, "-o", "p.png", "--size", "60x60", "--view", "front", "--plain", *options)
            _, _, rows = read_png(self.here / "p.png")
            return [tuple(rows[y][3 * x:3 * x + 3]) for x, y in ((8, 51), (51, 51), (51, 8), (8, 8))]

        ply("rgb.ply", "property uchar red\nproperty uchar green\nproperty uchar blue\n", "BBB",
            [(255, 0, 0), (0, 255, 0), (0, 0, 255), (255, 255, 0)])
        red, green, blue, yellow = corners("rgb.ply")
        self.assertTrue(red[0] > 2 * max(red[1:]) and green[1] > 2 * max(green[0], green[2]) and blue[2] > 2 * max(blue[:2])
                        and min(yellow[:2]) > 2 * yellow[2], (red, green, blue, yellow))
        plain = corners("rgb.ply", "--color-by", "none")
        self.assertEqual(len(set(plain)), 1)
        ply("value.ply", "property float value\n", "f", [(0,), (5,), (5,), (0,)])
        low, high, _, _ = corners("value.ply", "--colors", "gray")
        self.assertLess(max(low), 0.5 * min(high))
        low, high, _, _ = corners("value.ply", "--colors", "gray_r")
        self.assertGreater(min(low), 2 * max(high))
        self.assertEqual(self.json("picture", "value.ply", "-o", "p.png")["range"], [0, 5])
        self.assertEqual(self.json("picture", "value.ply", "-o", "p.png", "--range=-1,9")["range"], [-1, 9])
        self.fails(2, "picture", "value.ply", "-o", "p.png", "--colors", "nice")
        self.fails(3, "picture", "value.ply", "-o", "p.png", "--color-by", "error")
        for name in ("rgb.ply", "value.ply", "p.png"):
            (self.here / name).unlink()

    def test_a_mesh_far_from_0_says_how_much_its_coordinates_are_rounded(self):
        self.assertLess(self.json("extract", "b.isonest", "--iso", "0.5", "-o", "b.ply")
                        ["coordinate_rounding"], 1e-5)
        self.ok("preprocess", "b.h5", "-o", "far.isonest", "--spacing", "0.25,1,1", "--origin",
                "5e6,0,0")
        done = self.ok("extract", "far.isonest", "--iso", "0.5", "-o", "far.ply", "--json")
        self.assertEqual(json.loads(done.stdout)["coordinate_rounding"], 1)  # half of 0.5, divided by 0.25
        self.assertIn(b"isonest: warning: far.ply: its coordinates", done.stderr)
        (self.here / "far.isonest").unlink()
        (self.here / "far.ply").unlink()

    def test_shading_falls_back_to_flat_where_memory_is_short(self):
        self.assertEqual(self.json("picture", "b.ply", "-o", "p.png")["shading"], "smooth")
        # Enough for OSMesa and the smallest strip of 10 pixels, but not for normals (tools/drawing/picture.cpp).
        least = (94 << 20) + 10 * 91 * (32 + 2)
        flat = self.json("picture", "b.ply", "-o", "p.png", "--size", "10x10", "--memory", least)
        self.assertEqual(flat["shading"], "flat")
        (self.here / "p.png").unlink()

    def test_an_empty_mesh_gives_the_background_and_a_warning(self):
        self.ok("extract", "b.isonest", "--iso", "99", "-o", "empty.ply")
        done = self.ok("picture", "empty.ply", "-o", "p.png", "--size", "7x5")
        self.assertIn(b"isonest: warning: ", done.stderr)
        width, height, rows = read_png(self.here / "p.png")
        self.assertEqual((width, height, len(colours(rows))), (7, 5, 1))
        (self.here / "p.png").unlink()
        (self.here / "empty.ply").unlink()


if __name__ == "__main__":
    unittest.main(argv=[sys.argv[0], *sys.argv[3:]], verbosity=1)
