#!/usr/bin/env python3
"""Stores of every released version of the format are read as before, and invalid ones are refused as before.

usage: golden_test.py ISONEST PLUGIN_FOLDER [--record]

tests/store/golden/expected.json says what is expected of each store. For a valid one: its volume, its version, the
SHA-256 of its surface at full resolution and within an error, with the nested grid of the paper and by default, and, if
it has them, the unit of length, the frame and the label names. For an invalid one: the command that refuses it, the kind
of the error, words of its message and the first remedy. --record adds valid ones that are missing. See CONTRIBUTING.md,
"Golden stores".
"""
import hashlib
import json
import pathlib
import sys
import tempfile
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served  # noqa: E402

ISONEST = sys.argv[1]
RECORD = "--record" in sys.argv
HERE = pathlib.Path(__file__).resolve().parent / "golden"
EXPECTED = json.loads((HERE / "expected.json").read_text())
STORES = sorted(path.name for path in HERE.glob("*.store"))
MOST_BYTES = 690_000
# Isovalue, errors, and a format that has lines if the data lie in a plane.
QUERIES = {"volume.raw": (100, (0, 12), "ply"), "flat.raw": (20, (0, 6), "obj"), "tiny.raw": (13.5, (0, 1), "ply"),
           "eight.raw": (0.1, (0, 0.05), "ply")}
NUMBERS = {"volume.raw": ("9,8,7", "int16"), "flat.raw": ("9,8,1", "float32"), "tiny.raw": ("3,3,3", "uint8"),
           "eight.raw": ("9,8,7", "float32")}


def run(*arguments):
    done = served.run([ISONEST, *map(str, arguments), "--json"], capture_output=True, text=True)
    return done.returncode, json.loads(done.stdout)


PAPER = ("--cells", "tet", "--effort", "none")


def meshes(store, volume, folder, *options):
    iso, errors, ending = QUERIES[volume]
    if "-uneven" in store and options == PAPER or "-curved" in store:
        errors = (0,)  # the nested grid needs even axes, and an error straight ones
    hashes = []
    for error in errors:
        mesh = pathlib.Path(folder) / f"{store}.{ending}"
        code, report = run("extract", HERE / store, "--iso", iso, "--error", error, *options, "-o", mesh)
        assert code == 0, (store, report)
        hashes.append(hashlib.sha256(mesh.read_bytes()).hexdigest())
    return hashes


class Golden(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory(prefix="isonest-golden-")
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)

    def good(self):
        return {name: e for name, e in EXPECTED.items() if "volume" in e}

    def test_every_store_has_an_expectation_and_the_folder_is_small(self):
        self.assertEqual(STORES, sorted(EXPECTED))
        self.assertLess(sum(path.stat().st_size for path in HERE.iterdir() if path.is_file()), MOST_BYTES)

    def test_good_stores_give_the_values_that_they_were_made_from(self):
        for name, expected in self.good().items():
            with self.subTest(name):
                out = self.folder / f"{name}.raw"
                self.assertEqual(run("export", HERE / name, "--field", "values", "-o", out)[0], 0)
                self.assertEqual(out.read_bytes(), (HERE / expected["volume"]).read_bytes())
                info = run("info", HERE / name)[1]
                self.assertEqual(info["format"], expected["format"])
                unknown = expected.get("unknown_fields", [])
                self.assertEqual(info["unknown_fields"], unknown)
                self.assertEqual(info["unit"], expected.get("unit"))  # not known before 2.7
                self.assertEqual(info["frame"], expected.get("frame"))  # not known before 2.10
                self.assertEqual(info["label_names"], expected.get("label_names", []))  # none before 2.8
                for field in unknown:
                    self.assertIn(field, info["warning"])

    def test_good_stores_are_consistent_by_brute_force(self):
        for name, expected in self.good().items():
            with self.subTest(name):
                dims, kind = NUMBERS[expected["volume"]]
                code, report = run("check", HERE / name, "--source", HERE / expected["volume"], "--dims", dims,
                                   "--type", kind)
                self.assertEqual((code, report.get("findings")), (0, []))
                self.assertGreater(report["cubes"], 0)

    def test_good_stores_give_the_same_meshes_as_ever(self):
        for name, expected in self.good().items():
            with self.subTest(name):
                self.assertEqual(meshes(name, expected["volume"], self.folder, *PAPER), expected["meshes"])
                self.assertEqual(meshes(name, expected["volume"], self.folder), expected["default_meshes"])

    def test_the_full_surface_is_the_same_whatever_version_stored_the_volume(self):
        full = {}
        for name, expected in self.good().items():
            # A mesh file contains its unit and its frame; rotated axes give other positions.
            key = expected["volume"], expected.get("unit"), expected.get("frame"), "-turned" in name, "-uneven" in name, "-curved" in name
            full.setdefault(key, set()).add(expected["meshes"][0])
        for key, hashes in full.items():
            self.assertEqual(len(hashes), 1, key)

    def test_bad_stores_are_refused_by_kind_words_and_remedy(self):
        for name, expected in EXPECTED.items():
            if "volume" in expected:
                continue
            with self.subTest(name):
                store = HERE / name
                command = ["extract", store, "--iso", "13.5", "-o", self.folder / "m.ply"]
                commands = ([["info", store]] if expected["when"] == "opened" else []) + [command]
                if expected["remedy"] == ["make_store"]:  # not a store: these commands take it for a volume
                    for arguments in commands:
                        self.assertNotEqual(run(*arguments)[0], 0)
                    commands = [["check", store]]
                for arguments in commands:
                    code, report = run(*arguments)
                    self.assertNotEqual(code, 0)
                    error = report["error"]
                    self.assertEqual(error["kind"], expected["error"])
                    self.assertEqual(error["file"], str(store))
                    self.assertEqual(error["inside"], expected["inside"])
                    self.assertIn(expected["words"], error["message"])
                    self.assertEqual([r["kind"] for r in error["remedies"]][:1], expected["remedy"])
                    self.assertFalse((self.folder / "m.ply").exists())


def record():
    with tempfile.TemporaryDirectory() as folder:
        for name in STORES:
            code, info = run("info", HERE / name)
            if code != 0 or {"error", "default_meshes"} & set(EXPECTED.get(name, {})):
                continue
            volume = {((9, 8, 7), "int16"): "volume.raw", ((9, 8, 7), "float32"): "eight.raw", ((9, 8, 1), "float32"): "flat.raw",
                      ((3, 3, 3), "uint8"): "tiny.raw"}[tuple(info["nodes"]), info["type"]]
            EXPECTED[name] = {"format": info["format"], "volume": volume,
                              "meshes": meshes(name, volume, folder, *PAPER),
                              "default_meshes": meshes(name, volume, folder), **EXPECTED.get(name, {})}
            if info["unit"]:
                EXPECTED[name]["unit"] = info["unit"]
            if info["frame"]:
                EXPECTED[name]["frame"] = info["frame"]
            if info["label_names"]:
                EXPECTED[name]["label_names"] = info["label_names"]
    lines = [f"  {json.dumps(name)}: {json.dumps(EXPECTED[name])}" for name in sorted(EXPECTED)]
    (HERE / "expected.json").write_text("{\n" + ",\n".join(lines) + "\n}\n")


if RECORD:
    record()
else:
    unittest.main(argv=sys.argv[:1])
