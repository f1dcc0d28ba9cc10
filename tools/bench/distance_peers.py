#!/usr/bin/python3
"""Surfaces within a distance compared with four peers: CGAL, VTK and OpenVDB on the same surfaces.

usage: distance_peers.py ISONEST PLUGIN_FOLDER hausdorff|envelope|quadrics|adaptivity --data FOLDER
                         [--volumes A,B] [--distances D,D] [--cells N] [--seconds S] [--folder FOLDER]

Each mode prints a markdown table. Distances are in voxels: smallest spacings. "max" and "q" are measured by
isonest_mesh_distance: the two-sided maximum, found to within a hundredth of a voxel, and the larger 99.9 % quantile.

hausdorff   on a crop: max, the bound on it, and CGAL's bounded_error_symmetric_Hausdorff_distance, whose error is at most
            a thousandth of a voxel, between isonest's mesh and its full surface. Exit code 1 if a distance is not kept,
            or if the two programs contradict each other.
envelope    on a crop: isonest and CGAL's edge collapse within a polyhedral envelope of the same full surface. The
            envelope only bounds the distance to the full surface, so the maxima of both directions are shown.
quadrics    isonest and vtkQuadricDecimation of Flying Edges' mesh, to as many triangles. Components of fewer than
            100 triangles are first removed on both sides.
adaptivity  isonest and OpenVDB's volumeToMesh, measured against OpenVDB's mesh at adaptivity 0; the fewest triangles
            with max <= D that eight steps of bisection of the adaptivity find.

A crop is the cube with --cells (48) cells per side, among those side by side from the first node, that has the most
cells with values on both sides of the isovalue. A program of CGAL that needs more than --seconds (300) is stopped: "-".
Seconds are the processor time of one run: isonest's include reading the store and writing, the peers' do not. The
first isovalue of each volume in distance.py is used. The programs are in the same folder as ISONEST; CGAL's and
OpenVDB's are only built if `tools/install-deps --bench` has installed the libraries.
"""
import argparse
import json
import os
import pathlib
import resource
import subprocess
import sys
import time

import needs

PROGRAMS = {"hausdorff": ["cgal_distance"], "envelope": ["cgal_envelope"], "quadrics": [], "adaptivity": ["openvdb_mesh"]}


def beside(bench, name, *arguments):
    """The output of a program in the folder of ISONEST; None if it needs more than --seconds."""
    command = [str(a) for a in (bench.args.isonest.with_name(f"isonest_{name}"), *arguments)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=bench.args.seconds)
    except subprocess.TimeoutExpired:
        return None
    if done.returncode:
        raise RuntimeError(f"{' '.join(command)}: exit code {done.returncode}: {done.stderr.strip()[:500]}")
    return json.loads(done.stdout)


def extract(bench, store, iso, options, out):
    """The report of isonest, with its seconds as processor time."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    report = bench.extract(store, iso, options, out)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return {**report, "seconds": after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime}


def values_of(store):
    import h5py
    with h5py.File(store) as file:
        return file["levels/0/values"][...], file.attrs["spacing"], file.attrs["origin"]


def crop(store, iso, cells):
    """The corners of the crop in the store's unit."""
    import numpy as np
    u, spacing, origin = values_of(store)
    some = every = u > iso
    for axis in range(3):
        low, high = ((slice(None),) * axis + (part,) for part in (slice(None, -1), slice(1, None)))
        some, every = some[low] | some[high], every[low] & every[high]
    cut = some & ~every
    best, at = -1, None
    for z in range(0, max(1, cut.shape[0] - cells + 1), cells):
        for y in range(0, max(1, cut.shape[1] - cells + 1), cells):
            for x in range(0, max(1, cut.shape[2] - cells + 1), cells):
                count = int(np.count_nonzero(cut[z:z + cells, y:y + cells, x:x + cells]))
                if count > best:
                    best, at = count, (x, y, z)
    low = [float(o + s * i) for o, s, i in zip(origin, spacing, at)]
    high = [float(o + s * min(i + cells, n - 1)) for o, s, i, n in zip(origin, spacing, at, u.shape[::-1])]
    return at, ["--box", ",".join(repr(c) for c in (*low, *high))]


