"""Several labels or isovalues in one .glb or .3mf: each is an object with its name and colour, and with the
same triangles as in a file of its own; read by the specifications of glTF and 3MF, and by VTK.

Usage: mesh_collection_test.py ISONEST PLUGIN_FOLDER
"""
import json
import pathlib
import struct
import sys
import tempfile
import unittest
import zipfile
from xml.etree import ElementTree

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served  # noqa: E402
from mesh_data import read_points  # noqa: E402

import h5py
import numpy as np
from vtkmodules.vtkIOGeometry import vtkGLTFReader

isonest = sys.argv.pop(1)
sys.argv.pop(1)
CORE = "{http://schemas.microsoft.com/3dmanufacturing/core/2015/02}"
KINDS = {5126: "<f4", 5125: "<u4", 5123: "<u2"}


def glb_objects(path):
    """A list of (node, material, arrays by name)."""
    data = path.read_bytes()
    length, = struct.unpack_from("<I", data, 12)
    head, body = json.loads(data[20:20 + length]), data[28 + length:]
    assert struct.unpack_from("<I", data, 8)[0] == len(data) and head["buffers"][0]["byteLength"] == len(body)

    def array(index):
        accessor = head["accessors"][index]
        view = head["bufferViews"][accessor["bufferView"]]
        width = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[accessor["type"]]
        return np.frombuffer(body, KINDS[accessor["componentType"]], accessor["count"] * width, view["byteOffset"]).reshape(-1, width)

    objects = []
    assert head["scenes"][0]["nodes"] == list(range(len(head["nodes"])))
    for node in head["nodes"]:
        if "mesh" not in node:
            continue
        primitive, = head["meshes"][node["mesh"]]["primitives"]
        arrays = {name: array(index) for name, index in primitive["attributes"].items()}
        arrays["triangles"] = array(primitive["indices"]).reshape(-1, 3)
        box = head["accessors"][primitive["attributes"]["POSITION"]]
        np.testing.assert_allclose([box["min"], box["max"]], [arrays["POSITION"].min(0), arrays["POSITION"].max(0)])
        objects.append((node, head["materials"][primitive["material"]], arrays))
    return objects


def threemf_objects(path):
    """A list of (object, display colour, vertices, triangles), in the order of the build."""
    with zipfile.ZipFile(path) as archive:
        assert archive.testzip() is None
        model = ElementTree.fromstring(archive.read("3D/3dmodel.model"))
    numbers = [one.get("id") for one in model.find(f"{CORE}resources")]
    assert len(set(numbers)) == len(numbers)
    colors = {group.get("id"): group[0].get("displaycolor") for group in model.iter(f"{CORE}basematerials")}
    by_number = {one.get("id"): one for one in model.iter(f"{CORE}object")}
    objects = []
    for item in model.iter(f"{CORE}item"):
        one = by_number.pop(item.get("objectid"))
        vertices = np.array([[float(v.get(axis)) for axis in "xyz"] for v in one.iter(f"{CORE}vertex")], "f4")
        triangles = np.array([[int(t.get(corner)) for corner in ("v1", "v2", "v3")] for t in one.iter(f"{CORE}triangle")])
        objects.append((one, colors.get(one.get("pid")), vertices, triangles))
    assert not by_number
    return objects


