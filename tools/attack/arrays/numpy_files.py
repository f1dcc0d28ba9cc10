"""Files of NumPy in all versions of their format, archives of them, and raw numbers. The judge is numpy."""
import gzip
import io
import struct
import zipfile

import numpy as np

import attack
from arrays.expect import TYPES, check, numbers

MAGIC = b"\x93NUMPY"


def shape_of(one, least=0, most=5):
    """Three axes of more than one position at most, others of one."""
    count = int(one.random.integers(least, most + 1))
    shape = [int(one.random.integers(1, one.pick(3, 9, 21))) for _ in range(count)]
    while sum(n > 1 for n in shape) > 3:
        shape[one.random.integers(count)] = 1
    return tuple(shape)


def squeezed(data):
    """As a volume: axes of one position go, if there are more than three."""
    return data if data.ndim <= 3 else data.reshape([n for n in data.shape if n > 1])


def literal(one, value):
    """A header's text: any Python literal of the dictionary."""
    def quote(text):
        mark = one.pick("'", '"') if odd else "'"
        return mark + text + mark
    odd = one.chance(0.3)
    blank = (lambda: one.pick("", " ", "  ", "\n" if inside[0] else " ")) if odd else (lambda: "")
    inside = [False]
    suffix = "L" if odd and value["python2"] else ""
    numbers_of_shape = [f"{blank()}{n}{suffix}{blank()}" for n in value["shape"]]
    shape = "(" + ",".join(numbers_of_shape) + ("," if len(numbers_of_shape) == 1 or odd and numbers_of_shape and one.chance(0.5) else "") + ")"
    parts = {"descr": quote(value["descr"]), "fortran_order": str(value["fortran"]), "shape": shape}
    keys = list(parts)
    if odd:
        one.random.shuffle(keys)
    text = "{" + ",".join(f"{blank()}{quote(k)}{blank()}:{' ' if not odd else blank()}{parts[k]}{blank()}" for k in keys)
    return text + one.pick(", }", "}", ",}")


def own_npy(one, data, version):
    """By the description of the format, with a header that numpy's own writer would not make."""
    fortran = data.ndim > 0 and bool(one.chance(0.5))
    text = literal(one, {"descr": data.dtype.str, "fortran": fortran, "shape": data.shape,
                         "python2": version < 3}).encode("utf8" if version == 3 else "latin1")
    size = 10 if version == 1 else 12
    pad = -(size + len(text) + 1) % one.pick(16, 64) + one.pick(0, 0, 64, 4096)
    text += b" " * pad + b"\n"
    head = MAGIC + bytes([version, 0]) + (struct.pack("<H", len(text)) if version == 1 else struct.pack("<I", len(text)))
    return head + text + data.tobytes("F" if fortran else "C"), fortran


def bytes_of(one, data):
    """A file, and whether it is in Fortran's order."""
    version = one.pick(1, 2, 3)
    if one.chance(0.5):
        return own_npy(one, data, version)
    out = io.BytesIO()
    order = one.pick("C", "F")
    data = np.asarray(data, order=order)
    np.lib.format.write_array(out, data, version=(version, 0))
    return out.getvalue(), not data.flags.c_contiguous and data.flags.f_contiguous


def judged(blob, data):
    """What numpy reads."""
    found = np.load(io.BytesIO(blob))
    np.testing.assert_array_equal(found, data)
    return found


def is_in_another_order(data, fortran):
    return fortran and sum(n > 1 for n in data.shape) > 1


def odd_type(one):
    """A type that cannot be read, and the words of the refusal."""
    shape = shape_of(one, 1, 3)
    kind = one.pick("c8", "c16", "S5", "U3", "M8[s]", "m8[ns]", "V4", "f16", [("a", "<i2"), ("b", "<f4")])
    return np.zeros(shape, kind), "records of several fields" if isinstance(kind, list) else "numbers of type"


def array_and_index(one):
    """An array of up to five axes, what is chosen of it, and what it is then."""
    kind = one.pick(*TYPES, "b1")
    order = one.pick("<", ">")
    if one.chance(0.75):
        data = numbers(one, shape_of(one), kind).astype(np.dtype(kind).newbyteorder(order))
        return data, None, squeezed(data), None
    data = numbers(one, tuple(int(n) for n in one.random.integers(2, 6, one.pick(4, 5))), kind)
    data = data.astype(np.dtype(kind).newbyteorder(order))
    if one.chance(0.2):
        return data, None, None, "axes: volumes of one scalar"
    keep = sorted(one.random.permutation(data.ndim)[:one.pick(1, 2, 3)])
    index = tuple(None if a in keep else int(one.random.integers(-n, n)) for a, n in enumerate(data.shape))
    return data, index, data[tuple(slice(None) if i is None else i for i in index)], None


def placed(one, axes):
    """Options with spacing and origin, and what they are in the volume."""
    if axes != 3 or one.chance(0.6):
        return {}, {}
    place = {"spacing": tuple(float(s) for s in one.random.uniform(0.1, 9, 3)),
             "origin": tuple(float(o) for o in one.random.normal(size=3) * 100)}
    return place, place


