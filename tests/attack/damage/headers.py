"""NIfTI, MRC, NRRD and MetaImage: good files, damage specific to them, independent readers."""
import dataclasses
import gzip
import pathlib
import struct
import subprocess
import tempfile
import zlib

import mrcfile
import nibabel
import numpy as np

from damage.arrays import gzip_tricks, in_gzip, packed, saved, values
from damage.case import LINK, FIFO, Case, astray


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
    image = path.with_name("v.img")  # isonest detects gzip from the first bytes, nibabel from the name
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
    # An extension whose size points elsewhere, or with label names that expand.
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
    """teem's values, as raw numbers after the header that it writes."""
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
