"""`isonest extract` of a volume file: the same triangles as from its store for every format, and what is refused.

Usage: extract_volume_test.py ISONEST PLUGIN_FOLDER
"""
import gzip
import json
import os
import pathlib
import subprocess
import sys
import tempfile
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served  # noqa: E402

os.environ["HDF5_PLUGIN_PATH"] = sys.argv[2]
try:
    import h5py
    import nibabel
    import numpy as np
    import tifffile
    from mesh_data import read_points
except ImportError as error:
    print(f"skipped: {error}")
    sys.exit(77)

ISONEST = os.path.abspath(sys.argv[1])


def waves(shape, kind="f4"):
    z, y, x = np.meshgrid(*map(np.arange, shape), indexing="ij")
    return np.round(100 + 40 * (np.sin(x / 3) + np.cos(y / 4) + np.sin(z / 5))).astype(kind)


def triangles(path):
    """Sorted triangles, each starting at its smallest corner."""
    vertices, faces = read_points(path)
    found = []
    for a, b, c in vertices[faces].tolist():
        found.append(min((a, b, c), (b, c, a), (c, a, b)))
    return sorted(found)


class Case(unittest.TestCase):
    def setUp(self):
        temporary = tempfile.TemporaryDirectory(prefix="isonest-volume-", dir=served.MEMORY)
        self.addCleanup(temporary.cleanup)
        self.here = pathlib.Path(temporary.name)
        self.mesh = self.here / "m.ply"

    def run_program(self, *arguments):
        return served.run([ISONEST, *map(str, arguments)], capture_output=True, text=True, timeout=600)

    def works(self, *arguments):
        done = self.run_program(*arguments)
        self.assertEqual(done.returncode, 0, done.stderr)
        return done.stdout

    def fails(self, code, *arguments):
        done = self.run_program(*arguments, "-o", self.mesh)
        self.assertEqual(done.returncode, code, done.stderr)
        self.assertFalse(self.mesh.exists())
        return done.stderr

    def nrrd(self, data, name="v.nrrd"):
        kinds = {"f4": "float", "u1": "uint8", "i2": "int16"}
        path = self.here / name
        header = (f"NRRD0004\ntype: {kinds[data.dtype.str[1:]]}\ndimension: 3\nendian: little\nencoding: raw\n"
                  f"sizes: {data.shape[2]} {data.shape[1]} {data.shape[0]}\nspacings: 0.5 0.5 2\n\n")
        path.write_bytes(header.encode() + data.tobytes())
        return path


class Formats(Case):
    def same(self, *how, iso="100.5"):
        """The mesh as extracted from a store."""
        self.works("extract", *how, "--iso", iso, "-o", self.mesh)
        store, other = self.here / "s.isonest", self.here / "o.ply"
        self.works("preprocess", *how, "-o", store, "--chunk", "16", "--force")
        self.works("extract", store, "--iso", iso, "--cells", "hex", "-o", other)
        found = triangles(self.mesh)
        self.assertEqual(found, triangles(other))
        return found

    def test_every_format_has_the_surface_of_its_store(self):
        data = waves((20, 21, 22))
        self.assertGreater(len(self.same(self.nrrd(data))), 1000)
        raw = self.here / "v.raw"
        raw.write_bytes(data.astype(">f4").tobytes())
        self.same(raw, "--dims", "22,21,20", "--type", ">f4", "--spacing", "1,2,3", "--unit", "mm")
        raw.with_suffix(".gz").write_bytes(gzip.compress(data.tobytes()))
        self.same(raw.with_suffix(".gz"), "--dims", "22,21,20", "--type", "f4")
        with h5py.File(self.here / "v.h5", "w") as file:
            file.create_dataset("first/v", data=data, chunks=(8, 8, 8), compression="gzip")
            file["second"] = data[:5]
        self.same(self.here / "v.h5", "--dataset", "/first/v")
        self.same(self.here / "v.h5", "--dataset", "second", "--every", "2")
        tifffile.imwrite(self.here / "v.tif", data, photometric="minisblack", metadata=None)
        self.same(self.here / "v.tif")
        stack = self.here / "stack"
        stack.mkdir()
        for z, plane in enumerate(data.astype("u1")):
            tifffile.imwrite(stack / f"{z:03}.tif", plane, photometric="minisblack", metadata=None)
        self.same(stack)
        self.same(*sorted(stack.iterdir()))
        np.save(self.here / "v.npy", data)
        self.same(self.here / "v.npy", "--crop", "3:,:-2,1:9")

    def test_a_turned_volume_lies_where_its_store_has_it(self):
        affine = np.array([[0, -2, 0, 5], [1, 0, 0, 6], [0, 0, 3, 7], [0, 0, 0, 1.0]])
        image = nibabel.Nifti1Image(waves((20, 21, 22)).T, affine)
        nibabel.save(image, self.here / "v.nii.gz")
        self.same(self.here / "v.nii.gz")

    def test_missing_values_plateaus_and_small_volumes(self):
        data = waves((20, 21, 22))
        self.same(self.nrrd(data), iso="100")
        self.same(self.nrrd(data), "--missing", "120", iso="110")
        data[5:8, :, 3] = np.nan
        self.same(self.nrrd(data))
        self.same(self.nrrd(waves((2, 2, 2)) + np.arange(2, dtype="f4")), iso="159")
        self.assertEqual(self.same(self.nrrd(np.ones((9, 9, 9), "f4")), iso="1"), [])

    def test_standard_input_is_a_volume(self):
        path = self.nrrd(waves((20, 21, 22)))
        self.works("extract", path, "--iso", "100.5", "-o", self.mesh)
        with open(path, "rb") as file:
            subprocess.run([ISONEST, "extract", "-", "--iso", "100.5", "-o", self.here / "p.ply", "-q"], stdin=file,
                           check=True)
        self.assertEqual(self.mesh.read_bytes(), (self.here / "p.ply").read_bytes())


