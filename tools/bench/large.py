"""Volumes far larger than --memory: time and peak heap of preprocess and extract, and the first coarse surface from a
store that is not in the page cache.

usage: large.py BUILD FOLDER [TYPE:SIZE:MEMORY...]    (uint8:2049:512M float32:1025:256M)

BUILD is a build folder, or a new one: isonest is built there and, from tools/bench, the library that counts the heap;
file mappings are not heap. FOLDER is for the volumes (which stay), the stores and the meshes (which are removed). A step
that held more than --memory is an error. The coarse surface, within 5 % of the range, is extracted three times, each
time after posix_fadvise(DONTNEED) on the store, including the start of the program.
"""
import json
import os
import pathlib
import re
import subprocess
import sys
import time

import needs

build, folder, *volumes = needs.arguments(2, __doc__)
build, folder = pathlib.Path(build).resolve(), pathlib.Path(folder)
isonest = build / "bin/isonest"
helper = build / "tools/bench/libisonest_peak_heap.so"
volumes = [v.split(":") for v in volumes or ["uint8:2049:512M", "float32:1025:256M"]]
BYTES = {"uint8": 1, "int8": 1, "uint16": 2, "int16": 2, "uint32": 4, "int32": 4, "float32": 4, "float64": 8}


def bytes_needed(kind, size):
    """Free space in FOLDER: for the volume, unless it exists, and 1.2 times that for its store and mesh."""
    volume = BYTES[kind] * int(size)**3
    return (0 if (folder / f"bucky-{kind}-{size}.h5").exists() else volume) + 1.2 * volume


needs.require(*(f"{':'.join(v)}: give TYPE:SIZE:MEMORY as in uint8:2049:512M" for v in volumes
                if len(v) != 3 or v[0] not in BYTES or not v[1].isdigit() or
                not re.fullmatch(r"\d+[KMG]", v[2])), needs.folder(folder))
needs.require(needs.space(folder, max(bytes_needed(kind, size) for kind, size, _ in volumes)))
needs.require(needs.built(build, "isonest", "isonest_peak_heap"))
needs.require(needs.program(isonest), None if helper.exists() else f"{helper} is missing: "
              f"{needs.build_command(build, 'isonest_peak_heap')}")
counted = dict(os.environ, LD_PRELOAD=str(helper))
UNITS = {"K": 1 << 10, "M": 1 << 20, "G": 1 << 30}


def run(*command):
    """(seconds, bytes of heap, report)"""
    start = time.perf_counter()
    done = subprocess.run([isonest, *command, "--json"], env=counted, capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(done.stderr)
    seconds = time.perf_counter() - start
    return seconds, int(re.search(r"peak heap (\d+) bytes", done.stderr)[1]), json.loads(done.stdout)


def forget(path):
    file = os.open(path, os.O_RDONLY)
    os.fsync(file)
    os.posix_fadvise(file, 0, 0, os.POSIX_FADV_DONTNEED)
    os.close(file)


def within(heap, budget, what):
    if heap > budget:
        sys.exit(f"{what} held {heap:,} bytes of heap, which is more than --memory")
    return f"{heap / (1 << 20):.0f} MiB of heap"


print("| volume, `--memory` | `preprocess` | store | full surface, tetrahedra | within 5 % of the range, store not in memory | "
      "`check --quick` |\n|---|---|---|---|---|---|")
for kind, size, memory in volumes:
    budget = int(memory[:-1]) * UNITS[memory[-1]]
    volume, store, mesh = (folder / f"bucky-{kind}-{size}.h5", folder / "large.isonest",
                           folder / "large.ply")
    iso = "121" if kind == "uint8" else "0.5"
    if not volume.exists():
        subprocess.run([isonest, "make-volume", "bucky", "--size", size, "--type", kind, "-o", volume,
                        "-q"], check=True)
    store.unlink(missing_ok=True)
    seconds, heap, _ = run("preprocess", volume, "-o", store, "--memory", memory)
    bytes_in = os.path.getsize(volume)
    cells = [f"{kind} {size}^3, {bytes_in / 1e9:.2f} GB, {memory}",
             f"{seconds:.1f} s ({bytes_in / 1e6 / seconds:.0f} MB/s), {within(heap, budget, 'preprocess')}",
             f"{os.path.getsize(store) / 1e9:.2f} GB"]
    mesh.unlink(missing_ok=True)
    seconds, heap, report = run("extract", store, "--iso", iso, "--cells", "tet", "-o", mesh, "--memory", memory)
    cells.append(f"{seconds:.1f} s, {within(heap, budget, 'extract')}, {report['triangles']:,} triangles, "
                 f"{os.path.getsize(mesh) / 1e9:.2f} GB")
    cold, heaps = [], []
    for _ in range(3):
        mesh.unlink(missing_ok=True)
        forget(store)
        seconds, heap, report = run("extract", store, "--iso", iso, "--error-relative", "0.05", "--effort", "none", "-o", mesh)
        cold.append(seconds)
        heaps.append(heap)
    cells.append(f"{min(cold):.2f} to {max(cold):.2f} s, {within(max(heaps), budget, 'extract')}, "
                 f"{report['triangles']:,} triangles, {report['chunks_read']} of {report['chunks_total']:,} chunks")
    start = time.perf_counter()
    subprocess.run([isonest, "check", store, "--quick", "-q"], check=True)
    print("| " + " | ".join(cells) + f" | {time.perf_counter() - start:.1f} s |", flush=True)
    store.unlink()
    mesh.unlink()
