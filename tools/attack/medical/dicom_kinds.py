"""Kinds of tries of DICOM: files without preamble, tables of values, mosaics, segmentations, folders of more than a series, echoes.

Judges: pydicom (tables, bits, files without preamble), nibabel.nicom (values and place of mosaics), GDCM (whether it reads a file without
preamble at all), and the numbers that were written.
"""
import shutil
import struct
import subprocess

import numpy as np

import attack

from . import volumes
from .dicom_files import (SYNTAXES, BasicTextSRStorage, Bits, Dataset, ExplicitVRBigEndian, ImplicitVRLittleEndian, Sequence, bits, image, meaning,
                          place, position, pydicom, scale_elements, scales, text, uid)

dicomwrappers = attack.require("nibabel.nicom.dicomwrappers")
lut = attack.require("pydicom.pixel_data_handlers.util")
MR = "1.2.840.10008.5.1.4.1.1.4"
SEGMENTATION = "1.2.840.10008.5.1.4.1.1.66.4"
LABEL_MAP = "1.2.840.10008.5.1.4.1.1.66.7"
SECONDARY = "1.2.840.10008.5.1.4.1.1.7"


def _shape(one):
    return int(one.random.integers(1, 7)), int(one.random.integers(1, 9)), int(one.random.integers(1, 9))


def _series(one, folder, stored, b, p, pairs, **more):
    """A series of single images; the paths by rising place."""
    paths = []
    series = more.pop("series", None) or uid(one)
    syntax = more.pop("syntax", None) or one.pick(*SYNTAXES)
    for z in range(len(stored)):
        paths.append(folder / f"{one.random.integers(10**9)}.dcm")
        image(one, paths[-1], stored[z], b, syntax=syntax, series=series, **p.elements(), **scale_elements(pairs[z]),
              ImagePositionPatient=position(p.at(z)), InstanceNumber=z + 1, **more)
    return paths, series


def _without_preamble(path, own_group):
    whole = path.read_bytes()
    start = 132
    if not own_group:
        start += 12 + pydicom.dcmread(path, stop_before_pixels=True).file_meta.FileMetaInformationGroupLength
    path.write_bytes(whole[start:])


def dicom_bare(one):
    """Files without preamble, some of them with their own group."""
    n, ny, nx = _shape(one)
    b, p = bits(one), place(one)
    p.size[2] = p.size[2] if n > 1 else 1
    stored, pairs = b.numbers(one, (n, ny, nx)), scales(one, n)
    syntax = one.pick(*SYNTAXES)
    paths, _ = _series(one, one.folder / "s", stored, b, p, pairs, syntax=syntax)
    for path in paths:
        if one.chance(0.8):
            before = pydicom.dcmread(path)
            own_group = one.chance(0.3)
            _without_preamble(path, own_group)
            after = pydicom.dcmread(path, force=True)
            if not b.floating and (after.Rows, after.PixelData) != (before.Rows, before.PixelData):
                return attack.wrong(f"the judge and the attacker disagree: {path.name}")
    if len(paths) == 1 and shutil.which("gdcminfo") and syntax != ExplicitVRBigEndian and not b.floating and one.chance(0.2):
        done = subprocess.run(["gdcminfo", paths[0]], capture_output=True, text=True, errors="replace")
        if done.returncode == 0 and f"Dimensions: ({nx},{ny},1)" not in done.stdout:
            return attack.wrong(f"the judge and the attacker disagree: {done.stdout[:300]}")
    values, dtype = meaning(stored, b, pairs)
    return volumes.compared(one, paths[0] if n == 1 and one.chance(0.5) else one.folder / "s", volumes.Volume(values, p.affine(), "mm", dtype))


