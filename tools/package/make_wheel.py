#!/usr/bin/env python3
"""Makes a wheel of the files that `cmake --install BUILD --component wheel --prefix TREE` installs.

usage: make_wheel.py TREE OUT [--system-libraries]

The wheel is self-contained: the shared libraries that its programs and modules need, and theirs, are copied into
isonest.libs, as auditwheel does, under names that contain a hash, so that they are never mistaken for the system's
or another wheel's. They must come from Debian packages, whose versions and licences the wheel lists. With
--system-libraries none is copied, and the wheel is for this machine alone. The wheel is for the Python that the module
in TREE was compiled for. Equal trees and libraries give equal bytes. Needs readelf, ldd, strip, patchelf, gcc and dpkg;
with --system-libraries only strip.
"""
import argparse
import base64
import contextlib
import datetime
import hashlib
import json
import os
import pathlib
import re
import shutil
import struct
import subprocess
import sys
import tempfile
import zipfile

import sbom

try:
    import tomllib
except ImportError:  # before Python 3.11
    from pip._vendor import tomli as tomllib

ROOT = pathlib.Path(__file__).resolve().parents[2]

# Not copied: every system that has the C library of the tag has them. All parts of glibc must have the same version, and a
# process must have only one C++ library, the newest, because all modules share its exceptions and streams. manylinux's
# rules also assume libz, libexpat and X11 on every system; bare systems lack these, so they are copied.
SYSTEM = re.compile(r"(ld-linux.*|libc|libm|libmvec|libdl|libpthread|librt|libutil|libresolv|libanl|libstdc\+\+|libgcc_s)\.so(\.\d+)*")

# Replaced by stand-ins whose functions end the process with a message; except for JBIG, they are never called. Together
# the libraries would add 7.6 MB to the wheel, and a TLS library in a wheel gets no security updates. URLs are read with
# the system's libcurl, which is loaded when one is opened.
STAND_INS = {
    "libcurl.so.4": "HDF5's driver for S3, which isonest does not use",
    "libcrypto.so.3": "HDF5's driver for S3 and GDCM's encryption, which isonest does not use",
    "libX11.so.6": "cairo's windows, which isonest does not open",
    "libXext.so.6": "cairo's windows, which isonest does not open",
    "libXrender.so.1": "cairo's windows, which isonest does not open",
    "libxcb.so.1": "cairo's windows, which isonest does not open",
    "libxcb-render.so.0": "cairo's windows, which isonest does not open",
    "libxcb-shm.so.0": "cairo's windows, which isonest does not open",
    "libjbig.so.0": "TIFF in JBIG, which is left out because this library's licence, the GPL, would become the wheel's",
}
# Functions of these that are called, and what they return instead of ending the process. libtiff reports that jbg_dec_in
# fails.
ANSWERS = {"jbg_dec_init": "0", "jbg_newlen": "0", "jbg_dec_in": "1", "jbg_dec_free": "0",
           "jbg_strerror": '(long)"this wheel of isonest has no JBIG"'}

# The versions of symbols that come with at least the C library 2.N, as in manylinux's rules (auditwheel 6,
# manylinux-policy.json, x86_64): those of libstdc++ and libgcc that the distributions with that C library have.
FIRST_GLIBC = 17  # manylinux2014, the oldest that most package indices still accept
COMES_WITH = {
    "GLIBCXX": [("3.4.19", 17), ("3.4.22", 24), ("3.4.24", 27), ("3.4.28", 31), ("3.4.29", 34), ("3.4.30", 35), ("3.4.33", 39)],
    "CXXABI": [("1.3.7", 17), ("1.3.10", 24), ("1.3.11", 27), ("1.3.12", 31), ("1.3.13", 34), ("1.3.15", 39)],
    "GCC": [("4.8.0", 17), ("7.0.0", 27), ("12.0.0", 35), ("14.0.0", 39)],
}
NEEDED_VERSION = re.compile(r"\bName: (GLIBC|GLIBCXX|CXXABI|GCC)_([\w.]+)")

# Installed by pip into the environment's bin/. It does not import the package, which would load NumPy.
PROGRAM_SCRIPT = '''#!python
"""Runs the program isonest, which is in the package's folder."""
import importlib.util
import os
import sys

found = importlib.util.find_spec("isonest")
if found is None or not found.submodule_search_locations:
    sys.exit("isonest: the Python package isonest is not installed")
os.execv(os.path.join(found.submodule_search_locations[0], "bin", "isonest"), ["isonest", *sys.argv[1:]])
'''