def crops(bench):
    """Name, store, isovalue, voxel, first cell, options, and the full surface, extracted."""
    full = bench.folder / "crop-full.ply"
    for name, store, voxel, _box, isos in bench.seven():
        at, box = crop(store, isos[0], bench.args.cells)
        report = extract(bench, store, isos[0], [*box, "--error", "0", "--cells", "hex"], full)
        yield name, store, isos[0], voxel, at, box, report["triangles"], full


def hausdorff(bench, distances):
    from distance import row
    row("volume, isovalue, first cell", "D", "full", "within D", "max", "max is at most", "CGAL", "CGAL's seconds")
    row(*["---"] * 8)
    wrong = 0
    mesh = bench.folder / "crop.ply"
    for name, store, iso, voxel, at, box, triangles, full in crops(bench):
        for d in distances:
            report = extract(bench, store, iso, [*box, "--distance", repr(d * voxel)], mesh)
            found = bench.distance(full, mesh, voxel, "--max-only", "--epsilon", repr(voxel / 1000))
            other = beside(bench, "cgal_distance", full, mesh, voxel / 1000)
            low, high = found["max"] / voxel, found["max_at_most"] / voxel
            text = "-"
            if other:
                cgal = other["distance"] / voxel
                text = f"{cgal:.5f}" + (f" ({sum(other['flat'])} flat)" if sum(other["flat"]) else "")
                bad = cgal > d + 1e-3 or cgal + 1e-3 < low or cgal - 1e-3 > high
                text += " CONTRADICTS" if bad else ""
                wrong += bad
            wrong += low > d * (1 + 1e-4)
            row(f"{name} {iso:g}, {at[0]} {at[1]} {at[2]}", d, triangles, report["triangles"], f"{low:.5f}",
                f"{high:.5f}", text, other["seconds"] if other else None)
    return 1 if wrong else 0


def envelope(bench, distances):
    from distance import row
    row("volume, isovalue, first cell", "D", "full", "isonest: triangles, max, seconds",
        "CGAL: triangles, max from the full surface, max to it, non-manifold edges, seconds")
    row(*["---"] * 5)
    mesh = bench.folder / "crop.ply"
    for name, store, iso, voxel, at, box, triangles, full in crops(bench):
        for d in distances:
            report = extract(bench, store, iso, [*box, "--distance", repr(d * voxel)], mesh)
            mine = bench.distance(full, mesh, voxel, "--max-only")
            other = beside(bench, "cgal_envelope", full, repr(d * voxel), mesh)
            text = "-"
            if other:
                far = bench.distance(full, mesh, voxel, "--max-only")
                text = (f"{other['triangles']:,}, {far['a_to_b']['max'] / voxel:.3f}, {far['b_to_a']['max'] / voxel:.3f}, "
                        f"{bench.quality(mesh)['nonmanifold_edges']}, {other['seconds']:.1f}")
            row(f"{name} {iso:g}, {at[0]} {at[1]} {at[2]}", d, triangles,
                f"{report['triangles']:,}, {mine['max'] / voxel:.3f}, {report['seconds']:.2f}", text)
    return 0


def quadrics(bench, distances):
    import distance
    least = 100
    distance.row("volume, isovalue", "D", "isonest: triangles, max, q, non-manifold edges, seconds",
                 "quadrics: triangles, max, q, non-manifold edges, seconds")
    distance.row(*["---"] * 4)
    full, mesh = bench.folder / "full.ply", bench.folder / "mesh.ply"
    for name, store, voxel, _box, isos in bench.seven():
        bench.full(store, isos[0], full)
        peer = distance.Peer(bench, store, isos[0], voxel, least)
        for d in distances:
            report = extract(bench, store, isos[0], ["--distance", repr(d * voxel), "--min-component", str(least)], mesh)
            found = bench.distance(full, mesh, voxel, "--min-component", least)
            cells = [f"{report['triangles']:,}, {found['max'] / voxel:.3f}, {found['p99.9'] / voxel:.3f}, "
                     f"{bench.quality(mesh)['nonmanifold_edges']}, {report['seconds']:.2f}"]
            start = time.process_time()
            v, t = peer.peers.quadric_decimation(peer.v, peer.t, min(1.0, report["triangles"] / len(peer.t)))
            seconds = time.process_time() - start
            peer.peers.write_ply(peer.mesh, v, t)
            found = bench.distance(peer.full, peer.mesh, voxel)
            cells.append(f"{len(t):,}, {found['max'] / voxel:.3f}, {found['p99.9'] / voxel:.3f}, "
                         f"{bench.quality(peer.mesh)['nonmanifold_edges']}, {seconds:.2f}")
            distance.row(f"{name} {isos[0]:g}", d, *cells)
    return 0


