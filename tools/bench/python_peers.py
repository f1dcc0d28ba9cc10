#!/usr/bin/python3
"""The Python package beside scikit-image's marching_cubes and VTK's Flying Edges, from array to arrays.

usage: python_peers.py BUILD SIZE [ROUNDS [arrays]]

The volume is a gyroid of SIZE^3 float32, isovalue 0.1; that of 384^3 has triangles that need mending. Every round runs
all rows once; a figure is the median of the rounds, with the smallest and the largest behind it. With "arrays" only the
rows that go from an array to arrays at full resolution are run, and their times are compared round by round. BUILD is a
build tree with the package in BUILD/python.
"""
import os
import statistics
import sys
import tempfile
import time

import needs

build, size, *rounds = needs.arguments(2, __doc__, 4)
needs.require(needs.module("numpy"), needs.module("skimage"), needs.module("vtkmodules"))
sys.path.insert(0, os.path.join(build, "python"))
try:
    import isonest
except ImportError as error:
    sys.exit(f"python_peers.py: {error}: build it, cmake --build {build} --target isonest_python")
import numpy as np
from skimage.measure import marching_cubes
from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy
from vtkmodules.vtkCommonDataModel import vtkImageData
from vtkmodules.vtkFiltersCore import vtkFlyingEdges3D

ISO = 0.1
n = int(size)
z, y, x = np.meshgrid(*[np.arange(n, dtype=np.float32) * np.float32(20 / n)] * 3, indexing="ij", sparse=True)
volume = np.sin(x) * np.cos(y) + np.sin(y) * np.cos(z) + np.sin(z) * np.cos(x)


def flying_edges():
    image = vtkImageData()
    image.SetDimensions(volume.shape[::-1])
    image.GetPointData().SetScalars(numpy_to_vtk(volume.ravel()))
    edges = vtkFlyingEdges3D()
    edges.SetInputData(image)
    edges.SetValue(0, ISO)
    edges.Update()
    mesh = edges.GetOutput()
    return len(vtk_to_numpy(mesh.GetPolys().GetConnectivityArray())) // 3


with tempfile.TemporaryDirectory(prefix="isonest-bench-") as folder:
    path = os.path.join(folder, "x.isonest")
    PEERS = {
        "scikit-image, `marching_cubes(volume, 0.1)`": lambda: len(marching_cubes(volume, ISO)[1]),
        "VTK, `vtkFlyingEdges3D`": flying_edges,
    }
    OWN = {
        "`isosurface(volume, 0.1)`": lambda: len(isonest.isosurface(volume, ISO).faces),
        "`isosurface(volume, 0.1, normals=False)`": lambda: len(isonest.isosurface(volume, ISO, normals=False).faces),
    }
    is_short = rounds[1:] == ["arrays"]
    if not is_short:
        isonest.preprocess(volume, path, indicators=["linf_bar", "linf_plus", "deviation_bar", "hex_deviation"])
        store = isonest.open(path)
    ROWS = {**PEERS, **OWN} if is_short else {
        **PEERS, **OWN,
        '`isosurface(volume, 0.1, cells="tet")`': lambda: len(isonest.isosurface(volume, ISO, cells="tet").faces),
        "`isosurface(volume, 0.1, distance=0.5)`": lambda: len(isonest.isosurface(volume, ISO, distance=0.5).faces),
        '`isosurface(volume, 0.1, distance=0.5, effort="fast")`':
            lambda: len(isonest.isosurface(volume, ISO, distance=0.5, effort="fast").faces),
        "`isosurface(volume, 0.1, error=0.03)`": lambda: len(isonest.isosurface(volume, ISO, error=0.03).faces),
        "`preprocess(volume, ...)`": lambda: isonest.preprocess(volume, path + "2", replace=True) and None,
        "`store.isosurface(0.1)`": lambda: len(store.isosurface(ISO).faces),
        "`store.isosurface(0.1, normals=False)`": lambda: len(store.isosurface(ISO, normals=False).faces),
        '`store.isosurface(0.1, cells="hexahedra")`': lambda: len(store.isosurface(ISO, cells="hexahedra").faces),
        "`store.isosurface(0.1, distance=0.5)`": lambda: len(store.isosurface(ISO, distance=0.5).faces),
        '`store.isosurface(0.1, distance=0.5, effort="fast")`':
            lambda: len(store.isosurface(ISO, distance=0.5, effort="fast").faces),
        "`store.isosurface(0.1, error=0.03)`": lambda: len(store.isosurface(ISO, error=0.03).faces),
        "`store.isosurface(0.1, error=0.3)`": lambda: len(store.isosurface(ISO, error=0.3).faces),
        "`store.slice((1, 0, 0), 35)`": lambda: len(store.slice((1, 0, 0), 35).faces),
        "`store.values()`": lambda: store.values() is None or None,
    }
    seconds, triangles = {name: [] for name in ROWS}, {}
    for _ in range(int(rounds[0]) if rounds else 3):
        for name, call in ROWS.items():
            begin = time.perf_counter()
            triangles[name] = call()
            seconds[name].append(time.perf_counter() - begin)

print(f"| {n}^3 | seconds | triangles |\n|---|---|---|")
for name, times in seconds.items():
    count = "" if triangles[name] is None else f"{triangles[name]:,}"
    print(f"| {name} | {statistics.median(times):.3f} ({min(times):.3f} to {max(times):.3f}) | {count} |")
if is_short:
    print("\n| | " + " | ".join(f"time against {name.split(',')[0]}" for name in PEERS) + " |\n|---|---|---|")
    for name in OWN:
        ratios = [[own / peer for own, peer in zip(seconds[name], seconds[other])] for other in PEERS]
        print(f"| {name} | " + " | ".join(f"{statistics.median(r):.2f} ({min(r):.2f} to {max(r):.2f})" for r in ratios) + " |")
