"""Runs every attack program for a few seconds: each finds nothing wrong; and their shared code notices what is wrong.

usage: attack_test.py ISONEST PLUGIN_FOLDER
ISONEST_ATTACK_SECONDS=600: so long for each kind of try of every attack program.
"""
import os
import pathlib
import subprocess
import sys
import tempfile
import textwrap
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).parents[1]))
from support.sanitized import is_sanitized  # noqa: E402

ISONEST = pathlib.Path(sys.argv[1]).resolve()
FOLDER = pathlib.Path(__file__).resolve().parent
SECONDS = os.environ.get("ISONEST_ATTACK_SECONDS")
SHARED = {"attack.py", "attack_test.py"}


def run(program, *arguments):
    with tempfile.TemporaryDirectory(prefix="isonest-test-") as folder:
        return subprocess.run([sys.executable, program, "--isonest", ISONEST, "--keep", pathlib.Path(folder) / "kept",
                               *arguments], capture_output=True, text=True, cwd=folder)


class Attackers(unittest.TestCase):
    # The limits of time and memory, and the Python package, are those of ordinary builds.
    @unittest.skipIf(is_sanitized(ISONEST), "built with a sanitizer")
    def test_each_finds_nothing_wrong(self):
        programs = [path for path in sorted(FOLDER.glob("*.py")) if path.name not in SHARED]
        for program in programs:
            with self.subTest(program.name):
                length = ["--seconds", SECONDS, "--count", "1000000000"] if SECONDS else ["--seconds", "3", "--count", "10"]
                done = run(program, *length)
                if done.returncode != 77:
                    self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
                    self.assertIn("| 0 |", done.stdout)


class Shared(unittest.TestCase):
    def attack(self, body, *arguments):
        with tempfile.TemporaryDirectory(prefix="isonest-test-") as folder:
            program = pathlib.Path(folder) / "a.py"
            program.write_text(f"import os, sys, time\nsys.path.insert(0, {str(FOLDER)!r})\nimport attack\n"
                               f"def kind(one):\n{textwrap.indent(textwrap.dedent(body), '    ')}\n"
                               "sys.exit(attack.main('a', {'kind': kind}))\n")
            done = run(program, "--reasons", *arguments)
        return done.returncode, done.stdout.splitlines()[2:], done.stderr

    def test_wrong_tries_are_counted_and_the_others_go_on(self):
        for bad in ("os.abort()", "time.sleep(60)", "1 / 0", "return attack.wrong('x')", "sys.exit(0)"):
            code, rows, err = self.attack(f"if one.seed in (3, 9): {bad}\nreturn attack.SAME", "--count", "12",
                                          "--patience", "2")
            self.assertEqual((code, rows[0].rsplit("|", 2)[0]), (2, "| kind | 12 | 10 | 0 | 2 "), bad + err)
            for seed in (3, 9):
                self.assertIn(f"--seed {seed}:", err)

    def test_a_seed_alone_makes_a_try(self):
        body = "return attack.refused(str(one.random.integers(1 << 60)))"
        _, all_of_them, _ = self.attack(body, "--count", "20", "--jobs", "3")
        _, one, _ = self.attack(body, "--seed", "7", "--count", "1")
        self.assertIn(one[1], all_of_them)

    def test_the_folder_of_a_wrong_try_is_kept(self):
        with tempfile.TemporaryDirectory(prefix="isonest-test-") as folder:
            code, _, err = self.attack("(one.folder / 'seed').write_text(str(one.seed))\n"
                                       "return attack.wrong('x') if one.seed % 3 == 0 else attack.SAME", "--count", "60", "--keep", folder)
            self.assertEqual(code, 20, err)
            for seed in range(3, 61, 3):
                self.assertEqual((pathlib.Path(folder) / f"kind-{seed}" / "seed").read_text(), str(seed))

    def test_limits_end_the_program(self):
        code, rows, err = self.attack("""
            done = one.run("make-volume", "bucky", "--size", "65", "-o", one.folder / "b.h5", heap=8 << 20)
            return attack.SAME if done.code not in (0, "hang") and not list(one.folder.iterdir()) else attack.wrong(str(done))
            """, "--count", "1")
        self.assertEqual(code, 0, err)

    def test_an_unknown_kind_is_an_error(self):
        self.assertEqual(self.attack("return attack.SAME", "other")[0], 2)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
