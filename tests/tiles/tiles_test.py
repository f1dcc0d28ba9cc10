#!/usr/bin/env python3
"""3D Tiles, read by their specifications (tile_reader.py), and measured against the full mesh by VTK.

usage: tiles_test.py ISONEST PLUGIN_FOLDER
"""
import collections
import json
import os
import pathlib
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served  # noqa: E402
from mesh_data import read_points  # noqa: E402
from tile_reader import STEPS, Distance, Tileset, is_readable, read_glb, samples  # noqa: E402

import numpy as np

ISONEST = pathlib.Path(sys.argv[1])
os.environ["HDF5_PLUGIN_PATH"] = sys.argv[2]
RANDOM = np.random.default_rng(57)


def run(*arguments, code=0, cwd=None):
    done = served.run([ISONEST, *map(str, arguments)], capture_output=True, text=True, cwd=cwd)
    assert done.returncode == code, (arguments, done.returncode, done.stderr)
    return done


def gyroid(n, scale=1.0):
    x, y, z = np.meshgrid(*(np.arange(n) * scale,) * 3, indexing="ij")
    return (np.sin(x) * np.cos(y) + np.sin(y) * np.cos(z) + np.sin(z) * np.cos(x)).astype("f4")


@unittest.skipUnless(is_readable(), "node or meshoptimizer (npm) is missing")
class Tiles(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory(prefix="isonest-test-")
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)

    def volume(self, values, *options):
        np.save(self.folder / "v.npy", values)
        run("preprocess", self.folder / "v.npy", "-o", self.folder / "v.isonest", "--force", *options)
        return self.folder / "v.isonest"

    def tileset(self, store, *options, name="site"):
        done = run("extract", store, *options, "--format", "3dtiles", "-o", self.folder / name, "--json")
        report = json.loads(done.stdout)
        return Tileset(self.folder / name), report

    def full(self, store, *options):
        run("extract", store, *options, "-o", self.folder / "full.ply")
        return read_points(self.folder / "full.ply")

    def check_errors(self, tiles, points, faces, metres=1.0):
        """Tiles are within their errors of the full mesh, and its part in their cubes is within them of the level's tiles."""
        points = points.astype(float) * metres
        full = Distance(points, faces)
        shares, levels = [], {}
        edge = np.array(tiles.tiles[0].head["nodes"][0]["scale"]) * STEPS / 2.0**tiles.tiles[0].level
        edge = edge @ abs(tiles.transform[:3, :3].T)
        for level in range(tiles.levels):
            own = [(tiles.world(tile), tile.arrays["indices"]) for tile in tiles.of_level(level)]
            first = np.cumsum([0] + [len(p) for p, _ in own])
            levels[level] = Distance(np.concatenate([p for p, _ in own]),
                                     np.concatenate([t + n for (_, t), n in zip(own, first)]))
        for tile in tiles.tiles:
            there = full.largest(samples(tiles.world(tile), tile.arrays["indices"], RANDOM))
            low = tiles.transform[:3, 3] + tile.cube * edge * 2.0**tile.level
            some = np.flatnonzero(((points >= low) & (points <= low + edge * 2.0**tile.level)).all(1))
            back = levels[tile.level].largest(points[RANDOM.choice(some, min(300, len(some)), False)]) if len(some) else 0
            self.assertLessEqual(max(there, back), tile.error * (1 + 1e-9), tile.path)
            if tile.level > 0:
                shares.append(max(there, back) / tile.error)
        return shares

    def check_borders(self, tiles):
        """The border of each tile's mesh in a face between cubes is the same from both sides, whatever the levels."""
        sides = {}  # (level, axis, plane, cube along the other axes) -> edges, by tiles on either side and their levels
        for tile in tiles.tiles:
            at, count = tiles.steps(tile), collections.Counter()
            for t in tile.arrays["indices"]:
                for a, b in ((t[0], t[1]), (t[1], t[2]), (t[2], t[0])):
                    count[min(a, b), max(a, b)] += 1
            size = STEPS << tile.level
            for axis in range(3):
                for end in (0, 1):
                    plane = (tile.cube[axis] + end) * size
                    edges = frozenset(tuple(sorted((tuple(at[a]), tuple(at[b])))) for (a, b), n in count.items()
                                      if n == 1 and at[a][axis] == plane and at[b][axis] == plane)
                    sides[tile.level, axis, plane, *np.delete(tile.cube, axis), end] = edges
        compared = 0
        for (level, axis, plane, u, v, end), edges in sides.items():
            if end == 1:
                other = sides.get((level, axis, plane, u, v, 0), frozenset())
                self.assertEqual(edges, other, (level, axis, plane))
                compared += len(edges)
            if level > 0:  # the four tiles of the level below at this face
                finer = frozenset().union(*(sides.get((level - 1, axis, plane, 2 * u + i, 2 * v + j, end), frozenset())
                                            for i in (0, 1) for j in (0, 1)))
                outer = frozenset(e for e in finer)
                seams = outer - edges
                # What the finer tiles have beyond is inside of this face: the seams between the four.
                self.assertEqual(edges - outer, frozenset(), (level, axis, plane))
                self.assertEqual(len(seams), 0)
                compared += len(edges)
        return compared

    def test_each_tile_is_within_its_error_and_closes_with_its_neighbours(self):
        store = self.volume(gyroid(97, 0.12), "--spacing", "1,0.7,1.3", "--unit", "mm")
        points, faces = self.full(store, "--iso", 0.1)
        tiles, report = self.tileset(store, "--iso", 0.1)
        self.assertGreaterEqual(tiles.levels, 3)
        self.assertEqual(len(report["tileset"]["levels"]), tiles.levels)
        shares = self.check_errors(tiles, points, faces, 1e-3)
        self.assertGreater(np.median(shares), 0.4)
        self.assertGreater(self.check_borders(tiles), 1000)
        self.assertEqual(sum(len(t.arrays["indices"]) for t in tiles.of_level(0)),
                         report["tileset"]["levels"][0]["triangles"])
        for level in range(1, tiles.levels):
            self.assertLess(sum(len(t.arrays["indices"]) for t in tiles.of_level(level)),
                            0.6 * sum(len(t.arrays["indices"]) for t in tiles.of_level(level - 1)))
        for tile in tiles.tiles:
            length = np.linalg.norm(tile.arrays["NORMAL"].astype(float), axis=1) / 127
            self.assertTrue((abs(length - 1) < 0.02).all())

    def test_dense_tiles_are_simplified_before_they_are_joined(self):
        store = self.volume(gyroid(124, 0.18))
        points, faces = self.full(store, "--iso", 0)
        self.assertGreater(len(faces), 1 << 17)
        tiles, report = self.tileset(store, "--iso", 0)
        self.assertEqual([level["without_mesh"] for level in report["tileset"]["levels"]], [0] * tiles.levels)
        self.check_errors(tiles, points, faces)
        self.assertGreater(self.check_borders(tiles), 1000)

    def test_what_cannot_be_simplified_has_no_mesh(self):
        store = self.volume(RANDOM.normal(0, 1, (80, 80, 80)).astype("f4"))
        tiles, report = self.tileset(store, "--iso", 0)
        self.assertGreater(report["tileset"]["levels"][-1]["without_mesh"], 0)
        self.assertEqual(tiles.empty, sum(level["without_mesh"] for level in report["tileset"]["levels"]))
        self.assertIsNone(tiles.root.path)
        self.assertGreater(tiles.root.error, max(tile.error for tile in tiles.tiles))

    def test_the_finest_level_is_the_whole_mesh(self):
        store = self.volume(gyroid(65, 0.2))
        points, faces = self.full(store, "--iso", 0)
        tiles, _ = self.tileset(store, "--iso", 0)
        a, b, c = points.astype(float)[faces].swapaxes(0, 1)
        area = np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2
        own = 0
        for tile in tiles.of_level(0):
            a, b, c = tiles.world(tile)[tile.arrays["indices"]].swapaxes(0, 1)
            own += np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2
        self.assertAlmostEqual(own / area, 1, delta=1e-3)

    def test_the_same_bytes_for_any_threads_memory_and_from_the_volume(self):
        values = gyroid(65, 0.2) + RANDOM.normal(0, 0.05, (65,) * 3).astype("f4")
        store = self.volume(values)
        run("extract", store, "--iso", 0, "--format", "3dtiles", "-o", self.folder / "a", "--threads", 1)
        run("extract", store, "--iso", 0, "--format", "3dtiles", "-o", self.folder / "b", "--threads", 3, "--memory", "400M")
        run("extract", self.folder / "v.npy", "--iso", 0, "--format", "3dtiles", "-o", self.folder / "c")
        files = {p.relative_to(self.folder / "a") for p in (self.folder / "a").rglob("*") if p.is_file()}
        for other in "bc":
            self.assertEqual(files, {p.relative_to(self.folder / other) for p in (self.folder / other).rglob("*")
                                     if p.is_file()})
            for name in files:
                self.assertEqual((self.folder / "a" / name).read_bytes(), (self.folder / other / name).read_bytes(), name)

    def test_pieces_smaller_than_a_step_are_kept(self):
        values = np.zeros((40, 40, 40), "f4")
        for node in RANDOM.integers(1, 39, (200, 3)):
            values[tuple(node)] = 1e-5  # a piece hardly larger than its node
        store = self.volume(values)
        points, faces = self.full(store, "--iso", 1e-5 * (1 - 1e-6))
        tiles, _ = self.tileset(store, "--iso", 1e-5 * (1 - 1e-6))
        self.check_errors(tiles, points, faces)

    def test_labels_are_features_with_names_and_colours(self):
        labels = np.zeros((48, 48, 48), "u1")
        labels[6:30, 6:40, 6:40] = 3
        labels[30:42, 6:40, 6:40] = 250
        np.save(self.folder / "l.npy", labels)
        (self.folder / "names.txt").write_text("3 Leber 200 10 20 0\n250 Milz 10 20 200 0\n")
        run("preprocess", self.folder / "l.npy", "-o", self.folder / "l.isonest", "--labels", "--label-names",
            self.folder / "names.txt")
        tiles, report = self.tileset(self.folder / "l.isonest", "--labels", "all", "--smooth")
        self.assertEqual([label["id"] for label in report["labels"]], [3, 250])
        seen = set()
        for tile in tiles.tiles:
            head, arrays, raw = read_glb(self.folder / "site" / tile.path)
            table = head["extensions"]["EXT_structural_metadata"]["propertyTables"][0]
            view = head["bufferViews"][table["properties"]["label"]["values"]]
            self.assertEqual(view["byteOffset"] % 8, 0)
            ids = np.frombuffer(raw["bytes"], "<i4", table["count"], raw["start"][table["properties"]["label"]["values"]])
            offsets = np.frombuffer(raw["bytes"], "<u4", table["count"] + 1,
                                    raw["start"][table["properties"]["name"]["stringOffsets"]])
            start = raw["start"][table["properties"]["name"]["values"]]
            for i, label in enumerate(ids.tolist()):
                name = raw["bytes"][start + offsets[i]:start + offsets[i + 1]].decode()
                self.assertEqual(name, {3: "Leber", 250: "Milz"}[label])
                rows = arrays["_FEATURE_ID_0"][:, 0] == i
                self.assertTrue(rows.any())
                red, _, blue, one = arrays["COLOR_0"][rows][0]
                self.assertEqual(one, 65535)
                self.assertEqual(red > blue, label == 3)
                seen.add(label)
            self.assertLess(arrays["_FEATURE_ID_0"].max(), table["count"])
        self.assertEqual(seen, {3, 250})

    def test_isovalues_are_features(self):
        store = self.volume(gyroid(48, 0.2))
        tiles, _ = self.tileset(store, "--iso=-0.3,0.1,0.5")
        seen = set()
        for tile in tiles.tiles:
            head, _, raw = read_glb(self.folder / "site" / tile.path)
            table = head["extensions"]["EXT_structural_metadata"]["propertyTables"][0]
            seen |= set(np.frombuffer(raw["bytes"], "<f8", table["count"],
                                      raw["start"][table["properties"]["isovalue"]["values"]]).tolist())
        self.assertEqual(seen, {-0.3, 0.1, 0.5})

    def test_a_place_on_the_globe(self):
        store = self.volume(gyroid(20, 0.3), "--origin", "10,20,30")
        tiles, _ = self.tileset(store, "--iso", 0, "--georeference", "90,0,100", name="globe")
        plain, _ = self.tileset(store, "--iso", 0)
        # At 90 degrees east on the equator, x (east) is -X, y (north) Z, and z (up) Y of the earth.
        x, y, z = plain.world(plain.root).T
        own = tiles.world(tiles.root).T
        self.assertTrue(np.allclose(own, [-x, z + 6378137 + 100, y], atol=1e-6))

    def test_rotated_and_sheared_volumes(self):
        values = gyroid(40, 0.2)
        for name, directions in (("rotated", "(0.6,0.8,0) (-0.8,0.6,0) (0,0,1.5)"), ("sheared", "(1,0,0) (0.2,1,0) (0,0.3,1.5)")):
            (self.folder / f"{name}.nrrd").write_bytes(
                b"NRRD0004\ntype: float\ndimension: 3\nsizes: 40 40 40\nendian: little\nspace dimension: 3\n"
                b"space directions: " + directions.encode() + b"\nspace origin: (100,-200,30)\nencoding: raw\n\n" + values.tobytes())
            run("preprocess", self.folder / f"{name}.nrrd", "-o", self.folder / f"{name}.isonest")
            tiles, _ = self.tileset(self.folder / f"{name}.isonest", "--iso", 0, "--close", name=name)
            closed = self.full(self.folder / f"{name}.isonest", "--iso", 0, "--close")
            near = Distance(closed[0].astype(float), closed[1])
            for tile in tiles.tiles:
                self.assertLessEqual(near.largest(samples(tiles.world(tile), tile.arrays["indices"], RANDOM)),
                                     tile.error * (1 + 1e-6) + 1e-4, tile.path)

    def test_a_relief_is_tiled(self):
        y, x = np.mgrid[:120, :90] * 0.1
        np.save(self.folder / "h.npy", (50 * np.sin(x) * np.cos(y)).astype("f4"))
        run("preprocess", self.folder / "h.npy", "-o", self.folder / "h.isonest", "--spacing", "10,10")
        tiles, _ = self.tileset(self.folder / "h.isonest", "--graph", "--scale", 2)
        run("extract", self.folder / "h.isonest", "--graph", "--scale", 2, "-o", self.folder / "full.ply")
        self.check_errors(tiles, *read_points(self.folder / "full.ply"))

    def test_frames_turn_as_in_mesh_files(self):
        store = self.volume(gyroid(20, 0.3))
        for frame in ("ras", "lps"):
            done = run("extract", store, "--iso", 0, "--format", "3dtiles", "-o", self.folder / "x", "--space", frame, code=2)
            self.assertIn(frame.upper(), done.stderr)

    def test_bounds_count_in_the_distance_of_the_mesh(self):
        store = self.volume(gyroid(65, 0.15))
        points, faces = self.full(store, "--iso", 0)
        tiles, report = self.tileset(store, "--iso", 0, "--distance", 0.8)
        bound = report["distance_bound"]
        self.assertTrue(all(tile.error >= bound for tile in tiles.tiles))
        self.check_errors(tiles, points, faces)

    def test_wrong_requests_are_refused_and_nothing_is_left(self):
        store = self.volume(gyroid(24, 0.3))
        before = set(self.folder.iterdir())
        for options, text in ((("--format", "ply"), "--labels"), (("--georeference", "1,2"), "3dtiles"),
                              (("--format", "3dtiles", "--georeference", "1,95"), "latitude"),
                              (("--format", "3dtiles", "--up", "y"), "--up"),
                              (("--format", "3dtiles", "--memory", "64M"), "memory"),
                              (("--format", "4dtiles"), "3dtiles")):
            done = run("extract", store, "--iso", 0, *options, "-o", self.folder / "out.ply",
                       code=7 if "--memory" in options else 2)
            self.assertIn(text, done.stderr)
            self.assertEqual(before, set(self.folder.iterdir()))
        (self.folder / "mine").mkdir()
        (self.folder / "mine" / "letter.txt").write_text("dear")
        done = run("extract", store, "--iso", 0, "--format", "3dtiles", "-o", self.folder / "mine", code=2)
        self.assertIn("will not be replaced", done.stderr)
        self.assertEqual((self.folder / "mine" / "letter.txt").read_text(), "dear")
        for _ in range(2):  # a tileset is replaced
            run("extract", store, "--iso", 0, "--format", "3dtiles", "-o", f"{self.folder / 'site'}/")
        empty, report = self.tileset_without_mesh(store)
        self.assertEqual(report["triangles"], 0)
        self.assertEqual(empty["root"]["geometricError"], 0)

    def tileset_without_mesh(self, store):
        done = run("extract", store, "--iso", 1e9, "--format", "3dtiles", "-o", self.folder / "empty", "--json")
        return json.loads((self.folder / "empty" / "tileset.json").read_text()), json.loads(done.stdout)

    def test_an_interrupted_run_leaves_nothing(self):
        store = self.volume(gyroid(129, 0.3))
        before = set(self.folder.iterdir())
        for wait in (0.3, 1.0, 2.0):
            with subprocess.Popen([ISONEST, "extract", store, "--iso", "0", "--format", "3dtiles", "-o", self.folder / "t"],
                                  stderr=subprocess.PIPE) as running:
                time.sleep(wait)
                running.send_signal(signal.SIGINT)
                running.wait(60)
            if running.returncode == 0:
                shutil.rmtree(self.folder / "t")
            self.assertIn(running.returncode, (0, 130))
            self.assertEqual(before, set(self.folder.iterdir()))


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