class Bytes(Case):
    def test_threads_and_memory_change_no_byte(self):
        path = self.nrrd(waves((24, 60, 64), "u1"))
        for options in ([], ["--normals", "--components", "largest"],
                        ["--distance", "0.5voxel", "--effort", "fast"], ["--triangles", "2000"]):
            meshes = set()
            for threads, memory in ((1, "1G"), (2, "48M"), (7, "1G")):
                self.works("extract", path, "--iso", "100", "--threads", threads, "--memory", memory, "-o", self.mesh,
                           *options)
                meshes.add(self.mesh.read_bytes())
            self.assertEqual(len(meshes), 1, options)
        self.assertEqual(sorted(os.listdir(self.here)), ["m.ply", "v.nrrd"])

    def test_the_report_says_what_was_done(self):
        path = self.nrrd(waves((20, 21, 22)))
        said = json.loads(self.works("extract", path, "--iso", "100.5", "--unit", "mm", "--distance", "200um", "--json",
                                     "-o", self.mesh))
        self.assertTrue(said["without_store"])
        self.assertEqual(said["unit"], "mm")
        self.assertEqual(said["distance"], 0.2)
        self.assertLessEqual(said["distance_bound"], 0.2)
        self.assertLess(said["triangles"], said["full_triangles"])
        self.assertGreater(said["area"], 0)
        text = self.works("extract", path, "--iso", "1000", "-o", self.mesh)
        self.assertIn("every value is below 1000; values are ", text)
        self.assertNotIn(" chunks", text)  # of a store


# What can be requested of a surface in addition to its isovalue; a store needs no field beyond the default for it.
OPTIONS = [["--error", "2"], ["--indicator", "plus"], ["--stop", "linf_plus", "--threshold", "3"], ["--focus", "3,4,5", "--falloff", "0.2"],
           ["--camera", "-9,0,0", "--pixels", "4", "--height", "64"], ["--box", "0.7,1.1,2.3,4.2,4.4,9.1"], ["--close"], ["--close=above"], ["--cells", "tet"],
           ["--cells", "hex"], ["--vertices", "exact"], ["--bound", "linf_plus"], ["--vertex-error", "deviation_bar"], ["--normals"], ["--quality"],
           ["--distance", "0.4voxel"], ["--effort", "fast"], ["--effort", "none"], ["--triangles", "300"], ["--by", "error"],
           ["--components", "largest"], ["--min-component", "20"], ["--min-volume", "0.5"], ["--volume-interval"], ["--space", "lps"],
           ["--vertex-values", "{other}"]]


