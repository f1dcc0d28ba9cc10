"""Every command gives the same for a store at a URL as for the file: the same bytes, the same report; and it reports
what was fetched, as the server counts it. With one thread and several, with an empty, full and damaged cache on disk.

usage: remote_queries_test.py ISONEST PLUGIN_FOLDER
"""
import hashlib
import json
import os
import pathlib
import re
import shutil
import sys
import tempfile
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).parents[1]))
sys.path.insert(0, str(pathlib.Path(__file__).parents[1] / "support"))
import served  # noqa: E402
from support.range_server import RangeServer  # noqa: E402

ISONEST = pathlib.Path(sys.argv[1]).resolve()
FOLDER = pathlib.Path(tempfile.mkdtemp(prefix="isonest-remote-", dir=served.MEMORY))
GOLDEN = pathlib.Path(__file__).parents[1] / "store" / "golden"
ENVIRONMENT = {name: value for name, value in os.environ.items()
               if not name.startswith(("AWS_", "SSL_CERT", "CURL_")) and not name.lower().endswith("_proxy")}
ENVIRONMENT["HOME"] = str(FOLDER)
FETCHED = {"remote_bytes", "requests", "round_trips", "cache_bytes"}
# Times, names, and counts that depend on how many chunks are held while others arrive.
VARIES = {"seconds", "peak_cache_bytes", "remote", "store", "mesh", "output", "folder", "analysis_file", "analyses",
          "scratch_bytes", "sources"}
READ = ("chunks_read", "bytes_read")  # a few more for a remote store, which were prefetched and not needed
# A command and the extension of its output; "/" is a folder.
QUERIES = {
    "bucky": [
        ("info", ""), ("info --histogram", ""), ("info --histogram -o {}", ".svg"),
        ("extract --iso 120 -o {}", ".ply"), ("extract --iso 120 --error-relative 0.05 -o {}", ".ply"),
        ("extract --iso 120 --error 3 --normals --vertex-error deviation_bar -o {}", ".vtp"),
        ("extract --iso 120 --error 3 --focus 20,30,25 --falloff 0.1 -o {}", ".ply"),
        ("extract --iso 120 --error 3 --box 5,5,5,30,40,33.5 --close -o {}", ".ply"),
        ("extract --iso 120 --cells hex -o {}", ".ply"), ("extract --iso 120 --distance 0.5voxel -o {}", ".ply"),
        ("extract --iso 120 --view 1,2,-0.5 -o {}", ".ply"),
        ("extract --iso 120 --vertices exact --error 9 -o {}", ".ply"),
        ("extract --iso 80,120,160 --error-relative 0.02 -o {}", ".vtp"),
        ("extract --iso 120 --volume-interval --close -o {}", ".stl"),
        ("extract --iso 120 --error 5 --vertex-values URL -o {}", ".ply"),
        ("extract --iso 120 --distance 0.5voxel --vertex-values p=URL --vertex-values v=URL,URL,URL -o {}", ".vtp"),
        ("slice --plane 0,0,1,20 --error 2 -o {}", ".ply"), ("slice --plane 1,2,3,100 --error 2 -o {}", ".png"),
        ("slice --plane 0,0,1,20 --contours 80,120 -o {}", ".vtp"),
        ("check", ""), ("check --quick", ""), ("check --deep", ""), ("check --source {source}", ""),
        ("export --field values --level 1 -o {}", ".nrrd"), ("export --field deviation_bar -o {}", ".npy"),
        ("export --field lp:3 -o {}", ".npy"),
        ("study --fields deviation_bar,linf_plus --steps 3 --iso 120 --out {}", "/"),
        ("smooth --steps 1 --tau 1 --lambda 20 -o {}", ".nrrd"),
    ],
    "labels": [
        ("extract --label 3 -o {}", ".ply"), ("extract --labels all --smooth -o {}", "/"),
        ("extract --labels all --smooth --interfaces -o {}", ".vtp"), ("extract --labels 1-3 -o {}", "/"),
    ],
    "map": [
        ("extract --iso 120 --error 3 -o {}", ".vtp"), ("extract --graph --error 3 -o {}", ".ply"),
    ],
}


