"""NumPy's files, NIfTI, MRC, NRRD, MetaImage and raw numbers: good ones, damages of their own, independent readers."""
import dataclasses
import gzip
import io
import os
import pathlib
import re
import subprocess
import struct
import tempfile
import warnings
import zipfile
import zlib

import mrcfile
import nibabel
import numpy as np

from damage.case import LINK, FIFO, Case, astray, bomb

warnings.filterwarnings("ignore")


def values(r, types=("u1", "i1", "u2", "i2", "u4", "i4", "f4", "f8"), axes=3):
    """Random values [z, y, x] of different lengths along the axes."""
    kind = np.dtype(str(r.choice(types)))
    shape = tuple(int(n) for n in r.permutation(np.arange(3, 9))[:axes])
    if kind.kind == "f":
        return r.normal(100, 50, size=shape).astype(kind)
    limits = np.iinfo(kind)
    return r.integers(max(limits.min, -2**40), min(limits.max, 2**40), shape, dtype=np.int64).astype(kind)


def saved(name, write):
    """The bytes that write(path) leaves."""
    with tempfile.TemporaryDirectory() as folder:
        path = pathlib.Path(folder) / name
        write(path)
        return path.read_bytes()


def packed(case, level=1):
    """The case with its target in gzip."""
    return case.with_data(gzip.compress(case.data, level, mtime=0), fields=(), texts=(), closing=None, exact=False)


def in_gzip(r, case, part=0.25):
    return packed(case) if r.random() < part else case


def gzip_tricks(case, one):
    """Members behind, bombs, gzip in gzip, wrong trailers."""
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
    """The length of the header as it is now."""
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
    """Numbers of a ZIP archive's headers."""
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
    if one.chance(0.3):  # the directory says another size
        data = data.replace(struct.pack("<I", len(member)), struct.pack("<I", one.pick(0xFFFFFFFF, 0, 1, len(member) * 1000)))
    return case.with_data(data, fields=())


# NIfTI

