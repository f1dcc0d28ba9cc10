"""Kinds of tries of DICOM: packed frames, and what must not be read as an even volume."""
import shutil
import subprocess

import numpy as np

import attack

from . import volumes
from .dicom_files import (SYNTAXES, Bits, bits, image, meaning, place, position, pydicom, scale_elements,
                          scales, text, uid)


def dicom_bad(one):
    """A series with something that must not be taken for an even volume."""
    n, ny, nx = int(one.random.integers(4, 8)), int(one.random.integers(2, 9)), int(one.random.integers(2, 9))
    b, p = bits(one, floats=False), place(one)
    stored = b.numbers(one, (n, ny, nx))
    folder = one.folder / "s"
    places = np.arange(n, dtype=float)
    asides = np.zeros((n, 2))
    special = {}
    extra = []
    which = int(one.random.integers(1, n - 1))
    syntax = one.pick(*SYNTAXES)
    way = one.pick("gap", "uneven", "copy", "doubled", "tilt", "aside", "size", "turned", "spacing", "bits", "RGB", "palette", "one bit",
                   "deflated", "offset", "nearly")
    must = {"gap": ("slices are missing", "missing"), "uneven": ("slices at uneven distances", "even distances"),
            "copy": ("other contents under one UID", "other contents"), "doubled": ("two images at one place", "doubled"), "tilt": ("a tilted gantry", "sheared"),
            "aside": ("a slice that lies aside", "beside its place"), "size": ("images of another size", "has "),
            "turned": ("images of another direction", "another direction"), "spacing": ("images of another pixel spacing", "pixel spacing"),
            "bits": ("images of other numbers", "bits"), "RGB": ("colours", "colours"), "palette": ("colours", "colours"),
            "one bit": ("single bits", "bits for each number"), "deflated": ("a deflated file", "deflated"),
            "offset": ("slices that drift", "even distances|beside its place"), "nearly": ("", "")}[way]
    if way == "gap":
        places[which:] += int(one.random.integers(1, 4))
    elif way == "uneven":
        places[which] += one.pick(-1, 1) * one.random.uniform(0.3, 0.6)
    elif way in ("copy", "doubled"):
        extra = [which]
    elif way == "tilt":
        # At least 1.2 of the larger side of a pixel, and of the distance of slices, from the first slice to the last.
        asides[:, 1] = np.arange(n) * one.random.uniform(0.4, 2) * p.size.max() / p.size[:2].min()
    elif way == "aside":
        asides[which] = one.random.choice([-1, 1], 2) * one.random.uniform(0.15, 3, 2)
    elif way == "turned":
        special[which] = {"ImageOrientationPatient": [text(v) for v in (*p.turn[:, 1], *p.turn[:, 0])]}
    elif way == "spacing":
        special[which] = {"PixelSpacing": [text(p.size[1] * 1.01), text(p.size[0])]}
    elif way == "offset":
        places = places**2 * 0.1 + places
    elif way == "nearly":
        must = None
        places[which] += one.random.uniform(-0.07, 0.07)
    for z in range(n):
        elements = p.elements() | {"ImagePositionPatient": position(p.at(places[z], asides[z])), "InstanceNumber": z + 1} | special.get(z, {})
        plane, c = stored[z], b
        if way == "size" and z == which:
            plane = stored[z][:-1]
        if way == "bits" and z == which:
            c = Bits(b.allocated, b.allocated, b.allocated - 1, not b.signed)
        if way == "RGB" and z == which:
            elements |= {"SamplesPerPixel": 3, "PhotometricInterpretation": "RGB", "PlanarConfiguration": 0}
        if way == "palette" and z == which:
            elements |= {"PhotometricInterpretation": "PALETTE COLOR"}
        if way == "one bit":
            elements |= {"BitsAllocated": 1, "BitsStored": 1, "HighBit": 0}
        d = image(one, folder / f"{z}.dcm", plane, c, **elements,
                  syntax=pydicom.uid.DeflatedExplicitVRLittleEndian if way == "deflated" and z == which else syntax)
        if z in extra:
            image(one, folder / "again.dcm", plane, c, **elements, syntax=syntax,
                  SOPInstanceUID=d.SOPInstanceUID if way == "copy" else uid(one))
            if (folder / "again.dcm").read_bytes() == (folder / f"{z}.dcm").read_bytes():
                must = None
    volume = volumes.Volume(stored.astype(b.dtype()), p.affine(), "mm", must_refuse=must)
    return volumes.compared(one, folder, volume)


def dicom_packed(one):
    """JPEG, JPEG-LS, JPEG 2000 and RLE, all without loss, by GDCM and pydicom; files of one series packed each in its way."""
    if shutil.which("gdcmconv") is None:
        return attack.refused("no gdcmconv (Debian: libgdcm-tools)")
    n, ny, nx = int(one.random.integers(1, 4)), int(one.random.integers(1, 40)), int(one.random.integers(1, 40))
    several = one.chance(0.3) and n > 1
    b, p = bits(one, floats=False), place(one)
    if b.allocated == 32:
        b = Bits(16, 16, 15, b.signed)
    b.high = b.stored - 1  # what encoders do with other bits is theirs
    stored = b.numbers(one, (n, ny, nx)) if one.chance(0.5) else \
        np.clip(np.arange(n * ny * nx).reshape(n, ny, nx) + b.range()[0], *b.range())
    pairs = scales(one, 1) * n
    p.size[2] = float(text(p.size[2]))
    p.size[2] = p.size[2] if n > 1 else 1
    ways = ("--jpeg", "--jpegls", "--j2k", "--rle", "pydicom", None)
    way = one.pick(*ways)
    mixed = one.chance(0.3)
    folder = one.folder / "s"
    common = p.elements() | scale_elements(pairs[0])
    if several:
        common["SpacingBetweenSlices"] = text(p.size[2])
    for z in range(1 if several else n):
        way = one.pick(*ways) if mixed else way
        path = folder / f"{z}.dcm"
        d = image(one, path, stored if several else stored[z], b, noise=False, InstanceNumber=z + 1, **common,
                  ImagePositionPatient=position(p.at(z)))
        if way == "pydicom":
            d = pydicom.dcmread(path)
            d.compress(pydicom.uid.RLELossless, encoding_plugin="pydicom")
            d.save_as(path, write_like_original=False)
        elif way:
            done = subprocess.run(["gdcmconv", way, path, path.with_suffix(".new")], capture_output=True)
            if done.returncode != 0:
                return attack.refused("GDCM does not pack it")
            raw = subprocess.run(["gdcmconv", "--raw", path.with_suffix(".new"), one.folder / "raw.dcm"], capture_output=True)
            again = pydicom.dcmread(one.folder / "raw.dcm") if raw.returncode == 0 else None
            before = pydicom.dcmread(path)
            if again is None or again.PixelData[:stored[z].size] != before.PixelData[:stored[z].size] or again.PixelData != before.PixelData:
                return attack.refused("GDCM does not unpack what it packed")
            path.with_suffix(".new").rename(path)
    values, dtype = meaning(stored, b, pairs)
    return volumes.compared(one, folder, volumes.Volume(values, p.affine(), "mm", dtype))
