#!/usr/bin/env python3
"""Volumes with axes that are not along the world's: every output is in the same place as the input.

usage: direction_test.py ISONEST PLUGIN_FOLDER
"""
import itertools
import json
import os
import pathlib
import struct
import sys
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served  # noqa: E402

os.environ["HDF5_PLUGIN_PATH"] = sys.argv[2]
try:
    import h5py
    import nibabel
    import numpy as np
    import vtk
    from vtk.util import numpy_support
    from volume_inputs import ISONEST, Input
except ImportError as error:
    print(f"skipped: {error}")
    sys.exit(77)

SHAPE = (14, 17, 20)  # z, y, x
SPACING = np.array([0.8, 1.1, 2.0])
ORIGIN = np.array([-30.0, 12.0, 55.0])


def rotation(seed):
    """A proper rotation, far from the axes."""
    q, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    return q * np.linalg.det(q)


def smooth():
    z, y, x = np.mgrid[:SHAPE[0], :SHAPE[1], :SHAPE[2]]
    return (np.hypot(np.hypot(x - 9, y - 8), 1.5 * (z - 6)) + 0.3 * np.sin(x * y)).astype("f4")


def read_mesh(path):
    reader = vtk.vtkXMLPolyDataReader()
    reader.SetFileName(str(path))
    reader.Update()
    mesh = reader.GetOutput()
    arrays = mesh.GetPointData()
    triangles = numpy_support.vtk_to_numpy(mesh.GetPolys().GetConnectivityArray()).reshape(-1, 3) \
        if mesh.GetNumberOfPolys() else None
    return (numpy_support.vtk_to_numpy(mesh.GetPoints().GetData()), triangles,
            {arrays.GetArrayName(i): numpy_support.vtk_to_numpy(arrays.GetArray(i))
             for i in range(arrays.GetNumberOfArrays())})