def dicom_table(one):
    """Tables of values (Modality LUT), of each file its own."""
    n, ny, nx = _shape(one)
    b = bits(one, floats=False)
    if b.allocated == 32:
        b = Bits(16, 16, 15, b.signed)
    p = place(one)
    p.size[2] = p.size[2] if n > 1 else 1
    low, high = b.range()
    count = int(one.pick(1, 2, 57, 256, 4096, 65536)) if one.chance(0.7) else int(one.random.integers(1, 5000))
    first = int(one.random.integers(max(low, -32768), min(high, 65535), endpoint=True)) if one.chance(0.7) else 0
    depth = int(one.pick(8, 12, 16))
    stored = np.clip(first + one.random.integers(-20, count + 20, (n, ny, nx)), low, high)
    syntax = one.pick(*SYNTAXES)
    order = ">" if syntax == ExplicitVRBigEndian else "<"
    values = np.zeros((n, ny, nx), "u1" if b.allocated == 8 and depth <= 8 else "u2")
    series = uid(one)
    for z in range(n):
        table = one.random.integers(0, 2**depth, count)
        item = Dataset()
        item.add_new(0x00283002, "SS" if b.signed else "US", [count % 65536 if not b.signed or count < 32768 else count - 65536 if count < 65536 else 0,
                                                            first, depth])
        item.add_new(0x00283006, "OW", table.astype(f"{order}u2").tobytes())
        item.ModalityLUTType = one.pick("HU", "US", "OD")
        path = one.folder / "s" / f"{one.random.integers(10**9)}.dcm"
        d = image(one, path, stored[z], b, syntax=syntax, series=series, **p.elements(), ImagePositionPatient=position(p.at(z)),
                  ModalityLUTSequence=Sequence([item]), **(scale_elements((3.0, 5.0)) if one.chance(0.2) else {}))
        values[z] = table[np.clip(stored[z] - first, 0, count - 1)]
        if b.stored == b.allocated and order == "<" and depth != 12 and count > 1 and one.chance(0.3):  # pydicom knows types of 8 and 16 bits
            d = pydicom.dcmread(path)
            array = d.pixel_array.reshape(ny, nx).astype("i8")  # so that it does not overflow
            if not np.array_equal(lut.apply_modality_lut(array, d), values[z]):
                return attack.wrong("the judge and the attacker disagree about a table")
    return volumes.compared(one, one.folder / "s", volumes.Volume(values, p.affine(), "mm"))


def _csa(tags):
    out = b"SV10\4\3\2\1" + struct.pack("<II", len(tags), 77)
    for name, vr, items in tags:
        packed = [item.encode() + b"\0" if item else b"" for item in items] + [b""] * int(6 - len(items))
        out += struct.pack("<64si4s3i", name.encode(), len(items), vr, 0, len(packed), 77)
        for item in packed:
            out += struct.pack("<4i", len(item), len(item), 77, len(item)) + item + b"\0" * (-len(item) % 4)
    return out + b"\0" * (len(out) % 2)


def dicom_mosaic(one):
    """Siemens mosaics, one or a series of times."""
    n, ny, nx = int(one.random.integers(2, 20)), int(one.random.integers(1, 9)), int(one.random.integers(1, 9))
    b, p = bits(one, floats=False), place(one)
    if b.allocated == 32:
        b = Bits(16, 16, 15, b.signed)
    times = int(one.random.integers(1, 4))
    stored = b.numbers(one, (times, n, ny, nx))
    pair = scales(one, 1)[0]
    sign = one.pick(1, 1, -1)
    side = int(np.ceil(np.sqrt(n)))
    series, syntax = uid(one), one.pick(*SYNTAXES)
    affine = None
    for t in one.random.permutation(times):
        plane = np.zeros((side * ny, side * nx), "i8")
        for z in range(n):
            y, x = divmod(z, side)
            plane[y * ny:(y + 1) * ny, x * nx:(x + 1) * nx] = stored[t, z]
        path = one.folder / "s" / f"{one.random.integers(10**9)}.dcm"
        d = image(one, path, plane, b, syntax=syntax, series=series, kind=MR, **p.elements(), **scale_elements(pair), SpacingBetweenSlices=text(p.size[2]),
                  ImagePositionPatient=position(p.first), ImageType=["ORIGINAL", "PRIMARY", "M", "MOSAIC"], AcquisitionNumber=int(t) + 1,
                  InstanceNumber=int(t) + 1, clutters=False)
        tags = [("NumberOfImagesInMosaic", b"US\0\0", [f"{n}"]), ("AcquisitionMatrixText", b"SH\0\0", [f"{ny}p*{nx}"]),
                ("SliceNormalVector", b"FD\0\0", [f"{v:.12f}" for v in sign * p.turn[:, 2]]), ("Other", b"IS\0\0", [])]
        for _ in range(int(one.random.integers(3))):
            tags.insert(int(one.random.integers(len(tags))), ("EchoLinePosition", b"IS\0\0", ["7"] * int(one.random.integers(1, 7))))
        block = int(one.pick(0x10, 0x10, 0x11, 0x2F))
        d.add_new(0x00290010, "LO", "SOME MAKER")  # nibabel looks for this block first
        d.add_new(0x00290000 + block, "LO", "SIEMENS CSA HEADER")
        d.add_new(0x00290000 + (block << 8) + 0x10, "OB", _csa(tags))
        d.save_as(path, write_like_original=False)
        judge = dicomwrappers.wrapper_from_file(str(path))
        affine = judge.affine[:, [1, 0, 2, 3]]
        if b.stored == b.allocated and pair is None and not np.array_equal(judge.get_data().transpose(2, 0, 1), stored[t]):
            return attack.wrong("the judge and the attacker disagree about a mosaic")
    t = int(one.random.integers(times))
    values, dtype = meaning(stored[t], b, [pair] * n)
    return volumes.compared(one, one.folder / "s", volumes.Volume(values, affine, "mm", dtype, options={"index": {"t": t}} if times > 1 else {}))


