"""The programs that judge meshes (tools/bench/meshes/mesh_distance.cpp, mesh_quality.cpp) compared with brute force in
numpy, and on meshes with known properties.

usage: mesh_measure_test.py ISONEST PLUGIN_FOLDER    (the programs are next to ISONEST)
"""
import json
import pathlib
import sys
import tempfile

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served  # noqa: E402

import numpy as np

programs = pathlib.Path(sys.argv[1]).parent
folder = pathlib.Path(tempfile.mkdtemp(prefix="isonest-measure-"))
TEN = np.array([(4, 4, 4), (6, 6, 0), (0, 6, 6), (6, 0, 6), (8, 2, 2), (2, 8, 2), (2, 2, 8), (2, 5, 5),
                (5, 2, 5), (5, 5, 2)]) / 12


def write(name, v, t, kind="f4"):
    faces = np.empty(len(t), np.dtype([("n", "u1"), ("i", "<u4", 3)]))
    faces["n"], faces["i"] = 3, np.reshape(t, (-1, 3))
    path = folder / name
    prop = "".join(f"property {'float' if kind == 'f4' else 'double'} {c}\n" for c in "xyz")
    path.write_bytes(f"ply\nformat binary_little_endian 1.0\nelement vertex {len(v)}\n{prop}element face "
                     f"{len(t)}\nproperty list uchar uint vertex_indices\nend_header\n".encode() +
                     np.asarray(v, "<" + kind).tobytes() + faces.tobytes())
    return path


def run(program, *arguments):
    done = served.run([programs / f"isonest_mesh_{program}", *map(str, arguments)], check=True,
                      capture_output=True, text=True)
    return json.loads(done.stdout)


def near(a, b, tolerance=1e-6):
    assert abs(a - b) <= tolerance * max(1.0, abs(b)), (a, b)


def point_triangle(p, a, b, c):
    """The distance as the minimum over a projection and three segments, by least squares."""
    found = []
    solved = np.linalg.lstsq(np.stack([b - a, c - a], 1), p - a, rcond=None)[0]
    if solved.min() >= 0 and solved.sum() <= 1:
        found.append(np.linalg.norm(a + solved[0] * (b - a) + solved[1] * (c - a) - p))
    for s, e in ((a, b), (b, c), (c, a)):
        d = e - s
        w = np.clip((p - s) @ d / (d @ d), 0, 1) if d @ d > 0 else 0
        found.append(np.linalg.norm(s + w * d - p))
    return min(found)


def brute(v, t, w, s):
    """The maximum, the mean over the surface and the 99 % quantile, from the ten points and the vertices."""
    points = np.einsum("kc,tcx->tkx", TEN, v[t])
    area = np.linalg.norm(np.cross(v[t[:, 1]] - v[t[:, 0]], v[t[:, 2]] - v[t[:, 0]]), axis=1) / 2
    d = np.array([[min(point_triangle(p, *w[u]) for u in s) for p in row] for row in points])
    corner = max(min(point_triangle(p, *w[u]) for u in s) for p in v[np.unique(t)])
    order = np.argsort(d.ravel())
    weight = np.repeat(area / 10, 10)[order].cumsum()
    p99 = d.ravel()[order][np.searchsorted(weight, 0.99 * weight[-1])]
    return max(d.max(), corner), (d.mean(1) * area).sum() / area.sum(), p99


def grid(n, z, step=1.0):
    x, y = np.meshgrid(np.arange(n) * step, np.arange(n) * step, indexing="ij")
    v = np.stack([x.ravel(), y.ravel(), np.full(n * n, z)], 1)
    i = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    return v, np.concatenate([np.stack([i, i + n, i + 1], 1), np.stack([i + 1, i + n, i + n + 1], 1)])


def sphere(level, centre):
    """An octahedron, each triangle divided into four `level` times, projected to the unit sphere."""
    v = [np.array(p, float) for p in ((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1))]
    t = [(0, 2, 4), (2, 1, 4), (1, 3, 4), (3, 0, 4), (2, 0, 5), (1, 2, 5), (3, 1, 5), (0, 3, 5)]
    for _ in range(level):
        middle, cut = {}, []
        def half(a, b):
            key = (min(a, b), max(a, b))
            if key not in middle:
                middle[key] = len(v)
                v.append((v[a] + v[b]) / np.linalg.norm(v[a] + v[b]))
            return middle[key]
        for a, b, c in t:
            d, e, f = half(a, b), half(b, c), half(c, a)
            cut += [(a, d, f), (d, b, e), (f, e, c), (d, e, f)]
        t = cut
    return np.array(v) + centre, np.array(t)


def random_meshes():
    rng = np.random.default_rng(7)
    for case in range(6):
        v, w = (rng.random((n, 3)).astype("f4").astype(float) for n in (9, 12))
        t, s = (np.array([rng.choice(len(p), 3, replace=False) for _ in range(k)])
                for p, k in ((v, 5 + case), (w, 7)))
        if case == 0:  # triangles without area: a point, a segment
            s[0], w[s[1, 2]] = s[0, 0], w[s[1, 1]]
        found = run("distance", write("a.ply", v, t), write("b.ply", w, s), "--spacing", 100, "--epsilon", 1e-5)
        for name, arguments in (("a_to_b", (v, t, w, s)), ("b_to_a", (w, s, v, t))):
            worst, mean, p99 = brute(*arguments)
            side = found[name]
            assert worst <= side["max"] * (1 + 1e-8), (worst, side)
            assert side["max"] <= side["max_at_most"] <= side["max"] + 1e-5, side
            near(side["mean"], mean, 1e-5)
            near(side["p99"], p99, 5e-4)
            at = np.array(side["at"])
            near(min(point_triangle(at, *arguments[2][u]) for u in arguments[3]), side["max"])
            # No point of a fine grid on the triangles is farther than the bound.
            rows = [point for a in np.linspace(0, 1, 9) for b in np.linspace(0, 1 - a, 9)
                    for point in np.tensordot((1 - a - b, a, b), arguments[0][arguments[1]], (0, 1))]
            finer = max(min(point_triangle(p, *arguments[2][u]) for u in arguments[3]) for p in rows)
            assert finer <= side["max_at_most"] * (1 + 1e-8), (finer, side)


