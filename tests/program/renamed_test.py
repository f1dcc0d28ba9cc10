"""Renamed indicators: new names for users, old names in stores, and notes where a name was given.

Usage: renamed_test.py ISONEST PLUGIN_FOLDER
"""
import json
import pathlib
import sys
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
from cli_case import CliCase, run  # noqa: E402

import h5py  # noqa: E402
import numpy as np  # noqa: E402

PAPER = "isonest: warning: normal_bar is now the paper's eta_N; the length of the whole jump, which had this name before, " \
        "is now normal_jump_bar\n"
FORMER = "isonest: warning: normal_component_bar is now called normal_bar; the next version will not know its former name\n"


class Renamed(CliCase):
    def setUp(self):
        super().setUp()
        np.save(self.here / "v.npy", np.random.default_rng(1).random((9, 12, 10), "f4"))
        self.store = self.here / "s.isonest"
        self.said = self.ok("preprocess", self.here / "v.npy", "--exact", "--indicators", "deviation_bar,normal_jump_bar,normal_bar",
                            "-o", self.store, "--force").stderr.decode()

    def of_field(self, name):
        done = self.ok("export", self.store, "--field", name, "-o", self.here / "f.npy", "--force")
        return np.load(self.here / "f.npy"), done.stderr.decode()

    def test_names_in_the_file_are_those_of_the_format(self):
        with h5py.File(self.store) as file:
            self.assertEqual(file.attrs["fields"], b"deviation_bar,normal_bar,normal_component_bar")
            jump = file["levels/1/normal_bar"][...]
            component = file["levels/1/normal_component_bar"][...]
            # In the order of slots: xyz odd.
            at = {name: array[:4, :5, :4, 6] for name, array in (("normal_jump_bar", jump), ("normal_bar", component))}
        for name, centres in at.items():
            field, _ = self.of_field(name)
            np.testing.assert_array_equal(field[1:9:2, 1:11:2, 1:9:2], centres)
        self.assertTrue((at["normal_jump_bar"] >= at["normal_bar"]).all() and (at["normal_jump_bar"] > at["normal_bar"]).any())
        self.assertEqual(json.loads(self.ok("info", self.store, "--json").stdout)["fields"],
                         ["deviation_bar", "normal_jump_bar", "normal_bar"])

    def test_a_name_with_another_meaning_is_noted_in_every_option(self):
        self.assertEqual(self.said, PAPER)
        mesh = ["extract", self.store, "--iso", "0.5", "-o", self.here / "m.ply"]
        for options, code in ((["export", self.store, "--field", "{}", "-o", self.here / "f.npy", "--force"], 0),
                              (["study", self.store, "--fields", "deviation_bar,{}", "--steps", "2", "-o", self.here / "study"], 0),
                              ([*mesh, "--stop", "{}", "--threshold", "0.5"], 0),
                              ([*mesh, "--error", "0.1", "--vertex-error", "{}"], 0),
                              ([*mesh, "--error", "0.1", "--bound", "{}"], 2),
                              ([*mesh, "--error", "0.1", "--view", "1,0,0", "--cull-by", "{}"], 2)):
            for name, note in (("normal_bar", PAPER), ("normal_component_bar", FORMER), ("normal_jump_bar", "")):
                with self.subTest(options=options, name=name):
                    done = run(*[str(o).format(name) for o in options], cwd=self.here)
                    self.assertEqual(done.returncode, code, done.stderr)
                    said = done.stderr.decode()
                    self.assertEqual(said[:len(note)], note)
                    self.assertEqual("warning" in said, note != "")

    def test_the_former_name_gives_the_same_field(self):
        new, _ = self.of_field("normal_bar")
        former, said = self.of_field("normal_component_bar")
        np.testing.assert_array_equal(new, former)
        self.assertEqual(said, FORMER)
        done = self.ok("extract", self.store, "--iso", "0.5", "--stop", "normal_component_bar", "--threshold", "0.5", "--json", "-o",
                       self.here / "m.ply")
        report = json.loads(done.stdout)
        self.assertEqual((report["stop"], report["warning"]), ("normal_bar", FORMER[len("isonest: warning: "):-1]))

    def test_names_that_nobody_gave_are_not_noted(self):
        for names in ("nodes", "all", "normal_jump_plus,normal_turn_plus"):
            done = self.ok("preprocess", self.here / "v.npy", "--indicators", names, "-o", self.here / "n.isonest", "--force")
            self.assertEqual(done.stderr, b"")
        # But a table of all fields has a row of another meaning.
        done = self.ok("study", self.store, "--steps", "2", "-o", self.here / "study")
        self.assertEqual(done.stderr, b"")
        self.assertIn("eta_N", done.stdout.decode())

    def test_a_store_without_the_field_is_refused_with_the_note(self):
        self.ok("preprocess", self.here / "v.npy", "--indicators", "linf_bar,normal_jump_bar", "-o", self.here / "n.isonest")
        done = run("export", self.here / "n.isonest", "--field", "normal_bar", "-o", self.here / "none.npy", cwd=self.here)
        self.assertEqual(done.returncode, 3, done.stderr)
        said = done.stderr.decode()
        self.assertTrue(said.startswith(PAPER), said)
        self.assertIn("it has linf_bar, normal_jump_bar", said)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
