"""Colours of vertices in .ply and .glb are those of the values, and y points up in .glb and .obj if requested; read by VTK
and by the specification of glTF.

Usage: mesh_colors_test.py ISONEST PLUGIN_FOLDER
"""
import pathlib
import sys
import tempfile
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served  # noqa: E402
from mesh_data import read_glb, read_ply  # noqa: E402

import numpy as np
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkIOGeometry import vtkGLTFReader, vtkOBJReader
from vtkmodules.vtkIOPLY import vtkPLYReader

isonest = sys.argv.pop(1)
sys.argv.pop(1)
SIZE = (17, 21, 26)  # z, y, x


def read(reader, path):
    reader.SetFileName(str(path))
    reader.Update()
    data = reader.GetOutput()
    arrays = data.GetPointData()
    return vtk_to_numpy(data.GetPoints().GetData()), {
        arrays.GetArrayName(i): vtk_to_numpy(arrays.GetArray(i)) for i in range(arrays.GetNumberOfArrays())}


def displayed(linear):
    """sRGB, 0 to 255, of linear numbers from 0 to 1 (IEC 61966-2-1)."""
    return 255 * np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


class ColorsTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.temporary = tempfile.TemporaryDirectory(dir=served.MEMORY)
        cls.folder = pathlib.Path(cls.temporary.name)
        z, y, x = np.meshgrid(*map(np.arange, SIZE), indexing="ij")
        ball = np.sqrt((x - 12.3)**2 + (y - 10.1)**2 + (z - 8.2)**2).astype("f4")
        ramp = (x + 0.1 * y).astype("f8")
        ramp[:, :, :4] = np.nan
        np.save(cls.folder / "ball.npy", ball)
        np.save(cls.folder / "ramp.npy", ramp)
        np.save(cls.folder / "labels.npy", (ball < 6).astype("u1"))
        cls.ball, cls.ramp = cls.folder / "ball.isonest", cls.folder / "ramp.isonest"
        cls.run_program("preprocess", cls.folder / "ball.npy", "-o", cls.ball)
        cls.run_program("preprocess", cls.folder / "ramp.npy", "-o", cls.ramp)

    @classmethod
    def tearDownClass(cls):
        cls.temporary.cleanup()

    @staticmethod
    def run_program(*words, code=0):
        done = served.run([isonest, *map(str, words)], capture_output=True, text=True)
        assert done.returncode == code, (words, done.returncode, done.stderr)
        return done.stderr

    def assert_gray(self, rgb, values, low, high, within):
        """The colours of the map `gray`, which is linear."""
        part = np.clip((np.nan_to_num(values, nan=low) - low) / (high - low), 0, 1)
        np.testing.assert_allclose(rgb, np.repeat(255 * part[:, None], 3, axis=1), atol=within)

    def colored(self, *options, low, high, name="value", has_glb=True):
        """Extracts as .ply and as .glb, compares their colours with their values, and returns the values."""
        ply, glb = self.folder / "m.ply", self.folder / "m.glb"
        for path in (ply, glb)[:1 + has_glb]:
            self.run_program(*options, "--colors", "gray", "-o", path)
        _, arrays = read(vtkPLYReader(), ply)
        rows, _ = read_ply(ply)
        values = rows[name].astype(float)
        self.assertGreater(len(values), 50)
        np.testing.assert_array_equal(arrays["RGB"], np.stack([rows[part] for part in ("red", "green", "blue")], 1))
        self.assert_gray(arrays["RGB"], values, low, high, 2)
        if not has_glb:
            return values
        head, of_glb = read_glb(glb)
        color = of_glb["COLOR_0"].astype(float) / 65535
        self.assertTrue((color[:, 3] == 1).all())
        np.testing.assert_allclose(displayed(color[:, :3]), arrays["RGB"], atol=1)
        self.assertEqual(head["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"], [1, 1, 1, 1])
        return values

    def test_colors_are_those_of_another_store_within_the_range(self):
        for more in ((), ("--cells", "tet", "--error", "0.3"), ("--normals", "--distance", "0.5voxel")):
            values = self.colored("extract", self.ball, "--iso", "8.5", "--vertex-values", self.ramp, "--range", "6,15", *more,
                                  low=6, high=15)
            self.assertTrue(np.isnan(values).any() and (values < 6).any() and (values > 15).any())

    def test_without_a_range_colors_are_from_the_smallest_to_the_largest_value(self):
        self.colored("extract", self.ball, "--iso", "7", "--vertex-values", self.ramp, low=4, high=27)
        ball = np.load(self.folder / "ball.npy").astype(float)
        self.colored("slice", self.ball, "--plane", "0,1,2,25.5", low=ball.min(), high=ball.max())

    def test_several_isovalues_in_one_mesh_have_one_color_each(self):
        values = self.colored("extract", self.ball, "--iso", "4,6,8", low=4, high=8, name="isovalue",
                              has_glb=False)  # .glb holds one isovalue
        self.assertEqual(set(values), {4, 6, 8})

    def test_colors_are_those_of_the_errors_of_vertices(self):
        self.colored("extract", self.ball, "--iso", "7", "--cells", "tet", "--error", "0.5", "--effort", "none",
                     "--vertex-error", "deviation_bar", "--range", "0,0.4", low=0, high=0.4, name="error")

    def test_a_slice_and_its_picture_have_the_same_options(self):
        for name in ("s.png", "s.ply"):
            self.run_program("slice", self.ball, "--plane", "0,0,1,8", "--colors", "viridis_r", "--range", "2,9", "-o",
                             self.folder / name)
        rows, _ = read_ply(self.folder / "s.ply")
        least = rows[np.argmin(rows["value"])]  # below the range: the last colour of viridis
        self.assertEqual([least["red"], least["green"], least["blue"]], [253, 231, 37])

    def test_a_window_of_ct_is_a_range(self):
        for window, low, high in (("bone", -500, 1300), ("lung", -1350, 150), ("soft", -150, 250), ("brain", 0, 80)):
            made = []
            for given in (window, f"{low},{high}"):
                path = self.folder / f"{len(made)}.ply"
                self.run_program("slice", self.ball, "--plane", "0,0,1,8", "--colors", "hot", f"--range={given}", "-o", path)
                made.append(path.read_bytes())
            self.assertEqual(made[0], made[1], window)
        self.assertIn("LOW,HIGH", self.run_program("slice", self.ball, "--plane", "0,0,1,8", "--range", "bones", "-o",
                                                   self.folder / "refused.png", code=2))

    def test_bytes_do_not_depend_on_threads_and_memory(self):
        seen = set()
        for options in ((), ("--threads", 1), ("--threads", 3, "--memory", "40M")):
            path = self.folder / "t.glb"
            self.run_program("extract", self.ball, "--iso", "8", "--vertex-values", self.ramp, "--colors", "turbo", "-o", path, *options)
            seen.add(path.read_bytes())
        self.assertEqual(len(seen), 1)

    def test_y_points_up_if_requested(self):
        plain, upright = self.folder / "z.obj", self.folder / "y.obj"
        query = ("extract", self.ball, "--iso", "8.5", "--normals", "-o")
        self.run_program(*query, plain)
        self.run_program(*query, upright, "--up", "y")
        points, arrays = read(vtkOBJReader(), plain)
        turned, others = read(vtkOBJReader(), upright)
        np.testing.assert_array_equal(turned, np.stack([points[:, 0], points[:, 2], 0 - points[:, 1]], 1))
        normals = arrays["Normals"]
        np.testing.assert_array_equal(others["Normals"], np.stack([normals[:, 0], normals[:, 2], 0 - normals[:, 1]], 1))
        self.run_program(*query, self.folder / "y.glb", "--up", "y")
        head, of_glb = read_glb(self.folder / "y.glb")
        # The node's rotation, a unit quaternion (x, y, z, w), turns the positions.
        q = np.array(head["nodes"][0]["rotation"])
        self.assertAlmostEqual(np.linalg.norm(q), 1, 9)
        v = of_glb["POSITION"].astype(float)
        rotated = v + 2 * np.cross(q[:3], np.cross(q[:3], v) + q[3] * v)
        np.testing.assert_allclose(rotated, turned, atol=1e-4)
        reader = vtkGLTFReader()
        reader.SetFileName(str(self.folder / "y.glb"))
        reader.Update()
        self.assertGreater(reader.GetOutput().GetNumberOfPoints(), 100)

    def test_what_has_no_colors_is_refused_and_nothing_is_written(self):
        values = ("--vertex-values", self.ramp)
        for words, said in (
                (("extract", self.ball, "--iso", 7, "--colors", "gray"), "--vertex-values"),
                (("extract", self.folder / "ball.npy", "--iso", 7, "--colors", "gray"), "--vertex-values"),
                (("extract", self.folder / "labels.npy", "--label", 1, "--colors", "gray"), "--label-names"),
                (("extract", self.ball, "--iso", 7, "--colors", "gray", "--vertex-error", "deviation_bar"), "--range"),
                (("extract", self.ball, "--iso", 7, *values, "--colors", "grau"), "viridis"),
                (("extract", self.ball, "--iso", 7, *values, "--range", "1,2"), "--colors"),
                (("extract", self.ball, "--iso", 7, *values, "--colors", "gray", "--range", "2,1"), "low value first"),
                (("slice", self.ball, "--plane", "0,0,1,8", "--contours", "5", "--colors", "gray"), "--colors"),
                (("extract", self.ball, "--iso", 7, "--up", "x"), "y or z"),
                (("extract", self.ball, "--iso", 7, "--up", "y"), ".glb")):
            path = self.folder / ("refused.vtp" if "--contours" in words else "refused.ply")
            with self.subTest(words=words[2:]):
                self.assertIn(said, self.run_program(*words, "-o", path, code=2))
                self.assertFalse(path.exists())
        for form in ("neuroglancer", "neuroglancer-multilod", "ply"):
            folder = self.folder / f"refused-{form}"
            with self.subTest(form=form):
                self.assertRegex(self.run_program("extract", self.folder / "labels.npy", "--labels", "all", "--smooth", "--format",
                                                  form, "--up", "y", "-o", folder, code=2), "--up|y up")
                self.assertEqual(list(folder.glob("*")), [])
        for end in ("stl", "obj", "vtp", "3mf"):
            with self.subTest(end=end):
                message = self.run_program("extract", self.ball, "--iso", 7, *values, "--colors", "gray", "-o",
                                           self.folder / f"refused.{end}", code=2)
                self.assertIn(".glb or .ply", message)
        self.assertIn("--up", self.run_program("slice", self.ball, "--plane", "0,0,1,8", "--up", "y", "-o",
                                               self.folder / "refused.png", code=2))


if __name__ == "__main__":
    unittest.main()
