"""Checks which folders may include each other, the number of files per folder, the files at the top level, and that
the library names no options of the program. Arguments are not used.

The checker must first find faults planted into a copy of the tree, then none in the tree itself.
"""
import collections
import pathlib
import re
import shutil
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parents[2]
MAY_INCLUDE = {
    "store": {"store"},
    "preprocess": {"preprocess", "store"},
    "query": {"query", "store"},
    "tools": {"tools", "preprocess", "query", "store"},
    "tests": {"tests", "tools", "preprocess", "query", "store"},
}
# The rooms of each folder, each with the rooms that it may include in addition to itself and public headers.
ROOMS = {
    "store": {"base": set(), "files": {"base"}, "bytes": {"base", "files"},
              "remote": {"base", "bytes"}, "lattice": {"base"},
              "hdf5": {"base", "files", "bytes"}, "ranks": {"base", "files"},
              "container": {"base", "files", "bytes", "remote", "lattice", "hdf5"},
              "exports": {"base", "files", "hdf5", "container"},
              "series": {"base", "files"}},
    "preprocess": {"sources": set(), "indicators": set(), "levels": {"sources", "indicators"},
                   "ranks": {"levels", "sources", "indicators"},
                   "synthetic": set()},
    "query": {"values": set(), "march": {"values"}, "formats": set(), "mesh": {"values", "march"},
              "apart": {"mesh"}, "simplify": {"values", "mesh", "traverse"},
              "traverse": {"values", "march"}, "check": {"values"}, "study": {"values", "traverse"},
              "finite_elements": {"values", "traverse"},
              "statistics": set(), "surface_nets": {"statistics", "mesh"},
              "ranks": {"values", "march", "mesh", "apart", "formats", "simplify", "traverse"},
              "neuroglancer": {"mesh", "simplify"},
              "tiles": {"mesh", "simplify", "formats"}, "meshers": {"mesh", "formats"},
              "slabs": {"values", "march", "mesh", "apart"},
              "distance": {"values", "march", "simplify", "traverse"},
              "extract": {"values", "march", "mesh", "apart", "simplify", "traverse", "distance", "slabs", "ranks",
                          "statistics", "study", "surface_nets", "neuroglancer"}},
}
# Rooms within a room, each with those that it may include in addition to itself; every folder there is one of them.
SHARED = {"bytes": set(), "wrapping": {"bytes"}, "numbers": {"bytes", "wrapping"}, "placement": {"bytes", "numbers", "wrapping"}}
FORMATS = ("arrays", "dicom", "grids", "hdf5", "images", "tiff", "zarr")
INNER_ROOMS = {
    "store/container": {"parts": {"chunk_source.h", "codec.h", "format.h", "reader.h", "writer.h"}},
    "preprocess/sources": SHARED | {name: {*SHARED, "volume_format.h", "module_loader.h"} for name in FORMATS},
    "query/extract": {
        "stages": {"extract_query.h"},
        "labels": {"combinations.h", "extract_query.h", "query_checks.h", "report.h"},
    },
}
# The rooms of these that expose no header: a format is known by its function in volume_format.h.
CLOSED = {"preprocess/sources": FORMATS}
STORAGE_HEADERS = re.compile(r"(hdf5|hdf5_hl|H5\w+|zstd\w*)\.h")
# Zarr's chunks are zstd frames of their own.
STORAGE_ALLOWED = ("store/", "tests/", "tools/bench/", "preprocess/sources/hdf5/",
                   "preprocess/sources/zarr/zarr_codec")
TOP_LEVEL = {*MAY_INCLUDE, "CMakeLists.txt", "README.md", "CONTRIBUTING.md", "CHANGES.md", "LICENSE",
             "CMakePresets.json", "pyproject.toml",
             "PKG-INFO"}  # in the source archive (tools/package/backend.py)
MOST_FILES = 32  # per folder; more files are divided into rooms
DATA_FOLDERS = ("tests/fuzz/corpus/", "tests/store/golden/", "tools/pictures/figures/")
FETCHED = {"node_modules", "dist", "__pycache__"}
LOCAL_OUTPUT = re.compile(r"build.*|quickstart-out|.*\.isonest")  # as in .gitignore
FLAG = re.compile(r'"(?:[^"\\]|\\.)*--[a-z](?:[^"\\]|\\.)*"')
INCLUDE = re.compile(r'\s*#\s*include\s+([<"])([^>"]+)[>"]')
PUBLIC = re.compile(r"isonest/\w+\.h")


def place_in(parent, name):
    """The room or file in `parent` that contains `name`; "" if it is elsewhere."""
    return name.removeprefix(parent + "/").split("/")[0] if name.startswith(parent + "/") else ""