class WheelError(Exception):
    """Something is missing, or cannot be put into a wheel."""


def output(*command):
    done = subprocess.run([*map(str, command)], capture_output=True, text=True, env={**os.environ, "LC_ALL": "C"})
    if done.returncode != 0:
        raise WheelError(f"{' '.join(map(str, command))}: {done.stderr.strip() or done.stdout.strip()}")
    return done.stdout


def numbers(version):
    return tuple(int(part) for part in version.split("."))


# ELF files

def is_elf(path):
    with open(path, "rb") as file:
        return file.read(4) == b"\x7fELF"


def needed_of(path):
    """The names of the libraries that a file needs, in the file's order."""
    return re.findall(r"\(NEEDED\).*\[(.*)\]", output("readelf", "-W", "-d", path))


def symbols_of(path, is_defined):
    """{name: (version or None, type, size)} of a file's dynamic symbols that are defined in it, or undefined."""
    found = {}
    for line in output("readelf", "-W", "--dyn-syms", path).splitlines():
        columns = line.split()
        if len(columns) >= 8 and columns[0].rstrip(":").isdigit() and (columns[6] != "UND") == is_defined:
            name, _, version = columns[7].partition("@")
            found[name] = (version.lstrip("@") or None, columns[3], int(columns[2], 0))
    return found


def where_found(path):
    """{name: path} of all libraries that the loader finds for a file, including indirect dependencies."""
    found = {}
    for line in output("ldd", path).splitlines():
        match = re.match(r"\s*(\S+) => (.*?)( \(0x[0-9a-f]+\))?$", line)
        if match and match[2] == "not found":
            raise WheelError(f"{path} needs {match[1]}, which is not found")
        if match:
            found[match[1]] = pathlib.Path(match[2])
    return found


def glibc_of(versions):
    """The N of manylinux_2_N for a set of (kind, version), as in ("GLIBC", "2.34")."""
    least = FIRST_GLIBC
    for kind, version in versions:
        if kind == "GLIBC":
            if version == "ABI_DT_RELR":
                least = max(least, 36)
            elif re.fullmatch(r"2\.\d+(\.\d+)?", version):
                least = max(least, numbers(version)[1])
            else:
                raise WheelError(f"a library needs GLIBC_{version}, which only this C library has")
        elif re.fullmatch(r"[\d.]+", version):
            first = next((glibc for last, glibc in COMES_WITH[kind] if numbers(version) <= numbers(last)), None)
            if first is None:
                raise WheelError(f"a library needs {kind}_{version}, which is newer than manylinux's rules")
            least = max(least, first)
    return least


def module_tags(name):
    """("cp311", "cp311") of "_core.cpython-311-x86_64-linux-gnu.so"."""
    match = re.fullmatch(r"_core\.cpython-(3)(\d+)(t?)-.*\.so", name)
    if not match:
        raise WheelError(f"{name} is of no CPython that this script knows")
    python = f"cp{match[1]}{match[2]}"
    return python, python + match[3]


# Libraries

class Library:
    """A library that is copied: its name, its file, its Debian package, and its name in the wheel."""

    def __init__(self, name, path):
        self.name, self.path = name, path.resolve()
        digest = hashlib.sha256(self.path.read_bytes()).hexdigest()[:8]
        stem, _, rest = name.partition(".so")
        self.new_name = f"{stem}-{digest}.so{rest}"
        self.package, self.version, self.source = debian_package(self.path)
        self.copyright = pathlib.Path("/usr/share/doc", self.package, "copyright")
        if not self.copyright.is_file():
            raise WheelError(f"{self.copyright}, with the licence of {name}, is missing")
        self.licence = licence_of(self.copyright.read_text(encoding="utf-8", errors="replace"))


def debian_package(path):
    """(package, version, source package) of a file."""
    # With /lib a link to /usr/lib, packages own files under either name.
    for name in (str(path), str(path).removeprefix("/usr")):
        with contextlib.suppress(WheelError):
            package = output("dpkg-query", "-S", name).split(":")[0]
            version, source = output("dpkg-query", "-W", "-f", "${Version} ${source:Package}\n", package).split()[:2]
            return package, version, source
    raise WheelError(f"{path} is of no Debian package, so its licence is not known")


