"""Every normal has length 1, in every format with normals: also where the data have no gradient, beside missing values,
where meshes are clipped, closed or mended, on slices and on graphs. Where the gradient is 0, the normal is that of the
surrounding triangles, which numpy recomputes.

Usage: normals_test.py ISONEST PLUGIN_FOLDER
"""
import json
import pathlib
import struct
import subprocess
import sys
import tempfile
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served  # noqa: E402

import h5py
import numpy as np
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkIOPLY import vtkPLYReader
from vtkmodules.vtkIOXML import vtkXMLPolyDataReader

ISONEST = sys.argv[1]
PACKAGES = pathlib.Path(__file__).resolve().parents[2] / "tools/view/web/node_modules"
VALIDATE = """
const validator = require(process.argv[1]);
const fs = require("fs");
Promise.all(process.argv.slice(2).map(async file => {
    const report = await validator.validateBytes(new Uint8Array(fs.readFileSync(file)));
    return report.issues.messages.filter(m => m.severity < 2).map(m => file + ": " + m.code + " " + m.pointer);
})).then(all => console.log(JSON.stringify(all.flat())));
"""


def of_vtk(reader, path):
    reader.SetFileName(str(path))
    reader.Update()
    data = reader.GetOutput()
    polys = vtk_to_numpy(data.GetPolys().GetConnectivityArray()).reshape(-1, 3)
    return (vtk_to_numpy(data.GetPoints().GetData()), polys, vtk_to_numpy(data.GetPointData().GetNormals()))


def of_obj(path):
    lines = [line.split() for line in path.read_text().splitlines()]
    rows = lambda word: np.array([line[1:] for line in lines if line and line[0] == word])
    faces = np.array([[[int(n) - 1 for n in corner.split("//")] for corner in face] for face in rows("f")])
    assert (faces[..., 0] == faces[..., 1]).all()
    return rows("v").astype("f4"), faces[..., 0], rows("vn").astype("f4")


def of_vtkhdf(path):
    with h5py.File(path) as file:
        root = file["VTKHDF"]
        return root["Points"][:], root["Polygons/Connectivity"][:].reshape(-1, 3), root["PointData/normal"][:]


