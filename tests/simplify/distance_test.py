"""extract --distance of small and odd volumes: the promised distance and topology, and the same bytes.

Usage: distance_test.py ISONEST PLUGIN_FOLDER    (the programs that measure meshes are next to ISONEST)
"""
import json
import pathlib
import sys
import tempfile

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served  # noqa: E402

try:
    import numpy as np
    from mesh_data import read_points
except ImportError:
    print("numpy is not installed")
    sys.exit(77)

ISONEST = pathlib.Path(sys.argv[1]).resolve()
RNG = np.random.default_rng(5)
failures = []


def run(*arguments, program=ISONEST):
    return served.run([program, *map(str, arguments)], capture_output=True, text=True, timeout=300)


def measure(program, *arguments):
    return json.loads(run(*arguments, program=ISONEST.with_name(f"isonest_mesh_{program}")).stdout)


def farthest(a, b, most, epsilon):
    """The distance of the meshes within epsilon; parts nearer than `most` are not examined closely."""
    return measure("distance", a, b, "--max-only", "--epsilon", epsilon, "--stop-above", most)["max"]


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


def topology(v, t):
    """Components, Euler characteristic, border loops, edges of more than two triangles, repeated triangles."""
    directed = np.concatenate([t[:, [0, 1]], t[:, [1, 2]], t[:, [2, 0]]])
    edges, uses = np.unique(np.sort(directed, 1), axis=0, return_counts=True)

    def parts(pairs):
        root = np.arange(len(v))
        while len(pairs):
            a, b = root[pairs[:, 0]], root[pairs[:, 1]]
            low = np.minimum(a, b)
            before = root.copy()
            np.minimum.at(root, a, low)
            np.minimum.at(root, b, low)
            root = root[root]
            if (before == root).all():
                break
        return len(np.unique(root[np.unique(pairs)])) if len(pairs) else 0

    return {"components": parts(edges), "euler": len(np.unique(t)) - len(edges) + len(t),
            "border loops": parts(edges[uses == 1]), "bad edges": int((uses > 2).sum()),
            "repeated": len(t) - len(np.unique(np.sort(t, 1), axis=0)), "unused": len(v) - len(np.unique(t))}


def volumes():
    """Yields name, values, isovalue, options, distances (world units)."""
    z, y, x = np.meshgrid(*(np.arange(n, dtype=float) for n in (23, 26, 29)), indexing="ij")
    ball = np.sqrt((x - 14) ** 2 + (y - 12) ** 2 + (z - 11) ** 2)
    yield "2x2x2", RNG.random((2, 2, 2)), 0.5, (), (0.1, 3)
    yield "2x2xn", RNG.random((40, 2, 2)), 0.5, (), (0.3, 3)
    yield "noise", RNG.random((14, 15, 16)), 0.5, (), (0.05, 0.5, 2)
    yield "checkerboard", ((x + y + z) % 2)[:9, :10, :11], 0.5, (), (0.3, 1)
    yield "sheet", (z == 11)[:, :9, :10], 0.5, (), (0.01, 0.4, 1.5)
    yield "plateau", np.clip(ball - 6, 0, 1) - (ball < 3), 0, (), (0.3, 1)
    yield "at the isovalue", np.full((9, 9, 9), 3.0), 3, (), (1,)
    yield "holes", np.where(RNG.random(ball.shape) < 0.01, np.nan, ball), 8.3, (), (0.2, 1)
    yield "tiny", ball, 8.3, ("--spacing", "1e-6,1e-6,1e-6"), (1e-7, 1e-6)
    yield "long voxels", ball, 8.3, ("--spacing", "1,1,10"), (0.3, 3)
    yield "far", ball, 8.3, ("--origin", "20000,-30000,10000"), (0.3, 1)
    # A hollow component near a plane could vanish within the distance, but must stay.
    ring = 1.3 - np.hypot(np.hypot(x - 14.3, y - 12.1) - 4.2, z - 11.2)
    tube = 1.2 - np.hypot(y - 12.1, z - 10.2)
    yield "torus near a plane", np.maximum(7.2 - z, ring), 0, (), (0.5, 6, 15)
    yield "tube near a plane", np.maximum(7.2 - z, tube), 0, (), (0.5, 6, 15)


