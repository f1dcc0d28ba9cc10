"""The reports on surfaces: what is said of triangles, components, distances, isovalues and closing.

Usage: cli_surfaces_test.py ISONEST PLUGIN_FOLDER
"""
import json
import pathlib
import re
import sys
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
from cli_case import CliCase, run  # noqa: E402


class Surfaces(CliCase):
    def test_an_empty_result_says_why(self):
        import h5py
        import numpy
        u = numpy.add.outer(numpy.add.outer(numpy.arange(9.0), numpy.arange(9.0)), numpy.arange(9.0))
        u[4, 4, 4] += 1
        with h5py.File(self.here / "why.h5", "w") as file:
            file["u"] = u
        self.ok("preprocess", "why.h5", "-o", "why.s", "--chunk", 8)
        far = ("--box", "20,20,20,30,30,30")
        inside = ("--box", "1,1,1,3,3,3")
        plane = ("slice", "why.s", "--plane")
        for arguments, words in (
                (("extract", "why.s", "--iso", 24.5), "every value is below 24.5"),
                (("extract", "why.s", "--iso", 0), "no value is below 0"),
                (("extract", "why.s", "--iso", 12.5, *far), "the box lies outside of the volume"),
                (("extract", "why.s", "--iso", 12.5, *inside), "empty inside the box"),
                ((*plane, "0,0,1,9"), "the plane misses the volume"),
                ((*plane, "0,0,1,4", *far), "the box lies outside of the volume"),
                ((*plane, "0,0,1,4", *inside), "does not pass through the box"),
                ((*plane, "0,0,1,4", "--contours", 99), "do not occur in the plane")):
            done = self.ok(*arguments, "-o", "why.vtp")
            self.assertIn(words, done.stdout.decode(), arguments)
        # A peak that is flattened: only the tolerance hides it.
        u[:] = 0
        u[3, 3, 3] = 1
        with h5py.File(self.here / "peak.h5", "w") as file:
            file["u"] = u
        self.ok("preprocess", "peak.h5", "-o", "peak.s", "--chunk", 8)
        done = self.ok("extract", "peak.s", "--iso", 0.5, "--error", 2, "--effort", "none", "-o", "why.vtp")
        self.assertIn("a smaller one may show some", done.stdout.decode())
        self.fails(2, *plane, "0,0,1,4", "--range", "200,100", "-o", "why.png")
        for path in self.here.glob("why.*"):
            path.unlink()
        for path in self.here.glob("peak.*"):
            path.unlink()

    def test_components_are_dropped_and_the_report_says_which(self):
        import h5py
        import numpy
        u = numpy.zeros((17, 17, 17))
        u[3:9, 3:9, 3:9] = 1
        u[12, 12, 4] = u[12, 4, 12] = u[4, 12, 12] = 1
        with h5py.File(self.here / "specks.h5", "w") as file:
            file["u"] = u
        self.ok("preprocess", "specks.h5", "-o", "specks.s", "--chunk", 8)
        extract = ("extract", "specks.s", "--iso", 0.5, "-o", "specks.ply")
        all_of_it = self.json(*extract)
        self.assertNotIn("components", all_of_it)
        for options in (("--components", "largest"), ("--components", 1), ("--min-component", 100),
                        ("--min-volume", "10.0"), ("--min-volume", 10)):
            report = self.json(*extract, *options)
            self.assertEqual((report["components"], report["dropped_components"]), (4, 3))
            self.assertEqual(report["triangles"] + report["dropped_triangles"], all_of_it["triangles"])
            self.assertEqual(3 * report["largest_dropped"], report["dropped_triangles"])
            self.assertRegex(self.ok(*extract, *options).stdout.decode(),
                             r"(?m)^dropped 3 of 4 components with \d+ triangles, the largest of \d+$")
        self.assertIn("4 components, none dropped", self.ok(*extract, "--components", "all").stdout.decode())
        self.assertIn("the distance is to the surface without them",
                      self.ok(*extract, "--components", 2, "--distance", "0.2voxel").stdout.decode())
        self.assertIn("all components of the surface were dropped, 4 with",
                      self.ok(*extract, "--min-component", 10000).stdout.decode())
        for path in self.here.glob("specks.p*"):
            path.unlink()
        for options, words in ((("--components", 0), "how many of the largest"),
                               (("--components", -3), "how many of the largest"),
                               (("--components", "most"), "how many of the largest"),
                               (("--min-component", -1), "give an integer from 0"),
                               (("--min-component", 2.5), "give an integer from 0"),
                               (("--min-volume", -1), "give a number >= 0"),
                               (("--min-volume", "much"), "give a finite number"),
                               (("--min-volume", "3cm3"), "give a finite number")):
            self.assertIn(words, self.fails(2, *extract, *options))
        for path in self.here.glob("specks.*"):
            path.unlink()

    def test_distances_and_numbers_of_triangles_are_read_and_reported(self):
        import h5py
        import numpy
        z, y, x = numpy.mgrid[:17, :17, :17]
        with h5py.File(self.here / "wave.h5", "w") as file:
            file["u"] = z + numpy.sin(x / 3) + 0.1 * numpy.sin(x + 2 * y)
        self.ok("preprocess", "wave.h5", "-o", "wave.s", "--chunk", 8)
        extract = ("extract", "wave.s", "--iso", 8.2, "-o", "wave.ply")
        full = self.json(*extract)["triangles"]
        report = self.json(*extract, "--triangles", full // 2, "--by", "error")
        self.assertTrue(report["within_budget"])
        self.assertLessEqual(report["triangles"], full // 2)
        self.assertGreater(report["error_bound"], 0)
        self.assertIn(f"asked for {full // 2} triangles",
                      self.ok(*extract, "--triangles", full // 2, "--by", "error").stdout.decode())
        same = [self.json(*extract, "--distance", d)["triangles"] for d in ("0.2", "0.20", "0.2voxel")]
        self.assertEqual(len(set(same)), 1)
        for options, words in ((("--distance", "1furlong"), "unknown unit"),
                               (("--distance", "0.2mm"), "has no unit"),
                               (("--distance", "nan"), "give a finite number"),
                               (("--distance", "-1mm"), "give a number >= 0"),
                               (("--triangles", 9, "--by", "size"), "give distance or error"),
                               (("--by", "error"), "--by needs --triangles"),
                               (("--triangles", 9, "--by", "error", "--distance", 1), "--by error and --distance cannot be combined")):
            self.assertIn(words, self.fails(2, *extract, *options))
        for path in self.here.glob("wave.*"):
            path.unlink()

    def test_several_isovalues_are_a_file_each_or_one_with_all(self):
        alone = {}
        for iso in ("0.3", "0.50", "5"):
            self.ok("extract", "b.isonest", "--iso", iso, "-o", "i_{iso}.ply")  # also replaced for a single one
            alone[iso] = (self.here / f"i_{iso}.ply").read_bytes()
            (self.here / f"i_{iso}.ply").unlink()
        several = ("extract", "b.isonest", "--iso", "0.3,0.50,5")
        report = self.json(*several, "-o", "i_{iso}.ply")["meshes"]
        self.assertEqual([(r["iso"], r["mesh"]) for r in report],
                         [(0.3, "i_0.3.ply"), (0.5, "i_0.50.ply"), (5, "i_5.ply")])
        self.assertEqual({iso: (self.here / f"i_{iso}.ply").read_bytes() for iso in alone}, alone)
        for name in ("all.ply", "all.vtp", "all.VTKHDF"):
            report = self.json(*several, "-o", name)["meshes"]
            self.assertEqual([(r["iso"], r["mesh"]) for r in report], [(0.3, name), (0.5, name), (5, name)])
            self.assertEqual(report[2]["triangles"], 0)
            self.assertIn(b"isovalue", (self.here / name).read_bytes())
        said = self.ok(*several, "-o", "all.ply").stdout.decode()
        self.assertIn("isovalue 0.50 in all.ply: ", said)
        self.assertIn("The surface is empty: every value is below 5", said)
        header = (self.here / "all.ply").read_bytes().split(b"end_header")[0].decode()
        self.assertIn("property double isovalue", header)
        self.assertIn(f"element face {sum(r['triangles'] for r in report)}", header)
        for path in [*self.here.glob("i_*"), *self.here.glob("all.*")]:
            path.unlink()
        for name in ("all.stl", "all.obj", "all.3mf", "all.glb", "all.GLB"):
            if name.endswith(("stl", "obj")):  # formats without such an attribute, and for one object
                message = self.fails(2, *several, "-o", name)
                self.assertRegex(message, rf"\A{re.escape(name)}: .*\.ply, \.vtp, \.vtkhdf, \.glb or \.3mf")
                self.assertIn("{iso}", message)
                self.assertFalse((self.here / name).exists())
            else:
                self.ok(*several, "-o", name)
                (self.here / name).unlink()
            # Each of these formats works with one file per isovalue.
            self.ok(*several, "-o", name.replace("all", "i_{iso}"))
            self.assertEqual(len(list(self.here.glob(f"i_*{name[-4:]}"))), 3)
        for path in self.here.glob("i_*"):
            path.unlink()
        self.assertIn("given twice", self.fails(2, "extract", "b.isonest", "--iso", "0.5,0.50", "-o", "i_{iso}.ply"))
        many = ",".join(str(i / 300) for i in range(257))
        self.assertIn("257 isovalues", self.fails(7, "extract", "b.isonest", "--iso", many, "-o", "all.ply"))

    def test_a_surface_is_closed_on_either_side_and_the_report_says_so(self):
        import h5py
        import numpy
        u = numpy.zeros((9, 9, 9))
        u[2:7, 2:7, 4:] = 1
        with h5py.File(self.here / "solid.h5", "w") as file:
            file["u"] = u
            file["holes"] = numpy.where(u == 0, numpy.nan, u)
            file["flat"] = u[4]
        for name in ("u", "holes", "flat"):
            self.ok("preprocess", "solid.h5", "--dataset", name, "-o", f"solid-{name}.s", "--chunk", 8)
        extract = ("extract", "solid-u.s", "--iso", 0.5, "-o", "solid.ply")
        is_open = self.json(*extract)
        self.assertNotIn("closed", is_open)
        for options, side in ((["--close"], "below"), (["--close=below"], "below"), (["--close=above"], "above")):
            report = self.json(*extract, *options)
            self.assertEqual((report["closed"], report["border_vertices"]), (side, 0))
            self.assertGreater(report["triangles"], is_open["triangles"])
            self.assertEqual(report["triangles"], 2 * report["vertices"] - 4)  # a sphere
            self.assertIn("closed at the faces of the volume: every edge has two triangles",
                          self.ok(*extract, *options).stdout.decode())
        self.assertIn("closed at the faces of the box",
                      self.ok(*extract, "--close", "--box", "1,1,1,5,5,5").stdout.decode())
        # The option's value is never the next argument.
        self.assertEqual(self.json("extract", "--iso", 0.5, "--close", "solid-u.s", "-o", "solid.ply")["closed"],
                         "below")
        full = ("extract", "solid-u.s", "--iso", -1, "--close", "-o", "solid.ply")
        self.assertEqual(self.json(*full)["triangles"], 6 * 8 * 8 * 2)
        self.assertIn("no value is below -1", self.ok(*full[:4], "--close=above", *full[5:]).stdout.decode())
        self.assertIn("every value is below 2",
                      self.ok("extract", "solid-u.s", "--iso", 2, "--close", "-o", "solid.ply").stdout.decode())
        holes = ("extract", "solid-holes.s", "--iso", 0.5, "--close", "-o", "solid.ply")
        self.assertGreater(self.json(*holes)["border_vertices"], 0)
        self.assertRegex(self.ok(*holes).stdout.decode(), r"open at missing values: \d+ vertices lie on borders")
        for path in self.here.glob("solid.ply"):
            path.unlink()
        self.assertIn("give below or above", self.fails(2, *extract, "--close=left"))
        self.assertIn("isolines cannot be combined with closing",
                      self.fails(2, "extract", "solid-flat.s", "--iso", 0.5, "--close", "-o", "solid.vtp"))
        self.fails(2, *extract, "--close", "--view", "0,0,1")
        self.fails(2, "extract", "solid-flat.s", "--graph", "--close", "-o", "solid.ply")
        self.fails(2, "slice", "solid-u.s", "--plane", "0,0,1,4", "--close", "-o", "solid.ply")
        for path in self.here.glob("solid*"):
            path.unlink()

    def test_ranges_tell_their_ends_apart(self):
        import h5py
        import numpy
        cases = ((1e9 + numpy.arange(60.0).reshape(3, 4, 5) / 20, "1000000000 to 1000000002.95"),
                 (numpy.full((3, 4, 5), numpy.nan), "values none"),
                 (numpy.arange(60.0).reshape(3, 4, 5), "values 0 to 59"))
        for values, words in cases:
            with h5py.File(self.here / "range.h5", "w") as file:
                file["u"] = values
            done = self.ok("preprocess", "range.h5", "-o", "range.s", "--force")
            self.assertIn(words, done.stdout.decode())
            self.assertIn(words, self.ok("info", "range.s").stdout.decode())
        for path in self.here.glob("range.*"):
            path.unlink()

    def test_check_asks_for_missing_where_that_is_all_that_differs(self):
        import numpy
        u = numpy.arange(60, dtype="<f4").reshape(3, 4, 5)
        u.tofile(self.here / "m.raw")
        shape = ("--dims", "5,4,3", "--type", "float32")
        self.ok("preprocess", "m.raw", *shape, "--missing", 7, "-o", "m.s")
        self.ok("check", "m.s", "--source", "m.raw", *shape, "--missing", 7)
        done = run("check", "m.s", "--source", "m.raw", *shape, cwd=self.here)
        self.assertEqual(done.returncode, 4)
        self.assertIn("give the same here", done.stdout.decode())
        (self.here / "m.raw").unlink()
        (self.here / "m.s").unlink()

    def test_reports_say_which_triangles_there_are(self):
        ask = ["extract", "b.isonest", "--iso", "0.5", "-o", "a.ply"]
        self.assertNotIn("smallest_angle", self.json(*ask))
        report = self.json(*ask, "--quality")
        angles = [report["smallest_angle"][key] for key in ("min", "q0.1%", "q1%", "q5%", "median")]
        self.assertEqual(angles, sorted(angles))
        self.assertGreater(angles[0], 0)
        self.assertLessEqual(angles[-1], 60)
        self.assertTrue(0 <= report["smallest_angle"]["share_below_5"] < 1)
        self.assertRegex(self.ok(*ask, "--quality").stdout, rb"[0-9.]+ degrees")
        self.assertEqual((report["mended_triangles"], report["zero_area_triangles"]), (0, 0))
        self.ok("preprocess", "b.h5", "--origin", "1e6,1e6,1e6", "--spacing", "1,1,1", "-o", "far.isonest")
        ask[1] = "far.isonest"
        report = json.loads(self.ok(*ask, "--json").stdout)  # in addition to a warning
        self.assertGreater(report["mended_triangles"], 0)
        self.assertEqual(report["zero_area_triangles"], 0)
        self.assertIn(f"{report['mended_triangles']} triangles that degenerate".encode(), self.ok(*ask).stdout)
        for name in ("a.ply", "far.isonest"):
            (self.here / name).unlink()


if __name__ == "__main__":
    unittest.main(argv=[sys.argv[0], *sys.argv[3:]], verbosity=1)
