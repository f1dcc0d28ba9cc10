"""Binaries are hardened: position-independent, read-only relocations, no executable stack, stack protection, checked
calls.

usage: hardening_test.py ISONEST PLUGIN_FOLDER
"""
import pathlib
import re
import subprocess
import sys
import unittest

ISONEST = pathlib.Path(sys.argv[1]).resolve()
BUILD = ISONEST.parent.parent
cache = (BUILD / "CMakeCache.txt").read_text()
if "ISONEST_HARDENED:BOOL=ON" not in cache or not re.search(r"ISONEST_SANITIZE:STRING=\n", cache):
    print("skipped: this build is not hardened")
    sys.exit(77)


def elf(*arguments):
    return subprocess.run(["readelf", "--wide", *arguments], capture_output=True, text=True, check=True).stdout


def built():
    """Programs, modules and the Python package of the build tree."""
    return [path for path in (ISONEST, BUILD / "bin/isonest-mpi", *(BUILD / "lib/isonest").glob("*.so"),
                              *(BUILD / "python/isonest").glob("*.so"), *(BUILD / "plugin").glob("*.so")) if path.exists()]


class Hardening(unittest.TestCase):
    def each(self):
        for file in built():
            with self.subTest(file.name):
                yield file

    def test_position_independent(self):
        for file in self.each():
            self.assertIn("Type:                              DYN", elf("-h", file))

    def test_relocations_are_read_only_before_main(self):
        for file in self.each():
            self.assertIn("GNU_RELRO", elf("-l", file))
            self.assertRegex(elf("-d", file), r"FLAGS\).*BIND_NOW|FLAGS_1\).*NOW")

    def test_the_stack_is_not_executable(self):
        for file in self.each():
            self.assertRegex(elf("-l", file), r"GNU_STACK .* RW +0x")

    def test_stacks_are_guarded(self):
        for file in self.each():
            if "h5zstd" not in file.name:  # possibly without any function with an array
                self.assertIn("__stack_chk_fail", elf("--dyn-syms", file))

    def test_calls_of_the_c_library_are_checked(self):
        self.assertRegex(elf("--dyn-syms", ISONEST), r"__(mem|str|vs?n?|pread|read|fread|realpath|getcwd)\w*_chk\b")


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
