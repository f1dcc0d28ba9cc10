"""Shared by the tests of input formats: preprocess a file, examine the store.

REQUIRES: sys.argv[1] is the program.
"""
import json
import pathlib
import shutil
import subprocess
import sys
import tempfile
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served  # noqa: E402

import numpy as np

ISONEST = sys.argv[1]
RANDOM = np.random.default_rng(5)
TYPES = ("u1", "i1", "u2", "i2", "u4", "i4", "f4", "f8")
def numbers(shape, kind="i2"):
    kind = np.dtype(kind)
    if kind.kind == "f":
        return RANDOM.normal(size=shape).astype(kind)
    if kind.itemsize == 8:
        return RANDOM.integers(0, 2**53, shape).astype(kind)
    whole = np.iinfo(kind)
    return RANDOM.integers(whole.min, whole.max, shape, endpoint=True).astype(kind)


def is_read_as(data):
    """The type in which values of a NumPy type are stored."""
    return data.astype({"i8": "f8", "u8": "f8", "f2": "f4"}.get(data.dtype.str[1:], data.dtype.str[1:]))


class DamagedFiles:
    """Mixin: any change of a file gives an error or a result, and no crash."""

    def damaged(self, whole, count=60):
        for i in range(count):
            data = bytearray(whole)
            for _ in range(RANDOM.integers(1, 4)):
                data[RANDOM.integers(min(len(data), 700))] = RANDOM.integers(256)
            if i % 4 == 0:
                del data[RANDOM.integers(len(data)):]
            self.path.write_bytes(data)
            done = self.preprocess("--memory", "256M")
            self.assertIn(done.returncode, (0, 2, 3, 4, 5, 6, 7), (i, done.stderr))
            if len(data) < len(whole) and done.returncode == 0:
                self.fail(f"{i}: a file that was cut short was read")


class Module:
    """Mixin: formats that are read by a module of the library. A copy of the program elsewhere has only the given
    modules."""

    def moved_program(self):
        program = self.here / "moved/bin/isonest"
        program.parent.mkdir(parents=True)
        (self.here / "moved/lib/isonest").mkdir(parents=True)
        shutil.copy(ISONEST, program)
        return program

    def run_moved(self, program):
        return subprocess.run([program, "preprocess", self.path, "-o", self.here / "moved.isonest", "--chunk", "8",
                               "--force"], capture_output=True, text=True)

    def needs_module(self, program, name, package):
        """Checks that `path` is read with the module, and that with none or a broken one there is an error and no
        store."""
        module = self.here / "moved/lib/isonest" / name
        done = self.run_moved(program)
        self.assertEqual(done.returncode, 5, done.stderr)
        self.assertRegex(done.stderr, f"not installed.* {package}\n")
        module.write_bytes(b"no module")
        done = self.run_moved(program)
        self.assertEqual(done.returncode, 5, done.stderr)
        self.assertRegex(done.stderr, f"cannot be loaded: .*{name}")
        self.assertEqual(list(self.here.glob("moved.*")), [])
        shutil.copy(pathlib.Path(ISONEST).resolve().parents[1] / "lib/isonest" / name, module)
        done = self.run_moved(program)
        self.assertEqual(done.returncode, 0, done.stderr)


class Input(unittest.TestCase):
    path = None

    def setUp(self):
        self.folder = tempfile.TemporaryDirectory(prefix="isonest-test-", dir=served.MEMORY)
        self.addCleanup(self.folder.cleanup)
        self.here = pathlib.Path(self.folder.name)

    def preprocess(self, *options, store=None):
        return served.run([ISONEST, "preprocess", self.path, "-o", store or self.here / "s.isonest",
                           "--chunk", "8", "--force", *options], capture_output=True, text=True,
                          errors="replace")

    def reads(self, data, *options):
        """Checks that the store has these numbers, [z, y, x]."""
        done = self.preprocess(*options)
        self.assertEqual(done.returncode, 0, done.stderr)
        served.run([ISONEST, "export", self.here / "s.isonest", "--field", "values", "-o",
                    self.here / "s.raw", "--force"], check=True, capture_output=True)
        found = np.fromfile(self.here / "s.raw", data.dtype)
        np.testing.assert_array_equal(found, data.ravel())
        return done

    def info(self):
        return json.loads(served.run([ISONEST, "info", self.here / "s.isonest", "--json"],
                                     check=True, capture_output=True).stdout)

    def lies(self, origin, spacing):
        info = self.info()
        np.testing.assert_allclose(info["origin"], origin)
        np.testing.assert_allclose(info["spacing"], spacing)

    def directions(self):
        return self.info()["direction"]

    def refuses(self, code, *words, options=()):
        done = self.preprocess(*options)
        self.assertEqual(done.returncode, code, done.stderr)
        for word in words:
            self.assertIn(word, done.stderr)


