"""What the answers should be: from the numbers that went into the store, and from isonest's Python package."""
import ctypes
import ctypes.util
import json
import struct

import numpy as np

STEPS = 65535


def codec():
    """meshoptimizer's library, which decodes; None if it is not there."""
    name = ctypes.util.find_library("meshoptimizer")
    return ctypes.CDLL(name) if name else None


def decoded(message, library):
    """The header of a mesh, with its sections under their names; ValueError where it is not as PROTOCOL.md says."""
    magic, version, length, zero = struct.unpack_from("<4sIII", message)
    if (magic, version, zero) != (b"ISOV", 1, 0) or length % 16 or 16 + length > len(message):
        raise ValueError("no mesh")
    header, at = json.loads(message[16:16 + length]), 16 + length
    kinds = {"positions": ("<u2", 4), "normals": ("i1", 4), "indices": ("<u4", 3)}
    for section in header["sections"]:
        data, count, stride = message[at:at + section["bytes"]], section["count"], section["stride"]
        fill = message[at + section["bytes"]:at + -(-section["bytes"] // 16) * 16]
        at += len(data) + len(fill)
        if len(data) != section["bytes"] or any(fill):
            raise ValueError("a section that does not fit")
        if section["encoding"] != "raw":
            out = ctypes.create_string_buffer(max(count * stride, 1))
            decode = {"meshopt_vertex": library.meshopt_decodeVertexBuffer,
                      "meshopt_index": library.meshopt_decodeIndexBuffer}[section["encoding"]]
            if decode(out, ctypes.c_size_t(count), ctypes.c_size_t(stride), data, ctypes.c_size_t(len(data))) != 0:
                raise ValueError("a section that does not decode")
            data = out.raw[:count * stride]
        dtype, columns = kinds[section["name"]]
        header[section["name"]] = np.frombuffer(data, dtype).reshape(-1, columns)
    if at != len(message):
        raise ValueError("bytes behind the mesh")
    return header


def _turned(faces):
    """Each triangle begun with its smallest corner."""
    faces = faces.astype(np.int64)
    first = faces.argmin(axis=1)[:, None]
    return np.take_along_axis(faces, (first + np.arange(3)) % 3, axis=1)


def _steps(numbers, low, step):
    q = (numbers.astype(float) - low) / step if step > 0 else np.zeros(len(numbers))
    return np.floor(np.clip(q, 0, STEPS) + 0.5).astype(np.uint16)


def wrong_mesh(got, mesh):
    """How a decoded message differs from the mesh that the library made; None if it does not."""
    if (got["vertices"], got["triangles"]) != (len(mesh.vertices), len(mesh.faces)):
        return f"{got['vertices']} vertices and {got['triangles']} triangles, not {len(mesh.vertices)} and {len(mesh.faces)}"
    if not np.array_equal(_turned(got["indices"]), _turned(np.asarray(mesh.faces))):
        return "other triangles"
    points = np.asarray(mesh.vertices)
    for axis in range(3 if len(points) else 0):
        low, high = float(points[:, axis].min()), float(points[:, axis].max())
        if (got["origin"][axis], got["step"][axis]) != (low, (high - low) / STEPS):
            return f"along axis {axis} {got['origin'][axis]}, {got['step'][axis]} of {low} to {high}"
        if not np.array_equal(_steps(points[:, axis], low, got["step"][axis]), got["positions"][:, axis]):
            return f"other positions along axis {axis}"
    if "normals" in got and mesh.normals is not None:
        wanted = np.clip(np.asarray(mesh.normals), -1, 1).astype(float) * 127
        if np.abs(wanted - got["normals"][:, :3]).max(initial=0) > 0.5 + 1e-4:
            return "other normals"
    if "value_step" in got:
        values = np.asarray(mesh.values, float)
        finite = np.isfinite(values)
        shown = got["value_origin"] + got["value_step"] * got["positions"][:, 3].astype(float)
        if np.abs(shown - values)[finite].max(initial=0) > got["value_rounding"] * (1 + 1e-9) + 1e-300:
            return "other values"
    return None


class Volume:
    """The numbers of a store [z, y, x], their places, and the value between them."""

    def __init__(self, store):
        self.values = np.asarray(store.values(0))
        if self.values.ndim == 2:
            self.values = self.values[None]
        three = lambda numbers, fill: ([fill] * 3 + [float(x) for x in numbers])[-3:]  # noqa: E731
        self.spacing = np.array(three(store.spacing, 1.0))[::-1]
        self.origin = np.array(three(store.origin, 0.0))[::-1]
        self.axes = np.asarray(store.direction, float)

    def place(self, parts):
        """World coordinates of parts 0 to 1 of the way along x, y, z."""
        nodes = np.asarray(parts) * (np.array(self.values.shape[::-1]) - 1)
        return self.origin + (nodes * self.spacing) @ self.axes

    def node(self, world):
        return (self.axes @ (np.asarray(world, float) - self.origin)) / self.spacing

    def value(self, world):
        """In the finest tetrahedra: on from the cube's corner of even numbers, along the axis that it is furthest on."""
        node = self.node(world)
        last = np.array(self.values.shape[::-1]) - 1
        if (node < -1e-6).any() or (node > last + 1e-6).any():
            return None, None
        node = np.clip(node, 0, last)
        cell = np.clip(np.floor(node).astype(int), 0, np.maximum(last - 1, 0))
        odd = (cell % 2 == 1) & (last > 0)
        part = np.where(odd, 1 - (node - cell), node - cell)
        at, step = cell + odd, np.where(odd, -1, 1)
        of = lambda n: float(self.values[n[2], n[1], n[0]])  # noqa: E731
        value, before = of(at), of(at)
        for axis in sorted(range(3), key=lambda a: -part[a]):
            if part[axis] <= 0 or last[axis] == 0:
                continue
            at[axis] += step[axis]
            value += part[axis] * (of(at) - before)
            before = of(at)
        return value, node