def check(folder, name, u, iso, options, distances):
    store = store_of(folder, "v", u, *options)
    # With a new analysis, and with an existing one; by mappings alone.
    kept = (("--keep-analysis",), ("--keep-analysis",), ("--effort", "fast"))
    check_cells(folder, store, name, iso, distances, ("--cells", "hex"), ((), *kept))
    check_cells(folder, store, name, iso, distances, ("--cells", "tet"), ((), kept[-1]))
    for close, way in (("--close", ()), ("--close=above", kept[-1])):
        check_cells(folder, store, name, iso, distances, ("--cells", "hex", close), (way,))


def check_cells(folder, store, name, iso, distances, cells, ways):
    full, mesh = folder / "full.ply", folder / "mesh.ply"
    assert run("extract", store, "--iso", iso, "--error", 0, "-o", full, "-q", *cells).returncode == 0
    before = topology(*read_points(full))
    before_options = None
    largest = float(np.abs(read_points(full)[0]).max(initial=0))
    for d, kept in ((d, kept) for d in distances for kept in ways):
        what = f"{name}, {' '.join(cells[1:])}, distance {d} {' '.join(kept)}"
        made = mesh.read_bytes() if kept and before_options == (d, kept) else None
        before_options = (d, kept)
        done = run("extract", store, "--iso", iso, "--distance", d, "-o", mesh, "--json", *cells, *kept)
        require(done.returncode == 0, f"{what}: {done.stderr}")
        if done.returncode:
            continue
        require(made in (None, mesh.read_bytes()), f"{what}: other bytes than when it was made")
        report = json.loads(done.stdout)
        require(report["full_triangles"] == len(read_points(full)[1]), f"{what}: full_triangles")
        require(report["distance_bound"] <= d, f"{what}: bound {report['distance_bound']}")
        require(topology(*read_points(mesh)) == before, f"{what}: {before} -> {topology(*read_points(mesh))}")
        if report["full_triangles"]:
            most = d + 2e-7 * largest
            found = farthest(full, mesh, most, d / 50)
            require(found <= most, f"{what}: {found} away")


def faults(v, t, size, spacing):
    """Edges of more than two triangles, edges of one triangle not in the volume's faces, edges with inconsistent
    orientation."""
    directed = np.concatenate([t[:, [0, 1]], t[:, [1, 2]], t[:, [2, 0]]])
    edges, uses = np.unique(np.sort(directed, 1), axis=0, return_counts=True)
    ends = v[edges[uses == 1]] / spacing
    on_face = ((ends == 0).all(1) | (np.abs(ends - (np.array(size) - 1)) < 1e-4).all(1)).any(1)
    return int((uses > 2).sum()), int((~on_face).sum()), len(directed) - len(np.unique(directed, axis=0))


