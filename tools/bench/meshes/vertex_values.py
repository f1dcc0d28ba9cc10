#!/usr/bin/python3
"""Values of another store at the vertices of a surface: the reported bound on the error of linear interpolation between
vertices, next to the largest difference found, and the time that the values take.

usage: tools/bench/meshes/vertex_values.py BUILD FOLDER "ISOVALUE VOLUME [OPTION...]"...

The other store has every second node of VOLUME, and is trilinear between them. Differences are measured by NumPy at 28
points of each of at most 200,000 triangles, so they are lower bounds. Seconds are the medians of five pairs of runs.
BUILD is a build folder.
"""
import json
import os
import pathlib
import statistics
import subprocess
import sys
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import needs  # noqa: E402

build, folder, *volumes = needs.arguments(3, __doc__, 99)
build, folder = pathlib.Path(build).resolve(), pathlib.Path(folder)
isonest = build / "bin/isonest"
needs.require(needs.module("numpy"), needs.folder(folder), needs.built(build, "isonest"))
os.environ["HDF5_PLUGIN_PATH"] = str(build / "plugin")
sys.path.insert(0, str(needs.ROOT / "tests/support"))
import numpy as np  # noqa: E402
from mesh_data import read_ply  # noqa: E402

STEPS = 6
PLACES = np.array([(i, j, STEPS - i - j) for i in range(STEPS + 1) for j in range(STEPS + 1 - i)]) / STEPS


def run(*words):
    return json.loads(subprocess.run([isonest, *map(str, words), "--json"], check=True, capture_output=True, text=True).stdout)


def trilinear(values, at):
    last = np.array(values.shape[::-1]) - 1
    inside = ((at >= 0) & (at <= last)).all(1)
    at = np.where(inside[:, None], at, 0)
    low = np.minimum(at.astype(int), last - 1)
    part, total = at - low, np.zeros(len(at))
    for corner in range(8):
        bits = np.array([corner >> axis & 1 for axis in range(3)])
        node = low + bits
        total += np.where(bits, part, 1 - part).prod(1) * values[node[:, 2], node[:, 1], node[:, 0]]
    return np.where(inside, total, np.nan)


print("| volume, isovalue | surface | triangles | bound, % of the range | largest difference found, % | bound / found | seconds, without and with |")
print("|---|---|---|---|---|---|---|")
store, other, mesh = folder / "values_a.isonest", folder / "values_b.isonest", folder / "values.ply"
for given in volumes:
    isovalue, volume, *reading = given.split()
    run("preprocess", volume, *reading, "-o", store, "--force")
    run("preprocess", volume, *reading, "--every", "2", "-o", other, "--force")
    run("export", other, "-o", folder / "values.npy", "--force")
    values = np.load(folder / "values.npy").astype(float)
    info = run("info", other)
    steps = np.array(info["direction"]) * np.array(info["spacing"])[:, None]
    for what, options in (("full resolution", ()), ("within 0.5 voxels", ("--distance", "0.5voxel"))):
        command = ("extract", store, "--iso", isovalue, *options, "--space", "as-stored", "-o", mesh)
        times = []
        for _ in range(5):
            pair = []
            for more in ((), ("--vertex-values", f"other={other}")):
                start = time.time()
                report = run(*command, *more)
                pair.append(time.time() - start)
            times.append(pair)
        rows, faces = read_ply(mesh)
        points = np.stack([rows[axis] for axis in "xyz"], 1).astype(float)
        at = np.linalg.solve(steps.T, (points - info["origin"]).T).T
        chosen = faces[np.random.default_rng(58).permutation(len(faces))[:200_000]]
        found = 0
        for place in PLACES:
            linear = np.einsum("k,fk->f", place, rows["other"].astype(float)[chosen])
            found = max(found, np.nanmax(np.abs(trilinear(values, np.einsum("k,fkd->fd", place, at[chosen])) - linear)))
        field, = report["vertex_fields"]
        width = info["max_value"] - info["min_value"]
        assert found <= field["linear_bound"], given
        seconds = [statistics.median(column) for column in zip(*times)]
        print(f"| {pathlib.Path(volume).name}, {isovalue} | {what} | {report['triangles']:,} | {100 * field['linear_bound'] / width:.2f} | "
              f"{100 * found / width:.2f} | {field['linear_bound'] / found:.2f} | {seconds[0]:.2f}, {seconds[1]:.2f} |", flush=True)
