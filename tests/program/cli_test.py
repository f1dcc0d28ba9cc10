"""The program as users see it: help, errors, exit codes, files, signals, pictures, the HDF5 plugin.

Usage: cli_test.py ISONEST PLUGIN_FOLDER
"""
import base64
import json
import os
import pathlib
import pty
import re
import shlex
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import time
import unittest
import zlib

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served  # noqa: E402
from sanitized import is_sanitized  # noqa: E402

ISONEST, PLUGINS = sys.argv[1:3]
os.environ["HDF5_PLUGIN_PATH"] = PLUGINS
COMMANDS = ["preprocess", "extract", "info", "export", "check", "make-volume", "picture"]
ERROR_KINDS = {2: "invalid_argument", 3: "not_found", 4: "corrupt", 5: "unsupported", 6: "io",
               7: "limit", 130: "cancelled"}


# The leak sanitizer of clang crashes when Mesa's threads end.
WITHOUT_LEAKS = {**os.environ, "ASAN_OPTIONS": os.environ.get("ASAN_OPTIONS", "") + ":detect_leaks=0"}
PICTURES = {"env": WITHOUT_LEAKS} if is_sanitized(ISONEST) else {}


def run(*arguments, cwd=None, **options):
    if arguments[:1] == ("picture",):
        options = {**PICTURES, **options}
    start = subprocess.run if options.keys() & {"preexec_fn", "input", "stdin"} else served.run
    return start([ISONEST, *map(os.fsdecode, map(os.fspath, map(_text, arguments)))],
                 cwd=cwd, capture_output=True, timeout=600, **options)


def _text(argument):
    return argument if isinstance(argument, (bytes, os.PathLike)) else str(argument)


