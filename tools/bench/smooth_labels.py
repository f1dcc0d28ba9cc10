#!/usr/bin/python3
"""Smooth surfaces of all labels of Voronoi cells, compared with VTK's, and the heap with little memory.

usage: smooth_labels.py BUILD FOLDER [SIZE:CELLS:MEMORY...] [--peer SIZE...] [--threads N] [--rounds N]
                        [--peer-rounds N] [--keep]

A markdown table, one row per volume (513:5000:1G 1025:5000:256M): SIZE^3 nodes of uint16, each with the number, from 1
on, of the nearest of CELLS random points. FOLDER is for the volume, the store and the meshes of one volume at a time,
which are removed (the volume stays with --keep). BUILD is as for large.py.

isonest    `extract --labels all --smooth`, with the mesh files (.ply): triangles; wall-clock and processor seconds; peak
           heap; peak temporary space. A heap larger than MEMORY is an error.
VTK        for the volumes that --peer names (257 513): vtkDiscreteFlyingEdges3D of all labels and
           vtkWindowedSincPolyDataFilter, 15 iterations, pass band 0.1, of the array in memory, without reading or
           writing: triangles; wall-clock and processor seconds; peak resident memory, including the volume and Python.
ratio      isonest's processor seconds over VTK's.

Both run in turn; the figures are those of the round with the fewest processor seconds, of N (3 for isonest, 1 for VTK,
which traverses the volume for each label).
"""
import argparse
import json
import os
import pathlib
import re
import resource
import shutil
import subprocess
import sys
import time

import needs

UNITS = {"K": 1 << 10, "M": 1 << 20, "G": 1 << 30}
BLOCK = 16  # nodes along each axis that are processed together
SEED = 20251


def make_volume(path, size, cells):
    """Brute force among the points that can be nearest to a node of a block: those no farther from its centre than the
    nearest one plus the block's diameter."""
    import numpy as np
    from scipy.spatial import cKDTree
    points = np.random.default_rng(SEED).random((cells, 3)) * size
    tree = cKDTree(points)
    volume = np.lib.format.open_memmap(path, mode="w+", dtype="<u2", shape=(size, size, size))
    half = (BLOCK - 1) / 2
    starts = np.arange(0, size, BLOCK)
    offsets = np.stack(np.meshgrid(*[np.arange(BLOCK)] * 3, indexing="ij"), -1).reshape(-1, 3)
    for z in starts:
        slab = np.empty((BLOCK, size, size), "<u2")
        for y in starts:
            middles = np.stack([np.full(len(starts), z), np.full(len(starts), y), starts], 1) + half
            nearest, _ = tree.query(middles)
            for x, middle, least in zip(starts, middles, nearest):
                near = np.sort(tree.query_ball_point(middle, least + 2 * np.sqrt(3) * half + 1e-9))
                nodes = (z, y, x) + offsets
                # |n - p|^2 minus |n|^2, which is the same for all points.
                distance = (points[near] ** 2).sum(1) - 2 * nodes @ points[near].T
                found = (1 + near)[distance.argmin(1)].reshape((BLOCK,) * 3)
                slab[:, y:y + BLOCK, x:x + BLOCK] = found[:, :min(BLOCK, size - y), :min(BLOCK, size - x)]
        volume[z:z + BLOCK] = slab[:min(BLOCK, size - z)]
    volume.flush()


def vtk_smoothed(path):
    """Run in a separate process; prints triangles, seconds, processor seconds, bytes."""
    import numpy as np
    import vtk
    from vtk.util.numpy_support import numpy_to_vtk
    data = np.load(path)
    labels = np.unique(data)
    start, before = time.perf_counter(), time.process_time()
    image = vtk.vtkImageData()
    image.SetDimensions(*data.shape[::-1])
    image.GetPointData().SetScalars(numpy_to_vtk(data.ravel()))
    edges = vtk.vtkDiscreteFlyingEdges3D()
    edges.SetInputData(image)
    edges.SetNumberOfContours(len(labels))
    for i, label in enumerate(labels):
        edges.SetValue(i, float(label))
    sinc = vtk.vtkWindowedSincPolyDataFilter()
    sinc.SetInputConnection(edges.GetOutputPort())
    sinc.SetNumberOfIterations(15)
    sinc.SetPassBand(0.1)
    sinc.BoundarySmoothingOff()
    sinc.FeatureEdgeSmoothingOff()
    sinc.NonManifoldSmoothingOn()
    sinc.NormalizeCoordinatesOn()
    sinc.Update()
    print(json.dumps({"triangles": sinc.GetOutput().GetNumberOfPolys(), "seconds": time.perf_counter() - start,
                      "processor": time.process_time() - before,
                      "bytes": 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss}))


