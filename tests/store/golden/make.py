#!/usr/bin/env python3
"""Makes the golden stores of the version that ISONEST writes, valid and invalid ones.

usage: make.py ISONEST [--good-only]

Existing files are never changed. See CONTRIBUTING.md, "Golden stores".
"""
import ctypes
import pathlib
import re
import shutil
import struct
import subprocess
import sys
import tempfile

import h5py
import numpy as np

HERE = pathlib.Path(__file__).resolve().parent
ISONEST = sys.argv[1]
# Name, nodes along x, y, z, type: the numbers are in NAME.raw, x fastest.
VOLUMES = {"": ("volume.raw", (9, 8, 7), "int16"), "-flat": ("flat.raw", (9, 8, 1), "float32"),
           "-tiny": ("tiny.raw", (3, 3, 3), "uint8"), "-turned": ("turned.nhdr", None, None),
           "-named": ("tiny.raw", (3, 3, 3), "uint8"), "-framed": ("tiny.raw", (3, 3, 3), "uint8"),
           "-own": ("tiny.raw", (3, 3, 3), "uint8"), "-unshuffled": ("eight.raw", (9, 8, 7), "float32"),
           "-uneven": ("uneven.vtr", None, None), "-curved": ("curved.vts", None, None)}
# Label names of "-named", in the form of FORMAT.md, section 3.
NAMES = "0 background\n13 Übergang 255 0 10 255\n26 end 1 2 3\n900 nowhere\n"
# The same numbers as volume.raw, on axes that are not along the world's.
TURNED = """NRRD0004
type: int16
dimension: 3
space dimension: 3
sizes: 9 8 7
space directions: (0.6,0.8,0) (-1.6,1.2,0) (0,0,0.5)
endian: little
encoding: raw
data file: volume.raw
"""
# The same numbers as tiny.raw, at positions of their own.
CURVED = """<?xml version="1.0"?>
<VTKFile type="StructuredGrid" version="0.1" byte_order="LittleEndian">
<StructuredGrid WholeExtent="0 2 0 2 0 2"><Piece Extent="0 2 0 2 0 2">
<PointData><DataArray type="UInt8" Name="v" format="ascii">{}</DataArray></PointData>
<Points><DataArray type="Float32" NumberOfComponents="3" format="ascii">{}</DataArray></Points>
</Piece></StructuredGrid></VTKFile>
"""
# The same numbers as tiny.raw, on axes of which x is even.
UNEVEN = """<?xml version="1.0"?>
<VTKFile type="RectilinearGrid" version="0.1" byte_order="LittleEndian">
<RectilinearGrid WholeExtent="0 2 0 2 0 2"><Piece Extent="0 2 0 2 0 2">
<PointData><DataArray type="UInt8" Name="v" format="ascii">{}</DataArray></PointData>
<Coordinates><DataArray type="Float64" Name="x" format="ascii">0 2 4</DataArray>
<DataArray type="Float64" Name="y" format="ascii">-1 0 2</DataArray>
<DataArray type="Float64" Name="z" format="ascii">100 150 250</DataArray></Coordinates>
</Piece></RectilinearGrid></VTKFile>
"""
COVERED = ("version", "flags", "nodes", "spacing", "origin", "value_type", "chunk", "compression", "exact",
           "fields", "range", "has_missing")


def checksum(data):
    xxhash = ctypes.CDLL("libxxhash.so.0")
    xxhash.XXH64.restype = ctypes.c_uint64
    xxhash.XXH64.argtypes = [ctypes.c_char_p, ctypes.c_size_t, ctypes.c_uint64]
    return np.uint64(xxhash.XXH64(data, len(data), 0))


def make_volumes():
    z, y, x = np.mgrid[0:7, 0:8, 0:9]
    numbers = {"volume.raw": (40 * np.hypot(np.hypot(x - 4, y - 3), z - 3) + 7 * (x * y * z % 5)).astype("<i2"),
               "flat.raw": (np.sin(x[0]) * 10 + y[0] ** 2).astype("<f4"),
               "tiny.raw": np.arange(27, dtype=np.uint8),
               # Of 8 bits: some chunks are shorter without the shuffle.
               "eight.raw": (np.random.default_rng(8).integers(0, 50, (7, 8, 9)) / 255).astype("<f4")}
    numbers["flat.raw"][7, 8] = np.nan
    for name, values in numbers.items():
        if not (HERE / name).exists():
            values.tofile(HERE / name)
    if not (HERE / "own.npy").exists():
        np.save(HERE / "own.npy", numbers["tiny.raw"][::-1].reshape(3, 3, 3))
    if not (HERE / "uneven.vtr").exists():
        (HERE / "uneven.vtr").write_text(UNEVEN.format(" ".join(map(str, numbers["tiny.raw"]))))
    if not (HERE / "curved.vts").exists():
        (HERE / "curved.vts").write_text(CURVED.format(" ".join(map(str, numbers["tiny.raw"])), " ".join(
            f"{2 * x + y / 4} {y + x * z / 8} {z - x * y / 8}" for z in range(3) for y in range(3) for x in range(3))))
    if not (HERE / "turned.nhdr").exists():
        (HERE / "turned.nhdr").write_text(TURNED)


