#!/usr/bin/env python3
"""Typical commands of users who do not know the program yet: each does what is meant, or says what to type.

usage: newcomer_test.py ISONEST PLUGIN_FOLDER
"""
import gzip
import json
import os
import pathlib
import re
import struct
import sys
import tempfile
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served  # noqa: E402

ISONEST = sys.argv[1]
os.environ["HDF5_PLUGIN_PATH"] = sys.argv[2]


def nifti(low, high, nodes=8):
    """A cube of `high` in `low`, surrounded by one layer of nodes, in millimetres."""
    header = bytearray(348)
    struct.pack_into("<i", header, 0, 348)
    struct.pack_into("<8h", header, 40, 3, nodes, nodes, nodes, 1, 1, 1, 1)
    struct.pack_into("<2h", header, 70, 4, 16)  # int16
    struct.pack_into("<8f", header, 76, *[1] * 8)
    struct.pack_into("<f", header, 108, 352)
    header[123] = 2  # mm
    header[344:348] = b"n+1\0"
    inside = range(1, nodes - 1)
    values = [high if x in inside and y in inside and z in inside else low
              for z in range(nodes) for y in range(nodes) for x in range(nodes)]
    return bytes(header) + bytes(4) + struct.pack(f"<{nodes ** 3}h", *values)


def dicom(series, image, place):
    """A CT slice of 4 x 3 pixels, explicit VR little endian."""
    def element(group, number, kind, value):
        value = value.encode() if isinstance(value, str) else value
        value += (b"\0" if kind in ("UI", "OW") else b" ") * (len(value) % 2)
        size = struct.pack("<2xI", len(value)) if kind == "OW" else struct.pack("<H", len(value))
        return struct.pack("<HH", group, number) + kind.encode() + size + value

    def short(group, number, value):
        return element(group, number, "US", struct.pack("<H", value))

    kind = "1.2.840.10008.5.1.4.1.1.2"
    meta = (element(2, 2, "UI", kind) + element(2, 3, "UI", f"{series}.{image}") +
            element(2, 16, "UI", "1.2.840.10008.1.2.1"))
    return (bytes(128) + b"DICM" + element(2, 0, "UL", struct.pack("<I", len(meta))) + meta +
            element(8, 0x16, "UI", kind) + element(8, 0x18, "UI", f"{series}.{image}") + element(8, 0x60, "CS", "CT") +
            element(0x20, 0xe, "UI", series) + element(0x20, 0x32, "DS", "\\".join(map(str, place))) +
            element(0x20, 0x37, "DS", "1\\0\\0\\0\\1\\0") + short(0x28, 2, 1) + element(0x28, 4, "CS", "MONOCHROME2") +
            short(0x28, 0x10, 3) + short(0x28, 0x11, 4) + element(0x28, 0x30, "DS", "1\\1") + short(0x28, 0x100, 16) +
            short(0x28, 0x101, 16) + short(0x28, 0x102, 15) + short(0x28, 0x103, 0) +
            element(0x7fe0, 0x10, "OW", struct.pack("<12H", *range(image, image + 12))))


