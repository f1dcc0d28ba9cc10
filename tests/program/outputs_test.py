"""What an output may replace, for every command that writes; and that an interrupted run leaves no file, or only files
that the next run for the same output names.

Usage: outputs_test.py ISONEST PLUGIN_FOLDER     (ISONEST_KILLS=200 in the environment: number of signals)
"""
import json
import os
import pathlib
import random
import resource
import shutil
import signal
import socket
import stat
import subprocess
import sys
import tempfile
import time
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served  # noqa: E402
from sanitized import is_sanitized  # noqa: E402

ISONEST = os.path.abspath(sys.argv[1])
STOPS = int(os.environ.get("ISONEST_KILLS", "10"))
random.seed(11)


class Case:
    """A command that writes `output`; `forced`: it replaces files with --force only. `inputs`: what it reads."""

    def __init__(self, name, output, arguments, inputs, forced=False, folder=False):
        self.name, self.output, self.arguments, self.inputs = name, output, arguments, inputs
        self.forced, self.folder = forced, folder

    def command(self, output, force=True):
        target = output.parent if self.folder else output
        option = ["--force"] if self.forced and force else []
        return [ISONEST, *map(str, self.arguments), "-o", str(target), "-q", *option]


def cases(here, big=False):
    volume, store, mesh = here / "v.h5", here / "s.isonest", here / "m.ply"
    extract = ["extract", store, "--iso", "0.5"]
    size = "120" if big else "9"
    writing = [
        Case("preprocess", "o.isonest", ["preprocess", volume, "--chunk", "8"], [volume], True),
        Case("preprocess of a detached header", "o.isonest", ["preprocess", here / "v.nhdr"],
             [here / "v.nhdr", here / "v.raw"], True),
        Case("extract with values", "o.ply", [*extract, "--vertex-values", here / "t.isonest"],
             [store, here / "t.isonest"]),
        Case("extract of a volume", "o.stl", ["extract", volume, "--iso", "0.5"], [volume]),
        Case("extract of a detached header", "o.ply", ["extract", here / "v.nhdr", "--iso", "0.5"],
             [here / "v.nhdr", here / "v.raw"]),
        Case("extract of a volume, simplified", "o.ply",
             ["extract", volume, "--iso", "0.5", "--distance", "0.5voxel"], [volume]),
        Case("slice", "o.vtp", ["slice", store, "--plane", "0,0,1,3"], [store]),
        Case("slice, picture", "o.png", ["slice", store, "--plane", "0,0,1,3"], [store]),
        Case("slice, contours", "o.obj", ["slice", store, "--plane", "0,0,1,3", "--contours", "0.4"],
             [store]),
        Case("info, plot", "o.png", ["info", store, "--histogram"], [store]),
        Case("picture", "o.png", ["picture", mesh, "--size", "320x240"], [mesh]),
        Case("study, table", "study.csv", ["study", store, "--steps", "3"], [store], folder=True),
        Case("study, plot", "linf.svg", ["study", store, "--steps", "3"], [store], folder=True),
        Case("study, plot over elements", "l2_by_leaves.png", ["study", store, "--steps", "3"],
             [store], folder=True)]
    for end in ("ply", "stl", "obj", "vtp", "vtkhdf", "glb", "3mf"):
        writing.append(Case(f"extract to {end}", f"o.{end}", extract, [store]))
    for end in ("h5", "nrrd", "raw"):
        writing.append(Case(f"smooth to {end}", f"o.{end}",
                            ["smooth", store, "--steps", "1", "--tau", "1", "--lambda", "1"], [store], True))
        writing.append(Case(f"export to {end}", f"o.{end}", ["export", store, "--field", "values"],
                            [store], True))
        writing.append(Case(f"make-volume to {end}", f"o.{end}",
                            ["make-volume", "noise", "--size", size], [], True))
    return writing


