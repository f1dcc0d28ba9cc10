"""The program in a folder with a volume, its store and a mesh: what the tests of the command line share."""
import json
import os
import pathlib
import subprocess
import sys
import tempfile
import unittest

import served
from sanitized import is_sanitized

ISONEST, PLUGINS = sys.argv[1:3]
os.environ["HDF5_PLUGIN_PATH"] = PLUGINS
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


class CliCase(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory(prefix="isonest-cli-", dir=served.MEMORY)
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
