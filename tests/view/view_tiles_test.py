"""Tiles of surfaces with more triangles than a page shows, from the server of isonest view: they are those of
`isonest extract --format 3dtiles`, and nothing is left of them.

Usage: view_tiles_test.py ISONEST PLUGIN_FOLDER
"""
import concurrent.futures
import json
import pathlib
import resource
import signal
import subprocess
import sys
import time
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import sanitized  # noqa: E402
from view_process import HERE, ISONEST, View, isonest, run_tests, view  # noqa: E402

import h5py
import numpy

SECONDS = 600 if sanitized.is_sanitized(ISONEST) else 120


def wait_until(condition, what):
    end = time.monotonic() + SECONDS
    while time.monotonic() < end:
        found = condition()
        if found:
            return found
        time.sleep(0.02)
    raise AssertionError(what)


def made(server, **parameters):
    """Asks until tiles are not in the making any more."""
    def ask():
        status, said = server.json("/api/tiles", **{"stream": "a", **parameters})
        return None if status == 200 and said["state"] in ("waiting", "making") else (status, said)
    return wait_until(ask, f"no tiles of {parameters}")


def is_being_made(server, **parameters):
    return wait_until(lambda: server.json("/api/tiles", **{"stream": "a", **parameters})[1]["state"] == "making", "it never began")


