"""isonest view of a series: each step's answers are those of isonest view for the step's own store.

usage: view_series_test.py ISONEST PLUGIN_FOLDER
"""
import json
import pathlib
import shutil
import subprocess
import sys
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
from view_process import HERE, ISONEST, View, decoded, isonest, run_tests, view  # noqa: E402

import h5py
import numpy

TIMES = (0.0, 0.5, 2.0, 7.25)


def write_steps(nodes=25):
    """A ball whose radius grows with time: the distance from its surface, plus the time."""
    grid = numpy.stack(numpy.meshgrid(*[numpy.arange(nodes, dtype=float)] * 3, indexing="ij"))
    distance = numpy.sqrt(((grid - nodes / 2) ** 2).sum(axis=0))
    for i, time in enumerate(TIMES):
        with h5py.File(HERE / f"run_{i}.h5", "w") as file:
            file["v"] = (10 + time - distance).astype("f4")
    isonest("preprocess", *[f"run_{i}.h5" for i in range(len(TIMES))], "--times", ",".join(map(str, TIMES)), "-o", "run.isonest", "-q")


class Series(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        write_steps()
        cls.view = View("run.isonest")

    @classmethod
    def tearDownClass(cls):
        code, _, err = cls.view.end()
        assert code == 0, err

    def test_the_description_is_of_all_steps(self):
        status, said = self.view.json("/api/store")
        self.assertEqual(status, 200)
        self.assertEqual(said["series"], {"time_unit": None, "times": list(TIMES)})
        values = [numpy.array(h5py.File(HERE / f"run_{i}.h5")["v"]) for i in range(len(TIMES))]
        least, largest = min(map(numpy.min, values)), max(map(numpy.max, values))
        self.assertEqual((said["min_value"], said["max_value"]), (least, largest))
        self.assertEqual(said["largest_error"], 2 * (float(largest) - float(least)))
        self.assertEqual(said["file_bytes"], sum(path.stat().st_size for path in (HERE / "run.isonest").glob("*.isonest")))
        self.assertEqual(said["name"], "run.isonest")
        with view("run.isonest/step_000001.isonest") as one:
            self.assertIsNone(one.json("/api/store")[1]["series"])

    def test_each_step_has_the_meshes_of_its_store(self):
        for step in (2, 0, 3, 1):
            with view(f"run.isonest/step_{step:06d}.isonest") as alone:
                for path, parameters in (("/api/surface", {"iso": 3.5, "error": 0}), ("/api/surface", {"iso": 3.5, "distance": 0.4}),
                                         ("/api/surface", {"iso": 1, "error": 0.2, "box": "2,2,2,20,20,20"}),
                                         ("/api/slice", {"plane": "0,0,1,9.5", "error": 0.01})):
                    with self.subTest(step=step, **parameters):
                        mine, own = (decoded(server.ask(path, **parameters, **more)[2])
                                     for server, more in ((self.view, {"step": step}), (alone, {})))
                        for key in ("vertices", "triangles", "error_bound", "distance_bound", "origin", "step"):
                            self.assertEqual(mine[key], own[key])
                        self.assertTrue((mine["points"] == own["points"]).all() and (mine["faces"] == own["faces"]).all())
                        self.assertGreater(mine["triangles"], 25)
                for path, parameters in (("/api/histogram", {}), ("/api/value", {"at": "3,4,5.5"})):
                    self.assertEqual(self.view.json(path, step=step, **parameters), alone.json(path, **parameters))

    def test_the_number_of_triangles_is_kept_at_each_step(self):
        radii = []
        for step, time in enumerate(TIMES):
            mesh = self.view.mesh("/api/surface", iso=6, triangles=2000, step=step)
            self.assertTrue(300 < mesh["triangles"] <= 2000, mesh["triangles"])
            radii.append(numpy.linalg.norm(mesh["points"] - 12.5, axis=1))
            self.assertLess(numpy.abs(radii[-1] - (4 + time)).max(), mesh["error_bound"] + 0.2)

    def test_commands_and_files_name_the_step(self):
        status, said = self.view.json("/api/command", iso=3.5, error=0, step=2, format="ply")
        self.assertEqual(status, 200)
        self.assertIn("run.isonest/step_000002.isonest", said["command"])
        subprocess.run(said["command"].replace("isonest ", f"{ISONEST} ", 1), shell=True, cwd=HERE, check=True, capture_output=True)
        made = (HERE / said["command"].split()[-1]).read_bytes()
        self.assertEqual(self.view.ask("/api/export", iso=3.5, error=0, step=2, format="ply")[2], made)

    def test_steps_that_do_not_exist(self):
        for step in (4, -1, 1.5, "x", ""):
            for path, parameters in (("/api/surface", {"iso": 3, "error": 0}), ("/api/value", {"at": "1,1,1"}), ("/api/histogram", {})):
                status, said = self.view.json(path, step=step, **parameters)
                self.assertEqual(status, 400)
                self.assertIn("step", said["error"]["message"])

    def test_some_steps(self):
        with view("run.isonest", "--times", "0.5,7.25") as some:
            self.assertEqual(some.json("/api/store")[1]["series"]["times"], [0.5, 7.25])
            self.assertEqual(some.mesh("/api/surface", iso=3.5, error=0, step=1)["triangles"],
                             self.view.mesh("/api/surface", iso=3.5, error=0, step=3)["triangles"])
            self.assertEqual(some.json("/api/store", step=2)[0], 400)

    def test_a_step_that_is_replaced_is_told_and_the_others_are_shown(self):
        shutil.copytree(HERE / "run.isonest", HERE / "copy.isonest")
        with view("copy.isonest") as server:
            self.assertEqual(server.json("/api/status")[1]["store"], "ok")
            state = "cut off" if (HERE / "copy.isonest/step_000002.isonest").stat().st_size < (HERE / "copy.isonest/step_000001.isonest").stat().st_size else "replaced"
            (HERE / "copy.isonest/step_000001.isonest").write_bytes((HERE / "copy.isonest/step_000002.isonest").read_bytes())
            self.assertEqual(server.json("/api/value", at="1,1,1", step=1)[0], 410)
            self.assertEqual(server.json("/api/value", at="1,1,1", step=2)[0], 200)
            self.assertEqual(server.json("/api/status")[1]["store"], state)

    def refused(self, *arguments, code):
        done = subprocess.run([ISONEST, "view", *arguments, "--port", "0"], cwd=HERE, capture_output=True, text=True, timeout=60)
        self.assertEqual(done.returncode, code, done.stderr)
        return done.stderr

    def test_what_is_refused(self):
        self.assertIn("--times", self.refused("run.isonest/step_000000.isonest", "--times", "1", code=2))
        self.assertIn("0.5", self.refused("run.isonest", "--times", "0.6", code=2))
        self.assertIn("--keep-store", self.refused("run.isonest", "--keep-store", "k.isonest", code=2))
        folder = HERE / "mixed.isonest"
        shutil.copytree(HERE / "run.isonest", folder)
        isonest("make-volume", "bucky", "--size", 25, "-o", "other.h5", "-q")
        isonest("preprocess", "other.h5", "-o", "other.isonest", "--spacing", "2,2,2", "-q")
        shutil.copy(HERE / "other.isonest", folder / "step_000002.isonest")
        said = self.refused("mixed.isonest", code=4)
        self.assertIn("step_000002.isonest", said)
        self.assertIn("step_000000.isonest", said)
        index = json.loads((folder / "series.json").read_text())
        (folder / "series.json").write_text(json.dumps({**index, "steps": []}))
        self.assertIn("without steps", self.refused("mixed.isonest", code=2))


if __name__ == "__main__":
    run_tests()