def _group(**elements):
    item = Dataset()
    for key, value in elements.items():
        setattr(item, key, value)
    return Sequence([item])


def dicom_segments(one):
    """Segmentations: single bits, fractions, label maps; planes without frames, overlaps, one segment of many."""
    n, ny, nx = int(one.random.integers(1, 8)), int(one.random.integers(1, 9)), int(one.random.integers(1, 9))
    p = place(one)
    kind = one.pick("BINARY", "BINARY", "BINARY", "FRACTIONAL", "LABELMAP")
    count = int(one.random.integers(1, 5))
    wide = kind != "FRACTIONAL" and one.chance(0.15)
    numbers = sorted(int(v) for v in one.random.choice(np.arange(1, 700 if wide else 256), count, replace=False))
    whole = one.random.choice([0, *numbers], (n, ny, nx))
    whole[one.random.random(n) < 0.3] = 0
    overlap = kind == "BINARY" and count > 1 and one.chance(0.2)
    most = int(one.random.integers(1, 256))
    fractions = one.random.integers(0, most, (count, n, ny, nx), endpoint=True)
    frames = []
    for z in range(n):
        if kind == "LABELMAP":
            if whole[z].any() or one.chance(0.3):
                frames.append((z, None, whole[z]))
            continue
        for i, number in enumerate(numbers):
            plane = whole[z] == number if kind == "BINARY" else fractions[i, z]
            if plane.any() or one.chance(0.2):
                frames.append((z, number, plane))
    if overlap:
        frames = [f for f in frames if f[0] != 0] + [(0, number, np.ones((ny, nx), bool)) for number in numbers[:2]]
    if not frames:
        return attack.refused("a segmentation without frames")
    frames = [frames[i] for i in one.random.permutation(len(frames))]
    per_frame = []
    for z, number, _ in frames:
        item = Dataset()
        item.PlanePositionSequence = _group(ImagePositionPatient=position(p.at(z)))
        item.FrameContentSequence = _group(DimensionIndexValues=[number or 1, z + 1])
        if number is not None:
            item.SegmentIdentificationSequence = _group(ReferencedSegmentNumber=number)
        per_frame.append(item)
    planes = np.stack([f[2] for f in frames])
    used = sorted({f[0] for f in frames})
    gaps = np.diff(used)
    says = one.chance(0.5) or len(used) < 2 or gaps.min() > 1  # else the smallest gap is the distance
    shared = Dataset()
    shared.PlaneOrientationSequence = _group(ImageOrientationPatient=p.elements()["ImageOrientationPatient"])
    shared.PixelMeasuresSequence = _group(PixelSpacing=p.elements()["PixelSpacing"], SliceThickness=text(p.size[2] * one.pick(0.3, 1, 2)))
    if says:
        shared.PixelMeasuresSequence[0].SpacingBetweenSlices = text(p.size[2])
    segments = []
    for number in numbers:
        item = Dataset()
        item.SegmentNumber, item.SegmentLabel = number, f"segment {number}"
        if one.chance(0.5):
            item.RecommendedDisplayCIELabValue = [int(v) for v in one.random.integers(0, 65536, 3)]
        item.SegmentedPropertyTypeCodeSequence = _group(CodeValue="1", CodeMeaning="organ")
        segments.append(item)
    size = 16 if kind == "LABELMAP" and wide else 8
    path = one.folder / "seg.dcm"
    more = {"MaximumFractionalValue": most} if kind == "FRACTIONAL" else {}
    d = image(one, path, planes.astype("i8"), Bits(size, size, size - 1, False), syntax=one.pick(*SYNTAXES[:2]), clutters=False, kind=LABEL_MAP if kind == "LABELMAP" else SEGMENTATION,
              SegmentationType=kind, SegmentSequence=Sequence(segments), SharedFunctionalGroupsSequence=Sequence([shared]),
              PerFrameFunctionalGroupsSequence=Sequence(per_frame), PhotometricInterpretation="MONOCHROME2", **more)
    if kind == "BINARY":
        d.BitsAllocated = d.BitsStored = 1
        d.HighBit = 0
        packed = np.packbits(planes.ravel(), bitorder="little").tobytes()
        d.PixelData = packed + b"\0" * (len(packed) % 2)
        d.save_as(path, write_like_original=False)
    if not np.array_equal(pydicom.dcmread(path).pixel_array.reshape(planes.shape), planes):
        return attack.wrong("the judge and the attacker disagree about bits")
    first, last = used[0], used[-1]
    affine = p.affine()
    affine[:3, 3] = p.at(first)
    only = int(one.pick(*numbers)) if one.chance(0.4) else None
    options = {} if only is None else {"index": {"segment": only}}
    values = np.zeros((last - first + 1, ny, nx), "u2" if kind == "LABELMAP" and size == 16 or kind == "BINARY" and numbers[-1] > 255 else "u1")
    if kind == "FRACTIONAL":
        values = np.zeros(values.shape, "f4")
        for z, number, plane in frames:
            if only in (None, number):
                values[z - first] = (plane / most).astype("f4")
    else:
        for z, number, plane in frames:
            found = plane if number is None else plane * number
            values[z - first] = np.maximum(values[z - first], found if only is None else np.where(found == only, only, 0))
    volume = volumes.Volume(values, affine, "mm", options=options)
    if kind == "FRACTIONAL" and only is None and count > 1:
        volume.must_refuse = ("several fractional segments, none named", "FRACTIONAL")
    elif overlap and only is None:
        volume.must_refuse = ("segments that overlap", "overlap")
    elif one.chance(0.03):
        volume.options, volume.must_refuse = {"index": {"segment": 999}}, ("no such segment", "no segment 999")
    return volumes.compared(one, path, volume)