class AnyOption(Case):
    """The same command on a volume and on its store: the same bytes, or the same refusal."""

    def setUp(self):
        super().setUp()
        data = waves((15, 16, 17))
        data[9:, 9:, 9:] = np.nan
        self.volume = self.nrrd(data)
        self.store, self.other = self.here / "s.isonest", self.here / "other.isonest"
        # Includes the fields for `--cells hex --error`, which are computed on demand for a volume.
        self.works("preprocess", self.volume, "-o", self.store, "--indicators", "linf_bar,linf_plus,deviation_bar,hex_linf,hex_deviation")
        self.works("preprocess", self.nrrd(waves((15, 16, 17)) ** 2, "o.nrrd"), "-o", self.other)

    def both(self, options, name="m.ply", iso=("--iso", "100.5")):
        """The exit code, and whether a store was made."""
        options = [word.format(other=self.other) for word in options]
        results = []
        for source in (self.volume, self.store):
            mesh = self.here / name
            mesh.unlink(missing_ok=True)
            done = self.run_program("extract", source, *iso, *options, "-o", mesh, "--json")
            said = done.stderr.replace(str(source), "INPUT")
            results.append((done.returncode, said, mesh.read_bytes() if mesh.exists() else None))
            self.assertIn(done.returncode, (0, 2), (options, done.stderr))
            if source == self.volume and done.returncode == 0:
                made = "made_store" in json.loads(done.stdout)
        self.assertEqual(results[0], results[1], options)
        self.assertFalse([name for name in os.listdir(self.here) if name.startswith(".")])
        return results[0][0], results[0][0] == 0 and made

    def test_every_pair_of_options_gives_the_mesh_of_the_store_or_is_refused_as_there(self):
        works = refused = 0
        for i, first in enumerate(OPTIONS):
            for second in OPTIONS[i + 1:]:
                if first[0] == second[0] or (first[0].startswith("--close") and second[0].startswith("--close")):
                    continue
                options = first + second
                if set(options) <= {"--cells", "hex", "--normals", "--quality", "--space", "lps", "--effort", "none"}:
                    continue  # neither option changes the surface
                with self.subTest(options=options):
                    code, _ = self.both(options)
                    works, refused = works + (code == 0), refused + (code != 0)
        print(f"{works} pairs work, {refused} are refused")
        self.assertGreater(works, 150)

    def test_full_resolution_makes_no_store_and_all_else_does(self):
        for options in (["--close"], ["--box", "0.7,1.1,2.3,4.2,4.4,9.1"], ["--cells", "tet"],
                        ["--distance", "0.4voxel", "--close"], ["--components", "largest"],
                        ["--triangles", "300", "--effort", "fast"], ["--close=above", "--cells", "tet", "--normals"]):
            with self.subTest(options=options):
                self.assertEqual(self.both(options), (0, False))
        for options in (["--error", "2"], ["--vertices", "exact"], ["--vertex-error", "linf_bar"]):
            with self.subTest(options=options):
                self.assertEqual(self.both(options), (0, True))

    def test_labels_planes_and_several_isovalues(self):
        np.save(self.here / "l.npy", (waves((15, 16, 17)) > 100).astype("i8") + (waves((15, 16, 17)) > 120))
        np.save(self.here / "p.npy", waves((15, 16, 17))[3])
        for name, labels, options, mesh in (("l", ["--labels"], ["--label", "2"], "m.ply"),
                                            ("l", ["--labels"], ["--label", "1", "--smooth", "--close"], "m.ply"),
                                            ("p", [], ["--iso", "100.5"], "m.vtp"), ("p", [], ["--graph", "--scale", "2"], "m.ply"),
                                            ("p", [], ["--iso", "100.5", "--distance", "0.3"], "m.vtp")):
            self.volume, self.store = self.here / f"{name}.npy", self.here / f"{name}.isonest"
            self.works("preprocess", self.volume, "-o", self.store, "--force", *labels)
            with self.subTest(options=options):
                self.assertEqual(self.both(options, mesh, iso=()), (0, True))
        self.volume, self.store = self.here / "v.nrrd", self.here / "s.isonest"
        for source, name in ((self.volume, "a"), (self.store, "b")):
            self.works("extract", source, "--iso", "90,100.5", "--error", "1", "-o", self.here / (name + "_{iso}.ply"))
        for iso in ("90", "100.5"):
            self.assertEqual((self.here / f"a_{iso}.ply").read_bytes(), (self.here / f"b_{iso}.ply").read_bytes())

    def test_fields_beyond_the_default_are_made(self):
        for options, fields in ((["--error", "2", "--cells", "hex", "--effort", "none"], "hex_deviation"),
                                (["--error", "2", "--view", "1,0,0"], "normal_turn_plus"),
                                (["--error", "2", "--view", "1,0,0", "--cull-by", "grad_linf_plus"], "grad_linf_plus"),
                                (["--stop", "normal_bar", "--threshold", "0.2"], "normal_bar")):
            self.works("preprocess", self.volume, "-o", self.store, "--force", "--indicators",
                       f"linf_plus,deviation_bar,{fields}")
            with self.subTest(options=options):
                self.assertEqual(self.both(options), (0, True))

    def test_a_kept_store_is_that_of_preprocess_and_nothing_else_stays(self):
        before = set(os.listdir(self.here))
        kept = self.here / "kept.isonest"
        said = json.loads(self.works("extract", self.volume, "--iso", "100.5", "--keep-store", kept, "--json", "-o", self.mesh))
        self.assertEqual(said["made_store"]["kept"], str(kept))
        self.works("preprocess", self.volume, "-o", self.here / "own.isonest")
        self.assertEqual(kept.read_bytes(), (self.here / "own.isonest").read_bytes())
        self.mesh.unlink()
        self.assertIn("kept.isonest", self.fails(2, "extract", self.volume, "--iso", "1", "--keep-store", kept))
        self.assertIn("--keep-store", self.fails(2, "extract", self.store, "--iso", "1", "--keep-store", self.here / "x"))
        self.assertIn("--keep-store", self.fails(2, "extract", self.volume, "--iso", "1", "--distance", "1", "--keep-analysis"))
        self.assertEqual(set(os.listdir(self.here)), before | {"kept.isonest", "own.isonest"})

    def test_slice_and_histogram_of_a_volume_are_those_of_its_store(self):
        for options, name in ((["--plane", "1,2,3,24", "--error", "3"], "p.png"), (["--plane", "1,2,3,24"], "m.vtp"),
                              (["--plane", "0,0,1,4", "--contours", "90,110"], "m.vtp")):
            meshes = []
            for source in (self.volume, self.store):
                self.works("slice", source, *options, "-o", self.here / name)
                meshes.append((self.here / name).read_bytes())
            self.assertEqual(*meshes, options)
        one, two = (json.loads(self.works("info", source, "--histogram", "--json")) for source in (self.volume, self.store))
        self.assertEqual(one["histogram"], two["histogram"])
        said = json.loads(self.works("info", self.volume, "--json"))
        self.assertEqual((said["nodes"], said["spacing"], said["type"]), ([17, 16, 15], [0.5, 0.5, 2], "float32"))

    def test_threads_and_memory_change_no_byte(self):
        path = self.nrrd(waves((40, 90, 88), "u1"), "large.nrrd")
        for options in (["--close", "--distance", "0.5voxel"], ["--cells", "tet", "--normals", "--close=above"], ["--error", "3"]):
            meshes = set()
            for threads, memory in ((1, "1G"), (2, "56M"), (7, "1G"), (2, "64M")):
                self.works("extract", path, "--iso", "100", "--threads", threads, "--memory", memory, "-o", self.mesh, *options)
                meshes.add(self.mesh.read_bytes())
            self.assertEqual(len(meshes), 1, options)


