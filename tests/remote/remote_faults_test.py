"""Failures between a command and a server give a clear error with its exit code and no output; Ctrl-C ends a wait at
once; and no password, query or header is ever shown.

usage: remote_faults_test.py ISONEST PLUGIN_FOLDER
"""
import json
import os
import pathlib
import resource
import shutil
import subprocess
import sys
import tempfile
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).parents[1]))
sys.path.insert(0, str(pathlib.Path(__file__).parents[1] / "support"))
import served  # noqa: E402
from support.interrupted import interrupted  # noqa: E402
from support.range_server import RangeServer, certificate  # noqa: E402

ISONEST = pathlib.Path(sys.argv[1]).resolve()
FOLDER = pathlib.Path(tempfile.mkdtemp(prefix="isonest-remote-faults-"))
ENVIRONMENT = {name: value for name, value in os.environ.items()
               if not name.startswith(("AWS_", "SSL_CERT", "CURL_")) and not name.lower().endswith("_proxy")}
ENVIRONMENT["HOME"] = str(FOLDER)
SECRET = "s3cret"
EXTRACT = ["--iso", "120", "--error", "3", "-o", "out.ply"]


def run(*arguments, **environment):
    return served.run([ISONEST, *map(str, arguments)], cwd=FOLDER, env={**ENVIRONMENT, **environment},
                      capture_output=True, text=True, timeout=200)


_missing = run("info", "http://127.0.0.1:1/x", "--json")
if _missing.returncode == 5:
    _remedy = json.loads(_missing.stdout)["error"]["remedies"][0]
    assert (_remedy["kind"], _remedy["value"]) == ("install_package", "libcurl4-openssl-dev"), _missing.stdout
    print("skipped: this build reads no URLs, and says so")
    sys.exit(77)


