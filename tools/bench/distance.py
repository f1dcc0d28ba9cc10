#!/usr/bin/python3
"""Surfaces within a distance: how small they are compared with peers, and whether they keep the requested distance.

usage: distance.py ISONEST PLUGIN_FOLDER compare|targets|verify [--data FOLDER] [--volumes A,B] [--isos N]
                   [--distances D,D] [--min-component N] [--quadrics] [--extract OPTIONS] [--folder FOLDER]
                   [--rounds N]

compare   a markdown table. isonest extracts within each distance; its two-sided maximum (max) and the larger 99.9 %
          quantile (q) are measured against its own full surface. The peer is VTK's Flying Edges and meshoptimizer's
          simplification, measured against Flying Edges' full mesh; its target error is found by bisection, twice:
          the fewest triangles with a maximum that is not larger, and with a quantile that is not larger (and as
          close as possible). --quadrics adds vtkQuadricDecimation to as many triangles as isonest's, and its distance.
targets   only the peer, at a maximum that is not larger than each distance, and isonest's full surface.
verify    every volume, the first N of its isovalues (3), every distance, and the volumes of odd_volumes.py: exit code 1
          if a maximum exceeds the distance, or a mesh has an edge of more than two triangles, two that disagree
          about the outside, a border inside the volume or an unused vertex, where the full one has none.

Distances are in voxels: smallest spacings. FOLDER (--data) has the files of VOLUMES; without it, verify only uses the
odd volumes. Components of fewer than --min-component triangles are first removed from both full meshes (100 in compare
and targets). --extract replaces `--distance D`, for instance by "--error-relative 0.05", to measure other meshes.
Seconds are those of one run (isonest's: the median of --rounds), without the start of a program; isonest's include
reading the store; the peer's include extraction, removal of components, simplification and writing. "-": no target
error down to 1/4000 of the limit keeps it. The measuring programs are in the same folder as ISONEST.
"""
import argparse
import json
import math
import os
import pathlib
import statistics
import subprocess
import sys
import tempfile
import time

import needs

# Name: file, options of preprocess, isovalues: one that shows a real surface, then two others.
VOLUMES = {
    "heptane": ("heptane_302_u8.nii.gz", "", (80.5, 20, 180)),
    "stent": ("stent_128x128x256_f32_gzip.nrrd", "", (0.15, 0.1, 0.4)),
    "tooth": ("tooth.nhdr", "", (600.5, 780, 1000)),
    "aneurism": ("aneurism_256_u8.raw.gz", "--dims 256,256,256 --type uint8", (60.5, 30, 120)),
    "cthead": ("cthead_256x256x113_u16be.raw.gz",
               "--dims 256,256,113 --type uint16 --endian big --spacing 1,1,2", (1150.5, 500, 1600)),
    "mri": ("mri_t1.nhdr", "", (60.5, 120, 300)),
    "cranium": ("cranium.nhdr", "", (-300.5, 300, 700)),
}
LOCKS = (False, True)  # meshopt_SimplifyLockBorder
VERIFY = (0.1, 0.25, 0.5, 1, 2)
COMPARE = (0.25, 0.5, 1)