class Outputs(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        temporary = tempfile.TemporaryDirectory(prefix="isonest-outputs-", dir=served.MEMORY)
        cls.addClassCleanup(temporary.cleanup)
        cls.here = pathlib.Path(temporary.name)
        for command in (["make-volume", "bucky", "--size", "17", "-o", "v.h5"],
                        ["preprocess", "v.h5", "-o", "s.isonest"],
                        ["preprocess", "v.h5", "-o", "t.isonest", "--chunk", "8"],
                        ["extract", "s.isonest", "--iso", "0.5", "-o", "m.ply"]):
            served.run([ISONEST, *command], cwd=cls.here, check=True, capture_output=True)
        (cls.here / "v.raw").write_bytes(bytes(range(125)))
        (cls.here / "v.nhdr").write_text("NRRD0004\ntype: uint8\ndimension: 3\nsizes: 5 5 5\n"
                                         "encoding: raw\ndata file: v.raw\n\n")
        cls.kept = {p: p.read_bytes() for p in cls.here.iterdir()}

    def setUp(self):
        temporary = tempfile.TemporaryDirectory(prefix="out", dir=self.here)
        self.addCleanup(temporary.cleanup)
        self.folder = pathlib.Path(temporary.name)

    def each(self):
        """Every command that writes, with an empty folder for its output."""
        for case in cases(self.here):
            for p in self.folder.iterdir():
                shutil.rmtree(p) if p.is_dir() and not p.is_symlink() else p.unlink()
            with self.subTest(case.name):
                yield case, self.folder / case.output

    def taken(self, case, output, force=True):
        done = served.run(case.command(output, force), capture_output=True, timeout=120)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertEqual([p.name for p in self.folder.iterdir() if p.name.startswith(".")], [])
        self.assertTrue(stat.S_ISREG(output.lstat().st_mode))

    def refused(self, case, output, words, force=True):
        """Refused immediately with a message, and all files are unchanged."""
        before = sorted(os.listdir(self.folder))
        status = output.lstat() if os.path.lexists(output) else None
        done = served.run(case.command(output, force), capture_output=True, timeout=20)
        self.assertEqual(done.returncode, 2, done.stderr)
        self.assertIn(str(output), done.stderr.decode())
        self.assertRegex(done.stderr.decode(), words)
        self.assertEqual(sorted(os.listdir(self.folder)), before)
        after = output.lstat()
        self.assertEqual((after.st_mode, after.st_ino, after.st_mtime_ns),
                         (status.st_mode, status.st_ino, status.st_mtime_ns))
        for path, content in self.kept.items():
            self.assertEqual(path.read_bytes(), content, path)

    def test_a_new_file_is_made_with_the_modes_of_the_umask(self):
        old = os.umask(0o027)
        self.addCleanup(os.umask, old)
        for case, output in self.each():
            self.taken(case, output, force=False)
            self.assertEqual(output.stat().st_mode & 0o777, 0o640)

    def test_an_existing_file_needs_force_where_there_is_force(self):
        for case, output in self.each():
            output.write_text("old")
            if case.forced:
                self.refused(case, output, "exists; give --force", force=False)
                self.assertEqual(output.read_text(), "old")
            else:
                self.taken(case, output)

    def test_a_replaced_file_keeps_its_permissions(self):
        for case, output in self.each():
            self.taken(case, output)
            fresh = output.read_bytes()
            for mode in (0o600, 0o666, 0o640, 0o444, 0o200):
                output.chmod(0o600)
                output.write_text("old")
                output.chmod(mode)
                self.taken(case, output)
                self.assertEqual(output.stat().st_mode & 0o7777, mode)
                output.chmod(0o600)
                self.assertEqual(output.read_bytes(), fresh)

    @unittest.skipUnless(os.geteuid() == 0, "giving files away needs root")
    def test_a_replaced_file_keeps_its_owner_and_group(self):
        for case, output in self.each():
            output.write_text("old")
            os.chown(output, 65534, 65533)
            output.chmod(0o640)
            self.taken(case, output)
            status = output.stat()
            self.assertEqual((status.st_uid, status.st_gid, status.st_mode & 0o777),
                             (65534, 65533, 0o640))

    def test_a_fifo_is_refused(self):
        for case, output in self.each():
            os.mkfifo(output)
            for force in (False, True):
                self.refused(case, output, "is a FIFO; only regular files", force)

    def test_a_socket_is_refused(self):
        for case, output in self.each():
            with socket.socket(socket.AF_UNIX) as end:
                end.bind(str(output))
                self.refused(case, output, "is a socket; only regular files")

    @unittest.skipUnless(os.geteuid() == 0, "making devices needs root")
    def test_a_device_is_refused(self):
        for case, output in self.each():
            try:
                os.mknod(output, stat.S_IFCHR | 0o666, os.makedev(1, 3))
            except PermissionError:
                self.skipTest("making devices is not allowed here")
            self.refused(case, output, "is a device; only regular files")

    def test_a_link_is_refused_and_what_it_leads_to_stays(self):
        with tempfile.NamedTemporaryFile(dir=self.here) as precious:
            precious.write(b"precious")
            precious.flush()
            for case, output in self.each():
                output.symlink_to(precious.name)
                self.refused(case, output, "is a link to .*; only regular files")
                self.assertEqual(pathlib.Path(precious.name).read_bytes(), b"precious")

    def test_a_link_that_leads_nowhere_is_refused_at_the_start(self):
        for case, output in self.each():
            output.symlink_to(self.folder / "nothing")
            for force in (False, True):
                self.refused(case, output, "is a broken link to ", force)

    def test_a_folder_is_refused(self):
        for case, output in self.each():
            output.mkdir()
            self.refused(case, output, "is a folder; give a file name")

    def test_an_input_is_refused_by_its_name_by_a_hard_link_and_through_a_link(self):
        for case, output in self.each():
            for source in case.inputs:
                for make in (os.link, os.symlink):
                    make(source, output)
                    self.refused(case, output, "is an input and cannot also be the output")
                    output.unlink()
                if not case.folder:
                    # By its own name, if the command accepts its extension.
                    done = served.run(case.command(source), capture_output=True, timeout=20)
                    self.assertEqual(done.returncode, 2, done.stderr)
                    self.assertEqual(source.read_bytes(), self.kept[source])

    def on_the_disk(self):
        """A folder in which outputs take longer, so that something can happen meanwhile."""
        temporary = tempfile.TemporaryDirectory(prefix="isonest-outputs-")
        self.addCleanup(temporary.cleanup)
        self.folder = pathlib.Path(temporary.name)

    def test_what_appears_under_the_name_during_the_run_is_not_replaced_if_it_is_no_file(self):
        self.on_the_disk()
        volume = self.folder / "n.raw"
        store = self.folder / "n.isonest"
        served.run([ISONEST, "make-volume", "noise", "--size", "65", "--type", "uint16", "-o",
                    volume], check=True, capture_output=True)
        process = subprocess.Popen(
            [ISONEST, "preprocess", volume, "--dims", "65,65,65", "--type", "uint16", "--compression",
             "19", "--threads", "1", "-o", store, "--force"], stderr=subprocess.PIPE,
            stdout=subprocess.DEVNULL)
        while process.poll() is None and not list(self.folder.glob(".n.isonest.*")):
            time.sleep(0.005)
        self.assertIsNone(process.poll(), "it was over before it could be disturbed")
        os.mkfifo(store)
        error = process.communicate(timeout=120)[1]
        self.assertEqual(process.returncode, 2, error)
        self.assertIn(b"is a FIFO", error)
        self.assertEqual(sorted(p.name for p in self.folder.iterdir()), ["n.isonest", "n.raw"])

    def test_nobody_reads_half_of_what_replaces_a_private_file(self):
        self.on_the_disk()
        for name in ("n.h5", "n.raw"):
            modes = set()
            for size in (150, 250, 400, 400, 400):  # larger if it was over before it could be looked at
                volume = self.folder / name
                volume.write_text("old")
                volume.chmod(0o600)
                process = subprocess.Popen([ISONEST, "make-volume", "noise", "--size", str(size), "-o", volume, "--force"],
                                           stdout=subprocess.DEVNULL)
                while process.poll() is None:
                    for p in self.folder.glob(f".{name}.*"):
                        try:
                            status = p.stat()
                        except FileNotFoundError:
                            continue
                        if status.st_size > 4096:
                            modes.add(status.st_mode & 0o777)
                self.assertEqual(process.returncode, 0)
                if modes:
                    break
            self.assertLessEqual(modes, {0o600})
            self.assertGreater(len(modes), 0, "it was over before it could be looked at")

    def test_a_study_that_fails_leaves_no_empty_folder(self):
        folder = self.folder / "a" / "b"
        done = served.run([ISONEST, "study", self.here / "s.isonest", "--memory", "1", "-o", folder],
                          capture_output=True)
        self.assertNotEqual(done.returncode, 0)
        self.assertEqual(list(self.folder.iterdir()), [])


class Stopped(unittest.TestCase):
    """Runs that are ended by signals at random moments."""

    whole_runs = {}  # of each case: the duration of an uninterrupted run in seconds, and the bytes of its output

    @classmethod
    def setUpClass(cls):
        temporary = tempfile.TemporaryDirectory(prefix="isonest-outputs-")
        cls.addClassCleanup(temporary.cleanup)
        cls.here = here = pathlib.Path(temporary.name)
        edge, period = 60, 23
        (here / "l.raw").write_bytes(bytes(1 + (x // 5 + y // 6 + z // 7) % period for z in range(edge)
                                           for y in range(edge) for x in range(edge)))
        for command in (["make-volume", "noise", "--size", "60", "-o", "v.h5"],
                        ["preprocess", "v.h5", "-o", "s.isonest", "--chunk", "16"],
                        ["preprocess", "l.raw", "--dims", f"{edge},{edge},{edge}", "--type", "uint8", "--labels", "-o",
                         "l.isonest", "--chunk", "16"],
                        ["extract", "s.isonest", "--iso", "0.05", "-o", "m.ply"]):
            served.run([ISONEST, *command], cwd=here, check=True, capture_output=True)
        store, extract = here / "s.isonest", ["extract", here / "s.isonest", "--iso", "0.05"]
        interfaces = ["extract", here / "l.isonest", "--labels", "all", "--smooth", "--interfaces"]
        cls.cases = [
            Case("preprocess", "o.isonest", ["preprocess", here / "v.h5", "--chunk", "8"], [], True),
            Case("extract", "o.ply", extract, []), Case("extract to vtkhdf", "o.vtkhdf", extract, []),
            Case("interfaces", "o.vtp", interfaces, []),
            Case("simplified interfaces", "o.vtp", [*interfaces, "--distance", "0.5voxel"], []),
            Case("slice", "o.vtp", ["slice", store, "--plane", "1,2,3,150"], []),
            Case("slice, picture", "o.png", ["slice", store, "--plane", "1,2,3,150"], []),
            Case("picture", "o.png", ["picture", here / "m.ply", "--size", "640x480"], []),
            Case("export", "o.h5", ["export", store, "--field", "deviation_bar"], [], True),
            Case("export to raw", "o.raw", ["export", store, "--field", "deviation_bar"], [], True),
            Case("smooth", "o.h5", ["smooth", store, "--steps", "4", "--tau", "1", "--lambda", "1"], [], True),
            Case("make-volume", "o.h5", ["make-volume", "noise", "--size", "150"], [], True),
            Case("make-volume to nrrd", "o.nrrd", ["make-volume", "noise", "--size", "150"], [], True),
            Case("study", "study.csv", ["study", store, "--steps", "4"], [], folder=True)]

    def stop(self, number, rounds=1):
        """Ends each command by this signal at random moments, at least `rounds` times; yields what is left."""
        for case in self.cases:
            with tempfile.TemporaryDirectory(dir=self.here) as name, self.subTest(case.name):
                folder = pathlib.Path(name) / "f"
                output = folder / case.output
                if not case.folder:
                    folder.mkdir()
                command = case.command(output)
                if case.name not in self.whole_runs:
                    start = time.monotonic()
                    self.assertEqual(subprocess.run(command).returncode, 0)
                    self.whole_runs[case.name] = time.monotonic() - start, output.read_bytes()
                seconds, whole = self.whole_runs[case.name]
                codes = []
                for _ in range(max(rounds, STOPS // 10)):
                    shutil.rmtree(folder, ignore_errors=True)
                    if not case.folder:
                        folder.mkdir()
                    process = subprocess.Popen(command, stderr=subprocess.DEVNULL)
                    # Before main() a program cannot influence what a signal does.
                    time.sleep(random.uniform(0.02, max(0.03, 1.1 * seconds)))
                    process.send_signal(number)
                    codes.append(process.wait(timeout=120))
                    if output.exists():
                        self.assertEqual(output.read_bytes(), whole)
                    left = sorted(folder.glob(".*")) if folder.exists() else []
                    yield case, folder, command, codes[-1], left

    def test_hang_up_terminate_interrupt_and_pipe_leave_nothing(self):
        tries = stopped = stopped_before = 0
        for number in (signal.SIGHUP, signal.SIGTERM, signal.SIGINT, signal.SIGPIPE, signal.SIGXCPU):
            for case, folder, _, code, left in self.stop(number):
                tries += 1
                # A signal during loading kills the program.
                self.assertIn(code, (0, 130, -number), case.name)
                self.assertEqual(left, [], (case.name, number))
                # If the signal comes after the output got its name, the output is complete, as stop() asserts.
                if code != 0 and not (folder / case.output).exists():
                    self.assertFalse(case.folder and folder.exists())
                    stopped_before += 1
                stopped += code == 130
        self.assertGreater(stopped, tries // 13)
        self.assertGreater(stopped_before, tries // 13)

    def test_what_a_kill_leaves_the_next_run_names(self):
        named = 0
        for case, folder, command, code, left in self.stop(signal.SIGKILL, rounds=2):
            self.assertIn(code, (0, -signal.SIGKILL))
            folder.mkdir(exist_ok=True)
            done = subprocess.run([a for a in command if a != "-q"], capture_output=True)
            self.assertEqual(done.returncode, 0, done.stderr)
            for p in left:
                base = p.name.removesuffix(".journal").removesuffix(".centres")
                self.assertIn(base, done.stderr.decode(), case.name)
                named += 1
            self.assertEqual(sorted(folder.glob(".*")), left)
        self.assertGreater(named, 3)

    def over(self):
        """The id of a process that has ended."""
        process = subprocess.Popen(["true"])
        process.wait()
        return process.pid

    def test_every_kind_of_leftover_is_named_by_the_next_run_of_its_command(self):
        for case in self.cases:
            with tempfile.TemporaryDirectory(dir=self.here) as name, self.subTest(case.name):
                output = pathlib.Path(name) / case.output
                pid = self.over()
                prefix = f".{case.output}.partial-{pid}"
                # The last: killed between naming the store and removing the files that were used to make it.
                for end in ("", "-2", ".ply", f".ply.partial-{pid}", "-3.journal", "-3.centres"):
                    (output.parent / (prefix + end)).write_text("x")
                (output.parent / f".isonest-scratch-{pid}-abcdef").write_text("x")
                alive = output.parent / f".{case.output}.partial-{os.getpid()}"
                alive.write_text("x")
                done = subprocess.run([*case.command(output), "--json"], capture_output=True)
                self.assertEqual(done.returncode, 0, done.stderr)
                warning = json.loads(done.stdout)["warning"]
                for p in output.parent.glob(".*"):
                    self.assertEqual(f"{p} (" in warning, p != alive, p.name)

    def test_a_journal_without_its_store_does_not_keep_other_runs_from_resuming(self):
        with tempfile.TemporaryDirectory(dir=self.here) as name:
            store = pathlib.Path(name) / "o.isonest"
            command = [ISONEST, "preprocess", self.here / "v.h5", "--chunk", "8", "-o", store, "-q",
                       "--force", "--resume"]
            journal = None
            process = subprocess.Popen(command)
            while process.poll() is None and journal is None:
                for p in store.parent.glob(".*.journal"):
                    if p.stat().st_size > 200:
                        journal = p.name, p.read_bytes()
            self.assertEqual(process.wait(), 0)
            self.assertIsNotNone(journal, "it was over before its journal could be read")
            (store.parent / journal[0]).write_bytes(journal[1])
            done = served.run([*command, "--exact"], capture_output=True)
            self.assertEqual(done.returncode, 0, done.stderr)
            self.assertIn(journal[0].encode(), done.stderr)

    def test_a_terminal_that_hangs_up_twice_does_not_cut_the_clean_up_short(self):
        with tempfile.TemporaryDirectory(dir=self.here) as name:
            output = pathlib.Path(name) / "o.h5"
            process = subprocess.Popen([ISONEST, "make-volume", "noise", "--size", "300", "-o", output],
                                       stderr=subprocess.DEVNULL)
            while process.poll() is None and not list(output.parent.iterdir()):
                time.sleep(0.002)
            for _ in range(20):
                process.send_signal(signal.SIGHUP)
            self.assertEqual(process.wait(timeout=60), 130)
            self.assertEqual(list(output.parent.iterdir()), [])

    def test_nohup_is_kept(self):
        with tempfile.TemporaryDirectory(dir=self.here) as name:
            output = pathlib.Path(name) / "o.h5"
            process = subprocess.Popen(["nohup", ISONEST, "make-volume", "noise", "--size", "150", "-o",
                                        output], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
            while process.poll() is None and not list(output.parent.iterdir()):
                time.sleep(0.002)
            process.send_signal(signal.SIGHUP)
            self.assertEqual(process.wait(timeout=60), 0)

    def test_a_reader_of_the_report_that_goes_away_costs_no_output(self):
        with tempfile.TemporaryDirectory(dir=self.here) as name:
            output = pathlib.Path(name) / "o.ply"
            read, write = os.pipe()
            os.close(read)
            done = subprocess.run([ISONEST, "extract", self.here / "s.isonest", "--iso", "0.05", "-o",
                                   output], stdout=write, stderr=subprocess.PIPE)
            os.close(write)
            self.assertEqual(done.returncode, -signal.SIGPIPE)
            self.assertEqual(done.stderr, b"")
            self.assertEqual(output.read_bytes(), (self.here / "m.ply").read_bytes())
            self.assertEqual(list(output.parent.iterdir()), [output])

    @unittest.skipIf(is_sanitized(ISONEST), "sanitizers start threads of their own")
    @unittest.skipUnless(os.geteuid() == 0, "running as a user of its own needs root")
    def test_threads_that_the_system_refuses_are_the_reason_given(self):
        user = 61234

        def limited(most):
            def limit():
                resource.setrlimit(resource.RLIMIT_NPROC, (most, most))
                os.setgroups([])
                os.setgid(user)
                os.setuid(user)
            return limit
        with tempfile.TemporaryDirectory() as name:
            here = pathlib.Path(name)
            here.chmod(0o777)
            for p in ("v.h5", "s.isonest", "m.ply"):
                shutil.copy(self.here / p, here / p)
            for command in (["preprocess", "v.h5", "-o", "o.isonest"],
                            ["extract", "s.isonest", "--iso", "0.05", "-o", "o.ply"],
                            ["slice", "s.isonest", "--plane", "0,0,1,5", "-o", "o.png"],
                            ["make-volume", "noise", "--size", "9", "-o", "o.h5"],
                            ["study", "s.isonest", "-o", "o", "--steps", "2"],
                            ["info", "s.isonest", "--histogram"],
                            ["check", "s.isonest"]):
                for most in (1, 2, 3):
                    with self.subTest(command=command[0], most=most):
                        run = [ISONEST, *command, "--threads"]
                        done = subprocess.run([*run, "4"], cwd=here, preexec_fn=limited(most),
                                              capture_output=True, timeout=60)
                        self.assertEqual(done.returncode, 7, done.stderr)
                        self.assertRegex(done.stderr.decode(),
                                         r"\d of 4 threads: .*; give --threads \d or raise the limit")
                        self.assertEqual(len(list(here.iterdir())), 3)
                done = subprocess.run([*run, "1"], cwd=here, preexec_fn=limited(1),
                                      capture_output=True, timeout=60)
                self.assertEqual(done.returncode, 0, done.stderr)
                for p in here.glob("o*"):
                    shutil.rmtree(p) if p.is_dir() else p.unlink()
            done = subprocess.run([ISONEST, "picture", "m.ply", "-o", "o.png"], cwd=here,
                                  preexec_fn=limited(1), capture_output=True, timeout=60)
            self.assertEqual(done.returncode, 0, done.stderr)


if __name__ == "__main__":
    unittest.main(argv=[sys.argv[0], *sys.argv[3:]])