def licence_of(text):
    """The names of the licences in a machine-readable copyright file, without those of Debian's own files."""
    names = []
    for paragraph in re.split(r"\n\s*\n", text):
        files = re.search(r"^Files:\s*(.*)", paragraph, re.M)
        name = re.search(r"^License:[ \t]*(\S.*)", paragraph, re.M)
        if files and name and not files[1].startswith("debian") and name[1].strip() not in names:
            names.append(name[1].strip())
    return ", ".join(names) or "see its copyright file"


def rename_undefined(file, symbols):
    """Renames undefined symbols of a file to their names in a stand-in; returns {new name: symbol}.

    The new names differ from the real ones, which the system's libcurl needs when the program loads it. Names are changed in
    place: the first letter becomes Z, or is left out if the name is also the end of a longer one.
    """
    data = bytearray(file.read_bytes())
    sections = {name: (int(begin, 16), int(size, 16)) for name, begin, size in re.findall(
        r"\] (\.dynstr|\.dynsym) +\S+ +\S+ (\S+) (\S+)", output("readelf", "-W", "-S", file))}
    (names, _), (table, table_size) = sections[".dynstr"], sections[".dynsym"]
    renamed = {}
    for entry in range(table, table + table_size, 24):  # Elf64_Sym: 4 bytes of name, 2 others, 2 of section
        place, _, section = struct.unpack_from("<IHH", data, entry)
        name = bytes(data[names + place:data.index(0, names + place)]).decode()
        if section == 0 and name in symbols:
            if data[names + place - 1] == 0:
                data[names + place] = ord("Z")
                renamed["Z" + name[1:]] = name
            else:
                struct.pack_into("<I", data, entry, place + 1)
                renamed[name[1:]] = name
    file.write_bytes(data)
    return renamed


def stand_in(name, users, real, folder):
    """Compiles the library that replaces `real` for the files `users`, and makes them call it. Returns its path."""
    defined = symbols_of(real, True)
    wanted = {}  # new name: (name, version, type, size)
    for user in users:
        absent = [symbol for symbol in symbols_of(user, False) if symbol in defined]
        for new_name, symbol in rename_undefined(user, absent).items():
            if wanted.setdefault(new_name, (symbol, *defined[symbol]))[0] != symbol:
                raise WheelError(f"{name}: two symbols have the name {new_name} in the stand-in")
    source, script, made = folder / "absent.c", folder / "absent.map", folder / name
    # Data are zeros, because only the replaced functions would read them (cairo passes them descriptions of X11's extensions).
    code = [f"char {new_name}[{size}];\n" if kind == "OBJECT"
            else f"long {new_name}(void) {{ return {ANSWERS[symbol]}; }}\n" if symbol in ANSWERS
            else f'void {new_name}(void) {{ end("{symbol}"); }}\n'
            for new_name, (symbol, _, kind, size) in sorted(wanted.items())]
    source.write_text(
        "#include <stdio.h>\n#include <stdlib.h>\n"
        "static void end(const char* function) {\n"
        f'    fprintf(stderr, "isonest: %s: the wheel has no {name}\\n", function);\n    abort();\n}}\n' + "".join(code))
    versions = sorted({of[1] for of in wanted.values() if of[1]})
    script.write_text("".join(
        f"{version} {{ global: {' '.join(f'{new_name};' for new_name in sorted(wanted) if wanted[new_name][1] == version)} }};\n"
        for version in versions) or "{ global: *; };\n")
    output("gcc", "-shared", "-fPIC", "-O1", "-fno-builtin", "-w", "-s", "-Wl,--build-id=none", "-Wl,-z,now",
           "-Wl,-z,noseparate-code", f"-Wl,-soname,{name}", f"-Wl,--version-script={script}", source, "-o", made)
    return made


