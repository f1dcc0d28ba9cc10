#!/usr/bin/python3
"""The size of stores, as multiples of what `zstd -3` makes of the values alone, and where the bytes are.

usage: tools/bench/store_size.py ISONEST VOLUME...

VOLUME is a file that isonest reads, with the options that it needs: "a.raw --dims 9,9,9 --type uint8". For each, stores
are made with three fields, with the default's two and with deviation_bar alone. The parts are of the default: values
and fields by the chunk table, by level, and everything else (table, ranges of cubes, HDF5). Medians of --rounds give
the time of `preprocess` for the default.
"""
import argparse
import pathlib
import shlex
import statistics
import subprocess
import tempfile
import time

import needs

parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("isonest")
parser.add_argument("volumes", nargs="+")
parser.add_argument("--rounds", type=int, default=3)
parser.add_argument("--options", default="", help="further options of preprocess")
args = parser.parse_args()
needs.require(needs.program(args.isonest), needs.module("h5py"), needs.tool("zstd"))

import h5py  # noqa: E402

FIELDS = ["linf_bar,linf_plus,deviation_bar", "linf_plus,deviation_bar", "deviation_bar"]


def run(*words):
    return subprocess.run([args.isonest, *map(str, words)], check=True, stdout=subprocess.PIPE).stdout


def bytes_of_chunks(store):
    """(bytes per field and level, the fraction of bytes without the shuffle)"""
    parts, unshuffled, seen = {}, 0, set()
    with h5py.File(store) as f:
        table = f["chunks"][...]
        for level in f["levels"]:
            for name, array in f["levels"][level].items():
                place = h5py.h5o.get_info(array.id).addr
                if array.chunks is None or place in seen:
                    continue
                seen.add(place)
                first = int(array.attrs["first_chunk_row"])
                rows = table[first:first + array.id.get_num_chunks()]
                what = name, min(int(level), 3)
                parts[what] = parts.get(what, 0) + int(rows["bytes"].sum())
                unshuffled += int(rows["bytes"][(rows["flags"] & 2) > 0].sum())
    return parts, unshuffled / sum(parts.values())


print("| volume | MB of zstd 3 | three fields | linf_plus, deviation_bar | deviation_bar | values | linf_plus, levels 1, 2, 3 on |"
      " deviation_bar | rest | not shuffled | s |\n|---|---|---|---|---|---|---|---|---|---|---|")
with tempfile.TemporaryDirectory(prefix="isonest-sizes-") as name:
    store, raw = pathlib.Path(name) / "s.isonest", pathlib.Path(name) / "s.raw"
    for volume in args.volumes:
        source = shlex.split(volume)
        sizes, seconds = [], []
        for fields in FIELDS:
            for _ in range(args.rounds if fields == FIELDS[1] else 1):
                start = time.perf_counter()
                run("preprocess", *source, "-o", store, "--force", "--indicators", fields, *shlex.split(args.options))
                seconds += [time.perf_counter() - start] if fields == FIELDS[1] else []
            sizes.append(store.stat().st_size)
            if fields == FIELDS[1]:
                parts, unshuffled = bytes_of_chunks(store)
        run("preprocess", *source, "-o", store, "--force", "--indicators", FIELDS[-1])  # the values that were given
        run("export", store, "-o", raw, "--force")
        packed = subprocess.Popen(["zstd", "-3", "-c", "-q", raw], stdout=subprocess.PIPE)
        reference = sum(len(block) for block in iter(lambda: packed.stdout.read(1 << 20), b""))
        assert packed.wait() == 0

        def of(field):
            return ", ".join(f"{parts.get((field, level), 0) / reference:.3f}" for level in (1, 2, 3))

        values = sum(size for (field, _), size in parts.items() if field == "values")
        rest = sizes[1] - sum(parts.values())
        print(f"| {pathlib.Path(source[0]).name.split('.')[0]} | {reference / 1e6:.2f} | "
              + " | ".join(f"{size / reference:.3f}" for size in sizes)
              + f" | {values / reference:.3f} | {of('linf_plus')} | {of('deviation_bar')} | {rest / reference:.3f} | "
              f"{100 * unshuffled:.0f} % | {statistics.median(seconds):.2f} |", flush=True)