class Bench:
    def __init__(self, args):
        self.args = args
        self.folder = args.folder or pathlib.Path(tempfile.mkdtemp(prefix="isonest-distance-"))
        self.folder.mkdir(parents=True, exist_ok=True)

    def run(self, *command):
        done = subprocess.run([str(c) for c in command], capture_output=True, text=True)
        if done.returncode:
            raise RuntimeError(f"{' '.join(map(str, command))}: exit code {done.returncode}: {done.stderr.strip()}")
        return done.stdout

    def store(self, name, path, options):
        """The store of a volume, made if it does not exist yet, and its smallest spacing."""
        store = self.folder / f"{name}.isonest"
        if not store.exists():
            self.run(self.args.isonest, "preprocess", path, "-o", store, "-q", *options)
        import h5py
        with h5py.File(store) as file:
            nodes = file["levels/0/values"].shape[::-1]
            spacing, origin = file.attrs["spacing"], file.attrs["origin"]
            box = [*origin, *(o + (n - 1) * s for o, n, s in zip(origin, nodes, spacing))]
        return store, float(min(spacing)), box

    def extract(self, store, iso, options, out):
        """The report of isonest, with the median of the rounds' seconds."""
        seconds = []
        for _ in range(self.args.rounds):
            report = json.loads(self.run(self.args.isonest, "extract", store, "--iso", repr(float(iso)), *options,
                                         "-o", out, "--json"))
            seconds.append(report["seconds"])
        return {**report, "seconds": statistics.median(seconds)}

    def full(self, store, iso, out, options=()):
        """The mesh from which the distance is measured: hexahedra, unless --extract says otherwise."""
        cells = () if self.args.extract else ("--cells", "hex")
        return self.extract(store, iso, [*options, "--error", "0", *cells], out)

    def within(self, store, iso, distance, least, out):
        options = self.args.extract.split() if self.args.extract else ["--distance", repr(distance)]
        return self.extract(store, iso, [*options, *(["--min-component", str(least)] if least else [])], out)

    def distance(self, full, mesh, voxel, *options):
        """The maxima are found to within a hundredth of a voxel, unless the options say otherwise."""
        options = ("--epsilon", repr(voxel / 100), *options)
        return json.loads(self.run(self.args.isonest.with_name("isonest_mesh_distance"), full, mesh, *options))

    def quality(self, mesh, box=(), *options):
        return json.loads(self.run(self.args.isonest.with_name("isonest_mesh_quality"), mesh, *options,
                                   *(["--box", *map(repr, map(float, box))] if len(box) else [])))

    def seven(self):
        """Name, store, smallest spacing, box, isovalues."""
        for name in self.args.volumes.split(",") if self.args.volumes else VOLUMES:
            file, options, isos = VOLUMES[name]
            yield (name, *self.store(name, self.args.data / file, options.split()), isos[:self.args.isos])


class Peer:
    """Flying Edges' mesh of one surface, and what simplification leaves of it."""

    def __init__(self, bench, store, iso, voxel, least):
        import peers
        self.peers, self.bench, self.voxel = peers, bench, voxel
        self.v, t, self.seconds = peers.store_edges(store, iso)
        self.full_triangles = len(t)
        start = time.perf_counter()
        self.t = peers.drop_small_components(self.v, t, least)
        self.seconds += time.perf_counter() - start
        self.full, self.mesh = bench.folder / "edges.ply", bench.folder / "simple.ply"
        peers.write_ply(self.full, self.v, self.t)

    def simplified(self, error, lock_border):
        start = time.perf_counter()
        simple = self.peers.simplify(self.v, self.t, error, lock_border)
        self.peers.write_ply(self.mesh, self.v, simple)
        return len(simple), self.seconds + time.perf_counter() - start

    def smallest(self, key, limit, steps=6):
        """The fewest triangles with distance[key] <= limit that bisection of the target error finds, with the border
        free and locked: error, triangles, seconds, that distance, the mesh's quality. None if there are none."""
        options = ["--max-only", "--stop-above", repr(limit)] if key == "max" else []
        best = None
        for lock_border in LOCKS:
            def good(error):
                nonlocal best
                triangles, seconds = self.simplified(error, lock_border)
                if triangles == 0:
                    return False
                found = self.bench.distance(self.full, self.mesh, self.voxel, *options)
                ok = not found["stopped"] and found[key] <= limit
                if ok and (best is None or triangles < best["triangles"]):
                    best = {"error": error, "triangles": triangles, "seconds": seconds, "locked": lock_border,
                            "mesh": self.bench.quality(self.mesh)}
                return ok

            low = high = limit / 4
            while not good(low) and low > limit * 1e-3:
                low, high = low / 2, low
            while low == high and good(2 * high):
                low = high = 2 * high
            high = 2 * low if low == high else high
            for _ in range(steps):
                middle = math.sqrt(low * high)
                low, high = (middle, high) if good(middle) else (low, middle)
        if best:  # with --stop-above the maximum is known no better than that it is below
            self.simplified(best["error"], best["locked"])
            best[key] = self.bench.distance(self.full, self.mesh, self.voxel,
                                            *(["--max-only"] if key == "max" else []))[key]
        return best


