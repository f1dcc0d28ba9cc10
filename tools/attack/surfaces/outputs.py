"""Mesh files, read by others; and the same bytes, however they were made."""
import json
import struct
import zipfile
from xml.etree import ElementTree

import h5py
import numpy as np
import vtk
from vtk.util.numpy_support import vtk_to_numpy

from . import volumes
from .tries import ask, kind, require, some_box, store_of, surface, world_box


READERS = {"ply": "vtkPLYReader", "stl": "vtkSTLReader", "obj": "vtkOBJReader", "vtp": "vtkXMLPolyDataReader"}


def read_mesh(path):
    """Vertices and triangles of a file, by VTK, h5py or, for 3MF and glTF, what their specifications say."""
    ending = path.suffix[1:]
    if ending in READERS:
        reader = getattr(vtk, READERS[ending])()
        reader.SetFileName(str(path))
        if ending == "stl":
            reader.MergingOff()
        reader.Update()
        data = reader.GetOutput()
        if not data.GetNumberOfPoints():
            return np.zeros((0, 3)), np.zeros((0, 3), int)
        return (vtk_to_numpy(data.GetPoints().GetData()),
                vtk_to_numpy(data.GetPolys().GetConnectivityArray()).reshape(-1, 3))
    if ending == "vtkhdf":
        with h5py.File(path) as file:
            root = file["VTKHDF"]
            return root["Points"][:], root["Polygons/Connectivity"][:].reshape(-1, 3)
    if ending == "3mf":
        with zipfile.ZipFile(path) as archive:
            require(archive.testzip() is None, "a damaged archive")
            root = ElementTree.fromstring(archive.read("3D/3dmodel.model"))
        name = "{http://schemas.microsoft.com/3dmanufacturing/core/2015/02}"
        v = [[float(e.get(c)) for c in "xyz"] for e in root.iter(name + "vertex")]
        f = [[int(e.get(c)) for c in ("v1", "v2", "v3")] for e in root.iter(name + "triangle")]
        return np.array(v, float).reshape(-1, 3), np.array(f, int).reshape(-1, 3)
    raw = path.read_bytes()
    magic, version, length, size, chunk = struct.unpack("<4sII I4s", raw[:20])
    require((magic, version, length, chunk) == (b"glTF", 2, len(raw), b"JSON"), "a header that is not glTF's")
    head, body = json.loads(raw[20:20 + size]), raw[28 + size:]
    if not head.get("meshes"):
        return np.zeros((0, 3)), np.zeros((0, 3), int)

    def array(number, dtype, columns):
        accessor = head["accessors"][number]
        view = head["bufferViews"][accessor["bufferView"]]
        at = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        return np.frombuffer(body, dtype, accessor["count"] * columns, at).reshape(-1, columns)

    primitive = head["meshes"][0]["primitives"][0]
    kinds = {5123: "<u2", 5125: "<u4"}
    v = array(primitive["attributes"]["POSITION"], "<f4", 3)
    f = array(primitive["indices"], kinds[head["accessors"][primitive["indices"]]["componentType"]], 1).reshape(-1, 3)
    for node in head.get("nodes", []):
        v = v * np.array(node.get("scale", (1, 1, 1))) + np.array(node.get("translation", (0, 0, 0)))
    return v, f


@kind
def formats(one):
    """The same mesh in every format, by other programs' readers."""
    volume = volumes.volume(one, most=12)
    iso = volumes.isovalue(one, volume.u)
    store = store_of(one, volume)
    options = one.pick({}, {"error": volumes.error(one, volume.u)}, {"cells": "hex"}, {"close": True})
    mesh = surface(one, store, iso, **options)
    for ending in one.random.permutation([*READERS, "vtkhdf", "3mf", "glb"])[:4]:
        path = one.folder / f"m.{ending}"
        ask(one, mesh.save, path)
        v, f = read_mesh(path)
        require(len(f) == len(mesh.faces), f"{ending}: {len(f)} triangles, not {len(mesh.faces)}")
        if not len(f):
            continue
        if ending == "glb":  # turned to y up and moved, perhaps
            a, b = (np.sort(np.linalg.norm(p[q] - p[np.roll(q, 1, 1)], axis=2), 1) for p, q in
                    ((v, f), (np.asarray(mesh.vertices, float), mesh.faces)))
            size = np.abs(mesh.vertices).max()
            require(np.abs(a - b).max() <= 1e-5 * size, f"glb: an edge of another length, by {np.abs(a - b).max()}")
            continue
        a, b = np.asarray(v, "f4")[f], np.asarray(mesh.vertices)[mesh.faces]
        if ending == "stl":
            a = np.asarray(v, "f4").reshape(-1, 3)[f]
        require(np.array_equal(a, b), f"{ending}: other triangles, by {np.abs(a.astype(float) - b).max()}")


@kind
def determinism(one):
    """Threads, memory and chunks do not change a byte."""
    volume = volumes.volume(one, most=16)
    iso = volumes.isovalue(one, volume.u)
    options = one.pick({"error": volumes.error(one, volume.u)}, {"error": volumes.error(one, volume.u), "close": True},
                       {"cells": "hex"}, {"distance": 0.5 * volume.unit}, {"distance": volume.unit, "effort": "fast"},
                       {"error": volumes.error(one, volume.u), "simplify": True}, {"components": 3, "close": True},
                       {"distance": 0.7 * volume.unit, "no_simplify": True},
                       {"triangles": int(one.random.integers(200, 3000))})
    if one.chance(0.2) and not volume.turned:
        options["box"] = world_box(volume, *some_box(one, volume))
    made = {}
    for chunk in (8, 64):
        store = store_of(one, volume, f"c{chunk}", chunk=chunk)
        for extra in ({"threads": 1}, {"threads": 4}, {"threads": 4, "memory": "96M"}):
            mesh = ask(one, store.isosurface, iso, coordinates="world", normals=True, **options, **extra)
            made[chunk, str(extra)] = (mesh.vertices.tobytes(), mesh.faces.tobytes(), np.asarray(mesh.normals).tobytes(),
                                       repr(mesh.report.area), mesh.report.error_bound, mesh.report.distance_bound)
    first = next(iter(made.values()))
    for how, one_of in made.items():
        require(one_of == first, f"{how}: other bytes, of {[a == b for a, b in zip(one_of, first)]}")
