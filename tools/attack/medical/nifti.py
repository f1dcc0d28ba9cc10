"""Random NIfTI files: the two versions, both byte orders, pairs, gzip, every pair of codes, scales, extensions, Analyze.

nibabel writes the header's fields and reads the file again: numbers with their scale by nibabel, and the place by
nibabel's get_best_affine() where the header has a code; without one by nifti1.h (method 1): the voxel's size alone, along
the axes from (0, 0, 0), where nibabel has a default of its own.
"""
import gzip
import warnings

import numpy as np

import attack

from . import volumes

nibabel = attack.require("nibabel")
nibabel.imageglobals.logger.setLevel("ERROR")
warnings.simplefilter("ignore")

TYPES = ("u1", "i1", "i2", "u2", "i4", "u4", "f4", "f8", "i8", "u8")
UNITS = {1: "m", 2: "mm", 3: "um"}


def _set_qform(one, header):
    """A qform; half a turn, where the quaternion's first number is 0, is frequent."""
    way = one.random.random()
    if way < 0.3:
        bcd = np.eye(3)[one.random.integers(3)] * one.pick(1, -1)  # half a turn: a = 0
    elif way < 0.5:
        bcd = np.zeros(3)
    else:
        q = one.random.normal(size=4)
        q /= np.linalg.norm(q) * one.pick(1, -1)
        bcd = q[1:] * (1 if q[0] >= 0 else -1)
    header["quatern_b"], header["quatern_c"], header["quatern_d"] = bcd
    header["pixdim"][0] = one.pick(1, -1, 0) if one.chance(0.9) else -1
    header["qoffset_x"], header["qoffset_y"], header["qoffset_z"] = volumes.origin(one)
    header["qform_code"] = one.random.integers(1, 6)


def _qform(header):
    """The map of nifti1.h (method 2)."""
    b, c, d = (float(header[f"quatern_{k}"]) for k in "bcd")
    a = np.sqrt(max(0.0, 1 - (b * b + c * c + d * d)))
    turn = np.array([[a * a + b * b - c * c - d * d, 2 * (b * c - a * d), 2 * (b * d + a * c)],
                     [2 * (b * c + a * d), a * a + c * c - b * b - d * d, 2 * (c * d - a * b)],
                     [2 * (b * d - a * c), 2 * (c * d + a * b), a * a + d * d - b * b - c * c]])
    size = header["pixdim"][1:4].astype("f8")
    size[2] *= -1 if header["pixdim"][0] < 0 else 1
    return volumes.affine_of(turn, size, [float(header[f"qoffset_{k}"]) for k in "xyz"])


def _shear(affine, shape):
    """By how many voxels the far corner of the volume moves if its axes are made straight: of the largest size, and of
    the smallest, where an axis of one node counts as one of two."""
    size = np.linalg.norm(affine[:3, :3], axis=0)
    u, _, v = np.linalg.svd(affine[:3, :3] / size)
    steps = np.linalg.norm((u @ v) * size - affine[:3, :3], axis=0)
    cells = np.array(shape[:3]) - 1
    return (steps * cells).sum() / size.max(), (steps * np.maximum(cells, 1)).sum() / size.min()


def _write(one, header, stored, single, big):
    """Header, extensions and numbers, as files; the one that is named."""
    extensions = b""
    begin = len(header.binaryblock)
    if one.chance(0.3):
        for _ in range(one.random.integers(1, 3)):
            size = 16 * int(one.random.integers(1, 5))
            code = one.pick(4, 6, 44)
            extensions += np.array([size, code], ">i4" if big else "<i4").tobytes() + one.random.bytes(size - 8)
    flag = b"\1\0\0\0" if extensions else b"\0\0\0\0"
    raw = stored.astype(stored.dtype.newbyteorder(">" if big else "<")).tobytes(order="F")
    gap = int(one.pick(0, 0, 0, 16, 5)) if single else int(one.pick(0, 0, 0, 32, 7))
    if single:
        offset = begin + 4 + len(extensions) + gap
        header["vox_offset"] = offset
        files = {"v.nii": header.binaryblock + flag + extensions + b"\7" * gap + raw}
        named = "v.nii"
    else:
        header["vox_offset"] = gap
        files = {"v.hdr": header.binaryblock + (flag + extensions if one.chance(0.7) else b""), "v.img": b"\7" * gap + raw}
        named = one.pick("v.hdr", "v.img")
    if one.chance(0.15):
        files[named if single else "v.img"] += b"\0" * int(one.random.integers(1, 50))  # more than is needed
    if one.chance(0.3):
        for name in list(files):
            data = files.pop(name)
            cut = int(one.random.integers(len(data))) if one.chance(0.2) else 0
            files[name + ".gz"] = (gzip.compress(data[:cut], 1) if cut else b"") + gzip.compress(data[cut:], 1)
        named += ".gz"
    for name, data in files.items():
        (one.folder / name).write_bytes(data)
    return one.folder / named


