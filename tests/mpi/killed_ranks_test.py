"""If a rank is killed at a random moment, isonest-mpi ends and nothing has the output's name that is not whole; a run
with --resume, of as many ranks or of others, makes the same bytes.

usage: killed_ranks_test.py ISONEST PLUGIN_FOLDER     (ISONEST_KILLS=50 in the environment: that many kills)
"""
import os
import pathlib
import random
import signal
import subprocess
import sys
import tempfile
import time
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import ranks

KILLS = int(os.environ.get("ISONEST_KILLS", "12"))


def processes_of(program):
    """Those that run it, by their numbers."""
    found = []
    for entry in pathlib.Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                if (entry / "exe").resolve() == program:
                    found.append(int(entry.name))
            except OSError:
                pass  # it has ended meanwhile
    return found


class KilledRanks(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory(prefix="isonest-ranks-")
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)
        # A copy, so that nobody else runs it.
        self.program = self.folder / "program" / "isonest-mpi"
        self.program.parent.mkdir()
        self.program.write_bytes(ranks.beside(sys.argv[1], "isonest-mpi").read_bytes())
        self.program.chmod(0o755)

    def preprocess(self, *more):
        return ["preprocess", self.folder / "v.h5", "-o", self.folder / "out" / "s.isonest", "--chunk", "8",
                "--threads", "1", "-q", *more]

    def test_nothing_half_written_opens_and_what_is_resumed_has_the_same_bytes(self):
        generator = random.Random(5)
        (self.folder / "out").mkdir()
        store = self.folder / "out" / "s.isonest"
        subprocess.run([sys.argv[1], "make-volume", "noise", "--size", "70,66,90", "-o", self.folder / "v.h5", "-q"],
                       check=True)
        start = time.monotonic()
        done = ranks.launched(3, self.program, *self.preprocess())
        seconds = time.monotonic() - start
        self.assertEqual(done.returncode, 0, done.stderr)
        plain = self.folder / "plain.isonest"
        subprocess.run([sys.argv[1], "preprocess", self.folder / "v.h5", "-o", plain, "--chunk", "8", "-q"], check=True)
        whole = plain.read_bytes()
        self.assertEqual(store.read_bytes(), whole)
        killed = 0
        for i in range(KILLS):
            for old in (self.folder / "out").iterdir():
                old.unlink()
            process = ranks.started(3, self.program, *self.preprocess("--resume"))
            time.sleep(generator.uniform(0.2, 1) * seconds)
            alive = processes_of(self.program)
            if alive:
                try:
                    os.kill(generator.choice(alive), signal.SIGKILL)
                except ProcessLookupError:
                    pass  # it was done
            code = process.wait(timeout=120)
            killed += code != 0
            with self.subTest(kill=i, code=code):
                if code == 0:
                    self.assertEqual(store.read_bytes(), whole)
                if store.exists():
                    self.assertEqual(store.read_bytes(), whole)
                if code != 0 and i % 2 == 0:
                    again = ranks.launched(generator.choice([1, 2, 3, 4]), self.program,
                                           *self.preprocess("--resume", "--force"))
                    self.assertEqual(again.returncode, 0, again.stderr)
                    self.assertEqual(store.read_bytes(), whole)
        self.assertGreater(killed, KILLS // 4)
        self.assertEqual(processes_of(self.program), [])


if __name__ == "__main__":
    ranks.require(sys.argv[1])
    unittest.main(argv=sys.argv[:1])
