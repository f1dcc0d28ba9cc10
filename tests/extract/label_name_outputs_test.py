#!/usr/bin/env python3
"""Labels selected by name, and names and colours in the outputs: lists, glTF, 3MF, VTK.

usage: label_name_outputs_test.py ISONEST PLUGIN_FOLDER
"""
import json
import os
import pathlib
import sys
import tempfile
import unittest
import xml.etree.ElementTree as ElementTree
import zipfile

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served  # noqa: E402
from mesh_data import read_glb  # noqa: E402

ISONEST = sys.argv[1]
os.environ["HDF5_PLUGIN_PATH"] = sys.argv[2]

import numpy as np  # noqa: E402
from vtkmodules.util.numpy_support import vtk_to_numpy  # noqa: E402
from vtkmodules.vtkIOXML import vtkXMLPolyDataReader  # noqa: E402

NAMES = {1: ("liver", (255, 0, 128)), 2: ('Milz <"&\'\\> äöü 第', None), 3: ("", (10, 20, 30)), 5: ("twice", (1, 2, 3)),
         6: ("twice", None), 7: ("12", None), 9: ("nowhere", None)}
CORE = "{http://schemas.microsoft.com/3dmanufacturing/core/2015/02}"


def run(*arguments, code=0):
    done = served.run([ISONEST, *map(str, arguments), "--json"], capture_output=True, text=True)
    assert done.returncode == code, (arguments, done.returncode, done.stdout, done.stderr)
    return json.loads(done.stdout)


def linear(shown):
    """sRGB to linear, by IEC 61966-2-1."""
    part = shown / 255
    return part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4