def nifti_fields(header):
    order = header.endianness
    fields = []
    for name, (kind, at, *_) in header.structarr.dtype.fields.items():
        base = kind.base
        if base.kind in "iuf":
            times = 4 if name in ("dim", "vox_offset", "sizeof_hdr", "datatype", "bitpix", "magic") else 1
            fields += [(at + i * base.itemsize, base.newbyteorder(order).str) for i in range(kind.itemsize // base.itemsize)] * times
    return tuple(fields)


def read_nifti(path):
    image = path.with_name("v.img")  # in gzip it is so by its first bytes, for nibabel by its name
    if path.suffix == ".hdr" and image.is_file() and image.read_bytes()[:2] == b"\x1f\x8b":
        image.write_bytes(gzip.decompress(image.read_bytes()))
    data = np.asarray(nibabel.load(path).dataobj)
    return data.reshape(data.shape[:3]).T if data.ndim > 3 and data.size == np.prod(data.shape[:3]) else data.T


def nifti(r):
    second = r.random() < 0.4
    array = values(r)
    maker = nibabel.Nifti2Image if second else nibabel.Nifti1Image
    header = maker.header_class(endianness=">" if r.random() < 0.3 else "<")
    header.set_data_dtype(array.dtype.newbyteorder(header.endianness))
    affine = np.diag([*r.choice([-1., 1, 2, 0.5], 3), 1])
    image = maker(array.T, affine, header)
    scaled = r.random() < 0.2
    if scaled:
        image.header.set_slope_inter(0.5, 3)
    if r.random() < 0.2:
        image.header.extensions.append(nibabel.nifti1.Nifti1Extension("comment", b"a text" * 5))
    if not second and r.random() < 0.25:
        with tempfile.TemporaryDirectory() as folder:
            nibabel.save(nibabel.Nifti1Pair(array.T, affine, image.header), pathlib.Path(folder) / "v.img")
            files = {name: (pathlib.Path(folder) / name).read_bytes() for name in ("v.hdr", "v.img")}
        target = str(r.choice(["v.hdr", "v.hdr", "v.img"]))
        return Case("v.hdr", files, target=target, fields=nifti_fields(image.header) if target == "v.hdr" else (),
                    exact=target == "v.img", read=read_nifti, values=array, close=True)
    name = "v.nii.gz" if r.random() < 0.25 else "v.nii"
    data = saved("v.nii", lambda path: nibabel.save(image, path))
    case = Case("v.nii", {"v.nii": data}, fields=nifti_fields(image.header), exact=True, read=read_nifti, values=np.asarray(image.dataobj).T,
                close=True)
    if name.endswith("gz"):
        case = packed(case)
        case = dataclasses.replace(case, name=name, target=name, files={name: case.data})
    return case


def nifti_tricks(case, one):
    if len(case.files) > 1:
        what = int(one.random.integers(5))
        if what == 0:
            return case.with_files({"v.img": (LINK, one.pick("/dev/zero", "v.img", "../../outside/secret.raw", "/etc/passwd", "."))}, target="v.hdr")
        if what == 1:
            return case.with_files({"v.img": (FIFO,)}, target="v.hdr")
        if what == 2:
            return dataclasses.replace(case, files={"v.hdr": case.files["v.hdr"]}, target="v.hdr")
        if what == 3:
            return case.with_files({"v.hdr": (FIFO,)}, name="v.img", target="v.img")
        return case.with_files({"v.img": gzip.compress(case.files["v.img"])}, exact=False)
    if case.data[:2] == b"\x1f\x8b":
        return gzip_tricks(case, one)
    # An extension with a size that leads elsewhere, or with labels' names that expand.
    laughs = b'<?xml version="1.0"?><!DOCTYPE a [<!ENTITY a0 "ha">' + b"".join(
        b'<!ENTITY a%d "%s">' % (i, b"&a%d;" % (i - 1) * 10) for i in range(1, 12)) + b"]><CaretExtension>&a11;</CaretExtension>"
    deep = b"<a>" * 20000
    content = one.pick(laughs, deep, b"<CaretExtension><VolumeInformation Index='0'><LabelTable>" +
                       b"<Label Key='1' Red='1e999'>x</Label>" * 20000 + b"</LabelTable></VolumeInformation></CaretExtension>")
    second = case.data[:4] in (b"\x1c\x02\0\0", b"\0\0\x02\x1c")
    big = case.data[0] == 0
    order = ">" if big else "<"
    start = 540 if second else 348
    content += b" " * (-(len(content) + 8) % 16)
    size = one.pick(len(content) + 8, len(content) + 8, 0, 8, -16, 1 << 30, 7, 0x7FFFFFF0)
    extension = b"\1\0\0\0" + struct.pack(order + "ii", size, one.pick(30, 30, 0, 4)) + content
    data = bytearray(case.data)
    offset = start + len(extension)
    if second:
        struct.pack_into(order + "q", data, 168, offset)
        body = 544
    else:
        struct.pack_into(order + "f", data, 108, offset)
        body = 352
    data = bytes(data[:start]) + extension + bytes(data[body:])
    return case.with_data(data, fields=(), options=("--labels",), read=None, values=None, exact=False)


# MRC

def read_mrc(path):
    opener = mrcfile.open
    with opener(path, "r", permissive=False) as file:
        return np.array(file.data)


def mrc(r):
    array = values(r, ("i1", "i2", "u2", "f4"))

    def write(path):
        with mrcfile.new(path) as file:
            file.set_data(array)
            file.voxel_size = (1.5, 2, 2.5)
    data = saved("v.mrc", write)
    fields = []
    for kind, at, *_ in mrcfile.dtypes.HEADER_DTYPE.fields.values():
        base = kind.base
        if base.kind in "iuf":
            fields += [(at + i * base.itemsize, base.str.replace("=", "<").replace("|", "")) for i in range(kind.itemsize // base.itemsize)]
        elif base.names:
            fields += [(at + i * 4, base[0].str.replace("=", "<").replace("|", "")) for i in range(len(base.names))]
    fields = [(at, kind) for at, kind in fields if at + np.dtype(kind).itemsize <= 1024 and not 100 <= at < 196]
    case = Case("v.mrc", {"v.mrc": data}, fields=tuple(fields), exact=True, read=read_mrc, values=array)
    return in_gzip(r, case, 0.15)


def mrc_tricks(case, one):
    return gzip_tricks(case, one) if case.data[:2] == b"\x1f\x8b" or one.chance(0.3) else case.with_data(
        case.data[:92] + struct.pack("<i", one.pick(-1024, -1, 1 << 30, 80, 0x7FFFFFFF)) + case.data[96:1024] + bytes(one.pick(0, 80)) + case.data[1024:])


# NRRD

def read_nrrd(path):
    """teem, as raw numbers after the header that it writes."""
    out = path.parent.parent / "teem.nrrd"
    subprocess.run(["teem-unu", "save", "-f", "nrrd", "-e", "raw", "-i", path.name, "-o", out], cwd=path.parent, check=True, timeout=10,
                   capture_output=True, stdin=subprocess.DEVNULL)
    data = out.read_bytes()
    end = data.index(b"\n\n")
    header = dict(line.split(b": ", 1) for line in data[:end].split(b"\n") if b": " in line and not line.startswith(b"#"))
    kinds = {b"unsigned char": "u1", b"signed char": "i1", b"unsigned short": "u2", b"short": "i2", b"unsigned int": "u4", b"int": "i4",
             b"float": "f4", b"double": "f8", b"long long int": "i8", b"unsigned long long int": "u8", b"uint8": "u1", b"int8": "i1",
             b"uint16": "u2", b"int16": "i2", b"uint32": "u4", b"int32": "i4", b"int64": "i8", b"uint64": "u8"}
    kind = np.dtype(kinds[header[b"type"]]).newbyteorder(">" if header.get(b"endian") == b"big" else "<")
    return np.frombuffer(data, kind, offset=end + 2).reshape([int(n) for n in header[b"sizes"].split()][::-1])


def nrrd(r):
    array = values(r)
    big, way = r.random() < 0.3, str(r.choice(["raw", "raw", "gzip"]))
    names = {"u1": "uchar", "i1": "int8", "u2": "unsigned short", "i2": "short", "u4": "uint", "i4": "int", "f4": "float", "f8": "double"}
    kind = array.dtype.str[1:]
    header = f"NRRD000{int(r.integers(1, 6))}\n# a comment\ntype: {names[kind]}\ndimension: 3\nsizes: {' '.join(map(str, array.shape[::-1]))}\n"
    header += str(r.choice(["spacings: 1 1.5 2\n", "space dimension: 3\nspace directions: (1,0,0) (0,2,0) (0,0,3)\nspace origin: (1,2,3)\n",
                            "axis mins: 0 1 2\naxis maxs: 5 6 7\n", "kinds: domain domain domain\nlabels: \"x\" \"y\" \"z\"\n", ""]))
    header += f"endian: {'big' if big else 'little'}\nencoding: {way}\n" + str(r.choice(["", "", "key:=value\n", "content: something\n"]))
    body = array.astype(array.dtype.newbyteorder(">" if big else "<")).tobytes()
    skip = int(r.integers(3)) if way == "raw" else 0
    if skip:
        header += f"byte skip: {skip}\n"
    body = b"x" * skip + (gzip.compress(body, mtime=0) if way == "gzip" else body)
    if r.random() < 0.25:
        header = header.encode() + b"data file: v.raw\n"
        target = str(r.choice(["v.nhdr", "v.nhdr", "v.nhdr", "v.raw"]))
        return Case("v.nhdr", {"v.nhdr": header, "v.raw": body}, target=target, texts=((0, len(header)),) if target == "v.nhdr" else (),
                    exact=target == "v.raw", read=read_nrrd, values=array)
    header = header.encode() + b"\n"
    return Case("v.nrrd", {"v.nrrd": header + body}, texts=((0, len(header)),), exact=True, read=read_nrrd, values=array)


def nrrd_tricks(case, one):
    if len(case.files) > 1:
        case = dataclasses.replace(case, target="v.nhdr", texts=(), exact=False)
        more, place = astray(case, one)
        return more.with_data(case.data.replace(b"data file: v.raw", b"data file: " + place.encode() + one.pick(b"", b"\nbyte skip: -1")))
    start = case.data.index(b"\n\n")
    line = one.pick(b"a:=" + b"b" * one.pick(70000, 6 << 20), b"k:=v\n" * 30000 + b"k:=v", b"sizes: " + b"1 " * 100000 + b"3", b"data file: LIST\nv.nrrd\n" * 3 + b"x",
                    b"data file: v%05d.raw 1 1000000000 1", b"# " + b"c" * (1 << 20), b"byte skip: 9223372036854775807", b"byte skip: -1",
                    b"line skip: 9223372036854775807", b"byte skip: -9223372036854775808", b"line skip: 5\nbyte skip: 7", b"encoding: ascii", b"encoding: hex",
                    b"encoding: bzip2", b"encoding: gz", b"space directions: " + b"(" * 100000, b"measurement frame: (1,0,0) (0,1,0) (0,0,1e999)",
                    b"Segment0_Name:=" + b"n" * 70000 + b"\nSegment0_LabelValue:=99999999999999999999\nSegment0_Color:=nan inf -1")
    return case.with_data(case.data[:start + 1] + line + case.data[start:], texts=(), options=one.pick((), ("--labels",)), exact=False, values=None)


# MetaImage

META = {"u1": "MET_UCHAR", "i1": "MET_CHAR", "u2": "MET_USHORT", "i2": "MET_SHORT", "u4": "MET_UINT", "i4": "MET_INT", "f4": "MET_FLOAT",
        "f8": "MET_DOUBLE"}


def meta_image(r):
    array = values(r)
    big, deflated = r.random() < 0.3, r.random() < 0.3
    body = array.astype(array.dtype.newbyteorder(">" if big else "<")).tobytes()
    body = zlib.compress(body) if deflated else body
    lines = ["ObjectType = Image", "NDims = 3", f"DimSize = {' '.join(map(str, array.shape[::-1]))}", f"ElementType = {META[array.dtype.str[1:]]}",
             f"ElementByteOrderMSB = {big}", "ElementSpacing = 1 2 3", "Offset = 0 -5 1e2", "TransformMatrix = -1 0 0 0 1 0 0 0 1"]
    lines += ["CompressedData = True", f"CompressedDataSize = {len(body)}"] if deflated else []
    lines += [str(r.choice(["HeaderSize = 0", "BinaryData = True", "AnatomicalOrientation = RAI"]))]
    head = "\n".join(lines).encode() + b"\nElementDataFile = "
    if r.random() < 0.3:
        head += b"v.raw\n"
        target = str(r.choice(["v.mhd", "v.mhd", "v.raw"]))
        return Case("v.mhd", {"v.mhd": head, "v.raw": body}, target=target, texts=((0, len(head)),) if target == "v.mhd" else (),
                    exact=target == "v.raw" and not deflated, values=array)
    head += b"LOCAL\n"
    return Case("v.mha", {"v.mha": head + body}, texts=((0, len(head)),), exact=not deflated, values=array)


def meta_tricks(case, one):
    if len(case.files) > 1:
        case = dataclasses.replace(case, target="v.mhd", texts=(), exact=False)
        more, place = astray(case, one)
        return more.with_data(case.data.replace(b"ElementDataFile = v.raw", one.pick(b"", b"HeaderSize = -1\n") + b"ElementDataFile = " + place.encode()))
    line = one.pick(b"Comment = " + b"c" * one.pick(70000, 6 << 20), b"DimSize = " + b"1 " * 100000 + b"3", b"NDims = 2000000000", b"NDims = -1",
                    b"HeaderSize = -1", b"HeaderSize = -9223372036854775808", b"HeaderSize = 9223372036854775807", b"ElementNumberOfChannels = 1000000000",
                    b"ElementDataFile = LIST 2\na\nb", b"ElementDataFile = %05d.raw 1 1000000000 1", b"CompressedData = True\nCompressedDataSize = 99999999999999",
                    b"ObjectType = Image\n" * 100000 + b"NDims = 3", b"Comment = x\nComment = y", b"ElementSpacing = 0 0 0", b"ElementSpacing = 1e999 nan inf")
    data = case.data
    at = one.pick(0, data.index(b"ElementDataFile"), data.index(b"DimSize"))
    return case.with_data(data[:at] + line + b"\n" + data[at:], texts=(), exact=False, values=None)


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