def run(*arguments, timeout=300, **options):
    return served.run([ISONEST, *map(str, arguments)], cwd=FOLDER, env=ENVIRONMENT, capture_output=True, text=True,
                      timeout=timeout, **options)


def report(*arguments):
    done = run(*arguments, "--json")
    if done.returncode != 0:
        raise AssertionError(f"{arguments}: {done.stdout}{done.stderr}")
    return json.loads(done.stdout)


def contents(path):
    """The content of a file, or of all files below a folder."""
    files = sorted(p for p in path.rglob("*") if p.is_file()) if path.is_dir() else [path] if path.exists() else []
    return {file.relative_to(path).as_posix(): hashlib.sha256(file.read_bytes()).hexdigest() for file in files}


def removed(path):
    shutil.rmtree(path, ignore_errors=True)
    path.unlink(missing_ok=True)


def stripped(value):
    """The report without fields that may differ."""
    if isinstance(value, dict):
        return {key: stripped(part) for key, part in value.items()
                if key not in VARIES and key not in READ and "remote" not in key}
    return [stripped(part) for part in value] if isinstance(value, list) else value


def ask(query, ending, location, *options):
    """The report of a query, and what it writes."""
    command, *words = query.split()
    output = FOLDER / ("out" + ending.rstrip("/"))
    removed(output)
    words = [word.replace("{}", str(output)).replace("{source}", str(FOLDER / "bucky.h5")).replace("URL", str(location))
             for word in words]
    said = report(command, location, *words, *options)
    made = contents(output)
    removed(output)
    return said, made


_missing = run("info", "http://127.0.0.1:1/x", "--json")
if _missing.returncode == 5:
    _remedy = json.loads(_missing.stdout)["error"]["remedies"][0]
    assert (_remedy["kind"], _remedy["value"]) == ("install_package", "libcurl4-openssl-dev"), _missing.stdout
    print("skipped: this build reads no URLs, and says so")
    sys.exit(77)


