"""A small picture of a mesh, drawn with NumPy, for notebooks."""
from __future__ import annotations

import base64
import html
import struct
import zlib

import numpy as np

_SIZE = 320
"""Width and height in pixels."""
_MOST = 200_000
"""Elements that are drawn; of larger meshes every n-th, enlarged."""
_PIECE = 1 << 20
"""Points that are in memory at a time."""
_COLOR = np.array([110.0, 160.0, 220.0])


def html_of(text: str, vertices: np.ndarray, faces: np.ndarray) -> str:
    """The text, and below it a picture of the mesh, given in world coordinates."""
    caption = f"<p>{html.escape(text)}</p>"
    if len(faces) == 0:
        return caption
    data = base64.b64encode(_png(drawn(vertices, faces))).decode()
    return f'<img src="data:image/png;base64,{data}" width="{_SIZE}" height="{_SIZE}" alt="{html.escape(text)}"/>{caption}'


def drawn(vertices: np.ndarray, faces: np.ndarray, size: int = _SIZE) -> np.ndarray:
    """(size, size, 4), uint8: red, green, blue and opacity, seen obliquely from above, z up."""
    step = -(-len(faces) // _MOST)
    corners = _seen(np.asarray(vertices, float)[np.asarray(faces[::step], np.int64)], vertices, size)
    if step > 1:
        middle = corners.mean(axis=1, keepdims=True)
        corners = middle + (corners - middle) * step**0.5
    shades = _shades(corners)
    color = np.zeros((size * size, 4))
    depth = np.full(size * size, -np.inf)
    spread = np.abs(corners[:, :, :2] - corners[:, :1, :2]).max(axis=(1, 2))
    # The elements by the number of points that cover them: 1, 3, 6, 15, 45 ...
    parts = 2 ** np.ceil(np.log2(np.clip(1.5 * spread, 1, 2 * size))).astype(int)
    for n in np.unique(parts):
        weights = _weights(int(n), corners.shape[1])
        (chosen,) = np.nonzero(parts == n)
        for some in np.array_split(chosen, max(1, len(chosen) * len(weights) // _PIECE)):
            points = np.einsum("kc,mcd->mkd", weights, corners[some]).reshape(-1, 3)
            _put(points, np.repeat(shades[some], len(weights)), depth, color, size)
    return color.reshape(size, size, 4).astype(np.uint8)


def _seen(corners: np.ndarray, vertices: np.ndarray, size: int) -> np.ndarray:
    """Right, down and towards the viewer, in pixels."""
    low, high = vertices.min(axis=0).astype(float), vertices.max(axis=0).astype(float)
    turn, rise = np.radians(-35), np.radians(30)
    right = [np.cos(turn), -np.sin(turn), 0]
    near = [-np.sin(turn) * np.cos(rise), -np.cos(turn) * np.cos(rise), np.sin(rise)]
    axes = np.array([right, -np.cross(near, right), near])
    scale = 0.95 * size / max(float(np.linalg.norm(high - low)), 1e-300)
    return (corners - (low + high) / 2) @ axes.T * scale + [size / 2, size / 2, 0]


def _shades(corners: np.ndarray) -> np.ndarray:
    """Brightness, from 0 to 1: of triangles by their inclination to the light, of lines always 0.8."""
    if corners.shape[1] == 2:
        return np.full(len(corners), 0.8)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    light = np.array([-0.35, -0.5, 0.79])
    return 0.25 + 0.75 * np.abs(normal @ light) / np.maximum(np.linalg.norm(normal, axis=1), 1e-300)


def _weights(n: int, corners: int) -> np.ndarray:
    """Barycentric coordinates of evenly spaced points of an element whose edges have n + 1 points."""
    if corners == 2:
        t = np.linspace(0, 1, n + 1)
        return np.stack([t, 1 - t], axis=1)
    i, j = np.mgrid[:n + 1, :n + 1].reshape(2, -1)
    i, j = i[i + j <= n], j[i + j <= n]
    return np.stack([i, j, n - i - j], axis=1) / n


def _put(points: np.ndarray, shade: np.ndarray, depth: np.ndarray, color: np.ndarray, size: int) -> None:
    """Draws points where they are nearest."""
    column: np.ndarray = points[:, 0].astype(int)
    row: np.ndarray = points[:, 1].astype(int)
    inside = (column >= 0) & (column < size) & (row >= 0) & (row < size)
    at, near, shade = (row * size + column)[inside], points[inside, 2], shade[inside]
    # Of several points in a pixel the last one stays.
    order = np.argsort(near)
    at, near, shade = at[order], near[order], shade[order]
    nearest = np.full(size * size, -np.inf)
    brightness = np.zeros(size * size)
    nearest[at], brightness[at] = near, shade
    front = nearest > depth
    depth[front] = nearest[front]
    color[front] = np.append(_COLOR, 255.0)
    color[front, :3] *= brightness[front, None]


def _png(picture: np.ndarray) -> bytes:
    """Portable Network Graphics (W3C, second edition): eight bits, red, green, blue and opacity, no filter."""
    height, width = picture.shape[:2]
    rows = np.concatenate([np.zeros((height, 1), np.uint8), picture.reshape(height, -1)], axis=1)

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 6, 0, 0, 0)) \
        + chunk(b"IDAT", zlib.compress(rows.tobytes(), 6)) + chunk(b"IEND", b"")