def bundle(tree):
    """Copies the libraries into tree/isonest.libs and links the files of the tree to the copies. Returns the libraries."""
    libraries, replaced, users, names = {}, {}, {}, {}
    files = sorted(path for path in tree.rglob("*") if path.is_file() and is_elf(path))
    to_do = [(file, None, where_found(file)) for file in files]
    while to_do:
        file, file_name, found = to_do.pop()
        for name in needed_of(file):
            if SYSTEM.fullmatch(name):
                continue
            if name in STAND_INS:
                replaced[name] = found[name]
                users.setdefault(name, []).append((file, file_name))
            elif name not in libraries:
                libraries[name] = Library(name, found[name])
                to_do.append((libraries[name].path, libraries[name].new_name, found))
    folder = tree / "isonest.libs"
    folder.mkdir()
    for name, library in libraries.items():
        names[name] = library.new_name
        shutil.copyfile(library.path, folder / library.new_name)
    with tempfile.TemporaryDirectory() as temporary:
        for name, real in replaced.items():
            copies = sorted(folder / file_name if file_name else file for file, file_name in users[name])
            made = stand_in(name, copies, real, pathlib.Path(temporary))
            digest = hashlib.sha256(made.read_bytes()).hexdigest()[:8]
            stem, _, rest = name.partition(".so")
            names[name] = f"{stem}-absent-{digest}.so{rest}"
            shutil.copyfile(made, folder / names[name])
    for name, new_name in names.items():
        patch(folder / new_name, names, "$ORIGIN", new_name)
    for file in files:
        patch(file, names, "$ORIGIN/" + os.path.relpath(folder, file.parent))
    return [libraries[name] for name in sorted(libraries)]


def patch(file, names, where, own_name=None):
    """Sets the libraries that a file needs, their folder, and its own name. patchelf is called once for each of the three,
    because version 0.14 mixes up the strings of different options; but all library names are set in one call, because each
    call moves the tables to the end of the file, which grows."""
    file.chmod(0o755)
    needed = [name for name in needed_of(file) if name in names]
    if needed:
        output("patchelf", *(word for name in needed for word in ("--replace-needed", name, names[name])), file)
    if own_name:
        output("patchelf", "--set-soname", own_name, file)
    output("patchelf", *(["--set-rpath", where] if needed else ["--remove-rpath"]), file)
    dynamic = output("readelf", "-W", "-d", file)
    expected = [names[name] for name in needed] + [own_name or ""] + ([where] if needed else [])
    if any(name in names for name in needed_of(file)) or not all(f"[{text}]" in dynamic for text in expected if text):
        raise WheelError(f"patchelf did not change {file} as it should")


# Metadata

def project():
    """[project] of pyproject.toml, with the version of CMakeLists.txt."""
    found = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    found["version"] = sbom.own_version()
    return found


def metadata_of(of):
    """The text of METADATA, and of PKG-INFO in a source archive."""
    lines = ["Metadata-Version: 2.1", f"Name: {of['name']}", f"Version: {of['version']}", f"Summary: {of['description']}",
             "License: MIT", f"Requires-Python: {of['requires-python']}", "Classifier: License :: OSI Approved :: MIT License",
             "Classifier: Operating System :: POSIX :: Linux", "Classifier: Programming Language :: Python :: 3"]
    lines += [f"Requires-Dist: {package}" for package in of.get("dependencies", [])]
    for extra, packages in of.get("optional-dependencies", {}).items():
        lines.append(f"Provides-Extra: {extra}")
        lines += [f'Requires-Dist: {package}; extra == "{extra}"' for package in packages]
    lines += ["Description-Content-Type: text/markdown", "", (ROOT / of["readme"]).read_text(encoding="utf-8")]
    return "\n".join(lines)


def entry_points(of):
    """The text of entry_points.txt, by which other programs find the package."""
    return "\n".join(f"[{group}]\n" + "".join(f"{name} = {place}\n" for name, place in entries.items())
                     for group, entries in of.get("entry-points", {}).items())


def licences(libraries):
    """{name in dist-info: text} of the licences: isonest's, a table of the libraries, and their copyright files."""
    files = {"licenses/LICENSE": (ROOT / "LICENSE").read_bytes()}
    if libraries:
        table = ["# Libraries in this wheel", "",
                 "Copied from Debian's packages; the source of each is the source package of that version at snapshot.debian.org.",
                 "", "| library | file | Debian's package | version | source package | licences |", "|---|---|---|---|---|---|"]
        table += [f"| {of.name} | isonest.libs/{of.new_name} | {of.package} | {of.version} | {of.source} | {of.licence} |"
                  for of in libraries]
        files["licenses/LIBRARIES.md"] = ("\n".join(table) + "\n").encode()
    for of in libraries:
        files[f"licenses/{of.package}/copyright"] = of.copyright.read_bytes()
    return files


