#!/usr/bin/env python3
"""Surfaces of labels compared with those of each label's own binary volume.

usage: labels_test.py ISONEST PLUGIN_FOLDER
"""
import json
import os
import pathlib
import sys
import tempfile
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served  # noqa: E402

import numpy as np

ISONEST = sys.argv[1]
os.environ["HDF5_PLUGIN_PATH"] = sys.argv[2]
import h5py  # noqa: E402  (it reads the environment)

RANDOM = np.random.default_rng(8)


def run(*arguments, code=0):
    done = served.run([ISONEST, *map(str, arguments)], capture_output=True, text=True)
    assert done.returncode == code, (arguments, done.returncode, done.stderr)
    return done


def cells(shape, count, ids, background=True):
    """Every node has the label of the nearest of some random points."""
    points = RANDOM.random((count, 3)) * shape
    nodes = np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), -1).reshape(-1, 1, 3)
    distance = ((nodes - points) ** 2).sum(-1)
    found = ids[distance.argmin(1)]
    if background:
        found[distance.min(1) > 25] = 0
    return found.reshape(shape)


class Labels(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory(prefix="isonest-test-", dir=served.MEMORY)
        self.addCleanup(folder.cleanup)
        self.here = pathlib.Path(folder.name)

    def store(self, data, name="s", *options):
        np.save(self.here / f"{name}.npy", data)
        run("preprocess", self.here / f"{name}.npy", "-o", self.here / f"{name}.isonest", "--chunk", 8, "--force",
            *options)
        return self.here / f"{name}.isonest"

    def test_a_label_is_the_half_of_its_binary_volume(self):
        for kind, ids in (("u1", [1, 7, 255]), ("i2", [-3, 5, 900]), ("u4", [1, 2**32 - 1, 70000]),
                          ("i8", [2**40, 2**53, -9])):
            for options in ((), ("--cells", "hex"), ("--close",), ("--distance", "0.6"), ("--triangles", 300),
                            ("--components", "largest"), ("--normals",), ("--box", "2,3,4,11,12,13")):
                with self.subTest(kind=kind, options=options):
                    data = cells((17, 14, 20), 12, np.array(ids * 4).astype(kind))
                    store = self.store(data)
                    for label in (ids[0], ids[2], 0):
                        same = self.store((data == label).astype(kind), "b")
                        run("extract", store, "--label", label, "-o", self.here / "a.ply", *options)
                        run("extract", same, "--iso", 0.5, "-o", self.here / "b.ply", *options)
                        self.assertEqual((self.here / "a.ply").read_bytes(), (self.here / "b.ply").read_bytes())

    def test_a_mesh_for_each_label_is_that_of_the_label_alone(self):
        data = cells((25, 30, 21), 40, RANDOM.choice(np.arange(1, 60000), 40, replace=False).astype("u2"))
        store = self.store(data)
        bytes_of = {}
        for threads, memory in ((1, "1G"), (3, "1G"), (2, "300M")):
            for options in ((), ("--distance", "0.6")):
                folder = self.here / f"m{threads}{memory}{len(options)}"
                run("extract", store, "--labels", "all", "-o", folder, "--threads", threads, "--memory", memory, *options)
                listed = json.loads((folder / "labels.json").read_text())["labels"]
                ids, counts = np.unique(data[data != 0], return_counts=True)
                self.assertEqual([entry["id"] for entry in listed], ids.tolist())
                self.assertEqual([entry["nodes"] for entry in listed], counts.tolist())
                for entry in listed:
                    z, y, x = np.nonzero(data == entry["id"])
                    self.assertEqual(entry["low"], [x.min(), y.min(), z.min()])
                    self.assertEqual(entry["high"], [x.max(), y.max(), z.max()])
                    mesh = (folder / entry["mesh"]).read_bytes()
                    key = entry["id"], options
                    if key not in bytes_of:
                        run("extract", store, "--label", entry["id"], "-o", self.here / "one.ply", *options)
                        bytes_of[key] = (self.here / "one.ply").read_bytes()
                    self.assertEqual(mesh, bytes_of[key])
                self.assertEqual(len(list(folder.iterdir())), len(ids) + 1)  # there is no other file

    def test_labels_of_64_bits(self):
        ids = np.array([7, 2**53 + 1, 720575940627185911, 720575940627185912, 2**62 - 1], "u8")
        data = cells((17, 14, 20), 12, np.tile(ids, 4))
        np.save(self.here / "w.npy", data)
        with h5py.File(self.here / "w.h5", "w") as file:
            file.create_dataset("v", data=data, chunks=(8, 8, 8), compression="gzip")
            file.create_dataset("plain", data=data.astype(">i8"))
        for volume, more in (("w.npy", ()), ("w.h5", ("--dataset", "v")), ("w.h5", ("--dataset", "plain"))):
            store = self.here / "w.isonest"
            self.assertIn("2^53", run("preprocess", self.here / volume, *more, "-o", store, "--force", code=5).stderr)
            run("preprocess", self.here / volume, *more, "-o", store, "--chunk", 8, "--labels", "--force")
            with h5py.File(store) as file:  # as FORMAT.md says
                self.assertEqual(int(file.attrs["flags"]) & ~32, 2)  # chunks may be stored without the shuffle
                np.testing.assert_array_equal(file["levels/0/values"][:].view("u8") - 0x3FF0000000000000, data)
            run("extract", store, "--labels", "all", "-o", self.here / "m")
            listed = json.loads((self.here / "m" / "labels.json").read_text())["labels"]
            found, counts = np.unique(data[data > 0], return_counts=True)
            self.assertEqual([(entry["id"], entry["nodes"]) for entry in listed], list(zip(found.tolist(), counts.tolist())))
            for label in found:
                same = self.store((data == label).astype("u1"), "b")
                run("extract", same, "--iso", 0.5, "-o", self.here / "b.ply")
                self.assertEqual((self.here / "m" / f"{label}.ply").read_bytes(), (self.here / "b.ply").read_bytes())
            self.assertRegex(run("extract", store, "--iso", 3, "-o", self.here / "a.ply", code=2).stderr, "64-bit labels")
            run("check", store, "--source", self.here / volume, "--labels", *more)
        np.save(self.here / "w.npy", data + np.uint64(2**62))
        self.assertIn("2^62", run("preprocess", self.here / "w.npy", "-o", store, "--labels", "--force", code=5).stderr)

    def test_labels_of_64_bits_leave_as_integers(self):
        """Names in every output, as other programs read them; queries that calculate with labels are refused."""
        ids = np.array([0, 3, 2**53 + 1, 720575940627185911, 2**62 - 1])
        data = cells((7, 9, 11), 12, np.tile(ids, 4), background=False)
        store = self.store(data, "w", "--labels")
        for level, wanted in ((0, data), (1, data[::2, ::2, ::2])):
            files = {}
            for end in ("npy", "nii", "nrrd", "h5", "vti", "mha", "raw"):
                files[end] = self.here / f"v{level}.{end}"
                said = run("export", store, "--field", "values", "--level", level, "-o", files[end], "--json")
                self.assertEqual(json.loads(said.stdout)["type"], "int64")
            found = {"npy": np.load(files["npy"]), "raw": np.fromfile(files["raw"], "<i8").reshape(wanted.shape),
                     "nrrd": self.behind(files["nrrd"], b"type: int64\n", b"\n\n", wanted.shape),
                     "mha": self.behind(files["mha"], b"ElementType = MET_LONG_LONG\n", b"ElementDataFile = LOCAL\n",
                                        wanted.shape)}
            with h5py.File(files["h5"]) as file:
                found["h5"] = file["data"][:]
            try:
                import nibabel
                image = nibabel.load(files["nii"])
                self.assertEqual(image.get_data_dtype(), np.int64)
                found["nii"] = np.asarray(image.dataobj).T
            except ImportError:
                print("nibabel is missing: .nii is not read")
            try:
                from vtkmodules.util.numpy_support import vtk_to_numpy
                from vtkmodules.vtkIOXML import vtkXMLImageDataReader
                reader = vtkXMLImageDataReader()
                reader.SetFileName(str(files["vti"]))
                reader.Update()
                found["vti"] = vtk_to_numpy(reader.GetOutput().GetPointData().GetArray(0)).reshape(wanted.shape)
            except ImportError:
                print("vtk is missing: .vti is not read")
            for end, values in found.items():
                with self.subTest(end=end, level=level):
                    self.assertEqual(values.dtype, np.int64)
                    np.testing.assert_array_equal(values, wanted)
        report = json.loads(run("info", store, "--histogram", "--json").stdout)
        self.assertEqual((report["type"], report["labels"], report["min_value"], report["max_value"]),
                         ("int64", True, 0, 2**62 - 1))
        self.assertEqual((report["arrays"][0]["min"], report["arrays"][0]["max"]), (0, 2**62 - 1))
        for array in report["arrays"]:
            self.assertTrue({array["min"], array["max"]} <= ({*ids.tolist()} if array["field"] == "values" else {None}), array)
        bins = report["histogram"]["bins"]
        self.assertEqual((bins[0]["low"], sum(entry["nodes"] for entry in bins)), (0, data.size))
        self.assertEqual((report["histogram"]["suggested"], report["histogram"]["cube_level"]), ([], None))
        for text in (run("info", store, "--histogram").stdout, run("preprocess", self.here / "w.npy", "--labels", "-o", store,
                                                                   "--force").stdout):
            self.assertIn(str(2**62 - 1), text)
            self.assertNotIn("1.0000", text)
        few = self.store(np.array([[[720575940627185911, 720575940627185913]] * 2] * 2), "few", "--labels")
        bins = json.loads(run("info", few, "--histogram", "--json").stdout)["histogram"]["bins"]
        self.assertEqual([(entry["low"], entry["nodes"]) for entry in bins],
                         [(720575940627185911, 4), (720575940627185912, 0), (720575940627185913, 4)])
        with h5py.File(store) as file:  # VTK and ParaView would show the codes
            self.assertNotIn("VTKHDF", file)
        run("check", store, "--deep", "--source", self.here / "w.npy", "--labels")
        out = self.here
        for words in (["slice", "--plane", "0,0,1,3", "-o", out / "s.ply"], ["slice", "--plane", "0,0,1,3", "-o", out / "s.png"],
                      ["slice", "--plane", "0,0,1,3", "--contours", "3", "-o", out / "s.vtp"],
                      ["export", "--field", "deviation_bar", "-o", out / "d.npy"], ["export", "--field", "lp:3", "-o", out / "d.npy"],
                      ["study", "--out", out / "study"], ["smooth", "--steps", 1, "--tau", 1, "--lambda", 1, "-o", out / "s.nrrd"],
                      ["extract", "--label", 3, "--vertex-error", "deviation_bar", "-o", out / "a.ply"],
                      ["extract", "--label", 3, "--vertex-values", store, "-o", out / "a.ply"]):
            with self.subTest(words=words):
                self.assertRegex(run(words[0], store, *words[1:], code=5).stderr, "labels of 64 bits|64-bit labels")

    def test_a_label_of_64_bits_can_be_missing(self):
        data = np.arange(27).reshape(3, 3, 3) % 4
        store = self.store(data, "m", "--labels", "--missing", 3)
        run("extract", store, "--labels", "0-9", "-o", self.here / "m")
        listed = json.loads((self.here / "m" / "labels.json").read_text())["labels"]
        self.assertEqual([(entry["id"], entry["nodes"]) for entry in listed],
                         [(i, int((data == i).sum())) for i in range(3)])
        self.assertTrue(json.loads(run("info", store, "--json").stdout)["has_missing"])
        for value in ("-1", "1.5"):
            self.assertIn("not a label", run("preprocess", self.here / "m.npy", "--labels", "--missing", value, "-o",
                                          self.here / "x.isonest", code=2).stderr)

    def behind(self, path, said, end, shape):
        """The int64 numbers after a header that ends in this way."""
        header, numbers = path.read_bytes().split(end, 1)
        self.assertIn(said, header + end)
        return np.frombuffer(numbers, "<i8").reshape(shape)

    def test_lists_and_ranges(self):
        data = cells((12, 12, 12), 9, np.array([2, 3, 5, 8, 13, 21, 34, 55, 89], "u1"), background=False)
        store = self.store(data)
        present = np.unique(data)
        for text, wanted in ((f"{present[0]}", [present[0]]), (f"{present[1]},{present[-1]},{present[1]}", present[[1, -1]]),
                             ("5-40,8", present[(present >= 5) & (present <= 40)])):
            run("extract", store, "--labels", text, "-o", self.here / "m")
            listed = json.loads((self.here / "m" / "labels.json").read_text())["labels"]
            self.assertEqual([entry["id"] for entry in listed], list(wanted))
        self.assertIn("smaller", run("extract", store, "--labels", "9-4", "-o", self.here / "m", code=2).stderr)
        few = self.store(np.array([[[2, 3], [5, 5]], [[5, 89], [3, 3]]], "u1"), "few")
        for text, words in (("4", "no label 4; the nearest ones are 3 and 5"), ("1", "no label 1; the smallest is 2"),
                            ("90-99", "no labels from 90 to 99; the largest is 89")):
            self.assertIn(words, run("extract", few, "--labels", text, "-o", self.here / "m", code=3).stderr)

    def test_neuroglancers_folder(self):
        data = cells((12, 12, 12), 4, np.array([2, 3, 5, 8], "u1"))
        store = self.store(data)
        for options in ((), ("--smooth",), ("--smooth=3", "--close", "--components", "largest")):
            run("extract", store, "--labels", "all", "--format", "neuroglancer", "-o", self.here / "m", *options)
            self.assertEqual(json.loads((self.here / "m" / "info").read_text()), {"@type": "neuroglancer_legacy_mesh"})
            run("extract", store, "--labels", "all", "-o", self.here / "p", "--format", "stl", *options)
            for label in np.unique(data[data > 0]):
                fragments = json.loads((self.here / "m" / f"{label}:0").read_text())["fragments"]
                raw = b"".join((self.here / "m" / name).read_bytes() for name in fragments)
                count = int.from_bytes(raw[:4], "little")
                points = np.frombuffer(raw, "<f4", 3 * count, 4).reshape(-1, 3)
                triangles = np.frombuffer(raw, "<u4", offset=4 + 12 * count).reshape(-1, 3)
                stl = np.frombuffer((self.here / "p" / f"{label}.stl").read_bytes()[84:],
                                    np.dtype([("n", "<f4", 3), ("p", "<f4", (3, 3)), ("a", "<u2")]))
                self.assertGreater(len(triangles), 10)
                np.testing.assert_array_equal(points[triangles], stl["p"])

    def test_what_makes_no_sense_is_refused(self):
        store = self.store(cells((9, 9, 9), 4, np.array([2, 3, 5, 8], "u1")))
        for options in (("--error", 1), ("--iso", 1), ("--view", "1,0,0"), ("--graph",)):
            run("extract", store, "--label", 3, "-o", self.here / "a.ply", *options, code=2)
        self.assertIn("has the label 77", run("extract", store, "--label", 77, "-o", self.here / "a.ply").stdout)
        self.assertIn("uint8", run("extract", store, "--label", 300, "-o", self.here / "a.ply", code=2).stderr)
        flat = self.store(np.arange(20, dtype="u1").reshape(1, 4, 5), "flat")
        run("extract", flat, "--label", 3, "-o", self.here / "a.vtp", code=2)
        amounts = self.store(RANDOM.normal(size=(9, 9, 9)), "amounts")
        self.assertIn("not a label", run("extract", amounts, "--labels", "all", "-o", self.here / "m", code=5).stderr)
        (self.here / "file").write_text("")
        run("extract", store, "--labels", "all", "-o", self.here / "file", code=2)
        many = self.store(np.arange(27000, dtype="u4").reshape(30, 30, 30), "many")
        self.assertIn("labels", run("extract", many, "--labels", "all", "-o", self.here / "m", "--memory", "14M",
                                    code=7).stderr)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
