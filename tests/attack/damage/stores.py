"""Damaged stores, meshes and label tables, for the commands that read them."""
import dataclasses
import json
import pathlib
import subprocess
import tempfile

import numpy as np

import attack
from damage import judge
from damage.arrays import values, zip_fields
from damage.case import FIFO, FOLDER, LINK, Case, damaged
from damage.images import xml_tricks

COMMANDS = {
    "info": ("info", "STORE"), "json": ("info", "STORE", "--json"), "histogram": ("info", "STORE", "--histogram"),
    "extract": ("extract", "STORE", "--iso", "100", "-o", "OUT.ply"), "error": ("extract", "STORE", "--iso", "100", "--error", "20", "-o", "OUT.ply"),
    "distance": ("extract", "STORE", "--iso", "100", "--distance", "0.5", "-o", "OUT.ply"), "slice": ("slice", "STORE", "--plane", "0,0,1,2", "-o", "OUT.ply"),
    "check": ("check", "STORE"), "deep": ("check", "STORE", "--deep"), "export": ("export", "STORE", "--field", "values", "-o", "OUT.npy"),
    "field": ("export", "STORE", "--field", "deviation_bar", "-o", "OUT.raw"), "publish": ("publish", "STORE", "-o", "OUT")}
PLAIN = ("check", "deep", "publish")  # they have no output to compare, or one that contains the store's bytes


def words(command, store, out):
    text = [word.replace("STORE", str(store)).replace("OUT", str(out)) for word in COMMANDS[command]]
    return [*text, *(("--memory", f"{judge.MEMORY}M") if command not in ("publish", "info", "json") else ()), *(() if "-o" not in text else ("-q",))]


def output_of(arguments, folder):
    return next((pathlib.Path(arguments[i + 1]) for i, word in enumerate(arguments) if word == "-o"), folder / "no output")


def good_store(program, variant):
    """The bytes of a store, and the output of each command on it."""
    r = np.random.default_rng(variant)
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        array = values(r, ("u1", "i2", "f4")) if variant % 3 else r.normal(100, 40, (17, 19, 21)).astype("f4")
        np.save(folder / "v.npy", array)
        subprocess.run([program, "preprocess", folder / "v.npy", "-o", folder / "s.isonest", "--chunk", "8", "-q", *(("--exact",) if variant % 2 else ())],
                       check=True)
        made = {}
        for command in COMMANDS:
            if command in PLAIN:
                continue
            arguments = words(command, folder / "s.isonest", folder / "o")
            done = subprocess.run([program, *arguments], capture_output=True, check=True, text=True)
            output = output_of(arguments, folder)
            made[command] = output.read_bytes() if output.exists() else done.stdout.replace(name, "")
        return (folder / "s.isonest").read_bytes(), made


def store_tricks(case, one):
    """Combines two stores, or puts the store's end before or after other bytes."""
    data = case.data
    what = int(one.random.integers(5))
    if what == 4:
        return dataclasses.replace(case, files={case.target: one.pick((LINK, "/dev/zero"), (FIFO,), (FOLDER,), (LINK, case.target), (LINK, "/proc/self/mem"),
                                                                      b"", data[:512] * 50, bytes(5000))})
    if what == 0:
        return case.with_data(data + one.random.bytes(one.pick(1, 64, 5000)))
    if what == 1:
        return case.with_data(data[:-64] + data[-64:] * 2)
    if what == 2:
        at = int(one.random.integers(len(data)))
        return case.with_data(data[:at] + data[-int(one.random.integers(64, 3000)):])
    at = int(one.random.integers(max(1, len(data) - 4096), len(data)))
    return case.with_data(data[:at] + bytes([int(one.random.integers(256))]) + data[at + 1:])


_stores, _meshes = {}, {}


def store(one):
    variant = int(one.random.integers(6))
    if variant not in _stores:
        _stores[variant] = good_store(one.program, variant)
    data, made = _stores[variant]
    end = len(data)
    fields = tuple((at, kind) for at in range(end - 64, end - 8, 4) for kind in ("<u4", "<u8"))
    case = damaged(Case("s.isonest", {"s.isonest": data}, fields=fields), one, (store_tricks,))
    path = judge.prepare(one, case)
    command = one.pick(*COMMANDS)
    arguments = words(command, path, one.folder / "out/o")
    output = output_of(arguments, one.folder)
    done, result = judge.watched(one, output, arguments, ["in/deep"], False)
    if done.code == "hang":
        return attack.wrong(f"{command}: no end within {judge.SECONDS} s")
    if command in ("check", "deep") and done.code == 4 and not done.err.startswith("isonest: error: "):
        return attack.refused("check finds what is wrong")
    if result is not None:
        return result
    if command not in PLAIN:
        found = output.read_bytes() if output.exists() else done.out.replace(str(one.folder / "in/deep"), "")
        if command in ("info", "json", "histogram"):
            if not found:
                return attack.wrong(f"{command}: nothing is said")
        elif found != made[command]:
            return attack.wrong(f"{command}: another result than of the whole store")
    return attack.SAME


# meshes for `isonest picture`


