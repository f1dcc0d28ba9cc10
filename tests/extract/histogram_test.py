"""`isonest info --histogram` compared with numpy, which counts every value and every cube.

Usage: histogram_test.py ISONEST PLUGIN_FOLDER
"""
import json
import os
import pathlib
import shutil
import signal
import subprocess
import sys
import tempfile
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served  # noqa: E402

ISONEST, PLUGINS = os.path.abspath(sys.argv[1]), sys.argv[2]
os.environ["HDF5_PLUGIN_PATH"] = PLUGINS
GOLDEN = pathlib.Path(__file__).resolve().parents[1] / "store" / "golden"

import h5py  # noqa: E402  (the plugin path must be set first)
import numpy as np  # noqa: E402

INTEGERS = ["uint8", "int8", "uint16", "int16", "uint32", "int32"]
RANDOM = np.random.default_rng(5)


def run(*arguments):
    return served.run([ISONEST, *map(str, arguments)], capture_output=True, text=True, timeout=600)


def bins_of(u):
    """The smallest value of each bin, as defined in the manual."""
    finite = u[np.isfinite(u)].astype("f8")
    if finite.size == 0:
        return np.array([])
    low, high = finite.min(), finite.max()
    if u.dtype.kind in "iu":
        width = -(-int(high - low + 1) // 256)
        return np.arange(low, high + 1, width)
    return low * (1 - np.arange(256) / 256) + high * (np.arange(256) / 256) if high > low else np.array([low])


def counts_of(u, low, stride):
    sample = u[::stride, ::stride, ::stride].astype("f8")
    bins = np.searchsorted(low, sample[np.isfinite(sample)], "right") - 1
    return np.bincount(bins, minlength=len(low)), int((~np.isfinite(sample)).sum())


def cubes_of(u, low, edge, keep):
    """For the smallest value of each bin, the number of cubes of that edge with values on both sides."""
    small = np.where(keep, u, np.inf).astype("f8")
    large = np.where(keep, u, -np.inf).astype("f8")
    for axis, n in enumerate(u.shape):
        starts = range(0, max(n - 1, 1), edge)
        small, large = (np.stack([f(a.take(range(s, min(s + edge, n - 1) + 1), axis), axis=axis) for s in starts], axis)
                        for f, a in ((np.min, small), (np.max, large)))
    return np.array([((small < v) & (large >= v)).sum() for v in low])


def suggested(low, nodes, cubes, integer):
    """The rule in the manual."""
    n, largest, groups, begin, total = len(low), cubes.max(initial=0), [], 0, int(nodes.sum())
    middle = lambda a, b: min(max((a + b) // 2, 1), n - 1)
    for end in range(1, n + 1):
        if nodes[begin:end].sum() >= max(64, total // 65536):
            if n > 1 and cubes[middle(begin, end)] >= max(largest // 100, 1):
                groups.append((begin, end))
            begin = end
    both = (cubes + np.append(cubes[1:], 0)) / 2
    reach = len(groups) // 32
    window = lambda a, i: sum(a[b:e].sum() for b, e in groups[max(i - reach, 0):i + reach + 1])
    curve = [window(both, i) / window(nodes, i) for i in range(len(groups))]
    peaks = []
    for i, height in enumerate(curve):
        left = [j for j in range(i) if curve[j] >= height]
        right = [j for j in range(i + 1, len(curve)) if curve[j] > height]
        valleys = ([min(curve[left[-1]:i + 1])] if left else []) + ([min(curve[i:right[0]])] if right else [])
        stands_out = height / max(valleys) if valleys else np.inf
        if stands_out >= 1.5:
            peaks.append((-stands_out, i))
    return [(low[middle(*groups[i])] - (0.5 if integer else 0), int(cubes[middle(*groups[i])]))
            for _, i in sorted(peaks)[:5]]


def volume(shape, dtype, kind):
    z, y, x = np.meshgrid(*map(np.arange, shape), indexing="ij")
    smooth = np.sin(x * 0.4) * np.cos(y * 0.3) + np.sin(z * 0.25 + 0.1 * x) + 0.05 * RANDOM.standard_normal(shape)
    if kind == "extreme":
        info = np.finfo(dtype) if dtype[0] == "f" else np.iinfo(dtype)
        return RANDOM.choice(np.array([info.min, info.max, 0, 1], dtype), shape)
    if dtype[0] == "f":
        u = smooth.astype(dtype)
        if kind == "missing":
            u[RANDOM.random(shape) < 0.1] = np.nan
            u[RANDOM.random(shape) < 0.05] = np.inf
        return u
    scale = {"narrow": 20, "wide": 120 if dtype.endswith("int8") else 5000}[kind]
    low = 0 if dtype[0] == "u" else -scale
    return np.clip(smooth * scale / 4 + (low + scale) / 2, low, scale).astype(dtype)


class Histogram(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        temporary = tempfile.TemporaryDirectory(prefix="isonest-histogram-", dir=served.MEMORY)
        cls.addClassCleanup(temporary.cleanup)
        cls.here = pathlib.Path(temporary.name)
        cls.ball = cls.store("ball", volume((25, 31, 40), "uint8", "wide"))

    @classmethod
    def store(cls, name, u, *options):
        path = cls.here / f"{name}.isonest"
        with h5py.File(cls.here / "v.h5", "w") as file:
            file["data"] = u
        done = run("preprocess", cls.here / "v.h5", "-o", path, "--force", *options)
        assert done.returncode == 0, done.stderr
        return path

    def histogram(self, store, *options):
        done = run("info", store, "--histogram", "--json", *options)
        self.assertEqual((done.returncode, done.stderr), (0, ""))
        return json.loads(done.stdout)["histogram"]

    def fails(self, code, *arguments):
        done = run("info", *arguments)
        self.assertEqual(done.returncode, code, (arguments, done.stderr, done.stdout))
        self.assertRegex(done.stderr, r"(?s)\Aisonest: error: .+\n\Z")
        return done.stderr

    def compare(self, u, h, what):
        """Checks counts with numpy; the level says what was counted."""
        with self.subTest(what, shape=u.shape, type=u.dtype, level=h["level"]):
            integer = u.dtype.kind in "iu"
            low = np.array([b["low"] for b in h["bins"]])
            with np.errstate(over="ignore"):
                wanted = bins_of(u)
            self.assertEqual(len(low), len(wanted))
            np.testing.assert_allclose(low, wanted, rtol=0 if integer else 1e-12, atol=0 if integer else 1e-12)
            nodes, missing = counts_of(u, low, 2**h["level"])
            np.testing.assert_array_equal([b["nodes"] for b in h["bins"]], nodes)
            self.assertEqual((h["missing"], h["values"]), (missing, missing + nodes.sum()))
            ranges = min(u.shape) > 1 and max(u.shape) > 5
            self.assertEqual(h["cube_level"], 0 if h["level"] == 0 else 3 if ranges else None)
            if h["cube_level"] is None:
                self.assertEqual({b["cubes"] for b in h["bins"]}, {None} if len(low) else set())
                self.assertEqual(h["suggested"], [])
                return
            cubes = np.array([b["cubes"] for b in h["bins"]], dtype=np.int64)
            keep = np.isfinite(u) if h["level"] == 0 else ~np.isnan(u)
            exact = cubes_of(u, low, 2**h["cube_level"], keep)
            if len(exact):
                exact[0] = 0  # infinities are below, but missing
            if h["level"] == 0 or u.dtype.itemsize <= 2:
                np.testing.assert_array_equal(cubes, exact)
            self.assertTrue((cubes >= exact).all())
            self.assertEqual([(s["isovalue"], s["cubes"]) for s in h["suggested"]],
                             suggested(low, nodes, cubes, integer))

    def test_counts_and_suggestions_are_those_of_numpy(self):
        shapes = [(19, 23, 37), (33, 9, 12), (2, 2, 50), (1, 30, 41), (1, 1, 40), (3, 3, 3), (1, 1, 1)]
        for i, dtype in enumerate([*INTEGERS, "float32", "float64"]):
            kinds = ["narrow", "wide", "extreme"] if dtype in INTEGERS else ["plain", "missing", "extreme"]
            for j, kind in enumerate(kinds):
                for shape in [shapes[0], shapes[1 + (i + j) % (len(shapes) - 1)]]:
                    u = volume(shape, dtype, kind)
                    store = self.store("s", u, "--chunk", (8, 16, 64)[(i + j) % 3])
                    self.compare(u, self.histogram(store), kind)
                    if max(shape) > 2:
                        self.compare(u, self.histogram(store, "--level", 1), kind)

    def test_constant_and_missing_volumes(self):
        for u in (np.full((9, 10, 11), 7, "uint8"), np.full((9, 10, 11), -1.5, "float32"),
                  np.full((9, 10, 11), np.nan, "float64"), np.full((1, 10, 11), np.inf, "float32")):
            store = self.store("s", u)
            h = self.histogram(store)
            self.compare(u, h, "constant")
            self.assertEqual(h["suggested"], [])
            plot = self.here / "constant.png"
            text = run("info", store, "--histogram", "-o", plot)
            self.assertEqual(text.returncode, 0, text.stderr)
            self.assertIn("missing" if h["missing"] else "no isovalue to suggest", text.stdout)
            self.assertEqual(plot.read_bytes()[:4], b"\x89PNG")

    def test_declared_missing_values_are_left_out(self):
        u = volume((9, 20, 20), "int16", "narrow")
        u[:, 3:6, 4:9] = -32768
        h = self.histogram(self.store("s", u, "--missing", -32768))
        self.assertEqual(h["missing"], 9 * 3 * 5)
        f = u.astype("f4")
        f[f == -32768] = np.nan
        self.assertEqual(h["bins"][0]["low"], np.nanmin(f))
        self.assertEqual(sum(b["nodes"] for b in h["bins"]), np.isfinite(f).sum())

    def test_the_surface_passes_through_as_many_cubes_as_are_said(self):
        """A full surface has 2 to 12 triangles in each such cube: six tetrahedra with one or two."""
        for s in self.histogram(self.ball)["suggested"]:
            done = run("extract", self.ball, "--iso", s["isovalue"], "-o", self.here / "m.ply", "--json")
            triangles = json.loads(done.stdout)["triangles"]
            self.assertGreaterEqual(triangles, 2 * s["cubes"])
            self.assertLessEqual(triangles, 12 * s["cubes"])

    def test_the_same_for_any_chunks_threads_and_memory(self):
        u = volume((25, 31, 40), "float32", "missing")
        seen = set()
        for chunk in (8, 32, 64):
            store = self.store("s", u, "--chunk", chunk)
            for options in ([], ["--threads", 1], ["--threads", 7], ["--memory", "24M"]):
                plot = self.here / "same.svg"
                seen.add(json.dumps(self.histogram(store, *options, "-o", plot)) + plot.read_text())
        self.assertEqual(len(seen), 1)

    def test_stores_of_every_version(self):
        values = np.frombuffer((GOLDEN / "volume.raw").read_bytes(), "<i2").reshape(7, 8, 9)
        flat = np.frombuffer((GOLDEN / "flat.raw").read_bytes(), "<f4").reshape(1, 8, 9)
        for version in ("1.0", "2.0", "2.2", "2.3"):
            self.compare(values, self.histogram(GOLDEN / f"{version}.store"), version)
            h = self.histogram(GOLDEN / f"{version}.store", "--level", 1)
            self.assertEqual(h["cube_level"], 3 if version >= "2.2" else None)
            if version == "1.0":
                continue  # flat ones are refused
            self.compare(flat, self.histogram(GOLDEN / f"{version}-flat.store"), version)
        text = run("info", GOLDEN / "2.0.store", "--histogram", "--level", 1).stdout
        self.assertIn("no ranges of cubes", text)
        self.assertIn("--level 0", text)

    def test_text_says_what_the_numbers_are_of(self):
        text = run("info", self.ball, "--histogram").stdout
        self.assertIn(f"all {25 * 31 * 40} values", text)
        for s in self.histogram(self.ball)["suggested"]:
            self.assertIn(f"{s['isovalue']:g} ", text)
        text = run("info", self.ball, "--histogram", "--level", 1).stdout
        self.assertIn("level 1", text)
        self.assertIn("8^3", text)

    def test_damaged_stores_are_errors(self):
        for bad in sorted(GOLDEN.glob("2.3-*.store")):
            done = run("info", bad, "--histogram")
            # Exit code 2: without the attribute that marks it as a store, the file has several volumes.
            self.assertIn(done.returncode, (0, 2, 4, 5) if "no-store" in bad.name else (0, 4, 5), (bad, done.stderr))
        whole = self.ball.read_bytes()
        with h5py.File(self.ball) as file:
            values = file["levels/0/values"].id.get_chunk_info(0).byte_offset
            ranges = file["levels/3/cube_ranges"].id.get_offset()
        bad = self.here / "bad.isonest"
        for at, options in ((values + 9, []), (ranges + 1, ["--level", 1])):
            bad.write_bytes(whole[:at] + bytes([whole[at] ^ 64]) + whole[at + 1:])
            self.fails(4, bad, "--histogram", *options)
        bad.write_bytes(whole[:len(whole) // 2])
        self.fails(4, bad, "--histogram")

    def test_wrong_requests_are_refused_before_any_work(self):
        plot, name = self.here / "p.png", self.ball
        for options in (["--level", 0], ["-o", plot], ["--threads", 1], ["--memory", "1G"]):
            self.fails(2, name, *options)  # without --histogram
        for options in (["--level", -1], ["--level", "x"], ["-o", self.here / "p.jpg"], ["-o", name],
                        ["-o", self.here]):
            self.fails(2, name, "--histogram", *options)
        self.assertIn("levels 0 to", self.fails(3, name, "--histogram", "--level", 9))
        self.assertIn("--memory", self.fails(7, name, "--histogram", "--memory", "1M", "-o", plot))
        self.assertFalse(plot.exists())
        self.assertEqual(name.read_bytes()[:8], b"\x89HDF\r\n\x1a\n")

    def test_an_interrupted_run_leaves_nothing(self):
        plot = self.here / "interrupted.png"
        child = subprocess.Popen([ISONEST, "info", self.ball, "--histogram", "-o", plot],
                                 stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        child.send_signal(signal.SIGINT)
        child.communicate(timeout=60)
        self.assertIn(child.returncode, (0, 130, -signal.SIGINT))
        self.assertEqual(plot.exists(), child.returncode == 0)

    def test_a_store_is_only_read(self):
        copy = self.here / "copy.isonest"
        shutil.copy(self.ball, copy)
        os.chmod(copy, 0o444)
        before = copy.read_bytes()
        self.histogram(copy, "-o", self.here / "copy.svg")
        self.assertEqual(copy.read_bytes(), before)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
