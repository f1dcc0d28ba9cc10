"""Stores of rounded values: what they hold, and that every bound holds for the original volume.

The volume's values, the finest piecewise linear function and its differences on meshes are computed here, from the
array that was written to the input file.

Usage: tolerance_test.py ISONEST PLUGIN_FOLDER
"""
import ctypes
import gzip
import json
import os
import pathlib
import subprocess
import sys
import tempfile
import unittest

HERE = pathlib.Path(__file__).resolve()
sys.path.insert(0, str(HERE.parents[1] / "support"))
sys.path.insert(0, str(HERE.parents[2] / "tools" / "bench"))
import served  # noqa: E402
from mesh_data import read_ply  # noqa: E402
from verify_surfaces import finest  # noqa: E402

ISONEST, PLUGINS = os.path.abspath(sys.argv[1]), sys.argv[2]
os.environ["HDF5_PLUGIN_PATH"] = PLUGINS

import h5py  # noqa: E402  (the plugin path must be set first)
import numpy as np  # noqa: E402

SHAPE = (21, 26, 35)


def run(*arguments):
    return served.run([ISONEST, *map(str, arguments)], capture_output=True, text=True, timeout=600)


def asked(*arguments):
    done = run(*arguments, "--json")
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def volume(dtype, noise=0.02):
    """Two smooth bumps with noise, over most of the type's range or, for floating point, from -40 to 60."""
    z, y, x = np.mgrid[:SHAPE[0], :SHAPE[1], :SHAPE[2]]
    u = np.sin(x * 0.21) * np.cos(y * 0.27) + 0.5 * np.cos(z * 0.33)
    u = (u - u.min()) / (u.max() - u.min()) + noise * np.random.default_rng(1).standard_normal(SHAPE)
    if np.dtype(dtype).kind == "f":
        return (100 * u - 40).astype(dtype)
    info = np.iinfo(dtype)
    low, high = max(info.min, -20000), min(info.max, 45000)
    return np.clip(low + (high - low) * np.clip(u, 0.02, 0.98), low, high).astype(dtype)


def trilinear(u, p):
    """The trilinear function at points p (x, y, z) in the volume."""
    high = np.array(u.shape[::-1]) - 1
    cell = np.clip(np.floor(p).astype(np.int64), 0, high - 1)
    t = p - cell
    value = np.zeros(len(p))
    for corner in np.ndindex(2, 2, 2):
        x, y, z = (cell + corner).T
        value += u[z, y, x].astype(float) * np.where(corner, t, 1 - t).prod(axis=1)
    return value


def residual(function, u, p, t, iso):
    """The largest difference from the isovalue at vertices and at points of the triangles."""
    random = np.random.default_rng(1)
    corners = p[t]
    inside = [np.einsum("ij,ijk->ik", random.dirichlet((1, 1, 1), len(t)), corners) for _ in range(4)]
    return max(np.abs(function(u, q) - iso).max() for q in (p, *inside))


def points_of(path):
    vertices, triangles = read_ply(path)
    return np.stack([vertices[axis] for axis in "xyz"], axis=1).astype(float), triangles.astype(np.int64), vertices


