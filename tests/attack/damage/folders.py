"""DICOM and Zarr: good inputs, damage specific to them, independent readers."""
import dataclasses
import gzip
import json
import pathlib
import struct
import sys
import tempfile

import numpy as np
import pydicom
from pydicom.uid import CTImageStorage, ExplicitVRBigEndian, ExplicitVRLittleEndian, ImplicitVRLittleEndian, RLELossless

import attack
from damage.arrays import values
from damage.case import LINK, FIFO, FOLDER, TOKENS, Case, bomb

sys.path.insert(0, str(attack.ROOT / "tests/support"))
from zarr_two import zarr  # noqa: E402
from zarr_writer import V3  # noqa: E402


def files_of(folder):
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


# DICOM

def dicom_image(path, plane, z, syntax, enhanced):
    meta = pydicom.dataset.FileMetaDataset()
    meta.MediaStorageSOPClassUID, meta.MediaStorageSOPInstanceUID = CTImageStorage, f"1.2.3.4.{z}"
    meta.TransferSyntaxUID = syntax
    d = pydicom.dataset.FileDataset(str(path), {}, file_meta=meta, preamble=bytes(128))
    d.is_little_endian, d.is_implicit_VR = syntax != ExplicitVRBigEndian, syntax == ImplicitVRLittleEndian
    d.SOPClassUID, d.SOPInstanceUID, d.SeriesInstanceUID, d.StudyInstanceUID = CTImageStorage, f"1.2.3.4.{z}", "1.2.3", "1.2"
    d.Modality, d.InstanceNumber, d.PatientName, d.SeriesDescription = "CT", z + 1, "Nobody", "Thorax"
    d.Rows, d.Columns = plane.shape[-2:]
    d.SamplesPerPixel, d.PhotometricInterpretation, d.PixelRepresentation = 1, "MONOCHROME2", int(plane.dtype.kind == "i")
    d.BitsAllocated = d.BitsStored = 16
    d.HighBit = 15
    if enhanced:
        d.NumberOfFrames = len(plane)
        groups = []
        for at in range(len(plane)):
            frame = pydicom.dataset.Dataset()
            frame.PlanePositionSequence = [pydicom.dataset.Dataset()]
            frame.PlanePositionSequence[0].ImagePositionPatient = [0, 0, at]
            groups.append(frame)
        d.PerFrameFunctionalGroupsSequence = groups
    else:
        d.ImagePositionPatient = [0, 0, 2 * z]
    d.ImageOrientationPatient, d.PixelSpacing, d.RescaleSlope, d.RescaleIntercept = [1, 0, 0, 0, 1, 0], [1, 2], 1, 0
    d.PixelData = plane.astype(plane.dtype.newbyteorder("<" if d.is_little_endian else ">")).tobytes()
    d["PixelData"].VR = "OW"
    if syntax == RLELossless:
        d.file_meta.TransferSyntaxUID = ExplicitVRLittleEndian
        d.compress(RLELossless, plane)
    d.save_as(path, write_like_original=False)


def read_dicom(path):
    images = [pydicom.dcmread(name) for name in (sorted(path.iterdir()) if path.is_dir() else [path])]
    if len(images) > 1:
        images.sort(key=lambda image: float(image.ImagePositionPatient[2]))
    if any(image.PhotometricInterpretation != "MONOCHROME2" for image in images):
        raise ValueError
    stack = [image.pixel_array * float(image.get("RescaleSlope", 1)) + float(image.get("RescaleIntercept", 0)) for image in images]
    return np.concatenate(stack) if stack[0].ndim == 3 else np.stack(stack)


def dicom(r):
    array = values(r, ("u2", "i2"))
    syntax = [ExplicitVRLittleEndian, ExplicitVRLittleEndian, ImplicitVRLittleEndian, ExplicitVRBigEndian, RLELossless][int(r.integers(5))]
    enhanced = r.random() < 0.3 and syntax != RLELossless
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        if enhanced:
            dicom_image(folder / "v.dcm", array, 0, syntax, True)
            files = {"v.dcm": (folder / "v.dcm").read_bytes()}
        else:
            (folder / "s").mkdir()
            for z, plane in enumerate(array):
                dicom_image(folder / f"s/{z}.dcm", plane, z, syntax, False)
            files = files_of(folder)
    target = str(r.choice(sorted(files)))
    data = files[target]
    order = ">" if syntax == ExplicitVRBigEndian else "<"
    fields, texts, at = [], [], 132
    while at + 8 <= len(data):  # explicit VR; with implicit VR only the file meta group
        group = data[at:at + 2]
        own = group == b"\2\0"
        here = "<" if own else order
        vr = data[at + 4:at + 6]
        if not own and syntax == ImplicitVRLittleEndian:
            length = struct.unpack("<I", data[at + 4:at + 8])[0]
            fields += [(at, "<u2"), (at + 2, "<u2"), (at + 4, "<u4")]
            at += 8
        elif vr in (b"OB", b"OW", b"SQ", b"UN", b"UT", b"OF"):
            length = struct.unpack(here + "I", data[at + 8:at + 12])[0]
            fields += [(at, here + "u2"), (at + 2, here + "u2"), (at + 4, "u1"), (at + 8, here + "u4")]
            at += 12
        else:
            length = struct.unpack(here + "H", data[at + 6:at + 8])[0]
            fields += [(at, here + "u2"), (at + 2, here + "u2"), (at + 5, "u1"), (at + 6, here + "u2")]
            at += 8
            if vr == b"US":
                fields += [(at, here + "u2")] * 6
            elif length:
                texts.append((at, at + length))
        if length == 0xFFFFFFFF or at + length > len(data):
            break
        at += length
    return Case("v.dcm" if enhanced else "s", files, target=target, fields=tuple(fields), texts=tuple(texts), values=array, read=read_dicom, close=True)


