"""The program as users see it: help, options, errors, exit codes, reports.

Usage: cli_test.py ISONEST PLUGIN_FOLDER
"""
import json
import os
import pathlib
import pty
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
from cli_case import CliCase, ISONEST, run  # noqa: E402

COMMANDS = ["preprocess", "extract", "info", "export", "check", "make-volume", "picture"]


class Cli(CliCase):
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
                self.fails(2, "export", store, "--field", field, "--level", level, "-o", self.here / "cells.npy")
        self.assertFalse((self.here / "cells.npy").exists())
        self.ok("export", store, "--field", "linf_bar", "-o", self.here / "cells.npy")

    def test_indicators_are_chosen_by_name_and_in_sets(self):
        measures = ["linf", "deviation", "l1", "l2", "grad_linf", "grad_l1", "grad_l2", "grad_edge", "normal_jump",
                    "normal_edge", "normal_turn", "normal"]
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

    def test_help_is_80_columns_wide(self):
        for command in ("", *COMMANDS, "slice", "study", "smooth"):
            text = self.ok(*([command] if command else []), "--help").stdout.decode()
            self.assertEqual([line for line in text.splitlines() if len(line) > 80], [], command)

    def test_mistyped_names_are_corrected(self):
        for arguments, meant in ((["extract", "b.isonest", "--eror", "3"], "--error?"), (["extrct"], "extract?"),
                                 (["picture", "b.ply", "--colour=1,2,3", "-o", "x.png"], "--color?")):
            self.assertIn("did you mean " + meant, self.fails(2, *arguments))
        self.assertNotIn("did you mean", self.fails(2, "frobnicate"))


if __name__ == "__main__":
    unittest.main(argv=[sys.argv[0], *sys.argv[3:]], verbosity=1)
