"""isonest view with --vertex-values, and its list of labels: compared with the formulas and arrays that the data are made from.

usage: view_quantities_test.py ISONEST PLUGIN_FOLDER
"""
import pathlib
import subprocess
import sys
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
from mesh_data import read_ply  # noqa: E402
from view_process import HERE, ISONEST, View, isonest, run_tests, view  # noqa: E402

import h5py
import numpy


def grid(shape):
    return numpy.stack(numpy.meshgrid(*[numpy.arange(n, dtype=float) for n in shape], indexing="ij"))


def write(name, values, *options):
    with h5py.File(HERE / f"{name}.h5", "w") as file:
        file["v"] = values
    isonest("preprocess", f"{name}.h5", "-o", f"{name}.isonest", "-q", *options)


class Colors(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        z, y, x = grid((25, 25, 25))
        write("ball", (10 - numpy.sqrt((x - 12) ** 2 + (y - 12) ** 2 + (z - 12) ** 2)).astype("f4"))
        # On a lattice twice as coarse, a linear function of the place in the world; and one that covers only half of it.
        z, y, x = 2 * grid((13, 13, 13))
        write("heat", (300 + x - 2 * y + 0.5 * z).astype("f4"), "--spacing", "2,2,2")
        write("part", (1 + x).astype("f4")[:, :, :7], "--spacing", "2,2,2")
        cls.view = View("ball.isonest", "--vertex-values", "heat=heat.isonest", "--vertex-values", "part=part.isonest")

    @classmethod
    def tearDownClass(cls):
        code, _, err = cls.view.end()
        assert code == 0, err

    def test_the_store_lists_its_quantities(self):
        said = self.view.json("/api/store")[1]
        self.assertEqual(said["quantities"], [{"name": "heat", "min_value": 252, "max_value": 336}, {"name": "part", "min_value": 1, "max_value": 13}])

    def test_vertices_have_the_value_at_their_place(self):
        for parameters in ({"iso": 2, "error": 0}, {"iso": 2, "distance": 0.5}, {"iso": 3, "triangles": 500}):
            with self.subTest(parameters):
                plain = self.view.mesh("/api/surface", **parameters)
                mesh = self.view.mesh("/api/surface", color="heat", **parameters)
                self.assertTrue((mesh["faces"] == plain["faces"]).all())
                x, y, z = mesh["points"].T
                off = numpy.abs(mesh["values"] - (300 + x - 2 * y + 0.5 * z))
                # The place was rounded after the value was taken there.
                self.assertLessEqual(off.max(), mesh["value_rounding"] + 3 * mesh["position_rounding"] + 1e-3)
                self.assertEqual(mesh["color"], "heat")
                self.assertLess(mesh["color_bound"], 1e-3)
                self.assertEqual(mesh["uncolored_triangles"], 0)
                self.assertNotIn("value_missing", mesh)
                self.assertNotIn("color", plain)

    def test_what_is_outside_is_missing(self):
        mesh = self.view.mesh("/api/surface", iso=2, error=0, color="part")
        steps = numpy.rint((mesh["values"] - mesh["value_origin"]) / mesh["value_step"])
        missing = steps == mesh["value_missing"]
        x = mesh["points"][:, 0]
        self.assertTrue(missing[x > 12.01].all() and not missing[x < 11.99].any())
        self.assertLessEqual(numpy.abs(mesh["values"] - (1 + x))[~missing].max(), mesh["value_rounding"] + mesh["position_rounding"] + 1e-4)
        self.assertGreater(mesh["uncolored_triangles"], 100)

    def test_the_value_under_the_cursor(self):
        said = self.view.json("/api/value", at="5,6,7")[1]
        self.assertEqual(said["quantities"], {"heat": 300 + 5 - 12 + 3.5, "part": 6})
        self.assertEqual(self.view.json("/api/value", at="20,6,7")[1]["quantities"]["part"], None)

    def test_files_and_commands_have_the_quantity(self):
        said = self.view.json("/api/command", iso=2, error=0.1, color="heat", format="ply")[1]["command"]
        self.assertIn("--vertex-values heat=heat.isonest", said)
        subprocess.run(said.replace("isonest ", f"{ISONEST} ", 1), shell=True, cwd=HERE, check=True, capture_output=True)
        self.assertEqual(self.view.ask("/api/export", iso=2, error=0.1, color="heat", format="ply")[2], (HERE / "surface.ply").read_bytes())
        vertices, _ = read_ply(HERE / "surface.ply")
        self.assertLess(numpy.abs(vertices["heat"] - (300 + vertices["x"] - 2 * vertices["y"] + 0.5 * vertices["z"])).max(), 1e-3)

    def test_what_is_refused(self):
        status, said = self.view.json("/api/surface", iso=2, error=0, color="cold")
        self.assertEqual(status, 400)
        self.assertIn("cold", said["error"]["message"])
        self.assertEqual(self.view.json("/api/slice", plane="0,0,1,5", error=0, color="heat")[0], 400)
        for text, word in (("heat.isonest", "NAME=STORE"), ("v=heat.isonest,heat.isonest,heat.isonest", "vector"), ("1x=heat.isonest", "1x"),
                           ("normal=heat.isonest", "normal"), ("a=nothing.isonest", "nothing.isonest")):
            done = subprocess.run([ISONEST, "view", "ball.isonest", "--port", "0", "--vertex-values", text], cwd=HERE, capture_output=True, text=True, timeout=60)
            self.assertNotEqual(done.returncode, 0)
            self.assertIn(word, done.stderr)


class Replaced(unittest.TestCase):
    def test_a_quantity_that_is_cut_off_is_refused_like_the_store(self):
        z, y, x = grid((13, 13, 13))
        write("field", (5 - abs(x - 6) - abs(y - 6) / 2).astype("f4"))
        write("gone", (x + y + z).astype("f4"))
        with view("field.isonest", "--vertex-values", "gone=gone.isonest") as server:
            self.assertEqual(server.mesh("/api/surface", iso=2, error=0, color="gone")["color"], "gone")
            with open(HERE / "gone.isonest", "r+b") as file:
                file.truncate(512)
            self.assertEqual(server.ask("/api/surface", iso=2.5, error=0, color="gone")[0], 410)
            self.assertEqual(server.ask("/api/value", at="5,6,7")[0], 410)


class Labels(unittest.TestCase):
    def test_all_labels_are_listed(self):
        values = numpy.random.default_rng(5).integers(0, 40, (9, 10, 11)) ** 2
        (HERE / "names.txt").write_text("4 Four 1 2 3 255\n5 Five 9 9 9 255\n")
        write("cells", values, "--labels", "--label-names", "names.txt")
        with view("cells.isonest") as server:
            listed = server.json("/api/labels")[1]["labels"]
            ids, counts = numpy.unique(values, return_counts=True)
            expected = {**dict(zip(ids.tolist(), counts.tolist())), 5: 0}
            self.assertEqual([label["id"] for label in listed], sorted(expected))
            self.assertEqual({label["id"]: label["nodes"] for label in listed}, expected)
            by_id = {label["id"]: label for label in listed}
            self.assertEqual((by_id[4]["name"], by_id[4]["color"], by_id[9]["name"], by_id[9]["color"]), ("Four", [1, 2, 3], None, None))
            named = server.json("/api/labels", named=1)[1]["labels"]
            self.assertEqual([(label["id"], label["name"], label["nodes"]) for label in named], [(4, "Four", None), (5, "Five", None)])
            self.assertEqual(server.json("/api/labels", named=2)[0], 400)


if __name__ == "__main__":
    run_tests()
