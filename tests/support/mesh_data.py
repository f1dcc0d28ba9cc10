"""Meshes in binary PLY and glTF: reads those of isonest, and writes PLY for programs that read it."""
import json
import struct

import numpy as np

_KINDS = {"float": "<f4", "double": "<f8", "uchar": "u1"}
_GLTF_KINDS = {5126: "<f4", 5125: "<u4", 5123: "<u2"}
_GLTF_WIDTHS = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}


def read_ply(path):
    """Vertices as a structured array, triangles."""
    data = path.read_bytes()
    end = data.index(b"end_header\n") + 11
    lines = data[:end].decode().splitlines()
    counts = [int(line.split()[2]) for line in lines if line.startswith("element")]
    fields = [(line.split()[2], _KINDS[line.split()[1]]) for line in lines
              if line.startswith("property") and "list" not in line]
    vertices = np.frombuffer(data, fields, counts[0], end)
    faces = np.frombuffer(data, [("n", "u1"), ("corners", "<i4", 3)], counts[1], end + vertices.nbytes)
    return vertices, faces["corners"]


def read_points(path):
    """Positions, (vertices, 3) float32, and triangles, int64."""
    vertices, triangles = read_ply(path)
    return np.stack([vertices[axis] for axis in "xyz"], axis=1), triangles.astype(np.int64)


def write_ply(path, points, faces):
    """Writes vertices and triangles only. points: float32; faces: vertex numbers."""
    rows = np.zeros(len(faces), [("n", "u1"), ("v", "<i4", 3)])
    rows["n"], rows["v"] = 3, faces
    path.write_bytes(f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\nproperty float x\n"
                     f"property float y\nproperty float z\nelement face {len(faces)}\n"
                     "property list uchar int vertex_indices\nend_header\n".encode()
                     + points.astype("<f4").tobytes() + rows.tobytes())


def read_glb(path):
    """The JSON header, and the arrays of the mesh by the names of their attributes and "indices"; None for a file without a
    mesh. By the specification of glTF 2.0 (Khronos Group, 2021); checks sizes, alignment and the box of the positions."""
    data = path.read_bytes()
    magic, version, total, length, kind = struct.unpack_from("<4sIII4s", data)
    assert (magic, version, kind) == (b"glTF", 2, b"JSON") and total == len(data)
    head = json.loads(data[20:20 + length])
    assert head["asset"]["version"] == "2.0"
    if "meshes" not in head:
        return head, None
    size, kind = struct.unpack_from("<I4s", data, 20 + length)
    assert kind == b"BIN\0" and 28 + length + size == len(data) and size % 4 == 0
    body = data[28 + length:]
    assert head["buffers"][0]["byteLength"] == size
    arrays = {}
    primitive = head["meshes"][0]["primitives"][0]
    assert primitive["mode"] == 4
    for name, index in [*primitive["attributes"].items(), ("indices", primitive["indices"])]:
        a = head["accessors"][index]
        view = head["bufferViews"][a["bufferView"]]
        width, kind = _GLTF_WIDTHS[a["type"]], np.dtype(_GLTF_KINDS[a["componentType"]])
        row = width * kind.itemsize
        assert view["byteLength"] == a["count"] * row and view["byteOffset"] % 4 == 0 and row % 4 == 0
        assert a.get("normalized", False) == (kind == "<u2")
        arrays[name] = np.frombuffer(body, kind, a["count"] * width, view["byteOffset"]).reshape(-1, width)
    position = head["accessors"][primitive["attributes"]["POSITION"]]
    assert np.allclose(position["min"], arrays["POSITION"].min(0))
    assert np.allclose(position["max"], arrays["POSITION"].max(0))
    return head, arrays
