#!/usr/bin/python3
"""The Python package compared with scikit-image's marching_cubes and VTK's Flying Edges, from array to arrays.

usage: python_peers.py BUILD SIZE [ROUNDS [arrays]]

The volume is a gyroid of SIZE^3 float32, isovalue 0.1; with 384^3 nodes it has triangles that need mending. SIZE may
also be NZxNYxNX@STEP, where a wave is 2 pi / STEP nodes long. Every round runs all rows once; a figure is the median of
the rounds, followed by the smallest and the largest. With "arrays", only the rows from an array to arrays at full
resolution are run. They are compared round by round with their equivalent: Flying Edges with or without normals, and
without the scalars that it adds by default. scikit-image always computes normals. Processor time is user and system, of
all threads. BUILD is a build tree with the package in BUILD/python.
"""
import os
import resource
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
lengths, _, step = size.partition("@")
nodes = [int(n) for n in lengths.split("x")]
nodes = nodes * 3 if len(nodes) == 1 else nodes
step = np.float32(step or 20 / max(nodes))
z, y, x = np.meshgrid(*[np.arange(n, dtype=np.float32) * step for n in nodes], indexing="ij", sparse=True)
volume = np.sin(x) * np.cos(y) + np.sin(y) * np.cos(z) + np.sin(z) * np.cos(x)


def flying_edges(normals=True, scalars=True):
    image = vtkImageData()
    image.SetDimensions(volume.shape[::-1])
    image.GetPointData().SetScalars(numpy_to_vtk(volume.ravel()))
    edges = vtkFlyingEdges3D()
    edges.SetInputData(image)
    edges.SetValue(0, ISO)
    edges.SetComputeNormals(normals)
    edges.SetComputeScalars(scalars)
    edges.Update()
    mesh = edges.GetOutput()
    return len(vtk_to_numpy(mesh.GetPolys().GetConnectivityArray())) // 3


with tempfile.TemporaryDirectory(prefix="isonest-bench-") as folder:
    path = os.path.join(folder, "x.isonest")
    SKIMAGE = "scikit-image, `marching_cubes(volume, 0.1)`"
    EDGES, EDGES_ALONE = "Flying Edges, with normals", "Flying Edges, without"
    PEERS = {
        SKIMAGE: lambda: len(marching_cubes(volume, ISO)[1]),
        "VTK, `vtkFlyingEdges3D`": flying_edges,
    }
    OWN = {
        "`isosurface(volume, 0.1)`": lambda: len(isonest.isosurface(volume, ISO).faces),
        "`isosurface(volume, 0.1, normals=False)`": lambda: len(isonest.isosurface(volume, ISO, normals=False).faces),
    }
    is_short = rounds[1:] == ["arrays"]
    if is_short:
        PEERS = {
            SKIMAGE: PEERS[SKIMAGE],
            EDGES: lambda: flying_edges(True, False),
            EDGES_ALONE: lambda: flying_edges(False, False),
        }
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
    seconds, of_processor, triangles = {name: [] for name in ROWS}, {name: [] for name in ROWS}, {}

    def processor_seconds():
        usage = resource.getrusage(resource.RUSAGE_SELF)
        return usage.ru_utime + usage.ru_stime
    for _ in range(int(rounds[0]) if rounds else 3):
        for name, call in ROWS.items():
            begin, begin_processor = time.perf_counter(), processor_seconds()
            triangles[name] = call()
            seconds[name].append(time.perf_counter() - begin)
            of_processor[name].append(processor_seconds() - begin_processor)

print(f"| {'x'.join(map(str, nodes))} | seconds | of the processor, at least | triangles |\n|---|---|---|---|")
for name, times in seconds.items():
    count = "" if triangles[name] is None else f"{triangles[name]:,}"
    print(f"| {name} | {statistics.median(times):.3f} ({min(times):.3f} to {max(times):.3f}) | {min(of_processor[name]):.3f} "
          f"| {count} |")
if is_short:
    print("\n| | time against scikit-image | against Flying Edges, which does the same | processor time against it |\n"
          "|---|---|---|---|")
    for name, edges in zip(OWN, (EDGES, EDGES_ALONE)):
        cells = [[own / peer for own, peer in zip(times[name], times[other])]
                 for times, other in ((seconds, SKIMAGE), (seconds, edges), (of_processor, edges))]
        print(f"| {name} | " + " | ".join(f"{statistics.median(r):.2f} ({min(r):.2f} to {max(r):.2f})" for r in cells) + " |")