def read_png(path):
    """(width, height, rows of RGB bytes) of an 8-bit RGB PNG; checks every checksum."""
    data = path.read_bytes()
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    at, pixels = 8, b""
    while at < len(data):
        size, kind = struct.unpack(">I4s", data[at:at + 8])
        body = data[at + 8:at + 8 + size]
        assert zlib.crc32(kind + body) == struct.unpack(">I", data[at + 8 + size:at + 12 + size])[0]
        if kind == b"IHDR":
            width, height, depth, color = struct.unpack(">IIBB", body[:10])
            assert (depth, color) == (8, 2)
        if kind == b"IDAT":
            pixels += body
        at += 12 + size
    raw, rows, stride = zlib.decompress(pixels), [], 3 * width
    above = bytearray(stride)
    for y in range(height):
        kind, row = raw[y * (stride + 1)], bytearray(raw[y * (stride + 1) + 1:(y + 1) * (stride + 1)])
        for i in range(stride):
            a = row[i - 3] if i >= 3 else 0
            b, c = above[i], above[i - 3] if i >= 3 else 0
            p = a + b - c
            paeth = min((abs(p - a), 0, a), (abs(p - b), 1, b), (abs(p - c), 2, c))[2]
            row[i] = (row[i] + (0, a, b, (a + b) // 2, paeth)[kind]) & 255
        rows.append(bytes(row))
        above = row
    return width, height, rows


def colours(rows):
    return {row[i:i + 3] for row in rows for i in range(0, len(row), 3)}


class Cli(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory(prefix="isonest-cli-")
        cls.here = pathlib.Path(cls.folder.name)
        for arguments in (["make-volume", "bucky", "--size", "33", "-o", "b.h5"],
                          ["preprocess", "b.h5", "-o", "b.isonest", "--chunk", "16"],
                          ["extract", "b.isonest", "--iso", "0.5", "-o", "b.ply"]):
            done = run(*arguments, cwd=cls.here)
            assert done.returncode == 0, done.stderr

    @classmethod
    def tearDownClass(cls):
        cls.folder.cleanup()

    def ok(self, *arguments):
        done = run(*arguments, cwd=self.here)
        self.assertEqual(done.returncode, 0, done.stderr)
        return done

    def json(self, *arguments):
        done = self.ok(*arguments, "--json")
        self.assertEqual(done.stderr, b"")
        return json.loads(done.stdout)

    def fails(self, code, *arguments):
        """Checks the exit code, the message on stderr and the error object on stdout; no file appears or disappears."""
        before = sorted(self.here.rglob("*"))
        done = run(*arguments, cwd=self.here)
        self.assertEqual(done.returncode, code, (arguments, done.stderr))
        self.assertRegex(done.stderr.decode(), r"(?s)\Aisonest: error: .+\n\Z")
        self.assertEqual(done.stdout, b"")
        done = run(*arguments, "--json", cwd=self.here)
        self.assertEqual(done.returncode, code)
        error = json.loads(done.stdout)["error"]
        self.assertEqual(error["kind"], ERROR_KINDS[code])
        self.assertIn(error["message"].split("\n")[0], done.stderr.decode())
        self.assertEqual(sorted(self.here.rglob("*")), before)
        return error["message"]

    # Help

    def test_help_lists_every_command_on_one_line(self):
        text = self.ok("--help").stdout.decode()
        for command in COMMANDS:
            self.assertRegex(text, rf"(?m)^  {command} +\w.*$")
        for line in text.split("\n"):
            self.assertLessEqual(len(line), 110)

    def test_an_option_is_a_line_of_a_group(self):
        for command in COMMANDS + ["slice", "study", "smooth", "check", "publish"]:
            text = self.ok(command, "--help").stdout.decode()
            groups = re.findall(r"(?m)^(\S.*):\n((?:  .*\n)+)", text[text.index("\nUsage:"):text.index("\nExamples:")])
            self.assertEqual([name for name, _ in groups][0], "Positionals")
            self.assertEqual([name for name, _ in groups][-1], "General")
            self.assertNotIn("Options", [name for name, _ in groups])
            for name, lines in groups[1:]:
                for line in lines.splitlines():
                    self.assertRegex(line, r"\A  (-\w,)?--[a-z-]+.{1,26}  \S", (command, name))

    def test_every_example_of_the_help_is_taken(self):
        seen = 0
        with tempfile.TemporaryDirectory() as empty:
            for command in COMMANDS:
                text = self.ok(command, "--help").stdout.decode()
                text = text.replace(" \\\n     ", "")  # continued lines
                examples = re.findall(r"(?m)^  (isonest .*)$", text[text.index("Examples:"):])
                self.assertGreaterEqual(len(examples), 2, command)
                self.assertTrue(text.rstrip().endswith(examples[-1]))
                for example in examples:
                    # No server listens there.
                    here = re.sub(r"(https|s3)://[\w.]+/", "http://127.0.0.1:1/", example)
                    done = run(*shlex.split(here)[1:], cwd=empty)
                    # The command is well formed; the file or server does not exist.
                    wanted = (0,) if command == "make-volume" else (3,) if here == example else (5, 6)
                    self.assertIn(done.returncode, wanted, (example, done.stderr))
                    seen += 1
        self.assertGreaterEqual(seen, 2 * len(COMMANDS))

    def test_version(self):
        self.assertRegex(self.ok("--version").stdout.decode(),
                         r"\Aisonest \d+\.\d+\.\d+ \(store format \d+\.\d+\)\nreads:\n  NRRD +\.nrrd \.nhdr\n")

    # Errors

    def test_wrong_requests_exit_with_2_and_touch_nothing(self):
        extract = ["extract", "b.isonest", "-o", "x.ply"]
        raw = ["preprocess", "b.h5", "-o", "x.isonest"]
        for arguments in (
                [], ["nothing"], ["info"], ["info", "b.isonest", "--what"], extract,
                [*extract, "--iso", "nan"], [*extract, "--iso", "inf"], [*extract, "--iso", ""],
                [*extract, "--iso", "0.5x"], [*extract, "--iso", "1", "--iso", "2"],
                [*extract, "--iso", "1", "--error", "-1"], [*extract, "--iso", "1", "--error", "nan"],
                [*extract, "--iso", "1", "--error", "1", "--error-relative", "1"],
                [*extract, "--iso", "1", "--indicator", "best"],
                [*extract, "--iso", "1", "--box", "0,0,0,1,1"],
                [*extract, "--iso", "1", "--box", "0,0,0,1,1,nan"],
                [*extract, "--iso", "1", "--box", "5,0,0,1,9,9"],
                [*extract, "--iso", "1", "--memory", "lots"],
                [*extract, "--iso", "1", "--threads", "-1"],
                [*raw, "--chunk", "20"], [*raw, "--chunk", "512"], [*raw, "--compression", "0"],
                [*raw, "--indicators", "best"], [*raw, "--indicators", "values"],
                [*raw, "--spacing", "1,0,1"], [*raw, "--spacing", "1"], [*raw, "--type", "int24"],
                [*raw, "--endian", "middle"], [*raw, "--dims", "7"],
                ["preprocess", "b.h5", "-o", "b.isonest"],
                ["make-volume", "cube", "--size", "8", "-o", "x.h5"],
                ["make-volume", "bucky", "--size", "0", "-o", "x.h5"],
                ["make-volume", "bucky", "--size", "8", "-o", "x.txt"],
                ["make-volume", "bucky", "--size", "8", "-o", "b.h5"],
                ["export", "b.isonest", "--field", "worst", "-o", "x.h5"],
                ["export", "b.isonest", "--field", "values", "-o", "x.txt"],
                ["picture", "b.ply", "-o", "x.png", "--size", "0x0"],
                ["picture", "b.ply", "-o", "x.png", "--size", "99999x9"],
                ["picture", "b.ply", "-o", "x.png", "--view", "0,0,0"],
                ["picture", "b.ply", "-o", "x.png", "--color", "0,0,256"]):
            with self.subTest(arguments=arguments):
                self.fails(2, *arguments)

    def test_a_field_of_cells_is_no_volume(self):
        store = self.here / "cells.isonest"
        (self.here / "cells.raw").write_bytes(bytes(range(243)) * 3)
        self.ok("preprocess", self.here / "cells.raw", "--dims", "9,9,9", "--type", "uint8", "--indicators", "linf_bar,hex_linf,hex_deviation",
                "-o", store)
        for field in ("hex_linf", "hex_deviation"):
            for level in ("0", "2"):
                self.assertIn("for each cell", self.fails(2, "export", store, "--field", field, "--level", level, "-o", self.here / "cells.npy"))
        self.assertFalse((self.here / "cells.npy").exists())
        self.ok("export", store, "--field", "linf_bar", "-o", self.here / "cells.npy")

    def test_indicators_are_chosen_by_name_and_in_sets(self):
        measures = ["linf", "deviation", "l1", "l2", "grad_linf", "grad_l1", "grad_l2", "grad_edge", "normal", "normal_edge",
                    "normal_turn", "normal_component"]
        nodes = [f"{name}_{how}" for name in measures for how in ("bar", "plus")]
        cells = ["hex_linf", "hex_deviation"]
        store = self.here / "sets.isonest"
        for dims, names, expected in (
                ("9x9x9", "all", nodes + cells), ("9x1x9", "all", nodes + cells), ("1x9x1", "all", nodes + cells),
                ("1x1x1", "all", nodes + cells), ("9x9x1", "nodes", nodes), ("9x9x9", "nodes,hex_deviation", nodes + cells[1:]),
                ("9x9x1", "l1_plus,all", nodes + cells), ("9x9x9", "hex_linf,linf_bar,hex_linf", ["linf_bar", "hex_linf"])):
            x, y, z = map(int, dims.split("x"))
            (self.here / "sets.raw").write_bytes((bytes(range(250)) * 3)[:x * y * z])
            with self.subTest(dims=dims, names=names):
                self.ok("preprocess", self.here / "sets.raw", "--dims", dims, "--type", "uint8", "--indicators", names,
                        "-o", store, "--force")
                self.assertEqual(json.loads(self.ok("info", store, "--json").stdout)["fields"], expected)
                self.ok("check", store, "--source", self.here / "sets.raw", "--dims", dims, "--type", "uint8")
        self.assertIn("nodes, all, linf_bar", self.fails(2, "preprocess", self.here / "sets.raw", "--dims", "9x9x9", "--type",
                                                         "uint8", "--indicators", "node", "-o", store, "--force"))

    def test_an_output_that_is_an_input_is_refused_and_the_input_stays(self):
        with tempfile.TemporaryDirectory(dir=self.here) as folder:
            here = pathlib.Path(folder)
            (here / "v.raw").write_bytes(bytes(range(27)))
            (here / "v.nhdr").write_text("NRRD0004\ntype: uint8\ndimension: 3\nsizes: 3 3 3\n"
                                         "encoding: raw\ndata file: v.raw\n\n")
            shutil.copy(self.here / "b.h5", here / "v.h5")
            shutil.copy(self.here / "b.isonest", here / "s.ply")
            shutil.copy(self.here / "b.isonest", here / "s.h5")
            shutil.copy(self.here / "b.ply", here / "m.ply")
            (here / "link.isonest").symlink_to("v.h5")
            for arguments in (
                    ["preprocess", "v.h5", "-o", "v.h5"], ["preprocess", "v.h5", "-o", "./v.h5"],
                    ["preprocess", "v.h5", "-o", "link.isonest"],
                    ["preprocess", "link.isonest", "-o", "v.h5", "--resume"],
                    ["preprocess", "v.nhdr", "-o", "v.raw"], ["preprocess", "v.nhdr", "-o", "v.nhdr"],
                    ["preprocess", "v.nhdr", "--spacing", "1,1,2", "--missing", "3", "-o", "v.raw"],
                    ["preprocess", "v.raw", "--dims", "3,3,3", "--type", "uint8", "-o", "v.raw"],
                    ["extract", "s.ply", "--iso", "0.5", "-o", "s.ply"],
                    ["extract", "b.isonest", "--iso", "0.5", "--vertex-values", "s.ply", "-o", "s.ply"],
                    ["export", "s.h5", "--field", "values", "-o", "s.h5"],
                    ["picture", "m.ply", "-o", "m.ply"]):
                arguments = [here / a if (here / a).exists() else a for a in arguments]
                if arguments[0] in ("preprocess", "export"):
                    arguments.append("--force")
                before = {path: path.read_bytes() for path in here.iterdir()}
                with self.subTest(arguments=arguments):
                    self.fails(2, *arguments)
                    self.assertEqual(before, {path: path.read_bytes() for path in here.iterdir()})

    def test_what_is_missing_exits_with_3(self):
        for arguments in (["info", "none"], ["check", "none"], ["picture", "none", "-o", "x.png"],
                          ["preprocess", "none", "-o", "x.isonest"],
                          ["preprocess", "b.h5", "--dataset", "/none", "-o", "x.isonest"],
                          ["extract", "b.isonest", "--iso", "1", "-o", "none/x.ply"],
                          ["picture", "b.ply", "-o", "none/x.png"],
                          ["export", "b.isonest", "--field", "values", "--level", "60", "-o",
                           "x.h5"]):
            with self.subTest(arguments=arguments):
                self.fails(3, *arguments)

    def test_an_error_is_an_object_with_place_and_remedies(self):
        done = run("preprocess", "b.h5", "-o", "b.isonest", "--json", cwd=self.here)
        error = json.loads(done.stdout)["error"]
        self.assertEqual(list(error), ["kind", "message", "file", "inside", "remedies"])
        self.assertEqual((error["file"], error["inside"]), ("b.isonest", ""))
        self.assertEqual(error["remedies"], [
            {"kind": "replace_existing", "value": "", "text": "give --force to replace it"},
            {"kind": "other_name", "value": "", "text": "give another name"}])
        self.assertEqual(done.stderr.decode(), f"isonest: error: {error['message']}\n")
        done = run("extract", "b.isonest", "--iso", "0.5", "--memory", "1M", "-o", "x.ply", "--json",
                   cwd=self.here)
        memory = json.loads(done.stdout)["error"]["remedies"][0]
        self.assertEqual(memory["kind"], "more_memory")
        self.assertEqual(memory["text"], f"give at least --memory {int(memory['value']) >> 20}M")
        done = run("info", "none.isonest", "--json", cwd=self.here)
        self.assertEqual(json.loads(done.stdout)["error"]["remedies"], [])

    def test_a_message_tells_the_way_out(self):
        self.assertIn("isonest extract --help", self.fails(2, "extract", "b.isonest", "--iso", "1"))
        self.assertIn("--force", self.fails(2, "preprocess", "b.h5", "-o", "b.isonest"))
        self.assertIn("deviation_bar", self.fails(2, "export", "b.isonest", "--field", "x", "-o",
                                                  "x.h5"))

    def test_too_little_memory_exits_with_7_and_says_how_much(self):
        self.assertRegex(self.fails(7, "extract", "b.isonest", "--iso", "0.5", "--memory", "1M",
                                    "-o", "x.ply"), r"--memory \d+M")

    def test_damage_exits_with_4(self):
        self.fails(4, "check", "b.ply")
        self.assertIn("mesh", self.fails(5, "info", "b.ply"))
        self.assertIn("not a mesh", self.fails(2, "picture", "b.h5", "-o", "x.png"))
        with tempfile.TemporaryDirectory() as other:
            volume, other_file = pathlib.Path(other) / "volume.obj", pathlib.Path(other) / "text.obj"
            volume.write_bytes(b"NRRD0004\ntype: uint8\ndimension: 3\nsizes: 2 2 2\nencoding: raw\n\n" + bytes(8))
            self.assertIn("not a mesh", self.fails(2, "picture", volume, "-o", "x.png"))
            other_file.write_text("a text\nof two lines\n")
            self.fails(4, "picture", other_file, "-o", "x.png")
            cut = pathlib.Path(other) / "cut.ply"
            cut.write_bytes((self.here / "b.ply").read_bytes()[:-1])
            self.assertIn("cut off", self.fails(4, "picture", cut, "-o", "x.png"))

    def test_check_finds_a_flipped_byte(self):
        report = self.json("check", "b.isonest", "--source", "b.h5")
        self.assertTrue(report["ok"])
        self.assertEqual(report["findings"], [])
        store = bytearray((self.here / "b.isonest").read_bytes())
        frame = store.index(b"\x28\xb5\x2f\xfd")  # zstd's magic: the first chunk
        store[frame + 40] ^= 1
        with tempfile.TemporaryDirectory() as other:
            path = pathlib.Path(other) / "flipped.isonest"
            path.write_bytes(store)
            done = run("check", path, "--json")
        self.assertEqual(done.returncode, 4)
        report = json.loads(done.stdout)
        self.assertFalse(report["ok"])
        self.assertGreater(report["failures"], 0)
        self.assertIn("checksum", {finding["test"] for finding in report["findings"]})

    def test_check_refuses_another_source(self):
        with tempfile.TemporaryDirectory() as other:
            path = pathlib.Path(other) / "s.h5"
            self.ok("make-volume", "sphere", "--size", "32", "-o", path)
            self.assertIn("32 x 32 x 32", self.fails(2, "check", "b.isonest", "--source", path))

    def test_a_full_disk_under_standard_output_exits_with_6(self):
        with open("/dev/full", "wb") as full:
            done = subprocess.run([ISONEST, "info", "b.isonest"], cwd=self.here, stdout=full,
                                  stderr=subprocess.PIPE, timeout=60)
        self.assertEqual(done.returncode, 6)
        self.assertIn(b"standard output", done.stderr)

    def test_a_file_size_limit_is_an_error_and_leaves_nothing(self):
        def limit():
            import resource
            resource.setrlimit(resource.RLIMIT_FSIZE, (20000, 20000))
        before = sorted(self.here.iterdir())
        for arguments in (["make-volume", "bucky", "--size", "33", "-o", "x.raw"],
                          ["preprocess", "b.h5", "-o", "x.isonest"],
                          ["extract", "b.isonest", "--iso", "0.5", "-o", "x.ply"],
                          ["export", "b.isonest", "--field", "values", "-o", "x.nrrd"],
                          ["picture", "b.ply", "-o", "x.png"]):
            with self.subTest(arguments=arguments):
                done = run(*arguments, cwd=self.here, preexec_fn=limit)
                self.assertEqual(done.returncode, 6, done.stderr)
                self.assertEqual(sorted(self.here.iterdir()), before)

    # Output

    def test_reports_have_what_scripts_need(self):
        info = self.json("info", "b.isonest")
        self.assertEqual(info["nodes"], [33, 33, 33])
        self.assertEqual(info["type"], "float32")
        self.assertEqual(info["cube_range_bytes"], (4**3 + 2**3 + 1) * 2 * 4)
        self.assertEqual(sum(a["chunks"] for a in info["arrays"] if not a["alias"]), info["chunks"])
        report = self.json("extract", "b.isonest", "--iso", "0.5", "--error", "0.01", "--effort", "none", "-o", "e.ply")
        for key in ("vertices", "triangles", "error_bound", "visited_tetrahedra",
                    "leaf_tetrahedra", "chunks_read", "chunks_total", "bytes_read",
                    "peak_cache_bytes", "seconds"):
            self.assertIn(key, report)
        self.assertLessEqual(report["error_bound"], 0.01)
        self.assertGreater(report["triangles"], 0)
        header = (self.here / "e.ply").read_bytes()[:400].decode("latin-1")
        self.assertIn(f"element face {report['triangles']}\n", header)
        cells = self.json("extract", "b.isonest", "--iso", "0.5", "--cells", "hex", "-o", "e.ply")
        self.assertGreaterEqual(cells["visited_hexahedra"], cells["leaf_hexahedra"])
        self.assertGreater(cells["leaf_hexahedra"], 0)
        self.assertNotIn("visited_tetrahedra", cells)
        (self.here / "e.ply").unlink()

    def test_reports_say_which_triangles_there_are(self):
        ask = ["extract", "b.isonest", "--iso", "0.5", "-o", "a.ply"]
        self.assertNotIn("smallest_angle", self.json(*ask))
        report = self.json(*ask, "--quality")
        angles = [report["smallest_angle"][key] for key in ("min", "q0.1%", "q1%", "q5%", "median")]
        self.assertEqual(angles, sorted(angles))
        self.assertGreater(angles[0], 0)
        self.assertLessEqual(angles[-1], 60)
        self.assertTrue(0 <= report["smallest_angle"]["share_below_5"] < 1)
        self.assertRegex(self.ok(*ask, "--quality").stdout, rb"[0-9.]+ degrees")
        self.assertEqual((report["mended_triangles"], report["zero_area_triangles"]), (0, 0))
        self.ok("preprocess", "b.h5", "--origin", "1e6,1e6,1e6", "--spacing", "1,1,1", "-o", "far.isonest")
        ask[1] = "far.isonest"
        report = json.loads(self.ok(*ask, "--json").stdout)  # in addition to a warning
        self.assertGreater(report["mended_triangles"], 0)
        self.assertEqual(report["zero_area_triangles"], 0)
        self.assertIn(f"{report['mended_triangles']} triangles that degenerate".encode(), self.ok(*ask).stdout)
        for name in ("a.ply", "far.isonest"):
            (self.here / name).unlink()

    def test_json_is_json_whatever_the_file_is_called(self):
        done = run("info", b"\xff\xfe.isonest", "--json", cwd=self.here)
        self.assertEqual(done.returncode, 3)
        self.assertIn("error", json.loads(done.stdout))

    def test_quiet_says_nothing(self):
        self.assertEqual(self.ok("picture", "b.ply", "-o", "q.png", "--quiet").stdout, b"")
        (self.here / "q.png").unlink()

    def test_units_reach_the_library(self):
        a = self.json("extract", "b.isonest", "--iso=0.5", "--memory", "64M", "-o", "u.ply")
        b = self.json("extract", "b.isonest", "--iso", "5e-1", "--memory", "67108864", "-o", "u.ply")
        self.assertEqual(a["triangles"], b["triangles"])
        below = self.json("extract", "b.isonest", "--iso", "-5", "-o", "u.ply")
        self.assertEqual((below["iso"], below["triangles"]), (-5, 0))
        (self.here / "u.ply").unlink()

    def test_progress_is_drawn_on_a_terminal_only(self):
        def stderr_of(*extra):
            master, slave = pty.openpty()
            try:
                with tempfile.TemporaryDirectory() as other:
                    process = subprocess.Popen(
                        [ISONEST, "make-volume", "noise", "--size", "65", "-o",
                         os.path.join(other, "n.h5"), *extra],
                        stderr=slave, stdout=subprocess.DEVNULL, env={**os.environ, "TERM": "xterm"})
                    os.close(slave)
                    text = b""
                    while True:
                        try:
                            part = os.read(master, 65536)
                        except OSError:  # the other end is closed
                            break
                        if not part:
                            break
                        text += part
                    self.assertEqual(process.wait(), 0)
                return text
            finally:
                os.close(master)
        drawn = stderr_of()
        self.assertIn(b" %", drawn)
        self.assertIn(b"noise", drawn)
        self.assertTrue(drawn.endswith(b"\r\x1b[K"), drawn[-40:])
        self.assertNotIn(b"\n", drawn)
        self.assertEqual(stderr_of("--quiet"), b"")
        self.assertEqual(stderr_of("--json"), b"")
        self.assertEqual(self.ok("make-volume", "noise", "--size", "9", "-o", "n.h5").stderr, b"")
        (self.here / "n.h5").unlink()

    # Signals

    def test_an_interrupt_leaves_nothing_behind(self):
        for number in (signal.SIGINT, signal.SIGTERM):
            with self.subTest(signal=number), tempfile.TemporaryDirectory() as other:
                folder = pathlib.Path(other)
                self.ok("make-volume", "noise", "--size", "129", "--type", "uint16", "-o",
                        folder / "n.raw")
                process = subprocess.Popen(
                    [ISONEST, "preprocess", "n.raw", "--dims", "129,129,129", "--type", "uint16",
                     "--compression", "19", "--chunk", "16", "--threads", "1", "-o", "n.isonest",
                     "--json"], cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
                while process.poll() is None and not list(folder.glob(".n.isonest.*")):
                    time.sleep(0.01)
                self.assertIsNone(process.poll(), "it was over before it could be interrupted")
                process.send_signal(number)
                out, err = process.communicate(timeout=120)
                self.assertEqual(process.returncode, 130, err)
                self.assertEqual(json.loads(out)["error"]["kind"], "cancelled")
                self.assertTrue(err.startswith(b"isonest: error: "), err)
                self.assertEqual([p.name for p in folder.iterdir()], ["n.raw"])

    def interrupted(self, folder, *arguments):
        """A run of preprocess on noise that is stopped after its first row of chunks; returns its command."""
        self.ok("make-volume", "noise", "--size", "129", "--type", "uint16", "-o", folder / "n.raw")
        command = [ISONEST, "preprocess", *arguments, "--compression", "19", "--chunk", "16",
                   "--threads", "1", "-o", "n.isonest", "--resume", "--json"]
        process = subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE,
                                   stderr=subprocess.PIPE)

        def a_row_is_done():
            return any(p.stat().st_size > 4096 for p in folder.glob(".n.isonest.*.journal"))
        while process.poll() is None and not a_row_is_done():
            time.sleep(0.01)
        self.assertIsNone(process.poll(), "it was over before it could be interrupted")
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=120)
        self.assertEqual(process.returncode, 130, err)
        self.assertIn("run again with --resume", json.loads(out)["error"]["message"])
        return command

    def test_an_interrupted_run_with_resume_says_how_to_go_on(self):
        with tempfile.TemporaryDirectory(prefix="isonest-test-") as name:
            folder = pathlib.Path(name)
            command = self.interrupted(folder, "n.raw", "--dims", "129,129,129", "--type", "uint16")
            self.assertEqual(len(list(folder.iterdir())), 4)
            for option, difference in ((["--exact"], (b"'exact false'", b"'exact true'")),
                                       (["--endian", "big"], (b"'big endian true'",))):
                other = served.run([*command, *option], cwd=folder, capture_output=True)
                self.assertEqual(other.returncode, 2)
                for part in difference:
                    self.assertIn(part, other.stderr)
            done = served.run(command, cwd=folder, capture_output=True, check=True)
            self.assertGreater(json.loads(done.stdout)["resumed_chunks"], 0)
            self.assertEqual(sorted(p.name for p in folder.iterdir()), ["n.isonest", "n.raw"])

    def test_a_run_is_not_resumed_when_the_data_behind_its_header_have_changed(self):
        with tempfile.TemporaryDirectory(prefix="isonest-test-") as name:
            folder = pathlib.Path(name)
            (folder / "n.nhdr").write_text("NRRD0004\ntype: uint16\ndimension: 3\n"
                                           "sizes: 129 129 129\nencoding: raw\nendian: little\n"
                                           "data file: n.raw\n\n")
            command = self.interrupted(folder, "n.nhdr")
            os.utime(folder / "n.raw", (1, 1))
            other = served.run(command, cwd=folder, capture_output=True)
            self.assertEqual(other.returncode, 2)
            self.assertIn(b"'input bytes 4293378, time ", other.stderr)

    def test_an_input_truncated_while_it_is_read_is_an_error(self):
        with tempfile.TemporaryDirectory(prefix="isonest-test-") as name:
            folder = pathlib.Path(name)
            path = folder / "n.raw"
            with open(path, "wb") as file:
                file.truncate(1 << 29)
            process = subprocess.Popen(
                [ISONEST, "preprocess", path, "--dims", "1024,512,1024", "--type", "uint8", "-o",
                 folder / "n.isonest"], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
            deadline = time.monotonic() + 120
            while not any(p.name.startswith(".") for p in folder.iterdir()):
                self.assertLess(time.monotonic(), deadline)
                time.sleep(0.01)
            os.truncate(path, 0)
            _, err = process.communicate(timeout=300)
            self.assertEqual(process.returncode, 6, err)
            self.assertIn(b"truncated", err)
            self.assertFalse((folder / "n.isonest").exists())

    # Pictures

    def test_a_picture_shows_the_mesh_in_its_middle(self):
        self.ok("picture", "b.ply", "-o", "p.png", "--size", "120x90")
        width, height, rows = read_png(self.here / "p.png")
        self.assertEqual((width, height), (120, 90))
        background = rows[0][:3]
        self.assertGreater(min(background), 200)
        ink = [(x, y) for y, row in enumerate(rows) for x in range(width)
               if row[3 * x:3 * x + 3] != background]
        self.assertGreater(len(colours(rows)), 50)  # it is shaded
        for axis, size in ((0, width), (1, height)):
            lo, hi = (f(p[axis] for p in ink) for f in (min, max))
            self.assertAlmostEqual(lo + hi, size - 1, delta=0.08 * size)
            self.assertGreater(lo, 0)
            self.assertLess(hi, size - 1)
        self.assertGreater(max(p[1] for p in ink) - min(p[1] for p in ink), 0.8 * height)
        first = (self.here / "p.png").read_bytes()
        self.ok("picture", "b.ply", "-o", "p.png", "--size", "120x90")
        self.assertEqual((self.here / "p.png").read_bytes(), first)
        for option in ("--wireframe", "--flat", "--view=0,0,-1", "--color=250,10,10"):
            self.ok("picture", "b.ply", "-o", "p.png", "--size", "120x90", option)
            self.assertNotEqual((self.here / "p.png").read_bytes(), first, option)
        (self.here / "p.png").unlink()

    def test_every_mesh_format_is_drawn_alike(self):
        options = ["--size", "90x70", "--plain"]
        self.ok("picture", "b.ply", "-o", "p.png", *options)
        smooth = (self.here / "p.png").read_bytes()
        self.ok("picture", "b.ply", "-o", "p.png", *options, "--flat")
        flat = (self.here / "p.png").read_bytes()
        for end in ("obj", "glb", "3mf", "vtp", "vtkhdf", "ngmesh", "stl"):
            mesh = self.here / f"m.{end}"
            self.ok("extract", "b.isonest", "--iso", "0.5", "-o", mesh)
            before = set(self.here.iterdir())
            self.ok("picture", mesh, "-o", "p.png", *options)
            self.assertEqual((self.here / "p.png").read_bytes(), flat if end == "stl" else smooth, end)
            self.assertEqual(set(self.here.iterdir()), before)
            whole = mesh.read_bytes()
            for cut in (0, 3, 20, 200, len(whole) // 2, len(whole) - 100):
                mesh.write_bytes(whole[:cut])
                done = run("picture", mesh, "-o", "p.png", *options, cwd=self.here)
                # A text format that ends at the end of a line is complete for its reader; so are numbers.
                fine = (0, 4, 5) if end in ("obj", "ngmesh") else (2, 4, 5)
                self.assertIn(done.returncode, fine, (end, cut, done.stderr))
            mesh.unlink()
        # As written by versions before 0.5.
        self.ok("extract", "b.isonest", "--iso", "0.5", "-o", "m.vtp")
        text, appended = (self.here / "m.vtp").read_text(), b""
        for array in re.findall(r'format="binary">\n.*?</DataArray>', text, re.DOTALL):
            text = text.replace(array, f'format="appended" offset="{len(appended)}"/>')
            appended += base64.b64decode(array.split("\n")[1])
        head, tail = text.split("</VTKFile>")
        (self.here / "m.vtp").write_bytes(f'{head}<AppendedData encoding="raw">\n_'.encode() + appended +
                                          f"\n</AppendedData>\n</VTKFile>{tail}".encode())
        self.ok("picture", "m.vtp", "-o", "p.png", *options)
        self.assertEqual((self.here / "p.png").read_bytes(), smooth)
        (self.here / "m.vtp").unlink()
        for end in ("ply", "glb", "vtp", "vtkhdf"):
            self.ok("extract", "b.isonest", "--iso", "0.5", "--error", "0.05", "-o", f"v.{end}", "--vertex-values", "b.isonest")
            shown = self.json("picture", f"v.{end}", "-o", "p.png", *options)
            self.assertEqual(shown.get("range"), self.json("picture", "v.ply", "-o", "p.png", *options).get("range"), end)
        for file in self.here.glob("v.*"):
            file.unlink()
        (self.here / "p.png").unlink()

    def test_hostile_meshes_take_little_memory(self):
        mesh = self.here / "h.glb"
        for text, words in ((b"[" * 3000000, "64 levels"), (b'{"a":[' + b"0," * 2000000 + b"0]}", "1000000 values")):
            mesh.write_bytes(b"glTF" + struct.pack("<III", 2, len(text) + 20, len(text)) + b"JSON" + text)
            self.assertIn(words, self.fails(4, "picture", "h.glb", "-o", "p.png"))
        mesh.unlink()
        mesh = self.here / "h.obj"
        for face in (b"c" * (8 << 20), b"f " + b"1 " * (4 << 20)):
            mesh.write_bytes(b"v 0 0 0\n" * 3 + face + b"\n")
            self.assertIn("line 4 has more than 1048576", self.fails(4, "picture", "h.obj", "-o", "p.png"))
        mesh.unlink()

    def test_a_mesh_that_is_no_file_is_not_waited_for(self):
        for name in ("p.ply", "p.stl", "p.obj", "p.glb", "p.3mf", "p.vtp"):
            os.mkfifo(self.here / name)
            self.assertIn(f"{name}: not a regular file", self.fails(2, "picture", name, "-o", "p.png"))

    def test_help_is_80_columns_wide(self):
        for command in ("", *COMMANDS, "slice", "study", "smooth"):
            text = self.ok(*([command] if command else []), "--help").stdout.decode()
            self.assertEqual([line for line in text.splitlines() if len(line) > 80], [], command)

    def test_mistyped_names_are_corrected(self):
        for arguments, meant in ((["extract", "b.isonest", "--eror", "3"], "--error?"), (["extrct"], "extract?"),
                                 (["picture", "b.ply", "--colour=1,2,3", "-o", "x.png"], "--color?")):
            self.assertIn("did you mean " + meant, self.fails(2, *arguments))
        self.assertNotIn("did you mean", self.fails(2, "frobnicate"))

    def test_larger_pictures_have_a_scale_bar_and_directions(self):
        pictures = []
        for options in ((), ("--plain",)):
            self.ok("picture", "b.ply", "-o", "p.png", "--size", "260x250", *options)
            pictures.append(read_png(self.here / "p.png")[2])
        noted, plain = pictures
        background = plain[0][:3]
        corner = [[row[3 * x:3 * x + 3] for row in picture[200:] for x in range(50)] for picture in pictures]
        self.assertEqual(set(corner[1]), {background})
        self.assertGreater(len([pixel for pixel in corner[0] if pixel != background]), 40)
        (self.here / "p.png").unlink()

    def test_views_by_name_and_by_angles_are_directions(self):
        def picture(view):
            self.ok("picture", "b.ply", "-o", "p.png", "--size", "60x50", "--view=" + view)
            return (self.here / "p.png").read_bytes()

        for name, angles, direction in (("front", "0,0", "0,-1,0"), ("right", "90,0", "1,0,0"), ("back", "180,0", "0,1,0"),
                                        ("left", "-90,0", "-1,0,0"), ("top", "0,90", "0,0,1"),
                                        ("bottom", "0,-90", "0,0,-1")):
            self.assertEqual(picture(name), picture(direction), name)
            if name in ("front", "top", "bottom"):  # cosines of right angles are not exactly 0
                self.assertEqual(picture(name), picture(angles), name)
        self.assertNotEqual(picture("front"), picture("iso"))
        self.fails(2, "picture", "b.ply", "-o", "p.png", "--view", "sideways")
        (self.here / "p.png").unlink()

    def test_a_turntable_begins_with_the_view_at_one_scale(self):
        self.ok("picture", "b.ply", "-o", "t.png", "--size", "60x50", "--turntable", "5", "--view", "10,20")
        names = [self.here / f"t_{i:03}.png" for i in range(5)]
        self.assertFalse((self.here / "t.png").exists())
        self.assertEqual(len({name.read_bytes() for name in names}), 5)
        for name in names:
            self.assertEqual(read_png(name)[:2], (60, 50))
            name.unlink()

    def test_values_and_colours_of_vertices_are_seen(self):
        def ply(name, properties, dtype, columns):
            rows = [(0, 0, 0), (1, 0, 0), (1, 0, 1), (0, 0, 1)]
            body = b"".join(struct.pack("<fff" + dtype, *row, *column) for row, column in zip(rows, columns))
            faces = b"".join(struct.pack("<Biii", 3, *f) for f in ((0, 1, 2), (0, 2, 3)))
            header = ("ply\nformat binary_little_endian 1.0\nelement vertex 4\nproperty float x\nproperty float y\n"
                      f"property float z\n{properties}element face 2\nproperty list uchar int vertex_indices\nend_header\n")
            (self.here / name).write_bytes(header.encode() + body + faces)

        def corners(name, *options):
            self.ok("picture", name, "-o", "p.png", "--size", "60x60", "--view", "front", "--plain", *options)
            _, _, rows = read_png(self.here / "p.png")
            return [tuple(rows[y][3 * x:3 * x + 3]) for x, y in ((8, 51), (51, 51), (51, 8), (8, 8))]

        ply("rgb.ply", "property uchar red\nproperty uchar green\nproperty uchar blue\n", "BBB",
            [(255, 0, 0), (0, 255, 0), (0, 0, 255), (255, 255, 0)])
        red, green, blue, yellow = corners("rgb.ply")
        self.assertTrue(red[0] > 2 * max(red[1:]) and green[1] > 2 * max(green[0], green[2]) and blue[2] > 2 * max(blue[:2])
                        and min(yellow[:2]) > 2 * yellow[2], (red, green, blue, yellow))
        plain = corners("rgb.ply", "--color-by", "none")
        self.assertEqual(len(set(plain)), 1)
        ply("value.ply", "property float value\n", "f", [(0,), (5,), (5,), (0,)])
        low, high, _, _ = corners("value.ply", "--colors", "gray")
        self.assertLess(max(low), 0.5 * min(high))
        low, high, _, _ = corners("value.ply", "--colors", "gray_r")
        self.assertGreater(min(low), 2 * max(high))
        self.assertEqual(self.json("picture", "value.ply", "-o", "p.png")["range"], [0, 5])
        self.assertEqual(self.json("picture", "value.ply", "-o", "p.png", "--range=-1,9")["range"], [-1, 9])
        self.fails(2, "picture", "value.ply", "-o", "p.png", "--colors", "nice")
        self.fails(3, "picture", "value.ply", "-o", "p.png", "--color-by", "error")
        for name in ("rgb.ply", "value.ply", "p.png"):
            (self.here / name).unlink()

    def test_a_mesh_far_from_0_says_how_much_its_coordinates_are_rounded(self):
        self.assertLess(self.json("extract", "b.isonest", "--iso", "0.5", "-o", "b.ply")
                        ["coordinate_rounding"], 1e-5)
        self.ok("preprocess", "b.h5", "-o", "far.isonest", "--spacing", "0.25,1,1", "--origin",
                "5e6,0,0")
        done = self.ok("extract", "far.isonest", "--iso", "0.5", "-o", "far.ply", "--json")
        self.assertEqual(json.loads(done.stdout)["coordinate_rounding"], 1)  # half of 0.5, divided by 0.25
        self.assertIn(b"isonest: warning: far.ply: its coordinates", done.stderr)
        (self.here / "far.isonest").unlink()
        (self.here / "far.ply").unlink()

    def test_shading_falls_back_to_flat_where_memory_is_short(self):
        self.assertEqual(self.json("picture", "b.ply", "-o", "p.png")["shading"], "smooth")
        # Enough for OSMesa and the smallest strip of 10 pixels, but not for normals (tools/drawing/picture.cpp).
        least = (94 << 20) + 10 * 91 * (32 + 2)
        flat = self.json("picture", "b.ply", "-o", "p.png", "--size", "10x10", "--memory", least)
        self.assertEqual(flat["shading"], "flat")
        (self.here / "p.png").unlink()

    def test_an_empty_mesh_gives_the_background_and_a_warning(self):
        self.ok("extract", "b.isonest", "--iso", "99", "-o", "empty.ply")
        done = self.ok("picture", "empty.ply", "-o", "p.png", "--size", "7x5")
        self.assertIn(b"isonest: warning: ", done.stderr)
        width, height, rows = read_png(self.here / "p.png")
        self.assertEqual((width, height, len(colours(rows))), (7, 5, 1))
        (self.here / "p.png").unlink()
        (self.here / "empty.ply").unlink()

    # What reports say

    def test_an_empty_result_says_why(self):
        import h5py
        import numpy
        u = numpy.add.outer(numpy.add.outer(numpy.arange(9.0), numpy.arange(9.0)), numpy.arange(9.0))
        u[4, 4, 4] += 1
        with h5py.File(self.here / "why.h5", "w") as file:
            file["u"] = u
        self.ok("preprocess", "why.h5", "-o", "why.s", "--chunk", 8)
        far = ("--box", "20,20,20,30,30,30")
        inside = ("--box", "1,1,1,3,3,3")
        plane = ("slice", "why.s", "--plane")
        for arguments, words in (
                (("extract", "why.s", "--iso", 24.5), "every value is below 24.5"),
                (("extract", "why.s", "--iso", 0), "no value is below 0"),
                (("extract", "why.s", "--iso", 12.5, *far), "the box lies outside of the volume"),
                (("extract", "why.s", "--iso", 12.5, *inside), "empty inside the box"),
                ((*plane, "0,0,1,9"), "the plane misses the volume"),
                ((*plane, "0,0,1,4", *far), "the box lies outside of the volume"),
                ((*plane, "0,0,1,4", *inside), "does not pass through the box"),
                ((*plane, "0,0,1,4", "--contours", 99), "do not occur in the plane")):
            done = self.ok(*arguments, "-o", "why.vtp")
            self.assertIn(words, done.stdout.decode(), arguments)
        # A peak that is flattened: only the tolerance hides it.
        u[:] = 0
        u[3, 3, 3] = 1
        with h5py.File(self.here / "peak.h5", "w") as file:
            file["u"] = u
        self.ok("preprocess", "peak.h5", "-o", "peak.s", "--chunk", 8)
        done = self.ok("extract", "peak.s", "--iso", 0.5, "--error", 2, "--effort", "none", "-o", "why.vtp")
        self.assertIn("a smaller one may show some", done.stdout.decode())
        self.fails(2, *plane, "0,0,1,4", "--range", "200,100", "-o", "why.png")
        for path in self.here.glob("why.*"):
            path.unlink()
        for path in self.here.glob("peak.*"):
            path.unlink()

    def test_components_are_dropped_and_the_report_says_which(self):
        import h5py
        import numpy
        u = numpy.zeros((17, 17, 17))
        u[3:9, 3:9, 3:9] = 1
        u[12, 12, 4] = u[12, 4, 12] = u[4, 12, 12] = 1
        with h5py.File(self.here / "specks.h5", "w") as file:
            file["u"] = u
        self.ok("preprocess", "specks.h5", "-o", "specks.s", "--chunk", 8)
        extract = ("extract", "specks.s", "--iso", 0.5, "-o", "specks.ply")
        all_of_it = self.json(*extract)
        self.assertNotIn("components", all_of_it)
        for options in (("--components", "largest"), ("--components", 1), ("--min-component", 100),
                        ("--min-volume", "10.0"), ("--min-volume", 10)):
            report = self.json(*extract, *options)
            self.assertEqual((report["components"], report["dropped_components"]), (4, 3))
            self.assertEqual(report["triangles"] + report["dropped_triangles"], all_of_it["triangles"])
            self.assertEqual(3 * report["largest_dropped"], report["dropped_triangles"])
            self.assertRegex(self.ok(*extract, *options).stdout.decode(),
                             r"(?m)^dropped 3 of 4 components with \d+ triangles, the largest of \d+$")
        self.assertIn("4 components, none dropped", self.ok(*extract, "--components", "all").stdout.decode())
        self.assertIn("the distance is to the surface without them",
                      self.ok(*extract, "--components", 2, "--distance", "0.2voxel").stdout.decode())
        self.assertIn("all components of the surface were dropped, 4 with",
                      self.ok(*extract, "--min-component", 10000).stdout.decode())
        for path in self.here.glob("specks.p*"):
            path.unlink()
        for options, words in ((("--components", 0), "how many of the largest"),
                               (("--components", -3), "how many of the largest"),
                               (("--components", "most"), "how many of the largest"),
                               (("--min-component", -1), "give an integer from 0"),
                               (("--min-component", 2.5), "give an integer from 0"),
                               (("--min-volume", -1), "give a number >= 0"),
                               (("--min-volume", "much"), "give a finite number"),
                               (("--min-volume", "3cm3"), "give a finite number")):
            self.assertIn(words, self.fails(2, *extract, *options))
        for path in self.here.glob("specks.*"):
            path.unlink()

    def test_distances_and_numbers_of_triangles_are_read_and_reported(self):
        import h5py
        import numpy
        z, y, x = numpy.mgrid[:17, :17, :17]
        with h5py.File(self.here / "wave.h5", "w") as file:
            file["u"] = z + numpy.sin(x / 3) + 0.1 * numpy.sin(x + 2 * y)
        self.ok("preprocess", "wave.h5", "-o", "wave.s", "--chunk", 8)
        extract = ("extract", "wave.s", "--iso", 8.2, "-o", "wave.ply")
        full = self.json(*extract)["triangles"]
        report = self.json(*extract, "--triangles", full // 2, "--by", "error")
        self.assertTrue(report["within_budget"])
        self.assertLessEqual(report["triangles"], full // 2)
        self.assertGreater(report["error_bound"], 0)
        self.assertIn(f"asked for {full // 2} triangles",
                      self.ok(*extract, "--triangles", full // 2, "--by", "error").stdout.decode())
        same = [self.json(*extract, "--distance", d)["triangles"] for d in ("0.2", "0.20", "0.2voxel")]
        self.assertEqual(len(set(same)), 1)
        for options, words in ((("--distance", "1furlong"), "unknown unit"),
                               (("--distance", "0.2mm"), "has no unit"),
                               (("--distance", "nan"), "give a finite number"),
                               (("--distance", "-1mm"), "give a number >= 0"),
                               (("--triangles", 9, "--by", "size"), "give distance or error"),
                               (("--by", "error"), "--by needs --triangles"),
                               (("--triangles", 9, "--by", "error", "--distance", 1), "--by error and --distance cannot be combined")):
            self.assertIn(words, self.fails(2, *extract, *options))
        for path in self.here.glob("wave.*"):
            path.unlink()

    def test_several_isovalues_are_a_file_each_or_one_with_all(self):
        alone = {}
        for iso in ("0.3", "0.50", "5"):
            self.ok("extract", "b.isonest", "--iso", iso, "-o", "i_{iso}.ply")  # also replaced for a single one
            alone[iso] = (self.here / f"i_{iso}.ply").read_bytes()
            (self.here / f"i_{iso}.ply").unlink()
        several = ("extract", "b.isonest", "--iso", "0.3,0.50,5")
        report = self.json(*several, "-o", "i_{iso}.ply")["meshes"]
        self.assertEqual([(r["iso"], r["mesh"]) for r in report],
                         [(0.3, "i_0.3.ply"), (0.5, "i_0.50.ply"), (5, "i_5.ply")])
        self.assertEqual({iso: (self.here / f"i_{iso}.ply").read_bytes() for iso in alone}, alone)
        for name in ("all.ply", "all.vtp", "all.VTKHDF"):
            report = self.json(*several, "-o", name)["meshes"]
            self.assertEqual([(r["iso"], r["mesh"]) for r in report], [(0.3, name), (0.5, name), (5, name)])
            self.assertEqual(report[2]["triangles"], 0)
            self.assertIn(b"isovalue", (self.here / name).read_bytes())
        said = self.ok(*several, "-o", "all.ply").stdout.decode()
        self.assertIn("isovalue 0.50 in all.ply: ", said)
        self.assertIn("The surface is empty: every value is below 5", said)
        header = (self.here / "all.ply").read_bytes().split(b"end_header")[0].decode()
        self.assertIn("property double isovalue", header)
        self.assertIn(f"element face {sum(r['triangles'] for r in report)}", header)
        for path in [*self.here.glob("i_*"), *self.here.glob("all.*")]:
            path.unlink()
        # Formats without such an attribute, or only with one of 32 bits under another name.
        for name in ("all.stl", "all.obj", "all.3mf", "all.glb", "all.GLB"):
            message = self.fails(2, *several, "-o", name)
            self.assertRegex(message, rf"\A{re.escape(name)}: .*\.ply, \.vtp or \.vtkhdf")
            self.assertIn("{iso}", message)
            self.assertFalse((self.here / name).exists())
            # Each of these formats works with one file per isovalue.
            self.ok(*several, "-o", name.replace("all", "i_{iso}"))
            self.assertEqual(len(list(self.here.glob(f"i_*{name[-4:]}"))), 3)
        for path in self.here.glob("i_*"):
            path.unlink()
        self.assertIn("given twice", self.fails(2, "extract", "b.isonest", "--iso", "0.5,0.50", "-o", "i_{iso}.ply"))
        many = ",".join(str(i / 300) for i in range(257))
        self.assertIn("257 isovalues", self.fails(7, "extract", "b.isonest", "--iso", many, "-o", "all.ply"))

    def test_a_surface_is_closed_on_either_side_and_the_report_says_so(self):
        import h5py
        import numpy
        u = numpy.zeros((9, 9, 9))
        u[2:7, 2:7, 4:] = 1
        with h5py.File(self.here / "solid.h5", "w") as file:
            file["u"] = u
            file["holes"] = numpy.where(u == 0, numpy.nan, u)
            file["flat"] = u[4]
        for name in ("u", "holes", "flat"):
            self.ok("preprocess", "solid.h5", "--dataset", name, "-o", f"solid-{name}.s", "--chunk", 8)
        extract = ("extract", "solid-u.s", "--iso", 0.5, "-o", "solid.ply")
        is_open = self.json(*extract)
        self.assertNotIn("closed", is_open)
        for options, side in ((["--close"], "below"), (["--close=below"], "below"), (["--close=above"], "above")):
            report = self.json(*extract, *options)
            self.assertEqual((report["closed"], report["border_vertices"]), (side, 0))
            self.assertGreater(report["triangles"], is_open["triangles"])
            self.assertEqual(report["triangles"], 2 * report["vertices"] - 4)  # a sphere
            self.assertIn("closed at the faces of the volume: every edge has two triangles",
                          self.ok(*extract, *options).stdout.decode())
        self.assertIn("closed at the faces of the box",
                      self.ok(*extract, "--close", "--box", "1,1,1,5,5,5").stdout.decode())
        # The option's value is never the next argument.
        self.assertEqual(self.json("extract", "--iso", 0.5, "--close", "solid-u.s", "-o", "solid.ply")["closed"],
                         "below")
        full = ("extract", "solid-u.s", "--iso", -1, "--close", "-o", "solid.ply")
        self.assertEqual(self.json(*full)["triangles"], 6 * 8 * 8 * 2)
        self.assertIn("no value is below -1", self.ok(*full[:4], "--close=above", *full[5:]).stdout.decode())
        self.assertIn("every value is below 2",
                      self.ok("extract", "solid-u.s", "--iso", 2, "--close", "-o", "solid.ply").stdout.decode())
        holes = ("extract", "solid-holes.s", "--iso", 0.5, "--close", "-o", "solid.ply")
        self.assertGreater(self.json(*holes)["border_vertices"], 0)
        self.assertRegex(self.ok(*holes).stdout.decode(), r"open at missing values: \d+ vertices lie on borders")
        for path in self.here.glob("solid.ply"):
            path.unlink()
        self.assertIn("give below or above", self.fails(2, *extract, "--close=left"))
        self.assertIn("isolines cannot be combined with closing",
                      self.fails(2, "extract", "solid-flat.s", "--iso", 0.5, "--close", "-o", "solid.vtp"))
        self.fails(2, *extract, "--close", "--view", "0,0,1")
        self.fails(2, "extract", "solid-flat.s", "--graph", "--close", "-o", "solid.ply")
        self.fails(2, "slice", "solid-u.s", "--plane", "0,0,1,4", "--close", "-o", "solid.ply")
        for path in self.here.glob("solid*"):
            path.unlink()

    def test_ranges_tell_their_ends_apart(self):
        import h5py
        import numpy
        cases = ((1e9 + numpy.arange(60.0).reshape(3, 4, 5) / 20, "1000000000 to 1000000002.95"),
                 (numpy.full((3, 4, 5), numpy.nan), "values none"),
                 (numpy.arange(60.0).reshape(3, 4, 5), "values 0 to 59"))
        for values, words in cases:
            with h5py.File(self.here / "range.h5", "w") as file:
                file["u"] = values
            done = self.ok("preprocess", "range.h5", "-o", "range.s", "--force")
            self.assertIn(words, done.stdout.decode())
            self.assertIn(words, self.ok("info", "range.s").stdout.decode())
        for path in self.here.glob("range.*"):
            path.unlink()

    def test_check_asks_for_missing_where_that_is_all_that_differs(self):
        import numpy
        u = numpy.arange(60, dtype="<f4").reshape(3, 4, 5)
        u.tofile(self.here / "m.raw")
        shape = ("--dims", "5,4,3", "--type", "float32")
        self.ok("preprocess", "m.raw", *shape, "--missing", 7, "-o", "m.s")
        self.ok("check", "m.s", "--source", "m.raw", *shape, "--missing", 7)
        done = run("check", "m.s", "--source", "m.raw", *shape, cwd=self.here)
        self.assertEqual(done.returncode, 4)
        self.assertIn("give the same here", done.stdout.decode())
        (self.here / "m.raw").unlink()
        (self.here / "m.s").unlink()

    # The HDF5 filter

    def test_the_plugin_writes_frames_with_size_and_checksum_and_reads_them(self):
        import h5py
        import numpy
        data = numpy.arange(4096, dtype="<u2").reshape(64, 64)
        path = self.here / "plugin.h5"
        with h5py.File(path, "w") as file:
            file.create_dataset("d", data=data, chunks=(32, 64), compression=32015,
                                compression_opts=(3,))
        with h5py.File(path, "r") as file:
            numpy.testing.assert_array_equal(file["d"][...], data)
            _, frame = file["d"].id.read_direct_chunk((0, 0))
            self.assertEqual(frame[:4], b"\x28\xb5\x2f\xfd")
            self.assertEqual(frame[4] & 0x04, 0x04, "checksum")
            self.assertTrue(frame[4] & 0xE0, "content size")
        path.unlink()

    def test_the_plugin_refuses_frames_that_lie(self):
        import h5py
        import numpy
        magic = b"\x28\xb5\x2f\xfd"
        lies = {
            "no zstd": b"\0" * 64,
            "empty": b"",
            "4 GiB in 32 bytes": magic + b"\xa0" + struct.pack("<I", 0xFFFFFFFF) + b"\1" * 23,
            "2^63 bytes": magic + b"\xe0" + struct.pack("<Q", 2**63) + b"\1" * 19,
            "unknown size": magic + b"\0\x58" + b"\1\0\0",
        }
        path = self.here / "lies.h5"
        for name, frame in lies.items():
            with self.subTest(name):
                with h5py.File(path, "w") as file:
                    d = file.create_dataset("d", (64,), "u1", chunks=(64,), compression=32015)
                    d.id.write_direct_chunk((0,), frame or b"\0")
                with h5py.File(path, "r") as file, self.assertRaises(OSError):
                    numpy.array(file["d"][...])
        path.unlink()

    def test_libraries_are_not_taken_from_the_current_folder(self):
        wanted = subprocess.run(["readelf", "-d", ISONEST], capture_output=True, text=True).stdout
        names = re.findall(r"\(NEEDED\).*\[(.*)\]", wanted)
        self.assertTrue(names)
        folder = self.here / "libraries"
        folder.mkdir()
        for name in names:
            (folder / name).write_bytes(b"not a library")
        self.assertEqual(run("--version", cwd=folder).returncode, 0)


if __name__ == "__main__":
    unittest.main(argv=[sys.argv[0], *sys.argv[3:]], verbosity=1)
