"""Tilesets of 3D Tiles 1.1 and their glTF tiles, read by their specifications (OGC 22-025r4, Khronos glTF 2.0), and
distances by VTK. Packed buffers are decoded by meshoptimizer's own decoder (npm), with node."""
import collections
import json
import os
import pathlib
import shutil
import struct
import subprocess

import numpy as np
from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray
from vtkmodules.vtkCommonCore import mutable, vtkPoints
from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkGenericCell, vtkPolyData, vtkStaticCellLocator

MODULES = pathlib.Path(__file__).resolve().parents[2] / "tools/view/web/node_modules"
STEPS = 32768  # of a tile's edge
KINDS = {5120: "i1", 5121: "u1", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}


def is_readable():
    return (MODULES / "meshoptimizer").is_dir() and shutil.which("node") is not None


Tile = collections.namedtuple("Tile", "level cube error box children head arrays path")


def read_glb(path):
    """The header and the arrays; positions in whole steps."""
    data = path.read_bytes()
    magic, version, total, length, kind = struct.unpack_from("<4sIII4s", data)
    assert (magic, version, kind) == (b"glTF", 2, b"JSON") and total == len(data) and length % 4 == 0
    head = json.loads(data[20:20 + length])
    size, kind = struct.unpack_from("<I4s", data, 20 + length)
    assert kind == b"BIN\0" and 28 + length + size == len(data) and head["buffers"][0]["byteLength"] == size
    unpacked = pathlib.Path(f"{path}.bin").read_bytes()
    start, at = {}, 0
    for i, view in enumerate(head["bufferViews"]):
        start[i] = at
        at += (view["byteLength"] + 7) // 8 * 8
    assert at == len(unpacked)
    primitive = head["meshes"][0]["primitives"][0]
    arrays = {}
    for name, index in [*primitive["attributes"].items(), ("indices", primitive["indices"])]:
        a = head["accessors"][index]
        view = head["bufferViews"][a["bufferView"]]
        kind, width = np.dtype(KINDS[a["componentType"]]), WIDTHS[a["type"]]
        stride = view.get("byteStride", kind.itemsize * width)
        assert (name == "indices") == ("byteStride" not in view) and stride * a["count"] == view["byteLength"]
        assert name == "indices" or stride % 4 == 0
        raw = np.frombuffer(unpacked, np.uint8, a["count"] * stride, start[a["bufferView"]]).reshape(-1, stride)
        arrays[name] = np.ascontiguousarray(raw[:, :kind.itemsize * width]).view(kind).reshape(a["count"], width)
    position = head["accessors"][primitive["attributes"]["POSITION"]]
    assert position["min"] == arrays["POSITION"].min(0).tolist() and position["max"] == arrays["POSITION"].max(0).tolist()
    arrays["indices"] = arrays["indices"].reshape(-1, 3).astype(np.int64)
    return head, arrays, {"start": start, "bytes": unpacked}


