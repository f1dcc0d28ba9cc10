"""Kept analyses of surfaces: read by h5py following FORMAT.md, damaged, stale, of other queries, listed and checked.

Usage: analysis_test.py ISONEST PLUGIN_FOLDER    (the program that measures distances is next to ISONEST)
"""
import json
import os
import pathlib
import sys
import tempfile

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served  # noqa: E402

try:
    import h5py
    import numpy as np
except ImportError as error:
    print(error)
    sys.exit(77)

ISONEST = pathlib.Path(sys.argv[1]).resolve()
RNG = np.random.default_rng(11)
ISO = 0.3
failures = []


def run(*arguments, program=ISONEST):
    return served.run([program, *map(str, arguments)], capture_output=True, text=True, timeout=300)


def require(good, what):
    if not good:
        failures.append(what)
        print("FAILED:", what, flush=True)


def store_of(folder, name, u, *options):
    path, store = folder / f"{name}.raw", folder / f"{name}.isonest"
    np.ascontiguousarray(u, "f4").tofile(path)
    done = run("preprocess", path, "--dims", ",".join(str(n) for n in u.shape[::-1]), "--type", "float32", "-o", store,
               "--force", "-q", *options)
    assert done.returncode == 0, done.stderr
    return store


def waves(n, noise=0.1):
    z, y, x = np.meshgrid(*(np.arange(k, dtype=float) for k in n), indexing="ij")
    return np.sin(x * 0.31) * np.cos(y * 0.23) + np.sin(z * 0.19 + 0.1 * x) + noise * RNG.random(n)


def analyses(folder):
    return sorted(folder.glob("*.analysis"))


def extract(store, mesh, *options):
    """The report of an extraction with --keep-analysis."""
    done = run("extract", store, "--iso", ISO, "-o", mesh, "--json", "--keep-analysis", *options)
    require(done.returncode == 0, f"{options}: {done.stderr}")
    return json.loads(done.stdout)


def distance(a, b, most):
    """The distance within 0.01; parts nearer than `most` are not examined closely."""
    done = run(a, b, "--max-only", "--epsilon", 0.01, "--stop-above", most, program=ISONEST.with_name("isonest_mesh_distance"))
    return json.loads(done.stdout)["max"]


def triangles_of(path):
    text = path.read_bytes()
    return int(text[:text.index(b"end_header")].split(b"element face")[1].split()[0])


def check_distances(folder):
    """Any distance and any number of triangles from one file: it is kept, and gives the same as when it was made."""
    store, mesh, full = store_of(folder, "d", waves((40, 44, 48)), "--spacing", "0.5,1,1"), folder / "m.ply", folder / "f.ply"
    assert run("extract", store, "--iso", ISO, "--cells", "hex", "-o", full, "-q").returncode == 0
    first = extract(store, mesh, "--distance", 0.3)
    require(first["analysis"] == "made" and len(analyses(folder)) == 1, f"made: {first}")
    written = analyses(folder)[0].read_bytes()
    made = mesh.read_bytes()
    for threads in (1, 4):
        again = extract(store, mesh, "--distance", 0.3, "--threads", threads, "--memory", "64M")
        require(again["analysis"] == "found" and again["chunks_read"] == 0, f"found: {again}")
        require(mesh.read_bytes() == made, f"{threads} threads: other bytes")
        same = ("triangles", "vertices", "full_triangles", "distance", "distance_bound")
        require(all(again[k] == first[k] for k in same), f"another report: {first} {again}")
    for d in (0.0626, 0.1, 0.25, 0.5, 0.71, 1, 3, 20):
        r = extract(store, mesh, "--distance", d)
        found = distance(full, mesh, r["distance_bound"] + 1e-5)
        require(r["analysis"] == "found" and r["distance_bound"] <= d, f"{d}: {r}")
        require(found <= r["distance_bound"] + 1e-5, f"{d}: {found} away, bound {r['distance_bound']}")
        require(r["triangles"] == triangles_of(mesh) < triangles_of(full), f"{d}: {r['triangles']}")
    fewer = []
    for n in (4000, 1500, 700, 300):
        r = extract(store, mesh, "--triangles", n)
        require(r["within_budget"] and triangles_of(mesh) <= n, f"{n} triangles: {r}")
        most = r["distance_bound"] + 1e-5
        require(distance(full, mesh, most) <= most <= r["distance"] + 2e-5, f"{n} triangles: {r}")
        fewer.append(r["distance_bound"])
    require(fewer == sorted(fewer), f"bounds of budgets: {fewer}")
    r = extract(store, mesh, "--triangles", 100, "--distance", 0.2)
    require(not r["within_budget"] and r["distance_bound"] <= 0.2, f"the distance first: {r}")
    r = extract(store, mesh, "--distance", 0.03)
    require(r["analysis"] == "not_used" and r["distance_bound"] <= 0.03, f"too small: {r}")
    r = extract(store, mesh, "--triangles", 10**9)
    require(mesh.read_bytes() == full.read_bytes() and r["analysis"] == "not_used", f"all triangles: {r}")
    require(analyses(folder)[0].read_bytes() == written, "a file that is current was written again")
    other = store_of(folder, "d", waves((20, 20, 20)))
    r = extract(other, mesh, "--distance", 0.3)
    require(r["analysis"] == "replaced_stale", f"of another store: {r}")
    return store


