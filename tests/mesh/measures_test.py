"""Area and volume that `extract` reports, compared with sums over the triangles of the mesh that it wrote: by numpy in
float64, and by VTK.

Usage: measures_test.py ISONEST PLUGIN_FOLDER
"""
import itertools
import json
import pathlib
import re
import sys
import tempfile
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served  # noqa: E402

import numpy as np
from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy
from vtkmodules.vtkCommonDataModel import vtkImageData
from vtkmodules.vtkFiltersCore import vtkFlyingEdges3D, vtkMassProperties
from vtkmodules.vtkIOPLY import vtkPLYReader

ISONEST = sys.argv[1]
MIDDLE = np.array((9, 8, 10))  # centre of the balls, in nodes: x, y, z
RADIUS = 6.3


class Mesh:
    """The triangles of a file, and their area and volume."""

    def __init__(self, path):
        reader = vtkPLYReader()
        reader.SetFileName(str(path))
        reader.Update()
        self.data = reader.GetOutput()
        self.triangles = np.zeros((0, 3), int)
        if self.data.GetNumberOfPolys():
            self.triangles = vtk_to_numpy(self.data.GetPolys().GetConnectivityArray()).reshape(-1, 3)
            points = vtk_to_numpy(self.data.GetPoints().GetData()).astype("f8")
            # Relative to a point of the surface, so that no digits are lost far from the origin.
            self.corners = (points - points[0])[self.triangles]
        else:
            self.corners = np.zeros((0, 3, 3))

    def area(self):
        a, b, c = self.corners.transpose(1, 0, 2)
        return np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2

    def signed_volume(self):
        """Volume of a closed mesh. Positive if the triangles, counter-clockwise as seen from outside, face outward."""
        a, b, c = self.corners.transpose(1, 0, 2)
        return np.einsum("ij,ij->", a, np.cross(b, c)) / 6

    def is_closed(self):
        """Whether every edge is traversed equally often in both directions."""
        passes = np.concatenate([self.triangles[:, [i, (i + 1) % 3]] for i in range(3)])
        edges, place = np.unique(np.sort(passes, 1), axis=0, return_inverse=True)
        balance = np.bincount(place.ravel(), np.sign(passes[:, 1] - passes[:, 0]), len(edges))
        return not balance.any()

    def of_vtk(self):
        """Area and volume."""
        properties = vtkMassProperties()
        properties.SetInputData(self.data)
        return properties.GetSurfaceArea(), properties.GetVolume()


class MeasuresTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory(prefix="isonest-test-", dir=served.MEMORY)
        cls.here = pathlib.Path(cls.folder.name)
        z, y, x = np.mgrid[:21, :18, :23].astype("f8")
        distance = np.sqrt((x - MIDDLE[0]) ** 2 + (y - MIDDLE[1]) ** 2 + (z - MIDDLE[2]) ** 2)
        waves = np.sin(x / 3) + np.cos(y / 4 + 1) * np.sin(z / 5) + 0.05 * np.random.default_rng(5).random(x.shape)
        volumes = {"ball": RADIUS - distance, "shell": 1.7 - abs(distance - 5), "waves": waves,
                   "holes": np.where((x > 12) & (y > 9) & (z > 11) & (z < 13), np.nan, RADIUS - distance)}
        for name, data in volumes.items():
            np.save(cls.here / "v.npy", data.astype("f4"))
            cls.run_program("preprocess", "v.npy", "-o", name, "--chunk", 8, "--indicators",
                            "deviation_bar,hex_deviation,linf_plus", "--force")
        np.save(cls.here / "v.npy", volumes["waves"].astype("f4"))
        cls.run_program("preprocess", "v.npy", "-o", "placed", "--chunk", 8, "--spacing", "2,0.5,1.25", "--origin",
                        "1000,-300,40", "--unit", "mm")

    @classmethod
    def tearDownClass(cls):
        cls.folder.cleanup()

    @classmethod
    def run_program(cls, *arguments):
        done = served.run([ISONEST, *map(str, arguments)], capture_output=True, text=True, cwd=cls.here)
        assert done.returncode == 0, (arguments, done.stderr)
        return done.stdout

    def measured(self, store, *options, iso=0.0, unit=""):
        """The mesh, after comparing it with both forms of its report; and the report as JSON."""
        command = ("extract", store, "--iso", iso, "-o", "m.ply", *options)
        report = json.loads(self.run_program(*command, "--json"))
        mesh = Mesh(self.here / "m.ply")
        self.assertEqual(len(mesh.triangles), report["triangles"])
        self.assertGreater(len(mesh.triangles), 50)
        np.testing.assert_allclose(report["area"], mesh.area(), rtol=1e-10)
        area_of_vtk, volume_of_vtk = mesh.of_vtk()
        np.testing.assert_allclose(report["area"], area_of_vtk, rtol=1e-5)
        closed = mesh.is_closed()
        if closed:
            volume = abs(mesh.signed_volume())
            np.testing.assert_allclose(report["volume"], volume, rtol=1e-10)
            np.testing.assert_allclose(report["volume"], volume_of_vtk, rtol=1e-4)
        else:
            self.assertIn("volume", report)
            self.assertIsNone(report["volume"])
        said = self.run_program(*command)
        number = r"([0-9.e+-]+)"
        square, cube = (f" {unit}{power}" if unit else "" for power in "23")
        if closed:
            (found,) = re.findall(rf"^area {number}{square}, volume {number}{cube}$", said, re.MULTILINE)
        else:
            (found,) = re.findall(rf"^area {number}{square}, not closed, so it has no volume$", said, re.MULTILINE)
            found = (found,)
        self.assertEqual(list(found), [f"{n:.6g}" for n in (report["area"], report["volume"])[:len(found)]])
        return mesh, report

    def test_a_sphere_within_the_volume_is_closed_and_faces_outwards(self):
        for options in ((), ("--cells", "tet"), ("--error", 0.3, "--effort", "none"), ("--error", 0.1), ("--normals",),
                        ("--cells", "hex", "--error", 0.3, "--effort", "none"),
                        ("--vertices", "exact")):
            with self.subTest(options=options):
                mesh, report = self.measured("ball", *options)
                self.assertTrue(mesh.is_closed())
                self.assertGreater(mesh.signed_volume(), 0)
                self.assertAlmostEqual(report["area"] / (4 * np.pi * RADIUS ** 2), 1, delta=0.08)
                self.assertAlmostEqual(report["volume"] / (4 / 3 * np.pi * RADIUS ** 3), 1, delta=0.08)

    def test_a_simplified_surface_is_measured_as_it_is_written(self):
        full = self.measured("ball")[1]
        for options in (("--distance", 0.3), ("--distance", 0.3, "--effort", "fast"), ("--triangles", 300),
                        ("--error", 0.3), ("--distance", 0.3, "--effort", "none")):
            with self.subTest(options=options):
                mesh, report = self.measured("ball", *options)
                self.assertTrue(mesh.is_closed())
                self.assertLess(report["triangles"], full["triangles"])
                self.assertNotEqual(report["area"], full["area"])
                self.assertNotEqual(report["volume"], full["volume"])

    def test_the_surface_at_full_resolution_is_measured_beside_a_simplified_one(self):
        cases = (("ball", ("--cells", "hex")), ("ball", ("--cells", "tet", "--close", "--box", "3,1,2,15,9.5,18")),
                 ("ball", ("--cells", "hex", "--close", "--box", "3,1,2,15,9.5,18")),
                 ("waves", ("--cells", "hex")), ("shell", ("--cells", "tet", "--components", "largest")),
                 ("placed", ("--cells", "hex")))
        for (store, options), stop in itertools.product(cases, (("--distance", 0.3), ("--triangles", 300),
                                                                ("--distance", 0.3, "--effort", "fast"))):
            with self.subTest(store=store, options=options, stop=stop):
                command = ("extract", store, "--iso", 0, "-o", "m.ply", *options)
                mesh = json.loads(self.run_program(*command, "--json"))
                full = Mesh(self.here / "m.ply")
                self.assertNotIn("full_area", mesh)
                simple = json.loads(self.run_program(*command, *stop, "--json"))
                np.testing.assert_allclose(simple["full_area"], full.area(), rtol=1e-10)
                if full.is_closed():
                    np.testing.assert_allclose(simple["full_volume"], abs(full.signed_volume()), rtol=1e-10)
                else:
                    self.assertIsNone(simple["full_volume"])
                self.assertRegex(self.run_program(*command, *stop),
                                 rf"\nat full resolution: area {simple['full_area']:.6g}(,| mm2,) ")

    def test_a_void_takes_its_volume_from_the_solid(self):
        mesh, report = self.measured("shell")
        self.assertTrue(mesh.is_closed())
        self.assertAlmostEqual(report["volume"] / (4 / 3 * np.pi * (6.7 ** 3 - 3.3 ** 3)), 1, delta=0.05)
        _, outer = self.measured("shell", "--components", "largest")
        self.assertGreater(outer["volume"], 1.1 * report["volume"])
        self.assertLess(outer["area"], report["area"])

    def test_an_open_surface_has_an_area_and_no_volume(self):
        box = ("--box", "3,1,2,15,9.5,18")
        for store, options in (("waves", ()), ("ball", box), ("holes", ()), ("waves", ("--cells", "hex")),
                               ("waves", ("--distance", 0.4)), ("ball", (*box, "--distance", 0.2)),
                               ("holes", ("--close",))):
            with self.subTest(store=store, options=options):
                self.assertFalse(self.measured(store, *options)[0].is_closed())

    def test_a_surface_that_was_closed_is_measured_with_its_caps(self):
        total = 20 * 17 * 22
        volumes = {}
        for cells, stops in (("tet", ((), ("--distance", 0.4), ("--error", 0.1))),
                             ("hex", ((), ("--distance", 0.4), ("--distance", 0.4, "--effort", "fast")))):
            opened = self.measured("waves", "--cells", cells)[1]
            for (side, signs), options in itertools.product((("below", 1), ("above", -1)), stops):
                with self.subTest(cells=cells, side=side, options=options):
                    mesh, report = self.measured("waves", f"--close={side}", "--cells", cells, *options)
                    self.assertTrue(mesh.is_closed())
                    self.assertGreater(signs * mesh.signed_volume(), 0)
                    if not options:
                        volumes[cells, side] = report["volume"]
                        self.assertGreater(report["area"], opened["area"])
            # The two sides of one surface fill the box.
            self.assertAlmostEqual((volumes[cells, "below"] + volumes[cells, "above"]) / total, 1, delta=1e-5)
            box = ("--box", "3,1,2,15,9.5,18")
            mesh, report = self.measured("ball", *box, "--close", "--cells", cells)
            self.assertTrue(mesh.is_closed())
            self.assertLess(report["volume"], 12 * 8.5 * 16)
        for side in ("below", "above"):
            self.assertAlmostEqual(volumes["hex", side] / volumes["tet", side], 1, delta=5e-3)

    def test_a_closed_surface_of_hexahedra_holds_what_that_of_vtk_holds_in_a_padded_volume(self):
        """A layer of nodes far outside leaves no border; its cells are flat. VTK uses other diagonals."""
        for side, far in (("below", -1e30), ("above", 1e30)):
            grid = vtkImageData()
            padded = np.pad(np.load(self.here / "v.npy").astype("f8"), 1, constant_values=far)
            grid.SetDimensions(*padded.shape[::-1])
            values = numpy_to_vtk(padded.ravel(), deep=True)
            grid.GetPointData().SetScalars(values)
            edges = vtkFlyingEdges3D()
            edges.SetInputData(grid)
            edges.SetValue(0, 0.0)
            properties = vtkMassProperties()
            properties.SetInputConnection(edges.GetOutputPort())
            report = self.measured("waves", f"--close={side}", "--cells", "hex")[1]
            np.testing.assert_allclose(report["volume"], properties.GetVolume(), rtol=5e-4)

    def test_the_interval_of_a_solid_within_an_error_holds_its_full_volume_and_shrinks_with_the_error(self):
        box = ("--box", "3,1,2,15,9.5,18")
        for store, options in (("ball", ("--close",)), ("waves", ("--close",)), ("waves", ("--close=above",)),
                               ("waves", ("--close", *box)), ("placed", ("--close=above",)),
                               ("waves", ("--close", "--indicator", "plus"))):
            full = self.measured(store, *options, "--cells", "tet", unit="mm" if store == "placed" else "")[1]["volume"]
            before = np.inf
            for error in (0.4, 0.05, 0):
                with self.subTest(store=store, options=options, error=error):
                    command = ("extract", store, "--iso", 0, "-o", "m.ply", *options, "--error", error, "--effort", "none",
                               "--cells", "tet")
                    report = json.loads(self.run_program(*command, "--volume-interval", "--json"))
                    least, most = report.pop("full_volume_interval")
                    self.assertLess(least, full)
                    self.assertLess(full, most)
                    self.assertLess(most - least, before)
                    before = most - least
                    self.assertRegex(self.run_program(*command, "--volume-interval"),
                                     rf"\nvolume at full resolution between {least:.6g} and {most:.6g}")
                    alone = json.loads(self.run_program(*command, "--json"))
                    for differing in ("seconds", "peak_cache_bytes"):
                        del alone[differing], report[differing]
                    self.assertEqual(alone, report)
            self.assertLess(before, 1e-4 * full)

    def test_the_interval_is_that_of_outer_solids(self):
        """For all guarantees and budgets, with the error that is reported."""
        for options in (("--error-relative", 0.1, "--effort", "none"), ("--error", 0.2), ("--triangles", 300, "--by", "error"),
                        ("--triangles", 300, "--by", "error", "--effort", "none")):
            with self.subTest(options=options):
                command = ("extract", "waves", "-o", "m.ply", "--close=above", "--json")
                report = json.loads(self.run_program(*command, "--iso", 0, "--volume-interval", *options))
                error = report["tolerance"]
                self.assertGreater(error, 0)
                volumes = [json.loads(self.run_program(*command, "--iso", iso, "--error", error, "--effort", "none", "--cells", "tet"))["volume"]
                           for iso in (-error, error)]
                np.testing.assert_allclose(report["full_volume_interval"], volumes, rtol=1e-5)

    def test_no_interval_is_said_where_missing_values_leave_the_solid_open(self):
        command = ("extract", "holes", "--iso", 0, "-o", "m.ply", "--close", "--error", 0.2, "--volume-interval")
        self.assertIsNone(json.loads(self.run_program(*command, "--json"))["full_volume_interval"])
        self.assertNotIn("between", self.run_program(*command))

    def test_measures_are_in_the_unit_of_the_coordinates(self):
        for options, closed in (((), False), (("--close",), True), (("--close", "--distance", "0.2mm"), True)):
            with self.subTest(options=options):
                self.assertEqual(self.measured("placed", *options, unit="mm")[0].is_closed(), closed)
        # A node distance is 2 x 0.5 x 1.25 mm3.
        _, nodes = self.measured("waves", "--close")
        _, millimetres = self.measured("placed", "--close", unit="mm")
        self.assertAlmostEqual(millimetres["volume"] / nodes["volume"], 1.25, delta=1e-3)

    def test_a_surface_without_triangles_measures_nothing(self):
        for options in ((), ("--close",), ("--distance", 0.3), ("--cells", "hex")):
            with self.subTest(options=options):
                command = ("extract", "ball", "--iso", 99, "-o", "m.ply", *options)
                report = json.loads(self.run_program(*command, "--json"))
                self.assertEqual((report["triangles"], report["area"], report["volume"]), (0, 0, 0))
                self.assertEqual(len(Mesh(self.here / "m.ply").triangles), 0)
                self.assertNotIn("area", self.run_program(*command))

    def test_each_of_several_isovalues_has_its_own(self):
        isovalues = (-0.4, 0.0, 0.6)
        command = ("extract", "waves", "--close", "--iso", ",".join(map(str, isovalues)), "-o")
        expected = [self.measured("waves", "--close", iso=iso)[1] for iso in isovalues]
        for name in ("m_{iso}.ply", "all.ply"):
            reports = json.loads(self.run_program(*command, name, "--json"))["meshes"]
            self.assertEqual([(r["area"], r["volume"]) for r in reports], [(r["area"], r["volume"]) for r in expected])
        intervals = []
        for iso in (*isovalues, ",".join(map(str, isovalues))):
            report = json.loads(self.run_program(*command[:3], "--iso", iso, "--error", 0.1, "-o", "m.vtp",
                                                 "--volume-interval", "--json"))
            intervals.append([r["full_volume_interval"] for r in report.get("meshes", [report])])
        self.assertEqual([one for several in intervals[:3] for one in several], intervals[3])

    def test_lines_have_neither(self):
        y, x = np.mgrid[:19, :23]
        np.save(self.here / "flat.npy", (6 - np.hypot(x - 11, y - 9)).astype("f4"))
        self.run_program("preprocess", "flat.npy", "-o", "flat")
        command = ("extract", "flat", "--iso", 0, "-o", "m.vtp")
        report = json.loads(self.run_program(*command, "--json"))
        self.assertGreater(report["triangles"], 0)
        self.assertFalse({"area", "volume"} & report.keys())
        self.assertNotIn("area", self.run_program(*command))


unittest.main(argv=sys.argv[:1])