class Refused(Case):
    def test_what_makes_no_sense_is_refused_before_a_store_is_made(self):
        path = self.nrrd(waves((9, 10, 11)))
        self.assertIn("--iso", self.fails(2, "extract", path))
        self.assertIn("distance", self.fails(2, "extract", path, "--iso", "100", "--effort", "fast"))
        self.assertIn("--unit", self.fails(2, "extract", path, "--iso", "100", "--distance", "1mm"))
        self.assertIn("backface culling", self.fails(2, "extract", path, "--iso", "100", "--close", "--view", "1,0,0", "--error", "1"))

    def test_a_file_that_is_no_volume_says_what_there_is(self):
        with h5py.File(self.here / "v.h5", "w") as file:
            file["a"] = file["b"] = waves((9, 10, 11))
        for options in ([], ["--dataset", "c"]):
            said = self.fails(2 if not options else 3, "extract", self.here / "v.h5", "--iso", "100", *options)
            self.assertIn("/a", said)
            self.assertIn("/b", said)
        junk = self.here / "junk"
        junk.write_bytes(b"hello world" * 100)
        said = self.fails(2, "extract", junk, "--iso", "100")
        self.assertIn("NRRD", said)
        self.assertIn("--dims", said)
        self.fails(3, "extract", self.here / "nothing.nrrd", "--iso", "100")
        path = self.nrrd(waves((9, 10, 11)))
        path.write_bytes(path.read_bytes()[:-100])
        self.assertIn("v.nrrd", self.fails(2, "extract", path, "--iso", "100"))

    def test_a_store_is_not_read_as_a_volume(self):
        store = self.here / "s.isonest"
        self.works("preprocess", self.nrrd(waves((9, 10, 11))), "-o", store)
        self.assertIn("is a store", self.fails(2, "extract", store, "--iso", "100", "--crop", ":,:,2:"))
        self.assertIn("surplus", self.fails(3, "extract", store, "surplus", "--iso", "100"))
        store.write_bytes(store.read_bytes()[:store.stat().st_size // 2])
        self.assertNotIn("volume file", self.fails(4, "extract", store, "--iso", "100"))

    def test_the_volume_is_not_replaced(self):
        path = self.nrrd(waves((9, 10, 11)), "v.ply")
        before = path.read_bytes()
        self.assertEqual(self.run_program("extract", path, "--iso", "100", "-o", path).returncode, 2)
        self.assertEqual(path.read_bytes(), before)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
