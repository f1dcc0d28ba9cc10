#!/usr/bin/env python3
"""--mesh-unit: positions of mesh files in another unit of length, in every format that has no unit of its own.

Compared with the same mesh in the volume's unit, multiplied here.

usage: mesh_unit_test.py ISONEST PLUGIN_FOLDER
"""
import json
import os
import pathlib
import sys
import tempfile
import unittest

import h5py
import numpy as np
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkIOGeometry import vtkOBJReader, vtkSTLReader
from vtkmodules.vtkIOXML import vtkXMLPolyDataReader

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served  # noqa: E402
from mesh_data import read_points  # noqa: E402

ISONEST = sys.argv[1]
os.environ["HDF5_PLUGIN_PATH"] = sys.argv[2]


def run(*arguments, code=0):
    done = served.run([ISONEST, *map(str, arguments)], capture_output=True, text=True)
    assert done.returncode == code, (arguments, done.returncode, done.stderr)
    return done.stdout if code == 0 else done.stderr


def read_by(reader, path):
    reader.SetFileName(str(path))
    reader.Update()
    return vtk_to_numpy(reader.GetOutput().GetPoints().GetData())


def stl_points(path):
    """Of all corners, in the order of the file."""
    data = path.read_bytes()
    return np.frombuffer(data, [("n", "<f4", 3), ("p", "<f4", (3, 3)), ("a", "<u2")], offset=84)["p"].reshape(-1, 3)