def show(number):
    return "-" if number is None else f"{number:,}" if isinstance(number, int) else f"{number:.3g}"


def row(*cells):
    print("| " + " | ".join(cell if isinstance(cell, str) else show(cell) for cell in cells) + " |", flush=True)


def targets(bench, distances):
    least = bench.args.min_component
    row("volume, isovalue", "isonest full", "without specks", "seconds", "Flying Edges", "without specks",
        *(f"+ meshopt, max ≤ {d:g}: triangles, its error (L: borders locked), max, non-manifold edges, seconds"
          for d in distances))
    row(*["---"] * (6 + len(distances)))
    for name, store, voxel, box, isos in bench.seven():
        for iso in isos:
            full = bench.folder / "full.ply"
            report = bench.full(store, iso, full)
            kept = bench.quality(full, (), "--min-component", least)["triangles"]
            peer, cells = Peer(bench, store, iso, voxel, least), []
            for d in distances:
                best = peer.smallest("max", d * voxel)
                cells.append("-" if best is None else
                             f"**{best['triangles']:,}**, {best['error'] / voxel:.3g}"
                             f"{' L' if best['locked'] else ''}, {best['max'] / voxel:.3f}, "
                             f"{best['mesh']['nonmanifold_edges']}, {best['seconds']:.1f}")
            row(f"{name} {iso:g}", report["triangles"], kept, f"{report['seconds']:.2f}", peer.full_triangles,
                len(peer.t), *cells)


def compare(bench, distances):
    least = bench.args.min_component
    row("volume, isovalue, D", "isonest: triangles, max, q, non-manifold, seconds", "peer at max: triangles, ratio, "
        "non-manifold, seconds", "peer at q: triangles, ratio, non-manifold, seconds",
        *(["quadrics: max, q, non-manifold, seconds"] if bench.args.quadrics else []))
    row(*["---"] * (5 if bench.args.quadrics else 4))
    for name, store, voxel, box, isos in bench.seven():
        for iso in isos:
            full, mesh = bench.folder / "full.ply", bench.folder / "mesh.ply"
            bench.full(store, iso, full)
            peer = Peer(bench, store, iso, voxel, least)
            for d in distances:
                report = bench.within(store, iso, d * voxel, least, mesh)
                found = bench.distance(full, mesh, voxel, "--min-component", least)
                cells = [f"{report['triangles']:,}, {show(found['max'] and found['max'] / voxel)}, "
                         f"{show(found['p99.9'] and found['p99.9'] / voxel)}, "
                         f"{bench.quality(mesh)['nonmanifold_edges']}, {report['seconds']:.2f}"]
                for key in ("max", "p99.9"):
                    best = peer.smallest(key, found[key]) if found[key] else None
                    cells.append("-" if best is None else
                                 f"{best['triangles']:,}, {best['triangles'] / report['triangles']:.2f}, "
                                 f"{best['mesh']['nonmanifold_edges']}, {best['seconds']:.1f}")
                if bench.args.quadrics:
                    cells.append(quadrics(bench, peer, report["triangles"], voxel))
                row(f"{name} {iso:g}, {d:g}", *cells)


def quadrics(bench, peer, triangles, voxel):
    start = time.perf_counter()
    v, t = peer.peers.quadric_decimation(peer.v, peer.t, min(1.0, triangles / len(peer.t)))
    peer.peers.write_ply(peer.mesh, v, t)
    seconds = peer.seconds + time.perf_counter() - start
    found = bench.distance(peer.full, peer.mesh, voxel)
    return (f"{show(found['max'] and found['max'] / voxel)}, {show(found['p99.9'] and found['p99.9'] / voxel)}, "
            f"{bench.quality(peer.mesh)['nonmanifold_edges']}, {seconds:.1f}")


