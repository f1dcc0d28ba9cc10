#!/usr/bin/python3
"""Surfaces as 3D Tiles: tiles, triangles, bytes and error of each level; seconds and peak heap; and the largest distance
of random tiles from the full surface, as a part of their geometricError.

usage: tools/bench/meshes/tiles.py BUILD FOLDER VOLUME:ISOVALUE...

VOLUME is a file that isonest reads, or "bucky N", which is made. Distances are measured by VTK at the vertices of 200 random
tiles above the finest level, and at 400 points on their triangles: they are lower bounds. BUILD is a build folder.
"""
import json
import os
import pathlib
import re
import shutil
import statistics
import subprocess
import sys
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import needs  # noqa: E402

build, folder, *volumes = needs.arguments(3, __doc__, 99)
build, folder = pathlib.Path(build).resolve(), pathlib.Path(folder)
isonest, helper = build / "bin/isonest", build / "tools/bench/libisonest_peak_heap.so"
needs.require(needs.module("vtk"), needs.module("numpy"), needs.tool("node"), needs.folder(folder),
              needs.built(build, "isonest", "isonest_peak_heap"))
os.environ["HDF5_PLUGIN_PATH"] = str(build / "plugin")
sys.path.insert(0, str(needs.ROOT / "tests/tiles"))
sys.path.insert(0, str(needs.ROOT / "tests/support"))
import numpy as np  # noqa: E402
from mesh_data import read_points  # noqa: E402
from tile_reader import Distance, Tileset, samples  # noqa: E402

RANDOM = np.random.default_rng(57)


def run(*words, environment=None):
    return subprocess.run([isonest, *map(str, words)], check=True, capture_output=True, text=True,
                          env={**os.environ, **(environment or {})})


print("| volume, isovalue | level | tiles | triangles | bytes | within, voxels | largest distance / error: median, most |")
print("|---|---|---|---|---|---|---|")
times = []
for given in volumes:
    volume, isovalue = given.rsplit(":", 1)
    name = pathlib.Path(volume).name
    if volume.startswith("bucky "):
        made = folder / f"bucky{volume.split()[1]}.h5"
        if not made.exists():
            run("make-volume", "bucky", "--size", volume.split()[1], "-o", made)
        volume = made
    site, full = folder / "tiles", folder / "full.ply"
    shutil.rmtree(site, ignore_errors=True)
    start = time.time()
    report = json.loads(run("extract", volume, "--iso", isovalue, "--format", "3dtiles", "-o", site, "--json", "--memory",
                            "512M").stdout)
    seconds = time.time() - start
    shutil.rmtree(site)
    done = run("extract", volume, "--iso", isovalue, "--format", "3dtiles", "-o", site, "--memory", "512M",
               environment={"LD_PRELOAD": str(helper)})
    heap = int(re.search(r"peak heap (\d+) bytes", done.stderr)[1])
    run("extract", volume, "--iso", isovalue, "-o", full)
    points, faces = read_points(full)
    tiles = Tileset(site)
    metres = tiles.tiles[0].head["nodes"][0]["scale"][0] / 2.0**tiles.tiles[0].level
    description = json.loads(run("info", volume, "--json").stdout)
    voxel = min(description["spacing"])
    unit = {"mm": 1e-3, "um": 1e-6, "nm": 1e-9, "cm": 1e-2}.get(description.get("unit"), 1)
    near = Distance(points.astype(float) * unit, faces)
    coarse = [tile for tile in tiles.tiles if tile.level > 0]
    chosen = [coarse[i] for i in RANDOM.permutation(len(coarse))[:200]]
    shares = {}
    for tile in chosen:
        there = near.largest(samples(tiles.world(tile), tile.arrays["indices"], RANDOM))
        shares.setdefault(tile.level, []).append(there / tile.error)
    for level, one in enumerate(report["tileset"]["levels"]):
        there = shares.get(level)
        print(f"| {f'{name}, {isovalue}' if level == 0 else ''} | {level} | {one['tiles']:,} | {one['triangles']:,} | "
              f"{one['bytes'] / 1e6:.2f} MB | {one['distance_bound'] / voxel:.4g} | "
              f"{f'{statistics.median(there):.2f}, {max(there):.3f}' if there else ''} |", flush=True)
    every = [share for some in shares.values() for share in some]
    times.append(f"{name}: {report['triangles']:,} triangles extracted in {report['seconds']:.1f} s, "
                 f"{seconds:.1f} s with the tiles, peak heap {heap / 2**20:.0f} MiB, {report['tileset']['files']:,} files, "
                 f"{report['tileset']['bytes'] / 1e6:.1f} MB; {len(every)} tiles: median {statistics.median(every):.2f}, "
                 f"largest {max(every):.3f}")
print("\n" + ".\n".join(times) + ".")
