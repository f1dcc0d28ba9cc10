"""isonest view of a store at a URL: the same meshes, few round trips until the first one, and an object that changes.

usage: remote_view_test.py ISONEST PLUGIN_FOLDER
"""
import http.client
import json
import os
import pathlib
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import unittest
import urllib.parse

sys.path.insert(0, str(pathlib.Path(__file__).parents[1]))
from support.range_server import RangeServer  # noqa: E402

ISONEST = pathlib.Path(sys.argv[1]).resolve()
FOLDER = pathlib.Path(tempfile.mkdtemp(prefix="isonest-remote-view-"))
ENVIRONMENT = {name: value for name, value in os.environ.items()
               if not name.startswith(("AWS_", "SSL_CERT", "CURL_")) and not name.lower().endswith("_proxy")}
ENVIRONMENT["HOME"] = str(FOLDER)
if subprocess.run([ISONEST, "view", "--help"], capture_output=True, check=False).returncode != 0:
    print("skipped: this build has no isonest view")
    sys.exit(77)

_missing = subprocess.run([ISONEST, "info", "http://127.0.0.1:1/x", "--json"], env=ENVIRONMENT, capture_output=True, text=True,
                         check=False)
if _missing.returncode == 5:
    _remedy = json.loads(_missing.stdout)["error"]["remedies"][0]
    assert (_remedy["kind"], _remedy["value"]) == ("install_package", "libcurl4-openssl-dev"), _missing.stdout
    print("skipped: this build reads no URLs, and says so")
    sys.exit(77)