def of_children():
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


class Smoothing:
    """isonest's meshes of one volume."""

    def __init__(self, isonest, helper, store, meshes, memory, threads):
        self.meshes = meshes
        self.command = [isonest, "extract", store, "--labels", "all", "--smooth", "--memory", memory, "-o", meshes, "--json",
                        *(["--threads", str(threads)] if threads else [])]
        self.counted = dict(os.environ, LD_PRELOAD=str(helper))

    def timed(self):
        """A run whose heap is counted."""
        before, start = of_children(), time.perf_counter()
        done = subprocess.run(self.command, env=self.counted, capture_output=True, text=True)
        seconds, processor = time.perf_counter() - start, of_children() - before
        if done.returncode != 0:
            sys.exit(done.stderr)
        report = json.loads(done.stdout)
        return {"triangles": sum(entry["triangles"] for entry in report["labels"]), "seconds": seconds, "processor": processor,
                "heap": int(re.search(r"peak heap (\d+) bytes", done.stderr)[1]), "scratch": report["scratch_bytes"]}


def measure(args, size, cells, memory):
    isonest, helper = args.build / "bin/isonest", args.build / "tools/bench/libisonest_peak_heap.so"
    volume, store, meshes = args.folder / f"cells-{size}-{cells}.npy", args.folder / "cells.isonest", args.folder / "meshes"
    if not volume.exists():
        make_volume(volume, size, cells)
    subprocess.run([isonest, "preprocess", volume, "--labels", "-o", store, "--force", "-q"], check=True)
    ours = Smoothing(isonest, helper, store, meshes, memory, args.threads)
    own, other = [], []
    for _ in range(args.rounds):
        own.append(ours.timed())
        if size in args.peer and len(other) < args.peer_rounds:
            done = subprocess.run([sys.executable, __file__, "--vtk", volume], capture_output=True, text=True)
            other.append(json.loads(done.stdout) if done.returncode == 0 else sys.exit(done.stderr))
    best = min(own, key=lambda one: one["processor"])
    heap = max(one["heap"] for one in own)
    peer = min(other, key=lambda one: one["processor"]) if other else None
    print(f"| {size}^3, {cells:,} | {best['triangles']:,}, {best['seconds']:.1f}, {best['processor']:.1f}, "
          f"{heap / (1 << 20):.0f} MiB of {memory}, {best['scratch'] / 1e9:.2f} GB | " +
          (f"{peer['triangles']:,}, {peer['seconds']:.1f}, {peer['processor']:.1f}, {peer['bytes'] / (1 << 20):.0f} MiB | "
           f"{best['processor'] / peer['processor']:.2f} |" if peer else "| |"), flush=True)
    shutil.rmtree(meshes)
    store.unlink()
    if not args.keep:
        volume.unlink()
    if heap > int(memory[:-1]) * UNITS[memory[-1]]:
        sys.exit(f"it held {heap:,} bytes of heap, which is more than --memory")


def main():
    given = needs.arguments(2, __doc__)
    if given[0] == "--vtk":
        return vtk_smoothed(given[1])
    parser = argparse.ArgumentParser(usage=__doc__)
    parser.add_argument("build", type=pathlib.Path)
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("volumes", nargs="*", default=["513:5000:1G", "1025:5000:256M"])
    parser.add_argument("--peer", type=int, nargs="*", default=[257, 513])
    parser.add_argument("--threads", type=int)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--peer-rounds", type=int, default=1)
    parser.add_argument("--keep", action="store_true")
    args = parser.parse_args(given)
    args.build = args.build.resolve()
    needs.require(*(f"{volume}: give SIZE:CELLS:MEMORY as in 513:5000:1G" for volume in args.volumes
                    if not re.fullmatch(r"\d+:\d+:\d+[KMG]", volume)), needs.folder(args.folder))
    volumes = [volume.split(":") for volume in args.volumes]
    # The volume, its store, and some 60 bytes in meshes and temporary files for each cell of a surface net.
    needs.require(needs.space(args.folder, max(5 * int(size) ** 3 + 60 * int(size) ** 3 for size, _, _ in volumes)),
                  needs.module("numpy"), needs.module("scipy"), needs.module("vtk"))
    needs.require(needs.built(args.build, "isonest_program", "isonest_peak_heap"))
    print("| volume, cells | isonest: triangles, seconds, processor, heap, temporary space | VTK: triangles, seconds, processor, memory | ratio |\n"
          "|---|---|---|---|", flush=True)
    for size, cells, memory in volumes:
        measure(args, int(size), int(cells), memory)


if __name__ == "__main__":
    sys.exit(main())
