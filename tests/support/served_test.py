"""served.run() gives the same as subprocess.run(): shown with a shell that prints everything it was given.

Usage: served_test.py ISONEST PLUGIN_FOLDER
"""
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile
import unittest

import served

LIBRARY = pathlib.Path(sys.argv[1]).resolve().parent.parent / "tests" / "libisonest_serve.so"
if not LIBRARY.exists():
    print("skipped: this build has no library that serves (sanitizers)")
    sys.exit(77)
TOLD = r"""
printf '%s\n' "$0" "$@"; pwd; umask; env | grep -v '^_=' | sort; echo error >&2
exit 7
"""


class Served(unittest.TestCase):
    def setUp(self):
        temporary = tempfile.TemporaryDirectory(prefix="isonest-served-")
        self.addCleanup(temporary.cleanup)
        self.here = pathlib.Path(temporary.name).resolve()
        for folder in ("bin", "tests"):
            (self.here / folder).mkdir()
        (self.here / "tests" / LIBRARY.name).symlink_to(LIBRARY)
        self.shell = str(shutil.copy("/bin/sh", self.here / "bin" / "sh"))

    def both(self, *arguments, **options):
        """The results of both, which must be equal."""
        done = [run([self.shell, *arguments], **options) for run in (subprocess.run, served.run)]
        self.assertEqual(vars(done[0]), vars(done[1]))
        return done[1]

    def test_a_program_gets_its_arguments_folder_environment_and_umask(self):
        self.addCleanup(os.umask, os.umask(0o027))
        done = self.both("-c", TOLD, "name", "two words", "", "\u00e4\n", cwd=self.here / "tests",
                         env={"A": "b c", "EMPTY": ""}, capture_output=True, text=True)
        self.assertEqual((done.returncode, done.stderr), (7, "error\n"))
        self.assertIn(f"{self.here}/tests\n0027\n", done.stdout)
        self.assertNotIn("ISONEST_SERVE", done.stdout)
        os.environ["ISONEST_SERVED_TEST"] = "inherited"
        self.assertIn("=inherited\n", self.both("-c", TOLD, capture_output=True, text=True).stdout)

    def test_one_run_leaves_nothing_to_the_next(self):
        for _ in range(3):
            self.assertEqual(self.both("-c", 'echo "$X"; X=1; export X; cd /; umask 0; echo "$X"',
                                       capture_output=True).stdout, b"\n1\n")

    def test_outputs_go_where_they_are_sent(self):
        for run in (subprocess.run, served.run):
            with open(self.here / "out", "w+") as file:
                done = run([self.shell, "-c", "echo out; echo error >&2"], stdout=file, stderr=subprocess.PIPE)
                file.seek(0)
                self.assertEqual((file.read(), done.stdout, done.stderr), ("out\n", None, b"error\n"))
        text = self.both("-c", r"printf 'a\r\nb\377'", capture_output=True, text=True, errors="replace").stdout
        self.assertEqual(text, "a\nb\ufffd")

    def test_input_comes_from_the_file_that_is_given(self):
        with open(self.here / "in", "w+b") as file:
            file.write(b"lines\nof input\n")
            for start in (0, 6):
                for run in (subprocess.run, served.run):
                    file.seek(start)
                    done = run([self.shell, "-c", "cat"], stdin=file, capture_output=True)
                    self.assertEqual(done.stdout, b"lines\nof input\n"[start:])

    def test_ends_are_told(self):
        for script, code in (("exit 0", 0), ("exit 255", 255), ("kill -TERM $$", -15), ("kill -KILL $$", -9)):
            self.assertEqual(self.both("-c", script).returncode, code)
        for run in (subprocess.run, served.run):
            with self.assertRaises(subprocess.CalledProcessError):
                run([self.shell, "-c", "exit 3"], check=True)
            with self.assertRaises(subprocess.TimeoutExpired):
                run([self.shell, "-c", "exec sleep 600"], timeout=0.5)
        self.assertEqual(self.both("-c", "exit 4", timeout=600).returncode, 4)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
