"""isonest-mpi extract and check: the same bytes, findings and exit codes as isonest, for several numbers of ranks.

usage: extract_ranks_test.py ISONEST PLUGIN_FOLDER
"""
import json
import pathlib
import subprocess
import sys
import tempfile
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import ranks

ISONEST = sys.argv[1]


class ExtractRanks(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory(prefix="isonest-ranks-")
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)
        self.store = self.folder / "s.isonest"
        volume = self.folder / "v.h5"
        subprocess.run([ISONEST, "make-volume", "bucky", "--size", "65", "-o", volume, "-q"], check=True)
        subprocess.run([ISONEST, "preprocess", volume, "-o", self.store, "--chunk", "16", "-q"], check=True)

    def launched(self, count, *arguments):
        return ranks.launched(count, ranks.beside(ISONEST, "isonest-mpi"), *arguments)

    def extracted(self, count, mesh, *arguments):
        command = ["extract", self.store, *arguments, "-o", mesh, "--json", "-q"]
        done = self.launched(count, *command) if count else \
            subprocess.run([ISONEST, *map(str, command)], capture_output=True, check=False)
        self.assertEqual(done.returncode, 0, done.stderr)
        return json.loads(done.stdout)

    def test_meshes_are_those_of_one_process(self):
        for arguments in (["--iso", "0.5"], ["--iso", "0.4", "--error-relative", "0.01", "--normals"],
                          ["--iso", "0.5", "--distance", "0.5", "--effort", "fast"],
                          ["--iso", "0.5", "--triangles", "3000", "--by", "error"]):
            plain = self.folder / "plain.vtp"
            expected = self.extracted(0, plain, *arguments)
            for count in (1, 2, 3):
                with self.subTest(arguments=arguments, ranks=count):
                    mesh = self.folder / "ranks.vtp"
                    report = self.extracted(count, mesh, *arguments)
                    self.assertEqual(mesh.read_bytes(), plain.read_bytes())
                    for key in ("vertices", "triangles", "error_bound", "leaves"):
                        self.assertEqual(report.get(key), expected.get(key), key)
                    self.assertEqual(len(report["ranks"]), count)
                    self.assertTrue(all(r["leaves"] > 0 for r in report["ranks"]))

    def test_uneven_axes_are_those_of_each_rank(self):
        numbers = " ".join(str(round(8 - ((x - 9)**2 + (y - 8)**2 + (z - 9)**2)**0.5, 4))
                           for z in range(19) for y in range(17) for x in range(20))
        axes = "".join(f'<DataArray type="Float64" format="ascii">{" ".join(str(i + i * i / 9) for i in range(n))}</DataArray>'
                       for n in (20, 17, 19))
        volume = self.folder / "v.vtr"
        volume.write_text('<VTKFile type="RectilinearGrid"><RectilinearGrid WholeExtent="0 19 0 16 0 18"><Piece>'
                          f'<PointData><DataArray type="Float32" Name="v" format="ascii">{numbers}</DataArray></PointData>'
                          f'<Coordinates>{axes}</Coordinates></Piece></RectilinearGrid></VTKFile>')
        subprocess.run([ISONEST, "preprocess", volume, "-o", self.store, "--chunk", "8", "-q", "--force"], check=True)
        for arguments in (["--normals"], ["--cells", "tet"], ["--distance", "0.5", "--effort", "fast"]):
            plain, mesh = self.folder / "plain.ply", self.folder / "ranks.ply"
            self.extracted(0, plain, "--iso", "2.2", *arguments)
            for count in (2, 3):
                self.extracted(count, mesh, "--iso", "2.2", *arguments)
                self.assertEqual(mesh.read_bytes(), plain.read_bytes(), (arguments, count))

    def test_all_ranks_write_a_mesh_that_no_stage_changes(self):
        for end in ("ply", "stl", "vtkhdf"):
            plain, mesh = self.folder / f"plain.{end}", self.folder / f"ranks.{end}"
            expected = self.extracted(0, plain, "--iso", "0.5", "--quality")
            for count in (1, 2, 3, 4, 7):
                with self.subTest(end=end, ranks=count):
                    report = self.extracted(count, mesh, "--iso", "0.5", "--quality")
                    self.assertEqual(mesh.read_bytes(), plain.read_bytes())
                    for key in ("vertices", "triangles", "error_bound", "area", "volume", "smallest_angle"):
                        self.assertEqual(report.get(key), expected.get(key), key)
                    self.assertEqual([r["meshes"] for r in report["ranks"]], [int(count > 1)] * count)
                    if count > 1:
                        self.assertEqual(sum(r["written_triangles"] for r in report["ranks"]), report["triangles"])
            self.assertEqual(sorted(path.name for path in self.folder.iterdir()),
                             sorted({plain.name, mesh.name, "s.isonest", "v.h5"}))
            plain.unlink()
            mesh.unlink()

    def test_several_isovalues_are_shared(self):
        self.extracted(0, self.folder / "plain_{iso}.ply", "--iso", "0.3,0.5")
        self.extracted(3, self.folder / "ranks_{iso}.ply", "--iso", "0.3,0.5")
        for iso in ("0.3", "0.5"):
            self.assertEqual((self.folder / f"ranks_{iso}.ply").read_bytes(),
                             (self.folder / f"plain_{iso}.ply").read_bytes())

    def test_what_rank_0_does_alone_it_says(self):
        mesh, plain = self.folder / "m.ply", self.folder / "plain.ply"
        arguments = ["--iso", "0.5", "--distance", "1", "--effort", "none"]
        self.extracted(0, plain, *arguments)
        done = self.launched(2, "extract", self.store, *arguments, "-o", mesh)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn(b"alone", done.stdout)
        self.assertEqual(mesh.read_bytes(), plain.read_bytes())

    def test_an_output_that_cannot_be_ends_all(self):
        done = self.launched(3, "extract", self.store, "--iso", "0.5", "-o", self.folder / "no" / "m.ply")
        self.assertNotEqual(done.returncode, 0)
        self.assertIn(b"m.ply", done.stderr)
        self.assertEqual(sorted(path.name for path in self.folder.iterdir()), ["s.isonest", "v.h5"])

    def test_what_is_not_one_store_to_all_ranks_is_refused(self):
        other = self.folder / "o.isonest"
        subprocess.run([ISONEST, "preprocess", self.folder / "v.h5", "-o", other, "--chunk", "32", "-q"], check=True)
        program = ranks.beside(ISONEST, "isonest-mpi")
        mesh = self.folder / "m.ply"
        for pair in ((self.store, other), (self.store, self.folder / "v.h5"), (self.folder / "v.h5", self.store)):
            done = ranks.launched_apart(*([program, "extract", path, "--iso", "0.5", "-o", mesh] for path in pair))
            self.assertEqual(done.returncode, 2, done.stderr)
            self.assertIn(b"not on ranks 1 (", done.stderr)
            self.assertFalse(mesh.exists())
        for pair in ((self.store, other), (other, self.store)):
            done = ranks.launched_apart(*([program, "extract", self.store, "--iso", "0.5", "--vertex-values", path,
                                           "-o", mesh] for path in pair))
            self.assertEqual(done.returncode, 2, done.stderr)
            self.assertIn(f"{pair[0]}: is a store, but not on ranks 1 (".encode(), done.stderr)
            self.assertFalse(mesh.exists())
        done = ranks.launched_apart(*([program, "check", path] for path in (self.store, other)))
        self.assertEqual(done.returncode, 2, done.stderr)
        self.assertIn(b"not on ranks 1 (", done.stderr)

    def test_folders_that_are_not_one_to_all_ranks_are_refused(self):
        program = ranks.beside(ISONEST, "isonest-mpi")
        for choice, end in ((["--labels", "all"], ""), (["--iso", "0.5"], "{iso}/m.ply")):
            folders = [self.folder / name for name in ("a", "b")]
            for folder in folders:
                (folder / "0.5").mkdir(parents=True, exist_ok=True)
            done = ranks.launched_apart(*([program, "extract", self.store, *choice, "-o", folder / end]
                                          for folder in folders))
            self.assertEqual(done.returncode, 2, done.stderr)
            self.assertIn(b"its folder is not shared", done.stderr)
            for folder in folders:
                self.assertEqual([path.name for path in folder.rglob("*")], ["0.5"])

    def test_findings_are_those_of_one_process(self):
        data = bytearray(self.store.read_bytes())
        for damaged in (False, True):
            if damaged:
                for at in range(len(data) // 2, len(data) // 2 + 20000, 4000):
                    data[at] ^= 255
                self.store.write_bytes(data)
            plain = subprocess.run([ISONEST, "check", self.store, "--deep", "--json", "-q"], capture_output=True,
                                   check=False)
            self.assertEqual(plain.returncode, 4 if damaged else 0, plain.stderr)
            for count in (2, 3):
                done = self.launched(count, "check", self.store, "--deep", "--json", "-q")
                self.assertEqual(done.returncode, plain.returncode, done.stderr)
                report = json.loads(done.stdout)
                self.assertEqual(len(report.pop("ranks")), count)
                self.assertEqual(report, json.loads(plain.stdout))


if __name__ == "__main__":
    ranks.require(ISONEST)
    unittest.main(argv=[sys.argv[0], *sys.argv[3:]])