def check_format(folder):
    """FORMAT.md, section 9."""
    store, mesh = store_of(folder, "f", waves((30, 30, 30), 0)), folder / "m.ply"
    report = extract(store, mesh, "--distance", 0.25, "--normals")
    with h5py.File(analyses(folder)[0], "r") as f:
        require(f.attrs["format"] == b"isonest analysis" and f.attrs["version"] == 1, "format and version")
        require(f.attrs["counts"][0] == report["full_triangles"] and f.attrs["counts"][7] == 12, "counts")
        require(b"\niso 0.3, of hexahedra, normals" in f.attrs["key"], f"key {f.attrs['key']}")
        bounds, counts = [], []
        for k in range(f.attrs["steps"]):
            step = f[f"step_{k:02}"]
            positions, rows, corners = (step[name][()] for name in ("positions", "rows", "corners"))
            require(step.attrs["size"].tolist() == [len(positions), len(corners)], f"size of step {k}")
            require(sorted(np.unique(corners)) == list(range(len(positions))), f"corners of step {k}")
            normals = rows.reshape(-1).view("<f4").reshape(-1, 3)
            require(np.allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-5), f"normals of step {k}")
            bounds.append(step.attrs["bound"][0])
            counts.append(len(corners))
        require(bounds == sorted(bounds) and bounds[0] <= 0.125 and bounds[-1] <= 4, f"bounds {bounds}")
        require(counts == sorted(counts, reverse=True), f"triangles {counts}")
        at = [i for i, b in enumerate(bounds) if b <= 0.25][-1]
        require(counts[at] >= report["triangles"], "the mesh has more triangles than the step of its distance")


def check_damage(folder):
    """A flipped bit anywhere is detected or has no effect."""
    store, mesh = store_of(folder, "x", waves((12, 12, 12))), folder / "m.ply"
    extract(store, mesh, "--distance", 0.2)
    good, (path,) = mesh.read_bytes(), analyses(folder)
    whole = path.read_bytes()
    seen = {"found": 0, "replaced_damaged": 0, "replaced_stale": 0}
    places = [*RNG.integers(0, len(whole), 40), *RNG.integers(0, 2048, 20)]
    for place in places:
        damaged = bytearray(whole)
        damaged[place] ^= 1 << int(RNG.integers(8))
        path.write_bytes(damaged)
        checked = run("check", store, "--quick")
        report = extract(store, mesh, "--distance", 0.2)
        seen[report["analysis"]] += 1
        require(mesh.read_bytes() == good, f"byte {place}: another mesh")
        require((checked.returncode == 4) == (report["analysis"] == "replaced_damaged"),
                f"byte {place}: check says {checked.returncode}, extract {report['analysis']}")
        require(path.read_bytes() == whole or report["analysis"] == "found", f"byte {place}: made anew, but otherwise")
        path.write_bytes(whole)
    require(seen["replaced_damaged"] > len(places) / 2, f"damage: {seen}")
    for cut in (0, 1, 100, len(whole) // 2, len(whole) - 1):
        path.write_bytes(whole[:cut])
        require(extract(store, mesh, "--distance", 0.2)["analysis"] == "replaced_damaged", f"cut at {cut}")
        require(mesh.read_bytes() == good, f"cut at {cut}: another mesh")


def check_queries(folder):
    """Different surfaces have separate files; info lists them, and a folder may hold them."""
    store, mesh = store_of(folder, "q", waves((24, 24, 24)), "--indicators", "deviation_bar,grad_linf_plus"), folder / "m.ply"
    queries = ((), ("--normals",), ("--close",), ("--box", "2,2,2,20,20,20"), ("--min-component", 50),
               ("--components", "largest"))
    for i, options in enumerate(queries):
        report = extract(store, mesh, "--distance", 0.2, *options)
        require(report["analysis"] == "made" and len(analyses(folder)) == i + 1, f"{options}: {report['analysis']}")
        made = mesh.read_bytes()
        again = extract(store, mesh, "--distance", 0.2, *options)
        require(again["analysis"] == "found" and mesh.read_bytes() == made, f"{options} again")
        drop = lambda r: {k: v for k, v in r.items()
                          if k not in ("analysis", "seconds", "scratch_bytes", "peak_cache_bytes", "bricks")
                          and not k.startswith(("chunks_", "bytes_", "visited", "leaf"))}
        require(drop(report) == drop(again), f"{options}: reports {report} {again}")
    listed = json.loads(run("info", store, "--json").stdout)["analyses"]
    require(len(listed) == len(queries) and {a["state"] for a in listed} == {"current"}, f"info: {listed}")
    require(sorted(pathlib.Path(a["file"]) for a in listed) == analyses(folder), "info lists other files")
    (folder / "elsewhere").mkdir()
    report = extract(store, mesh, "--distance", 0.2, f"--keep-analysis={folder / 'elsewhere'}")
    require(report["analysis"] == "made" and len(analyses(folder / "elsewhere")) == 1, "a folder of its own")
    for options, code in (((), 2), (("--error", 1), 2), (("--distance", 1, "--view", "0,0,1"), 2),
                          (("--distance", 1, f"--keep-analysis={folder / 'nowhere'}"), 3)):
        done = run("extract", store, "--iso", ISO, "-o", mesh, "-q", "--keep-analysis", *options)
        require(done.returncode == code and done.stderr, f"{options}: {done}")
    read_only = folder / "read-only"
    read_only.mkdir(mode=0o555)
    if not os.access(read_only, os.W_OK):  # root can write anywhere
        done = run("extract", store, "--iso", ISO, "-o", mesh, "-q", "--distance", 1, f"--keep-analysis={read_only}")
        require(done.returncode == 6 and "not writable" in done.stderr, f"read-only: {done}")
    empty = run("extract", store, "--iso", 99, "-o", mesh, "-q", "--keep-analysis", "--distance", 1)
    require(empty.returncode == 0 and triangles_of(mesh) == 0, f"an empty surface: {empty}")


for test in (check_distances, check_format, check_damage, check_queries):
    with tempfile.TemporaryDirectory(prefix="isonest-analysis-") as name:
        test(pathlib.Path(name))

sys.exit(1 if failures else 0)
