"""isonest smooth from outside: its files, its report, its guarantees, and what is refused.

Usage: smooth_test.py ISONEST PLUGIN_FOLDER
"""
import json
import os
import pathlib
import signal
import subprocess
import sys
import tempfile
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served  # noqa: E402

import h5py
import numpy

ISONEST = pathlib.Path(sys.argv[1]).resolve()
failures = []


def run(*arguments):
    return served.run([ISONEST, *map(str, arguments)], capture_output=True, text=True, timeout=300)


def require(good, what):
    if not good:
        failures.append(what)
        print("FAILED:", what, flush=True)


def masses(n):
    """For each node, the number of elements of the finest grid at it times the mass that each contributes."""
    odd = sum(numpy.meshgrid(*(numpy.arange(k) % 2 for k in n), indexing="ij"))
    cells = numpy.ones(n)
    for axis, k in enumerate(n):
        ends = numpy.full(k, 2.0)
        ends[[0, -1]] = 1
        cells *= ends.reshape([-1 if a == axis else 1 for a in range(3)])
    return cells * numpy.where((odd == 0) | (odd == 3), 6, 2) / 24


with tempfile.TemporaryDirectory(prefix="isonest-smooth-", dir=served.MEMORY) as name:
    folder = pathlib.Path(name)
    os.chdir(folder)
    rng = numpy.random.default_rng(3)
    nz, ny, nx = 14, 19, 26
    z, y, x = numpy.mgrid[:nz, :ny, :nx]
    clean = numpy.where(x + y > z + 18, 200.0, 50.0)
    noisy = (clean + rng.normal(0, 10, clean.shape)).round().astype("<i2")
    noisy.tofile("v.raw")
    raw = ["v.raw", "--dims", f"{nx},{ny},{nz}", "--type", "int16"]
    how = ["--steps", 4, "--tau", 0.5, "--lambda", 10, "--sigma", 0.5, "--json"]

    done = run("smooth", *raw, *how, "-o", "a.raw", "--snapshots", "0,2,4", "--grid", "g.nrrd")
    require(done.returncode == 0, done.stderr)
    report = json.loads(done.stdout)
    written = {f.name for f in folder.iterdir()} - {"v.raw"}
    require(written == {"a.raw", "a-0.raw", "a-2.raw", "a-4.raw", "g.nrrd", "g-0.nrrd", "g-2.nrrd", "g-4.nrrd"},
            f"written: {written}")
    first = numpy.fromfile("a-0.raw", "<f4").reshape(clean.shape)
    result = numpy.fromfile("a.raw", "<f4").reshape(clean.shape)
    require((first == noisy).all(), "step 0 is the input")
    require(pathlib.Path("a.raw").read_bytes() == pathlib.Path("a-4.raw").read_bytes(), "the last step is the result")
    weight = masses(noisy.shape)
    require(abs(weight.sum() - (nz - 1) * (ny - 1) * (nx - 1)) < 1e-9, "the masses are the volume")
    drift = abs((weight * (result - noisy)).sum() / weight.sum())
    require(drift < 2e-5 * noisy.max(), f"the mean moved by {drift}")
    require(noisy.min() - 1e-3 <= result.min() and result.max() <= noisy.max() + 1e-3, "the range grew")
    left = numpy.mean((result - clean)**2) / numpy.mean((noisy - clean)**2)
    require(left < 0.2, f"{left} of the noise is left")
    require([s["step"] for s in report["steps"]] == [1, 2, 3, 4] and
            all(s["unknowns"] == noisy.size and s["residual"] <= 1e-6 for s in report["steps"]), f"{report}")
    require(all(a["variance"] > b["variance"] for a, b in zip(report["steps"], report["steps"][1:])), "variance")

    # The same bytes for any number of threads, from a store, and through another format.
    assert run("preprocess", *raw, "-o", "s.isonest", "-q").returncode == 0
    for threshold in (0, 15):
        options = [*how, "--threshold", threshold, "--force"]
        for output, source in (("t1.h5", [*raw, "--threads", 1]), ("t3.h5", [*raw, "--threads", 3]),
                               ("s.h5", ["s.isonest"])):
            done = run("smooth", *source, *options, "-o", output)
            require(done.returncode == 0, done.stderr)
        arrays = [h5py.File(f)["data"][()] for f in ("t1.h5", "t3.h5", "s.h5")]
        require(all((a == arrays[0]).all() for a in arrays), f"threshold {threshold}: the results differ")
        if threshold == 0:
            require((arrays[0] == result).all(), "formats differ")
    unknowns = [s["unknowns"] for s in json.loads(done.stdout)["steps"]]
    require(0 < unknowns[-1] < unknowns[0] < noisy.size, f"unknowns {unknowns}")
    done = run("smooth", *raw, *how, "--threshold", 15, "--force", "-o", "a.raw", "--grid", "g.raw", "--snapshots", "3")
    nodes = numpy.fromfile("g-3.raw", "u1")
    require(set(nodes) == {0, 1} and nodes.sum() == json.loads(done.stdout)["steps"][3]["unknowns"],
            "the grid of step 3 is that which step 4 takes")
    require(run("preprocess", "a-0.raw", "--dims", f"{nx},{ny},{nz}", "--type", "float32", "-o", "again.isonest",
                "-q").returncode == 0, "preprocess reads what smooth wrote")

    # Two-dimensional data: pictures.
    noisy[0].tofile("p.raw")
    plane = ["p.raw", "--dims", f"{nx},{ny}", "--type", "int16"]
    done = run("smooth", *plane, *how, "--threshold", 10, "-o", "p.png", "--grid", "pg.png")
    require(done.returncode == 0 and all(pathlib.Path(f).read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
                                         for f in ("p.png", "pg.png")), f"pictures: {done}")

    def refused(code, why, *arguments):
        before = {f.name for f in folder.iterdir()}
        done = run("smooth", *arguments)
        require(done.returncode == code and why in done.stderr, f"{arguments}: {done}")
        require({f.name for f in folder.iterdir()} == before, f"{arguments}: a file is left")

    least = ["--steps", 1, "--tau", 1, "--lambda", 1]
    refused(2, "exists", *raw, *least, "-o", "a.raw")
    refused(2, "data in a plane", *raw, *least, "-o", "b.png")
    refused(2, "write .h5, .nrrd, .raw", *raw, *least, "-o", "b.tiff")
    refused(2, "--tau", *raw, "--steps", 1, "--tau", 0, "--lambda", 1, "-o", "b.raw")
    refused(2, "--lambda", *raw, "--steps", 1, "--tau", 1, "--lambda", "nan", "-o", "b.raw")
    refused(2, "--snapshots", *raw, *least, "--snapshots", "1.5", "-o", "b.raw")
    refused(2, "is an input", *raw, *least, "-o", "v.raw", "--force")
    refused(3, "nothing.raw", "nothing.raw", "--dims", "4,4,4", "--type", "u8", *least, "-o", "b.raw")
    refused(7, "give at least --memory", *raw, *least, "--memory", "1M", "-o", "b.raw")
    holed = noisy.astype("<f4")
    holed[0, 0, 2] = numpy.nan
    holed.tofile("holed.raw")
    refused(5, "node (2, 0, 0)", "holed.raw", "--dims", f"{nx},{ny},{nz}", "--type", "float32", *least, "-o", "b.raw")
    refused(2, "--missing", "v.raw", "--dims", f"{nx},{ny},{nz}", "--type", "int16", "--missing",
            int(noisy[0, 0, 2]), *least, "-o", "b.raw")
    refused(3, "there is no folder", *raw, *least, "-o", "nowhere/b.raw")
    refused(2, "--snapshots", *raw, *least, "--snapshots", "0,2", "-o", "b.raw")
    refused(2, "b-1.nrrd" if pathlib.Path("b-1.nrrd").write_text("x") else "", *raw, *least, "--snapshots", "1", "-o",
            "b.nrrd")

    # An interrupted run leaves no file.
    assert run("make-volume", "noise", "--size", 129, "--type", "float32", "-o", "n.h5").returncode == 0
    before = {f.name for f in folder.iterdir()}
    # On a busy machine a signal may come before the program has installed its handler.
    for seconds in (1.5, 6, 24):
        process = subprocess.Popen([ISONEST, "smooth", "n.h5", "--steps", "1000", "--tau", "5", "--lambda", "1", "-o",
                                    "c.raw", "-q"], stderr=subprocess.PIPE)
        time.sleep(seconds)
        process.send_signal(signal.SIGINT)
        code = process.wait(timeout=60)
        if code != -signal.SIGINT:
            break
    require(code == 130, "interrupted")
    require({f.name for f in folder.iterdir()} == before, "an interruption left a file")

sys.exit(1 if failures else 0)
