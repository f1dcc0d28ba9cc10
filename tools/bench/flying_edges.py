"""VTK's Flying Edges from the dataset /data of an HDF5 file to a PLY file: a peer that needs the whole volume in
memory. Prints JSON with the seconds of reading, extracting and writing.

usage: flying_edges.py IN.h5 ISOVALUE OUT.ply
"""
import json
import sys
import time

import needs

needs.require(needs.module("h5py"), needs.module("vtk"))
import h5py
import vtk
from vtk.util import numpy_support


def read_image(path):
    """The values, and the image that shares their memory."""
    with h5py.File(path) as f:
        data = f["data"][...]
    image = vtk.vtkImageData()
    image.SetDimensions(*data.shape[::-1])
    image.GetPointData().SetScalars(numpy_support.numpy_to_vtk(data.reshape(-1), deep=False))
    return data, image


def flying_edges(image, iso):
    edges = vtk.vtkFlyingEdges3D()
    edges.SetInputData(image)
    edges.SetValue(0, iso)
    edges.ComputeNormalsOff()
    edges.ComputeScalarsOff()
    edges.Update()
    return edges.GetOutput()


def main():
    path, iso, out = needs.arguments(3, __doc__, 3)
    needs.require(needs.file(path, "an HDF5 file with a dataset /data"))
    iso = float(iso)
    start = time.perf_counter()
    _data, image = read_image(path)
    read = time.perf_counter()
    mesh = flying_edges(image, iso)
    extracted = time.perf_counter()
    writer = vtk.vtkPLYWriter()
    writer.SetInputData(mesh)
    writer.SetFileName(out)
    writer.SetFileTypeToBinary()
    writer.Write()
    end = time.perf_counter()
    print(json.dumps({"triangles": mesh.GetNumberOfCells(), "read": read - start,
                      "extract": extracted - read, "write": end - extracted, "total": end - start}))


if __name__ == "__main__":
    main()