class Direction(Input):
    def setUp(self):
        super().setUp()
        self.data = smooth()

    def nifti(self, matrix, data=None):
        data = self.data if data is None else data
        affine = np.eye(4)
        affine[:3, :3] = matrix * SPACING
        affine[:3, 3] = ORIGIN
        self.path = self.here / "v.nii"
        nibabel.save(nibabel.Nifti2Image(data.T, affine), self.path)
        return affine

    def run_it(self, *arguments, code=0):
        done = served.run([ISONEST, *map(str, arguments)], capture_output=True, text=True)
        self.assertEqual(done.returncode, code, done.stderr)
        return done

    def stores(self, matrix):
        """The rotated volume, and the same volume along the axes, with the same origin."""
        self.nifti(matrix)
        self.run_it("preprocess", self.path, "-o", self.here / "r", "--chunk", "8", "--force")
        self.nifti(np.eye(3))
        self.run_it("preprocess", self.path, "-o", self.here / "s", "--chunk", "8", "--force")

    def turned(self, points, matrix):
        return (points - ORIGIN) @ matrix.T + ORIGIN

    def test_the_store_says_how_its_axes_lie(self):
        matrix = rotation(1)
        self.stores(matrix)
        info = json.loads(self.run_it("info", self.here / "r", "--json").stdout)
        np.testing.assert_allclose(np.array(info["direction"]).T, matrix, atol=1e-12)
        np.testing.assert_allclose(info["origin"], ORIGIN)
        np.testing.assert_allclose(info["spacing"], SPACING)
        with h5py.File(self.here / "r") as file:
            self.assertEqual(file.attrs["flags"], 1)
            np.testing.assert_allclose(file["VTKHDF"].attrs["Direction"].reshape(3, 3), matrix, atol=1e-12)
            np.testing.assert_allclose(file.attrs["direction"].reshape(3, 3).T, matrix, atol=1e-12)
        self.run_it("check", self.here / "r", "--deep")
        self.assertIn("axes along", self.run_it("info", self.here / "r").stdout)
        with h5py.File(self.here / "r", "r+") as file:
            file.attrs.modify("direction", file.attrs["direction"][[1, 2, 0, 4, 5, 3, 7, 8, 6]])
        self.assertIn("directions", self.run_it("info", self.here / "r", code=4).stderr)

    def test_meshes_are_the_turned_ones(self):
        for seed, options in itertools.product((1, 2), ((), ("--error", "0.3"), ("--distance", "0.5"), ("--cells", "hex"),
                                                        ("--triangles", "300"), ("--close",),
                                                        ("--triangles", "600", "--by", "error"),
                                                        ("--triangles", "600", "--by", "error"))):
            with self.subTest(seed=seed, options=options):
                matrix = rotation(seed)
                self.stores(matrix)
                for name in "rs":
                    self.run_it("extract", self.here / name, "--iso", "6.05", "--normals", *options, "-o",
                                self.here / f"{name}.vtp")
                turned, plain = read_mesh(self.here / "r.vtp"), read_mesh(self.here / "s.vtp")
                np.testing.assert_array_equal(turned[1], plain[1])
                np.testing.assert_allclose(turned[0], self.turned(plain[0], matrix), atol=1e-5)
                np.testing.assert_allclose(turned[2]["normal"], plain[2]["normal"] @ matrix.T, atol=1e-6)
                for path in ("r", "s"):
                    (self.here / f"{path}.vtp").unlink()

    def test_a_mesh_lies_where_vtk_puts_it(self):
        matrix = rotation(3)
        self.stores(matrix)
        self.run_it("extract", self.here / "r", "--iso", "6.05", "-o", self.here / "r.vtp")
        image = vtk.vtkImageData()
        image.SetDimensions(*SHAPE[::-1])
        image.SetSpacing(SPACING)
        image.SetOrigin(ORIGIN)
        image.SetDirectionMatrix(matrix.ravel())
        image.GetPointData().SetScalars(numpy_support.numpy_to_vtk(self.data.ravel()))
        contour = vtk.vtkFlyingEdges3D()
        contour.SetInputData(image)
        contour.SetValue(0, 6.05)
        contour.Update()
        distance = vtk.vtkDistancePolyDataFilter()
        reader = vtk.vtkXMLPolyDataReader()
        reader.SetFileName(str(self.here / "r.vtp"))
        distance.SetInputConnection(0, reader.GetOutputPort())
        distance.SetInputConnection(1, contour.GetOutputPort())
        distance.SignedDistanceOff()
        distance.Update()
        far = numpy_support.vtk_to_numpy(distance.GetOutput().GetPointData().GetArray("Distance"))
        self.assertLess(far.max(), 0.5 * SPACING.min())
        self.assertGreater(len(far), 500)

    def test_slices_contours_focus_and_camera_are_in_the_world(self):
        matrix = rotation(4)
        self.stores(matrix)
        centre = ORIGIN + matrix @ (SPACING * np.array([9, 8, 6]))
        normal = np.array([0.2, -0.5, 0.84])
        plane = ",".join(map(repr, [*map(float, normal), float(normal @ centre)]))
        own = matrix.T @ normal
        local = ORIGIN + SPACING * np.array([9, 8, 6])
        own_plane = ",".join(map(repr, [*map(float, own), float(own @ local)]))
        for options in ((), ("--contours", "5,7")):
            for name, p in (("r", plane), ("s", own_plane)):
                self.run_it("slice", self.here / name, "--plane=" + p, *options, "-o", self.here / f"{name}.vtp")
            turned, plain = read_mesh(self.here / "r.vtp"), read_mesh(self.here / "s.vtp")
            np.testing.assert_allclose(turned[0] @ normal, normal @ centre, atol=1e-4)
            # Nodes in the plane may be on different sides, because the plane is rounded.
            far = np.linalg.norm(turned[0][:, None] - self.turned(plain[0], matrix)[None], axis=2)
            self.assertLess(np.quantile(far.min(1), 0.99), 1e-3)
            self.assertLess(np.quantile(far.min(0), 0.99), 1e-3)
            for name in "rs":
                (self.here / f"{name}.vtp").unlink()
        self.run_it("slice", self.here / "r", "--plane=" + plane, "-o", self.here / "p.png")
        for where in ("--focus", "--camera"):
            for name, p in (("r", centre), ("s", local)):
                text = ",".join(map(repr, map(float, p)))
                options = (where + "=" + text, "--falloff", "0.5") if where == "--focus" else (where + "=" + text,)
                self.run_it("extract", self.here / name, "--iso", "6.05", "--error", "0.2", *options, "-o",
                            self.here / f"{name}.vtp")
            turned, plain = read_mesh(self.here / "r.vtp"), read_mesh(self.here / "s.vtp")
            self.assertLess(abs(len(turned[0]) - len(plain[0])), 0.02 * len(plain[0]) + 3)
            for name in "rs":
                (self.here / f"{name}.vtp").unlink()

    def test_all_mesh_formats_and_the_box_of_glb(self):
        matrix = rotation(5)
        self.stores(matrix)
        for name in ("m.ply", "m.stl", "m.obj", "m.vtp", "m.vtkhdf", "m.glb", "m.3mf"):
            self.run_it("extract", self.here / "r", "--iso", "6.05", "-o", self.here / name)
        points = read_mesh(self.here / "m.vtp")[0]
        glb = (self.here / "m.glb").read_bytes()
        head = json.loads(glb[20:20 + struct.unpack("<I", glb[12:16])[0]])
        box = next(a for a in head["accessors"] if "min" in a)
        np.testing.assert_allclose(box["min"], points.min(0), rtol=1e-6)
        np.testing.assert_allclose(box["max"], points.max(0), rtol=1e-6)

    def test_exported_volumes_lie_there_too(self):
        for matrix in (rotation(6), np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0.0]])):
            affine = self.nifti(matrix)
            self.reads(self.data)
            for name in ("e.nii", "e.vti", "e.mha", "e.nrrd", "e.h5"):
                self.run_it("export", self.here / "s.isonest", "--field", "values", "-o", self.here / name, "--force")
                self.path = self.here / name
                self.run_it("preprocess", self.path, "-o", self.here / "again", "--force")
                info = json.loads(self.run_it("info", self.here / "again", "--json").stdout)
                # NIfTI uses RAS, and MetaImage LPS: the same positions with x and y negated.
                turn = np.array([-1, -1, 1] if name == "e.mha" else [1, 1, 1])
                self.assertEqual(info["frame"], {"e.mha": "LPS", "e.vti": None}.get(name, "RAS"))
                np.testing.assert_allclose(np.array(info["direction"]).T, turn[:, None] * matrix, atol=1e-6)
                np.testing.assert_allclose(info["origin"], turn * ORIGIN, rtol=1e-6)
            np.testing.assert_allclose(nibabel.load(self.here / "e.nii").affine, affine, atol=1e-5)
            reader = vtk.vtkXMLImageDataReader()
            reader.SetFileName(str(self.here / "e.vti"))
            reader.Update()
            found = reader.GetOutput().GetDirectionMatrix()
            np.testing.assert_allclose([[found.GetElement(i, j) for j in range(3)] for i in range(3)], matrix, atol=1e-7)

    def test_left_handed_axes_are_turned_around(self):
        matrix = rotation(7) * np.array([-1, 1, 1])
        self.nifti(matrix)
        self.reads(np.ascontiguousarray(self.data[:, :, ::-1]))
        info = json.loads(self.run_it("info", self.here / "s.isonest", "--json").stdout)
        found = np.array(info["direction"]).T
        self.assertAlmostEqual(np.linalg.det(found), 1)
        last = np.array(info["origin"]) + found @ (np.array(info["spacing"]) * (SHAPE[2] - 1, 0, 0))
        np.testing.assert_allclose(last, ORIGIN, atol=1e-9)

    def test_parts_keep_their_place(self):
        matrix = rotation(8)
        self.nifti(matrix)
        self.reads(np.ascontiguousarray(self.data[3::2, 2:, 4:-2]), "--crop", "4:-2,2:,3:", "--every", "1,1,2")
        info = json.loads(self.run_it("info", self.here / "s.isonest", "--json").stdout)
        np.testing.assert_allclose(info["origin"], ORIGIN + matrix @ (SPACING * (4, 2, 3)))
        self.run_it("check", self.here / "s.isonest", "--source", self.path, "--crop", "4:-2,2:,3:", "--every", "1,1,2")

    def test_what_cannot_be_turned_is_refused(self):
        self.stores(rotation(9))
        done = self.run_it("extract", self.here / "r", "--iso", "6", "--box=-30,12,55,-20,20,60", "-o", self.here / "m.ply",
                           code=5)
        self.assertIn("crop", done.stderr)
        self.nifti(rotation(9), self.data[:1])
        self.run_it("preprocess", self.path, "-o", self.here / "p", "--force")
        self.run_it("extract", self.here / "p", "--graph", "--scale", "1", "-o", self.here / "m.ply", code=5)
        self.run_it("extract", self.here / "p", "--iso", "9", "-o", self.here / "m.vtp")

    def test_smoothed_volumes_stay_there(self):
        self.stores(rotation(10))
        self.run_it("smooth", self.here / "r", "--steps", "1", "--tau", "0.1", "--lambda", "1", "-o", self.here / "f.nrrd", "--force")
        self.path = self.here / "f.nrrd"
        self.run_it("preprocess", self.path, "-o", self.here / "again", "--force")
        info = json.loads(self.run_it("info", self.here / "again", "--json").stdout)
        np.testing.assert_allclose(np.array(info["direction"]).T, rotation(10), atol=1e-12)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