def of_glb(path):
    data = path.read_bytes()
    (length,) = struct.unpack_from("<I", data, 12)
    head = json.loads(data[20:20 + length])
    primitive = head["meshes"][0]["primitives"][0]

    def array(index, kind):
        accessor = head["accessors"][index]
        view = head["bufferViews"][accessor["bufferView"]]
        return np.frombuffer(data, kind, view["byteLength"] // 4, 28 + length + view["byteOffset"]).reshape(-1, 3)

    of = primitive["attributes"]
    return array(of["POSITION"], "<f4"), array(primitive["indices"], "<u4"), array(of["NORMAL"], "<f4")


READERS = {"ply": lambda path: of_vtk(vtkPLYReader(), path), "obj": of_obj, "vtkhdf": of_vtkhdf, "glb": of_glb,
           "vtp": lambda path: of_vtk(vtkXMLPolyDataReader(), path)}


def of_triangles(points, triangles):
    """At each vertex the sum over the surrounding triangles, weighted by area and scaled to length 1."""
    p = points.astype("f8")[triangles]
    each = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    total = np.zeros((len(points), 3))
    for corner in range(3):
        np.add.at(total, triangles[:, corner], each)
    size = np.linalg.norm(total, axis=1)
    return total / np.where(size > 0, size, 1)[:, None], size


class Normals(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.temporary = tempfile.TemporaryDirectory(dir=served.MEMORY)
        cls.here = pathlib.Path(cls.temporary.name)
        cls.glbs = []

    @classmethod
    def tearDownClass(cls):
        cls.temporary.cleanup()

    def run_program(self, *arguments):
        done = served.run([ISONEST, *map(str, arguments)], capture_output=True, text=True)
        self.assertEqual(done.returncode, 0, (arguments, done.stderr))

    def volume(self, name, values, *options):
        """A file and its store."""
        np.save(self.here / f"{name}.npy", values)
        self.run_program("preprocess", self.here / f"{name}.npy", "-o", self.here / f"{name}.isonest", *options)
        return self.here / f"{name}.npy", self.here / f"{name}.isonest"

    def meshes(self, *command):
        """Points, triangles and normals: the same from all formats, with normals of length 1."""
        first = None
        for end, read in READERS.items():
            path = self.here / f"m{len(self.glbs)}.{end}"
            self.run_program(*command, "-o", path)
            points, triangles, normals = read(path)
            self.assertGreater(len(triangles), 0, command)
            self.assertEqual(normals.shape, points.shape)
            sizes = np.linalg.norm(normals.astype("f8"), axis=1)
            self.assertLess(np.abs(sizes - 1).max(), 1e-5, (command, end))
            first = first or (points, triangles, normals)
            self.assertTrue(np.array_equal(triangles, first[1]), (command, end))
            self.assertLess(np.abs(normals - first[2]).max(), 1e-5, (command, end))
        self.glbs.append(self.here / f"m{len(self.glbs)}.glb")
        return first

    def alternating(self, shape):
        """Values that alternate from node to node: all central differences are 0, except at the border."""
        return ((-1) ** np.indices(shape).sum(0) * 50 + 100).astype("u1")

    def test_of_the_triangles_around_where_the_gradient_is_0(self):
        values = self.alternating((7, 9, 8))
        inner = np.pad(values, 3, constant_values=100)  # no other values beside the border
        file, store = self.volume("alternating", inner, "--spacing", "1,2,0.5", "--origin", "3,-4,5")
        place = ("--spacing", "1,2,0.5", "--origin", "3,-4,5")
        for source, options in ((store, ()), (store, ("--cells", "hex")), (file, place)):
            for iso in (100.5, 117):
                points, triangles, normals = self.meshes("extract", source, "--iso", iso, "--normals", *options)
                around, size = of_triangles(points, triangles)
                # Normals that do not come from a gradient, which is 0 in the middle of the pattern.
                low, high = np.array((3, -4, 5)) + np.array((5, 5, 5)) * (1, 2, 0.5), np.array(
                    (3, -4, 5)) + np.array((9, 10, 8)) * (1, 2, 0.5)
                middle = ((points > low) & (points < high)).all(1) & (size > 1e-3)
                self.assertGreater(middle.sum(), 20, options)
                self.assertLess(np.abs(around - normals)[middle].max(), 1e-5, options)

    def test_of_hard_values(self):
        one = np.random.default_rng(1)
        noise = one.normal(size=(15, 14, 17)).astype("f4")
        holes = noise.copy()
        holes[one.random(noise.shape) < 0.1] = np.nan
        plateaus = np.floor(3 * np.sin(np.indices((17, 16, 15)) / 2).sum(0)).astype("i2")
        for name, values, iso in (
                ("holes", holes, 0.1), ("plateaus", plateaus, 1), ("tiny", noise.astype("f8") * 1e-310, 1e-311),
                ("huge", noise.astype("f8") * 3e307, 1e307), ("two", (noise > 0).astype("u1"), 0.5)):
            file, store = self.volume(name, values)
            for options in (("--cells", "tet"), ("--cells", "hex"), ("--vertices", "exact", "--cells", "tet"),
                            ("--close", "--box", "0.3,0.4,0.5,11.2,12.7,12.1"), ("--box", "1.3,2.4,1.5,9.2,10.7,9.1"),
                            ("--distance", "0.5")):
                with self.subTest(name, options=options):
                    self.meshes("extract", store, "--iso", iso, "--normals", *options)
            with self.subTest(name, options="file"):
                self.meshes("extract", file, "--iso", iso, "--normals")

    def test_of_slices_and_graphs(self):
        _, store = self.volume("slices", self.alternating((9, 9, 9)), "--spacing", "1,2,0.5", "--indicators", "deviation_bar,hex_deviation")
        for plane in ("0,0,1,2.2", "1,0,0,0", "1,1,0,7.7", "-3,1,2,-2.5"):
            for cells in ("tet", "hex"):
                if cells == "hex" and plane.count("0,") < 2:
                    continue
                points, triangles, normals = self.meshes("slice", store, "--plane", plane, "--normals", "--cells", cells)
                direction = np.array([float(x) for x in plane.split(",")[:3]])
                direction /= np.linalg.norm(direction)
                self.assertLess(np.abs(np.abs(normals @ direction) - 1).max(), 1e-6, plane)
                around, size = of_triangles(points, triangles)
                self.assertGreater((around * normals).sum(1)[size > 0].min(), 0.99, (plane, cells))
        one = np.random.default_rng(3)
        for name, values in (("flat", self.alternating((33, 25))), ("rough", one.integers(0, 90, (33, 25)).astype("i2"))):
            _, store = self.volume(name, values)
            for options in ((), ("--error", 5), ("--cells", "quad"), ("--box", "1.3,1.4,-1,20.2,19.1,1")):
                with self.subTest(name, options=options):
                    points, _, normals = self.meshes("extract", store, "--graph", "--scale", 3, "--normals", *options)
                    self.assertGreater(normals[:, 2].min(), 0)

    def test_z_is_for_the_validator_of_gltf(self):
        """With npm's gltf-validator, if it is installed among the packages of the viewer's page."""
        if not (PACKAGES / "gltf-validator").is_dir():
            self.skipTest("gltf-validator is not among the packages of the viewer's page")
        self.assertGreater(len(self.glbs), 10)
        done = subprocess.run(["node", "-e", VALIDATE, str(PACKAGES / "gltf-validator"), *map(str, self.glbs)],
                              capture_output=True, text=True, check=True)
        self.assertEqual(json.loads(done.stdout), [])


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