def make_good(version):
    help_text = subprocess.run([ISONEST, "preprocess", "--help"], capture_output=True, text=True).stdout
    for suffix, (volume, nodes, kind) in VOLUMES.items():
        store = HERE / f"{version}{suffix}.store"
        if suffix == "-tiny" and "--good-only" in sys.argv or store.exists():
            continue
        if suffix == "-named" and "--label-names" not in help_text:  # from 2.8 on
            continue
        command = [ISONEST, "preprocess", HERE / volume, "--chunk", "8", "-o", store]
        if nodes:
            command += ["--dims", ",".join(map(str, nodes)), "--type", kind, "--spacing", "1,2,0.5"]
        if "--unit" in help_text:  # from 2.7 on
            command += ["--unit", "um"]
        if suffix == "-framed" and "--frame" not in help_text:  # from 2.10 on
            continue
        if suffix == "-own" and "--own" not in help_text:  # from 2.12 on
            continue
        if suffix == "-unshuffled" and tuple(map(int, version.split("."))) < (2, 13):
            continue
        if suffix == "-uneven" and tuple(map(int, version.split("."))) < (2, 14):
            continue
        if suffix == "-curved" and tuple(map(int, version.split("."))) < (2, 15):
            continue
        if suffix == "-own":
            command += ["--own", f"size={HERE / 'own.npy'}"]
        if suffix == "-framed":
            command += ["--frame", "lps"]
        if suffix == "-named":
            (HERE / "names.txt").write_text(NAMES)
            command += ["--labels", "--label-names", HERE / "names.txt"]
        wanted = "linf_bar,linf_plus,deviation_bar,normal_turn_plus"
        if suffix == "-tiny" or subprocess.run([*command, "--indicators", wanted]).returncode != 0:
            subprocess.run(command, check=True)  # 1.0 has no other indicators
        # A store is written in the oldest version that has all that it holds: nothing new need be kept of it.
        same = [old.name for old in HERE.glob("*.store") if old != store and old.read_bytes() == store.read_bytes()]
        if same:
            store.unlink()
        print(store.name, f"is the same as {same[0]}" if same else "made")


def seal(f):
    """The checksum of the header as it is now."""
    f.attrs["xxh64"] = checksum(b"".join(np.asarray(f.attrs[name]).tobytes() for name in COVERED))


def set_version(f, major, minor):
    f.attrs.modify("version", np.array([major, minor], "<u4"))


def set_fields(f, names):
    f.attrs.create("fields", np.bytes_(names))


def replace_table(f, table):
    del f["chunks"]
    f.create_dataset("chunks", data=table)
    f["chunks"].attrs["xxh64"] = checksum(table.tobytes())