def check_nested(folder, name, u, iso, options, distances):
    """The unsimplified nested grid: within the distance, without cracks, the same bytes for any threads and memory."""
    store = store_of(folder, "n", u, *options)
    full, mesh = folder / "full.ply", folder / "mesh.ply"
    assert run("extract", store, "--iso", iso, "--cells", "tet", "-o", full, "-q").returncode == 0
    spacing = [float(s) for s in options[1].split(",")] if options[:1] == ("--spacing",) else [1, 1, 1]
    largest = float(np.abs(read_points(full)[0]).max(initial=0))
    counts = []
    for d in (min(distances) / 1000, *distances):
        what = f"{name}, nested, distance {d}"
        made = []
        for extra in (("--threads", 1), ("--threads", 4, "--memory", "100M")):
            done = run("extract", store, "--iso", iso, "--distance", d, "--effort", "none", "-o", mesh, "--json", *extra)
            if done.returncode == 7 and "32-bit" in done.stderr:
                break  # below the rounding of float32
            require(done.returncode == 0, f"{what}: {done.stderr}")
            made.append(mesh.read_bytes())
        if not made:
            continue
        require(len(set(made)) == 1, f"{what}: threads or memory change the bytes")
        report = json.loads(done.stdout)
        require(report["distance_bound"] <= d, f"{what}: bound {report['distance_bound']}")
        v, t = read_points(mesh)
        counts.append(len(t))
        if name != "holes" and name != "far":
            require(faults(v, t, u.shape[::-1], spacing) == (0, 0, 0),
                    f"{what}: cracks {faults(v, t, u.shape[::-1], spacing)}")
        require((len(t) == 0) == (len(read_points(full)[1]) == 0), f"{what}: {len(t)} triangles")
        if len(t):
            most = d + 2e-7 * largest
            found = farthest(full, mesh, most, min(distances) / 50)
            require(found <= most, f"{what}: {found} away")
    require(counts == sorted(counts, reverse=True), f"{name}, nested: {counts} triangles")


def same_bytes(folder):
    u = RNG.random((19, 21, 23))
    u[5:15] += np.linspace(-0.4, 0.4, 21)[:, None]
    meshes = {}
    for chunk in (16, 64):
        store = store_of(folder, f"c{chunk}", u, "--chunk", chunk)
        for options in (("--threads", 1), ("--threads", 4), ("--threads", 4, "--memory", "64M")):
            mesh = folder / "m.ply"
            done = run("extract", store, "--iso", 0.7, "--distance", "0.4voxel", "-o", mesh, "-q", *options)
            require(done.returncode == 0, done.stderr)
            meshes[chunk, options] = mesh.read_bytes()
    require(len(set(meshes.values())) == 1, "threads, memory or chunks change the bytes")
    require(run("extract", store, "--iso", 0.7, "--distance", "0.4voxel", "-o", mesh, "-q", "--effort",
                "best").returncode == 0, "--effort best")
    require(mesh.read_bytes() in meshes.values(), "--effort best is not what is made without it")
    folds = measure("quality", mesh)["folds_150"]
    for cells, is_default in (("hex", True), ("tet", False)):
        assert run("extract", store, "--iso", 0.7, "--distance", "0.4voxel", "-o", mesh, "-q", "--cells",
                   cells).returncode == 0
        require((mesh.read_bytes() in meshes.values()) == is_default, f"--cells {cells} beside what is made without it")
        assert run("extract", store, "--iso", 0.7, "-o", mesh, "-q", "--cells", cells).returncode == 0
        require(folds <= 2 * measure("quality", mesh)["folds_150"], f"{folds} folds beside those of the full {cells}")


def waves(nodes, scale):
    z, y, x = (np.arange(n) / scale for n in nodes)
    z, y, x = z[:, None, None], y[None, :, None], x[None, None, :]
    return np.sin(x) * np.cos(y) + np.sin(y) * np.cos(z) + np.sin(z) * np.cos(x)


def fast_bytes(folder):
    """More triangles than fit into a block; mapped with any threads, memory and chunks."""
    stores = {chunk: store_of(folder, f"w{chunk}", waves((51, 54, 67), 3), "--chunk", chunk) for chunk in (16, 64)}
    ways = (("--threads", 1), ("--threads", 2), ("--threads", 7), ("--threads", 7, "--memory", "80M"))
    # Every way with each of both, and with each chunk size once.
    for turn, stop in enumerate((("--distance", "0.3voxel"), ("--triangles", 3000))):
        meshes = {}
        for i, options in enumerate(ways):
            chunk = (16, 64)[(i + turn) % 2]
            mesh = folder / "m.ply"
            done = run("extract", stores[chunk], "--iso", 0.2, *stop, "--effort", "fast", "-o", mesh, "--json", *options)
            require(done.returncode == 0, done.stderr)
            meshes[chunk, options] = mesh.read_bytes()
        require(json.loads(done.stdout)["full_triangles"] > 3 * 16384, "fewer than three blocks")
        require(len(set(meshes.values())) == 1, f"{stop}: threads, memory or chunks change the bytes of mappings")


