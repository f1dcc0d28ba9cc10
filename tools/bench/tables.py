"""The tables of RESULTS.md: each is made by the command written above it.

    <!-- table NAME: COMMAND -->
    Measured: isonest 0.5.0 (commit 0123abc), 2026-01-31, 2 cores of a CPU MODEL.

    | ...
    <!-- end -->

COMMAND is run by the shell in the root of the tree. Its output replaces everything between the lines. Variables: $BUILD, the
build folder; $DATA, a folder with the volumes of distance.py; $WORK, a folder for large files, kept. `bucky N` is the
store of a bucky ball of N^3 nodes of 8 bits in $WORK, made if it does not exist.
"""
import datetime
import os
import pathlib
import platform
import re
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parents[2]
RESULTS = ROOT / "tools/bench/RESULTS.md"
BLOCK = re.compile(r"<!-- table ([a-z-]+): (.*?) -->\n(.*?)<!-- end -->\n", re.S)
MEASURED = re.compile(r"Measured: isonest (\d+\.\d+\.\d+) \(commit ([0-9a-f]{7,})\)")

# Shell functions for the commands.
FUNCTIONS = """bucky() {
    local store=$WORK/bucky$1.isonest
    if [[ ! -e $store ]]; then
        "$BUILD/bin/isonest" make-volume bucky --size "$1" --type uint8 -q --force -o "$WORK/bucky$1.h5" >&2
        "$BUILD/bin/isonest" preprocess "$WORK/bucky$1.h5" -q -o "$store" >&2
    fi
    echo "$store"
}
"""


def version():
    return re.search(r"project\(isonest VERSION ([\d.]+)", (ROOT / "CMakeLists.txt").read_text()).group(1)


def machine():
    try:
        model = re.search(r"model name\s*: (.*)", pathlib.Path("/proc/cpuinfo").read_text()).group(1)
    except (OSError, AttributeError):
        model = platform.machine()
    return f"{os.cpu_count()} cores of {model}"


def measured():
    commit = subprocess.run(["git", "-C", ROOT, "rev-parse", "--short=8", "HEAD"], check=True, capture_output=True, text=True)
    return f"Measured: isonest {version()} (commit {commit.stdout.strip()}), {datetime.date.today()}, {machine()}."


def update(names, build, data, work):
    """Runs the commands of the tables with these names, or of all, and writes RESULTS.md after each."""
    blocks = {name: command for name, command, _ in BLOCK.findall(RESULTS.read_text(encoding="utf-8"))}
    for unknown in set(names) - blocks.keys():
        sys.exit(f"RESULTS.md has no table {unknown}; it has {', '.join(blocks)}")
    environment = {**os.environ, "BUILD": str(build), "DATA": str(data or ""), "WORK": str(work),
                   "HDF5_PLUGIN_PATH": str(build / "plugin")}
    failed = []
    for name in names or blocks:
        print(f"{name}: {blocks[name]}", file=sys.stderr, flush=True)
        if "$DATA" in blocks[name] and not data:
            failed.append(f"{name}: give --data FOLDER")
            continue
        done = subprocess.run(["bash", "-euc", FUNCTIONS + blocks[name]], cwd=ROOT, env=environment, stdout=subprocess.PIPE, text=True)
        if done.returncode != 0:
            failed.append(f"{name}: exit code {done.returncode}")
            continue
        # Read again: another run may have replaced another table.
        text = RESULTS.read_text(encoding="utf-8")
        block = f"<!-- table {name}: {blocks[name]} -->\n{measured()}\n\n{done.stdout.strip()}\n<!-- end -->\n"
        text = BLOCK.sub(lambda found: block if found.group(1) == name else found.group(0), text)
        RESULTS.with_suffix(".part").write_text(text, encoding="utf-8")
        RESULTS.with_suffix(".part").replace(RESULTS)
    sys.exit("\n".join(failed) if failed else 0)