class MeshUnit(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory(prefix="isonest-test-", dir=served.MEMORY)
        cls.addClassCleanup(folder.cleanup)
        cls.here = pathlib.Path(folder.name)
        z, y, x = np.mgrid[:14, :15, :16].astype("f4")
        ball = np.hypot(np.hypot(x - 7, y - 7), z - 6)
        np.save(cls.here / "ball.npy", ball)
        np.save(cls.here / "labels.npy", (ball < 5).astype("u1") + (ball < 3))
        place = ("--spacing", "0.3,0.31,0.32", "--origin", "5,6,7")
        run("preprocess", cls.here / "ball.npy", "-o", cls.here / "ball.isonest", "--unit", "mm", *place)
        run("preprocess", cls.here / "ball.npy", "-o", cls.here / "unknown.isonest", *place)
        run("preprocess", "--labels", cls.here / "labels.npy", "-o", cls.here / "labels.isonest", "--unit", "mm", *place)

    def test_each_format(self):
        surface = ("extract", self.here / "ball.isonest", "--iso", 5.1, "--normals")
        run(*surface, "-o", self.here / "mm.ply")
        points, faces = read_points(self.here / "mm.ply")
        for unit, factor in (("m", 1e-3), ("um", 1000), ("in", 1 / 25.4)):
            expected = (points.astype(float) * factor).astype("f4")
            for end in ("ply", "stl", "obj", "vtp", "vtkhdf"):
                with self.subTest(unit=unit, end=end):
                    mesh = self.here / f"m.{end}"
                    report = json.loads(run(*surface, "-o", mesh, "--mesh-unit", unit, "--json"))
                    plain = json.loads(run(*surface, "-o", self.here / f"plain.{end}", "--json"))
                    self.assertEqual(report["mesh_unit"], unit)
                    self.assertNotIn("mesh_unit", plain)
                    for name in ("unit", "area", "vertices", "error_bound", "coordinate_rounding"):
                        self.assertEqual(report[name], plain[name], name)
                    if end == "ply":
                        found, own = read_points(mesh)
                        np.testing.assert_array_equal(own, faces)
                        self.assertIn(f"comment unit {unit}".encode(), mesh.read_bytes())
                    elif end == "stl":
                        found = stl_points(mesh)
                        self.assertEqual(read_by(vtkSTLReader(), mesh).shape[1], 3)
                    elif end == "obj":
                        found = read_by(vtkOBJReader(), mesh)
                        self.assertIn(f"# unit {unit}", mesh.read_text())
                    elif end == "vtp":
                        found = read_by(vtkXMLPolyDataReader(), mesh)
                    else:
                        with h5py.File(mesh) as file:
                            found = file["VTKHDF/Points"][()]
                            self.assertEqual(file["VTKHDF"].attrs["unit"].decode(), unit)
                    np.testing.assert_allclose(found, expected[faces.ravel()] if end == "stl" else expected,
                                               rtol=0 if end != "obj" else 1e-6)

    def test_labels(self):
        labels = ("extract", self.here / "labels.isonest", "--labels", "all", "--smooth", "--close")
        run(*labels, "-o", self.here / "mm")
        text = run(*labels, "-o", self.here / "m", "--mesh-unit", "m")
        self.assertIn("positions in the file are in m, but everything reported here is in the unit of the volume", text)
        run(*labels, "-o", self.here / "all.vtkhdf", "--mesh-unit", "m")
        with h5py.File(self.here / "all.vtkhdf") as file:
            for label in (1, 2):
                points = read_points(self.here / "mm" / f"{label}.ply")[0]
                expected = (points.astype(float) * 1e-3).astype("f4")
                np.testing.assert_array_equal(read_points(self.here / "m" / f"{label}.ply")[0], expected)
                block = file[f"VTKHDF/label_{label}"]
                np.testing.assert_array_equal(block["Points"][()], expected)
                self.assertEqual(block.attrs["unit"].decode(), "m")
        for end in ("msh", "smesh"):
            made = []
            for options in ((), ("--mesh-unit", "m")):
                run(*labels, "--interfaces", "-o", self.here / f"i.{end}", *options)
                data = (self.here / f"i.{end}").read_bytes()
                if end == "msh":
                    at = data.index(b"$Nodes\n") + 7
                    count = int(np.frombuffer(data, "<u8", 2, at)[1])
                    made.append(np.frombuffer(data, "<f8", 3 * count, at + 32 + 20 + 8 * count))
                else:
                    rows = [line.split() for line in data.decode().split("\n") if line[:1] not in ("", "#")]
                    made.append(np.array([row[1:] for row in rows[1:1 + int(rows[0][0])]], float).ravel())
            np.testing.assert_allclose(made[1], made[0] * 1e-3, rtol=1e-7)
        before = json.loads((self.here / "mm" / "labels.json").read_text())
        after = json.loads((self.here / "m" / "labels.json").read_text())
        self.assertEqual(after.pop("mesh_unit"), "m")
        before.pop("folder"), after.pop("folder")
        self.assertEqual(before, after)

    def test_slices_and_values(self):
        run("slice", self.here / "ball.isonest", "--plane", "0,0,1,8.92", "-o", self.here / "s.ply")
        run("slice", self.here / "ball.isonest", "--plane", "0,0,1,8.92", "-o", self.here / "t.ply", "--mesh-unit", "m")
        before, after = (read_points(self.here / f"{name}.ply")[0] for name in "st")
        np.testing.assert_array_equal(after, (before.astype(float) * 1e-3).astype("f4"))
        # Values of another store are those at the place in the volume.
        felt = []
        for options in ((), ("--mesh-unit", "m")):
            run("extract", self.here / "labels.isonest", "--label", 1, "--vertex-values", f"r={self.here / 'ball.isonest'}",
                "-o", self.here / "v.vtp", *options)
            reader = vtkXMLPolyDataReader()
            reader.SetFileName(str(self.here / "v.vtp"))
            reader.Update()
            felt.append(vtk_to_numpy(reader.GetOutput().GetPointData().GetArray("r")))
        np.testing.assert_array_equal(*felt)

    def test_refused(self):
        surface = ("extract", self.here / "ball.isonest", "--iso", 5.1, "--mesh-unit", "m", "-o")
        for name, says in (("no.glb", "unit of their own"), ("no.3mf", "unit of their own")):
            self.assertIn(says, run(*surface, self.here / name, code=2))
            self.assertFalse((self.here / name).exists())
        self.assertIn("always in metres", run(*surface, self.here / "tiles", "--format", "3dtiles", code=2))
        labels = ("extract", self.here / "labels.isonest", "--labels", "all", "--smooth", "--mesh-unit", "m", "-o")
        self.assertIn("nanometres", run(*labels, self.here / "n", "--format", "neuroglancer-multilod", code=2))
        self.assertIn("unit of their own", run(*labels, self.here / "n", "--format", "neuroglancer", code=2))
        self.assertIn("unit of their own", run(*labels, self.here / "all.glb", code=2))
        unknown = run("extract", self.here / "unknown.isonest", "--iso", 5.1, "--mesh-unit", "m", "-o", self.here / "no.ply", code=2)
        self.assertIn("unknown", unknown)
        self.assertIn("--unit", unknown)
        self.assertIn("one of", run("extract", self.here / "ball.isonest", "--iso", 5.1, "--mesh-unit", "ell", "-o",
                                    self.here / "no.ply", code=2))
        self.assertIn("picture", run("slice", self.here / "ball.isonest", "--plane", "0,0,1,8", "--mesh-unit", "m", "-o",
                                     self.here / "no.png", code=2))
        self.assertFalse((self.here / "no.ply").exists())


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
