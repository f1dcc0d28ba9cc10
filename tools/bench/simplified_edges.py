"""The peers' way to a surface at a tolerance, and ours, at the same measured residual.

usage: simplified_edges.py ISONEST STORE IN.h5 ISOVALUE ERROR_RELATIVE [FOLDER [ROUNDS]]

Ours: `isonest extract --error-relative`. Theirs: VTK's Flying Edges of the whole volume, then
meshoptimizer's simplification with the largest error for which the measured residual is no larger than
ours, found by bisection. Then both run ROUNDS (5) times, in turn; the figures are the medians of their
seconds and of the rounds' ratios, with the smallest and the largest. The residual is the largest |U - iso| at the
vertices and at three random points of every triangle, U being the finest piecewise linear function.
Neither side's seconds contain the start of its program. Prints JSON. Needs memory for the volume and the meshes.
"""
import ctypes
import ctypes.util
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
from verify_surfaces import read_ply, residual

meshoptimizer = ctypes.CDLL(ctypes.util.find_library("meshoptimizer") or "libmeshoptimizer.so.2d")
meshoptimizer.meshopt_simplify.restype = ctypes.c_size_t
meshoptimizer.meshopt_simplifyScale.restype = ctypes.c_float


def simplify(v, t, error):
    """Triangles of the simplified mesh; `error` is an absolute distance."""
    f = v.astype(np.float32)
    scale = meshoptimizer.meshopt_simplifyScale(f.ctypes.data_as(ctypes.c_void_p),
                                                ctypes.c_size_t(len(f)), ctypes.c_size_t(12))
    index, out = t.astype(np.uint32).reshape(-1), np.empty(t.size, np.uint32)
    n = meshoptimizer.meshopt_simplify(
        out.ctypes.data_as(ctypes.c_void_p), index.ctypes.data_as(ctypes.c_void_p),
        ctypes.c_size_t(index.size), f.ctypes.data_as(ctypes.c_void_p), ctypes.c_size_t(len(f)),
        ctypes.c_size_t(12), ctypes.c_size_t(0), ctypes.c_float(error / scale), ctypes.c_uint(0),
        None)
    return out[:n].reshape(-1, 3)


def write_ply(path, v, t):
    used = np.zeros(len(v), bool)
    used[t.reshape(-1)] = True
    faces = np.empty(len(t), np.dtype([("n", "u1"), ("i", "<u4", 3)]))
    faces["n"], faces["i"] = 3, (np.cumsum(used) - 1)[t]
    with open(path, "wb") as file:
        file.write(b"ply\nformat binary_little_endian 1.0\nelement vertex %d\nproperty float x\n"
                   b"property float y\nproperty float z\nelement face %d\nproperty list uchar uint "
                   b"vertex_indices\nend_header\n" % (np.count_nonzero(used), len(t)))
        file.write(v[used].astype("<f4").tobytes())
        file.write(faces.tobytes())


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
