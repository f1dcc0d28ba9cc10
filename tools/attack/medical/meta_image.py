"""Random MetaImage files: .mha and .mhd, types, orders, zlib, skipped bytes, channels, every name of a key.

The text of the header is written here, by MetaIO's documentation. VTK's vtkMetaImageReader reads it too, where it can: it
judges numbers, spacing and position; it knows no directions, and of those MetaIO's rule judges (row i of TransformMatrix is the
direction of axis i).
"""
import gzip
import zlib

import numpy as np

import attack

from . import volumes

vtk = attack.require("vtk")
from vtk.util import numpy_support  # noqa: E402

TYPES = {"MET_UCHAR": "u1", "MET_CHAR": "i1", "MET_USHORT": "u2", "MET_SHORT": "i2", "MET_UINT": "u4", "MET_INT": "i4",
         "MET_FLOAT": "f4", "MET_DOUBLE": "f8", "MET_LONG_LONG": "i8", "MET_ULONG_LONG": "u8"}


def _text(values):
    return " ".join(repr(float(v)) if not float(v).is_integer() else str(int(v)) for v in np.ravel(values))


def meta_image(one):
    kind = one.pick(*TYPES)
    dtype = np.dtype(TYPES[kind])
    dims = int(one.pick(3, 3, 3, 2, 4))
    shape = [*volumes.sizes(one), int(one.random.integers(1, 4))][:dims]
    channels = int(one.random.integers(2, 4)) if one.chance(0.15) else 1
    stored = volumes.numbers(one, dtype, (*shape[::-1], channels))
    big = one.chance(0.4)
    size = np.concatenate([volumes.spacing(one), [2.5]])[:dims]
    at = np.concatenate([volumes.origin(one), [7]])[:dims]
    turn = np.eye(dims)
    if one.chance(0.6):
        turn[:3, :3] = volumes.rotation(one)[:dims, :dims] if dims > 2 else one.pick(np.eye(2), [[0, 1], [-1, 0]], [[0.6, 0.8], [-0.8, 0.6]])
    lines = []
    if one.chance(0.2):
        lines.append("Comment = written = by hand, ElementType = MET_OTHER: NDims")
    lines.append("ObjectType = Image")
    lines.append(f"NDims = {dims}")  # MetaIO wants it before what depends on it
    body = [f"DimSize = {_text(shape)}", f"ElementType = {kind}"]
    if one.chance(0.7):
        body.append(f"ElementSpacing = {_text(size)}")
        if one.chance(0.2):
            body.append(f"ElementSize = {_text(size * 3)}")
    elif one.chance(0.5):
        body.append(f"ElementSize = {_text(size)}")
    else:
        size = np.ones(dims)
    if one.chance(0.8):
        body.append(f"{one.pick('Offset', 'Position', 'Origin')} = {_text(at)}")
    else:
        at = np.zeros(dims)
    if one.chance(0.8):
        body.append(f"{one.pick('TransformMatrix', 'Rotation', 'Orientation')} = {_text(turn.T)}")
    else:
        turn = np.eye(dims)
    if channels > 1:
        body.append(f"ElementNumberOfChannels = {channels}")
    if big or one.chance(0.7):
        body.append(f"{one.pick('BinaryDataByteOrderMSB', 'ElementByteOrderMSB')} = {big}")
    if one.chance(0.8):
        body.append("BinaryData = True")
    unit = one.pick(None, None, "?", "um", "mm", "cm")
    if unit:
        body.append(f"DistanceUnits = {unit}")
    for line in ("CenterOfRotation = 0 0 0", "AnatomicalOrientation = RAI", "Modality = MET_MOD_CT", "Name = a b"):
        if one.chance(0.2):
            body.append(line)
    raw = stored.astype(dtype.newbyteorder(">" if big else "<")).tobytes()
    packed = one.chance(0.3)
    plain = raw
    if packed:
        raw = zlib.compress(raw, 1) if one.chance(0.8) else gzip.compress(raw, 1)
        body.append("CompressedData = True")
        if one.chance(0.7):
            body.append(f"CompressedDataSize = {len(raw)}")
    else:
        if one.chance(0.4):
            body.append("CompressedData = False")
    order = one.random.permutation(len(body)) if one.chance(0.3) else range(len(body))
    body = [body[i] for i in order]
    local = one.chance(0.4)
    in_parts = not local and dims > 2 and one.chance(0.4)
    end = one.pick("\n", "\n", "\n", "\r\n")
    if local:
        path = one.folder / "v.mha"
        text = end.join(lines + body + ["ElementDataFile = " + one.pick("LOCAL", "Local", "local")]) + end
        path.write_bytes(text.encode() + raw)
    elif in_parts:
        path = _in_parts(one, shape, plain, packed, lines + body, end)
    else:
        skip = int(one.pick(0, 0, 0, 10, 100))
        front = one.random.bytes(skip)
        if skip:
            body.append(f"HeaderSize = {-1 if not packed and one.chance(0.3) else skip}")
        name = one.pick("v.raw", "v.zraw", "a b.raw", "sub/v.raw")
        (one.folder / name).parent.mkdir(exist_ok=True)
        (one.folder / name).write_bytes(front + raw)
        path = one.folder / "v.mhd"
        path.write_bytes((end.join(lines + body + [f"ElementDataFile = {name}"]) + end).encode())

    channel = int(one.random.integers(channels))
    time = int(one.random.integers(shape[3])) if dims == 4 else 0
    chosen = stored[..., channel]
    chosen = chosen[time] if dims == 4 else chosen
    chosen = chosen[None] if dims == 2 else chosen
    volume = volumes.Volume(chosen, unit={"um": "um", "mm": "mm", "cm": "cm"}.get(unit))
    full = np.eye(3)
    full[:min(dims, 3), :min(dims, 3)] = turn[:3, :3]
    volume.affine = volumes.affine_of(full, np.concatenate([size, [1]])[:3], np.concatenate([at, [0]])[:3])
    index = {}
    if dims == 4 and shape[3] > 1:
        index["t"] = time
    if channels > 1:
        index["c"] = channel
    if index:
        if one.chance(0.1):
            volume.must_refuse = ("several volumes, none named", "index")
        else:
            volume.options["index"] = index
    judged = _vtk_differs(path, volume, channel, dims, channels)
    if judged:
        return attack.wrong("VTK and the attacker disagree: " + judged)
    return volumes.compared(one, path, volume)