class Faults(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        for arguments in (["make-volume", "bucky", "--size", "65", "--type", "uint8", "-o", "bucky.h5"],
                          ["preprocess", "bucky.h5", "-o", "s.isonest", "--chunk", "16"]):
            done = run(*arguments)
            assert done.returncode == 0, done.stderr
        (FOLDER / "page.html").write_text("<html>" + "no store " * 9000)

    def tearDown(self):
        self.assertEqual([path.name for path in FOLDER.iterdir() if "out" in path.name], [])

    def failed(self, code, words, *arguments, **environment):
        """The error, after checking that it contains no secret."""
        done = run(*arguments, "--json", **environment)
        self.assertEqual(done.returncode, code, done.stdout + done.stderr)
        error = json.loads(done.stdout)["error"]
        for word in words if isinstance(words, list) else [words]:
            self.assertIn(word, error["message"])
        self.assertNotIn(SECRET, done.stdout + done.stderr)
        return error

    def test_what_a_server_refuses(self):
        for status, code, words in ((404, 3, ["404", "check the URL"]), (403, 6, ["403", "credentials"]),
                                    (401, 6, ["401", "credentials", "--header"])):
            with self.subTest(status=status), \
                    RangeServer(FOLDER, fault_of=lambda *_, status=status: f"status:{status}") as server:
                for command in (["info"], ["check"], ["extract", *EXTRACT], ["view"],
                                ["slice", "--plane", "0,0,1,9", "-o", "out.png"],
                                ["export", "--field", "values", "-o", "out.npy"],
                                ["study", "--out", "out"]):
                    error = self.failed(code, words, command[0], server.url("s.isonest", f"me:{SECRET}@") + "?key=" + SECRET,
                                        *command[1:], "--header", f"X-Token: {SECRET}")
                    self.assertEqual(error["file"], server.url("s.isonest"))

    def test_what_fails_in_the_middle(self):
        later = {"status:404": (3, "404"), "whole": (6, "a range was requested"), "etag": (6, "changed"), "wrong_bytes": (4, "damaged")}
        for fault, (code, words) in later.items():
            with self.subTest(fault=fault), RangeServer(
                    FOLDER, fault_of=lambda number, *_, fault=fault: fault if number > 1 else None) as server:
                error = self.failed(code, words, "extract", server.url("s.isonest"), *EXTRACT)
                self.assertTrue(error["remedies"])

    def test_bytes_that_are_wrong_once_are_fetched_again(self):
        run("extract", "s.isonest", "--iso", "120", "--error", "3", "-o", "local.ply")
        truth = (FOLDER / "local.ply").read_bytes()
        with RangeServer(FOLDER) as server:
            done = run("extract", server.url("s.isonest"), "--iso", "120", "--error", "3", "-o", "mesh.ply", "--json")
            requests = json.loads(done.stdout)["remote"]["requests"]
        self.assertGreater(requests, 2)
        for wrong in range(2, requests + 1):
            with self.subTest(request=wrong), RangeServer(
                    FOLDER, fault_of=lambda number, *_, wrong=wrong: "wrong_bytes" if number == wrong else None) as server:
                cache = FOLDER / f"cache{wrong}"
                for state in ("cold", "warm", "again"):
                    done = run("extract", server.url("s.isonest"), "--iso", "120", "--error", "3", "-o", "mesh.ply", "--json",
                               "--cache", cache)
                    self.assertEqual(done.returncode, 0, done.stdout)
                    self.assertEqual((FOLDER / "mesh.ply").read_bytes(), truth, state)
                # Nothing wrong was cached. (Data found to be wrong before the rest of their request arrived are not
                # cached at all, so that the second run may have to fetch them.)
                self.assertEqual(json.loads(done.stdout)["remote"]["requests"], 1)

    def test_what_passes_is_tried_again(self):
        faults = ["status:503:0", "reset", "status:429:0", "broken", "status:500"]
        with RangeServer(FOLDER, fault_of=lambda number, *_: faults[number // 2 % 5] if number % 2 == 0 else None) as server:
            done = run("extract", server.url("s.isonest"), "--iso", "120", "--error", "3", "-o", "mesh.ply", "--json")
            self.assertEqual(done.returncode, 0, done.stdout)
            remote = json.loads(done.stdout)["remote"]
            # libcurl itself repeats a request that a kept connection did not accept.
            self.assertLessEqual(remote["requests"], server.requests)
            self.assertGreater(remote["requests"], server.requests // 2)
        run("extract", "s.isonest", "--iso", "120", "--error", "3", "-o", "local.ply")
        self.assertEqual((FOLDER / "mesh.ply").read_bytes(), (FOLDER / "local.ply").read_bytes())

    def test_a_server_without_ranges(self):
        with RangeServer(FOLDER, knows_ranges=False) as server:
            self.failed(5, "copy it to this machine", "extract", server.url("s.isonest"), *EXTRACT)

    def test_nobody_there(self):
        with RangeServer(FOLDER) as server:
            url = server.url("s.isonest", f"me:{SECRET}@")
        self.failed(6, "check the URL", "extract", url, *EXTRACT)
        self.failed(2, "has no host", "info", f"https://me:{SECRET}@/x?{SECRET}")

    def test_what_is_no_store(self):
        with RangeServer(FOLDER) as server:
            self.failed(2, "not a store", "check", server.url("page.html"))
            self.failed(5, "web page", "info", server.url("page.html"))
            self.failed(5, "web page", "extract", server.url("page.html"), *EXTRACT)

    def test_a_certificate_that_is_not_trusted(self):
        tls = certificate(FOLDER)
        with RangeServer(FOLDER, tls=tls) as server:
            self.failed(6, ["not trusted", "SSL_CERT_FILE"], "info", server.url("s.isonest"))
            self.assertEqual(run("info", server.url("s.isonest"), SSL_CERT_FILE=str(tls[0])).returncode, 0)

    def test_credentials_are_used_and_not_shown(self):
        def needs_header(number, path, headers):
            return None if headers.get("X-Token") == SECRET else "status:403"
        (FOLDER / "headers").write_text(f"X-Other: a\r\n\nX-Token: {SECRET}\n")
        (FOLDER / ".netrc").write_text(f"machine 127.0.0.1 login me password {SECRET}\n")
        with RangeServer(FOLDER, fault_of=needs_header) as server, RangeServer(FOLDER, fault_of=needs_header) as other:
            url = server.url("s.isonest")
            for header in (f"X-Token: {SECRET}", f"X-Token:{SECRET}", "@headers"):
                done = run("extract", url, *EXTRACT, "--header", header)
                self.assertEqual(done.returncode, 0, done.stderr)
                self.assertNotIn(SECRET, done.stdout + done.stderr)
            (FOLDER / "out.ply").unlink()
            # A header is only sent to the server of INPUT.
            self.failed(6, "403", "extract", url, *EXTRACT, "--vertex-values", other.url("s.isonest"), "--header",
                        f"X-Token: {SECRET}")
            done = run("extract", url, *EXTRACT, "--vertex-values", url, "--header", f"X-Token: {SECRET}")
            self.assertEqual(done.returncode, 0, done.stderr)
            (FOLDER / "out.ply").unlink()
        with RangeServer(FOLDER, password=("me", SECRET)) as server:
            for userinfo in (f"me:{SECRET}@", ""):
                done = run("info", server.url("s.isonest", userinfo), "--json")
                self.assertEqual(done.returncode, 0, done.stderr)
                self.assertEqual(json.loads(done.stdout)["store"], server.url("s.isonest"))
                self.assertNotIn(SECRET, done.stdout + done.stderr)
        (FOLDER / ".netrc").unlink()
        with RangeServer(FOLDER, keys={"KEY": (SECRET, "")}) as server:
            keys = {"AWS_ACCESS_KEY_ID": "KEY", "AWS_SECRET_ACCESS_KEY": SECRET, "AWS_REGION": "us-east-1",
                    "AWS_ENDPOINT_URL": server.url("").rstrip("/")}
            (FOLDER / "bucket").mkdir()
            (FOLDER / "bucket" / "s.isonest").hardlink_to(FOLDER / "s.isonest") if hasattr(pathlib.Path, "hardlink_to") \
                else os.link(FOLDER / "s.isonest", FOLDER / "bucket" / "s.isonest")
            done = run("info", "s3://bucket/s.isonest", "--json", **keys)
            self.assertEqual(done.returncode, 0, done.stdout)
            self.assertEqual(json.loads(done.stdout)["store"], "s3://bucket/s.isonest")
            self.failed(6, ["403", "AWS_ACCESS_KEY_ID"], "info", "s3://bucket/s.isonest",
                        **{**keys, "AWS_SECRET_ACCESS_KEY": "other"})

    def test_a_cache_that_takes_nothing_changes_no_answer_and_is_said(self):
        """On a full disk, on a file system that lets files grow no further, and in a folder of another user."""
        def counted(url, *options, code=0, **how):
            done = subprocess.run([ISONEST, "info", url, "--histogram", "--json", *options], cwd=FOLDER, env=ENVIRONMENT,
                                  capture_output=True, text=True, timeout=200, **how)
            self.assertEqual(done.returncode, code, done.stdout + done.stderr)
            return json.loads(done.stdout)

        places = FOLDER / "places"
        places.mkdir()
        self.addCleanup(shutil.rmtree, places)
        is_root = os.geteuid() == 0
        small = places / "small"
        small.mkdir()
        if is_root and subprocess.run(["mount", "-t", "tmpfs", "-o", "size=64k", "tmpfs", small],
                                      capture_output=True).returncode == 0:
            self.addCleanup(subprocess.run, ["umount", small], check=True)
            cases = [(small, {})]
        else:
            cases = []
        least = 2000
        cases.append((places / "short", {"preexec_fn": lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (least, least))}))
        foreign = places / "foreign"
        foreign.mkdir()
        if is_root:
            places.chmod(0o777)
            FOLDER.chmod(0o755)
            self.addCleanup(FOLDER.chmod, 0o700)
            reachable = subprocess.run(["test", "-x", ISONEST], user=65534, group=65534, extra_groups=[]).returncode == 0
            cases += [(foreign, {"user": 65534, "group": 65534, "extra_groups": []})] if reachable else []
        else:
            foreign.chmod(0o500)
            cases.append((foreign, {}))
        with RangeServer(FOLDER) as server:
            url = server.url("s.isonest")
            plain = counted(url)
            self.assertNotIn("warning", plain)
            for folder, how in cases:
                for turn in range(2):
                    with self.subTest(folder=folder.name, turn=turn):
                        if folder == foreign:
                            # No folder can be made there: that is an error, as for any other output.
                            error = counted(url, "--cache", folder / "c", code=6, **how)["error"]
                            self.assertIn(str(folder / "c"), error["file"])
                            continue
                        report = counted(url, "--cache", folder, **how)
                        self.assertEqual(report["histogram"], plain["histogram"])
                        self.assertIn(str(folder), report["warning"])
                        self.assertEqual([file for file in folder.rglob("new/*")], [])

    def test_wrong_options(self):
        (FOLDER / "bad").write_text(f"X-Token: a\n{SECRET}\n")
        for header, words in ((SECRET, "'Name: value'"), (f"X Token: {SECRET}", "'Name: value'"), ("@bad", "line 2"),
                              (f"X-Token: {SECRET}\nHost: b", "'Name: value'")):
            self.failed(2, words, "info", "https://127.0.0.1:1/x", "--header", header)
        self.failed(3, "none", "info", "https://127.0.0.1:1/x", "--header", "@none")
        self.failed(2, "--cache", "info", "https://127.0.0.1:1/x", "--cache", "")
        # The same for messages of the command line's parser.
        self.failed(2, "", "check", "s.isonest", f"https://me:{SECRET}@127.0.0.1/x?{SECRET}")

    def test_ctrl_c_ends_a_wait_at_once(self):
        for first_silent in (1, 2):
            with self.subTest(first_silent=first_silent), RangeServer(
                    FOLDER, fault_of=lambda number, *_, n=first_silent: "silent" if number >= n else None) as server:
                code, seconds, text = interrupted(server, first_silent, [ISONEST, "extract", server.url("s.isonest"), *EXTRACT],
                                                  cwd=FOLDER, env=ENVIRONMENT)
                self.assertLess(seconds, 3)
                self.assertEqual(code, 130, text)
                self.assertIn("interrupted", text)


try:
    unittest.main(argv=sys.argv[:1])
finally:
    shutil.rmtree(FOLDER)