class Tiles(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        # With a unit and a patient's axes as well: the page's coordinates are those of the store.
        isonest("make-volume", "bucky", "--size", 97, "-o", "v.h5", "-q")
        isonest("preprocess", "v.h5", "-o", "s.isonest", "-q")
        isonest("preprocess", "v.h5", "--unit", "mm", "--frame", "lps", "-o", "patient.isonest", "-q")
        # 598,176 triangles: long enough to be cancelled.
        isonest("make-volume", "bucky", "--size", 257, "--type", "uint8", "-o", "l.h5", "-q")
        isonest("preprocess", "l.h5", "-o", "l.isonest", "-q")
        cls.full = json.loads(isonest("extract", "s.isonest", "--iso", 0.5, "-o", "full.ply", "--json").stdout)["triangles"]

    def test_tiles_are_those_that_extract_makes(self):
        isonest("extract", "s.isonest", "--iso", 0.5, "--normals", "--format", "3dtiles", "-o", "site", "-q")
        files = [file for file in (HERE / "site").rglob("*") if file.is_file()]
        self.assertGreater(len(files), 5)
        for store in ("s.isonest", "patient.isonest"):
            with view(store) as server:
                status, said = made(server, iso=0.5, limit=self.full - 1)
                self.assertEqual((status, said["state"], said["triangles"], said["data_tolerance"]), (200, "ready", self.full, 0))
                for file in files:
                    path = f"/api/tileset/{said['tileset']}/{file.relative_to(HERE / 'site')}"
                    status, headers, body = server.ask(path)
                    self.assertEqual(status, 200, path)
                    self.assertEqual(headers["Content-Type"], "application/json" if file.suffix == ".json" else "model/gltf-binary")
                    # Neither metres nor other axes: what is in the store's own coordinates has no unit for the tiles.
                    self.assertEqual(body, file.read_bytes(), f"{store}: {file}")
                self.assertEqual(sum(file.stat().st_size for file in files), said["bytes"])
                self.assertEqual(server.ask(f"/api/tileset/{said['tileset']}/tiles/0/99_0_0.glb")[0], 404)
                self.assertEqual(server.ask(f"/api/tileset/{said['tileset']}/../store")[0], 404)

    def test_a_list_counts_the_triangles_of_each_tile(self):
        with view("s.isonest") as server:
            _, said = made(server, iso=0.5, limit=100)
            root = server.json(f"/api/tileset/{said['tileset']}/tileset.json")[1]["root"]
            sums = {}

            def visit(tile):
                level = int(tile["content"]["uri"].split("/")[1])
                body = server.ask(f"/api/tileset/{said['tileset']}/{tile['content']['uri']}")[2]
                head = json.loads(body[20:20 + int.from_bytes(body[12:16], "little")])
                corners = head["accessors"][head["meshes"][0]["primitives"][0]["indices"]]["count"]
                self.assertEqual(tile["extras"]["triangles"], corners // 3)
                sums[level] = sums.get(level, 0) + corners // 3
                for child in tile.get("children", []):
                    visit(child)
            visit(root)
            self.assertEqual([sums[level] for level in sorted(sums)], [level["triangles"] for level in said["levels"]])

    def test_a_surface_within_the_limit_gets_none(self):
        with view("s.isonest") as server:
            self.assertEqual(made(server, iso=0.5, limit=self.full), (200, {"state": "unneeded", "triangles": self.full}))
            self.assertEqual(made(server, iso=0.5, limit=self.full - 1)[1]["state"], "ready")
            self.assertEqual(made(server, iso=0.5, limit=self.full)[1], {"state": "unneeded", "triangles": self.full})
            self.assertEqual(made(server, iso=99, limit=100)[1], {"state": "unneeded", "triangles": 0})

    def test_wrong_requests_are_refused(self):
        with h5py.File(HERE / "labels.h5", "w") as file:
            file["v"] = numpy.arange(4913, dtype=numpy.int64).reshape(17, 17, 17) % 3
            file["flat"] = numpy.arange(289, dtype=numpy.float32).reshape(17, 17)
        isonest("preprocess", "labels.h5", "--dataset", "v", "--labels", "-o", "labels.isonest", "-q")
        isonest("preprocess", "labels.h5", "--dataset", "flat", "-o", "flat.isonest", "-q")
        for store in ("labels.isonest", "flat.isonest"):
            with view(store) as server:
                self.assertEqual(server.json("/api/tiles", iso=1, limit=100, stream="a")[0], 400, store)
        with view("s.isonest") as server:
            for wrong in ({"limit": 100}, {"iso": 0.5}, {"iso": "nan", "limit": 100}, {"iso": 0.5, "limit": 99},
                          {"iso": 0.5, "limit": 100, "error": 1}):
                status, said = server.json("/api/tiles", stream="a", **wrong)
                self.assertEqual((status, said["error"]["kind"]), (400, "invalid_argument"), wrong)
            self.assertEqual(server.json("/api/tiles", iso=0.5, limit=100)[0], 400)
            self.assertEqual(server.ask("/api/tileset/0123456789abcdef0123456789abcdef/tileset.json")[0], 404)
            self.assertEqual(server.ask("/api/tiles", method="POST", iso=0.5, limit=100, stream="a")[0], 405)

    def test_another_isovalue_and_cancel_end_the_work(self):
        with view("l.isonest") as server:
            is_being_made(server, iso=128, limit=1000)
            # Another page wants the same: then it goes on.
            self.assertEqual(server.json("/api/tiles", iso=128, limit=1000, stream="b")[0], 200)
            self.assertEqual(server.ask("/api/cancel", method="POST", stream="a")[0], 204)
            self.assertEqual(server.json("/api/status")[1]["file"], 1)
            self.assertEqual(server.json("/api/status")[1]["cancelled"], 0)
            started = time.monotonic()
            self.assertIn(server.json("/api/tiles", iso=200, limit=10**8, stream="b")[1]["state"], ("waiting", "making"))
            self.assertEqual(made(server, iso=200, limit=10**8, stream="b")[1]["state"], "unneeded")
            # The first would have taken longer than both.
            self.assertLess(time.monotonic() - started, SECONDS / 2)
            is_being_made(server, iso=128, limit=1000)
            server.ask("/api/cancel", method="POST", stream="a")
            wait_until(lambda: server.json("/api/status")[1]["file"] == 0, "it went on")

    def test_a_file_has_priority_and_tiles_are_begun_again(self):
        with view("l.isonest") as server, concurrent.futures.ThreadPoolExecutor() as pool:
            is_being_made(server, iso=128, limit=1000)
            status, _, body = pool.submit(server.ask, "/api/export", iso=128, error=20, format="ply").result(timeout=SECONDS)
            self.assertEqual(status, 200)
            self.assertTrue(body.startswith(b"ply"))
            self.assertIn(server.json("/api/tiles", iso=128, limit=1000, stream="a")[1]["state"], ("waiting", "making"))
            self.assertEqual(made(server, iso=128, limit=1000)[1]["state"], "ready")

    def test_the_last_four_are_kept(self):
        with view("s.isonest") as server:
            names = [made(server, iso=iso, limit=1000)[1]["tileset"] for iso in (0.3, 0.4, 0.5, 0.6)]
            self.assertEqual(made(server, iso=0.3, limit=1000)[1]["tileset"], names[0])
            made(server, iso=0.7, limit=1000)
            there = [server.ask(f"/api/tileset/{name}/tileset.json")[0] for name in names]
            self.assertEqual(there, [200, 404, 200, 200])

    def test_the_heap_stays_within_the_memory(self):
        memory = 1 << 30
        with view("l.isonest", "--memory", "1G", limit=memory + (200 << 20)) as server, \
                concurrent.futures.ThreadPoolExecutor() as pool:
            most = 0

            def made_meanwhile():
                nonlocal most
                status, said = server.json("/api/tiles", iso=128, limit=1000, stream="a")
                most = max(most, server.json("/api/status")[1]["heap_bytes"])
                self.assertEqual(status, 200, said)
                return said if said["state"] == "ready" else None
            meshes = [pool.submit(server.mesh, "/api/surface", iso=iso, error=0, stream=f"m{iso}") for iso in (100, 130)]
            said = wait_until(made_meanwhile, "no tiles")
            for mesh in meshes:
                self.assertGreater(mesh.result(timeout=SECONDS)["triangles"], 100000)
            self.assertGreater(said["levels"][0]["tiles"], 20)
            self.assertLess(most, memory)
            self.assertGreater(most, 16 << 20)  # it was measured while there was work

    def test_too_little_memory_is_an_error_with_the_memory_that_is_enough(self):
        with view("s.isonest", "--memory", "512M") as server:
            status, said = made(server, iso=0.5, limit=1000)
            self.assertEqual((status, said["error"]["kind"]), (413, "limit"))
            self.assertIn("--memory", said["error"]["message"])
            enough = next(remedy["value"] for remedy in said["error"]["remedies"] if remedy["kind"] == "more_memory")
            self.assertEqual(made(server, iso=0.5, limit=self.full)[1]["state"], "unneeded")
        with view("s.isonest", "--memory", enough) as server:
            self.assertEqual(made(server, iso=0.5, limit=1000)[1]["state"], "ready")

    def test_nothing_is_left_in_the_temporary_folder(self):
        for end in (signal.SIGINT, signal.SIGTERM, signal.SIGKILL):
            for is_ready in (True, False):
                folder = HERE / f"tmp-{end}-{is_ready}"
                folder.mkdir()
                server = View("l.isonest", folder=folder)
                if is_ready:
                    self.assertEqual(made(server, iso=250, limit=100)[1]["state"], "ready")
                is_being_made(server, iso=128, limit=1000)
                code, _, errors = server.end(end)
                self.assertEqual(code, -9 if end == signal.SIGKILL else 0, errors)
                self.assertEqual(list(folder.rglob("*")), [])

    def test_a_disk_without_space_is_an_error(self):
        # A limit of the size of files stands for a full disk: tiles of the large surface do not fit.
        server = View.__new__(View)
        server.process = subprocess.Popen(
            [ISONEST, "view", "l.isonest", "--json", "--port", "0"], cwd=HERE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
            preexec_fn=lambda: (signal.signal(signal.SIGXFSZ, signal.SIG_IGN), resource.setrlimit(resource.RLIMIT_FSIZE, (1 << 20, 1 << 20))))
        server.url = json.loads(server.process.stdout.readline())["url"]
        server.port = int(server.url.rsplit(":", 1)[1].rstrip("/"))
        status, said = made(server, iso=128, limit=1000)
        self.assertEqual((status, said["error"]["kind"]), (500, "io"), said)
        self.assertEqual(server.json("/api/store")[0], 200)
        self.assertEqual(server.end()[0], 0)


if __name__ == "__main__":
    run_tests()