def check_fast(what, full, mesh, done, most):
    """A surface of some size, by mappings alone: the promise, the topology, folds and fewer triangles."""
    require(done.returncode == 0, f"{what}: {done.stderr}")
    if done.returncode:
        return
    report = json.loads(done.stdout)
    before, after = measure("quality", full), measure("quality", mesh)
    require(0 < report["distance_bound"] <= most, f"{what}: bound {report['distance_bound']}")
    found = farthest(full, mesh, report["distance_bound"] + 1e-5, most / 100)
    require(found <= report["distance_bound"] + 1e-5, f"{what}: {found} away")
    require(after["triangles"] < before["triangles"] / 3, f"{what}: {after['triangles']} triangles")
    require(topology(*read_points(full)) == topology(*read_points(mesh)), f"{what}: another topology")
    for name in ("nonmanifold_edges", "turned_edges", "euler", "components", "fan_vertices"):
        require(before[name] == after[name], f"{what}: {name} {before[name]} -> {after[name]}")
    require(after["folds_150"] <= 2 * before["folds_150"], f"{what}: {after['folds_150']} folds")


def sampled_budget(folder):
    """A number of triangles for a surface so large that a part of it is searched first."""
    full, mesh = folder / "full.ply", folder / "mesh.ply"
    meshes = set()
    most = 32000
    for threads, chunk in ((1, 16), (7, 32)):
        store = store_of(folder, f"s{chunk}", waves((58, 57, 60), 1.05), "--chunk", chunk)
        done = run("extract", store, "--iso", 0.2, "--triangles", most, "-o", mesh, "--json", "--threads", threads)
        require(done.returncode == 0, done.stderr)
        meshes.add(mesh.read_bytes())
    report = json.loads(done.stdout)
    require(report["full_triangles"] > 2**18, "too small for a sample")
    require(0.9 * most <= report["triangles"] <= most, f"{report['triangles']} triangles of a sampled surface")
    require(len(meshes) == 1, "threads or chunks change the bytes within a number of triangles")
    assert run("extract", store, "--iso", 0.2, "--cells", "hex", "-o", full, "-q").returncode == 0
    found = farthest(full, mesh, report["distance_bound"] + 1e-5, report["distance_bound"] / 50)
    require(found <= report["distance_bound"] + 1e-5, f"sampled: {found} away, {report['distance_bound']} is said")


