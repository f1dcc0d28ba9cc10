"""`isonest publish --check`: what it reports for correct servers, and for servers with one fault.

usage: publish_check_test.py ISONEST PLUGIN_FOLDER
"""
import json
import os
import pathlib
import subprocess
import sys
import tempfile
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
from range_server import RangeServer  # noqa: E402

ISONEST = os.path.abspath(sys.argv[1])
SHARED = {"Access-Control-Allow-Origin": "*", "Access-Control-Expose-Headers": "ETag",
          "Access-Control-Allow-Headers": "Range"}
UNSUPPORTED = 5


def run(*arguments):
    done = subprocess.run([ISONEST, *map(str, arguments)], text=True, capture_output=True, timeout=120)
    return done.returncode, done.stdout, done.stderr


def check(url, *options):
    code, out, _ = run("publish", "--check", url, "--json", *options)
    report = json.loads(out)
    wrong = {finding["fault"] for finding in report.get("findings", ()) if finding["state"] == "wrong"}
    return code, report, wrong


class Store(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.kept = tempfile.TemporaryDirectory()
        cls.folder = pathlib.Path(cls.kept.name)
        volume = cls.folder / "v.h5"
        assert run("make-volume", "bucky", "--size", "33", "-o", volume)[0] == 0
        assert run("preprocess", volume, "-o", cls.folder / "s.isonest")[0] == 0
        (cls.folder / "other.isonest").write_bytes(bytes(range(256)) * 100)

    @classmethod
    def tearDownClass(cls):
        cls.kept.cleanup()

    def server(self, extra=SHARED, **options):
        return RangeServer(self.folder, extra=lambda method, path: extra, **{"options": 204, **options})

    def test_a_right_server_is_right(self):
        with self.server() as server:
            code, report, wrong = check(server.url("s.isonest"), "--origin", "https://example.net")
            self.assertEqual((code, report["right"], report["kind"], wrong), (0, True, "store", set()))
            self.assertEqual({finding["what"] for finding in report["findings"]},
                             {"ranges", "length", "store", "encoding", "state", "CORS origin", "CORS headers", "CORS preflight"})
            self.assertEqual(report["lines"], [])
            asked = [note for note in server.notes if note.get("method") == "OPTIONS"]
            self.assertEqual([note["origin"] for note in asked], ["https://example.net"])
            self.assertEqual(run("publish", "--check", server.url("s.isonest"))[0], 0)

    def test_one_origin_may_be_allowed(self):
        with self.server({**SHARED, "Access-Control-Allow-Origin": "https://example.net"}) as server:
            self.assertEqual(check(server.url("s.isonest"), "--origin", "https://example.net")[0], 0)
            self.assertEqual(check(server.url("s.isonest"), "--origin", "https://example.com")[2], {"cors_origin"})

    def faults(self, expected, what=None, extra=SHARED, **options):
        with self.server(extra, fault_of=lambda number, path, headers: what if "range" in headers else None,
                         **options) as server:
            code, report, wrong = check(server.url("s.isonest"))
            self.assertEqual((code, wrong), (UNSUPPORTED, expected), report)
            self.assertFalse(report["right"])
            return {lines["server"]: lines["lines"] for lines in report["lines"]}

    def test_ranges(self):
        lines = self.faults({"ranges"}, knows_ranges=False)
        self.assertIn("max_ranges", lines["nginx"])
        self.assertIn("MaxRanges", lines["Apache"])
        for what in ("whole", "range_wrong", "range_shifted", "range_missing", "range_damaged"):
            with self.subTest(what):
                self.faults({"ranges"}, what)

    def test_a_compressed_store(self):
        lines = self.faults({"encoding"}, "gzip")
        self.assertIn("gzip off", lines["nginx"])
        self.assertIn("no-gzip", lines["Apache"])
        self.assertIn("content-encoding", lines["S3"])

    def test_sharing(self):
        lines = self.faults({"cors_origin"}, extra={}, options=405)
        for server in ("nginx", "Apache"):
            self.assertIn("Access-Control-Allow-Origin", lines[server])
        self.assertIn("put-bucket-cors", lines["S3"])
        for fault, extra, options in (("cors_headers", {**SHARED, "Access-Control-Expose-Headers": "X-ETag"}, 204),
                                      ("cors_preflight", SHARED, 405),
                                      ("cors_preflight", {**SHARED, "Access-Control-Allow-Headers": "If-Range"}, 204)):
            with self.server(extra, options=options) as server:
                code, report, wrong = check(server.url("s.isonest"))
                self.assertEqual((code, wrong), (0, set()))
                better = {finding["fault"] for finding in report["findings"] if finding["state"] == "could be better"}
                self.assertEqual(better, {fault})
                self.assertTrue(report["lines"])

    def test_lengths(self):
        fault = lambda number, path, headers: "no_head" if number > 1 and "range" not in headers else None  # noqa: E731
        with self.server(fault_of=fault) as server:
            self.assertEqual(check(server.url("s.isonest"))[2], {"length"})

    def test_what_is_no_store(self):
        with self.server() as server:
            code, report, wrong = check(server.url("other.isonest"))
            self.assertEqual((code, wrong), (UNSUPPORTED, {"missing"}))
            self.assertIn("footer", json.dumps(report))
            code, report, wrong = check(server.url("nothing.isonest"))
            self.assertEqual((code, wrong), (UNSUPPORTED, {"missing"}))
            self.assertIn("404", json.dumps(report))

    def test_without_states_it_could_be_better(self):
        with self.server(fault_of=lambda *_: "no_etag") as server:
            code, report, wrong = check(server.url("s.isonest"))
            self.assertEqual((code, wrong), (0, set()))
            self.assertIn("etag", {finding["fault"] for finding in report["findings"]})
            self.assertTrue(report["lines"])

    def test_nobody_answers(self):
        with self.server() as server:
            url = server.url("s.isonest")
        code, _, errors = run("publish", "--check", url)
        self.assertEqual(code, 6, errors)
        self.assertEqual(run("publish", "--check", "no url")[0], 2)

    def test_secrets_are_not_shown(self):
        with self.server() as server:
            for options in ((), ("--json",)):
                code, text, errors = run("publish", "--check", server.url("s.isonest?X-Amz-Signature=s3cret", "me:s3cret@"), *options)
                self.assertEqual(code, 0)
                self.assertNotIn("s3cret", text + errors)


    def test_a_server_does_not_write_to_the_terminal(self):
        hostile = "ETag, \x1b]0;renamed\x07\x9b31m\xe2\x80\xae\xc3\xa9\x7f"  # bytes of Latin-1
        with self.server({**SHARED, "Access-Control-Expose-Headers": hostile}) as server:
            done = subprocess.run([ISONEST, "publish", "--check", server.url("s.isonest")], capture_output=True, timeout=120)
            self.assertEqual(done.returncode, 0)
            shown = done.stdout.decode()
            self.assertIn("ETag, \\x1b]0;renamed\\x07\\x9b31m\\xe2\\x80\\xae\u00e9\\x7f", shown)
            self.assertTrue(all(c == "\n" or c.isprintable() for c in shown), shown)


class Site(unittest.TestCase):
    """A page with the list of its stores: the checks that concern the server."""

    def test_types(self):
        types = {".wasm": "application/wasm", ".mjs": "text/javascript; charset=utf-8", ".js": "application/javascript"}
        with tempfile.TemporaryDirectory() as kept:
            folder = pathlib.Path(kept)
            (folder / "site").mkdir()
            (folder / "site" / "index.html").write_text('<meta name="isonest-site" content="site.json" />')
            for name in ("isonest.wasm", "isonest.mjs", "worker.js", "mesh_worker.js", "main.js"):
                (folder / "site" / name).write_bytes(b"x" * 1000)
            volume = folder / "v.h5"
            self.assertEqual(run("make-volume", "bucky", "--size", "17", "-o", volume)[0], 0)
            self.assertEqual(run("preprocess", volume, "-o", folder / "site" / "s.isonest")[0], 0)
            wanted = types

            def extra(method, path):
                ending = pathlib.PurePosixPath(path.partition("?")[0]).suffix
                return {"Content-Type": wanted[ending]} if ending in wanted else {}

            with RangeServer(folder, extra=extra) as server:
                page = server.url("site/index.html")
                (folder / "site" / "site.json").write_text(json.dumps({"isonest_site": 1, "stores": [{"url": "s.isonest"}]}))
                code, report, wrong = check(page)
                self.assertEqual((code, report["kind"], wrong), (0, "site", set()), report)
                self.assertNotIn("CORS", json.dumps(report), "on its own server a store needs none")
                self.assertTrue(all(note.get("accept-encoding") == "identity" for note in server.notes if "site.json" in note["path"]))
                self.assertIn("compression", {finding["fault"] for finding in report["findings"]})
                with RangeServer(folder / "site") as other:
                    (folder / "site" / "site.json").write_text(json.dumps({"isonest_site": 1, "stores": [{"url": other.url("s.isonest")}]}))
                    self.assertEqual(check(page)[2], {"cors_origin"})
                    asked = [note for note in other.notes if "origin" in note]
                    self.assertEqual({note["origin"] for note in asked}, {"http://" + server.host})
                whole = {"url": "s.isonest", "bytes": (folder / "site" / "s.isonest").stat().st_size}
                for steps, expected in (([whole, whole], set()), ([whole, {**whole, "url": "t.isonest"}], {"missing"}),
                                        ([whole, {**whole, "bytes": 7}], {"missing"}), ([whole, {"url": "s.isonest"}], {"missing"}),
                                        ([{**whole, "bytes": "many"}], {"missing"}), ([7], {"missing"})):
                    (folder / "site" / "site.json").write_text(
                        json.dumps({"isonest_site": 1, "stores": [{"url": "s.isonest", "series": {"steps": steps}}]}))
                    code, report, wrong = check(page)
                    self.assertEqual(wrong, expected, steps)
                    told = [finding["found"] for finding in report["findings"] if finding["what"] == "steps"]
                    self.assertEqual(told, [] if expected else ["all 2 steps of the series are there"])
                (folder / "site" / "site.json").write_text(json.dumps({"isonest_site": 1, "stores": [{"url": "s.isonest"}]}))
                wanted = {".wasm": "application/octet-stream", ".mjs": "text/plain", ".js": "text/javascript"}
                code, report, wrong = check(page)
                self.assertEqual((code, wrong), (UNSUPPORTED, {"wasm_type", "script_type"}))
                lines = {one["server"]: one["lines"] for one in report["lines"]}
                self.assertIn("application/wasm", lines["nginx"])
                self.assertIn("AddType text/javascript", lines["Apache"])
                for named in ("\x1b]0;renamed\x07.isonest", "https://\x1b[31m/s.isonest", "http://127.0.0.1:1/\x1b[31m"):
                    (folder / "site" / "site.json").write_text(json.dumps({"isonest_site": 1, "stores": [{"url": named}]}))
                    done = subprocess.run([ISONEST, "publish", "--check", page], capture_output=True, text=True, timeout=120)
                    self.assertNotEqual(done.returncode, 0)
                    self.assertNotIn("\x1b", done.stdout + done.stderr, named)
                (folder / "site" / "site.json").write_text(json.dumps({"isonest_site": 1, "stores": [{"url": "s.isonest"}]}))
                (folder / "site" / "isonest.wasm").unlink()
                self.assertEqual(check(page)[2], {"missing", "script_type"})


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