def adaptivity(bench, distances):
    import numpy as np
    from distance import row
    row("volume, isovalue", "D", "isonest: full, within D, max, seconds",
        "OpenVDB: full, adapted, max, adaptivity, non-manifold edges, seconds", "ratio")
    row(*["---"] * 5)
    raw, theirs, adapted, full, mesh = (bench.folder / name for name in (
        "values.f32", "openvdb-full.ply", "openvdb.ply", "full.ply", "mesh.ply"))
    for name, store, voxel, _box, isos in bench.seven():
        u, spacing, origin = values_of(store)
        raw.write_bytes(np.ascontiguousarray(u, "<f4").tobytes())
        volume = (raw, *u.shape[::-1], *map(repr, map(float, (*spacing, *origin))), isos[0])
        before = beside(bench, "openvdb_mesh", *volume, 0, theirs)["triangles"]
        triangles = bench.full(store, isos[0], full)["triangles"]
        for d in distances:
            report = extract(bench, store, isos[0], ["--distance", repr(d * voxel)], mesh)
            mine = bench.distance(full, mesh, voxel, "--max-only")
            best = None

            def good(a):
                nonlocal best
                made = beside(bench, "openvdb_mesh", *volume, repr(a), adapted)
                found = bench.distance(theirs, adapted, voxel, "--max-only", "--stop-above", repr(d * voxel))
                ok = not found["stopped"] and found["max"] <= d * voxel
                if ok and (best is None or made["triangles"] < best["triangles"]):
                    best = {**made, "adaptivity": a, "mesh": bench.quality(adapted)}
                return ok

            low, high = 0.0, 1.0
            if not good(1.0):
                for _ in range(8):
                    middle = (low + high) / 2
                    low, high = (middle, high) if good(middle) else (low, middle)
            text, ratio = "-", None
            if best:
                beside(bench, "openvdb_mesh", *volume, repr(best["adaptivity"]), adapted)
                found = bench.distance(theirs, adapted, voxel, "--max-only")
                text = (f"{before:,}, {best['triangles']:,}, {found['max'] / voxel:.3f}, {best['adaptivity']:.3g}, "
                        f"{best['mesh']['nonmanifold_edges']}, {best['seconds']:.2f}")
                ratio = best["triangles"] / report["triangles"]
            row(f"{name} {isos[0]:g}", d, f"{triangles:,}, {report['triangles']:,}, {mine['max'] / voxel:.3f}, "
                f"{report['seconds']:.2f}", text, ratio)
    return 0


def main():
    given = needs.arguments(3, __doc__)
    parser = argparse.ArgumentParser(usage=__doc__.replace("%", "%%"))
    parser.add_argument("isonest", type=pathlib.Path)
    parser.add_argument("plugin")
    parser.add_argument("mode", choices=tuple(PROGRAMS))
    parser.add_argument("--data", type=pathlib.Path)
    parser.add_argument("--volumes")
    parser.add_argument("--distances")
    parser.add_argument("--cells", type=int, default=48)
    parser.add_argument("--seconds", type=float, default=300)
    parser.add_argument("--folder", type=pathlib.Path)
    args = parser.parse_args(given)
    os.environ["HDF5_PLUGIN_PATH"] = args.plugin
    programs = [f"isonest_{p}" for p in ("mesh_distance", "mesh_quality", *PROGRAMS[args.mode])]
    missing = [needs.program(args.isonest.with_name(p), p) for p in programs]
    if any(missing[2:]):
        missing.append(f"the peers' programs are built where their libraries are: first {needs.INSTALL}")
    needs.require(needs.program(args.isonest), *missing,
                  needs.module("numpy"), needs.module("h5py"),
                  needs.module("vtk") if args.mode == "quadrics" else None,
                  None if args.data else "give the folder of the volumes with --data")
    needs.require(needs.zstd_filter())
    import distance
    args.rounds, args.isos, args.extract = 1, 1, None
    distances = [float(d) for d in args.distances.split(",")] if args.distances else distance.COMPARE
    return globals()[args.mode](distance.Bench(args), distances)


if __name__ == "__main__":
    sys.exit(main())