class LabelNameOutputs(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory(prefix="isonest-test-", dir=served.MEMORY)
        cls.here = pathlib.Path(cls.folder.name)
        z, y, x = np.mgrid[0:12, 0:12, 0:16]
        data = (x // 4 + 4 * (y // 6)).astype("u1")  # 0 to 7
        np.save(cls.here / "v.npy", data)
        cls.plain, cls.store = cls.here / "plain", cls.here / "s"
        run("preprocess", cls.here / "v.npy", "-o", cls.plain, "--chunk", 8)
        cls.make(data)

    @classmethod
    def make(cls, data):
        root = cls.here / "v.zarr"
        (root / "0/0/0").mkdir(parents=True)
        (root / ".zgroup").write_text('{"zarr_format": 2}')
        (root / ".zattrs").write_text(json.dumps({
            "multiscales": [{"axes": [{"name": a, "type": "space"} for a in "zyx"],
                             "datasets": [{"path": "0", "coordinateTransformations": [{"type": "scale", "scale": [1] * 3}]}]}],
            "image-label": {"properties": [{"label-value": i, "name": n} for i, (n, _) in NAMES.items() if n],
                            "colors": [{"label-value": i, "rgba": [*c, 255]} for i, (_, c) in NAMES.items() if c]}}))
        (root / "0/.zarray").write_text(json.dumps({
            "zarr_format": 2, "shape": data.shape, "chunks": data.shape, "dtype": "|u1", "fill_value": 0, "order": "C",
            "compressor": None, "filters": None, "dimension_separator": "/"}))
        (root / "0/0/0/0").write_bytes(data.tobytes())
        run("preprocess", root, "--labels", "-o", cls.store, "--chunk", 8)

    @classmethod
    def tearDownClass(cls):
        cls.folder.cleanup()

    def extract(self, *options, name="m.ply", store=None, code=0):
        return run("extract", store or self.store, *options, "-o", self.here / name, code=code)

    def test_a_label_is_found_by_its_name(self):
        for label, name in ((1, "liver"), (2, NAMES[2][0]), (9, "nowhere")):
            by_id = self.extract("--label", label, name="a.ply")
            by_name = self.extract("--label", name, name="b.ply")
            self.assertEqual((self.here / "a.ply").read_bytes(), (self.here / "b.ply").read_bytes())
            for report in (by_id, by_name):
                self.assertEqual((report["label"], report["name"]), (label, name))
                self.assertEqual(report.get("color"), list(NAMES[label][1]) if NAMES[label][1] else None)
        self.assertEqual(self.extract("--label", "12")["label"], 12)  # a number is always an id, never a name
        self.assertNotIn("name", self.extract("--label", "12"))
        for options in ((), ("--smooth",), ("--close", "--distance", "0.6")):
            self.extract("--label", "liver", *options, name="b.ply")
            self.extract("--label", 1, *options, name="a.ply")
            self.assertEqual((self.here / "a.ply").read_bytes(), (self.here / "b.ply").read_bytes())

    def test_lists_take_names_and_numbers(self):
        for text, ids in (("liver", [1]), ("3-4,liver,0", [0, 1, 3, 4]), ("7,liver,7", [1, 7]), ("all", [1, 2, 3, 4, 5, 6, 7])):
            with self.subTest(text):
                folder = f"m{len(text)}{text[0]}"
                self.extract("--labels", text, name=folder)
                listed = json.loads((self.here / folder / "labels.json").read_text())["labels"]
                self.assertEqual([entry["id"] for entry in listed], ids)
                for entry in listed:
                    name, color = NAMES.get(entry["id"], ("", None))
                    self.assertEqual((entry.get("name", ""), entry.get("color")), (name, list(color) if color else None))
                    self.assertEqual(entry["mesh"], f"{entry['id']}.ply")
                    self.assertEqual("name" in entry, bool(name))
        self.extract("--labels", "liver", "--smooth", "--close", name="smooth")
        listed = json.loads((self.here / "smooth/labels.json").read_text())["labels"]
        self.assertEqual([(e["id"], e["name"], e["color"]) for e in listed], [(1, "liver", [255, 0, 128])])

    def test_names_that_are_none_get_what_is_near(self):
        for option in ("--label", "--labels"):
            for text, kind, code, words in (
                    ("livre", "not_found", 3, "no label 'livre'; the nearest names are liver"),
                    ("Liver", "not_found", 3, "the nearest names are liver"),
                    ("kidney", "not_found", 3, "no label 'kidney'; there are 12, Milz"),
                    ("twice", "invalid_argument", 2, ": 5, 6"),
                    ("3-x", "not_found", 3, "no label '3-x'")):
                error = self.extract(option, text, code=code)["error"]
                self.assertEqual(error["kind"], kind)
                self.assertIn(words, error["message"])
            error = self.extract(option, "liver", store=self.plain, code=3)["error"]
            self.assertEqual(error["kind"], "not_found")
        error = self.extract("--labels", "nowhere", name="nowhere", code=3)["error"]
        self.assertIn("there is no label 9", error["message"])

    def test_gltf_has_the_name_and_the_colour(self):
        self.extract("--labels", "0-7", "--format", "glb", name="glb")
        for label in range(8):
            name, color = NAMES.get(label, ("", None))
            head, _ = read_glb(self.here / "glb" / f"{label}.glb")
            (node,), (material,) = head["nodes"], head["materials"]
            self.assertEqual(node.get("name", ""), name)
            self.assertEqual(material["name"], name or "surface")
            base = material["pbrMetallicRoughness"]["baseColorFactor"]
            expected = [*map(linear, color), 1] if color else [0.62, 0.68, 0.76, 1]
            np.testing.assert_allclose(base, expected, atol=1e-6)

    def test_3mf_has_the_name_and_the_colour(self):
        for label in (1, 2, 3, 4):
            name, color = NAMES.get(label, ("", None))
            self.extract("--label", label, name="m.3mf")
            with zipfile.ZipFile(self.here / "m.3mf") as z:
                resources = ElementTree.fromstring(z.read("3D/3dmodel.model")).find(CORE + "resources")
            thing = resources.find(CORE + "object")
            self.assertEqual(thing.get("name", ""), name)
            materials = resources.findall(CORE + "basematerials")
            self.assertEqual(len(materials), 1 if color else 0)
            if color:
                self.assertLess(list(resources).index(materials[0]), list(resources).index(thing))
                (base,) = materials[0]
                self.assertEqual(base.get("displaycolor"), "#%02X%02X%02X" % color)
                self.assertEqual(base.get("name"), name or "surface")
                self.assertEqual((thing.get("pid"), thing.get("pindex")), (materials[0].get("id"), "0"))
                self.assertNotEqual(thing.get("id"), thing.get("pid"))

    def test_vtk_reads_the_name_and_the_colour(self):
        for label in (1, 2, 3, 4):
            name, color = NAMES.get(label, ("", None))
            self.extract("--label", label, name="m.vtp")
            reader = vtkXMLPolyDataReader()
            reader.SetFileName(str(self.here / "m.vtp"))
            reader.Update()
            fields = reader.GetOutput().GetFieldData()
            said = fields.GetAbstractArray("Name")
            self.assertEqual(said.GetValue(0) if said else "", name)
            colors = fields.GetArray("Color")
            self.assertEqual(colors is not None, color is not None)
            if color:
                np.testing.assert_allclose(vtk_to_numpy(colors), [[c / 255 for c in color]], atol=1e-7)

    def test_other_formats_are_as_without_names(self):
        for end in ("ply", "stl", "obj", "vtkhdf"):
            for store in (self.store, self.plain):
                self.extract("--label", 1, name=f"{store.name}.{end}", store=store)
            self.assertEqual((self.here / f"s.{end}").read_bytes(), (self.here / f"plain.{end}").read_bytes())

    def test_info_lists_names_and_colours(self):
        text = served.run([ISONEST, "info", str(self.store)], capture_output=True, text=True).stdout
        for words in ("1 #ff0080  liver", "9          nowhere", "3 #0a141e"):
            self.assertIn(words, text)
        self.assertEqual(run("info", self.plain)["label_names"], [])


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
