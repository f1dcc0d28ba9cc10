#!/usr/bin/env python3
"""NRRD files as other programs write them, and gzip: the numbers, and their positions in the world.

usage: nrrd_headers_test.py ISONEST PLUGIN_FOLDER
"""
import gzip
import itertools
import json
import os
import pathlib
import subprocess
import sys
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served  # noqa: E402

os.environ["HDF5_PLUGIN_PATH"] = sys.argv[2]
try:
    import h5py
    import numpy as np
    from volume_inputs import ISONEST, Input
except ImportError as error:
    print(f"skipped: {error}")
    sys.exit(77)

RANDOM = np.random.default_rng(3)


class NrrdInput(Input):
    def setUp(self):
        super().setUp()
        self.path = self.here / "v.nrrd"
        self.data = RANDOM.integers(0, 30000, (6, 7, 9)).astype(np.int16)

    def write(self, *lines, data=None, encoding="raw", sizes=None):
        data = self.data if data is None else data
        sizes = sizes or data.shape[::-1]
        header = ["NRRD0005", "type: int16", f"dimension: {len(sizes)}",
                  "sizes: " + " ".join(map(str, sizes)), f"encoding: {encoding}", "endian: little",
                  *lines]
        numbers = data.astype("<i2").tobytes()
        self.path.write_bytes(("\n".join(header) + "\n\n").encode() +
                              (gzip.compress(numbers) if encoding == "gzip" else numbers))

    def test_an_axis_that_runs_backward_is_turned_around(self):
        """World positions are preserved: node i of an axis with step d is at o + i d."""
        for signs in itertools.product((1, -1), repeat=3):
            step = np.array([2, 0.5, 3]) * signs
            origin = np.array([10, 20, 30])
            vectors = " ".join(f"({','.join(map(str, row))})" for row in np.diag(step))
            turned = self.data[tuple(slice(None, None, s) for s in signs[::-1])]
            low = [o + min(0, d * (n - 1)) for o, d, n in zip(origin, step, (9, 7, 6))]
            for lines in ((f"space directions: {vectors}", "space origin: (10,20,30)"),
                          (f"spacings: {' '.join(map(str, step))}", "space origin: (10,20,30)")):
                for encoding in ("raw", "gzip"):
                    with self.subTest(lines=lines, encoding=encoding):
                        self.write(*lines, encoding=encoding)
                        if encoding == "gzip" and signs[2] < 0:
                            self.refuses(5, "z axis runs backward", "encoding: raw")
                            continue
                        self.reads(turned)
                        self.lies(low, abs(step))

    def test_a_backward_axis_is_turned_in_space_on_disk_too(self):
        data = RANDOM.integers(0, 30000, (30, 500, 500)).astype(np.int16)
        for encoding, z in (("raw", -1), ("gzip", 1)):
            with self.subTest(encoding=encoding):
                self.write(f"spacings: -1 -1 {z}", data=data, encoding=encoding)
                turned = data[::z, ::-1, ::-1]
                done = self.reads(turned, "--memory", "18M", "--threads", "1", "--json")
                self.assertTrue(json.loads(done.stdout)["input_on_disk"])

    def test_missing_values_and_check_see_the_turned_volume(self):
        self.data[2, 3, 4] = -5
        self.write("spacings: 1 -1 -1")
        turned = self.data[::-1, ::-1].astype(np.float32)
        turned[turned == -5] = np.nan
        self.reads(turned, "--missing", "-5")
        done = served.run([ISONEST, "check", self.here / "s.isonest", "--source", self.path,
                           "--missing", "-5"], capture_output=True, text=True)
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)

    def test_axes_without_a_direction_are_not_the_volumes(self):
        vectors = "none (2,0,0) (0,-0.5,0) (0,0,3)"
        self.write(f"space directions: {vectors}", "space origin: (10,20,30)", sizes=(1, 9, 7, 6))
        self.reads(self.data[:, ::-1])
        self.lies([10, 17, 30], [2, 0.5, 3])
        self.write("spacings: nan 2 0.5 3", sizes=(1, 9, 7, 6))
        self.reads(self.data)
        self.lies([0, 0, 0], [2, 0.5, 3])

    def test_samples_lie_between_the_ends_of_their_axes(self):
        ends = ("axis mins: 10 20 30", "axis maxs: 28 16.5 48")
        for centers, low, step in ((None, (11, 16.75, 31.5), (2, 0.5, 3)),
                                   ("cell cell ???", (11, 16.75, 31.5), (2, 0.5, 3)),
                                   ("node node node", (10, 16.5, 30), (18 / 8, 3.5 / 6, 18 / 5)),
                                   ("cell node cell", (11, 16.5, 31.5), (2, 3.5 / 6, 3))):
            with self.subTest(centers=centers):
                self.write(*ends, *([] if centers is None else [f"centers: {centers}"]))
                self.reads(self.data[:, ::-1])
                self.lies(low, step)
        self.write("axis mins: 10 nan 30", "spacings: 2 0.5 nan", "centerings: node node node")
        self.reads(self.data)
        self.lies([10, 0, 30], [2, 0.5, 1])
        self.write("axis mins: 10 20 30", "space origin: (1,2,3)", "spacings: 2 0.5 3")
        self.reads(self.data)
        self.lies([1, 2, 3], [2, 0.5, 3])
        for line in ("axis mins: 1 2", "axis maxs: 1 2 3 4"):
            self.write("axis mins: 1 2 3" if "maxs" in line else "spacings: 1 1 1", line)
            self.refuses(4, line.split(":")[0])

    def test_a_picture_in_space_has_the_spacing_of_its_two_axes(self):
        self.write("space directions: (2,0,0) (0,3,0)", "space origin: (10,20,30)",
                   data=self.data[0])
        self.reads(self.data[:1])
        self.lies([10, 20, 30], [2, 3, 1])

    def test_oblique_axes_are_kept_or_ignored(self):
        for vectors, turned in (("(0,1,0) (0,0,1) (1,0,0)", 1), ("(0,1,0) (1,0,0) (0,0,1)", -1),
                                ("(0.7,0.7,0) (-0.7,0.7,0) (0,0,1)", 1)):
            with self.subTest(vectors=vectors):
                self.write(f"space directions: {vectors}")
                self.reads(self.data[:, :, ::turned])
                self.reads(self.data, "--spacing", "1,2,3")
                self.lies([0, 0, 0], [1, 2, 3])
        for vectors, code, word in (("(1,0,0) (0,0,0) (0,0,1)", 4, "step"), ("(1,0,0) (0,nan,0) (0,0,1)", 4, "step"),
                                    ("(1,0,0) (1,1e-5,0) (0,0,1)", 5, "nearly in one plane")):
            with self.subTest(vectors=vectors):
                self.write(f"space directions: {vectors}")
                self.refuses(code, word, "--spacing")
                self.reads(self.data, "--spacing", "1,2,3")
                self.lies([0, 0, 0], [1, 2, 3])
        self.write("space directions: (1,0,0) (0,1,0)")
        self.refuses(4, "'space directions' and 'sizes' do not agree")
        self.write("spacings: 1 2")
        self.refuses(4, "'spacings' and 'sizes' do not agree")
        vectors = "(0.7,0.7,0) (-0.7,0.7,0) (0,0,1)"
        self.write(f"space directions: {vectors}", "space origin: (10,20,30)")
        self.reads(self.data, "--spacing", "1,2,3")
        self.lies([10, 20, 30], [1, 2, 3])
        self.reads(self.data, "--spacing", "1,2,3", "--origin", "4,5,6")
        self.lies([4, 5, 6], [1, 2, 3])

    def test_directions_are_aligned_if_they_lead_less_than_a_tenth_of_a_voxel_astray(self):
        """Over 9 x 7 x 6 nodes; a voxel is 2 x 0.5 x 3."""
        def vectors(tilt):
            return f"(2,{tilt},0) (0,0.5,0) (0,0,3)"
        self.write(f"space directions: {vectors(0.049 / 8)}")
        self.reads(self.data)
        straight = self.directions()
        self.write(f"space directions: {vectors(0.051 / 8)}")
        self.reads(self.data)
        self.assertNotEqual(self.directions(), straight)
        self.write("space directions: (2,0.003,0) (0,0.5,0) (0,0.0053,3)")
        self.reads(self.data)
        self.assertNotEqual(self.directions(), straight)
        for sheared in ("(2,0,0.05) (0,0.5,0) (0,0,3)", "(2,0,0) (0.05,0.5,0) (0,0,3)"):
            self.write(f"space directions: {sheared}")
            self.reads(self.data)
            self.assertTrue(self.info()["sheared"])
        self.write("space directions: (2,0,0.1) (0,0.5,0)", data=self.data[0])
        self.reads(self.data[:1])
        self.assertNotEqual(self.directions(), straight)

    def test_another_spacing_leaves_the_first_sample_where_it_is(self):
        """For a reversed axis that is the position of the last node."""
        self.write("space directions: (-2,0,0) (0,0.5,0) (0,0,3)", "space origin: (10,20,30)")
        self.reads(self.data[:, :, ::-1], "--spacing", "1,2,3")
        self.lies([10 - 8 * 1, 20, 30], [1, 2, 3])
        self.write("axis mins: 10 20 30", "axis maxs: -8 23.5 48")
        self.reads(self.data[:, :, ::-1], "--spacing", "1,2,4")
        self.lies([10 - 0.5 - 8, 21, 32], [1, 2, 4])

    def test_skips_are_honoured_in_any_order(self):
        """Lines of the file, then bytes of the data decompressed from there."""
        numbers = self.data.tobytes()
        for encoding, detached, lines, skip, first in itertools.product(
                ("raw", "gzip"), (False, True), (0, 1, 3), (0, 100, -1), ("line", "byte")):
            fields = [f"line skip: {lines}", f"byte skip: {skip}"][::1 if first == "line" else -1]
            front = b"some text\n\n\x1f\x8b\x08\n"[:(0, 10, 0, 15)[lines]] + b""
            body = b"x\n" * 50 * (skip != 0) + numbers
            stored = front + (gzip.compress(body) if encoding == "gzip" else body)
            header = "\n".join(["NRRD0005", "type: int16", "dimension: 3", "sizes: 9 7 6",
                                f"encoding: {encoding}", "endian: little", *fields])
            with self.subTest(encoding=encoding, detached=detached, fields=fields):
                if detached:
                    (self.here / "v.data").write_bytes(stored)
                    self.path.write_text(header + "\ndata file: v.data\n")
                else:
                    self.path.write_bytes(header.encode() + b"\n\n" + stored)
                if encoding == "gzip" and skip == -1:
                    self.refuses(5, "byte skip: -1", *(["v.data: ", f"{self.path})"] if detached else []))
                else:
                    self.reads(self.data)
        for field, code in (("line skip: 1000000", 4), ("line skip: -1", 4), ("byte skip: -2", 4),
                            ("byte skip: 1e3", 4), ("byte skip: 1", 2),
                            (f"byte skip: {2**63 - 1}", 2), (f"byte skip: {2**63}", 4)):
            self.write(field)
            self.refuses(code)
        self.write("byte skip: -1", sizes=(9, 7, 7))  # would start in the header
        self.refuses(2, "bytes")

    def test_the_encoding_and_the_bytes_must_agree(self):
        noise = RANDOM.integers(-2**15, 2**15, self.data.shape).astype(np.int16)
        self.write(encoding="gzip", data=noise)
        whole = self.path.read_bytes()
        start = whole.index(b"\n\n") + 2
        for at in range(3):
            damaged = bytearray(whole)
            damaged[start + at] ^= 4
            self.path.write_bytes(damaged)
            self.refuses(4, "gzip")
        self.path.write_bytes(whole.replace(b"encoding: gzip", b"encoding: raw"))
        self.refuses(4, "encoding raw")
        noise.ravel()[:2] = -29921, 8  # like the start of gzip: 1F 8B 08 00
        self.write(data=noise)
        self.reads(noise)

    def test_axes_that_are_no_places_are_named(self):
        colour = ("kinds: RGB-color domain domain", "kinds: domain space 3-vector",
                  "kinds: domain list domain", "kinds: ??? none covariant-vector")
        for lines, (name, axis) in zip(colour, (("c", 0), ("c", 2), ("list", 1), ("c", 2))):
            for sizes in ((9, 7, 6), (9, 7, 6, 1)):
                self.write(lines + (" stub" if len(sizes) > 3 else ""), sizes=sizes)
                self.refuses(5, f"{sizes[axis]} volumes along axis '{name}'", f"--index {name}=0")
                self.reads(np.ascontiguousarray(np.take(self.data, 3, 2 - axis)), "--index", f"{name}=3")
        for lines in ("kinds: space DOMAIN time", "kinds: ??? none domain"):
            self.write(lines)
            self.reads(self.data)
        self.write("kinds: scalar domain domain domain", sizes=(1, 9, 7, 6))
        self.reads(self.data)
        self.write("kinds: domain domain")
        self.refuses(4, "'kinds' and 'sizes' do not agree")

    def test_numbers_that_are_none_or_out_of_range_are_refused(self):
        for line in ("spacings: 1e400 1 1", "spacings: 1e-400 1 1", "spacings: 1,1,1",
                     "spacings: 1 2 3mm", "spacings: 1 - 1", "space origin: (1,2,x)",
                     "space origin: 1 2 3", "space directions: (1,0,0) (0,1e999,0) (0,0,1)",
                     "space directions: (1,0,0) (0,1) (0,0,1)", "space directions: (1 0 0) none none",
                     "axis mins: 0 0 0x", "byte skip: 0.5", "byte skip: 1e400", "byte skip: 1 2",
                     "byte skip: "):
            with self.subTest(line=line):
                self.write(line)
                self.refuses(4, line.split(":")[0])
        for sizes in ("9 7 6.5", "9 7 6e400", "9 7 -6", "9 7 0", "9x7x6", "9 7 99999999999999999999"):
            with self.subTest(sizes=sizes):
                self.write()
                self.path.write_bytes(self.path.read_bytes().replace(b"9 7 6", sizes.encode()))
                self.refuses(4, "'sizes'")
        self.write("spacings: +1 2e0 NaN")
        self.reads(self.data)
        self.lies([0, 0, 0], [1, 2, 1])

    def test_a_carriage_return_in_the_middle_of_a_line_is_refused(self):
        for line in ("byte skip:=4\rbyte skip: 0", "# a comment\rbyte skip: 0"):
            with self.subTest(line=line):
                self.write(line)
                self.refuses(4, "carriage return")

    def test_fields_that_come_twice_or_are_not_known_are_refused(self):
        for lines, words in ((("byte skip: 0", "byte skip: 0"), ("'byte skip'", "line 8")),
                             (("byteskip: 0", "Byte Skip: 0"), ("duplicate field",)),
                             (("centers: cell cell cell", "centerings: node node node"), ("duplicate field",)),
                             (("type: int16",), ("'type'",)),
                             (("bytes skip: 8",), ("line 7", "'bytes skip: 8'")),
                             (("byte skip:8",), ("line 7",)), (("so be it",), ("line 7",)),
                             (("  ",), ("line 7",)),
                             (("spacings: 1 1 1", "space directions: (1,0,0) (0,1,0) (0,0,1)"),
                              ("both 'spacings' and 'space directions'",))):
            with self.subTest(lines=lines):
                self.write(*lines)
                self.refuses(4, *words)
        self.write("# byte skip: 4", "byte skip:=4", "byte skip:=8", "key:=sizes: 1 1 1", "units: ",
                   "labels: \"a: b\" \"\" \"\"")
        self.reads(self.data)

    def test_a_header_ends_with_an_empty_line(self):
        self.write()
        whole = self.path.read_bytes()
        head, numbers = whole.split(b"\n\n", 1)
        for end in (b"\n", b"\r\n"):
            self.path.write_bytes(head.replace(b"\n", end) + end + end + numbers)
            self.reads(self.data)
        self.path.write_bytes(head + b"\n" + b"# x\n" * 40000 + b"\n" + numbers)
        self.reads(self.data)
        self.path.write_bytes(head + b"\n" + b"# x\n" * (1 << 20) + b"\n" + numbers)
        self.refuses(5, "empty line")
        self.path.write_bytes(head + b"\n# " + numbers.translate(None, b"\r\n"))
        self.refuses(4, "empty line")
        self.path.write_bytes(whole.replace(b"NRRD0005", b"NRRD0006"))
        self.refuses(5, "NRRD0006")

    def test_options_that_do_not_go_with_the_format_are_errors(self):
        raw_only = (("--dims", "9,7,6"), ("--type", "int16"), ("--endian", "little"), ("--offset", "0"))
        self.write()
        for option in (*raw_only, ("--dataset", "v")):
            self.refuses(2, option[0], "NRRD", options=option)
        self.path = self.here / "v.h5"
        with h5py.File(self.path, "w") as file:
            file["v"] = self.data
        for option in raw_only:
            self.refuses(2, option[0], "HDF5", options=option)
        self.path = self.here / "v.raw"
        self.data.tofile(self.path)
        self.refuses(2, "--dataset", "raw",
                     options=("--dims", "9,7,6", "--type", "int16", "--dataset", "v"))


