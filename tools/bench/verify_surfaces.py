#!/usr/bin/python3
"""Verifies the error bound on your own volumes: runs preprocess and extract, and checks every triangle.

usage: verify_surfaces.py ISONEST PLUGIN_FOLDER INPUT...

INPUT is a volume file with the options of preprocess that it needs: "a.raw --dims 9,9,9 --type uint8".
Three isovalues (the quantiles 0.5, 0.9 and 0.99 of the distinct values), five tolerances (0, 0.5, 2, 5
and 10 % of the range). For each surface: edges with one triangle that do not lie on the volume's
boundary (so an edge with two vertices shows as a crack), edges with more than two triangles or two of
the same orientation, unused vertices, flat triangles, and the largest |U - iso| over the vertices and
three random points of each triangle, where U is the finest piecewise linear function, from the values
as h5py reads them. Prints a row of a table per volume: the number of surfaces, the largest residual as a fraction of the
tolerance, the visited tetrahedra per leaf, and the bytes read per byte of the chunks that contain leaves or their
refinement nodes, each at full resolution and with a tolerance. Faults are listed; exit code 1 if there are any. Needs
memory for the volume and the meshes, and isonest_chunk_bytes in the folder of ISONEST.
"""
import json
import os
import pathlib
import shlex
import subprocess
import sys
import tempfile

import needs

needs.require(needs.module("numpy"), needs.module("h5py"))
import numpy as np

TOLERANCES = (0, 0.005, 0.02, 0.05, 0.1)
QUANTILES = (0.5, 0.9, 0.99)


def read_ply(path):
    with open(path, "rb") as file:
        counts, line = {}, b""
        while line != b"end_header\n":
            line = file.readline()
            if line.startswith(b"element"):
                counts[line.split()[1]] = int(line.split()[2])
        v = np.frombuffer(file.read(12 * counts[b"vertex"]), "<f4").reshape(-1, 3).astype(float)
        face = np.dtype([("n", "u1"), ("i", "<u4", 3)])
        t = np.frombuffer(file.read(13 * counts[b"face"]), face)["i"].astype(np.int64)
        assert file.read() == b""
    return v, t


def finest(u, p):
    """U at points p (x, y, z in lattice units): Kuhn tetrahedra of unit cubes, mirrored by parity."""
    n = np.array(u.shape[::-1])
    cell = np.clip(np.floor(p).astype(np.int64), 0, np.maximum(n - 2, 0))
    t = p - cell
    odd = (cell & 1) == 1
    corner = cell + odd
    step = np.where(odd, -1, 1)
    t = np.where(odd, 1 - t, t)
    order = np.argsort(-t, axis=1, kind="stable")
    t = np.take_along_axis(t, order, 1)
    at = lambda c: u[tuple(np.clip(c, 0, n - 1).T[::-1])].astype(float)
    value = at(corner) * (1 - t[:, 0])
    rows = np.arange(len(p))
    for i in range(3):
        corner[rows, order[:, i]] += step[rows, order[:, i]]
        value += at(corner) * (t[:, i] - (t[:, i + 1] if i < 2 else 0))
    return value


def residual(u, spacing, v, t, iso):
    worst, rng = 0.0, np.random.default_rng(1)
    for a in range(0, len(v), 1 << 20):
        worst = max(worst, np.abs(finest(u, v[a:a + (1 << 20)] / spacing) - iso).max())
    for a in range(0, len(t), 1 << 19):
        corners = v[t[a:a + (1 << 19)]]
        for _ in range(3):
            w = rng.dirichlet((1, 1, 1), len(corners))
            p = np.einsum("ij,ijk->ik", w, corners) / spacing
            worst = max(worst, np.abs(finest(u, p) - iso).max())
    return worst