class View:
    def __init__(self, location, *options):
        self.process = subprocess.Popen([ISONEST, "view", location, "--port", "0", "--json", *options], cwd=FOLDER,
                                        env=ENVIRONMENT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        self.first = json.loads(self.process.stdout.readline())
        self.port = urllib.parse.urlsplit(self.first["url"]).port

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.send_signal(signal.SIGINT)
        self.out, self.err = self.process.communicate(timeout=60)

    def ask(self, what, **parameters):
        """Status and body."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=120)
        try:
            connection.request("GET", f"/api/{what}?{urllib.parse.urlencode(parameters)}")
            answer = connection.getresponse()
            return answer.status, answer.read()
        finally:
            connection.close()


def without_times(message):
    """A mesh in the format of PROTOCOL.md: its header without the time, and the rest."""
    length = struct.unpack_from("<I", message, 8)[0]
    header = json.loads(message[16:16 + length])
    assert header.pop("seconds") >= 0
    return header, message[16 + length:]


class RemoteView(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        for arguments in (["make-volume", "bucky", "--size", "129", "--type", "uint8", "-o", "b.h5"],
                          ["preprocess", "b.h5", "-o", "b.isonest", "--chunk", "32"]):
            subprocess.run([ISONEST, *arguments], cwd=FOLDER, check=True, capture_output=True)

    def test_the_page_gets_what_it_gets_of_the_file(self):
        asked = [("store", {}), ("surface", {"iso": 120, "error": 12}), ("surface", {"iso": 120, "triangles": 20000}),
                 ("slice", {"plane": "0,0,1,40", "error": 5}), ("value", {"at": "20,30,40"}), ("histogram", {}),
                 ("export", {"iso": 120, "error": 12, "format": "ply"})]
        with RangeServer(FOLDER) as server, View("b.isonest") as local:
            url = server.url("b.isonest", "me:s3cret@") + "?s3cret"
            with View(url, "--header", "X-Token: s3cret") as remote:
                self.assertEqual(remote.first["store"], server.url("b.isonest"))
                for path, parameters in asked:
                    here, there = local.ask(path, **parameters), remote.ask(path, **parameters)
                    if path == "store":
                        # A part of the memory is reserved for fetched data.
                        here, there = (json.loads(body) for _, body in (here, there))
                        self.assertEqual((here.pop("remote"), there.pop("remote")), (False, True))
                        for key in ("memory", "most_triangles", "first_error"):
                            here.pop(key), there.pop(key)
                    elif here[1][:4] == there[1][:4] == b"ISOV":
                        here, there = without_times(here[1]), without_times(there[1])
                    self.assertEqual(here, there, path)
                status = json.loads(remote.ask("status")[1])
                self.assertEqual(status["store"], "ok")
                self.assertEqual(status["remote"]["requests"], server.requests)
                self.assertNotIn("remote", json.loads(local.ask("status")[1]))
                command = json.loads(remote.ask("command", iso=120, error=12)[1])["command"]
                self.assertIn(server.url("b.isonest"), command)
            self.assertNotIn("s3cret", remote.out + remote.err + json.dumps(remote.first) + command)
            self.assertEqual(remote.process.returncode, 0)
            self.assertGreaterEqual(json.loads(remote.out)["remote"]["requests"], status["remote"]["requests"])

    def test_the_first_mesh_takes_few_round_trips(self):
        with RangeServer(FOLDER) as server, View(server.url("b.isonest")) as view:
            status, _ = view.ask("surface", iso=120, triangles=2000)
            self.assertEqual(status, 200)
            self.assertLessEqual(json.loads(view.ask("status")[1])["remote"]["round_trips"], 5)

    def test_the_first_picture_takes_three_round_trips(self):
        for arguments in (["make-volume", "bucky", "--size", "257", "--type", "uint8", "-o", "c.h5"],
                          ["preprocess", "c.h5", "-o", "large.isonest", "--chunk", "32"]):
            subprocess.run([ISONEST, *arguments], cwd=FOLDER, check=True, capture_output=True)
        with RangeServer(FOLDER, delay=0.02) as server, View("large.isonest") as local, \
                View(server.url("large.isonest")) as remote:
            self.assertIsNone(json.loads(local.ask("store")[1])["first_error"])
            # As the page does: the suggestion, then the surface.
            store = json.loads(remote.ask("store")[1])
            self.assertGreater(store["first_error"], 0)
            self.assertLess(store["first_error"], 0.1 * store["max_value"])
            histogram = json.loads(remote.ask("histogram", coarse=1)[1])
            self.assertGreater(histogram["level"], 0)
            self.assertEqual(histogram["cube_level"], histogram["level"])
            asked = {"iso": histogram["suggested"][0]["isovalue"], "error": store["first_error"], "limit": 100000}
            _, mesh = remote.ask("surface", **asked)
            fetched = json.loads(remote.ask("status")[1])["remote"]
            self.assertLessEqual(fetched["round_trips"], 2)
            self.assertLess(fetched["remote_bytes"], 1.3 * 2**20)
            header, rest = without_times(mesh)
            self.assertGreater(header["triangles"], 1000)
            self.assertLessEqual(header["error_bound"], store["first_error"])
            self.assertEqual((header, rest), without_times(local.ask("surface", **asked)[1]))
            # Also a slice and another isovalue, without further round trips.
            self.assertEqual(remote.ask("slice", plane="0,0,1,128", error=store["first_error"], limit=30000)[0], 200)
            self.assertEqual(remote.ask("surface", **{**asked, "iso": asked["iso"] + 20})[0], 200)
            self.assertLessEqual(json.loads(remote.ask("status")[1])["remote"]["round_trips"], 2)
            # For a file, coarse has no effect.
            self.assertEqual(local.ask("histogram", coarse=1), local.ask("histogram"))
            self.assertEqual(local.ask("histogram", coarse=2)[0], 400)

    def test_an_object_that_changes_is_an_error(self):
        shutil.copy(FOLDER / "b.isonest", FOLDER / "c.isonest")
        with RangeServer(FOLDER) as server, View(server.url("c.isonest")) as view:
            self.assertEqual(view.ask("surface", iso=120, triangles=1000)[0], 200)
            (FOLDER / "c.isonest").write_bytes((FOLDER / "b.isonest").read_bytes()[:-1] + b"x")
            status, body = view.ask("surface", iso=120, error=0)
            self.assertEqual(status, 500, body)
            self.assertIn("changed", json.loads(body)["error"]["message"])

    def test_no_request_names_another_url(self):
        with RangeServer(FOLDER) as server, View("b.isonest") as view:
            for name in ("store", "url", "location", "path"):
                self.assertEqual(view.ask("surface", iso=120, error=12, **{name: server.url("b.isonest")})[0], 400)
            self.assertEqual(server.requests, 0)


try:
    unittest.main(argv=sys.argv[:1])
finally:
    shutil.rmtree(FOLDER)