class Tileset:
    """A folder of tiles; every file in it is used."""

    def __init__(self, folder):
        self.folder = pathlib.Path(folder)
        done = subprocess.run(["node", pathlib.Path(__file__).with_name("unpack_tiles.mjs"), MODULES, self.folder],
                              capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        self.used = set()
        self.head = self.json("tileset.json")
        self.transform = np.array(self.head["root"].pop("transform"), float).reshape(4, 4).T
        self.tiles = []
        self.empty = 0
        self.root = self.walk(self.head["root"], pathlib.PurePosixPath("."))
        files = {p.relative_to(self.folder).as_posix() for p in self.folder.rglob("*")
                 if p.is_file() and p.suffix != ".bin"}
        assert files == self.used, files ^ self.used

    def json(self, path):
        self.used.add(path)
        head = json.loads((self.folder / path).read_text())
        assert head["asset"]["version"] == "1.1" and head["geometricError"] >= head["root"]["geometricError"]
        return head

    def walk(self, tile, folder):
        assert tile["refine"] == "REPLACE"
        uri = tile.get("content", {}).get("uri")
        path = os.path.normpath(folder / uri) if uri else None
        if path and path.endswith(".json"):
            inner = self.json(path)["root"]
            assert inner["boundingVolume"] == tile["boundingVolume"] and "children" not in tile
            assert inner["geometricError"] == tile["geometricError"]
            return self.walk(inner, pathlib.PurePosixPath(path).parent)
        children = [self.walk(child, folder) for child in tile.get("children", [])]
        box = np.array(tile["boundingVolume"]["box"]).reshape(4, 3)
        low, high = box[0] - box[1:].diagonal(), box[0] + box[1:].diagonal()
        head = arrays = cube = level = None
        if path:
            self.used.add(path)
            _, level, name = path.split("/")
            level, cube = int(level), np.array([int(n) for n in name.split(".")[0].split("_")])
            head, arrays, self.raw = read_glb(self.folder / path)
        else:
            self.empty += 1
        made = Tile(level, cube, tile["geometricError"], (low, high), children, head, arrays, path)
        for child in children:
            assert child.error <= made.error, "errors decrease towards the leaves"
            assert (child.box[0] >= low - 1e-9).all() and (child.box[1] <= high + 1e-9).all()
        if path:
            points = self.local(made)
            assert (points >= low).all() and (points <= high).all()
            self.tiles.append(made)
        return made

    def local(self, tile):
        """In the tileset's coordinates, z up, as a viewer computes them."""
        node = tile.head["nodes"][0]
        assert np.allclose(node["rotation"], [-2**-0.5, 0, 0, 2**-0.5])
        scaled = tile.arrays["POSITION"][:, :3].astype(float) * node["scale"]
        turned = np.stack([scaled[:, 0], scaled[:, 2], -scaled[:, 1]], 1) + node["translation"]  # y is up in glTF
        return np.stack([turned[:, 0], -turned[:, 2], turned[:, 1]], 1)  # and z in tiles

    def world(self, tile):
        return self.local(tile) @ self.transform[:3, :3].T + self.transform[:3, 3]

    def steps(self, tile):
        """Corners in whole steps of level 0."""
        return (tile.cube * STEPS + tile.arrays["POSITION"][:, :3].astype(np.int64)) << tile.level

    def of_level(self, level):
        return [tile for tile in self.tiles if tile.level == level]

    @property
    def levels(self):
        return max(tile.level for tile in self.tiles) + 1


class Distance:
    """From points to a mesh."""

    def __init__(self, points, faces):
        data, at = vtkPolyData(), vtkPoints()
        at.SetDataTypeToDouble()
        at.SetData(numpy_to_vtk(np.ascontiguousarray(points, float), deep=True))
        cells = vtkCellArray()
        rows = np.insert(np.asarray(faces, np.int64), 0, 3, axis=1).ravel()
        cells.SetCells(len(faces), numpy_to_vtkIdTypeArray(rows, deep=True))
        data.SetPoints(at)
        data.SetPolys(cells)
        self.data = data
        self.locator = vtkStaticCellLocator()
        self.locator.SetDataSet(data)
        self.locator.BuildLocator()
        self.cell = vtkGenericCell()

    def largest(self, points):
        worst, near = 0.0, [0.0] * 3
        number, part, square = mutable(0), mutable(0), mutable(0.0)
        for p in points:
            self.locator.FindClosestPoint(p, near, self.cell, number, part, square)
            worst = max(worst, float(square) ** 0.5)
        return worst


def samples(points, faces, random, count=400):
    """Vertices, and points in random triangles."""
    chosen = faces[random.integers(0, len(faces), count)]
    weights = random.dirichlet((1, 1, 1), count)
    return np.concatenate([points[random.choice(len(points), min(count, len(points)), False)],
                           (points[chosen] * weights[:, :, None]).sum(1)])