def _in_parts(one, shape, raw, packed, lines, end):
    """The header of a list or a pattern of files, and the files."""
    own = one.pick(len(shape) - 1, len(shape) - 1, *range(1, len(shape)))
    count = int(np.prod(shape[own:]))
    skip = int(one.pick(0, 0, 10))
    if skip:
        lines.append(f"HeaderSize = {-1 if not packed and one.chance(0.3) else skip}")
    lines = [line for line in lines if not line.startswith("CompressedDataSize")]
    if own < len(shape) - 1 or one.chance(0.5):
        names = [one.pick("p", "a b ", "sub/") + f"{i}.raw" for i in range(count)]
        said = "LIST" + (f" {own}{one.pick('', 'D')}" if own < len(shape) - 1 or one.chance(0.5) else "")
        lines = [*lines, f"ElementDataFile = {said}", *names]
    else:
        first, step, pattern = int(one.random.integers(0, 20)), one.pick(1, 2, 10), one.pick("p%d.raw", "p%03d.raw", "sub/p%02d.raw")
        names = [pattern % (first + i * step) for i in range(count)]
        last = first + (count - 1) * step
        lines.append(f"ElementDataFile = {pattern} {first} {last} {step}" if step > 1 or one.chance(0.6) else
                     f"ElementDataFile = {pattern} {first}" + one.pick("", f" {last}"))
    (one.folder / "sub").mkdir()
    size = len(raw) // count
    for i, name in enumerate(names):
        part = raw[i * size:(i + 1) * size]
        (one.folder / name).write_bytes(one.random.bytes(skip) + (zlib.compress(part, 1) if packed else part))
    path = one.folder / "v.mhd"
    path.write_bytes((end.join(lines) + end).encode())
    return path


def _vtk_differs(path, volume, channel, dims, channels):
    text = path.read_bytes()[:4000]
    if dims == 4 or b"ElementDataFile = LIST" in text or b"%" in text or b"LONG_LONG" in text or b"\r" in text or b"Comment" in text or b"HeaderSize" in text or b"local" in text[-400:]:
        return None  # what VTK 9.1 does not read, or reads otherwise than MetaIO documents
    if b"ElementByteOrderMSB" in text or b"BinaryData = " not in text:
        return None
    if text.startswith(b"ObjectType") and b"CompressedData = True" in text and (b"CompressedDataSize" not in text or b"\x1f\x8b" in text):
        return None
    reader = vtk.vtkMetaImageReader()
    reader.AddObserver("ErrorEvent", lambda *_: None)
    if not reader.CanReadFile(str(path)):
        return None
    reader.SetFileName(str(path))
    reader.Update()
    image = reader.GetOutput()
    if image.GetNumberOfPoints() != volume.values.size:
        return f"{image.GetDimensions()}"
    data = numpy_support.vtk_to_numpy(image.GetPointData().GetScalars()).reshape(*volume.values.shape, channels)[..., channel]
    if not np.array_equal(data, volume.values, equal_nan=data.dtype.kind == "f"):
        return f"values of {data.dtype}"
    if not np.allclose(image.GetSpacing()[:dims], np.linalg.norm(volume.affine[:3, :dims], axis=0)):
        return f"spacing {image.GetSpacing()}"
    return None if np.allclose(image.GetOrigin()[:dims], volume.affine[:dims, 3]) else f"origin {image.GetOrigin()}"


def meta_image_refused(one):
    """What MetaImage has and isonest says that it does not read."""
    stored = volumes.numbers(one, "i2", volumes.sizes(one)[::-1])
    why, lines, files = one.pick(*_REFUSED)(stored)
    nz, ny, nx = stored.shape
    text = f"ObjectType = Image\nNDims = 3\nDimSize = {nx} {ny} {nz}\n" + "".join(line + "\n" for line in lines)
    for name, data in files.items():
        (one.folder / name).write_bytes(data)
    body = files.pop("", b"")
    (one.folder / "v.mhd").write_bytes(text.encode() + body)
    return volumes.compared(one, one.folder / "v.mhd", volumes.Volume(stored, must_refuse=why))


def _as_text(stored):
    return (("numbers as text", "text"), ["BinaryData = False", "ElementType = MET_SHORT", "ElementDataFile = v.txt"],
            {"v.txt": _text(stored).encode()})


def _long(stored):
    return (("MET_LONG", "MET_LONG"), ["ElementType = MET_LONG", "ElementDataFile = v.raw"], {"v.raw": stored.astype("i8").tobytes()})


def _short_file(stored):
    return (("a file that is cut short", "bytes"), ["ElementType = MET_SHORT", "ElementDataFile = v.raw"], {"v.raw": stored.tobytes()[:-1]})


_REFUSED = (_as_text, _long, _short_file)