def element(tag, vr, value, length=None):
    group, number = tag >> 16, tag & 0xFFFF
    return struct.pack("<HH2sHI", group, number, vr, 0, len(value) if length is None else length) + value


def dicom_tricks(case, one):
    data = case.data
    at = data.find(b"\x08\0\x16\0")  # before the first element after the file meta group
    at = 132 if at < 0 else at
    depth = one.pick(10, 17, 1000, 100000)
    what = int(one.random.integers(9))
    item = struct.pack("<HHI", 0xFFFE, 0xE000, 0xFFFFFFFF)
    sequence = struct.pack("<HH2sHI", 0x0008, 0x1115, b"SQ", 0, 0xFFFFFFFF)
    per_frame = struct.pack("<HH2sHI", 0x5200, 0x9230, b"SQ", 0, 0xFFFFFFFF)
    more = {}
    if what == 0:
        put = (sequence + item) * depth
    elif what == 1:
        put = (sequence + item) * depth + (struct.pack("<HHI", 0xFFFE, 0xE00D, 0) + struct.pack("<HHI", 0xFFFE, 0xE0DD, 0)) * depth
    elif what == 2:
        put = per_frame + struct.pack("<HHI", 0xFFFE, 0xE000, 0) * one.pick(1000, 600000)
    elif what == 3:
        put = b"".join(struct.pack("<HH2sH", 0x0008, 0x0060, b"CS", 2) + b"CT" for _ in range(one.pick(1000, 200000)))
    elif what == 4:  # a text of the maximum length
        put = element(0x0008103E, b"UT", b"t" * one.pick(65536, 1 << 20, 17 << 20))
    elif what == 5:
        put = element(0x0020000D, b"UN", b"", one.pick(0xFFFFFFFF, 0xFFFFFFFE, 0x7FFFFFFF))
    elif what == 6 and case.name == "s":  # many images, links, FIFOs
        put = b""
        name = case.target
        more = {f"s/{i}": one.pick((LINK, "/dev/zero"), (FIFO,), (LINK, "."), (LINK, ".."), (LINK, f"{i}"), (FOLDER,), data, b"",
                                   bytes(128) + b"DICM", (LINK, "../../../outside/secret.raw")) for i in range(3)}
        more[f"{name}x"] = data
    elif what == 7:  # frames that the header declares and the file lacks
        put = struct.pack("<HH2sH", 0x0028, 0x0008, b"IS", 10) + one.pick(b"1000000000", b"2147483647", b"-1        ", b"500000    ")
        at = data.find(b"\x28\0\x10\0") if data.find(b"\x28\0\x10\0") > 0 else at
    else:
        put = per_frame + (item + struct.pack("<HH2sHI", 0x0020, 0x9113, b"SQ", 0, 0xFFFFFFFF) + item +
                           struct.pack("<HH2sH", 0x0020, 0x0032, b"DS", 6) + b"0\\0\\1e" + struct.pack("<HHI", 0xFFFE, 0xE00D, 0) +
                           struct.pack("<HHI", 0xFFFE, 0xE0DD, 0) + struct.pack("<HHI", 0xFFFE, 0xE00D, 0)) * one.pick(3, 100000, 400000)
    return case.with_data(data[:at] + put + data[at:], fields=(), texts=(), values=None).with_files(more)


# Zarr

HEAD = b"\x1f\x8b\x08\0\0\0\0\0\0\x03"  # of gzip


def read_zarr2(path):
    return zarr.open_array(str(path), "r")[...]


