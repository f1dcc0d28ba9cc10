"""The arrows between the folders, what stands at the top level, and that the library names no flags of the
program. Arguments are not used.

The checker first has to find faults planted into a copy of the tree, then none in the tree itself.
"""
import pathlib
import re
import shutil
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parent.parent
MAY_INCLUDE = {
    "store": {"store"},
    "preprocess": {"preprocess", "store"},
    "query": {"query", "store"},
    "tools": {"tools", "preprocess", "query", "store"},
    "tests": {"tests", "tools", "preprocess", "query", "store"},
}
# The rooms of a folder, each with those that it may include beside itself and public headers.
ROOMS = {
    "store": {"base": set(), "files": {"base"}, "lattice": {"base"},
              "container": {"base", "files", "lattice"}},
    "preprocess": {"sources": set(), "indicators": set(), "levels": {"sources", "indicators"},
                   "synthetic": set()},
    "query": {"view": set(), "march": {"view"}, "formats": set(), "mesh": {"view", "march"},
              "simplify": {"view", "mesh", "traverse"},
              "traverse": {"view", "march"}, "check": {"view"}, "study": {"view", "traverse"},
              "finite_elements": {"view", "traverse"},
              "statistics": set(), "labels": set(),
              "distance": {"view", "march", "simplify", "traverse"},
              "extract": {"view", "march", "mesh", "simplify", "traverse", "distance"}},
}
# Rooms within a room. What stands beside them (the room's entrance) may include all of them; they may
# include of it what is named here.
SHARED = {"bytes", "placement", "wrapping", "volume_format.h"}
INNER_ROOMS = {
    "preprocess/sources": {
        "bytes": {"nrrd", "volume_format.h"}, "wrapping": {"bytes"}, "placement": SHARED,
        **{name: SHARED for name in ("dicom", "meta_image", "mrc", "nifti", "nrrd", "numpy",
                                     "openvdb", "tiff", "zarr")},
        "hdf5": SHARED | {"nrrd"}, "netcdf": SHARED | {"nrrd"}, "vtk": SHARED | {"nrrd"},
    },
    "query/extract": {
        "stages": {"extract_query.h"},
        "analysis": {"extract_query.h", "run_extraction.h", "stages"},
    },
}
STORAGE_HEADERS = re.compile(r"(hdf5|hdf5_hl|H5\w+|zstd\w*)\.h")
# Zarr's chunks are zstd frames of its own.
STORAGE_ALLOWED = ("store/", "tests/", "tools/bench/", "preprocess/sources/hdf5/",
                   "preprocess/sources/zarr/zarr_codec")
TOP_LEVEL = {*MAY_INCLUDE, "CMakeLists.txt", "README.md", "CONTRIBUTING.md", "LICENSE",
             "CMakePresets.json", "pyproject.toml"}
LOCAL_OUTPUT = re.compile(r"build.*|quickstart-out|.*\.isonest")  # as in .gitignore
FLAG = re.compile(r'"(?:[^"\\]|\\.)*--[a-z](?:[^"\\]|\\.)*"')
INCLUDE = re.compile(r'\s*#\s*include\s+([<"])([^>"]+)[>"]')
PUBLIC = re.compile(r"isonest/\w+\.h")


def place_in(parent, name):
    """The room, or file, of `parent` that `name` is in; nothing if it is elsewhere."""
    return name.removeprefix(parent + "/").split("/")[0] if name.startswith(parent + "/") else ""


