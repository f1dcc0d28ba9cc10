"""Meshes in binary PLY: reads those of isonest, and writes some for programs that read them."""
import numpy as np

_KINDS = {"float": "<f4", "double": "<f8"}


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