def vtkhdf_objects(path):
    """A list of (name, attributes of the block, points, triangles), in the order of the assembly. By the specification of
    VTKHDF 2.1 (docs.vtk.org), section "PartitionedDataSetCollection and MultiBlockDataSet"."""
    objects = []
    with h5py.File(path) as file:
        root = file["VTKHDF"]
        assert tuple(root.attrs["Version"]) == (2, 1) and root.attrs["Type"] == b"PartitionedDataSetCollection"
        assembly = root["Assembly"]
        order = assembly.id.get_create_plist().get_link_creation_order()
        assert order == h5py.h5p.CRT_ORDER_TRACKED | h5py.h5p.CRT_ORDER_INDEXED
        names = []
        assembly.id.links.visit(lambda name: names.append(name.decode()), idx_type=h5py.h5.INDEX_CRT_ORDER)
        assert set(names) == set(root) - {"Assembly"}
        for index, name in enumerate(names):
            link = assembly.get(name, getlink=True)
            assert isinstance(link, h5py.SoftLink) and link.path == f"/VTKHDF/{name}"
            assert all(c.isascii() and (c.isalnum() or c in "_-") for c in name) and not name[0].isdigit(), name
            block = assembly[name]
            assert block.attrs["Index"] == index and block.attrs["Type"] == b"PolyData"
            assert block["NumberOfPoints"][()] == [len(block["Points"])]
            for kind in ("Vertices", "Lines", "Strips"):
                assert block[kind]["NumberOfCells"][()] == [0] and len(block[kind]["Connectivity"]) == 0
            faces = block["Polygons"]
            assert faces["NumberOfConnectivityIds"][()] == [len(faces["Connectivity"])]
            assert (faces["Offsets"][()] == 3 * np.arange(faces["NumberOfCells"][0] + 1)).all()
            objects.append((name, dict(block.attrs), block["Points"][()], faces["Connectivity"][()].reshape(-1, 3)))
    return objects


class MeshCollectionTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.temporary = tempfile.TemporaryDirectory()
        cls.folder = pathlib.Path(cls.temporary.name)
        z, y, x = np.meshgrid(*map(np.arange, (21, 26, 33)), indexing="ij")
        labels = np.zeros(x.shape, "u2")
        labels[np.hypot(np.hypot(x - 9, y - 12), z - 10) < 7] = 7
        labels[np.hypot(np.hypot(x - 22, y - 13), z - 10) < 8] = 300
        labels[20, 25, 32] = 9  # one node in a corner
        np.save(cls.folder / "labels.npy", labels)
        np.save(cls.folder / "ball.npy", np.hypot(np.hypot(x - 16, y - 12), z - 10).astype("f4"))
        (cls.folder / "names.txt").write_text('7 200 10 20 1 1 1 "left & <right>"\n300 20 200 20 1 1 1 "Röhre"\n', encoding="utf-8")
        cls.run_program("preprocess", "labels.npy", "--labels", "--label-names", "names.txt", "--unit", "um", "--frame", "lps",
                        "-o", "labels.isonest")
        cls.run_program("preprocess", "ball.npy", "-o", "ball.isonest")

    @classmethod
    def tearDownClass(cls):
        cls.temporary.cleanup()

    @classmethod
    def run_program(cls, *words, code=0):
        done = served.run([isonest, *map(str, words)], capture_output=True, text=True, cwd=cls.folder)
        assert done.returncode == code, (words, done.returncode, done.stderr)
        return done.stdout if code == 0 else done.stderr

    def test_each_label_is_an_object_with_its_own_mesh_name_and_color(self):
        names = {7: "left & <right>", 9: "label 9", 300: "Röhre"}
        colors = {7: (200, 10, 20), 9: None, 300: (20, 200, 20)}
        for options in (("--smooth", "--close"), (), ("--smooth", "--distance", "0.4", "--close", "--space", "as-stored")):
            extract = ("extract", "labels.isonest", "--labels", "all", *options)
            self.run_program(*extract, "--format", "ply", "-o", "apart")
            apart = {int(path.stem.split("_")[-1]): read_points(path) for path in (self.folder / "apart").glob("*.ply")}
            self.assertEqual(set(apart), {7, 9, 300})
            kept = [label for label in sorted(apart) if len(apart[label][1])]
            for end in ("glb", "3mf", "vtkhdf"):
                report = json.loads(self.run_program(*extract, "-o", f"all.{end}", "--json"))
                self.assertEqual([label["id"] for label in report["labels"]], [7, 9, 300])
                objects = READERS[end](self.folder / f"all.{end}")
                self.assertEqual(len(objects), len(kept))
                for label, one in zip(kept, objects):
                    with self.subTest(options=options, end=end, label=label):
                        points, faces = apart[label]
                        if end == "glb":
                            node, material, arrays = one
                            np.testing.assert_array_equal(arrays["POSITION"], points)
                            np.testing.assert_array_equal(arrays["triangles"], faces)
                            self.assertEqual((node["name"], material["name"]), (names[label], names[label]))
                            self.assertEqual(node["scale"], [1e-6] * 3)
                            color = material["pbrMetallicRoughness"]["baseColorFactor"][:3]
                            if colors[label]:
                                np.testing.assert_allclose(255 * np.array(color), [
                                    255 * (c / 255 / 12.92 if c <= 10 else ((c / 255 + 0.055) / 1.055) ** 2.4) for c in colors[label]], atol=1e-3)
                        elif end == "vtkhdf":
                            name, attributes, vertices, triangles = one
                            np.testing.assert_array_equal(vertices, points)
                            np.testing.assert_array_equal(triangles, faces)
                            self.assertEqual(attributes["Name"].decode(), names[label])
                            self.assertEqual((attributes["unit"], attributes["SPACE"]),
                                             (b"um", b"LPS" if "as-stored" in options else b"RAS"))
                            if colors[label]:
                                np.testing.assert_allclose(255 * attributes["Color"], colors[label], atol=1e-9)
                            self.assertEqual("Color" in attributes, colors[label] is not None)
                            self.assertEqual(name, {7: "left____right_", 9: "label_9", 300: "R__hre"}[label])
                        else:
                            element, color, vertices, triangles = one
                            np.testing.assert_array_equal(vertices, points)
                            np.testing.assert_array_equal(triangles, faces)
                            self.assertEqual(element.get("name"), names[label])
                            self.assertEqual(color, "#%02X%02X%02X" % colors[label] if colors[label] else None)
        reader = vtkGLTFReader()
        reader.SetFileName(str(self.folder / "all.glb"))
        reader.Update()
        self.assertEqual(reader.GetOutput().GetNumberOfBlocks(), len(kept))

    def test_one_label_is_one_object_and_empty_ones_are_left_out(self):
        self.run_program("extract", "labels.isonest", "--labels", "7", "-o", "seven.glb")
        self.run_program("extract", "labels.isonest", "--label", "7", "-o", "label.glb")
        self.assertEqual((self.folder / "seven.glb").read_bytes(), (self.folder / "label.glb").read_bytes())
        self.run_program("extract", "labels.isonest", "--labels", "all", "--min-component", "50", "--close", "-o", "large.3mf")
        self.assertEqual([one[0].get("name") for one in threemf_objects(self.folder / "large.3mf")], ["left & <right>", "Röhre"])
        for end, objects in READERS.items():
            self.run_program("extract", "labels.isonest", "--labels", "all", "--min-component", "1000000", "-o", f"none.{end}")
            self.assertEqual(objects(self.folder / f"none.{end}"), [])

    def test_isovalues_are_objects_and_have_the_colors_of_their_values(self):
        self.run_program("extract", "ball.isonest", "--iso", "4,6,8", "--colors", "gray", "--range", "4,8", "--normals", "-o", "iso.glb")
        objects = glb_objects(self.folder / "iso.glb")
        self.assertEqual([one[0]["name"] for one in objects], ["isovalue 4", "isovalue 6", "isovalue 8"])
        self.run_program("extract", "ball.isonest", "--iso", "4,6,8", "--normals", "-o", "iso_{iso}.ply")
        for value, (_, material, arrays) in zip((4, 6, 8), objects):
            points, faces = read_points(self.folder / f"iso_{value}.ply")
            np.testing.assert_array_equal(arrays["POSITION"], points)
            np.testing.assert_array_equal(arrays["triangles"], faces)
            self.assertEqual(arrays["NORMAL"].shape, points.shape)
            gray = (round(255 * (value - 4) / 4) / 255 + 0.055) / 1.055
            np.testing.assert_allclose(material["pbrMetallicRoughness"]["baseColorFactor"][:3],
                                       [gray ** 2.4 if value > 4 else 0] * 3, atol=1e-2)
        self.run_program("extract", "ball.isonest", "--iso", "4,6,8", "-o", "iso.3mf")
        self.assertEqual(len(threemf_objects(self.folder / "iso.3mf")), 3)

    def test_objects_have_values_of_other_stores(self):
        self.run_program("extract", "labels.isonest", "--labels", "all", "--smooth", "--vertex-values", "r=ball.isonest",
                         "--colors", "gray", "-o", "felt.glb")
        for _, _, arrays in glb_objects(self.folder / "felt.glb"):
            self.assertEqual(arrays["_R"].shape, (len(arrays["POSITION"]), 1))
            self.assertEqual(arrays["COLOR_0"].shape, (len(arrays["POSITION"]), 4))

    def test_bytes_are_the_same_for_any_threads_and_memory(self):
        for end in READERS:
            files = []
            for options in ((), ("--threads", "1"), ("--threads", "5", "--memory", "300M")):
                self.run_program("extract", "labels.isonest", "--labels", "all", "--smooth", "--close", *options, "-o", f"same.{end}")
                files.append((self.folder / f"same.{end}").read_bytes())
            self.assertEqual(files[1:], files[:1] * 2)

    def test_blocks_of_vtkhdf_have_names_and_attributes_of_their_own(self):
        (self.folder / "twice.txt").write_text('7 0 0 0 1 1 1 "a.b"\n300 1 1 1 1 1 1 "a/b"\n9 1 1 1 1 1 1 "Assembly"\n')
        self.run_program("preprocess", "labels.npy", "--labels", "--label-names", "twice.txt", "-o", "twice.isonest")
        self.run_program("extract", "twice.isonest", "--labels", "all", "--smooth", "--close", "--vertex-values",
                         "r=ball.isonest", "-o", "twice.vtkhdf")
        self.assertEqual([one[0] for one in vtkhdf_objects(self.folder / "twice.vtkhdf")], ["a_b", "_Assembly", "a_b_2"])
        with h5py.File(self.folder / "twice.vtkhdf") as file:
            for name in ("a_b", "a_b_2"):
                block = file["VTKHDF"][name]
                expected = np.linalg.norm(block["Points"][()] - (16, 12, 10), axis=1)
                np.testing.assert_allclose(block["PointData/r"][()], expected, atol=0.2)
        # Several isovalues stay one mesh, with the isovalue of each triangle.
        self.run_program("extract", "ball.isonest", "--iso", "4,6", "-o", "iso.vtkhdf")
        with h5py.File(self.folder / "iso.vtkhdf") as file:
            self.assertEqual(file["VTKHDF"].attrs["Type"], b"PolyData")
            self.assertEqual(set(file["VTKHDF/CellData/isovalue"][()]), {4, 6})

    def test_other_names_and_inputs_are_refused(self):
        extract = ("extract", "labels.isonest", "--labels", "all", "-o")
        self.assertIn(".3mf", self.run_program(*extract, "new.ply", code=2))
        self.assertIn("--over", self.run_program(*extract, "new.glb", "--over", "zarr", code=2))
        self.run_program(*extract, "labels.isonest", code=2)
        self.assertIn("glb", self.run_program("extract", "ball.isonest", "--iso", "4,6", "-o", "two.stl", code=2))
        # A folder that exists stays a folder.
        (self.folder / "folder.glb").mkdir()
        self.run_program(*extract, "folder.glb")
        self.assertTrue((self.folder / "folder.glb" / "labels.json").exists())
        self.assertEqual([path.name for path in self.folder.iterdir() if path.name.startswith(".")], [])


READERS = {"glb": glb_objects, "3mf": threemf_objects, "vtkhdf": vtkhdf_objects}
unittest.main(verbosity=2)
