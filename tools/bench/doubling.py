"""Whether the time of a surface at a tolerance grows with the surface or with the volume.

usage: doubling.py ISONEST FOLDER ISOVALUE ERROR_RELATIVE SIZE...    (129 257 513 1025)

Makes the uint8 bucky ball of each size in FOLDER (unless it is there), preprocesses it and extracts
the surface five times. Prints the smallest time, the counts, and the ratio to the size before.
"""
import json
import pathlib
import subprocess

import needs

isonest, folder, iso, relative, *sizes = needs.arguments(5, __doc__)
folder = pathlib.Path(folder)
needs.require(needs.program(isonest), needs.folder(folder))
before = None
for size in sizes:
    volume, store = folder / f"bucky-{size}.h5", folder / f"bucky-{size}.isonest"
    if not store.exists():
        if not volume.exists():
            subprocess.run([isonest, "make-volume", "bucky", "--size", size, "--type", "uint8", "-o",
                            volume, "-q"], check=True)
        subprocess.run([isonest, "preprocess", volume, "-o", store, "-q"], check=True)
    reports = [json.loads(subprocess.run(
        [isonest, "extract", store, "--iso", iso, "--error-relative", relative, "-o",
         folder / "doubling.ply", "--json"], check=True, capture_output=True).stdout)
        for _ in range(5)]
    best = min(reports, key=lambda r: r["seconds"])
    ratio = f", {best['seconds'] / before:.2f} x" if before else ""
    print(f"{size}^3: {best['seconds']:.3f} s{ratio}, {best['triangles']:,} triangles, "
          f"{best['visited_tetrahedra']:,} visited, {best['chunks_read']} of "
          f"{best['chunks_total']} chunks, {best['bytes_read'] / 1e6:.2f} MB", flush=True)
    before = best["seconds"]