def nifti(one):
    version, single, big = one.pick(1, 2), one.chance(0.65), one.chance(0.4)
    cls = {(1, True): nibabel.nifti1.Nifti1Header, (1, False): nibabel.nifti1.Nifti1PairHeader,
           (2, True): nibabel.nifti2.Nifti2Header, (2, False): nibabel.nifti2.Nifti2PairHeader}[version, single]
    header = cls(endianness=">" if big else "<")
    dtype = np.dtype(one.pick(*TYPES))
    shape = volumes.sizes(one)
    extra = [] if one.chance(0.75) else [int(one.random.integers(1, 4)) for _ in range(one.random.integers(1, 4))]
    if not extra and one.chance(0.1):
        shape = shape[:2] + (1,)
    stored = volumes.numbers(one, dtype, (*shape, *extra))
    header.set_data_dtype(dtype)
    header.set_data_shape(stored.shape if one.chance(0.9) or extra or shape[2] > 1 else shape[:2])
    size = volumes.spacing(one)
    header["pixdim"][1:4] = size
    sform, qform = one.chance(0.6), one.chance(0.6)
    if qform:
        _set_qform(one, header)
    sheared = one.chance(0.1)
    if sform:
        directions = volumes.rotation(one)
        if sheared:
            directions = directions @ (np.eye(3) + one.random.normal(size=(3, 3)) * 10.0 ** one.random.uniform(-5, 0))
        rows = volumes.affine_of(directions, size if one.chance(0.8) else volumes.spacing(one), volumes.origin(one))
        for row, name in zip(rows, ("srow_x", "srow_y", "srow_z")):
            header[name] = row
        header["sform_code"] = one.random.integers(1, 6)
    elif one.chance(0.3):
        header["srow_x"] = [9, 9, 9, 9]  # means nothing without its code
    unit = int(one.random.integers(0, 4))
    header["xyzt_units"] = unit | int(one.pick(0, 8, 16, 24))
    slope, inter = np.nan, np.nan
    way = one.random.random()
    if way < 0.25:
        slope, inter = one.pick((0, 0), (0, 5), (1, 0), (np.nan, 3), (np.inf, 1))
    elif way < 0.7:
        whole = one.chance(0.5)
        slope = float(one.random.integers(-5, 6) or 2) if whole else float(np.float32(one.random.normal() or 1))
        inter = float(one.random.integers(-2000, 2000)) if whole else float(np.float32(one.random.normal() * 100))
    header["scl_slope"], header["scl_inter"] = slope, inter
    path = _write(one, header, stored, single, big)

    index = tuple(int(one.random.integers(n)) for n in extra)
    chosen = stored[(Ellipsis, *index)] if extra else stored
    values = np.ascontiguousarray(chosen.T)
    factor, offset = float(header["scl_slope"]), float(header["scl_inter"])
    applies = np.isfinite(factor) and factor != 0
    volume = volumes.Volume(values, unit=UNITS.get(unit))
    if applies:
        inner = values.astype("f8") if dtype.itemsize == 8 else values
        volume.values, volume.dtype = volumes.scaled(inner, factor, offset)
        if inner is values and volume.values is values:
            volume.dtype = None
    elif dtype.itemsize == 8:
        volume.dtype = np.dtype("f8")
    if sform:
        volume.affine = np.vstack([[header[k] for k in ("srow_x", "srow_y", "srow_z")], [0, 0, 0, 1]]).astype("f8")
    elif qform:
        volume.affine = _qform(header)
    else:
        volume.affine = volumes.affine_of(np.eye(3), header["pixdim"][1:4].astype("f8"), np.zeros(3))
    if sform and sheared:
        shear, most = _shear(volume.affine, (*shape, 1, 1))
        volume.loose = True
        pair = ("a sheared volume", "sheared")
        if shear > 1:
            volume.must_refuse = pair
        elif max(shear, most) > 1e-4:
            volume.may_refuse = (pair,)
    if any(n > 1 for n in extra):
        # Axes of one position need no index; by name or by position.
        names = [name for name, n in zip("tuvw", extra) if n > 1]
        at = [i for i, n in zip(index, extra) if n > 1]
        if one.chance(0.1):
            volume.must_refuse = ("several volumes, none named", "index")
        else:
            volume.options["index"] = dict(zip(names, at))
    judged = _nibabel_differs(path, volume, index)
    if judged:
        return attack.wrong("nibabel and the attacker disagree: " + judged)
    return volumes.compared(one, path, volume)


def _nibabel_differs(path, volume, index):
    """What nibabel reads otherwise than it was meant; nothing where nibabel refuses (an intercept that is no number, for one)."""
    try:
        image = nibabel.load(path)
        affine = image.header.get_best_affine()
    except (nibabel.spatialimages.HeaderDataError, nibabel.filebasedimages.ImageFileError, ValueError):
        return None
    if image.header["sform_code"] > 0 or image.header["qform_code"] > 0:
        if not np.allclose(affine, volume.affine, rtol=1e-4, atol=1e-4):
            return f"affine {affine.tolist()} and {volume.affine.tolist()}"
    data = np.asanyarray(image.dataobj)
    data = data[(Ellipsis, *index)] if index else data
    while data.ndim < 3:
        data = data[..., None]
    want = volume.values.astype("f8")
    largest = np.abs(want[np.isfinite(want)]).max(initial=1)
    if not np.allclose(data.T.astype("f8"), want, rtol=1e-6, atol=1e-6 * largest, equal_nan=True):
        return "values"
    return None


def analyze(one):
    """Analyze 7.5, which does not say where right is and whose origin SPM keeps elsewhere: never taken for something else."""
    header = nibabel.AnalyzeHeader(endianness=one.pick("<", ">"))
    dtype = np.dtype(one.pick("u1", "i2", "i4", "f4", "f8"))
    stored = volumes.numbers(one, dtype, volumes.sizes(one))
    header.set_data_dtype(dtype)
    header.set_data_shape(stored.shape)
    header["pixdim"][1:4] = volumes.spacing(one)
    (one.folder / "v.hdr").write_bytes(header.binaryblock)
    (one.folder / "v.img").write_bytes(stored.tobytes(order="F"))
    volume = volumes.Volume(stored.T, must_refuse=("Analyze without NIfTI's magic", "dims|raw|ANALYZE|Analyze"))
    return volumes.compared(one, one.folder / one.pick("v.hdr", "v.img"), volume)