def paths_below(folder):
    """All files, in order, except fetched or generated ones."""
    for path in sorted(folder.iterdir()):
        if path.is_dir() and path.name not in FETCHED:
            yield from paths_below(path)
        elif path.is_file():
            yield path


def find_faults(root):
    faults, files, shown = [], 0, collections.Counter()
    # Where each public header lives: <isonest/error.h> is store/public/isonest/error.h.
    owner = {f"isonest/{path.name.removesuffix('.in')}": path.relative_to(root).parts[0]
             for path in root.glob("*/public/isonest/*.h*")
             if not LOCAL_OUTPUT.fullmatch(path.relative_to(root).parts[0])}
    for folder, may in MAY_INCLUDE.items():
        for path in paths_below(root / folder):
            name = path.relative_to(root).as_posix()
            if not name.startswith(DATA_FOLDERS) and not path.name.startswith("."):
                shown[path.parent.relative_to(root).as_posix()] += 1
            if path.suffix not in (".h", ".cpp"):
                continue
            files += 1
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
                    if quote == '"' and there in CLOSED.get(parent, ()) and here != there and folder != "tests":
                        faults.append(f"{place}; of {parent}/{there}/ nothing may be included outside of it")
                if PUBLIC.fullmatch(target) and owner.get(target) not in may:
                    faults.append(f"{place}, of {owner.get(target)}; {folder}/ may include "
                                  f"{', '.join(sorted(may))}")
                if STORAGE_HEADERS.fullmatch(target.split("/")[-1]) and quote == "<" \
                        and not name.startswith(STORAGE_ALLOWED):
                    faults.append(f"{place}; HDF5 and zstd belong into store/")
            if folder in ("store", "preprocess", "query") and not public \
                    and path.suffix == ".h" and re.search(r"^namespace isonest \{", text, re.M):
                faults.append(f"{name}: an inner header puts names into namespace isonest")
            faults += [f"{name} is in a room without arrows" for parent, inner in INNER_ROOMS.items()
                       if root / parent in path.parents and path.parent != root / parent
                       and place_in(parent, name) not in inner]
            if folder in ("store", "preprocess", "query") and path.parent == root / folder:
                faults.append(f"{name} belongs into a room")
    faults += [f"{folder}/ shows {count} files, at most {MOST_FILES} are to be seen at once: it needs rooms"
               for folder, count in sorted(shown.items()) if count > MOST_FILES]
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
    "query/values/planted_room.h": '#include "query/traverse/interest.h"',
    "store/container/planted_room.h": '#include "store/exports/volume_file.h"',
    "preprocess/sources/dicom/planted_inner.h": '#include "preprocess/sources/zarr/zarr_array.h"',
    "preprocess/sources/bytes/planted_shared.h": '#include "preprocess/sources/numbers/raw_rows.h"',
    "preprocess/sources/planted_inside.cpp": '#include "preprocess/sources/zarr/zarr_array.h"',
    "preprocess/levels/planted_face.cpp": '#include "preprocess/sources/zarr/zarr_array.h"',
    "preprocess/sources/unknown/planted.h": "",
    "query/planted_hdf5.cpp": "#include <hdf5.h>",
    "preprocess/planted_hdf5.cpp": "#include <hdf5.h>",
    "tools/planted.cpp": '#include "tests/support/test_support.h"',
    "tools/planted_zstd.cpp": "#include <zstd.h>",
    "store/base/planted_flag.cpp": 'fail("give \\"more\\" --memory");',
    "NOTES.md": "",
}
with tempfile.TemporaryDirectory() as temporary:
    copy = pathlib.Path(temporary)
    for folder in MAY_INCLUDE:
        shutil.copytree(ROOT / folder, copy / folder, ignore=shutil.ignore_patterns("node_modules"))
    for name, text in PLANTED.items():
        (copy / name).parent.mkdir(exist_ok=True)
        (copy / name).write_text(text + "\n")
    for folder, count in (("crowded", MOST_FILES + 1), ("full", MOST_FILES), ("full/node_modules", 99)):
        (copy / "tools" / folder).mkdir()
        for i in range(count):
            (copy / "tools" / folder / f"{i}.txt").touch()
    found = "\n".join(find_faults(copy)[0])
    missed = [name for name in (*PLANTED, "tools/crowded/ shows") if name not in found]
    if "tools/full" in found:
        sys.exit("the checker finds a fault where there is none")
if missed:
    sys.exit(f"the checker misses planted faults: {', '.join(missed)}")

faults, files = find_faults(ROOT)
if files < 40:
    sys.exit(f"only {files} source files found below {ROOT}")
print("\n".join(faults) or f"{files} files: all includes follow the arrows, no folder is crowded")
sys.exit(1 if faults else 0)