def good_mesh(program, ending):
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        subprocess.run([program, "make-volume", "sphere", "--size", "9", "--type", "uint8", "-o", folder / "v.h5", "-q"], check=True)
        subprocess.run([program, "preprocess", folder / "v.h5", "-o", folder / "s", "--chunk", "8", "-q"], check=True)
        subprocess.run([program, "extract", folder / "s", "--iso", "128", "-o", folder / f"m.{ending}", "-q",
                        *(("--normals",) if ending in ("ply", "vtp", "glb") else ())], check=True)
        return (folder / f"m.{ending}").read_bytes()


def special_files(case, one):
    return dataclasses.replace(case, files={case.target: one.pick((LINK, "/dev/zero"), (FIFO,), (FOLDER,), (LINK, case.target), b"")})


def mesh_of(endings, foreign):
    def attempt(one):
        ending = one.pick(*endings)
        if ending not in _meshes:
            _meshes[ending] = good_mesh(one.program, ending)
        data = _meshes[ending]
        header = data.find(b"end_header") if ending == "ply" else {"glb": 0, "3mf": 0, "stl": 0}.get(ending, len(data))
        fields = tuple((at, kind) for at in range(0, 64, 4) for kind in ("<u4", "<f4")) if ending in ("glb", "stl") else ()
        if ending == "3mf":
            fields = zip_fields(data)
        if ending == "glb":
            header = 20 + int.from_bytes(data[12:16], "little")
        if ending == "ply":
            fields = tuple((at, kind) for at in range(header + 11, len(data) - 4, 13) for kind in ("<u4", "<f4"))
        case = Case(f"m.{ending}", {f"m.{ending}": data}, fields=fields, texts=((0, header),) if header > 0 else ())
        case = damaged(case, one, (xml_tricks, special_files) if ending == "vtp" else (special_files,))
        path = judge.prepare(one, case)
        output = one.folder / "out/p.png"
        done, result = judge.watched(one, output, ("picture", path, "-o", output, "--size", "64x48", "--memory", "128M", "-q"), ["in/deep"], foreign,
                                     64 * judge.MIB)
        if done.code == "hang":
            return attack.refused("library crashed: hang") if foreign else attack.wrong("no end within 10 s")
        if result is not None:
            return result
        if case.cut and ending in ("stl", "3mf", "ply", "glb"):
            return attack.wrong("a mesh that was cut short was drawn")
        return attack.refused("not compared: a picture")
    return attempt


# label tables

TABLES = (
    "0 Unknown 0 0 0 0\n1 liver 221 130 101 255\n2 spleen 157 108 162 255\n4 left kidney 1 2 3 255\n",
    "#######\n# ITK-SnAP Label Description File\n#######\n    0     0    0    0        0  0  0    \"Clear Label\"\n    1   255    0    0        1  1  1    \"liver\"\n"
    "    2     0  255    0        1  1  1    \"spleen\"\n",
    "1 liver\n2 spleen\n7 a long name of words\n")


def labels(one):
    table = one.pick(*TABLES).encode()
    case = damaged(Case("t.txt", {"t.txt": table}, texts=((0, len(table)),) * 2), one, (label_tricks,))
    path = judge.prepare(one, case)
    volume = one.folder / "in/deep/v.npy"
    np.save(volume, np.random.default_rng(1).integers(0, 5, (4, 5, 6)).astype("u1"))
    output = one.folder / "out/s.isonest"
    done, result = judge.watched(one, output, ("preprocess", volume, "--labels", "--label-names", path, "--chunk", "8", "-o", output, *judge.LIMITS), ["in/deep"], False)
    if done.code == "hang":
        return attack.wrong("no end within 10 s")
    if result is not None:
        return result
    # What the store keeps: at most 255 bytes without control characters, each label once.
    again = judge.run(one, "info", output, "--json")
    if again.code != 0:
        return attack.wrong(f"info of the store: {again.code} {again.err}")
    names = [label.get("name") or "" for label in json.loads(again.out).get("label_names", [])]
    if any(len(name.encode()) > 255 or any(ord(letter) < 32 for letter in name) for name in names):
        return attack.wrong(f"kept names: {names}")
    return attack.refused("not compared: names that are kept")


def label_tricks(case, one):
    data = case.data
    if one.chance(0.1):
        return dataclasses.replace(case, files={case.target: one.pick((LINK, "/dev/zero"), (FIFO,), (FOLDER,), (LINK, case.target), (LINK, "/proc/self/mem"))})
    line = one.pick(b"3 " + b"n" * 256, b"3 " + b"n" * (1 << 20), b"3 a\x1b[2Jb", b"3 \xff\xfe", b"1 again", b"4611686018427387904 big", b"-1 minus", b"3 x 256 0 0 0",
                    b"3 x 1e999 nan inf 0", b"3", b"3 \"", b"3 \"x", b"\n".join(b"%d n%d" % (i, i) for i in range(10, 70000)), b"18446744073709551616 x",
                    b" " * (6 << 20), b"3 \xe2\x80\xae evil", b"3 a\rb", b"3 \0", b"0x3 hex", b"3.0 x", b"+3 x", b"\xef\xbb\xbf3 x")
    return case.with_data(one.pick(data + line + b"\n", line + b"\n" + data, line), texts=())
