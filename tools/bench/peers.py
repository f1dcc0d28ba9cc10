#!/usr/bin/python3
"""The peers of a surface within a distance: VTK's Flying Edges, and programs that simplify meshes.

usage: peers.py STORE ISOVALUE ERROR OUT.ply [MIN_COMPONENT]

Simplifies Flying Edges' mesh of the values in STORE with meshoptimizer, with the target error ERROR in the store's unit
(`full`: no simplification), writes it, and prints JSON. First removes components of fewer than MIN_COMPONENT triangles.
"""
import ctypes
import ctypes.util
import json
import sys
import time

import needs

needs.require(needs.module("numpy"), needs.module("h5py"), needs.module("vtk"),
              needs.library("meshoptimizer", "libmeshoptimizer.so.2d"))
import h5py
import numpy as np
import vtk
from vtk.util import numpy_support

meshoptimizer = ctypes.CDLL(ctypes.util.find_library("meshoptimizer") or "libmeshoptimizer.so.2d")
meshoptimizer.meshopt_simplify.restype = ctypes.c_size_t
meshoptimizer.meshopt_simplifyScale.restype = ctypes.c_float


def simplify(v, t, error, lock_border=False):
    """Triangles of the simplified mesh; `error` is an absolute distance."""
    f = v.astype(np.float32)
    scale = meshoptimizer.meshopt_simplifyScale(f.ctypes.data_as(ctypes.c_void_p),
                                                ctypes.c_size_t(len(f)), ctypes.c_size_t(12))
    index, out = t.astype(np.uint32).reshape(-1), np.empty(t.size, np.uint32)
    n = meshoptimizer.meshopt_simplify(
        out.ctypes.data_as(ctypes.c_void_p), index.ctypes.data_as(ctypes.c_void_p),
        ctypes.c_size_t(index.size), f.ctypes.data_as(ctypes.c_void_p), ctypes.c_size_t(len(f)),
        ctypes.c_size_t(12), ctypes.c_size_t(0), ctypes.c_float(error / scale),
        ctypes.c_uint(1 if lock_border else 0), None)
    return out[:n].reshape(-1, 3)


def quadric_decimation(v, t, share):
    """vtkQuadricDecimation to `share` of the triangles: vertices and triangles."""
    decimation = vtk.vtkQuadricDecimation()
    decimation.SetInputData(polydata(v, t))
    decimation.SetTargetReduction(1 - share)
    decimation.Update()
    return arrays(decimation.GetOutput())


def polydata(v, t):
    cells = vtk.vtkCellArray()
    cells.SetData(3, numpy_support.numpy_to_vtk(np.ascontiguousarray(t, np.int64).reshape(-1), deep=True))
    points = vtk.vtkPoints()
    points.SetData(numpy_support.numpy_to_vtk(np.ascontiguousarray(v), deep=True))
    mesh = vtk.vtkPolyData()
    mesh.SetPoints(points)
    mesh.SetPolys(cells)
    return mesh


def arrays(mesh):
    """Vertices and triangles, copied."""
    if mesh.GetNumberOfCells() == 0:
        return np.empty((0, 3), np.float32), np.empty((0, 3), np.int64)
    return (numpy_support.vtk_to_numpy(mesh.GetPoints().GetData()).copy(),
            numpy_support.vtk_to_numpy(mesh.GetPolys().GetConnectivityArray()).reshape(-1, 3).copy())


def store_edges(store, iso):
    """Flying Edges' mesh of a store's values, in world coordinates, and the seconds without reading."""
    with h5py.File(store) as file:
        u = file["levels/0/values"][...]
        spacing, origin = file.attrs["spacing"], file.attrs["origin"]
    image = vtk.vtkImageData()
    image.SetDimensions(*u.shape[::-1])
    image.SetSpacing(*spacing)
    image.SetOrigin(*origin)
    image.GetPointData().SetScalars(numpy_support.numpy_to_vtk(u.reshape(-1), deep=False))
    start = time.perf_counter()
    edges = vtk.vtkFlyingEdges3D()
    edges.SetInputData(image)
    edges.SetValue(0, iso)
    edges.ComputeNormalsOff()
    edges.ComputeScalarsOff()
    edges.Update()
    return *arrays(edges.GetOutput()), time.perf_counter() - start


def drop_small_components(v, t, least):
    """The triangles of components (connected by vertices) with at least `least` triangles."""
    if least <= 1 or len(t) == 0:
        return t
    regions = vtk.vtkPolyDataConnectivityFilter()
    regions.SetInputData(polydata(v, t))
    regions.SetExtractionModeToAllRegions()
    regions.ColorRegionsOn()
    regions.Update()
    # The order of its points differs, that of its triangles does not.
    mesh = regions.GetOutput()
    of = numpy_support.vtk_to_numpy(mesh.GetPointData().GetScalars())[arrays(mesh)[1][:, 0]]
    return t[np.bincount(of)[of] >= least]


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
    store, iso, error, out, *least = needs.arguments(4, __doc__, 5)
    needs.require(needs.file(store, "a store"), needs.zstd_filter())
    v, t, extracted = store_edges(store, float(iso))
    full, start = len(t), time.perf_counter()
    t = drop_small_components(v, t, int(least[0]) if least else 0)
    dropped = time.perf_counter()
    simple = t if error == "full" else simplify(v, t, float(error))
    simplified = time.perf_counter()
    write_ply(out, v, simple)
    print(json.dumps({"full_triangles": full, "kept_triangles": len(t), "triangles": len(simple),
                      "extract": extracted, "drop": dropped - start, "simplify": simplified - dropped}))


if __name__ == "__main__":
    main()