def zarr_folder(r):
    array = values(r, ("u1", "i2", "u4", "f4", "f8"))
    chunks = tuple(int(n) for n in np.maximum(1, -(-np.array(array.shape) // r.integers(1, 3, 3))))
    way = int(r.choice([0, 0, 0, 1, 2, 3]))
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        if way == 0:
            codec = [None, zarr.Blosc("lz4"), zarr.Zlib(), zarr.Zstd(), zarr.GZip()][int(r.integers(5))]
            zarr.save_array(str(folder / "z"), array, chunks=chunks, compressor=codec)
        elif way == 3:
            inner = tuple(max(1, n // 2) for n in chunks)
            V3(folder / "z", array, inner, codecs=[(), ("gzip",), ("zstd", "crc32c")][int(r.integers(3))], shards=tuple(2 * n for n in inner),
               index_at=str(r.choice(["start", "end"])), index_checksum=bool(r.random() < 0.5))
        else:
            V3(folder / "z", array, chunks, codecs=[(), ("gzip",), ("zstd",), ("blosc",), ("crc32c",)][int(r.integers(5))],
               order=(2, 0, 1) if r.random() < 0.3 else None, big=bool(r.random() < 0.3), names=list("zyx"), attributes={"a": 1})
            if way == 2:
                image = {"axes": [{"name": a, "type": "space"} for a in "zyx"], "datasets": [{"path": "i", "coordinateTransformations": [
                    {"type": "scale", "scale": [2, 1, 1]}]}]}
                (folder / "z").rename(folder / "i")
                (folder / "z").mkdir()
                (folder / "i").rename(folder / "z/i")
                (folder / "z/zarr.json").write_text(json.dumps({"zarr_format": 3, "node_type": "group", "attributes": {
                    "ome": {"version": "0.5", "multiscales": [image]}}}))
        files = files_of(folder)
    described = [name for name in sorted(files) if name.endswith((".zarray", "zarr.json"))]
    others = [name for name in sorted(files) if name not in described]
    target = str(r.choice(described)) if r.random() < 0.7 or not others else str(r.choice(others))
    data = files[target]
    fields = ()
    if target in others:
        fields = tuple((at, kind) for at in (*range(0, min(len(data), 64) - 8, 4), *range(max(0, len(data) - 132), len(data) - 8, 4))
                       for kind in ("<u4", "<u8"))
    return Case("z", files, target=target, fields=fields, texts=((0, len(data)),) if target in described else (), exact=target in described,
                values=array, read=read_zarr2 if way == 0 else None)


def replaced(node, at, value):
    """The tree with node number `at` replaced, counted from the root; and the number of nodes."""
    count = [0]

    def walk(one):
        count[0] += 1
        if count[0] - 1 == at:
            return value
        if isinstance(one, dict):
            return {key: walk(inner) for key, inner in one.items()}
        if isinstance(one, list):
            return [walk(inner) for inner in one]
        return one
    return walk(node), count[0]


def zarr_tricks(case, one):
    described = [name for name in case.files if name.endswith((".zarray", "zarr.json"))]
    what = int(one.random.integers(8))
    if what <= 4:
        case = dataclasses.replace(case, target=one.pick(*described), fields=(), texts=(), exact=False, values=None)
        tree = json.loads(case.data)
        _, count = replaced(tree, -1, None)
        marks = (None, True, [], {}, "", "x" * 100000, 0, -1, 1 << 31, 1 << 63, 1 << 64, 1 << 200, 0.5, -0.0, 1e308, [[]] * 1000, ["a"] * 1000, [1 << 20] * 3,
                 [1 << 40] * 3, [0, 0, 0], [1, 1, 1], [-1, 4, 4], [3] * 33, "int16", "<f8", "|O", "../../../outside", "/etc/passwd", "NaN", "0x7f", {"name": "gzip"},
                 [{"name": "bytes"}] * 3, [{"name": "gzip"}] * 50, {"id": "zlib"}, {"name": "transpose", "configuration": {"order": [0, 0, 0]}}, "MARK")
        mark = one.pick(*marks)
        changed, _ = replaced(tree, int(one.random.integers(1, count)), mark)
        data = json.dumps(changed).encode()
        if mark == "MARK":
            data = data.replace(b'"MARK"', one.pick(b"[" * 100000, b"[" * 100000 + b"]" * 100000, b'{"a":' * 100000 + b"1" + b"}" * 100000, b"9" * 100000, b"1e999999999",
                                                    b"-1e999", b"0." + b"1" * 100000, b'"\\ud800"', b'"\\u0000"', b'"\x01"', b"NaN", b"Infinity", b"1e5", b"01",
                                                    *TOKENS))
        if one.chance(0.1):
            data = data[:-1] + b"," + data[1:]  # every key twice
        return case.with_data(data)
    if what == 5:  # chunks that are not files
        chunks = [name for name in case.files if name not in described]
        if chunks:
            name = one.pick(*chunks)
            return case.with_files({name: one.pick((LINK, "/dev/zero"), (FIFO,), (FOLDER,), (LINK, "."), (LINK, name.split("/")[-1]), b"", bytes(1 << 20),
                                                   (LINK, "../../../outside/secret.raw"))}, values=None, exact=False, read=None)
    if what == 6:  # metadata that are not files
        name = one.pick(*described)
        return case.with_files({name: one.pick((LINK, "/dev/zero"), (FIFO,), (FOLDER,), (LINK, "."), b"", b"\0" * (1 << 20), b"[" + b"0," * (8 << 20), b'{"a":[' + b"{}," * (4 << 20), b"[" * (17 << 20), b'"' + b"a" * (17 << 20) + b'"')},
                               values=None, exact=False, read=None, target=described[0])
    chunks = [name for name in case.files if name not in described]
    if not chunks:
        return case.with_data(case.data + b"{")
    name = one.pick(*chunks)
    return case.with_files({name: one.pick(gzip.compress(bytes(1000)), HEAD + bomb(100 << 20))}, values=None, exact=False, read=None)