def fast(folder):
    full, mesh = folder / "full.ply", folder / "mesh.ply"
    u = waves((33, 30, 36), 3.3)
    u[14:18, 9:13, 20:25] = np.nan
    store = store_of(folder, "waves", u, "--spacing", "1,1.5,2")

    def both(store, options, stop, full=full, mesh=mesh):
        assert run("extract", store, *options, "--cells", "hex", "-o", full, "-q").returncode == 0
        return run("extract", store, *options, *stop, "--effort", "fast", "-o", mesh, "--json")

    for options in ((), ("--box", "5,5,5,40.5,30,40"), ("--close",), ("--close=above",), ("--components", "largest"),
                    ("--close", "--components", "largest", "--box", "5,5,5,40.5,30,40")):
        for d in (0.4, 1):
            done = both(store, ("--iso", 0.4, *options), ("--distance", d))
            check_fast(f"waves {' '.join(options)}, {d}", full, mesh, done, d)
    ids = np.digitize(waves((33, 30, 36), 3.3), (-0.4, 0.4)).astype("u1")
    np.save(folder / "ids.npy", ids)
    labels = folder / "labels.isonest"
    assert run("preprocess", folder / "ids.npy", "-o", labels, "--labels", "-q").returncode == 0
    for options in ((), ("--close",)):
        check_fast(f"a label {' '.join(options)}", full, mesh,
                   both(labels, ("--label", 2, *options), ("--distance", "0.7voxel")), 0.7)
    one = mesh.read_bytes()
    assert run("extract", labels, "--labels", "1,2", "--close", "--distance", "0.7voxel", "--effort", "fast", "-o",
               folder / "all", "-q").returncode == 0
    require((folder / "all" / "2.ply").read_bytes() == one, "labels together are not those alone")
    # Several isovalues, each the same as alone.
    assert run("extract", store, "--iso", "0.1,0.4", "--distance", 0.5, "--effort", "fast", "-o",
               folder / "m_{iso}.ply", "-q").returncode == 0
    assert run("extract", store, "--iso", 0.4, "--distance", 0.5, "--effort", "fast", "-o", mesh, "-q").returncode == 0
    require((folder / "m_0.4.ply").read_bytes() == mesh.read_bytes(), "isovalues together are not those alone")
    fast_budgets(store, both, full, mesh)
    for options in ((), ("--distance", 1, "--keep-analysis")):
        done = run("extract", store, "--iso", 0.4, *options, "--effort", "fast", "-o", mesh, "-q")
        require(done.returncode == 2 and "effort" in done.stderr, f"--effort with {options}: {done}")
    done = run("extract", store, "--iso", 0.4, "--effort", "best", "-o", mesh, "-q")
    require(done.returncode == 2 and "effort" in done.stderr, f"--effort best alone: {done}")
    done = run("extract", store, "--iso", 0.4, "--distance", 1, "--effort", "slow", "-o", mesh, "-q")
    require(done.returncode == 2 and "none, fast or best" in done.stderr, f"--effort slow: {done}")
    flat = store_of(folder, "plane", u[:1])
    done = run("extract", flat, "--iso", 0.1, "--distance", 1, "--effort", "fast", "-o", folder / "l.obj", "-q")
    require(done.returncode == 2 and "isolines" in done.stderr, f"isolines with --effort: {done}")


def fast_budgets(store, both, full, mesh):
    for n in (2000, 1200, 700):
        done = both(store, ("--iso", 0.4), ("--triangles", n))
        report = json.loads(done.stdout)
        check_fast(f"{n} triangles", full, mesh, done, report["distance"])
        require(0.8 * n < report["triangles"] <= n and report["within_budget"], f"{n} triangles: {report}")
    few = report["triangles"]
    report = json.loads(both(store, ("--iso", 0.4), ("--triangles", few, "--distance", 0.2)).stdout)
    require(report["triangles"] > few and not report["within_budget"] and report["distance_bound"] <= 0.2,
            f"a distance before {few} triangles: {report}")
    report = json.loads(both(store, ("--iso", 0.4), ("--triangles", 10**7)).stdout)
    require(mesh.read_bytes() == full.read_bytes() and report["within_budget"], "enough triangles for all")
    done = both(store, ("--iso", 0.4), ("--triangles", 4))
    require(done.returncode == 7 and "the fewest triangles" in done.stderr, f"4 triangles: {done}")