def verify(bench, distances):
    least, broken = bench.args.min_component, 0
    faults = ("nonmanifold_edges", "turned_edges", "boundary_edges_inside", "unused_vertices")

    def cases():
        if bench.args.data:
            yield from bench.seven()
        if not bench.args.volumes:
            import odd_volumes
            for name, path, iso, options in odd_volumes.write_all(bench.folder):
                yield (name, *bench.store(name, path, options), (iso,))

    print("| volume, isovalue | D | full surface | within D | largest distance, at most | |\n|---|---|---|---|---|---|")
    for name, store, voxel, box, isos in cases():
        # A vertex is rounded to float32.
        slack = 4 * max(abs(number) for number in box) * 2.0**-24
        for iso in isos:
            full, mesh = bench.folder / "full.ply", bench.folder / "mesh.ply"
            bench.full(store, iso, full)
            before = bench.quality(full, box, "--min-component", least)
            for d in distances:
                problem, triangles, text = "", 0, ""
                try:
                    triangles = bench.within(store, iso, d * voxel, least, mesh)["triangles"]
                    found = bench.distance(full, mesh, voxel, "--max-only", "--min-component", least)
                    after = bench.quality(mesh, box)
                    empty = [n == 0 for n in (before["triangles"], after["triangles"])]
                    if empty[0] != empty[1]:
                        problem = "one of the meshes is empty"
                    elif not empty[0]:
                        text = f"{found['max'] / voxel:.5f}, {found['max_at_most'] / voxel:.5f}"
                        if found["max"] > d * voxel + slack:
                            side = max(("a_to_b", "b_to_a"), key=lambda s: found[s]["max"])
                            problem = f"{'from' if side == 'a_to_b' else 'to'} the full surface at {found[side]['at']}"
                    for fault in faults:
                        if after[fault] > before[fault]:
                            problem += f" {fault} {before[fault]} -> {after[fault]}"
                except RuntimeError as error:
                    problem = str(error)
                broken += problem != ""
                print(f"| {name} {iso:g} | {d:g} | {before['triangles']:,} | {triangles:,} | {text} | "
                      f"{'BROKEN ' + problem if problem else 'ok'} |", flush=True)
    return 1 if broken else 0


def main():
    given = needs.arguments(3, __doc__)
    parser = argparse.ArgumentParser(usage=__doc__.replace("%", "%%"))
    parser.add_argument("isonest", type=pathlib.Path)
    parser.add_argument("plugin")
    parser.add_argument("mode", choices=("compare", "targets", "verify"))
    parser.add_argument("--data", type=pathlib.Path)
    parser.add_argument("--volumes")
    parser.add_argument("--isos", type=int)
    parser.add_argument("--distances")
    parser.add_argument("--min-component", type=int)
    parser.add_argument("--quadrics", action="store_true")
    parser.add_argument("--extract")
    parser.add_argument("--folder", type=pathlib.Path)
    parser.add_argument("--rounds", type=int, default=1)
    args = parser.parse_args(given)
    verifies = args.mode == "verify"
    os.environ["HDF5_PLUGIN_PATH"] = args.plugin
    needs.require(needs.program(args.isonest), *(needs.program(args.isonest.with_name(f"isonest_mesh_{name}"),
                                                               f"isonest_mesh_{name}")
                                                 for name in ("distance", "quality")),
                  needs.module("numpy"), needs.module("h5py"), None if verifies else needs.module("vtk"),
                  None if verifies or args.data else "give the folder of the volumes with --data")
    needs.require(needs.zstd_filter())
    if args.min_component is None:
        args.min_component = 0 if verifies else 100
    args.isos = args.isos or (3 if verifies else 1)
    distances = [float(d) for d in args.distances.split(",")] if args.distances else \
        {"verify": VERIFY, "compare": COMPARE, "targets": (0.25, 0.5)}[args.mode]
    return {"compare": compare, "targets": targets, "verify": verify}[args.mode](Bench(args), distances)


if __name__ == "__main__":
    sys.exit(main())