def planes():
    a, b = write("a.ply", *grid(9, 0.0)), write("b.ply", *grid(5, 0.25, 2.0), kind="f8")
    found = run("distance", a, b, "--epsilon", 1e-4)
    for side in (found["a_to_b"], found["b_to_a"]):
        for name in ("max", "max_at_most", "mean", "p99", "p99.9"):
            near(side[name], 0.25, 3e-4)
    # Half a plane: the distance of the far edge is the length by which the other plane extends beyond it.
    found = run("distance", a, write("b.ply", *grid(5, 0.0)))
    near(found["a_to_b"]["max"], np.sqrt(32))
    assert found["b_to_a"]["max_at_most"] < 0.004 and found["b_to_a"]["mean"] == 0, found
    assert run("distance", a, write("b.ply", *grid(5, 0.0)), "--stop-above", 1)["stopped"]
    # One triangle whose centre is farther than its corners and its ten points: the bound finds the place.
    v = np.array([(0, 0, 0), (9, 0, 0), (0, 9, 0)], float)
    w = np.array([(0, 0, 0), (9, 0, 0), (2.9, 3.3, 3), (0, 9, 0)], float)
    found = run("distance", write("a.ply", v, [(0, 1, 2)]), write("b.ply", w, [(0, 1, 2), (1, 3, 2), (3, 0, 2)]))
    near(found["b_to_a"]["max"], 3)


def spheres():
    a = write("a.ply", *sphere(5, (0, 0, 0)))
    for shift in (0.01, 0.5):
        found = run("distance", a, write("b.ply", *sphere(5, (shift, 0, 0))))
        near(found["max"], shift, 2e-3)
    v, t = sphere(5, (0, 0, 0))
    near(run("distance", a, write("b.ply", 1.1 * v, t))["max"], 0.1, 2e-3)
    small, u = sphere(0, (5, 0, 0))
    both = write("b.ply", np.concatenate([v, small]), np.concatenate([t, u + len(v)]))
    near(run("distance", a, both)["b_to_a"]["max"], 5, 2e-3)
    assert run("distance", both, a, "--min-component", 9)["max_at_most"] < 0.001
    one, two = (run("distance", a, both, "--threads", n) for n in (1, 2))
    assert one == two, (one, two)
    empty = write("e.ply", v[:0], t[:0])
    assert run("distance", a, empty)["max"] is None


def quality():
    v, t = sphere(3, (0, 0, 0))
    found = run("quality", write("a.ply", v, t))
    assert found["euler"] == 2 and found["components"] == 1 and found["triangles"] == 512, found
    clean = ("zero_area", "nonmanifold_edges", "turned_edges", "boundary_edges", "fan_vertices", "unused_vertices",
             "repeated_triangles")
    assert not any(found[name] for name in clean), found
    t[0] = t[0][::-1]
    assert run("quality", write("a.ply", v, t))["turned_edges"] == 3
    assert run("quality", write("a.ply", v, t[1:]))["boundary_edges"] == 3
    assert run("quality", write("a.ply", v, np.concatenate([t[1:], t[1:2]])))["repeated_triangles"] == 1
    # The border of a plane is in four faces of its box; in a box larger by one step, one side is not.
    v, t = grid(5, 0.0)
    path = write("a.ply", v, t)
    assert run("quality", path)["boundary_edges"] == 16
    assert run("quality", path, "--box", 0, 0, -1, 4, 4, 1)["boundary_edges_inside"] == 0
    assert run("quality", path, "--box", 0, 0, -1, 4, 5, 1)["boundary_edges_inside"] == 4
    near(run("quality", path)["angle_min"], 45)
    # Two tetrahedra that share a vertex; that share an edge; and a separate speck.
    v = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (-1, 0, 0), (0, -1, 0), (0, 0, -1)], float)
    tetra = np.array([(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)])
    other = np.array([0, 4, 5, 6])[tetra]
    found = run("quality", write("a.ply", v, np.concatenate([tetra, other])))
    assert (found["fan_vertices"], found["components"], found["nonmanifold_edges"]) == (1, 1, 0), found
    found = run("quality", write("a.ply", v, np.concatenate([tetra, np.array([0, 1, 5, 6])[tetra]])))
    assert found["nonmanifold_edges"] == 1, found
    found = run("quality", write("a.ply", v, np.concatenate([tetra, [(4, 5, 6)], [(4, 4, 5)]])))
    assert (found["components"], found["zero_area"], found["smallest_component"]) == (2, 1, 2), found
    assert run("quality", path, "--min-component", 99)["triangles"] == 0
    for bad in (b"ply\n", b"", b"ply\nformat ascii 1.0\nend_header\n",
                path.read_bytes()[:-1], path.read_bytes() + b"x"):
        (folder / "bad.ply").write_bytes(bad)
        for command in (("quality", folder / "bad.ply"), ("distance", path, folder / "bad.ply")):
            done = served.run([programs / f"isonest_mesh_{command[0]}", *command[1:]], capture_output=True)
            assert done.returncode == 1, (bad, done)


for test in (random_meshes, planes, spheres, quality):
    test()