class Newcomer(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory(prefix="isonest-newcomer-")
        cls.here = pathlib.Path(cls.folder.name)
        (cls.here / "scan.nii").write_bytes(nifti(0, 400))
        (cls.here / "scan.nii.gz").write_bytes(gzip.compress(nifti(0, 400)))
        cls.run_ok("preprocess", "scan.nii", "-o", "scan.isonest")

    @classmethod
    def tearDownClass(cls):
        cls.folder.cleanup()

    @classmethod
    def run_it(cls, *words):
        return served.run([ISONEST, *map(str, words)], cwd=cls.here, capture_output=True, text=True)

    @classmethod
    def run_ok(cls, *words):
        done = cls.run_it(*words)
        assert done.returncode == 0, (words, done.stderr)
        return done.stdout

    def refused(self, code, *words):
        """Returns the message; checks that no file was made."""
        before = sorted(self.here.rglob("*"))
        done = self.run_it(*words)
        self.assertEqual(done.returncode, code, (words, done.stderr))
        self.assertEqual(sorted(self.here.rglob("*")), before)
        return done.stderr

    def extract(self, *words):
        return self.refused(2, "extract", "scan.isonest", *words, "-o", "x.ply")

    def report(self, *words):
        return json.loads(self.run_ok("extract", "scan.isonest", "--iso", "200", *words, "-o", "made.ply", "--json"))

    def test_an_error_in_percent(self):
        percent, relative = self.report("--error", "5%"), self.report("--error-relative", "0.05")
        self.assertEqual(percent["tolerance"], relative["tolerance"])
        self.assertEqual(percent["triangles"], relative["triangles"])
        self.assertAlmostEqual(percent["tolerance"], 20)
        self.assertEqual(self.report("--error", "20")["tolerance"], percent["tolerance"])
        self.assertIn("write --error 5%", self.extract("--iso", "200", "--error", "5", "%"))

    def test_a_relative_error_is_a_fraction(self):
        for words, meant in ((("--error-relative", "1.01"), "0.0101"), (("--error-relative", "5"), "0.05"),
                             (("--error", "2000%"), "0.01")):
            said = self.extract("--iso", "200", *words)
            self.assertIn(f"{words[0]} '{words[1]}'", said)
            self.assertRegex(said, r"\b(101|500|2000) %")
            self.assertIn(f"--error-relative {meant}\n", said)
        for words in (("--error-relative", "1"), ("--error", "100%")):
            self.assertEqual(self.report(*words)["tolerance"], 400)

    def test_a_blank_before_the_unit(self):
        for words, meant in ((("--distance", "0.5", "mm"), "--distance 0.5mm"), (("--distance", "2", "voxels"), "--distance 2voxels"),
                             (("--memory", "2", "G"), "--memory 2G")):
            said = self.extract("--iso", "200", *words)
            self.assertIn(f"unexpected '{words[2]}'; write {meant}", said)
        self.assertIn("write --memory 2G", self.refused(2, "export", "scan.isonest", "--memory", "2", "G", "-o", "x.nrrd"))

    def test_several_isovalues_without_commas(self):
        self.assertIn("write --iso 300,400", self.extract("--iso", "300", "400"))
        self.assertIn("write --iso 300,400,-5", self.extract("--iso", "300", "400", "-5"))

    def test_flags_with_a_value(self):
        self.assertRegex(self.extract("--iso", "200", "--normals", "yes"), "unexpected 'yes'; write --normals alone")
        self.assertRegex(self.extract("--iso", "200", "--normals", "no"), "unexpected 'no'; leave out --normals")
        self.assertIn("write --close=above", self.extract("--iso", "200", "--close", "above"))
        self.assertIn("write --smooth=8", self.extract("--label", "200", "--smooth", "8"))

    def test_a_file_is_never_a_stray_word(self):
        (self.here / "mm").write_bytes((self.here / "scan.nii").read_bytes())
        try:
            self.assertEqual(self.run_it("extract", "--iso", "200", "--distance", "0.5", "mm", "-o", "made.ply").returncode, 0)
        finally:
            (self.here / "mm").unlink()
        # The same for a name that cannot be distinguished from a missing file.
        self.assertIn("later.isonest", self.refused(3, "extract", "--iso", "200", "later.isonest", "-o", "x.ply"))

    def test_the_isovalue_under_other_names(self):
        for name in ("--isovalue", "-i", "--level", "--isolevel", "--threshold-value"):
            said = self.extract(name, "300")
            self.assertIn(f"no option {name}", said)
            if name != "--threshold-value":
                self.assertIn("did you mean --iso?", said)
        self.assertIn("did you mean --force?", self.refused(2, "preprocess", "scan.nii", "--overwrite", "-o", "x.isonest"))
        self.assertNotIn("--iso?", self.refused(2, "make-volume", "bucky", "--isovalue", "3", "--size", "9", "-o", "x.h5"))

    def test_a_picture_in_another_format(self):
        for end in ("jpg", "JPEG", "tif"):
            self.assertIn("-o s.png", self.refused(2, "slice", "scan.isonest", "--plane", "0,0,1,3", "-o", f"s.{end}"))

    def test_a_volume_where_a_store_is_needed(self):
        self.assertRegex(self.run_ok("info", "scan.nii.gz"), r"\Ascan\.nii\.gz: a volume, 8 x 8 x 8 int16")
        for words in (["check"], ["export", "-o", "x.nrrd"]):
            for name in ("scan.nii", "scan.nii.gz"):
                said = self.refused(2, words[0], name, *words[1:])
                self.assertRegex(said, r"NIfTI.*not a store; make one with: isonest preprocess")
                self.assertNotIn("corrupt", said)
        self.run_ok("make-volume", "bucky", "--size", "5", "-o", "b.h5")
        self.assertRegex(self.refused(2, "check", "b.h5"), "HDF5.*not a store")
        # A truncated store is damaged, not another kind of file.
        (self.here / "half.isonest").write_bytes((self.here / "scan.isonest").read_bytes()[:3000])
        self.refused(4, "check", "half.isonest")

    def test_a_volume_where_a_mesh_is_needed(self):
        self.run_ok("make-volume", "bucky", "--size", "5", "-o", "volume.h5")
        for name in ("scan.nii.gz", "scan.isonest", "volume.h5"):
            self.assertIn(f"isonest extract {name} --iso V", self.refused(2, "picture", name, "-o", "p.png"))

    def test_a_slice_of_a_dicom_series(self):
        folder = self.here / "series"
        folder.mkdir()
        for z in range(7):
            (folder / f"im{z}").write_bytes(dicom("1.2.3", z + 1, (0, 0, 2 * z)))
        (folder / "other").write_bytes(dicom("1.2.4", 1, (0, 0, 0)))
        (folder / "notes.txt").write_text("x")
        for command in (["preprocess", "-o", "x.isonest"], ["info"], ["extract", "--iso", "3", "-o", "x.ply"]):
            said = self.refused(2, command[0], "series/im3", *command[1:])
            self.assertRegex(said, r"series/im3: .*one slice of 7.* the folder, series")
        self.assertIn("4 x 3 x 7", self.run_ok("info", "series", "--series", "1.2.3"))
        self.assertIn("4 x 3 x 2", self.run_ok("info", "series/im3", "series/im4"))
        # A series of one slice is a volume, and so is one slice of a folder.
        self.assertIn("4 x 3 x 1", self.run_ok("info", "series/other"))
        self.assertIn("4 x 3 x 1", self.run_ok("info", "series", "--series", "1.2.3", "--crop", ":,:,3:4"))

    def test_without_an_output_the_endings_are_listed(self):
        for words, endings in ((["extract", "scan.isonest", "--iso", "200"], ".ply .stl .obj .vtp .vtkhdf .glb .3mf"),
                               (["slice", "scan.isonest", "--plane", "0,0,1,3"], ".png .ply .vtp"),
                               (["preprocess", "scan.nii"], ".isonest"), (["export", "scan.isonest"], ".h5 .nrrd .nii .vti .npy .mha .raw"),
                               (["make-volume", "bucky", "--size", "9"], ".h5 .nrrd .raw"), (["picture", "made.ply"], ".png"),
                               (["smooth", "scan.nii", "--steps", "1", "--tau", "1", "--lambda", "1"], ".h5 .nrrd .raw .png")):
            said = self.refused(2, *words)
            self.assertIn("missing -o ", said)
            for ending in endings.split():
                self.assertIn(ending, said)

    def test_export_writes_values_unless_told(self):
        self.run_ok("export", "scan.isonest", "-o", "a.npy")
        self.run_ok("export", "scan.isonest", "--field", "values", "-o", "b.npy")
        self.assertEqual((self.here / "a.npy").read_bytes(), (self.here / "b.npy").read_bytes())

    def test_an_empty_surface_names_the_values(self):
        for name in ("scan.isonest", "scan.nii", "scan.nii.gz"):
            for words in ([], ["--close"], ["--distance", "1voxel"], ["--error", "20"], ["--triangles", "9"], ["--normals"]):
                said = self.run_ok("extract", name, "--iso", "3000", *words, "-o", "made.ply")
                self.assertIn("every value is below 3000", said, (name, words))
                self.assertIn("0 to 400", said, (name, words))
        self.assertIn("0 to 400", self.run_ok("extract", "scan.isonest", "--iso", "3000,4000", "-o", "made_{iso}.ply"))

    def test_paraview_is_explained_once(self):
        self.assertNotIn("ParaView", self.run_ok("preprocess", "scan.nii", "-o", "p.isonest"))
        said = " ".join(self.run_ok("preprocess", "--help").split())
        self.assertRegex(said, r"ParaView opens a store .*\.hdf .*\.vtkhdf")

    def test_what_cannot_be_combined_or_is_missing(self):
        self.assertIn("--iso and --labels cannot be combined", self.extract("--iso", "1", "--labels", "all"))
        self.assertIn("--threshold needs --stop", self.extract("--iso", "1", "--threshold", "1"))
        self.assertRegex(self.refused(2), "give a command: preprocess, extract")
        self.assertRegex(self.refused(2, "extrct"), "did you mean extract")
        self.assertRegex(self.refused(2, "info"), "missing INPUT: ")
        self.assertIsNone(re.search(r"--help.*--help", self.refused(2, "info")))


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1] + sys.argv[3:])