def npy(one):
    if one.chance(0.05):
        data, refused = odd_type(one)
        np.save(one.folder / "a.npy", data)
        return check(one, one.folder / "a.npy", data, refused=refused)
    data, index, chosen, refused = array_and_index(one)
    blob, fortran = bytes_of(one, data)
    judged(blob, data)
    name = one.pick("a.npy", "a", "a b.tif", "\u00e4.raw")
    if one.chance(0.2):
        blob = gzip.compress(blob, one.pick(0, 1, 9))
        if fortran and sum(n > 1 for n in data.shape) > 1:
            refused = refused or "may: order"
        elif index is not None:
            refused = refused or "may: order"
    path = one.folder / name
    path.write_bytes(blob)
    options, place = placed(one, chosen.ndim if index is None and chosen is not None else 0)
    return check(one, path, chosen, {"index": index, **options}, refused=refused, **place)


def npz(one):
    arrays, orders = {}, {}
    path = one.folder / one.pick("a.npz", "a.zip", "a")
    method = one.pick(zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
    count = one.pick(1, 1, 2, 3, 5)
    names = one.pick(["arr_0", "arr_1", "arr_2", "arr_3", "arr_4"], ["x", "a/b", "a b", "\u00e4\u6f22", "x.y"],
                     ["volume", "volume2", "Volume", "v", "vol"])[:count]
    data, index, chosen, refused = array_and_index(one)
    at = int(one.random.integers(count))
    with open(path, "wb") as raw:
        # A file that cannot be sought in gets descriptors behind its members.
        out = Unseekable(raw) if one.chance(0.3) else raw
        with zipfile.ZipFile(out, "w", method, allowZip64=True) as archive:
            for i, name in enumerate(names):
                arrays[name] = data if i == at else numbers(one, shape_of(one, 1, 3), one.pick(*TYPES))
                blob, orders[name] = bytes_of(one, arrays[name])
                with archive.open(zipfile.ZipInfo(name + ".npy") if one.chance(0.5) else name + ".npy", "w",
                                  force_zip64=bool(one.chance(0.3))) as member:
                    member.write(blob)
            if one.chance(0.1):
                archive.writestr("readme.txt", "not an array")
            archive.comment = one.pick(b"", b"", b"a comment")
    loaded = np.load(path)
    np.testing.assert_array_equal(loaded[names[at]], data)
    with zipfile.ZipFile(path) as archive:
        packed = archive.getinfo(names[at] + ".npy").compress_type == zipfile.ZIP_DEFLATED
    if packed and (index is not None or orders[names[at]] and sum(n > 1 for n in data.shape) > 1):
        refused = refused or "may: order"
    options = {"index": index, **({"dataset": names[at]} if count > 1 or one.chance(0.3) else {})}
    if count > 1 and one.chance(0.05):
        del options["dataset"]
        refused = "there are several arrays"
    more, place = placed(one, chosen.ndim if index is None and chosen is not None else 0)
    return check(one, path, chosen, {**options, **more}, refused=refused, **place)


class Unseekable(io.RawIOBase):
    def __init__(self, file):
        self.file = file

    def writable(self):
        return True

    def write(self, data):
        return self.file.write(data)

    def flush(self):
        if not self.file.closed:
            self.file.flush()


def raw(one):
    kind = one.pick(*TYPES)
    order = one.pick("<", ">")
    data = numbers(one, tuple(int(n) for n in one.random.integers(1, one.pick(4, 20), one.pick(3, 3, 2))), kind)
    data = data.astype(np.dtype(kind).newbyteorder(order))
    front = one.random.integers(0, 256, one.pick(0, 0, 1, 7, 512, 1000), dtype="u1").tobytes()
    # What a format would be recognised by, in front of the numbers, is another door.
    front = front.replace(b"\x1f\x8b", b"--")
    blob = front + data.tobytes()
    refused = "type" if kind in ("u8", "i8", "f2") else None
    if not front and blob[:2] == b"\x1f\x8b":
        refused = "may: gzip"
    wrong_size = one.chance(0.05)
    if wrong_size:
        blob = blob + b"x" if one.chance(0.5) else blob[:-1]
        refused = refused or "bytes"
    if one.chance(0.3):
        blob = gzip.compress(blob, one.pick(0, 1, 9))
        if one.chance(0.2) and not wrong_size:
            whole = gzip.decompress(blob)
            cut = int(one.random.integers(len(whole) + 1))
            blob = gzip.compress(whole[:cut]) + gzip.compress(whole[cut:]) + b"\0" * one.pick(0, 512)
    if not blob and refused == "bytes":
        refused = "empty"
    path = one.folder / one.pick("a.raw", "a.bin", "a", "a.npy")
    path.write_bytes(blob)
    options, place = placed(one, data.ndim)
    return check(one, path, data, {"shape": data.shape, "dtype": data.dtype, "offset": len(front) or None, **options},
                 refused=refused, **place)
