#!/usr/bin/env python3
"""NRRD files as other programs write them, where their parser and the format's description decide: names of data files,
axes of one node, types.

usage: nrrd_input_test.py ISONEST PLUGIN_FOLDER
"""
import bz2
import gzip
import pathlib
import shutil
import subprocess
import sys
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))

try:
    import numpy as np
    from volume_inputs import RANDOM, Input, is_read_as, numbers
except ImportError as error:
    print(f"skipped: {error}")
    sys.exit(77)


UNU = shutil.which("teem-unu") or shutil.which("unu")
if UNU is None:
    print("skipped: no unu (Debian: teem-apps)")
    sys.exit(77)
NAMES = {"u1": "uint8", "i2": "int16", "i4": "int", "f4": "float", "f8": "double", "i8": "int64", "u8": "uint64"}
ENCODINGS = {"raw": lambda data: data.tobytes(), "gzip": lambda data: gzip.compress(data.tobytes()),
             "bzip2": lambda data: bz2.compress(data.tobytes()),
             "ascii": lambda data: "\n".join(repr(v.item()) if data.dtype.itemsize != 4 or data.dtype.kind != "f" else str(v)
                                             for v in data.ravel()).encode() + b"\n",
             "hex": lambda data: data.tobytes().hex().encode()}