def dicom_mixed(one):
    """A series in a folder with colours, copies, localizers, reports and damaged files of other series."""
    n, ny, nx = int(one.random.integers(2, 7)), int(one.random.integers(2, 9)), int(one.random.integers(2, 9))
    b, p = bits(one), place(one)
    stored, pairs = b.numbers(one, (n, ny, nx)), scales(one, n)
    folder = one.folder / "s"
    paths, series = _series(one, folder, stored, b, p, pairs)
    values, dtype = meaning(stored, b, pairs)
    volume = volumes.Volume(values, p.affine(), "mm", dtype)
    small = Bits(8, 8, 7, False)
    choices = 1
    for thing in one.random.choice(["colours", "copy", "bare copy", "localizer", "report", "damaged", "colours in it", "changed"], int(one.random.integers(1, 4)),
                                   replace=False):
        name = folder / f"{thing.replace(' ', '_')}.dcm"
        if thing == "colours":
            image(one, name, np.zeros((4, 12), "i8"), small, series=uid(one), kind=SECONDARY, Columns=4, SamplesPerPixel=3, PhotometricInterpretation="RGB",
                  PlanarConfiguration=0)
        elif thing == "copy":
            shutil.copy(paths[one.random.integers(n)], name)
        elif thing == "bare copy":
            shutil.copy(paths[one.random.integers(n)], name)
            _without_preamble(name, one.chance(0.5))
        elif thing == "localizer":
            way = one.random.random()
            turn = {"ImageOrientationPatient": [text(v) for v in (*p.turn[:, 1], *p.turn[:, 2])]} if way < 0.5 else {"ImageType": ["ORIGINAL", "PRIMARY", "LOCALIZER"]}
            plane = stored[0] if way < 0.7 else np.zeros((ny + 1, nx), "i8")
            image(one, name, plane, b, series=series, **(p.elements() | turn), ImagePositionPatient=position(p.at(0)))
            volume.options["index"] = {"stack": 0}
        elif thing == "report":
            image(one, name, stored[0], small, PixelData=None, series=series if one.chance(0.5) else uid(one), kind=BasicTextSRStorage) if not b.floating else None
        elif thing == "damaged":
            image(one, name, np.zeros((4, 5), "i8"), small, series=uid(one), syntax=ImplicitVRLittleEndian, PixelData=None)
            choices += 1
        elif thing == "colours in it":
            image(one, name, np.zeros((4, 12), "i8"), small, series=series, Columns=4, SamplesPerPixel=3, PhotometricInterpretation="RGB", PlanarConfiguration=0)
            volume.options["index"] = {"stack": 0}
        elif thing == "changed":
            d = pydicom.dcmread(paths[one.random.integers(n)])
            d.PatientName = "Somebody^Else"
            d.save_as(name, write_like_original=False)
            volume.must_refuse = ("two contents under one UID", "other contents")
    if choices > 1 or one.chance(0.3):
        volume.options["series"] = series if one.chance(0.6) else series[-9:]
    if "index" in volume.options and volume.must_refuse is None and one.chance(0.2):
        del volume.options["index"]
        volume.must_refuse = ("several stacks, none named", "stack=0")
    return volumes.compared(one, folder, volume)


