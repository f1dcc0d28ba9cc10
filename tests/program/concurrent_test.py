"""Several processes at once, read-only folders, full disks: no output is ever incomplete.

Usage: concurrent_test.py ISONEST PLUGIN_FOLDER
"""
import os
import pathlib
import subprocess
import sys
import tempfile
import unittest

ISONEST = sys.argv[1]


def start(*arguments, **options):
    return subprocess.Popen([ISONEST, *map(str, arguments)], stdout=subprocess.PIPE,
                            stderr=subprocess.PIPE, **options)


def run(*arguments, **options):
    return subprocess.run([ISONEST, *map(str, arguments)], capture_output=True, timeout=600,
                          **options)


class InFolder(unittest.TestCase):
    def setUp(self):
        temporary = tempfile.TemporaryDirectory(prefix="isonest-concurrent-")
        self.addCleanup(temporary.cleanup)
        self.here = pathlib.Path(temporary.name)


class Concurrent(InFolder):
    def setUp(self):
        super().setUp()
        self.volume = self.here / "v.h5"
        self.store = self.here / "s.isonest"
        self.assertEqual(run("make-volume", "noise", "--size", "70", "--type", "uint8", "-o",
                             self.volume).returncode, 0)
        self.make = ("preprocess", self.volume, "-o", self.store, "--chunk", "16", "-q")

    def names(self, folder=None):
        return sorted(p.name for p in (folder or self.here).iterdir())

    def test_readers_get_the_old_store_or_the_new_one_while_it_is_replaced(self):
        self.assertEqual(run(*self.make).returncode, 0)
        extract = ("extract", self.store, "--iso", "128", "-q")
        self.assertEqual(run(*extract, "-o", self.here / "m.ply").returncode, 0)
        expected = (self.here / "m.ply").read_bytes()
        for _ in range(3):
            writer = start(*self.make, "--force")
            readers = [start(*extract, "-o", self.here / f"m{i}.ply") for i in range(4)]
            for i, reader in enumerate(readers):
                _, err = reader.communicate(timeout=300)
                self.assertEqual(reader.returncode, 0, err)
                mesh = self.here / f"m{i}.ply"
                self.assertEqual(mesh.read_bytes(), expected)
                mesh.unlink()
            writer.communicate(timeout=300)
            self.assertEqual(writer.returncode, 0)

    def test_of_two_runs_for_one_store_one_wins_and_the_other_says_why(self):
        both = [start(*self.make), start(*self.make)]
        ends = sorted((p.communicate(timeout=300)[1], p.returncode) for p in both)
        codes = sorted(code for _, code in ends)
        self.assertEqual(codes, [0, 2], ends)
        message = next(err for err, code in ends if code == 2)
        self.assertIn(b"exists; give --force", message)
        self.assertEqual(run("check", self.store).returncode, 0)
        self.assertEqual(self.names(), ["s.isonest", "v.h5"])

    def test_two_forced_runs_end_with_a_whole_store(self):
        for p in [start(*self.make, "--force"), start(*self.make, "--force")]:
            _, err = p.communicate(timeout=300)
            self.assertEqual(p.returncode, 0, err)
        self.assertEqual(run("check", self.store, "--deep").returncode, 0)
        self.assertEqual(self.names(), ["s.isonest", "v.h5"])

    def test_a_running_run_is_not_taken_over(self):
        both = [start(*self.make, "--force", "--resume"), start(*self.make, "--force", "--resume")]
        for p in both:
            _, err = p.communicate(timeout=300)
            self.assertEqual(p.returncode, 0, err)
        self.assertEqual(run("check", self.store).returncode, 0)
        self.assertEqual(self.names(), ["s.isonest", "v.h5"])

    def test_temporary_files_do_not_follow_links(self):
        victim = self.here / "precious"
        victim.write_text("precious")
        # The names that the next process ids would give.
        last = start("--version")
        last.communicate()
        for i in range(200):
            for end in ("", ".journal", ".centres"):
                os.symlink(victim, self.here / f".s.isonest.partial-{last.pid + i}{end}")
        self.assertEqual(run(*self.make).returncode, 0)
        self.assertEqual(victim.read_text(), "precious")
        self.assertEqual(run("check", self.store).returncode, 0)
        self.assertFalse(self.store.is_symlink())

    def test_unfinished_files_are_nobody_elses(self):
        script = ("import os, subprocess, sys; os.umask(0o022); "
                  "sys.exit(subprocess.run(sys.argv[1:]).returncode)")
        subprocess.run([sys.executable, "-c", script, ISONEST, *map(str, self.make)], check=True)
        self.assertEqual(self.store.stat().st_mode & 0o777, 0o644)