class Nrrd(Input):
    def setUp(self):
        super().setUp()
        self.path = self.here / "v.nrrd"
        self.data = RANDOM.integers(0, 255, (4, 3, 2)).astype(np.uint8)

    def write(self, *lines, data=None, kind="uint8", sizes=None, body=None, encoding="raw"):
        data = self.data if data is None else data
        sizes = sizes or data.shape[::-1]
        head = ["NRRD0004", f"type: {kind}", f"dimension: {len(sizes)}", f"sizes: {' '.join(map(str, sizes))}",
                f"encoding: {encoding}", f"endian: {'big' if data.dtype.byteorder == '>' else 'little'}", *lines]
        self.path.write_bytes(("\n".join(head) + "\n\n").encode() + (data.tobytes() if body is None else body))

    def test_a_data_file_with_a_percent_sign_in_its_name_is_one_file(self):
        for name in ("50%.raw", "5%d.raw", "50% of it.raw", "%03d 1 2", "LISTED.raw"):
            with self.subTest(name=name):
                (self.here / name).write_bytes(self.data.tobytes())
                self.write(f"data file: {name}", body=b"")
                self.reads(self.data)

    def by_teem(self):
        """The values of the file by teem, [..., y, x]."""
        out = self.here / "teem.nrrd"
        subprocess.run([UNU, "save", "-f", "nrrd", "-e", "raw", "-en", "little", "-i", self.path, "-o", out], check=True,
                       capture_output=True)
        header, found = out.read_bytes().split(b"\n\n", 1)
        sizes = next(line for line in header.decode().split("\n") if line.startswith("sizes: "))[7:]
        return np.frombuffer(found, self.data.dtype).reshape([int(n) for n in sizes.split()][::-1])

    def test_data_in_several_files(self):
        data = numbers((6, 4, 5), "u1")
        for encoding, pack in ENCODINGS.items():
            planes = [pack(plane) for plane in data]
            slabs = [pack(slab) for slab in np.split(data, 3)]
            rows = [pack(row) for plane in data for row in plane]
            for lines, names, parts in ((["LIST"], ["a.raw", "b: c.raw", "#.raw", "d e.raw", "f.raw", "g.raw"], planes),
                                        (["LIST 2"], [f"x{i}" for i in range(6)], planes),
                                        (["LIST 3"], ["a", "b", "c"], slabs), (["LIST 1"], [f"r{i}" for i in range(24)], rows),
                                        (["v%03d.raw 1 6 1"], [f"v{i:03d}.raw" for i in range(1, 7)], planes),
                                        (["w%d.raw 15 5 -2 2"], [f"w{i}.raw" for i in range(15, 4, -2)], planes),
                                        (["./u%02d 0 2 1 3"], [f"u{i:02d}" for i in range(3)], slabs)):
                for end in (b"", b"\n") if "LIST" in lines[0] else (b"\n",):
                    with self.subTest(encoding=encoding, lines=lines, end=end):
                        for name, part in zip(names, parts):
                            (self.here / name).write_bytes(part)
                        self.path = self.here / "v.nhdr"
                        self.write(f"data file: {lines[0]}", *(names if "LIST" in lines[0] else ()), data=data, encoding=encoding, body=b"")
                        self.path.write_bytes(self.path.read_bytes().rstrip(b"\n") + b"\n" + end)
                        if not end and "#.raw" not in names or "LIST" not in lines[0]:
                            np.testing.assert_array_equal(self.by_teem(), data)
                        self.reads(data)
                        before = (self.here / names[2]).read_bytes()
                        self.assertEqual(self.preprocess(store=self.here / names[2]).returncode, 2)
                        self.assertEqual((self.here / names[2]).read_bytes(), before)
                        if encoding != "raw":
                            (self.here / names[-1]).write_bytes(before[:len(before) // 2])
                            self.assertIn(self.preprocess().returncode, (2, 4))
                        (self.here / names[-1]).unlink()
                        self.refuses(3, names[-1].split("/")[-1])
        for i, plane in enumerate(data):
            (self.here / f"y{i}").write_bytes(gzip.compress(b"abc" + plane.tobytes()))
        self.write("byte skip: 3", "data file: y%d 0 5 1", data=data, encoding="gzip", body=b"")
        self.reads(data)
        self.write("byte skip: -1", "data file: y%d 0 5 1", data=data, encoding="gzip", body=b"")
        self.refuses(5, "byte skip: -1")
        for lines in (["LIST 4", "a"], ["LIST 0", "a"], ["LIST"], ["LIST 2 2", "a"], ["v%d 1 5 1"], ["v%d 1 6 0"], ["v%d 6 1 1"],
                      ["v%d 1 99999999999 1"], ["v%d 1 4 1 3"], ["LIST 3", "a", "b", "c", "d"]):
            with self.subTest(lines=lines):
                self.write(f"data file: {lines[0]}", *lines[1:], data=data, body=b"")
                self.refuses(4, "data file")

    def test_all_encodings(self):
        for kind in ("u1", "i2", "i4", "f4", "f8", "i8", "u8"):
            data = numbers((4, 3, 2), kind)
            for encoding, pack in ENCODINGS.items():
                for order in "<>":
                    with self.subTest(kind=kind, encoding=encoding, order=order):
                        stored = data.astype(order + kind)
                        self.write(data=stored, kind=NAMES[kind], encoding=encoding, body=pack(stored))
                        self.data = data
                        np.testing.assert_array_equal(self.by_teem(), data)
                        self.reads(is_read_as(data))
                        whole = self.path.read_bytes()
                        if encoding in ("bzip2", "gzip"):
                            for damaged in (whole[:-3], whole[:-20], whole[:-6] + bytes([whole[-6] ^ 1]) + whole[-5:]):
                                self.path.write_bytes(damaged)
                                self.refuses(4)
                        if encoding in ("ascii", "hex"):
                            self.path.write_bytes(whole[:-5] if encoding == "hex" else whole.rstrip().rsplit(b"\n", 1)[0])
                            self.refuses(4)
                            self.path.write_bytes(whole[:-4] + b"x" + whole[-3:])
                            self.refuses(4)
        streams = bz2.compress(self.data.tobytes()[:50]) + bz2.compress(self.data.tobytes()[50:])
        self.write(data=self.data, kind=NAMES["u8"], encoding="bz2", body=streams)
        self.reads(is_read_as(self.data))
        self.write("byte skip: 3", data=self.data, kind=NAMES["u8"], encoding="bz2", body=bz2.compress(b"abc" + self.data.tobytes()))
        self.reads(is_read_as(self.data))
        self.write("byte skip: -1", data=self.data, kind=NAMES["u8"], encoding="bz2", body=streams)
        self.refuses(5, "byte skip: -1")
        self.write(data=self.data, kind=NAMES["u8"], encoding="zrl", body=streams)
        self.refuses(5, "unu save", "-e gzip")

    def test_a_spacing_that_nothing_says_is_named(self):
        for lines, axes in (((), ""), (("spacings: 1 1 1",), None), (("spacings: 2 nan 3",), " along y"), (("spacings: nan 2 nan",), " along x and z"),
                            (("axis mins: 1 2 3", "axis maxs: 3 nan 9"), " along y"), (("axis mins: 1 nan 3",), ""),
                            (("space: LPS", "space directions: (1,0,0) none (0,0,1)"), " along y"),
                            (("space: LPS", "space directions: (0,1,0) (1,0,0) (0,0,1)"), None)):
            with self.subTest(lines=lines):
                self.write(*lines)
                done = self.preprocess()
                text = done.stdout + done.stderr
                self.assertEqual(done.returncode, 0, text)
                self.assertEqual(f"the file does not give the spacing{axes};" in text, axes is not None)
                self.assertEqual("does not give the spacing" in text, axes is not None)
                done = self.preprocess("--spacing", "1,1,1")
                self.assertNotIn("does not give the spacing", done.stdout + done.stderr)

    def test_axes_of_time_and_components(self):
        data = numbers((2, 7, 8, 9), "f4")
        self.write("space dimension: 4", "space directions: (1,0,0,0) (0,2,0,0) (0,0,3,0) (0,0,0,1)", "kinds: domain domain domain domain",
                   "space origin: (1,2,3,0)", data=data, kind="float")
        self.refuses(5, "t 2, z 7, y 8, x 9", "--index t=0")
        for way in ("t=1", "time=1", "0=1", "1,:,:,:"):
            self.reads(data[1], "--index", way)
            self.lies((1, 2, 3), (1, 2, 3))
        done = self.reads(np.ascontiguousarray(data[:, 4]), "--index", "t=:,z=4")
        self.assertIn("'t' is not a direction in space", done.stdout + done.stderr)
        self.lies((1, 2, 15), (1, 2, 1))
        self.reads(np.ascontiguousarray(data[1, 4]), "--index", "t=1,z=4")
        self.lies((1, 2, 15), (1, 2, 1))
        # A vector axis first, custom names, compressed or not; a rotated volume.
        for encoding in ("raw", "gzip", "bzip2"):
            parts = np.moveaxis(data, 0, -1).copy()
            for labels, names in (('labels: "Vx;Vy" "x" "y" "z"', ("c", "C", "component", "3", "-1")), ('labels: "flow" "R" "A" "S"', ("flow", "Flow", "3"))):
                for directions, turned in (("none (0.75,0,0) (0,0.75,0) (0,0,0.75)", False), ("none (0.6,0.8,0) (-0.8,0.6,0) (0,0,1)", True)):
                    self.write("space: right-anterior-superior", f"space directions: {directions}", "kinds: vector domain domain domain", labels,
                               data=parts, kind="float", encoding=encoding, body=ENCODINGS[encoding](parts))
                    self.refuses(5, "2 volumes along axis", f"--index {names[0]}=0")
                    for name in names:
                        with self.subTest(encoding=encoding, name=name, turned=turned):
                            self.reads(data[1], "--index", f"{name}=1")
                            self.assertEqual(self.directions() != np.eye(3).tolist(), turned)
        for directions in ("none (0.75,0,0) (0,0.75,0) (0,0,0.75)", "none (0.6,0.8,0) (-0.8,0.6,0) (0,0,1)"):
            self.write("space: right-anterior-superior", f"space directions: {directions}", "kinds: vector domain domain domain", data=parts, kind="float")
            done = self.reads(np.ascontiguousarray(parts[2]), "--index", "z=2,c=:")
            self.assertIn("used as x, with a spacing of 1", done.stdout + done.stderr)
        # A time axis first; three axes including a time are a volume.
        self.write("kinds: time domain domain domain", data=parts, kind="float")
        self.refuses(5, "--index t=0")
        self.reads(data[1], "--index", "t=1")
        self.write("kinds: domain domain time", "spacings: 1 2 3", data=data[0], kind="float")
        self.reads(data[0])
        self.lies((0, 0, 0), (1, 2, 3))

    def test_an_axis_of_one_node_without_a_direction_gets_one_at_right_angles(self):
        data = self.data.reshape(1, 1, 24)
        for vector, step in (((0, 2, 0), 2), ((0, 0, -3), 3), ((3, 4, 0), 5), ((1, 2, 2), 3), ((2, 0, 0), 2)):
            with self.subTest(vector=vector):
                self.write("space: RAS", f"space directions: ({','.join(map(str, vector))})", sizes=(24,))
                self.reads(data)
                self.lies((0, 0, 0), (step, 1, 1))
                turn = np.array(self.directions())
                np.testing.assert_allclose(turn[0], np.array(vector) / step, atol=1e-12)
                np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
                self.assertAlmostEqual(np.linalg.det(turn), 1)
        # Also with four axes, one of them long.
        self.write("space: RAS", "space directions: none (0,0,0) (0,2,0) none", sizes=(1, 1, 24, 1))
        self.reads(data)
        np.testing.assert_allclose(self.directions()[0], (0, 1, 0))
        self.write("space: RAS", "space directions: (1,0,0) (2,0,0)", data=self.data[0])
        self.refuses(5, "nearly in one plane")

    def test_an_axis_has_a_spacing_or_a_direction(self):
        directions = "space directions: (1,0,0) (0,2,0) (0,0,3) none"
        self.write(directions, "spacings: nan nan nan 2.5", sizes=(2, 3, 4, 1))
        self.reads(self.data)
        self.lies((0, 0, 0), (1, 2, 3))
        self.write(directions, "spacings: nan 2 nan 2.5", sizes=(2, 3, 4, 1))
        self.refuses(4, "axis 1", "'spacings'", "'space directions'")

    def test_the_unit_is_that_of_the_axes_with_more_than_one_node(self):
        self.write("spacings: 1 2 3", 'units: "" "km" "km"', data=self.data[:, :, :1])
        done = self.reads(self.data[:, :, :1], "--json")
        self.assertIn('"unit": "km"', done.stdout)

    def test_integers_of_64_bits_are_read_where_float64_has_them(self):
        for kind, names in (("i8", ("longlong", "long long", "signed long long int", "int64", "int64_t")),
                            ("u8", ("ulonglong", "unsigned long long", "uint64", "uint64_t"))):
            for order, name in zip("<><><", names):
                with self.subTest(name=name, order=order):
                    data = numbers((4, 3, 2), kind).astype(order + kind)
                    if kind == "i8":
                        data[0, 0, 0] = -5
                    self.write(data=data, kind=name)
                    self.reads(data.astype("f8"))
        data[1, 2, 0] = 2**53 + 1
        self.write(data=data, kind="uint64")
        self.refuses(5, "2^53")
        labels = np.full((4, 3, 2), 2**60 + 1, "<i8")
        self.write(data=labels, kind="int64")
        self.assertEqual(self.preprocess("--labels").returncode, 0)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
