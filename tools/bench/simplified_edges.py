"""The peers' way to a surface at a tolerance, and ours, at the same measured residual.

usage: simplified_edges.py ISONEST STORE IN.h5 ISOVALUE ERROR_RELATIVE [FOLDER [ROUNDS]]

Ours: `isonest extract --error-relative`. Theirs: VTK's Flying Edges of the whole volume, then
meshoptimizer's simplification with the largest error for which the measured residual is no larger than
ours, found by bisection. Then both run ROUNDS (5) times, in turn; the figures are the medians of their
seconds and of the rounds' ratios, with the smallest and the largest. The residual is the largest |U - iso| at the
vertices and at three random points of every triangle, U being the finest piecewise linear function.
Neither side's seconds contain the start of its program. Prints JSON. Needs memory for the volume and the meshes.
"""
import json
import pathlib
import statistics
import subprocess
import sys
import tempfile
import time

import needs

needs.arguments(5, __doc__, 7)
needs.require(needs.module("numpy"), needs.module("vtk"), needs.module("h5py"),
              needs.library("meshoptimizer", "libmeshoptimizer.so.2d"), needs.program(sys.argv[1]),
              needs.file(sys.argv[2], "a store"), needs.file(sys.argv[3], "the HDF5 file that it is made of"))
import numpy as np
from vtk.util import numpy_support

from flying_edges import flying_edges, read_image
from peers import simplify, write_ply
from verify_surfaces import read_ply, residual

def main():
    isonest, store, volume, iso, relative = sys.argv[1:6]
    iso = float(iso)
    folder = sys.argv[6] if len(sys.argv) > 6 else tempfile.mkdtemp()
    pathlib.Path(folder).mkdir(parents=True, exist_ok=True)
    rounds = int(sys.argv[7]) if len(sys.argv) > 7 else 5
    mesh = pathlib.Path(folder, "tolerance.ply")

    def extract():
        done = subprocess.run([isonest, "extract", store, "--iso", str(iso), "--error-relative",
                               relative, "-o", mesh, "--json"], check=True, capture_output=True)
        return json.loads(done.stdout)

    def edges():
        u, image = read_image(volume)
        output = flying_edges(image, iso)
        v = numpy_support.vtk_to_numpy(output.GetPoints().GetData())
        t = numpy_support.vtk_to_numpy(output.GetPolys().GetConnectivityArray()).reshape(-1, 3)
        return u, v, t, (image, output)

    ours = extract()
    u, v, t, alive = edges()
    one = np.ones(3)
    reached = residual(u, one, *read_ply(mesh), iso)
    low, high = 0.0, 4.0  # lattice units
    for _ in range(9):
        middle = (low + high) / 2
        simple = simplify(v, t, middle)
        good = len(simple) and residual(u, one, v.astype(float), simple.astype(np.int64), iso) <= reached
        low, high = (middle, high) if good else (low, middle)
    simple = simplify(v, t, low)
    peer_residual = residual(u, one, v.astype(float), simple.astype(np.int64), iso)
    full = len(t)
    del u, v, t, alive

    seconds, peer_seconds = [], []
    for _ in range(rounds):
        seconds.append(extract()["seconds"])
        start = time.perf_counter()
        u, v, t, alive = edges()
        write_ply(pathlib.Path(folder, "simplified.ply"), v, simplify(v, t, low))
        peer_seconds.append(time.perf_counter() - start)
        del u, v, t, alive
    ratios = [p / s for s, p in zip(seconds, peer_seconds)]
    print(json.dumps({
        "tolerance": ours["tolerance"], "residual": reached, "bound": ours["error_bound"],
        "triangles": ours["triangles"], "peer_triangles": len(simple), "peer_full_triangles": full,
        "peer_error": low, "peer_residual": peer_residual,
        "seconds": statistics.median(seconds), "peer_seconds": statistics.median(peer_seconds),
        "ratio": statistics.median(ratios), "smallest_ratio": min(ratios),
        "largest_ratio": max(ratios)}))


if __name__ == "__main__":
    main()
