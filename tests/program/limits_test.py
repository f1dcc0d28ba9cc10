"""Limits of the machine that once caused a crash, an internal error or a wrong message: memory, address space, threads,
permissions, long names, a missing temporary folder. tests/attack/limits.py tries such limits at random.

Usage: limits_test.py ISONEST PLUGIN_FOLDER
"""
import json
import os
import pathlib
import resource
import shutil
import subprocess
import sys
import tempfile
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).parents[1]))
from support.sanitized import is_sanitized  # noqa: E402

ISONEST = os.path.abspath(sys.argv[1])


def run(*arguments, cwd, limits=(), user=None, **environment):
    """limits: pairs of a resource and a number. user: a user other than root."""
    def prepare():
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        if user is not None:
            os.setgroups([])
            os.setgid(user)
            os.setuid(user)
        for which, size in limits:
            resource.setrlimit(which, (size, size))
    return subprocess.run([ISONEST, *map(str, arguments)], cwd=cwd, capture_output=True, text=True, errors="replace", timeout=120,
                          preexec_fn=prepare, env={**os.environ, **environment})


class Limits(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        temporary = tempfile.TemporaryDirectory(prefix="isonest-limits-")
        cls.addClassCleanup(temporary.cleanup)
        cls.here = pathlib.Path(temporary.name)
        cls.here.chmod(0o755)
        for command in (["make-volume", "bucky", "--size", "17", "-o", "v.h5"], ["preprocess", "v.h5", "-o", "s.isonest"],
                        ["extract", "s.isonest", "--iso", "0.5", "-o", "m.ply"]):
            subprocess.run([ISONEST, *command, "-q"], cwd=cls.here, check=True, capture_output=True)
        # A raw format, so that HDF5 is not used until the store is made.
        cls.volume = cls.here / "v.nrrd"
        cls.volume.write_bytes(b"NRRD0004\ntype: uint8\ndimension: 3\nsizes: 9 8 7\nencoding: raw\n\n" + bytes(range(252)) * 2)

    def setUp(self):
        temporary = tempfile.TemporaryDirectory(prefix="out", dir=self.here)
        self.addCleanup(temporary.cleanup)
        self.out = pathlib.Path(temporary.name)

    def refused(self, done, code, words):
        self.assertEqual(done.returncode, code, done.stderr)
        self.assertRegex(done.stderr, words)
        self.assertEqual(done.stderr.count("isonest: error: "), 1, done.stderr)
        self.assertEqual([path for path in self.out.rglob("*") if path.is_file()], [])

    @unittest.skipIf(is_sanitized(ISONEST), "sanitizers need more memory than such limits leave")
    def test_little_heap_is_an_error_also_where_hdf5_would_crash(self):
        codes = set()
        for kib in range(2048, 5120, 64):
            if run("--version", cwd=self.here, limits=[(resource.RLIMIT_DATA, kib << 10)]).returncode != 0:
                continue  # the program and its libraries cannot start
            done = run("export", self.here / "s.isonest", "--field", "values", "-o", self.out / "o.h5", cwd=self.here,
                       limits=[(resource.RLIMIT_DATA, kib << 10)])
            codes.add(done.returncode)
            self.refused(done, 7, "memory")
        self.assertIn(7, codes)

    @unittest.skipIf(is_sanitized(ISONEST), "sanitizers need more memory than such limits leave")
    def test_little_address_space_is_an_error_also_where_hdf5_would_crash_as_it_starts(self):
        def made_within(kib):
            return run("preprocess", self.volume, "-o", self.out / "o.isonest", "--force", "--threads", "1", cwd=self.here,
                       limits=[(resource.RLIMIT_AS, kib << 10)])

        fails, works = 16 << 10, 1 << 20
        while works - fails > 128:
            middle = (fails + works) // 2
            fails, works = (fails, middle) if made_within(middle).returncode == 0 else (middle, works)
        (self.out / "o.isonest").unlink()
        for kib in range(works - 8192, works, 128):
            done = made_within(kib)
            if done.returncode == 0:
                (self.out / "o.isonest").unlink()
            elif run("--version", cwd=self.here, limits=[(resource.RLIMIT_AS, kib << 10)]).returncode == 0:
                self.assertIn(done.returncode, (6, 7), f"{kib} KiB: {done.stderr}")
                self.refused(done, done.returncode, "memory")

    @unittest.skipIf(is_sanitized(ISONEST), "sanitizers need more memory than such limits leave")
    def test_a_library_that_does_not_fit_into_memory_is_not_called_missing(self):
        seen = set()
        for mib in range(8, 72, 8):
            done = run("picture", self.here / "m.ply", "-o", self.out / "o.png", cwd=self.here,
                       limits=[(resource.RLIMIT_DATA, mib << 20)])
            seen.add(done.returncode)
            if done.returncode != 0:
                self.refused(done, 7, "memory")
        self.assertIn(7, seen)

    @unittest.skipIf(is_sanitized(ISONEST), "sanitizers need more memory than such limits leave")
    def test_little_address_space_never_ends_threads(self):
        for mib in range(200, 1000, 40):
            done = run("preprocess", self.here / "v.h5", "-o", self.out / "o.isonest", "--threads", "16", cwd=self.here,
                       limits=[(resource.RLIMIT_AS, mib << 20)])
            if done.returncode != 0:
                self.refused(done, 7, "memory|threads")
            else:
                (self.out / "o.isonest").unlink()

    @unittest.skipUnless(os.geteuid() == 0, "limits of threads do not hold for root, and only root becomes another user")
    def test_a_viewer_without_threads_says_so(self):
        seen = False
        for count in (1, 2, 3):
            done = run("view", self.here / "s.isonest", "--port", "0", "--threads", "1", cwd="/", user=987_654_321,
                       limits=[(resource.RLIMIT_NPROC, count)])
            if "this build has no viewer" in done.stderr:
                self.skipTest("this build has no viewer")
            self.refused(done, 7, "thread")
            seen = seen or "cannot start another thread" in done.stderr
        self.assertTrue(seen)

    @unittest.skipIf(is_sanitized(ISONEST), "sanitizers need descriptors of their own")
    def test_a_viewer_without_descriptors_says_so(self):
        done = run("view", self.here / "s.isonest", "--port", "0", "--threads", "1", cwd="/", limits=[(resource.RLIMIT_NOFILE, 4)])
        if "this build has no viewer" in done.stderr:
            self.skipTest("this build has no viewer")
        self.refused(done, 6, "Too many open files")

    @unittest.skipUnless(os.geteuid() == 0, "only root becomes another user")
    def test_a_folder_that_may_not_be_searched_is_not_called_missing(self):
        self.out.chmod(0o600)
        inner = self.out / "inner"
        for name, words in (("o.ply", ["--iso", "0.5"]), ("labels", ["--labels", "all", "--format", "neuroglancer"])):
            store = self.here / "s.isonest"
            if name == "labels":
                store = self.here / "l.isonest"
                subprocess.run([ISONEST, "make-volume", "sphere", "--size", "9", "--type", "uint8", "-o", "l.h5", "-q", "--force"],
                               cwd=self.here, check=True)
                subprocess.run([ISONEST, "preprocess", "l.h5", "--labels", "-o", store, "-q", "--force"], cwd=self.here, check=True)
            done = run("extract", store, *words, "-o", inner.parent / name, cwd="/", user=987_654_321)
            self.refused(done, 6, "Permission denied")

    def test_outputs_may_have_the_longest_names(self):
        for end, command in ((".ply", ["extract", self.here / "s.isonest", "--iso", "0.5"]),
                             (".vtkhdf", ["extract", self.here / "s.isonest", "--iso", "0.5"]),
                             (".isonest", ["preprocess", self.here / "v.h5", "--resume"]),
                             (".nrrd", ["export", self.here / "s.isonest", "--field", "values"])):
            name = "n" * (255 - len(end)) + end
            done = run(*command, "-o", self.out / name, cwd=self.here)
            self.assertEqual(done.returncode, 0, done.stderr)
            self.assertEqual(os.listdir(self.out), [name])
            (self.out / name).unlink()
            self.refused(run(*command, "-o", self.out / ("n" + name), cwd=self.here), 6, "too long")

    def test_a_path_that_leaves_no_room_for_a_temporary_name_is_too_long(self):
        place = self.out
        while len(str(place)) + 201 < 4080:
            place = place / ("d" * 200)
        place = place / ("e" * (4080 - len(str(place)) - 1))
        place.mkdir(parents=True)
        for command, name in ((["preprocess", self.here / "v.h5"], "a.isonest"),
                              (["extract", self.here / "s.isonest", "--iso", "0.5"], "a.vtkhdf")):
            self.refused(run(*command, "-o", place / name, cwd=self.here), 6, "too long")

    def test_messages_do_not_steer_the_terminal(self):
        name = "a\x1b[31m\x9b2J\x07.ply"
        done = run("extract", self.here / "s.isonest", "--iso", "0.5", "-o", self.out / "none" / name, cwd=self.here)
        self.refused(done, 3, r"a\\x1b\[31m\\x9b2J\\x07\.ply: there is no folder")
        done = run("extract", self.here / "s.isonest", "--iso", "0.5", "-o", self.out / name, cwd=self.here)
        self.assertIn(r"a\x1b[31m\x9b2J\x07.ply", done.stdout)
        (self.out / name).unlink()
        # JSON has escapes of its own.
        name = "\u00e9\u202e\x7f\x9b.isonest"
        shutil.copy(self.here / "s.isonest", self.out / name)
        done = run("info", self.out / name, "--json", cwd=self.here)
        self.assertTrue(json.loads(done.stdout)["store"].endswith(name))
        self.assertRegex(done.stdout, r"^[\n -~]*$")
        (self.out / name).unlink()

    def test_what_a_kill_left_of_a_long_name_is_named(self):
        name, other = "n" * 250 + ".ply", "n" * 249 + "o.ply"
        done = run("extract", self.here / "s.isonest", "--iso", "0.5", "-o", self.out / name, cwd=self.here,
                   limits=[(resource.RLIMIT_FSIZE, 100)])
        self.refused(done, 6, "too large")
        left = self.out / done.stderr.split("/")[-1].split(":")[0]
        self.assertEqual(left.name, name)
        process = subprocess.run([sys.executable, "-c", "import os; print(os.getpid())"], capture_output=True, text=True)
        number = 0xcbf29ce484222325
        for byte in name.encode():
            number = (number ^ byte) * 0x100000001b3 % 2**64
        temporary = self.out / f".{name[:180]}~{number:016x}.partial-{process.stdout.strip()}"
        temporary.write_text("half")
        for output, named in ((name, True), (other, False)):
            done = run("extract", self.here / "s.isonest", "--iso", "0.5", "-o", self.out / output, cwd=self.here)
            self.assertEqual(done.returncode, 0, done.stderr)
            self.assertEqual(temporary.name in done.stderr + done.stdout, named, done.stderr)
        for path in self.out.iterdir():
            path.unlink()

    def test_a_temporary_folder_that_is_not_there_is_named(self):
        done = run("check", self.here / "s.isonest", "--source", self.here / "v.h5", cwd=self.here, TMPDIR="/nowhere")
        self.refused(done, 6, "/nowhere: temporary space.*TMPDIR")


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