class Queries(unittest.TestCase):
    maxDiff = None

    @classmethod
    def setUpClass(cls):
        report("make-volume", "bucky", "--size", "65", "--type", "uint8", "-o", "bucky.h5")
        report("preprocess", "bucky.h5", "-o", "bucky.isonest", "--chunk", "16", "--indicators", "nodes")
        cells = bytes((x // 5 + y // 5 + z // 5) % 5 for z in range(20) for y in range(20) for x in range(20))
        (FOLDER / "labels.raw").write_bytes(cells)
        report("preprocess", "labels.raw", "--dims", "20,20,20", "--type", "uint8", "--labels", "--chunk", "8", "-o",
               "labels.isonest")
        report("make-volume", "noise", "--size", "90,70", "--type", "uint8", "-o", "map.h5")
        report("preprocess", "map.h5", "-o", "map.isonest", "--chunk", "16")

    def setUp(self):
        server = RangeServer(FOLDER)
        server.__enter__()
        self.addCleanup(server.__exit__, None, None, None)
        self.server = server

    def counted(self, query, ending, url, *options):
        """The same, compared with what the server counts."""
        requests, size = self.server.requests, self.server.bytes
        said, made = ask(query, ending, url, *options)
        remote = said["remote"]
        self.assertEqual(set(remote), FETCHED, query)
        all_stores = [remote, *([said["remote_values"]] if "remote_values" in said else []),
                      *(counts for field in said.get("vertex_fields", []) for counts in field["remote"])]
        total = {name: sum(counts[name] for counts in all_stores) for name in FETCHED}
        self.assertEqual(total["requests"], self.server.requests - requests, query)
        # Prefetched data still on the way at the end are not included here.
        self.assertLessEqual(total["remote_bytes"], self.server.bytes - size, query)
        self.assertGreaterEqual(total["remote_bytes"], 0.9 * (self.server.bytes - size), query)
        self.assertLessEqual(1, remote["round_trips"], query)
        self.assertLessEqual(remote["round_trips"], remote["requests"], query)
        return said, made

    def test_answers_are_those_of_the_file(self):
        for store, queries in QUERIES.items():
            url = self.server.url(f"{store}.isonest")
            for query, ending in queries:
                with self.subTest(query=query):
                    local, bytes_of_file = ask(query, ending, f"{store}.isonest")
                    self.assertNotIn("remote", local)
                    self.assertEqual(bool(ending), bool(bytes_of_file))
                    for options in ([], ["--threads", "1"]):
                        if options and query.startswith("export"):
                            continue  # it has no --threads
                        if options and query == "info":
                            continue  # --threads requires --histogram
                        remote, bytes_of_url = self.counted(query, ending, url, *options)
                        self.assertEqual(bytes_of_url, bytes_of_file, options)
                        self.assertEqual(stripped(remote), stripped(local), options)
                        self.assertEqual(remote["remote"]["cache_bytes"], 0)
                        for count in READ:
                            self.assertLessEqual(remote.get(count, 0), 1.1 * local.get(count, 0), options)

    def test_what_is_not_made_by_levels_is_announced_too(self):
        report("preprocess", "bucky.h5", "-o", "fine.isonest", "--chunk", "8")
        edge, names = 48, 23
        (FOLDER / "cells.raw").write_bytes(bytes(1 + (x // 5 + 3 * (y // 5) + 7 * (z // 5)) % names for z in range(edge)
                                                 for y in range(edge) for x in range(edge)))
        report("preprocess", "cells.raw", "--dims", f"{edge},{edge},{edge}", "--type", "uint8", "--labels", "--chunk", "8",
               "-o", "cells.isonest")
        # The end of the file, pages of the table, ranges of cubes, chunks; and requests that depend on them.
        for store, most, queries in (
                ("fine", 3, [("info --histogram", ""), ("export --field values --level 0 -o {}", ".npy"),
                             ("export --field values --level 1 -o {}", ".npy"), ("export --field deviation_bar -o {}", ".npy")]),
                ("cells", 3, [("info --histogram", ""), ("extract --labels all -o {}", "/"),
                              ("extract --labels all --smooth -o {}", "/"), ("extract --labels 1-3 --smooth -o {}", "/"),
                              ("extract --labels all --smooth --interfaces -o {}", ".vtp")]),
                ("cells", 5, [("extract --label 3 -o {}", ".ply"), ("extract --label 3 --smooth -o {}", ".ply")])):
            for query, ending in queries:
                for options in ([], ["--threads", "1"])[:1 if query.startswith("export") else 2]:
                    with self.subTest(store=store, query=query, options=options):
                        said, _ = ask(query, ending, self.server.url(f"{store}.isonest"), *options)
                        self.assertLessEqual(said["remote"]["round_trips"], most)
                        self.assertGreater(said["remote"]["requests"], 4 * most)  # not everything is in the first read

    def test_a_cache_changes_no_answer_and_is_used(self):
        url, cache = self.server.url("bucky.isonest"), FOLDER / "cache"
        for query, ending in QUERIES["bucky"]:
            # Two processes that keep the same block at the same time may lose what one of them has added.
            if query.startswith(("check --source", "study", "smooth")) or "URL" in query:
                continue
            with self.subTest(query=query):
                removed(cache)
                local, bytes_of_file = ask(query, ending, "bucky.isonest")
                cold, warm, damaged, mended = "cold", "warm", "damaged", "mended"
                for state in (cold, warm, damaged, mended):
                    if state == damaged:
                        for file in contents(cache):
                            data = bytearray((cache / file).read_bytes())
                            for at in range(0, len(data), 1000):
                                data[at] ^= 0x41
                            (cache / file).write_bytes(data)
                    said, made = self.counted(query, ending, url, "--cache", f"{cache}:64M")
                    self.assertEqual(made, bytes_of_file, state)
                    self.assertEqual(stripped(said), stripped(local), state)
                    remote = said["remote"]
                    if state in (warm, mended):
                        # The end of the object, by which the server identifies its state.
                        self.assertEqual((remote["requests"], remote["round_trips"], remote["remote_bytes"]), (1, 1, 64), state)
                    else:
                        self.assertLess(remote["cache_bytes"], 1 + remote["remote_bytes"], state)

    def test_the_histogram_reads_ranges_that_traversals_leave_alone(self):
        # Those of level 3 take more than 256 KiB, and the prefetched ones more than their share of the memory.
        report("make-volume", "bucky", "--size", "273", "-o", "large.h5")
        report("preprocess", "large.h5", "-o", "large.isonest")
        query = "info --histogram --level 2"
        local, _ = ask(query, "", "large.isonest")
        self.assertEqual(local["histogram"]["cube_level"], 3)
        for options in ([], ["--memory", "64M", "--threads", "1"]):
            remote, _ = self.counted(query, "", self.server.url("large.isonest"), *options)
            self.assertEqual(stripped(remote), stripped(local))
            self.assertLessEqual(remote["remote"]["round_trips"], 6)

    def test_the_text_says_what_was_fetched(self):
        url = self.server.url("bucky.isonest")
        requests = self.server.requests
        done = run("extract", url, "--iso", "120", "-o", "text.ply")
        said = re.search(r"^fetched ([\d.]+ k?M?B) in (\d+) requests?, (\d+) round trips?; 0 B from the cache$",
                         done.stdout, re.M)
        self.assertTrue(said, done.stdout)
        self.assertEqual(int(said[2]), self.server.requests - requests)
        self.assertNotIn("fetched", run("extract", "bucky.isonest", "--iso", "120", "-o", "text.ply").stdout)

    def test_older_stores_are_read_whole_enough(self):
        for name in ("1.0.store", "2.0-flat.store", "2.3.store", "2.7.store"):
            with self.subTest(store=name):
                shutil.copy(GOLDEN / name, FOLDER / name)
                for query, ending in (("info", ""), ("extract --iso 20 --error 1 -o {}", ".vtp"), ("check --deep", "")):
                    local, bytes_of_file = ask(query, ending, name)
                    remote, bytes_of_url = self.counted(query, ending, self.server.url(name))
                    self.assertEqual(bytes_of_url, bytes_of_file)
                    self.assertEqual(stripped(remote), stripped(local))

    def test_an_analysis_is_kept_in_the_current_folder(self):
        url = self.server.url("bucky.isonest")
        kept = [report("extract", url, "--iso", "100", "--distance", "1voxel", "--keep-analysis", "-o", "a.ply")
                for _ in range(2)]
        found = sorted(FOLDER.glob("bucky.isonest.iso100-*.analysis"))
        self.assertEqual(len(found), 1)
        self.assertEqual([report["analysis"] for report in kept], ["made", "found"])
        listed = report("info", url)["analyses"]
        self.assertEqual([(pathlib.Path(a["file"]).name, a["state"]) for a in listed], [(found[0].name, "current")])
        found[0].unlink()

    def test_memory_has_a_share_for_what_is_fetched(self):
        url = self.server.url("bucky.isonest")
        done = run("extract", url, "--iso", "120", "-o", "m.ply", "--memory", "20M", "--json")
        self.assertEqual(done.returncode, 7, done.stdout)
        remedy = json.loads(done.stdout)["error"]["remedies"][0]
        self.assertEqual(remedy["kind"], "more_memory")
        enough = int(remedy["value"])
        report("extract", url, "--iso", "120", "-o", "m.ply", "--memory", enough)

    def test_some_volumes_are_not_read_over_a_network(self):
        (FOLDER / "pages.tif").write_bytes(b"II*\0" + bytes(5000))
        for arguments in (["preprocess", self.server.url("pages.tif", "user:secret@"), "-o", "x.isonest"],
                          ["extract", self.server.url("pages.tif", "user:secret@"), "--iso", "120", "-o", "x.ply"],
                          ["smooth", self.server.url("pages.tif", "user:secret@"), "--steps", "1", "--tau", "1", "--lambda", "2",
                           "-o", "x.nrrd"]):
            done = run(*arguments, "--json")
            self.assertEqual(done.returncode, 5, done.stdout)
            self.assertIn("download it first", done.stdout)
            self.assertNotIn("secret", done.stdout + done.stderr)
            self.assertEqual(list(FOLDER.glob("*x.*")), [])

    def test_a_name_in_front_makes_a_file_of_a_url(self):
        done = run("info", "./http://127.0.0.1/a.isonest")
        self.assertEqual(done.returncode, 3, done.stderr)


try:
    unittest.main(argv=sys.argv[:1])
finally:
    shutil.rmtree(FOLDER)