def faults(v, t, high):
    if len(t) == 0:
        return {"vertices": len(v)} if len(v) else {}
    n, found = len(v), {}
    found["unused vertices"] = n - len(np.unique(t))
    e = np.concatenate([t[:, [0, 1]], t[:, [1, 2]], t[:, [2, 0]]])
    key = e.min(1) * n + e.max(1)
    order = np.argsort(key, kind="stable")
    unique, start, count = np.unique(key[order], return_index=True, return_counts=True)
    turn = np.add.reduceat(np.where(e[:, 0] < e[:, 1], 1, -1)[order], start)
    found["edges with more than two triangles"] = int((count > 2).sum())
    found["edges of two orientations"] = int(((count == 2) & (turn != 0)).sum())
    open_edges = unique[count == 1]
    a, b = v[open_edges // n], v[open_edges % n]
    on_face = np.zeros(len(open_edges), bool)
    for face in (np.zeros(3), high):
        on_face |= ((np.abs(a - face) < 1e-3) & (np.abs(b - face) < 1e-3)).any(1)
    found["cracks"] = int((~on_face).sum())
    found["loops"] = int((e[:, 0] == e[:, 1]).sum())
    found["flat triangles"] = int((np.cross(v[t[:, 1]] - v[t[:, 0]],
                                            v[t[:, 2]] - v[t[:, 0]]) == 0).all(1).sum())
    return {name: c for name, c in found.items() if c}


def read_ratio(program, store, iso, tolerance):
    done = subprocess.run([program, store, repr(iso), str(tolerance)], check=True, capture_output=True,
                          text=True)
    return float(done.stdout.splitlines()[-2].split()[-2])


def spread(numbers):
    return f"{min(numbers):.2f} to {max(numbers):.2f}" if numbers else "-"


def verify(isonest, volume, options, folder):
    """(surfaces, residuals as fractions of the tolerance, visited per leaf and read per byte by whether there is a
    tolerance, faults)"""
    import h5py
    chunk_bytes = pathlib.Path(isonest).with_name("isonest_chunk_bytes")
    store, mesh = pathlib.Path(folder, "s.isonest"), pathlib.Path(folder, "m.ply")
    subprocess.run([isonest, "preprocess", volume, "-o", store, "-q", "--force", *options], check=True)
    with h5py.File(store) as file:
        u = file["levels/0/values"][...]
        spacing = np.array(file.attrs["spacing"])
        origin = np.array(file.attrs["origin"])
        low, high = file.attrs["range"]
    extent = (np.array(u.shape[::-1]) - 1) * spacing
    isovalues = np.quantile(np.unique(u[np.isfinite(u)]), QUANTILES)
    # Rounding a vertex to float32: half a unit in the last place of the coordinates, times
    # the steepest step between neighbours.
    steep = max(np.abs(np.diff(u.astype(float), axis=a)).max() for a in range(3))
    slack = 4 * steep * (np.abs(origin / spacing) + u.shape[::-1]).max() * 2.0**-24 * 3
    surfaces, residuals, visited, read, broken = 0, [], ([], []), ([], []), []
    for iso in isovalues:
        if u.dtype.kind in "iu":
            iso = float(round(iso))  # the difficult case: equal to values of nodes
        for tolerance in TOLERANCES:
            done = subprocess.run([isonest, "extract", store, "--iso", repr(float(iso)),
                                   "--error-relative", str(tolerance), "--cells", "tet", "--effort", "none",
                                   "-o", mesh, "--json"], check=True, capture_output=True)
            report = json.loads(done.stdout)
            v, t = read_ply(mesh)
            v -= origin
            worst = residual(u, spacing, v, t, iso) if len(t) else 0.0
            found = faults(v, t, extent)
            epsilon = tolerance * (high - low)
            surfaces += 1
            if found or worst > epsilon + slack or report["error_bound"] > epsilon or report["triangles"] != len(t):
                broken.append(f"iso {iso:g}, tolerance {epsilon:g}: residual {worst:g}, "
                              f"bound {report['error_bound']:g}, {found}")
            if len(t):
                if tolerance:
                    residuals.append(worst / epsilon)
                visited[tolerance > 0].append(report["visited_tetrahedra"] / report["leaf_tetrahedra"])
                read[tolerance > 0].append(read_ratio(chunk_bytes, store, float(iso), tolerance))
    return surfaces, residuals, visited, read, broken


def main():
    isonest, plugin, *inputs = needs.arguments(3, __doc__)
    os.environ["HDF5_PLUGIN_PATH"] = plugin
    volumes = [shlex.split(volume) for volume in inputs]
    needs.require(needs.program(isonest), *(needs.file(volume[0], "a volume that isonest reads") for volume in volumes),
                  needs.program(pathlib.Path(isonest).with_name("isonest_chunk_bytes"), "isonest_chunk_bytes"))
    needs.require(needs.zstd_filter())
    broken = False
    print("| volume | surfaces | faults | residual / tolerance | visited per leaf, full resolution; with a tolerance | "
          "read per byte needed, full resolution; with a tolerance |\n|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        for path, *options in volumes:
            surfaces, residuals, visited, read, wrong = verify(isonest, path, options, folder)
            print(f"| {pathlib.Path(path).name.split('.')[0]} | {surfaces} | {len(wrong)} | {spread(residuals)} | "
                  f"{spread(visited[0])}; {spread(visited[1])} | {spread(read[0])}; {spread(read[1])} |", flush=True)
            for fault in wrong:
                print(f"{path}: {fault}", file=sys.stderr)
            broken |= bool(wrong)
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