@unittest.skipUnless(os.geteuid() == 0, "mounting needs root")
class OtherFileSystems(InFolder):
    def setUp(self):
        super().setUp()
        self.small = self.here / "small"
        self.small.mkdir()

    def mount(self, size):
        done = subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", self.small],
                              capture_output=True)
        if done.returncode != 0:
            self.skipTest("mounting is not allowed here")
        self.addCleanup(subprocess.run, ["umount", "-l", self.small], capture_output=True)

    def test_a_full_disk_is_an_error_wherever_it_happens_and_leaves_nothing(self):
        volume = self.here / "v.h5"
        run("make-volume", "noise", "--size", "70", "--type", "uint8", "-o", volume)
        store = self.here / "s"
        self.assertEqual(run("preprocess", volume, "-o", store, "--chunk", "16").returncode, 0)
        full = store.stat().st_size
        self.mount("4m")
        filler = self.small / "filler"
        failed = 0
        # With less and less free space the journal, the centres, the chunks or the table does not fit.
        for free in (8192, 40000, 150000, full // 4, full // 2, full - 60000, full - 4096):
            filler.write_bytes(b"")
            space = os.statvfs(self.small)
            filler.write_bytes(b"x" * (space.f_bavail * space.f_frsize - free))
            for options in ((), ("--resume",)):
                done = run("preprocess", volume, "-o", self.small / "s", "--chunk", "16", *options)
                self.assertEqual(done.returncode, 6, done.stderr)
                self.assertRegex(done.stderr, b"(?i)no space")
                failed += 1
                self.assertFalse((self.small / "s").exists())
                left = [p for p in self.small.iterdir() if p != filler]
                if options == ():
                    self.assertEqual(left, [])
                for p in left:
                    p.unlink()
        # What was finished before the disk was full is used when there is space again.
        filler.write_bytes(b"")
        space = os.statvfs(self.small)
        filler.write_bytes(b"x" * (space.f_bavail * space.f_frsize - full * 3 // 4))
        self.assertEqual(run("preprocess", volume, "-o", self.small / "s", "--chunk", "16",
                             "--resume").returncode, 6)
        filler.unlink()
        done = run("preprocess", volume, "-o", self.small / "s", "--chunk", "16", "--resume")
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn(b"from an interrupted run", done.stdout)
        self.assertEqual((self.small / "s").read_bytes(), store.read_bytes())
        (self.small / "s").unlink()
        for output in ("m.ply", "m.vtp", "m.vtkhdf", "m.glb", "m.obj", "m.stl", "m.3mf"):
            filler.write_bytes(b"")
            space = os.statvfs(self.small)
            filler.write_bytes(b"x" * (space.f_bavail * space.f_frsize - 100000))
            done = run("extract", store, "--iso", "128", "-o", self.small / output)
            self.assertEqual(done.returncode, 6, (output, done.stderr))
            self.assertEqual(self.names(), ["filler"], output)

    def names(self):
        return sorted(p.name for p in self.small.iterdir())

    def test_a_read_only_file_system_serves_readers_and_refuses_writers(self):
        self.mount("16m")
        volume, store = self.small / "v.h5", self.small / "s"
        run("make-volume", "noise", "--size", "50", "--type", "uint8", "-o", volume)
        self.assertEqual(run("preprocess", volume, "-o", store, "--chunk", "16").returncode, 0)
        subprocess.run(["mount", "-o", "remount,ro", self.small], check=True)
        readers = [start("extract", store, "--iso", "128", "-o", self.here / f"m{i}.ply")
                   for i in range(4)]
        for reader in readers:
            _, err = reader.communicate(timeout=300)
            self.assertEqual(reader.returncode, 0, err)
        self.assertEqual(run("check", store, "--deep").returncode, 0)
        for arguments in (("preprocess", volume, "-o", store, "--force"),
                          ("extract", store, "--iso", "128", "-o", self.small / "m.ply")):
            done = run(*arguments)
            self.assertEqual(done.returncode, 6, done.stderr)
            self.assertIn(b"ead-only file system", done.stderr)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
