"""Values of other stores and volumes at the vertices of a mesh (--vertex-values NAME=STORE), against a trilinear
interpolation in NumPy: each vertex has the value at its position in the world, and the reported bound holds for the
linear function on every triangle.

Usage: vertex_values_test.py ISONEST PLUGIN_FOLDER
"""
import json
import pathlib
import sys
import tempfile
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served  # noqa: E402
from mesh_data import read_glb, read_ply  # noqa: E402

import h5py
import numpy as np
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkIOXML import vtkXMLPolyDataReader

isonest = sys.argv.pop(1)
sys.argv.pop(1)

TURN = np.array([[0.8, 0.6, 0], [-0.6, 0.8, 0], [0, 0, 1]])  # rows: directions of the axes x, y, z


class Field:
    """A volume of NumPy, its place in the world, and the trilinear function of its values."""

    def __init__(self, values, spacing=(1, 1, 1), origin=(0, 0, 0), directions=np.eye(3)):
        self.values = values  # [z, y, x]
        self.origin = np.array(origin, float)
        self.steps = np.asarray(directions, float) * np.array(spacing, float)[:, None]

    def write(self, path):
        kind = {"f4": "float", "f8": "double", "u1": "uint8", "i2": "int16"}[self.values.dtype.str[1:]]
        triple = " ".join("(" + ",".join(map(repr, map(float, row))) + ")" for row in self.steps)
        head = (f"NRRD0005\ntype: {kind}\ndimension: 3\nspace dimension: 3\nsizes: {' '.join(map(str, self.values.shape[::-1]))}\n"
                f"space directions: {triple}\nspace origin: ({','.join(map(repr, map(float, self.origin)))})\n"
                "endian: little\nencoding: raw\n\n")
        path.write_bytes(head.encode() + np.ascontiguousarray(self.values).tobytes())
        return path

    def at(self, points):
        """NaN outside."""
        at = np.linalg.solve(self.steps.T, (np.asarray(points, float) - self.origin).T).T
        at = np.where(np.abs(at - np.rint(at)) < 1e-9, np.rint(at), at)
        last = np.array(self.values.shape[::-1]) - 1
        inside = ((at >= 0) & (at <= last)).all(1)
        at = np.where(inside[:, None], at, 0)
        low = np.minimum(at.astype(int), np.maximum(last - 1, 0))
        part = at - low
        total = np.zeros(len(at))
        for corner in range(8):
            bits = np.array([corner >> axis & 1 for axis in range(3)])
            weight = np.where(bits, part, 1 - part).prod(1)
            node = np.minimum(low + bits, last)
            value = self.values[node[:, 2], node[:, 1], node[:, 0]].astype(float)
            total += np.where(weight > 0, weight * np.where(weight > 0, value, 0), 0)
        return np.where(inside & np.isfinite(total), total, np.nan)


def grid(shape):
    return np.meshgrid(*(np.arange(n, dtype=float) for n in shape), indexing="ij")


class VertexValuesTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.temporary = tempfile.TemporaryDirectory()
        cls.folder = pathlib.Path(cls.temporary.name)
        z, y, x = grid((21, 26, 31))
        cls.shape = Field((np.hypot(np.hypot(x - 15.2, y - 12.4), z - 10.1) + 0.4 * np.sin(x) * np.cos(y)).astype("f4"))
        z, y, x = grid((17, 24, 19))
        cls.smooth = Field(np.sin(x / 5) + np.cos(y / 6) * z / 10, (2.4, 2.1, 1.9), (12.4, -19.9, -5), TURN)
        noise = np.random.default_rng(3).integers(0, 200, (25, 30, 35)).astype("u1")
        cls.noise = Field(noise, origin=(-2, -1, -3))
        holes = np.random.default_rng(4).normal(size=(23, 23, 23)).astype("f4")
        holes[3:7, :, 11:14] = np.nan
        holes[20] = np.inf
        cls.holes = Field(holes, (0.9, 1, 1), (3, 2, -1))  # does not reach everywhere
        cls.wind = [Field((a * x - b * y + c * z).astype("f4"), (2, 2, 2), (-2, -8, -2)) for a, b, c in
                    ((0.5, 1, 0), (0.25, 0, 2), (1, 1, 1))]
        for name in ("shape", "smooth", "noise", "holes"):
            cls.store(name, getattr(cls, name))
        for axis, field in zip("xyz", cls.wind):
            cls.store(f"wind_{axis}", field)

    @classmethod
    def tearDownClass(cls):
        cls.temporary.cleanup()

    @classmethod
    def store(cls, name, field, *options):
        cls.run_program("preprocess", field.write(cls.folder / f"{name}.nrrd"), "-o", cls.folder / f"{name}.isonest",
                        "--chunk", "8", *options)

    @classmethod
    def run_program(cls, *words, code=0):
        done = served.run([isonest, *map(str, words)], capture_output=True, text=True, cwd=cls.folder)
        assert done.returncode == code, (words, done.returncode, done.stderr)
        return done.stdout if code == 0 else done.stderr

    def extract(self, *words, mesh="m.ply", source="shape.isonest", iso=("--iso", "8.5")):
        """The mesh, and the report on its fields by name."""
        report = json.loads(self.run_program("extract", source, *iso, *words, "-o", mesh, "--json"))
        fields = {one["name"]: one for one in report["vertex_fields"]}
        return (*read_ply(self.folder / mesh), fields) if mesh.endswith(".ply") else fields

    @staticmethod
    def points(rows):
        return np.stack([rows[axis] for axis in "xyz"], 1).astype(float)

    def error_between_vertices(self, rows, faces, name, field):
        """The largest difference on the triangles that have a value everywhere, at 66 points of each."""
        points, values = self.points(rows), rows[name].astype(float)
        steps = 10
        places = np.array([(i, j, steps - i - j) for i in range(steps + 1) for j in range(steps + 1 - i)]) / steps
        worst = 0
        for place in places:
            at = np.einsum("k,fkd->fd", place, points[faces])
            linear = np.einsum("k,fk->f", place, values[faces])
            difference = np.abs(field.at(at) - linear)
            worst = max(worst, np.nanmax(difference, initial=0))
        return worst

    def test_vertices_have_the_values_at_their_place_and_the_bound_holds_between_them(self):
        for options in ((), ("--distance", "0.2"), ("--cells", "tet", "--error", "0.1", "--effort", "none"), ("--normals", "--box", "3,3,3,28,23,18")):
            rows, faces, reports = self.extract("--vertex-values", "s=smooth.isonest", "--vertex-values", "n=noise.isonest", *options)
            self.assertGreater(len(faces), 300)
            for name, field, factor in (("s", self.smooth, 4), ("n", self.noise, 3)):
                with self.subTest(options=options, field=name):
                    at = field.at(self.points(rows))
                    np.testing.assert_allclose(rows[name], at, rtol=3e-6, atol=1e-5)
                    self.assertEqual(np.isnan(at).sum(), 0)
                    bound = reports[name]["linear_bound"]
                    measured = self.error_between_vertices(rows, faces, name, field)
                    self.assertLessEqual(measured, bound)
                    self.assertGreater(measured, bound / factor)
                    self.assertEqual((reports[name]["missing_vertices"], reports[name]["unbounded_triangles"]), (0, 0))

    def test_a_linear_field_has_no_error_between_vertices(self):
        fields = self.extract("--vertex-values", "w=wind_x.isonest,wind_y.isonest,wind_z.nrrd", mesh="m.vtkhdf")
        self.assertLess(fields["w"]["linear_bound"], 1e-3)
        self.assertEqual((fields["w"]["components"], fields["w"]["sources"]),
                         (3, ["wind_x.isonest", "wind_y.isonest", "wind_z.nrrd"]))

    def test_missing_values_are_nan_and_counted(self):
        rows, faces, reports = self.extract("--vertex-values", "h=holes.isonest")
        at = self.holes.at(self.points(rows))
        self.assertTrue(0 < np.isnan(at).sum() < len(at))
        np.testing.assert_array_equal(np.isnan(rows["h"]), np.isnan(at))
        np.testing.assert_allclose(rows["h"], at, rtol=3e-6, atol=1e-5)
        self.assertEqual(reports["h"]["missing_vertices"], np.isnan(at).sum())
        self.assertGreaterEqual(reports["h"]["unbounded_triangles"], np.isnan(at)[faces].any(1).sum())
        self.assertLess(reports["h"]["unbounded_triangles"], len(faces))

    def test_vertices_on_the_border_keep_their_values_although_their_positions_are_rounded(self):
        z, y, x = grid((15, 16, 17))
        for directions in (np.eye(3), TURN):
            own = Field((x + 2 * y + 3 * z).astype("f4"), (0.7, 0.7, 0.7), (-123.4, -87.3, 55.1), directions)
            self.store("own", own, "--force")
            rows, faces, reports = self.extract("--vertex-values", "v=own.isonest", "--close", source="own.isonest", iso=("--iso", "40"))
            self.assertEqual((reports["v"]["missing_vertices"], reports["v"]["unbounded_triangles"]), (0, 0))
            self.assertLess(np.abs(rows["v"]).max(), 100)

    def test_values_beyond_the_numbers_of_the_mesh_are_refused_and_have_no_bound(self):
        z, y, x = grid((21, 26, 31))
        self.store("huge", Field(1e39 * (1 + x * y)))
        error = self.run_program("extract", "shape.isonest", "--iso", "8.5", "--vertex-values", "h=huge.isonest", "-o", "h.glb", code=7)
        self.assertIn("32-bit", error)
        self.assertGreater(self.extract("--vertex-values", "h=huge.isonest")[2]["h"]["linear_bound"], 1e38)
        self.store("extreme", Field(np.where(x % 2 > 0, 1.7e308, -1.7e308)))
        fields = self.extract("--vertex-values", "h=extreme.isonest")[2]["h"]
        self.assertGreater(fields["linear_bound"], 1e307)
        self.assertGreater(fields["unbounded_triangles"], 0)  # where the bound itself is beyond float64

    def test_the_bound_is_for_the_values_before_they_were_rounded(self):
        self.store("rounded", self.noise, "--tolerance", "8")
        rows, faces, reports = self.extract("--vertex-values", "n=rounded.isonest")
        measured = self.error_between_vertices(rows, faces, "n", self.noise)
        exact = self.extract("--vertex-values", "n=noise.isonest")[2]["n"]["linear_bound"]
        self.assertLessEqual(measured, reports["n"]["linear_bound"])
        self.assertLess(np.abs(reports["n"]["linear_bound"] - exact), 32)

    def test_all_formats_with_attributes_hold_scalars_and_vectors(self):
        values = ("--vertex-values", "s=smooth.isonest", "--vertex-values", "wind=wind_x.isonest,wind_y.isonest,wind_z.isonest")
        rows, faces, _ = self.extract(*values)
        wind = np.stack([rows[f"wind_{axis}"] for axis in "xyz"], 1)
        np.testing.assert_allclose(wind, np.stack([field.at(self.points(rows)) for field in self.wind], 1), rtol=3e-6, atol=1e-5)
        # float64 values stay float64 where the format has them.
        self.assertEqual((rows["s"].dtype, rows["wind_x"].dtype), (np.dtype("<f8"), np.dtype("<f4")))
        self.extract(*values, mesh="m.vtp")
        reader = vtkXMLPolyDataReader()
        reader.SetFileName(str(self.folder / "m.vtp"))
        reader.Update()
        data = reader.GetOutput().GetPointData()
        self.assertEqual(data.GetScalars().GetName(), "s")
        np.testing.assert_array_equal(vtk_to_numpy(data.GetArray("s")), rows["s"])
        np.testing.assert_array_equal(vtk_to_numpy(data.GetArray("wind")), wind)
        self.extract(*values, mesh="m.vtkhdf")
        with h5py.File(self.folder / "m.vtkhdf") as file:
            np.testing.assert_array_equal(file["VTKHDF/PointData/s"], rows["s"])
            np.testing.assert_array_equal(file["VTKHDF/PointData/wind"], wind)
        self.extract(*values, mesh="m.glb")
        of_glb = read_glb(self.folder / "m.glb")[1]
        np.testing.assert_array_equal(of_glb["_S"][:, 0], rows["s"].astype("f4"))
        np.testing.assert_array_equal(of_glb["_WIND"], wind)
        for mesh in ("m.stl", "m.obj", "m.3mf", "m.ngmesh"):
            error = self.run_program("extract", "shape.isonest", "--iso", "8.5", *values, "-o", mesh, code=2)
            self.assertIn(".vtp", error)

    def test_volumes_give_the_bytes_of_their_stores_for_any_threads_and_memory(self):
        self.extract("--vertex-values", "n=noise.isonest")
        first = (self.folder / "m.ply").read_bytes()
        for words in (("n=noise.nrrd",), ("n=noise.isonest", "--threads", "1", "--memory", "60M")):
            self.extract("--vertex-values", *words)
            self.assertEqual((self.folder / "m.ply").read_bytes(), first, words)
        # A mesh made directly from a file has its own order of vertices.
        stored = read_ply(self.folder / "m.ply")[0]
        direct = self.extract("--vertex-values", "n=noise.nrrd", source="shape.nrrd")[0]
        np.testing.assert_array_equal(np.sort(direct), np.sort(stored))
        self.assertEqual([path.name for path in self.folder.glob("*.tmp*")], [])

    def test_a_dataset_of_a_file_is_named_behind_a_colon(self):
        with h5py.File(self.folder / "two.h5", "w") as file:
            file["a"], file["b"] = self.shape.values, self.shape.values * 2
        rows = self.extract("--vertex-values", "b=two.h5:b")[0]
        np.testing.assert_allclose(rows["b"], 2 * self.shape.at(self.points(rows)), rtol=3e-6)

    def test_labels_isovalues_and_tiles_have_fields_and_their_colors(self):
        labels = Field((self.shape.values < 7).astype("u1") * 3)
        self.store("labels", labels, "--labels")
        for words in (("--label", "3"), ("--label", "3", "--smooth", "--distance", "0.5")):
            rows, faces, reports = self.extract("--vertex-values", "n=noise.isonest", *words, source="labels.isonest", iso=())
            np.testing.assert_allclose(rows["n"], self.noise.at(self.points(rows)), rtol=3e-6, atol=1e-5)
            self.assertLessEqual(self.error_between_vertices(rows, faces, "n", self.noise), reports["n"]["linear_bound"])
        self.run_program("extract", "labels.isonest", "--labels", "all", "--smooth", "--vertex-values", "n=noise.isonest",
                         "--colors", "gray", "-o", "all")
        rows = read_ply(next((self.folder / "all").glob("*.ply")))[0]
        low, high = float(self.noise.values.min()), float(self.noise.values.max())
        np.testing.assert_allclose(rows["red"], 255 * (rows["n"] - low) / (high - low), atol=2)
        rows = self.extract("--vertex-values", "n=noise.isonest", iso=("--iso", "7,8.5"))[0]
        self.assertEqual(set(rows["isovalue"]), {7, 8.5})
        np.testing.assert_allclose(rows["n"], self.noise.at(self.points(rows)), rtol=3e-6, atol=1e-5)
        report = json.loads(self.run_program("extract", "shape.isonest", "--iso", "8.5", "--vertex-values", "n=noise.isonest",
                                             "--colors", "gray", "--format", "3dtiles", "-o", "site", "--json"))
        self.assertIsNone(report["vertex_fields"][0]["linear_bound"])
        tile = next((self.folder / "site").rglob("*.glb")).read_bytes()
        self.assertIn(b'"_N":', tile)
        self.assertIn(b'"COLOR_0":', tile)

    def test_what_cannot_be_done_is_refused_with_the_reason(self):
        values = ("extract", "shape.isonest", "--iso", "8.5", "-o", "never.ply")
        for words, said in (
                (["--vertex-values", "n=absent.isonest"], "absent.isonest"),
                (["--vertex-values", "n=noise.isonest,noise.isonest"], "three components"),
                (["--vertex-values", "n="], "NAME=STORE"),
                (["--vertex-values", "1n=noise.isonest"], "digit"),
                (["--vertex-values", "normal=noise.isonest"], "something else"),
                (["--vertex-values", "n=noise.isonest", "--vertex-values", "N=noise.isonest"], "two"),
                (["--vertex-values", "w=noise.isonest,noise.isonest,noise.isonest", "--vertex-values", "w_y=noise.isonest"], "W_Y"),
                (["--vertex-values", "shape.isonest", "--vertex-values", "shape.isonest"], "NAME=STORE"),
                (["--vertex-values", "n=noise.isonest", "--vertex-values", "s=smooth.isonest", "--format", "3dtiles"], "one number")):
            with self.subTest(words=words):
                self.assertIn(said, self.run_program(*values, *words, code=2 if "absent" not in said else 3))
                self.assertFalse((self.folder / "never.ply").exists())
        # The mesh must not replace a volume that it is made from.
        before = (self.folder / "noise.isonest").read_bytes()
        self.run_program("extract", "shape.isonest", "--iso", "8.5", "--vertex-values", "n=noise.isonest", "-o", "noise.isonest", code=2)
        self.assertEqual((self.folder / "noise.isonest").read_bytes(), before)


unittest.main(verbosity=2)