def add_field(f, name):
    """Adds a field that no version knows; its rows are copies of those of linf_bar."""
    fields = f.attrs["fields"]
    fields = (fields.decode() if isinstance(fields, bytes) else fields).split(",")
    old, rows = f["chunks"][...], []
    for level in range(len(f["levels"])):
        group = f[f"levels/{level}"]
        seen, counts = set(), {}  # fields may be links to one array
        for field in ["values", *(fields if level else [])]:
            array = group[field]
            chunks = counts[field] = int(np.prod([-(-s // c) for s, c in zip(array.shape[:3], array.chunks[:3])]))
            first = int(array.attrs["first_chunk_row"])
            place = h5py.h5o.get_info(array.id).addr
            if place in seen:
                continue
            seen.add(place)
            array.attrs.modify("first_chunk_row", np.uint64(len(rows)))
            rows += list(old[first:first + chunks])
        if level:
            f.copy(group[fields[0]], group, name)
            group[name].attrs.modify("first_chunk_row", np.uint64(len(rows)))
            first = int(group[fields[0]].attrs["first_chunk_row"])
            rows += rows[first:first + counts[fields[0]]]
    set_fields(f, ",".join([*fields, name]))
    return np.array(rows, old.dtype)


def newer_minor(f):
    """What a later 2.x may add: attributes, groups, fields, and rows that belong to no field."""
    table = add_field(f, "curl_bar")
    replace_table(f, np.concatenate([table, table[-1:]]))
    set_version(f, 2, 99)
    set_unit(f, "furlong")
    f.attrs["curl_of"] = np.bytes_("a later version")
    f.create_group("later").create_dataset("table", data=np.arange(5))
    seal(f)


def newer_minor_misplaced(f):
    set_version(f, 2, 99)
    set_fields(f, "curl_bar,linf_bar,linf_plus,deviation_bar")
    seal(f)


def unknown_field(f):
    set_fields(f, "linf_bar,linf_plus,deviation_bar,curl_bar")
    seal(f)


def flags(f):
    f.attrs.modify("flags", np.uint32(4))
    seal(f)


def version(major, minor):
    def change(f):
        set_version(f, major, minor)
        seal(f)
    return change


def wrong_digest(f):
    f.attrs.modify("spacing", np.array([1.0, 2.0, 0.25]))


def set_unit(f, symbol):
    """With its checksum."""
    f.attrs.create("unit", np.bytes_(symbol))
    f.attrs.modify("unit_xxh64", checksum(symbol.encode()))


def unit_unknown(f):
    set_unit(f, "furlong")


def unit_damaged(f):
    f.attrs.create("unit", np.bytes_("mm"))


def unit_alone(f):
    del f.attrs["unit_xxh64"]


def set_frame(f, name):
    """With its checksum."""
    f.attrs.create("frame", np.bytes_(name))
    f.attrs.modify("frame_xxh64", checksum(name.encode()))


def frame_unknown(f):
    set_frame(f, "LIA")


def frame_damaged(f):
    f.attrs.create("frame", np.bytes_("RAS"))


def set_names(f, rows):
    """With their checksum."""
    del f["label_names"]
    f.create_dataset("label_names", data=rows)
    f["label_names"].attrs["xxh64"] = checksum(rows.tobytes())


def names_damaged(f):
    rows = f["label_names"][...]
    rows["id"][1] += 1
    f["label_names"][...] = rows


def names_unordered(f):
    set_names(f, f["label_names"][...][::-1])


def names_no_text(f):
    rows = f["label_names"][...]
    rows["name"][0] = b"\xff"
    set_names(f, rows)


def table_too_short(f):
    replace_table(f, f["chunks"][...][:-1])


def table_too_long(f):
    table = f["chunks"][...]
    replace_table(f, np.concatenate([table, table[-1:]]))


def table_damaged(f):
    table = f["chunks"][...]
    table["offset"][0] += 1
    f["chunks"][...] = table


def incomplete(f):
    f.attrs.modify("complete", np.uint32(0))


def no_store(f):
    del f.attrs["format"]


BAD = {"newer-minor": newer_minor, "newer-minor-misplaced": newer_minor_misplaced, "newer-major": version(3, 0),
       "older-major": version(0, 9), "unknown-field": unknown_field, "flags": flags,
       "wrong-digest": wrong_digest, "table-too-short": table_too_short, "table-too-long": table_too_long,
       "unit-unknown": unit_unknown, "unit-damaged": unit_damaged, "unit-alone": unit_alone,
       "table-damaged": table_damaged, "incomplete": incomplete, "no-store": no_store}


# A store changed by an HDF5 program loses its footer, and is then like a store of 2.8. So these are not kept twice where
# nothing else differs.
SAME_SINCE_FOOTERS = {*BAD} - {"newer-minor", "newer-minor-misplaced"}


def records_of(data):
    """The records of the catalogue: tag, detail, content."""
    begin, size = struct.unpack_from("<2Q", data, len(data) - 64)
    catalogue, records = data[begin:begin + size], []
    while catalogue:
        tag, detail, size = struct.unpack_from("<IIQ", catalogue)
        records.append((tag, detail, catalogue[16:16 + size]))
        catalogue = catalogue[16 + -(-size // 8) * 8:]
    return records


def behind_hdf5(data, records):
    """HDF5's part of a file with a catalogue of these records, and a footer."""
    catalogue = b"".join(struct.pack("<IIQ", tag, detail, len(content)) + content + bytes(-len(content) % 8)
                         for tag, detail, content in records)
    begin = -(-len(data) // 8) * 8
    numbers = struct.pack("<5QII", begin, len(catalogue), int(checksum(catalogue)), len(data), begin + len(catalogue) + 64, 1, 64)
    return data.ljust(begin, b"\0") + catalogue + numbers + struct.pack("<Q", int(checksum(numbers))) + b"IsoNest\n"


def hdf5_part(data):
    return data[:struct.unpack_from("<Q", data, len(data) - 40)[0]]


def flipped(data, at):
    return data[:at] + bytes([data[at] ^ 1]) + data[at + 1:]


def later_catalogue(data):
    """The catalogue of a later 2.x: with new records, and records that have grown."""
    records = records_of(data)
    with tempfile.NamedTemporaryFile() as file:
        file.write(data)
        file.flush()
        with h5py.File(file.name, "r+", libver=("earliest", "v110")) as f:
            set_version(f, 2, 99)
            seal(f)
            sealed = {name: np.asarray(f.attrs[name]).tobytes() for name in ("version", "xxh64")}
        data = pathlib.Path(file.name).read_bytes()

    def newer(tag, detail, content):
        name = content[:32].rstrip(b"\0").decode() if tag == 1 else ""
        return tag, detail, content[:32] + sealed[name] if name in sealed else content + bytes(8 if tag in (2, 3) else 0)

    later = [(77, 3, b"later"), *(newer(*record) for record in records), (1, 9, b"curl_of".ljust(32, b"\0") + b"curl")]
    return behind_hdf5(data, later)


TAILS = {"footer-cut": hdf5_part,
         "footer-damaged": lambda data: flipped(data, len(data) - 48),
         "catalogue-damaged": lambda data: flipped(data, len(data) - 84),
         "catalogue-later": later_catalogue,
         "catalogue-lacks": lambda data: behind_hdf5(hdf5_part(data), [r for r in records_of(data) if r[0] != 2])}

BAD_FRAMES = {"frame-unknown": frame_unknown, "frame-damaged": frame_damaged}
BAD_NAMES = {"names-damaged": names_damaged, "names-unordered": names_unordered, "names-no-text": names_no_text}


def make_bad(current):
    with_footer = tuple(map(int, current.split("."))) >= (2, 9)
    for name, change in BAD_NAMES.items():
        store = HERE / f"{current}-{name}.store"
        if not store.exists() and not with_footer:
            shutil.copyfile(HERE / f"{current}-named.store", store)
            with h5py.File(store, "r+", libver=("earliest", "v110")) as f:
                change(f)
    for name, change in BAD_FRAMES.items():
        store, framed = HERE / f"{current}-{name}.store", HERE / f"{current}-framed.store"
        if framed.exists() and not store.exists():
            shutil.copyfile(framed, store)
            with h5py.File(store, "r+", libver=("earliest", "v110")) as f:
                change(f)
    if tuple(map(int, current.split("."))) > (2, 9):
        return  # everything else is as in 2.9
    good = HERE / f"{current}-tiny.store"
    if not good.exists():
        return  # the invalid stores of an older version are the same
    for name, change in BAD.items():
        store = HERE / f"{current}-{name}.store"
        if store.exists() or with_footer and name in SAME_SINCE_FOOTERS:
            continue
        # With several levels, so that rows of the new field lie between those of others.
        shutil.copyfile(HERE / f"{current}.store" if change is newer_minor else good, store)
        with h5py.File(store, "r+", libver=("earliest", "v110")) as f:
            change(f)
    with h5py.File(good) as f:
        first = int(f["chunks"]["offset"][0])
    for name, change in TAILS.items():
        if with_footer and not (HERE / f"{current}-{name}.store").exists():
            (HERE / f"{current}-{name}.store").write_bytes(change(good.read_bytes()))
    data = bytearray(good.read_bytes())
    cut = HERE / f"{current}-cut.store"
    if not cut.exists():
        cut.write_bytes(data[:len(data) * 3 // 4])
    data[first + 9] ^= 1
    damaged = HERE / f"{current}-damaged-chunk.store"
    if not damaged.exists():
        damaged.write_bytes(data)


make_volumes()
said = subprocess.run([ISONEST, "--version"], capture_output=True, text=True, check=True).stdout
written = re.search(r"store format ([\d.]+)", said)[1]
make_good(written)
if "--good-only" not in sys.argv:
    make_bad(written)