def materials(libraries):
    """CycloneDX of the wheel: the libraries that it contains."""
    parts = [sbom.part(of.name, of.version, sbom.debian_url(of.package, of.version), {"license": {"name": of.licence}})
             for of in libraries]
    return (json.dumps(sbom.document(parts), indent=2, ensure_ascii=False) + "\n").encode()


# The archive

def record_row(name, data):
    digest = base64.urlsafe_b64encode(hashlib.sha256(data).digest()).rstrip(b"=").decode()
    return f"{name},sha256={digest},{len(data)}"


def write_archive(path, files, dist_info):
    """files: {name: (bytes, is a program)}. RECORD, the list of all, is added; dist-info comes last, as PEP 427 recommends."""
    rows = [record_row(name, data) for name, (data, _) in sorted(files.items())]
    record = f"{dist_info}/RECORD"
    files = {**files, record: ("\n".join([*rows, f"{record},,"]).encode() + b"\n", False)}
    epoch = max(int(os.environ.get("SOURCE_DATE_EPOCH", 0)), 315532800)  # ZIP begins in 1980
    date = datetime.datetime.fromtimestamp(epoch, datetime.timezone.utc).timetuple()[:6]
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for name in sorted(files, key=lambda name: (name.startswith(dist_info), name == record, name)):
            data, is_program = files[name]
            entry = zipfile.ZipInfo(name, date)
            entry.create_system = 3  # Unix, whose permissions follow
            entry.external_attr = (0o100755 if is_program else 0o100644) << 16
            entry.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(entry, data)


def make(tree, out, is_bundled=True):
    """Makes the wheel of a tree in the folder `out`. Returns its name and the libraries in it."""
    tree, out = pathlib.Path(tree), pathlib.Path(out)
    of = project()
    modules = [path.name for path in (tree / "isonest").glob("_core.*.so")]
    if len(modules) != 1:
        raise WheelError(f"{tree}/isonest has no module _core: {modules}")
    python, abi = module_tags(modules[0])
    machine = os.uname().machine
    with tempfile.TemporaryDirectory() as temporary:
        work = pathlib.Path(temporary, "tree")
        shutil.copytree(tree, work)
        # Before patchelf, because strip would destroy what patchelf moves.
        for path in filter(is_elf, sorted(path for path in work.rglob("*") if path.is_file())):
            output("strip", "--strip-unneeded", path)
        libraries, platform = [], f"linux_{machine}"
        if is_bundled:
            libraries = bundle(work)
            needed = {found for path in work.rglob("*") if path.is_file() and is_elf(path)
                      for found in NEEDED_VERSION.findall(output("readelf", "-W", "-V", path))}
            platform = f"manylinux_2_{glibc_of(needed)}_{machine}"
        stem = f"{of['name']}-{of['version']}"
        dist_info = f"{stem}.dist-info"
        files = {path.relative_to(work).as_posix(): (path.read_bytes(), os.access(path, os.X_OK))
                 for path in work.rglob("*") if path.is_file()}
    files[f"{stem}.data/scripts/isonest"] = (PROGRAM_SCRIPT.encode(), True)
    tag = f"{python}-{abi}-{platform}"
    files[f"{dist_info}/METADATA"] = (metadata_of(of).encode(), False)
    files[f"{dist_info}/WHEEL"] = (f"Wheel-Version: 1.0\nGenerator: isonest\nRoot-Is-Purelib: false\nTag: {tag}\n".encode(), False)
    files[f"{dist_info}/entry_points.txt"] = (entry_points(of).encode(), False)
    for name, data in licences(libraries).items():
        files[f"{dist_info}/{name}"] = (data, False)
    if is_bundled:
        files[f"{dist_info}/sboms/isonest.cdx.json"] = (materials(libraries), False)
    name = f"{stem}-{tag}.whl"
    write_archive(out / name, files, dist_info)
    return name, libraries


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("tree")
    parser.add_argument("out")
    parser.add_argument("--system-libraries", action="store_true")
    arguments = parser.parse_args()
    try:
        name, libraries = make(arguments.tree, arguments.out, not arguments.system_libraries)
    except WheelError as error:
        sys.exit(f"make_wheel.py: {error}")
    print(f"{name}: {pathlib.Path(arguments.out, name).stat().st_size} bytes, {len(libraries)} libraries")


if __name__ == "__main__":
    main()