class Tolerance(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory(dir=served.MEMORY)
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)

    def input(self, u, name="v.npy"):
        np.save(self.folder / name, u)
        return self.folder / name

    def store(self, u, *options, name="s.isonest"):
        path = self.folder / name
        report = asked("preprocess", self.input(u), "-o", path, "--force", "--chunk", 16, *options)
        return path, report

    def values(self, path):
        with h5py.File(path) as file:
            return file["levels/0/values"][...]

    def test_values_are_multiples_of_the_step_within_the_tolerance(self):
        for dtype, choice in (("u1", "3"), ("u1", "1%"), ("i1", "bits:3"), ("u2", "0.5%"), ("i2", "100"), ("u2", "bits:7"),
                              ("i4", "0.3%"), ("u4", "77"), ("f4", "0.5%"), ("f4", "0.3"), ("f8", "auto"), ("f4", "auto")):
            with self.subTest(dtype=dtype, choice=choice):
                u = volume(dtype)
                if dtype == "f4":
                    u[3, 4, 5:9], u[0, 0, 0] = np.nan, np.inf
                path, report = self.store(u, "--tolerance", choice)
                tolerance, step = report["tolerance"], report["tolerance_step"]
                finite = u[np.isfinite(u)].astype("f8")
                limit = (float(choice) if choice[-1].isdigit() and ":" not in choice
                         else float(choice[:-1]) / 100 * (finite.max() - finite.min()) if choice.endswith("%")
                         else 2.0 ** int(choice[5:]) / 2 if choice.startswith("bits")
                         else 0.6 * 0.02 * 100)  # half of the noise, with room for the estimate
                self.assertTrue(limit / 4 < tolerance <= limit, (tolerance, limit))
                v = self.values(path)
                self.assertTrue(np.array_equal(np.isfinite(u), np.isfinite(v)))
                w = v[np.isfinite(v)].astype("f8")
                self.assertLessEqual(np.abs(w - finite).max(), tolerance)
                self.assertGreater(np.abs(w - finite).max(), tolerance / 2)
                self.assertTrue((np.remainder(w, step) == 0).all())
                info = asked("info", path)
                self.assertEqual((info["format"], info["tolerance"], info["tolerance_step"]), ("2.13", tolerance, step))
                self.assertIn(f"multiples of {step:.6g}", run("info", path).stdout)

    def test_header_says_so_and_older_readers_refuse(self):
        path, report = self.store(volume("u2"), "--tolerance", "0.5%")
        with h5py.File(path) as file:
            numbers = file.attrs["tolerance"]
            self.assertEqual(numbers.tolist(), [report["tolerance"], report["tolerance_step"]])
            xxhash = ctypes.CDLL("libxxhash.so.0")
            xxhash.XXH64.restype = ctypes.c_uint64
            xxhash.XXH64.argtypes = [ctypes.c_char_p, ctypes.c_size_t, ctypes.c_uint64]
            self.assertEqual(xxhash.XXH64(numbers.astype("<f8").tobytes(), 16, 0), int(file.attrs["tolerance_xxh64"]))
            # A bit that readers of 2.12 and before do not know, so they refuse the store.
            self.assertEqual(int(file.attrs["flags"]) & 64, 64)
            self.assertEqual(list(file.attrs["version"]), [2, 13])

    def test_a_changed_or_missing_tolerance_is_damage(self):
        path, _ = self.store(volume("u2"), "--tolerance", "0.5%")
        whole = path.read_bytes()

        def damaged(change):
            path.write_bytes(whole)
            with h5py.File(path, "r+") as file:
                change(file.attrs)
            done = run("info", path)
            self.assertEqual(done.returncode, 4, done.stderr)
            self.assertIn("tolerance", done.stderr)

        damaged(lambda attributes: attributes.modify("tolerance", np.array([1.0, 2.0])))
        damaged(lambda attributes: attributes.__delitem__("tolerance"))
        damaged(lambda attributes: attributes.__delitem__("tolerance_xxh64"))

    def test_no_tolerance_changes_no_byte(self):
        u = volume("i2")
        plain, _ = self.store(u, name="plain.isonest")
        for i, choice in enumerate(("0", "0%", "bits:0", "0.4")):
            same, report = self.store(u, "--tolerance", choice, name=f"{i}.isonest")
            self.assertEqual(plain.read_bytes(), same.read_bytes(), choice)
            self.assertEqual(report["tolerance"], 0)

    def test_same_bytes_for_any_threads_memory_and_input(self):
        u = volume("f4")
        path, _ = self.store(u, "--tolerance", "0.5%")
        whole = path.read_bytes()
        for options in (("--threads", 1), ("--memory", "96M")):
            self.assertEqual(whole, self.store(u, "--tolerance", "0.5%", *options)[0].read_bytes(), options)
        stream = self.folder / "v.npy.gz"  # can be read only forwards, so it is opened again
        stream.write_bytes(gzip.compress(self.input(u).read_bytes()))
        asked("preprocess", stream, "-o", path, "--force", "--chunk", 16, "--tolerance", "0.5%")
        self.assertEqual(whole, path.read_bytes())

    def test_surfaces_and_slices_are_within_the_bound_of_the_given_volume(self):
        for dtype, choice in (("u1", "2%"), ("i2", "1%"), ("u2", "bits:9"), ("f4", "1%"), ("f8", "1%")):
            u = volume(dtype)
            path, report = self.store(u, "--tolerance", choice, "--indicators",
                                      "linf_plus,deviation_bar,hex_deviation")
            tolerance, step = report["tolerance"], report["tolerance_step"]
            span = float(u.max()) - float(u.min())
            # A multiple of the step: plateaus at the isovalue.
            iso = float(np.round((float(u.min()) + 0.6 * span) / step) * step)
            slack = 1e-4 * span
            mesh = self.folder / "m.ply"
            for error in (0, tolerance, 1.5 * tolerance, 0.05 * span):
                for options in (("--cells", "tet", "--effort", "none"), ("--cells", "tet"),
                                ("--cells", "tet", "--effort", "none", "--vertices", "exact"),
                                ("--cells", "tet", "--indicator", "plus", "--effort", "none"),
                                ("--cells", "hex", "--effort", "none"), ("--cells", "hex", "--effort", "fast")):
                    if error == 0 and "none" not in options:
                        continue
                    with self.subTest(dtype=dtype, error=error, options=options):
                        r = asked("extract", path, "--iso", repr(iso), "--error", repr(error), *options, "-o", mesh)
                        p, t, _ = points_of(mesh)
                        self.assertGreater(len(t), 0)
                        self.assertEqual(r["tolerance"], error)
                        self.assertEqual(r["data_tolerance"], tolerance)
                        self.assertGreaterEqual(r["error_bound"], tolerance)
                        if "exact" not in options:
                            self.assertLessEqual(r["error_bound"], max(error, tolerance))
                        most = max(r["error_bound"], r.get("full_error_bound") or 0)
                        if "hex" not in options:
                            self.assertLessEqual(residual(finest, u, p, t, iso), most + slack)
                        elif "full_error_bound" in r:
                            self.assertLessEqual(residual(trilinear, u, p, t, iso), most + slack)
                        elif error <= tolerance:  # at full resolution, vertices on edges are those of the function
                            p = p[(np.abs(p - p.round()) < 1e-4).sum(axis=1) >= 2]
                            self.assertLessEqual(np.abs(trilinear(u, p) - iso).max(), most + slack)
                plane = self.folder / "p.ply"
                r = asked("slice", path, "--plane", "0.3,0.2,1,14", "--error", repr(error), "-o", plane)
                p, _, vertices = points_of(plane)
                off = np.abs(finest(u, p) - vertices["value"]).max()
                self.assertLessEqual(off, r["error_bound"] + slack)
                self.assertLessEqual(r["error_bound"], max(error, tolerance) + r["value_rounding"])
            # Without an error, the surface at full resolution is within the tolerance.
            self.assertEqual(asked("extract", path, "--iso", repr(iso), "-o", mesh)["error_bound"], tolerance)
            r = asked("extract", path, "--iso", repr(iso), "--triangles", 600, "--by", "error", "-o", mesh)
            p, t, _ = points_of(mesh)
            most = max(r["error_bound"], r.get("full_error_bound") or 0)
            self.assertLessEqual(residual(trilinear if "leaf_hexahedra" in r else finest, u, p, t, iso), most + slack)
            self.assertLessEqual(r["error_bound"], r["tolerance"])

    def test_the_interval_of_the_volume_contains_that_of_the_given_surface(self):
        u = volume("f4")
        plain, _ = self.store(u, name="plain.isonest")
        path, report = self.store(u, "--tolerance", "2%")
        mesh = self.folder / "m.ply"
        full = asked("extract", plain, "--iso", 20, "--cells", "tet", "--close", "-o", mesh)["volume"]
        for error in (0, 3 * report["tolerance"]):
            r = asked("extract", path, "--iso", 20, "--error", error, "--close", "--volume-interval", "-o", mesh)
            low, high = r["full_volume_interval"]
            self.assertTrue(low < full < high, (low, full, high))

    def test_an_error_below_the_tolerance_is_refused(self):
        path, report = self.store(volume("u2"), "--tolerance", "0.5%")
        tolerance = report["tolerance"]
        for command in (("extract", path, "--iso", 20000), ("slice", path, "--plane", "0,0,1,9")):
            done = run(*command, "--error", tolerance / 2, "-o", self.folder / "m.ply")
            self.assertEqual(done.returncode, 2, done.stderr)
            self.assertIn(f"rounded within {tolerance:.6g}", done.stderr)
            self.assertFalse((self.folder / "m.ply").exists())

    def test_reports_of_distances_say_that_values_are_rounded(self):
        path, report = self.store(volume("u2"), "--tolerance", "0.5%")
        done = run("extract", path, "--iso", 20000, "--distance", 0.5, "-o", self.folder / "m.ply")
        self.assertIn(f"rounded within {report['tolerance']:.6g}, which the distance does not include", done.stdout)

    def test_check_compares_within_the_tolerance(self):
        for dtype in ("u2", "f4"):
            u = volume(dtype)
            if dtype == "f4":
                u[2, 2, 2] = np.nan
            path, report = self.store(u, "--tolerance", "0.5%")
            done = run("check", path, "--source", self.folder / "v.npy")
            self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
            self.assertIn(f"values within {report['tolerance']:.6g} of the source's", done.stdout)
            u[7, 8, 9] += np.asarray(2 * report["tolerance"] + 1, u.dtype)
            found = json.loads(run("check", path, "--source", self.input(u), "--json").stdout)
            self.assertEqual([f["node"] for f in found["findings"]], [[9, 8, 7]])
            self.assertEqual(found["findings"][0]["test"], "source")

    def test_labels_streams_and_wrong_tolerances_are_refused(self):
        u = volume("u2")
        path = self.input(u)
        out = self.folder / "o.isonest"
        for choice in ("-1", "nan", "101%", "bits:16", "bits:x", "many", "", "70000"):
            done = run("preprocess", path, "-o", out, f"--tolerance={choice}")
            self.assertEqual(done.returncode, 2, (choice, done.stderr))
            self.assertIn("tolerance", done.stderr)
        self.assertEqual(run("preprocess", path, "-o", out, "--tolerance", "5", "--labels").returncode, 2)
        self.assertEqual(run("preprocess", self.input(volume("f4"), "f.npy"), "-o", out, "--tolerance", "bits:2").returncode, 2)
        stream = [ISONEST, "preprocess", "-", "-o", str(out), "--dims", "35,26,21", "--type", "uint16", "--tolerance"]
        refused = subprocess.run([ISONEST, "preprocess", "-", "-o", str(out), "--tolerance", "1%"],
                                 input=gzip.compress(path.read_bytes()), capture_output=True, check=False)
        self.assertEqual(refused.returncode, 2)
        self.assertIn(b"standard input", refused.stderr)
        self.assertFalse(out.exists())
        done = subprocess.run([*stream, "50"], input=u.tobytes(), capture_output=True, check=False)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertLessEqual(np.abs(self.values(out).astype(int) - u).max(), 50)

    def test_suggested_isovalues_lie_between_the_multiples(self):
        path, report = self.store(volume("u1"), "--tolerance", "5")
        suggested = asked("info", path, "--histogram")["histogram"]["suggested"]
        self.assertTrue(suggested)
        for isovalue in suggested:
            self.assertGreater(min(isovalue["isovalue"] % report["tolerance_step"],
                                   -isovalue["isovalue"] % report["tolerance_step"]), 1)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
