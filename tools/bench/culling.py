#!/usr/bin/python3
"""What backface culling saves, over random directions of view.

usage: tools/bench/culling.py STORE --iso V [--error E] [--views 100] [--isonest PROGRAM]

STORE needs normal_turn_plus or grad_linf_plus (preprocess --indicators ...). For each of the two that it has, prints
the mean, smallest and largest fraction that remains of visited tetrahedra, triangles, bytes read and time.
"""
import argparse
import json
import pathlib
import random
import statistics
import subprocess
import tempfile

import needs

root = pathlib.Path(__file__).resolve().parents[2]
parser = argparse.ArgumentParser(description=__doc__,
                                 formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("store")
parser.add_argument("--iso", required=True)
parser.add_argument("--error", default="0")
parser.add_argument("--views", type=int, default=100)
parser.add_argument("--isonest", default=str(root / "build/bin/isonest"))
args = parser.parse_args()
needs.require(needs.program(args.isonest), needs.file(args.store, "a store"))
keys = ("visited_tetrahedra", "triangles", "bytes_read", "seconds")


def extract(folder, *options):
    done = subprocess.run([args.isonest, "extract", args.store, "--iso", args.iso, "--error", args.error,
                           "--cells", "tet", "--effort", "none", "-o", f"{folder}/m.ply", "--json", *options], check=True,
                          stdout=subprocess.PIPE)
    return json.loads(done.stdout)


fields = json.loads(subprocess.run([args.isonest, "info", args.store, "--json"], check=True,
                                   stdout=subprocess.PIPE).stdout)["fields"]
names = [f if isinstance(f, str) else f["name"] for f in fields]
needs.require(None if {"normal_turn_plus", "grad_linf_plus"} & set(names) else
              f"{args.store} has neither of the fields: isonest preprocess --indicators "
              "linf_bar,linf_plus,deviation_bar,normal_turn_plus,grad_linf_plus makes them")
print("| cull by | visited | triangles | bytes read | time |\n|---|---|---|---|---|")
with tempfile.TemporaryDirectory(prefix="isonest-bench-") as folder:
    for field in ("normal_turn_plus", "grad_linf_plus"):
        if field not in names:
            continue
        chance = random.Random(1)
        left = {key: [] for key in keys}
        for _ in range(args.views):
            view = [chance.gauss(0, 1) for _ in range(3)]
            whole = extract(folder)
            cut = extract(folder, "--view", ",".join(map(str, view)), "--cull-by", field)
            for key in keys:
                left[key].append(cut[key] / whole[key])
        print(f"| {field} | " + " | ".join(f"{statistics.mean(v):.3f} ({min(v):.3f} to {max(v):.3f})"
                                           for v in left.values()) + " |", flush=True)
