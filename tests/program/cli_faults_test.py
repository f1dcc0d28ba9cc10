"""Damage, limits, interrupts and the HDF5 plugin: what the program says, and what it leaves behind.

Usage: cli_faults_test.py ISONEST PLUGIN_FOLDER
"""
import json
import os
import pathlib
import re
import signal
import struct
import subprocess
import sys
import tempfile
import time
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served  # noqa: E402
from cli_case import CliCase, ISONEST, run  # noqa: E402


class Faults(CliCase):
    def test_too_little_memory_exits_with_7_and_says_how_much(self):
        self.assertRegex(self.fails(7, "extract", "b.isonest", "--iso", "0.5", "--memory", "1M",
                                    "-o", "x.ply"), r"--memory \d+M")

    def test_damage_exits_with_4(self):
        self.fails(2, "check", "b.ply")
        self.assertIn("mesh", self.fails(5, "info", "b.ply"))
        self.assertIn("not a mesh", self.fails(2, "picture", "b.h5", "-o", "x.png"))
        with tempfile.TemporaryDirectory() as other:
            volume, other_file = pathlib.Path(other) / "volume.obj", pathlib.Path(other) / "text.obj"
            volume.write_bytes(b"NRRD0004\ntype: uint8\ndimension: 3\nsizes: 2 2 2\nencoding: raw\n\n" + bytes(8))
            self.assertIn("not a mesh", self.fails(2, "picture", volume, "-o", "x.png"))
            other_file.write_text("a text\nof two lines\n")
            self.fails(4, "picture", other_file, "-o", "x.png")
            cut = pathlib.Path(other) / "cut.ply"
            cut.write_bytes((self.here / "b.ply").read_bytes()[:-1])
            self.assertIn("cut off", self.fails(4, "picture", cut, "-o", "x.png"))

    def test_check_finds_a_flipped_byte(self):
        report = self.json("check", "b.isonest", "--source", "b.h5")
        self.assertTrue(report["ok"])
        self.assertEqual(report["findings"], [])
        store = bytearray((self.here / "b.isonest").read_bytes())
        frame = store.index(b"\x28\xb5\x2f\xfd")  # zstd's magic: the first chunk
        store[frame + 40] ^= 1
        with tempfile.TemporaryDirectory() as other:
            path = pathlib.Path(other) / "flipped.isonest"
            path.write_bytes(store)
            done = run("check", path, "--json")
        self.assertEqual(done.returncode, 4)
        report = json.loads(done.stdout)
        self.assertFalse(report["ok"])
        self.assertGreater(report["failures"], 0)
        self.assertIn("checksum", {finding["test"] for finding in report["findings"]})

    def test_check_refuses_another_source(self):
        with tempfile.TemporaryDirectory() as other:
            path = pathlib.Path(other) / "s.h5"
            self.ok("make-volume", "sphere", "--size", "32", "-o", path)
            self.assertIn("32 x 32 x 32", self.fails(2, "check", "b.isonest", "--source", path))

    def test_a_full_disk_under_standard_output_exits_with_6(self):
        with open("/dev/full", "wb") as full:
            done = subprocess.run([ISONEST, "info", "b.isonest"], cwd=self.here, stdout=full,
                                  stderr=subprocess.PIPE, timeout=60)
        self.assertEqual(done.returncode, 6)
        self.assertIn(b"standard output", done.stderr)

    def test_a_file_size_limit_is_an_error_and_leaves_nothing(self):
        def limit():
            import resource
            resource.setrlimit(resource.RLIMIT_FSIZE, (20000, 20000))
        before = sorted(self.here.iterdir())
        for arguments in (["make-volume", "bucky", "--size", "33", "-o", "x.raw"],
                          ["preprocess", "b.h5", "-o", "x.isonest"],
                          ["extract", "b.isonest", "--iso", "0.5", "-o", "x.ply"],
                          ["export", "b.isonest", "--field", "values", "-o", "x.nrrd"],
                          ["picture", "b.ply", "-o", "x.png"]):
            with self.subTest(arguments=arguments):
                done = run(*arguments, cwd=self.here, preexec_fn=limit)
                self.assertEqual(done.returncode, 6, done.stderr)
                self.assertEqual(sorted(self.here.iterdir()), before)

    def test_an_interrupt_leaves_nothing_behind(self):
        for number in (signal.SIGINT, signal.SIGTERM):
            with self.subTest(signal=number), tempfile.TemporaryDirectory() as other:
                folder = pathlib.Path(other)
                self.ok("make-volume", "noise", "--size", "129", "--type", "uint16", "-o",
                        folder / "n.raw")
                process = subprocess.Popen(
                    [ISONEST, "preprocess", "n.raw", "--dims", "129,129,129", "--type", "uint16",
                     "--compression", "19", "--chunk", "16", "--threads", "1", "-o", "n.isonest",
                     "--json"], cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
                while process.poll() is None and not list(folder.glob(".n.isonest.*")):
                    time.sleep(0.01)
                self.assertIsNone(process.poll(), "it was over before it could be interrupted")
                process.send_signal(number)
                out, err = process.communicate(timeout=120)
                self.assertEqual(process.returncode, 130, err)
                self.assertEqual(json.loads(out)["error"]["kind"], "cancelled")
                self.assertTrue(err.startswith(b"isonest: error: "), err)
                self.assertEqual([p.name for p in folder.iterdir()], ["n.raw"])

    def interrupted(self, folder, *arguments):
        """A run of preprocess on noise that is stopped after its first row of chunks; returns its command."""
        self.ok("make-volume", "noise", "--size", "129", "--type", "uint16", "-o", folder / "n.raw")
        command = [ISONEST, "preprocess", *arguments, "--compression", "19", "--chunk", "16",
                   "--threads", "1", "-o", "n.isonest", "--resume", "--json"]
        process = subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE,
                                   stderr=subprocess.PIPE)

        def a_row_is_done():
            return any(p.stat().st_size > 4096 for p in folder.glob(".n.isonest.*.journal"))
        while process.poll() is None and not a_row_is_done():
            time.sleep(0.01)
        self.assertIsNone(process.poll(), "it was over before it could be interrupted")
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=120)
        self.assertEqual(process.returncode, 130, err)
        self.assertIn("run again with --resume", json.loads(out)["error"]["message"])
        return command

    def test_an_interrupted_run_with_resume_says_how_to_go_on(self):
        with tempfile.TemporaryDirectory(prefix="isonest-test-") as name:
            folder = pathlib.Path(name)
            command = self.interrupted(folder, "n.raw", "--dims", "129,129,129", "--type", "uint16")
            self.assertEqual(len(list(folder.iterdir())), 4)
            for option, difference in ((["--exact"], (b"'exact false'", b"'exact true'")),
                                       (["--endian", "big"], (b"'big endian true'",))):
                other = served.run([*command, *option], cwd=folder, capture_output=True)
                self.assertEqual(other.returncode, 2)
                for part in difference:
                    self.assertIn(part, other.stderr)
            done = served.run(command, cwd=folder, capture_output=True, check=True)
            self.assertGreater(json.loads(done.stdout)["resumed_chunks"], 0)
            self.assertEqual(sorted(p.name for p in folder.iterdir()), ["n.isonest", "n.raw"])

    def test_a_run_is_not_resumed_when_the_data_behind_its_header_have_changed(self):
        with tempfile.TemporaryDirectory(prefix="isonest-test-") as name:
            folder = pathlib.Path(name)
            (folder / "n.nhdr").write_text("NRRD0004\ntype: uint16\ndimension: 3\n"
                                           "sizes: 129 129 129\nencoding: raw\nendian: little\n"
                                           "data file: n.raw\n\n")
            command = self.interrupted(folder, "n.nhdr")
            os.utime(folder / "n.raw", (1, 1))
            other = served.run(command, cwd=folder, capture_output=True)
            self.assertEqual(other.returncode, 2)
            self.assertIn(b"'input bytes 4293378, time ", other.stderr)

    def test_an_input_truncated_while_it_is_read_is_an_error(self):
        with tempfile.TemporaryDirectory(prefix="isonest-test-") as name:
            folder = pathlib.Path(name)
            path = folder / "n.raw"
            with open(path, "wb") as file:
                file.truncate(1 << 29)
            process = subprocess.Popen(
                [ISONEST, "preprocess", path, "--dims", "1024,512,1024", "--type", "uint8", "-o",
                 folder / "n.isonest"], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
            deadline = time.monotonic() + 120
            while not any(p.name.startswith(".") for p in folder.iterdir()):
                self.assertLess(time.monotonic(), deadline)
                time.sleep(0.01)
            os.truncate(path, 0)
            _, err = process.communicate(timeout=300)
            self.assertEqual(process.returncode, 6, err)
            self.assertIn(b"truncated", err)
            self.assertFalse((folder / "n.isonest").exists())

    def test_the_plugin_writes_frames_with_size_and_checksum_and_reads_them(self):
        import h5py
        import numpy
        data = numpy.arange(4096, dtype="<u2").reshape(64, 64)
        path = self.here / "plugin.h5"
        with h5py.File(path, "w") as file:
            file.create_dataset("d", data=data, chunks=(32, 64), compression=32015,
                                compression_opts=(3,))
        with h5py.File(path, "r") as file:
            numpy.testing.assert_array_equal(file["d"][...], data)
            _, frame = file["d"].id.read_direct_chunk((0, 0))
            self.assertEqual(frame[:4], b"\x28\xb5\x2f\xfd")
            self.assertEqual(frame[4] & 0x04, 0x04, "checksum")
            self.assertTrue(frame[4] & 0xE0, "content size")
        path.unlink()

    def test_the_plugin_refuses_frames_that_lie(self):
        import h5py
        import numpy
        magic = b"\x28\xb5\x2f\xfd"
        lies = {
            "no zstd": b"\0" * 64,
            "empty": b"",
            "4 GiB in 32 bytes": magic + b"\xa0" + struct.pack("<I", 0xFFFFFFFF) + b"\1" * 23,
            "2^63 bytes": magic + b"\xe0" + struct.pack("<Q", 2**63) + b"\1" * 19,
            "unknown size": magic + b"\0\x58" + b"\1\0\0",
        }
        path = self.here / "lies.h5"
        for name, frame in lies.items():
            with self.subTest(name):
                with h5py.File(path, "w") as file:
                    d = file.create_dataset("d", (64,), "u1", chunks=(64,), compression=32015)
                    d.id.write_direct_chunk((0,), frame or b"\0")
                with h5py.File(path, "r") as file, self.assertRaises(OSError):
                    numpy.array(file["d"][...])
        path.unlink()

    def test_libraries_are_not_taken_from_the_current_folder(self):
        wanted = subprocess.run(["readelf", "-d", ISONEST], capture_output=True, text=True).stdout
        names = re.findall(r"\(NEEDED\).*\[(.*)\]", wanted)
        self.assertTrue(names)
        folder = self.here / "libraries"
        folder.mkdir()
        for name in names:
            (folder / name).write_bytes(b"not a library")
        self.assertEqual(run("--version", cwd=folder).returncode, 0)


if __name__ == "__main__":
    unittest.main(argv=[sys.argv[0], *sys.argv[3:]], verbosity=1)
