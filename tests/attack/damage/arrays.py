"""NumPy files, raw numbers, and both in gzip: good files, damage specific to them, independent readers."""
import dataclasses
import gzip
import io
import pathlib
import re
import struct
import tempfile
import warnings
import zipfile

import numpy as np

from damage.case import LINK, FIFO, Case, bomb

warnings.filterwarnings("ignore")


def values(r, types=("u1", "i1", "u2", "i2", "u4", "i4", "f4", "f8"), axes=3):
    """Random values [z, y, x], with different lengths along the axes."""
    kind = np.dtype(str(r.choice(types)))
    shape = tuple(int(n) for n in r.permutation(np.arange(3, 9))[:axes])
    if kind.kind == "f":
        return r.normal(100, 50, size=shape).astype(kind)
    limits = np.iinfo(kind)
    return r.integers(max(limits.min, -2**40), min(limits.max, 2**40), shape, dtype=np.int64).astype(kind)


def saved(name, write):
    """The bytes that write(path) writes."""
    with tempfile.TemporaryDirectory() as folder:
        path = pathlib.Path(folder) / name
        write(path)
        return path.read_bytes()


def packed(case, level=1):
    """The case with its target compressed by gzip."""
    return case.with_data(gzip.compress(case.data, level, mtime=0), fields=(), texts=(), closing=None, exact=False)


def in_gzip(r, case, part=0.25):
    return packed(case) if r.random() < part else case


def gzip_tricks(case, one):
    """Appended members, decompression bombs, gzip in gzip, wrong trailers."""
    data = case.data if case.data[:2] == b"\x1f\x8b" else gzip.compress(case.data, 1, mtime=0)
    what = int(one.random.integers(7))
    if what == 0:
        data = gzip.compress(data, 1)
    elif what == 1:
        zeros = bomb(64 << 20)
        data = data[:-8] + gzip.compress(b"", 1) + b"\x1f\x8b\x08\0\0\0\0\0\0\x03" + zeros + struct.pack("<II", 0, 64 << 20)
    elif what == 2:
        data += b"\x1f\x8b\x08\0\0\0\0\0\0\x03" + bomb(200 << 20)
    elif what == 3:
        data = data[:-8] + one.random.bytes(8)
    elif what == 4:
        data = data[:3] + bytes([one.pick(2, 4, 8, 16, 31, 255)]) + data[4:10] + b"x" * one.pick(1, 70000) + data[10:]
    elif what == 5:
        data += gzip.compress(b"", 1) * one.pick(1, 1000)
    else:
        data += one.pick(b"\0" * 5000, b"\0\0\x1f", b"garbage", data)
    return case.with_data(data, fields=(), texts=(), closing=None, exact=False)


# NumPy

def npy_closing(data):
    """Updates the stored length of the header."""
    version, width = data[6], (2, "<H") if data[6] == 1 else (4, "<I")
    start = 8 + width[0]
    end = data.find(b"\n", start) + 1
    length = (end if end else len(data)) - start
    return data[:8] + struct.pack(width[1], min(length, 65535 if version == 1 else 1 << 31)) + data[start:]


def read_npy(path):
    data = path.read_bytes()
    if data[:2] == b"\x1f\x8b":
        data = gzip.decompress(data)
    return np.load(io.BytesIO(data), allow_pickle=False, max_header_size=1 << 20)


def npy(r):
    array = values(r, ("u1", "i1", "u2", ">u2", "i2", "u4", "<i4", ">i4", "f4", ">f4", "f8", ">f8", "i8", "f2"), int(r.integers(2, 4)))
    if r.random() < 0.4:
        array = np.asfortranarray(array)
    out = io.BytesIO()
    np.lib.format.write_array(out, array, version=[(1, 0), (2, 0), (3, 0)][int(r.integers(3))])
    data = out.getvalue()
    start = 10 if data[6] == 1 else 12
    case = Case("v.npy", {"v.npy": data}, fields=((8, "<u2" if data[6] == 1 else "<u4"), (6, "u1"), (7, "u1")),
                texts=((start, data.index(b"\n") + 1),), exact=True, read=read_npy, values=array, closing=npy_closing)
    return in_gzip(r, case)


def npy_tricks(case, one):
    if case.data[:2] == b"\x1f\x8b":
        return gzip_tricks(case, one)
    header = one.pick(
        b"{'descr': '<f4', 'fortran_order': False, 'shape': " + b"(" * 30000 + b"3" + b")" * 30000 + b"}",
        b"{'descr': '<f4', 'fortran_order': False, 'shape': (" + b"1," * 20000 + b")}",
        b"{'descr': '<f4', 'fortran_order': False, 'shape': (3,4,5), 'shape': (5,4,3)}",
        b"{'descr': '|O', 'fortran_order': False, 'shape': (3,4,5)}",
        b"{'descr': [('a', '<f4'), ('b', '<i2')], 'fortran_order': False, 'shape': (3,4,5)}",
        b"{'descr': '<f4', 'fortran_order': False, 'shape': (3,4,0)}",
        b"{'descr': '<f4', 'fortran_order': False, 'shape': ()}",
        b"{'descr': '<f4', 'fortran_order': False, 'shape': (60,)}",
        b"{'descr': '<f4', 'fortran_order': False, 'shape': (3L,4L,5L)}",
        b"{'descr': '<f4', 'fortran_order': False, 'shape': (4294967296,4294967296,4)}",
        b"{'descr': '<f4', 'fortran_order': False, 'shape': (1048576,1048576,1048576)}",
        b"{'descr': '<f4', 'fortran_order': 1, 'shape': (3,4,5)}",
        b"{\"descr\": \"<f4\", \"fortran_order\": False, \"shape\": [3,4,5]}",
        b"{'descr': u'<f4', 'fortran_order': False, 'shape': (3,4,5), }" + b" " * 60000,
        b"{'descr': '<f4', 'fortran_order': __import__('os').system('touch /tmp/x'), 'shape': (3,4,5)}",
        b"{" * 60000, b"'" * 60000, b"\\" * 60000) + b"\n"
    big = one.chance(0.5)
    data = b"\x93NUMPY" + (b"\2\0" + struct.pack("<I", len(header)) if big or len(header) > 65535 else b"\1\0" + struct.pack("<H", len(header)))
    return case.with_data(data + header + np.arange(60, dtype="<f4").tobytes(), fields=(), texts=())


