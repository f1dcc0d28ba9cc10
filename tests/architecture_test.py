"""The arrows between the folders, and what stands at the top level. Arguments are not used."""
import pathlib
import re
import subprocess
import sys

root = pathlib.Path(__file__).resolve().parent.parent
allowed = {
    "store": {"store"},
    "preprocess": {"preprocess", "store"},
    "query": {"query", "store"},
    "tools": {"tools", "preprocess", "query", "store"},
    "tests": {"tests", "tools", "preprocess", "query", "store"},
}
hdf5_outside_store = {"preprocess/hdf5_source.cpp"}
faults = []
files = 0
for folder, may in allowed.items():
    for path in sorted((root / folder).rglob("*")):
        if path.suffix not in (".h", ".cpp"):
            continue
        files += 1
        name = str(path.relative_to(root))
        for line in path.read_text().splitlines():
            own = re.match(r'\s*#\s*include\s+"(\w+)/', line)
            if own and own.group(1) in allowed and own.group(1) not in may:
                faults.append(f"{name} includes {own.group(1)}/")
            system = re.match(r"\s*#\s*include\s+<(hdf5|H5\w*|zstd)\.h>", line)
            if system and folder not in ("store", "tests") and name not in hdf5_outside_store \
                    and not name.startswith("tools/bench/"):
                faults.append(f"{name} includes <{system.group(1)}.h>")
top = {"store", "preprocess", "query", "tests", "tools", "CMakeLists.txt", "README.md", "LICENSE",
       "CMakePresets.json"}
listing = subprocess.run(["git", "-C", str(root), "ls-tree", "--name-only", "HEAD"],
                         capture_output=True, text=True)
for name in listing.stdout.split():
    if not name.startswith(".") and name not in top:
        faults.append(f"{name} does not belong at the top level")
print("\n".join(faults) or f"{files} files: all includes follow the arrows")
sys.exit(bool(faults) or files < 40)