def arguments(folder):
    store = store_of(folder, "ball", np.hypot(*np.meshgrid(np.arange(12.0), np.arange(12.0)))[None] +
                     np.arange(12.0)[:, None, None], "--spacing", "2,3,4")
    mesh, full = folder / "m.ply", folder / "full.ply"

    def extract(*options):
        return run("extract", store, "--iso", 9.3, "-o", mesh, "-q", *options)

    for text in ("-1", "-0.5voxel", "nan", "inf", "1parsec", "1voxelss", "", "voxel"):
        done = extract("--distance", text)
        require(done.returncode == 2 and "--distance" in done.stderr, f"--distance {text!r}: {done}")
    for options in (("--error", 0.1), ("--error-relative", 0.1), ("--focus", "1,2,3")):
        require(extract("--distance", 1, *options).returncode == 2, f"--distance with {options} is accepted")
    for memory in ("1", "20M"):
        done = extract("--distance", 1, "--memory", memory)
        require(done.returncode == 7 and "give at least --memory" in done.stderr, f"{memory}: {done}")
    assert run("extract", store, "--iso", 9.3, "-o", full, "--error", 0, "--cells", "hex", "-q").returncode == 0
    require(extract("--distance", 0).returncode == 0, "--distance 0")
    require(mesh.read_bytes() == full.read_bytes(), "--distance 0 is not the full surface")
    # Hexahedra at full resolution need no field.
    lean = store_of(folder, "lean", RNG.random((7, 8, 9)), "--indicators", "linf_bar")
    for stop in (("--distance", 0.2), ("--triangles", 700), ("--distance", 0.2, "--effort", "fast", "--close")):
        done = run("extract", lean, "--iso", 0.5, *stop, "-o", mesh, "-q")
        require(done.returncode == 0, f"{stop} in a store without deviation_bar: {done.stderr}")
        done = run("extract", lean, "--iso", 0.5, *stop, "--cells", "tet", "-o", mesh, "-q")
        require(done.returncode == 3 and "deviation_bar" in done.stderr, f"{stop} of tetrahedra: {done}")
    for options in (("--close",), ("--components", "largest"), ("--triangles", 9), ("--keep-analysis",),
                    ("--box", "3,3,3,15,20,25"), ("--normals",)):
        good = options[0] in ("--box", "--normals")
        done = extract("--distance", 1, "--effort", "none", *options)
        require(done.returncode == (0 if good else 2), f"--effort none with {options}: {done}")
    bytes_of = {}
    for text in ("2", "2.0", "1voxel", "1e30", "1e300", "1e-3"):
        done = extract("--distance", text)
        require(done.returncode == 0, f"--distance {text}: {done.stderr}")
        bytes_of[text] = mesh.read_bytes()
    require(bytes_of["2"] == bytes_of["2.0"] == bytes_of["1voxel"], "units differ")
    # A part of the volume has the same topology as without the distance.
    for box in ("3,3,3,15,20,25", "0,0,0,1e9,1e9,20", "500,500,500,501,501,501"):
        codes = [run("extract", store, "--iso", 9.3, "--box", box, "-q", "-o", path, *options).returncode
                 for path, options in ((full, ("--error", 0)), (mesh, ("--distance", 1.5)))]
        require(codes == [0, 0], f"--box {box}: {codes}")
        require(topology(*read_points(full)) == topology(*read_points(mesh)), f"--box {box}: another topology")
    # Rounding alone moves vertices farther than this.
    far = store_of(folder, "far", RNG.random((5, 5, 5)), "--origin", "1e6,1e6,1e6")
    done = run("extract", far, "--iso", 0.5, "--distance", 1e-4, "-o", mesh, "-q")
    require(done.returncode == 7 and "32-bit" in done.stderr, f"distance below rounding: {done}")
    flat = folder / "flat.isonest"
    (folder / "flat.raw").write_bytes(RNG.random((9, 9)).astype("f4").tobytes())
    assert run("preprocess", folder / "flat.raw", "--dims", "9,9", "--type", "float32", "-o", flat, "-q").returncode == 0
    done = run("extract", flat, "--iso", 0.5, "--triangles", 9, "-o", folder / "l.obj", "-q")
    require(done.returncode == 2 and "distance" in done.stderr, f"lines by their triangles: {done}")


with tempfile.TemporaryDirectory(prefix="isonest-distance-", dir=served.MEMORY) as name:
    arguments(pathlib.Path(name))
    for volume in volumes():
        check(pathlib.Path(name), *volume)
        check_nested(pathlib.Path(name), *volume)
    same_bytes(pathlib.Path(name))
    fast_bytes(pathlib.Path(name))
    sampled_budget(pathlib.Path(name))
    fast(pathlib.Path(name))

sys.exit(1 if failures else 0)