def find_faults(root):
    faults, files = [], 0
    # Where each public header lives: <isonest/error.h> is store/public/isonest/error.h.
    owner = {f"isonest/{path.name.removesuffix('.in')}": path.relative_to(root).parts[0]
             for path in root.glob("*/public/isonest/*.h*")
             if not LOCAL_OUTPUT.fullmatch(path.relative_to(root).parts[0])}
    for folder, may in MAY_INCLUDE.items():
        for path in sorted((root / folder).rglob("*")):
            if path.suffix not in (".h", ".cpp"):
                continue
            files += 1
            name = path.relative_to(root).as_posix()
            public = "/public/" in name
            text = path.read_text(encoding="utf-8")
            for number, line in enumerate(text.splitlines(), 1):
                if folder in ("store", "preprocess", "query") and FLAG.search(line):
                    faults.append(f"{name}:{number}: a text names a flag; the library gives a remedy")
                include = INCLUDE.match(line)
                if not include:
                    continue
                quote, target = include.groups()
                place = f"{name}:{number}: includes {target}"
                if quote == '"' and public:
                    faults.append(f"{place}; public headers include public ones alone")
                if quote == '"' and target.split("/")[0] not in may:
                    faults.append(f"{place}; {folder}/ may include {', '.join(sorted(may))}")
                rooms = ROOMS.get(folder, {})
                room, of = name.split("/")[1], target.split("/")[:2]
                if quote == '"' and room in rooms and of[0] == folder \
                        and of[1] not in {room, *rooms[room]}:
                    faults.append(f"{place}; {folder}/{room}/ may include {sorted(rooms[room])}")
                for parent, inner in INNER_ROOMS.items():
                    here, there = (place_in(parent, which) for which in (name, target))
                    if quote == '"' and here in inner and there \
                            and there not in {here, *inner[here]}:
                        faults.append(f"{place}; {parent}/{here}/ may include {sorted(inner[here])}")
                if PUBLIC.fullmatch(target) and owner.get(target) not in may:
                    faults.append(f"{place}, of {owner.get(target)}; {folder}/ may include "
                                  f"{', '.join(sorted(may))}")
                if STORAGE_HEADERS.fullmatch(target.split("/")[-1]) and quote == "<" \
                        and not name.startswith(STORAGE_ALLOWED):
                    faults.append(f"{place}; HDF5 and zstd belong into store/")
            if folder in ("store", "preprocess", "query") and not public \
                    and path.suffix == ".h" and re.search(r"^namespace isonest \{", text, re.M):
                faults.append(f"{name}: an inner header puts names into namespace isonest")
            if folder in ("store", "preprocess", "query") and path.parent == root / folder:
                faults.append(f"{name} belongs into a room")
    for entry in sorted(root.iterdir()):
        if not (entry.name.startswith(".") or entry.name in TOP_LEVEL
                or LOCAL_OUTPUT.fullmatch(entry.name)):
            faults.append(f"{entry.name} does not belong at the top level")
    return faults, files


PLANTED = {
    "store/planted.h": '#include "query/extract/extract.h"',
    "preprocess/planted.cpp": '#include "query/extract/extract.h"',
    "query/planted.cpp": '#  include "preprocess/public/isonest/preprocess.h"',
    "query/planted_too.cpp": '#include "../store/error.h"',
    "query/mesh/planted_public.cpp": "#include <isonest/preprocess.h>",
    "store/public/isonest/planted.h": '#include "store/base/box.h"',
    "query/mesh/planted_names.h": "namespace isonest {",
    "query/view/planted_room.h": '#include "query/traverse/interest.h"',
    "preprocess/sources/dicom/planted_inner.h": '#include "preprocess/sources/zarr/zarr_source.h"',
    "query/planted_hdf5.cpp": "#include <hdf5.h>",
    "preprocess/planted_hdf5.cpp": "#include <hdf5.h>",
    "tools/planted.cpp": '#include "tests/test_support.h"',
    "tools/planted_zstd.cpp": "#include <zstd.h>",
    "store/base/planted_flag.cpp": 'fail("give \\"more\\" --memory");',
    "NOTES.md": "",
}
with tempfile.TemporaryDirectory() as temporary:
    copy = pathlib.Path(temporary)
    for folder in MAY_INCLUDE:
        shutil.copytree(ROOT / folder, copy / folder, ignore=shutil.ignore_patterns("node_modules"))
    for name, text in PLANTED.items():
        (copy / name).write_text(text + "\n")
    found = "\n".join(find_faults(copy)[0])
    missed = [name for name in PLANTED if name not in found]
if missed:
    sys.exit(f"the checker misses planted faults: {', '.join(missed)}")

faults, files = find_faults(ROOT)
if files < 40:
    sys.exit(f"only {files} source files found below {ROOT}")
print("\n".join(faults) or f"{files} files: all includes follow the arrows")
sys.exit(1 if faults else 0)