class GzipInput(Input):
    """Like gzip(1), except that input about which it warns is refused."""

    def setUp(self):
        super().setUp()
        self.data = RANDOM.integers(0, 30000, (6, 7, 9)).astype(np.int16)
        self.numbers = self.data.tobytes()

    def each(self, stored):
        """As raw numbers, and after and next to NRRD headers."""
        header = (b"NRRD0005\ntype: int16\ndimension: 3\nsizes: 9 7 6\nendian: little\n"
                  b"encoding: gzip\n")
        self.path = self.here / "v.raw.gz"
        self.path.write_bytes(stored)
        yield ("--dims", "9,7,6", "--type", "int16")
        self.path = self.here / "v.nhdr"
        self.path.write_bytes(header + b"data file: v.raw.gz\n")
        yield ()
        self.path = self.here / "v.nrrd"
        self.path.write_bytes(header + b"\n" + stored)
        yield ()

    def gzip_says(self, stored):
        """Runs gzip(1): the exit status, and the output."""
        done = subprocess.run(["gzip", "-dc"], input=stored, capture_output=True)
        return done.returncode, done.stdout

    def test_a_cut_trailer_is_refused(self):
        whole = gzip.compress(self.numbers)
        for cut in (*range(1, 10), 100):
            self.assertEqual(self.gzip_says(whole[:-cut])[0], 1)
            for options in self.each(whole[:-cut]):
                with self.subTest(cut=cut, path=self.path.name):
                    self.refuses(4, "gzip", "cut short", options=options)

    def test_a_wrong_checksum_or_length_is_refused(self):
        for at in range(-8, 0):
            damaged = bytearray(gzip.compress(self.numbers))
            damaged[at] ^= 1
            self.assertEqual(self.gzip_says(bytes(damaged))[0], 1)
            for options in self.each(bytes(damaged)):
                with self.subTest(at=at, path=self.path.name):
                    self.refuses(4, "gzip", options=options)

    def test_several_members_are_one_stream(self):
        parts = [gzip.compress(self.numbers[i:i + 97]) for i in range(0, len(self.numbers), 97)]
        empty = gzip.compress(b"")
        for stored in (b"".join(parts), empty + b"".join(parts) + empty, empty.join(parts)):
            self.assertEqual(self.gzip_says(stored), (0, self.numbers))
            for options in self.each(stored):
                self.reads(self.data, *options)
            for options in self.each(stored[:-1]):
                self.refuses(4, "cut short", options=options)

    def test_zeros_may_follow_and_nothing_else(self):
        whole = gzip.compress(self.numbers)
        for behind in (b"\0", bytes(512), bytes(300000)):
            self.assertEqual(self.gzip_says(whole + behind), (0, self.numbers))
            for options in self.each(whole + behind):
                self.reads(self.data, *options)
        for behind in (b"x", bytes(512) + b"x", b"\x1f", b"\x1f\x8b", whole[:1], bytes(3) + whole):
            self.assertNotEqual(self.gzip_says(whole + behind)[0], 0)
            for options in self.each(whole + behind):
                with self.subTest(behind=behind[:4], path=self.path.name):
                    self.refuses(4, "gzip", options=options)

    def test_bytes_behind_the_data_are_read_for_the_checksum(self):
        stored = gzip.compress(self.numbers + bytes(RANDOM.integers(0, 256, 5000, np.uint8)))
        for options in self.each(stored):
            if options:
                self.refuses(2, "more than the", options=options)
            else:
                self.reads(self.data)
        for options in self.each(stored[:-1]):
            self.refuses(4, "cut short", options=options)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
