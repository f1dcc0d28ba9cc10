"""If a rank is killed at a random moment, isonest-mpi ends and no incomplete file has the name of the output; a run
with --resume, of the same or another number of ranks, writes the same bytes. A run that is interrupted says so if and
only if there is no store.

usage: killed_ranks_test.py ISONEST PLUGIN_FOLDER     (ISONEST_KILLS=50 in the environment: number of kills)
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


class KilledRanks(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory(prefix="isonest-ranks-")
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)
        # A copy, so that no other process runs it.
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
            alive = ranks.processes_of(self.program)
            if alive:
                try:
                    os.kill(generator.choice(alive), signal.SIGKILL)
                except ProcessLookupError:
                    pass  # it had ended
            code = ranks.ended(process, self.program)
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
        self.assertEqual(ranks.processes_of(self.program), [])

    def test_a_signal_while_the_store_gets_its_name_is_too_late(self):
        (self.folder / "out").mkdir()
        store = self.folder / "out" / "s.isonest"
        subprocess.run([sys.argv[1], "make-volume", "noise", "--size", "40,40,40", "-o", self.folder / "v.h5", "-q"],
                       check=True)
        reached = 0
        for i in range(KILLS):
            for old in (self.folder / "out").iterdir():
                old.unlink()
            process = ranks.started(3, self.program, *self.preprocess())
            while not store.exists() and process.poll() is None:
                pass
            alive = ranks.processes_of(self.program)
            for rank in alive if i % 2 == 0 else alive[:1]:
                try:
                    os.kill(rank, signal.SIGTERM)
                    reached += 1
                except ProcessLookupError:
                    pass  # it had ended
            with self.subTest(signal=i):
                self.assertEqual(process.wait(timeout=120), 0)
                self.assertTrue(store.exists())
        self.assertGreater(reached, 0)

    def test_a_signal_while_a_mesh_gets_its_name_is_too_late(self):
        (self.folder / "out").mkdir()
        mesh = self.folder / "out" / "m.ply"
        volume, store = self.folder / "v.h5", self.folder / "s.isonest"
        subprocess.run([sys.argv[1], "make-volume", "noise", "--size", "40,40,40", "-o", volume, "-q"], check=True)
        subprocess.run([sys.argv[1], "preprocess", volume, "-o", store, "-q"], check=True)
        reached = 0
        for i in range(KILLS):
            mesh.unlink(missing_ok=True)
            process = ranks.started(3, self.program, "extract", store, "--iso", "0.5", "-o", mesh)
            while not mesh.exists() and process.poll() is None:
                pass
            alive = ranks.processes_of(self.program)
            for rank in alive if i % 2 == 0 else alive[-1:]:
                try:
                    os.kill(rank, signal.SIGTERM)
                    reached += 1
                except ProcessLookupError:
                    pass  # it had ended
            with self.subTest(signal=i):
                self.assertEqual(process.wait(timeout=120), 0)
                self.assertEqual(list((self.folder / "out").iterdir()), [mesh])
        self.assertGreater(reached, 0)

    def test_a_signal_at_a_random_moment(self):
        (self.folder / "out").mkdir()
        store = self.folder / "out" / "s.isonest"
        subprocess.run([sys.argv[1], "make-volume", "noise", "--size", "40,40,40", "-o", self.folder / "v.h5", "-q"],
                       check=True)
        generator = random.Random(7)
        codes = set()
        for i in range(KILLS):
            for old in (self.folder / "out").iterdir():
                old.unlink()
            process = ranks.started(3, self.program, *self.preprocess())
            # Not before all ranks have started: mpirun itself may hang if ranks end while others start.
            while not list((self.folder / "out").iterdir()) and process.poll() is None:
                pass
            time.sleep(generator.uniform(0, 0.3))
            for rank in ranks.processes_of(self.program):
                try:
                    os.kill(rank, signal.SIGTERM)
                except ProcessLookupError:
                    pass  # it had ended
            code = process.wait(timeout=120)
            codes.add(code)
            with self.subTest(signal=i, code=code):
                self.assertEqual(store.exists(), code == 0)
        self.assertLessEqual(codes, {0, 130, 143})


if __name__ == "__main__":
    ranks.require(sys.argv[1])
    unittest.main(argv=sys.argv[:1])
