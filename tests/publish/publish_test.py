"""`isonest publish`: the content of the folder, that it appears completely or not at all, and what is refused.

usage: publish_test.py ISONEST PLUGIN_FOLDER
"""
import html
import json
import os
import pathlib
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
from range_server import RangeServer  # noqa: E402

import h5py
import numpy

ROOT = pathlib.Path(__file__).resolve().parents[2]
ISONEST = os.path.abspath(sys.argv[1])
PAGE = {"index.html", "main.js", "mesh_worker.js", "worker.js", "style.css", "licences.txt", "isonest.wasm", "isonest.mjs", "site.json"}


def run(*arguments, code=0):
    done = subprocess.run([ISONEST, *map(str, arguments)], text=True, capture_output=True, timeout=300)
    assert done.returncode == code, f"{arguments}: {done.returncode}\n{done.stdout}{done.stderr}"
    return done.stdout + done.stderr


def files_of(folder):
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}


class Publish(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.kept = tempfile.TemporaryDirectory()
        cls.folder = pathlib.Path(cls.kept.name)
        volume = cls.folder / "v.h5"
        cls.store, cls.other = cls.folder / "scan.isonest", cls.folder / "a b.isonest"
        run("make-volume", "bucky", "--size", "33", "-o", volume)
        run("preprocess", volume, "--unit", "um", "-o", cls.store)
        run("make-volume", "sphere", "--size", "17", "-o", volume, "--force")
        run("preprocess", volume, "-o", cls.other)

    @classmethod
    def tearDownClass(cls):
        cls.kept.cleanup()

    def setUp(self):
        self.site = self.folder / self.id().rpartition(".")[2]

    def tearDown(self):
        self.assertEqual([path.name for path in self.folder.iterdir() if path.name.startswith(".")], [])
        shutil.rmtree(self.site, ignore_errors=True)

    def list_of(self):
        return json.loads((self.site / "site.json").read_text())

    def policy_of(self):
        page = (self.site / "index.html").read_text()
        [policy] = re.findall(r'http-equiv="Content-Security-Policy" content="([^"]*)"', page)
        self.assertLess(page.index("Content-Security-Policy"), page.index("<script"))
        self.assertLess(page.index("Content-Security-Policy"), page.index("<link"))
        return {words[0]: words[1:] for words in (part.split() for part in html.unescape(policy).split(";"))}

    def test_a_folder(self):
        report = json.loads(run("publish", self.store, "-o", f"{self.site}/", "--title", 'A <"scan"> & more', "--description",
                                "First.\n\nSecond.", "--license", "CC BY 4.0", "--json"))
        self.assertEqual(files_of(self.site), PAGE | {"stores/scan.isonest"})
        self.assertEqual(set(report["files"]), files_of(self.site))
        self.assertEqual((self.site / "stores/scan.isonest").read_bytes(), self.store.read_bytes())
        listed = self.list_of()
        [store] = listed["stores"]
        self.assertEqual((listed["isonest_site"], listed["title"], listed["memory"]), (1, 'A <"scan"> & more', 256 << 20))
        self.assertEqual(store, {"name": "scan", "url": "stores/scan.isonest", "title": 'A <"scan"> & more',
                                 "description": "First.\n\nSecond.", "license": "CC BY 4.0",
                                 "bytes": self.store.stat().st_size, "nodes": [33, 33, 33], "type": "float32", "unit": "um"})
        page = (self.site / "index.html").read_text()
        self.assertIn("<title>A &lt;&quot;scan&quot;&gt; &amp; more</title>", page)
        self.assertIsNone(re.search(r"<script(?![^>]*src=)|<style|style=|onload=", page))
        policy = self.policy_of()
        self.assertEqual((policy["default-src"], policy["script-src"], policy["connect-src"]),
                         (["'none'"], ["'self'", "'wasm-unsafe-eval'"], ["'self'"]))
        self.assertIn('<iframe src="https://YOUR.HOST/PATH/?store=scan" title="A &lt;&quot;scan&quot;> &amp; more"', report["stores"][0]["iframe"])
        self.assertEqual((self.site / "isonest.wasm").read_bytes()[:4], b"\0asm")

    def test_several(self):
        run("publish", self.store, self.other, self.other, "-o", self.site, "--title", "All", "--license", "CC0", "--license", "MIT", "--license", "")
        listed = self.list_of()
        self.assertEqual([(store["name"], store["url"], store["title"], store["license"], store["unit"]) for store in listed["stores"]],
                         [("scan", "stores/scan.isonest", "scan", "CC0", "um"), ("a-b", "stores/a-b.isonest", "a b", "MIT", None),
                          ("a-b-2", "stores/a-b-2.isonest", "a b", "", None)])
        self.assertEqual((listed["title"], listed["license"]), ("All", ""))
        run("publish", self.store, self.other, "-o", self.site, "--force", "--title", "a", "--title", "b", "--title", "c", code=2)

    def test_hard_links_and_links(self):
        run("publish", self.store, "-o", self.site, "--hard-link")
        self.assertTrue((self.site / "stores/scan.isonest").samefile(self.store))
        run("publish", self.store, self.other, "-o", self.site, "--force", "--link", "https://data.example.org:8443/x/")
        self.assertEqual(files_of(self.site), PAGE)
        self.assertEqual([store["url"] for store in self.list_of()["stores"]],
                         ["https://data.example.org:8443/x/scan.isonest", "https://data.example.org:8443/x/a%20b.isonest"])
        self.assertEqual(self.policy_of()["connect-src"], ["'self'", "https://data.example.org:8443"])
        self.assertTrue(self.store.exists(), "what was linked is there")
        with RangeServer(self.folder) as server:
            run("publish", server.url("scan.isonest"), "-o", self.site, "--force")
            self.assertEqual([store["url"] for store in self.list_of()["stores"]], [server.url("scan.isonest")])
        for wrong in ("https://me:secret@example.org/s", "https://example.org/s?X-Amz-Signature=secret", "s", "file:///s"):
            text = run("publish", self.store, "-o", self.site, "--force", "--link", wrong, code=2)
            self.assertNotIn("secret", text.replace("--link", "").replace("a password or", ""))
        for name in ("token", "access_token", "%74oken", "X-Access-Token", "key", "api_key", "apiKey", "sig", "password", "client_secret", "jwt", "auth", "code"):
            link = f"https://example.org/s.isonest?a=1&{name}=hidden123"
            text = run("publish", self.store, "-o", self.site, "--force", "--link", link, code=2)
            self.assertNotIn("hidden123", text)
            self.assertIn("everybody could read", text)
        for query in ("version=3", "key=data/s.isonest", "key=s.isonest", "token=", "response-content-type=x", "keys=7", "tokens=1"):
            run("publish", self.store, "-o", self.site, "--force", "--link", f"https://example.org/s?{query}")
        run("publish", self.store, self.other, "-o", self.site, "--force", "--link", "https://example.org/s.isonest", code=2)
        run("publish", self.store, "-o", self.site, "--force", "--link", "https://example.org/s", "--hard-link", code=2)

    def test_what_is_replaced(self):
        self.site.mkdir()
        self.assertIn("exists", run("publish", self.store, "-o", self.site, code=2))
        self.assertIn("did not create", run("publish", self.store, "-o", self.site, "--force", code=2))
        self.site.rmdir()
        run("publish", self.store, "-o", self.site)
        self.assertIn("--force", run("publish", self.store, "-o", self.site, code=2))
        (self.site / "CNAME").write_text("example.org")
        self.assertIn("CNAME", run("publish", self.store, "-o", self.site, "--force", code=2))
        (self.site / "CNAME").unlink()
        run("publish", self.other, "-o", self.site, "--force")
        self.assertEqual(files_of(self.site), PAGE | {"stores/a-b.isonest"})
        inside = self.site / "stores/a-b.isonest"
        self.assertIn("folder", run("publish", inside, "-o", self.site, "--force", code=2))
        self.assertTrue(inside.exists())
        link = self.folder / "link"
        link.symlink_to(self.site)
        self.assertIn("not a folder", run("publish", self.store, "-o", link, "--force", code=2))
        link.unlink()
        run("publish", self.store, "-o", self.folder / "nowhere" / "site", code=3)

    def series(self):
        """Three steps, at the times 0, 1.5 and 4, with the largest values 7, 8 and 11."""
        folder = self.folder / "run.isonest"
        if not folder.exists():
            grid = numpy.indices((9, 10, 11)).sum(axis=0) / 27
            for step, largest in enumerate((7, 8, 11)):
                with h5py.File(self.folder / f"t{step}.h5", "w") as file:
                    file["v"] = (grid * largest).astype("f4")
            run("preprocess", *[self.folder / f"t{step}.h5" for step in range(3)], "--times", "0,1.5,4", "-o", folder)
        return folder

    def test_a_series(self):
        series = self.series()
        names = [f"step_00000{step}.isonest" for step in range(3)]
        report = json.loads(run("publish", f"{series}/", self.store, "-o", self.site, "--json"))
        self.assertEqual(files_of(self.site), PAGE | {"stores/scan.isonest"} | {f"stores/run/{name}" for name in names})
        self.assertEqual(set(report["files"]), files_of(self.site))
        for name in names:
            self.assertEqual((self.site / "stores/run" / name).read_bytes(), (series / name).read_bytes())
        sizes = [(series / name).stat().st_size for name in names]
        run_, scan = self.list_of()["stores"]
        self.assertEqual((run_["name"], run_["title"], run_["url"], run_["bytes"], run_["nodes"]),
                         ("run", "run", f"stores/run/{names[0]}", sum(sizes), [11, 10, 9]))
        self.assertEqual(run_["series"], {"time_unit": None, "min_value": 0, "max_value": 11, "steps": [
            {"time": time, "url": f"stores/run/{name}", "bytes": size} for time, name, size in zip((0, 1.5, 4), names, sizes)]})
        self.assertNotIn("series", scan)
        self.assertEqual(report["stores"][0]["steps"], 3)
        # Its folder is replaced as a whole, and not if there is anything else in it.
        (self.site / "stores/run/notes").write_text("mine")
        self.assertIn("notes", run("publish", self.store, "-o", self.site, "--force", code=2))
        (self.site / "stores/run/notes").unlink()
        run("publish", series, "-o", self.site, "--force", "--times", "1:", "--hard-link")
        self.assertEqual([step["time"] for step in self.list_of()["stores"][0]["series"]["steps"]], [1.5, 4])
        self.assertEqual(files_of(self.site), PAGE | {f"stores/run/{name}" for name in names[1:]})
        self.assertTrue((self.site / "stores/run" / names[1]).samefile(series / names[1]))
        self.assertIn("input", run("publish", self.site / "stores/run" / names[1], "-o", self.site, "--force", code=2))

    def test_a_series_that_is_linked(self):
        series = self.series()
        own = "https://data.example.org/x/run.isonest"
        for link in (own, "https://data.example.org/x/"):
            run("publish", series, "-o", self.site, "--force", "--link", link)
            self.assertEqual(files_of(self.site), PAGE)
            self.assertEqual([step["url"] for step in self.list_of()["stores"][0]["series"]["steps"]],
                             [f"{own}/step_00000{step}.isonest" for step in range(3)])
            self.assertEqual(self.policy_of()["connect-src"], ["'self'", "https://data.example.org"])
        run("publish", series, "-o", self.site, "--force", "--link", "https://example.org/run?version=2", code=2)
        self.assertIn("--times", run("publish", self.store, "-o", self.site, "--force", "--times", "1", code=2))

    def test_old_stores(self):
        old = ROOT / "tests/store/golden/2.7.store"
        self.assertTrue(old.exists())
        text = run("publish", old, "-o", self.site, code=5)
        self.assertIn("preprocess the volume again", text)
        self.assertFalse(self.site.exists())
        run("publish", self.folder / "v.h5", "-o", self.site, code=2)
        run("publish", "-o", self.site, code=2)
        self.assertFalse(self.site.exists())

    def big_store(self):
        big = self.folder / "big.isonest"
        if not big.exists():
            run("make-volume", "noise", "--size", "257", "-o", self.folder / "big.h5")
            run("preprocess", self.folder / "big.h5", "-o", big)
        return big

    def test_an_unfinished_folder_that_somebody_removes_is_said_to_be_removed(self):
        process = subprocess.Popen([ISONEST, "publish", *[self.big_store()] * 8, "-o", self.site, "-q"], stderr=subprocess.PIPE, text=True)
        unfinished = []
        while not unfinished and process.poll() is None:
            unfinished = [path for path in self.folder.iterdir() if path.name.startswith(f".{self.site.name}.partial-")]
        process.send_signal(signal.SIGSTOP)
        os.waitid(os.P_PID, process.pid, os.WSTOPPED | os.WEXITED | os.WNOWAIT)
        for path in unfinished:
            shutil.rmtree(path)
        process.send_signal(signal.SIGCONT)
        _, said = process.communicate(timeout=60)
        self.assertEqual(process.returncode, 6, said)
        self.assertIn("was removed while it was filled", said)
        self.assertEqual(said.count("isonest: error: "), 1, said)
        self.assertFalse(self.site.exists())

    def test_interrupted(self):
        big = self.big_store()
        stopped = 0
        for wait in (0.05, 0.1, 0.15, 0.2, 0.3, 0.4):
            process = subprocess.Popen([ISONEST, "publish", *[big] * 8, "-o", self.site, "-q"], stderr=subprocess.DEVNULL)
            time.sleep(wait)
            process.send_signal(signal.SIGINT)
            code = process.wait(60)
            self.assertIn(code, (0, 130, -signal.SIGINT))  # it may have come before the program installed its handler
            stopped += code == 130
            self.assertEqual(self.site.exists(), code == 0)
            self.assertEqual([path.name for path in self.folder.iterdir() if path.name.startswith(".")], [])
            shutil.rmtree(self.site, ignore_errors=True)
        self.assertGreater(stopped, 0, "no run was stopped")


if __name__ == "__main__":
    if "only checks servers" in " ".join(run("publish", "--help").split()):
        assert "(publish)" in run("--version")
        with tempfile.TemporaryDirectory() as kept:
            text = run("publish", pathlib.Path(kept) / "s.isonest", "-o", pathlib.Path(kept) / "site", code=5)
            assert "emscripten" in text, text
        print("skipped: the program was built without emscripten, and says so")
        sys.exit(77)
    unittest.main(argv=sys.argv[:1])