def dicom_echoes(one):
    """Images of one place that differ by echo, acquisition, b value, trigger time: the axis t by these, whatever their numbers say."""
    n, ny, nx = _shape(one)
    b, p = bits(one, floats=False), place(one)
    p.size[2] = p.size[2] if n > 1 else 1
    keys = one.random.choice(["TemporalPositionIdentifier", "AcquisitionNumber", "DiffusionBValue", "TriggerTime", "EchoNumbers"],
                             int(one.random.integers(1, 3)), replace=False)
    keys = [k for k in ("TemporalPositionIdentifier", "AcquisitionNumber", "DiffusionBValue", "TriggerTime", "EchoNumbers") if k in keys]
    counts = [int(one.random.integers(2, 4)) for _ in keys]
    times = int(np.prod(counts))
    levels = [sorted(int(v) for v in one.random.choice(50, c, replace=False)) for c in counts]
    stored = b.numbers(one, (times, n, ny, nx))
    pair = scales(one, 1)[0]
    series = uid(one)
    for z in range(n):
        for t in range(times):
            at = np.unravel_index(t, counts)
            more = {key: (float if key == "DiffusionBValue" else str if key == "TriggerTime" else int)(levels[i][at[i]]) for i, key in enumerate(keys)}
            image(one, one.folder / "s" / f"{one.random.integers(10**9)}", stored[t, z], b, series=series, **p.elements(), **scale_elements(pair),
                  ImagePositionPatient=position(p.at(z)), InstanceNumber=int(one.random.integers(1000)), **more)
    t = int(one.random.integers(times))
    values, dtype = meaning(stored[t], b, [pair] * n)
    volume = volumes.Volume(values, p.affine(), "mm", dtype, options={"index": {"t": t}})
    if one.chance(0.05):
        volume.options, volume.must_refuse = {}, ("several times, none named", "t is ")
    return volumes.compared(one, one.folder / "s", volume)
