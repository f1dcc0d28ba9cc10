#!/usr/bin/python3
"""Small volumes that are hard for a surface within a distance.

usage: odd_volumes.py FOLDER

Writes them as NRRD (the first as HDF5, the second as raw numbers) and prints for each the file, the isovalue and the
options that `isonest preprocess` needs. The smallest spacing is 1 in all except one.
"""
import pathlib
import sys

import needs

needs.require(needs.module("numpy"), needs.module("h5py"))
import h5py
import numpy as np


def axes(*nodes):
    """Coordinates x, y, z of the nodes; arrays are indexed z, y, x."""
    z, y, x = np.meshgrid(*(np.arange(n, dtype=float) for n in nodes[::-1]), indexing="ij")
    return x, y, z


def gyroid(x, y, z, period):
    x, y, z = (2 * np.pi * c / period for c in (x, y, z))
    return np.sin(x) * np.cos(y) + np.sin(y) * np.cos(z) + np.sin(z) * np.cos(x)


def tori(n, step, large, small):
    """1 inside tori with the two radii, one in each cube of `step` nodes, with axes in turn along x, y and z."""
    cell = [np.mod(c, step) - step / 2 + 0.137 for c in axes(n, n, n)]
    which = sum(np.floor(c / step) for c in axes(n, n, n)) % 3
    u = np.empty((n, n, n))
    for axis in range(3):
        a, b, c = cell[axis], cell[(axis + 1) % 3], cell[(axis + 2) % 3]
        distance = np.hypot(np.hypot(b, c) - large, a)
        u[which == axis] = (small - distance)[which == axis]
    return u


def volumes():
    """Yields name, array, isovalue, spacing (x, y, z), origin."""
    rng = np.random.default_rng(20240229)
    x, y, z = axes(41, 37, 29)
    yield "noise", rng.random((33, 33, 33)).astype("f4"), 0.5, (1, 1, 1), (0, 0, 0)
    yield "noise-at-nodes", rng.integers(0, 5, (25, 29, 31)).astype("u1"), 2, (1, 1, 1), (0, 0, 0)
    yield "checkerboard", ((x + y + z) % 2).astype("u1"), 0.5, (1, 1, 1), (0, 0, 0)
    yield "checkerboard-of-blocks", (np.floor(x / 3) + np.floor(y / 3) + np.floor(z / 3)) % 2, 0.5, (1, 1, 1), (0, 0, 0)
    r = np.sqrt((x - 20) ** 2 + (y - 18) ** 2 + (z - 14) ** 2)
    yield "plateau", (1 + (r > 11) - (r < 7).astype(int)).astype("i2"), 1, (1, 1, 1), (0, 0, 0)
    yield "all-at-the-isovalue", np.full((17, 17, 17), 3, "u1"), 3, (1, 1, 1), (0, 0, 0)
    yield "plane-through-nodes", (x + y + z).astype("i2"), 40, (1, 1, 1), (0, 0, 0)
    yield "surface-on-the-border", x.astype("i2"), 0, (1, 1, 1), (0, 0, 0)
    yield "sheet", (z == 15).astype("u1"), 0.5, (1, 1, 1), (0, 0, 0)
    yield "two-sheets", ((z == 15) | (z == 17)).astype("u1"), 0.5, (1, 1, 1), (0, 0, 0)
    tilted = np.floor(0.31 * x + 0.17 * y + z)
    yield "tilted-sheets", ((tilted == 15) | (tilted == 17)).astype("u1"), 0.5, (1, 1, 1), (0, 0, 0)
    shell = np.rint(np.sqrt((x - 20) ** 2 + (y - 18) ** 2 + (z - 14) ** 2))
    yield "shell", (shell == 12).astype("u1"), 0.5, (1, 1, 1), (0, 0, 0)
    yield "shells-near", 1 - np.abs(np.abs(r - 11) - 1), 0.9, (1, 1, 1), (0, 0, 0)
    yield "tori", tori(49, 8, 2.3, 0.8).astype("f4"), 0, (1, 1, 1), (0, 0, 0)
    yield "linked-tori", tori(65, 11, 4.6, 1.1).astype("f4"), 0, (1, 1, 1), (0, 0, 0)
    for n in (2, 3, 77):
        yield f"2x2x{n}", rng.random((n, 2, 2)), 0.5, (1, 1, 1), (0, 0, 0)
    yield "97x2x3", rng.random((3, 2, 97)).astype("f4"), 0.4, (1, 1, 1), (0, 0, 0)
    yield "odd", gyroid(*axes(53, 18, 37), 13.7), 0.1, (1, 1, 1), (0, 0, 0)
    yield "flat-voxels", gyroid(*axes(33, 47, 35), 9.3), 0.2, (1, 1, 10), (0, 0, 0)
    yield "long-voxels", gyroid(*axes(19, 33, 35), 11.1), 0, (10, 1, 1.7), (0, 0, 0)
    yield "far-away", gyroid(*axes(33, 34, 35), 12.2), 0.1, (0.5, 0.5, 0.5), (1e4, -3e4, 7e3)
    bumps = np.zeros((49, 49, 49), "u1")
    bumps[rng.integers(0, 49, 40), rng.integers(0, 49, 40), rng.integers(0, 49, 40)] = 255
    yield "bumps", bumps, 3, (1, 1, 1), (0, 0, 0)
    yield "bumps-nearly-full", bumps, 254, (1, 1, 1), (0, 0, 0)
    box = np.maximum(np.maximum(np.abs(x - 20.3), np.abs(y - 18.2)), np.abs(z - 14.4))
    yield "box", box, 9.35, (1, 1, 1), (0, 0, 0)
    yield "needle", np.hypot(y - 18.2, z - 14.4) - x / 25, 0, (1, 1, 1), (0, 0, 0)
    holes = gyroid(*axes(41, 37, 29), 10).astype("f4")
    holes[r < 9] = np.nan
    yield "missing", holes, 0.1, (1, 1, 1), (0, 0, 0)


def write_nrrd(path, u, spacing, origin):
    kind = {"u1": "uint8", "i2": "int16", "f4": "float", "f8": "double"}[u.dtype.str[1:]]
    sizes = " ".join(str(n) for n in u.shape[::-1])
    directions = " ".join(f"({','.join(str(s if a == b else 0) for b in range(3))})" for a, s in enumerate(spacing))
    path.write_bytes(f"NRRD0004\ntype: {kind}\ndimension: 3\nspace dimension: 3\nsizes: {sizes}\nendian: little\n"
                     f"encoding: raw\nspace directions: {directions}\nspace origin: "
                     f"({','.join(str(o) for o in origin)})\n\n".encode() + u.tobytes())


def write_all(folder):
    """Yields name, file, isovalue and options of preprocess."""
    for number, (name, u, iso, spacing, origin) in enumerate(volumes()):
        options = []
        if number == 0:
            path = folder / f"{name}.h5"
            with h5py.File(path, "w") as file:
                file["data"] = u
        elif number == 1:
            path = folder / f"{name}.raw"
            path.write_bytes(u.tobytes())
            options = ["--dims", ",".join(str(n) for n in u.shape[::-1]), "--type", "uint8"]
        else:
            path = folder / f"{name}.nrrd"
            write_nrrd(path, np.ascontiguousarray(u), spacing, origin)
        yield name, path, iso, options


def main():
    folder = pathlib.Path(needs.arguments(1, __doc__, 1)[0])
    needs.require(needs.folder(folder))
    for _name, path, iso, options in write_all(folder):
        print(path, iso, *options)


if __name__ == "__main__":
    sys.exit(main())