def read_npz(path):
    with np.load(path, allow_pickle=False) as archive:
        return archive[archive.files[0]]


def zip_fields(data):
    """Changes numbers in a ZIP archive's headers."""
    fields = []
    for magic, places in ((b"PK\3\4", ((4, "<u2"), (6, "<u2"), (8, "<u2"), (14, "<u4"), (18, "<u4"), (22, "<u4"), (26, "<u2"), (28, "<u2"))),
                          (b"PK\1\2", ((8, "<u2"), (10, "<u2"), (16, "<u4"), (20, "<u4"), (24, "<u4"), (28, "<u2"), (30, "<u2"), (32, "<u2"),
                                       (42, "<u4"))),
                          (b"PK\5\6", ((4, "<u2"), (8, "<u2"), (10, "<u2"), (12, "<u4"), (16, "<u4"), (20, "<u2")))):
        for found in re.finditer(re.escape(magic), data):
            fields += [(found.start() + at, kind) for at, kind in places]
    return tuple(fields)


def npz(r):
    array = values(r)
    out = io.BytesIO()
    (np.savez_compressed if r.random() < 0.5 else np.savez)(out, v=array)
    data = out.getvalue()
    return Case("v.npz", {"v.npz": data}, options=("--dataset", "v") if r.random() < 0.3 else (), fields=zip_fields(data), read=read_npz,
                values=array)


def npz_tricks(case, one):
    array = np.arange(60, dtype="f4").reshape(3, 4, 5)
    member = saved("v.npy", lambda path: np.save(path, array))
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", one.pick(zipfile.ZIP_DEFLATED, zipfile.ZIP_STORED)) as archive, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        what = int(one.random.integers(8))
        if what == 0:
            for name in ("../../../outside/evil.npy", "/tmp/evil.npy", "..\\evil.npy", "v.npy")[one.pick(0, 0, 1, 3):]:
                archive.writestr(name, member)
        elif what == 1:
            with archive.open("v.npy", "w") as file:
                file.write(member)
                file.write(bytes(16 << 20))
        elif what == 2:
            archive.writestr("v.npy", member)
            archive.writestr("v.npy", member[:-4] + b"abcd")
        elif what == 3:
            for i in range(one.pick(3000, 9000)):
                archive.writestr(f"{i}.npy", member[:130])
        elif what == 4:
            archive.writestr("v.npy", member)
            archive.comment = one.pick(b"PK\5\6" * 1000, b"PK\5\6" + bytes(18), b"x" * 65535)
        elif what == 5:
            archive.writestr("v" * 65000 + ".npy", member)
        elif what == 6:
            archive.writestr("v.npy", gzip.compress(member))
        else:
            info = zipfile.ZipInfo("v.npy")
            info.extra = one.random.bytes(one.pick(1, 3, 4, 20, 60000))
            archive.writestr(info, member)
    data = out.getvalue()
    if one.chance(0.3):  # the directory has another size
        data = data.replace(struct.pack("<I", len(member)), struct.pack("<I", one.pick(0xFFFFFFFF, 0, 1, len(member) * 1000)))
    return case.with_data(data, fields=())


# raw numbers

def raw(r):
    array = values(r, ("u1", "i2", ">u2", "f4", ">f8"))
    name = array.dtype.str.replace("|", "")
    options = ["--dims", ",".join(map(str, array.shape[::-1])), "--type", name.replace("<", "")]
    skip = int(r.integers(5))
    options += ["--offset", str(skip)] if skip else []
    body = b"y" * skip + array.tobytes()
    case = Case("v.raw", {"v.raw": body}, options=tuple(options), exact=True, values=array)

    def read(path):
        data = path.read_bytes()
        data = gzip.decompress(data) if data[:2] == b"\x1f\x8b" else data
        if len(data) != len(body):
            raise ValueError
        return np.frombuffer(data, array.dtype, offset=skip).reshape(array.shape)
    case.read = read
    return in_gzip(r, case, 0.6)


def raw_tricks(case, one):
    what = int(one.random.integers(4))
    if what == 0:
        return dataclasses.replace(case, options=("--dims", one.pick("0,3,3", "-1,2,2", "1e999,2,2", "99999999999999999999,1,1", "1048576,1048576,1048576",
                                                                    "3,3,3,3", "3", "nan,3,3", "2147483648,2,2", "1" * 5000), "--type", one.pick("u1", "f8")), exact=False,
                                   read=None)
    if what == 1:
        return dataclasses.replace(case, files={"v.raw": one.pick((LINK, "/dev/zero"), (FIFO,), (LINK, "v.raw"), (LINK, "/etc/passwd"), b"")})
    return gzip_tricks(case, one)
