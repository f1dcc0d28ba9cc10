#!/usr/bin/python3
"""Both efforts of simplification within a distance, and Flying Edges with meshoptimizer at the same 99 % quantile.

usage: efforts.py ISONEST PLUGIN_FOLDER --data FOLDER [--volumes A,B] [--distances D,D] [--min-component N]
                  [--folder FOLDER] [--rounds N]

A markdown table, one row for each volume, distance and effort. FOLDER (--data) has the files of distance.py's VOLUMES;
"bucky257" and "bucky513" are made by `isonest make-volume bucky`. Distances are in voxels: smallest spacings.
Components of fewer than N (100) triangles are removed on both sides.

isonest    triangles; the larger 99 % quantile of the distances between its mesh and its own full surface; edges folded
           by more than 150 degrees, those of the full surface in brackets; seconds and processor seconds of the whole
           program, and microseconds of the processor per triangle of the full surface.
peer       a single process that reads the store's values, runs Flying Edges, removes components, calls
           meshopt_simplify once and writes a PLY file. Its target error is found by bisection, so that the larger 99 %
           quantile to its own full mesh is at most isonest's, and close to it: its triangles, seconds, processor seconds.
ratios     isonest over peer: triangles, seconds, processor seconds.

Both are timed in turn, after the target error is known: medians of N rounds (3).
"""
import argparse
import json
import math
import os
import pathlib
import resource
import statistics
import sys
import time

import distance
import needs

EFFORTS = ("fast", "best")
BUCKY = {"bucky257": 257, "bucky513": 513}


def of_children():
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def medians(seconds):
    """Medians of pairs."""
    return [statistics.median(column) for column in zip(*seconds)]


def quantile(found):
    return max(found[side]["p99"] for side in ("a_to_b", "b_to_a"))


class Ours:
    """isonest's mesh of one surface within a distance."""

    def __init__(self, bench, store, iso, limit, effort, least, out):
        self.command = [bench.args.isonest, "extract", store, "--iso", repr(float(iso)), "--distance", repr(limit),
                        "--effort", effort, *(["--min-component", str(least)] if least else []), "-o", out, "--json"]
        self.bench, self.report = bench, None

    def timed(self):
        start, before = time.perf_counter(), of_children()
        self.report = json.loads(self.bench.run(*self.command))
        return time.perf_counter() - start, of_children() - before


class Theirs(distance.Peer):
    """The same for the peer, with target errors for a quantile."""

    def __init__(self, bench, store, iso, voxel, least):
        super().__init__(bench, store, iso, voxel, least)
        self.store, self.iso, self.least = store, iso, least
        self.known = {}

    def look(self, error):
        """The 99 % quantile and the triangles at a target error."""
        if error not in self.known:
            triangles, _ = self.simplified(error, lock_border=False)
            if triangles == 0:
                self.known[error] = (math.inf, 0)
            else:
                found = self.bench.run(self.bench.args.isonest.with_name("isonest_mesh_distance"), self.full,
                                       self.mesh, "--epsilon", "1e30")
                self.known[error] = (quantile(json.loads(found)), triangles)
        return self.known[error]

    def largest_error(self, limit):
        """The largest target error whose quantile is at most the limit; None if there is none."""
        low, high = None, None
        error = limit
        while low is None or high is None:
            if self.look(error)[0] <= limit:
                low, error = error, error * 2
            elif error < limit * 1e-3:
                return None
            else:
                high, error = error, error / 2
        while high > 1.03 * low:
            middle = math.sqrt(low * high)
            low, high = (middle, high) if self.look(middle)[0] <= limit else (low, middle)
        return low

    def timed(self, error):
        start, before = time.perf_counter(), time.process_time()
        v, t, _ = self.peers.store_edges(self.store, self.iso)
        t = self.peers.drop_small_components(v, t, self.least)
        self.peers.write_ply(self.mesh, v, self.peers.simplify(v, t, error))
        return time.perf_counter() - start, time.process_time() - before


def compare(bench, name, store, voxel, iso):
    args = bench.args
    full, mesh = bench.folder / "full.ply", bench.folder / "mesh.ply"
    report = bench.full(store, iso, full)
    folds = bench.quality(full)["folds_150"]
    theirs = Theirs(bench, store, iso, voxel, args.min_component)
    for d in map(float, args.distances.split(",")):
        for effort in EFFORTS:
            ours = Ours(bench, store, iso, d * voxel, effort, args.min_component, mesh)
            ours.timed()
            limit = quantile(json.loads(bench.run(
                args.isonest.with_name("isonest_mesh_distance"), full, mesh, "--min-component",
                str(args.min_component), "--epsilon", "1e30")))
            folded = bench.quality(mesh)["folds_150"]
            error = theirs.largest_error(limit)
            own, other = [], []
            for _ in range(args.rounds):
                own.append(ours.timed())
                other.append(theirs.timed(error) if error else (math.nan, math.nan))
            (wall, cpu), (wall_peer, cpu_peer) = medians(own), medians(other)
            triangles, left = ours.report["triangles"], theirs.look(error)[1] if error else math.nan
            print(f"| {name} {iso:g}, {d:g}, {effort} | {triangles:,}, {limit / voxel:.3f}, {folded} ({folds}), "
                  f"{wall:.2f}, {cpu:.2f}, {1e6 * cpu / report['triangles']:.2f} | "
                  f"{left:,}, {wall_peer:.2f}, {cpu_peer:.2f} | "
                  f"{triangles / left:.2f}, {wall / wall_peer:.2f}, {cpu / cpu_peer:.2f} |", flush=True)


def main():
    given = needs.arguments(3, __doc__)
    parser = argparse.ArgumentParser(usage=__doc__.replace("%", "%%"))
    parser.add_argument("isonest", type=pathlib.Path)
    parser.add_argument("plugin")
    parser.add_argument("--data", type=pathlib.Path, required=True)
    parser.add_argument("--volumes")
    parser.add_argument("--distances", default="0.25,0.5,1")
    parser.add_argument("--min-component", type=int, default=100)
    parser.add_argument("--folder", type=pathlib.Path)
    parser.add_argument("--rounds", type=int, default=3)
    args = parser.parse_args(given)
    os.environ["HDF5_PLUGIN_PATH"] = args.plugin
    needs.require(needs.program(args.isonest),
                  *(needs.program(args.isonest.with_name(f"isonest_mesh_{name}"), f"isonest_mesh_{name}")
                    for name in ("distance", "quality")),
                  needs.module("numpy"), needs.module("h5py"), needs.module("vtk"))
    needs.require(needs.zstd_filter())
    args.extract, args.isos = None, 1
    names = args.volumes.split(",") if args.volumes else [*distance.VOLUMES, *BUCKY]
    args.volumes = ",".join(name for name in names if name not in BUCKY)
    bench = distance.Bench(args)
    print("| volume, isovalue, D, effort | isonest: triangles, q99, folds (full), seconds, processor, us per triangle | "
          "peer: triangles, seconds, processor | ratios: triangles, seconds, processor |\n|---|---|---|---|")
    if args.volumes:
        for name, store, voxel, _, isos in bench.seven():
            compare(bench, name, store, voxel, isos[0])
    for name in (name for name in names if name in BUCKY):
        volume = bench.folder / f"{name}.h5"
        if not volume.exists():
            bench.run(args.isonest, "make-volume", "bucky", "--size", BUCKY[name], "-o", volume)
        store, voxel, _ = bench.store(name, volume, ())
        compare(bench, name, store, voxel, 0.5)


if __name__ == "__main__":
    sys.exit(main())
