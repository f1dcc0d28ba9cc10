"""isonest-mpi preprocess: the same bytes as isonest, the report of each rank, and what is refused.

usage: preprocess_ranks_test.py ISONEST PLUGIN_FOLDER
"""
import gzip
import json
import pathlib
import subprocess
import sys
import tempfile
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import ranks


class PreprocessOnRanks(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory(prefix="isonest-ranks-")
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)
        (self.folder / "scratch").mkdir()
        subprocess.run([sys.argv[1], "make-volume", "noise", "--size", "50,66,90", "--type", "uint8", "-o",
                        self.folder / "v.raw", "-q"], check=True)
        self.options = ["--dims", "50,66,90", "--type", "uint8", "--chunk", "8", "--threads", "1"]

    def on_ranks(self, count, source, *more):
        return ranks.launched(count, ranks.beside(sys.argv[1], "isonest-mpi"), "preprocess", self.folder / source,
                              "-o", self.folder / "s.isonest", *self.options, "--force", *more)

    def test_the_bytes_of_one_process_and_a_report_of_each_rank(self):
        plain = self.folder / "plain.isonest"
        subprocess.run([sys.argv[1], "preprocess", self.folder / "v.raw", "-o", plain, *self.options, "-q"], check=True)
        for count in (1, 3):
            done = self.on_ranks(count, "v.raw", "--scratch", self.folder / "scratch", "--json")
            self.assertEqual(done.returncode, 0, done.stderr)
            self.assertEqual((self.folder / "s.isonest").read_bytes(), plain.read_bytes())
            self.assertEqual(list((self.folder / "scratch").iterdir()), [])
            report = json.loads(done.stdout)
            self.assertEqual(report["store_bytes"], plain.stat().st_size)
            self.assertEqual([rank["rank"] for rank in report["ranks"]], list(range(count)))
            read = sum(rank["input_bytes"] for rank in report["ranks"])
            self.assertGreaterEqual(read, 50 * 66 * 90)
            self.assertEqual(all(rank["bytes_sent"] > 0 for rank in report["ranks"]), count > 1)
            self.assertLess(sum(rank["store_bytes"] for rank in report["ranks"]), plain.stat().st_size)

    def test_what_several_ranks_cannot_do_is_refused_and_nothing_is_left(self):
        (self.folder / "v.raw.gz").write_bytes(gzip.compress((self.folder / "v.raw").read_bytes()))
        before = sorted(self.folder.iterdir())
        done = self.on_ranks(2, "v.raw.gz")
        self.assertEqual(done.returncode, 5, done.stderr)
        self.assertIn(b"decompress it first", done.stderr)
        done = self.on_ranks(2, "v.raw", "--scratch", self.folder / "nowhere")
        self.assertEqual(done.returncode, 6, done.stderr)
        self.assertIn(b"nowhere", done.stderr)
        self.assertEqual(sorted(self.folder.iterdir()), before)

    def test_ranks_of_another_version_or_with_another_input_are_refused(self):
        program = ranks.beside(sys.argv[1], "isonest-mpi")
        version = subprocess.run([program, "--version"], capture_output=True, check=True).stdout.split()[1]
        other = self.folder / "isonest-mpi"
        numbers = version.split(b".")
        newer = b".".join([*numbers[:-1], b"%d" % ((int(numbers[-1]) + 1) % 10)])
        self.assertEqual(len(newer), len(version))
        other.write_bytes(program.read_bytes().replace(version + b"\0", newer + b"\0"))
        other.chmod(0o755)
        changed = bytearray((self.folder / "v.raw").read_bytes())
        changed[7777] ^= 1
        (self.folder / "w.raw").write_bytes(changed)
        before = sorted(self.folder.iterdir())

        def command(which, source, store="s.isonest"):
            return [which, "preprocess", self.folder / source, "-o", self.folder / store, *self.options]
        for second, told in ((command(other, "v.raw"), b"ranks 1 ("), (command(program, "w.raw"), b"different inputs")):
            done = ranks.launched_apart(command(program, "v.raw"), second)
            self.assertEqual(done.returncode, 2, done.stderr)
            self.assertIn(told, done.stderr)
            self.assertEqual(sorted(self.folder.iterdir()), before)


if __name__ == "__main__":
    ranks.require(sys.argv[1])
    unittest.main(argv=sys.argv[:1])
