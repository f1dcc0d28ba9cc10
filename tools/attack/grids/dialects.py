"""Random files of HDF5's dialects and of MINC, and where their own readers have which value.

MINC is judged by nibabel; the others by the array that was written and their descriptions: ITK's HDF5ImageIO, Imaris'
file format 5.5, vigra's axistags, ChimeraX's cmap, HyperSpy's hspy, the EMD of Berkeley and of Velox.
"""
import json
import warnings

import attack
import h5py
import nibabel
import numpy as np
from scipy.io import netcdf_file

from . import compare

UNITS = {"um": "um", "nm": "nm", "mm": "mm", "µm": "um", "Å": "angstrom"}


def _shape(one, axes=3):
    return tuple(int(n) for n in one.random.integers(1, 12, axes))


def _affine(steps, first):
    """steps: the world's step along each index."""
    affine = np.eye(4)
    affine[:3, :3] = np.array(steps, "f8").T
    affine[:3, 3] = first
    return affine


def _rotation(one):
    q, _ = np.linalg.qr(one.random.normal(size=(3, 3)))
    return q if one.chance(0.5) else q * np.sign(np.linalg.det(q))


def _storage(one, shape):
    if not one.chance(0.6):
        return {}
    made = {"chunks": tuple(int(one.random.integers(1, n + 1)) for n in shape)}
    made["compression"] = one.pick(None, "gzip", "lzf")
    made["shuffle"], made["fletcher32"] = one.chance(0.5), one.chance(0.3)
    return made


def _integers(one, shape, kind):
    whole = np.iinfo(kind)
    return one.random.integers(whole.min, whole.max, shape, dtype=kind, endpoint=True)


class _Minc:
    """What both versions of MINC say."""

    def __init__(self, one, kinds):
        self.kind = one.pick(*kinds)
        names = [f"{a}space" for a in one.random.permutation(list("xyz"))] if one.chance(0.5) else ["zspace", "yspace", "xspace"]
        self.shape = _shape(one)
        self.time = one.chance(0.25)
        if self.time:
            names, self.shape = ["time", *names], (int(one.random.integers(1, 4)), *self.shape)
        self.names = names
        whole = np.iinfo(self.kind) if self.kind[0] != "f" else None
        self.values = compare.numbers(one, self.shape, self.kind)
        self.valid = None
        if whole and one.chance(0.7):
            low, high = sorted(int(v) for v in one.random.integers(max(whole.min, -2**40), min(whole.max, 2**40), 2, endpoint=True))
            self.valid = (float(low), float(high + (low == high and high < whole.max)))
            if self.valid[0] == self.valid[1]:
                self.valid = None
        self.scales = one.pick(0, 0, 1, 1, 2)
        outer = self.shape[:self.scales]
        self.least = one.random.normal(size=outer) * 10.0 ** one.random.integers(-3, 4)
        self.most = self.least + np.abs(one.random.normal(size=outer)) + 0.1
        cosines = _rotation(one) if one.chance(0.5) else None
        self.dims = {}
        for i, name in enumerate(n for n in names):
            said = {"spacing": b"regular__"}
            if one.chance(0.9):
                said["step"] = float(one.random.uniform(0.2, 4)) * one.pick(1, -1)
            if one.chance(0.9):
                said["start"] = float(one.random.normal() * 100)
            if cosines is not None and name != "time":
                said["direction_cosines"] = cosines["xyz".index(name[0])]
            if one.chance(0.7):
                said["units"] = b"mm" if name != "time" else b"s"
            self.dims[name] = said

    def expected(self, one, path):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            image = nibabel.load(path)
            values, affine = np.asarray(image.dataobj, "f8"), image.affine
        options = {}
        if self.time:
            t = int(one.random.integers(self.shape[0]))
            values = values[t]
            if self.shape[0] > 1 or one.chance(0.5):
                options["index"] = {"time": t} if one.chance(0.5) else (t, None, None, None)
        # nibabel's sums are of float64, those of small integers here are rounded to float32 in the end.
        spread = float(np.max(np.abs(self.most)) + np.max(np.abs(self.least)))
        return compare.InWorld(values, affine, "mm", "RAS", tolerance=4 + 4 * spread / max(float(np.abs(values).max()), 1e-30)), options


def minc1(one):
    """MINC 1, written by scipy as MINC's programs do."""
    said = _Minc(one, ("i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8"))
    path = one.folder / "v.mnc"
    letter = {"i1": "b", "u1": "b", "i2": "h", "u2": "h", "i4": "i", "u4": "i", "f4": "f", "f8": "d"}[said.kind]
    with netcdf_file(path, "w", version=1) as file:
        for name, n in zip(said.names, said.shape):
            file.createDimension(name, n)
        variables = [*said.dims, "image", "image-max", "image-min"]
        for name in one.random.permutation(variables):
            name = str(name)
            if name in said.dims:
                v = file.createVariable(name, "i", ())
                v.assignValue(0)
                v.varid = b"MINC standard variable"
                for key, value in said.dims[name].items():
                    setattr(v, key, value)
            elif name == "image":
                v = file.createVariable(name, letter, tuple(said.names))
                v[:] = said.values.view(said.values.dtype.str.replace("u", "i"))
                v.varid = b"MINC standard variable"
                v.signtype = b"unsigned" if said.kind[0] == "u" else b"signed__"
                if said.valid and one.chance(0.7):
                    v.valid_range = np.array(said.valid)
                elif said.valid:
                    v.valid_min, v.valid_max = said.valid
            else:
                numbers = said.most if name == "image-max" else said.least
                v = file.createVariable(name, "d", tuple(said.names[:said.scales]))
                if said.scales:
                    v[:] = numbers
                else:
                    v.assignValue(float(numbers))
                v.varid = b"MINC standard variable"
    expected, options = said.expected(one, path)
    return compare.differs_in_world(one, path, expected, **options)


def minc2(one):
    """MINC 2, written by h5py."""
    said = _Minc(one, ("i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8"))
    path = one.folder / "v.mnc"
    with h5py.File(path, "w") as file:
        root = file.create_group("minc-2.0")
        for name, attributes in said.dims.items():
            dim = root.create_dataset(f"dimensions/{name}", data=0)
            for key, value in attributes.items():
                dim.attrs[key] = np.bytes_(value) if isinstance(value, bytes) else value
            dim.attrs["length"] = said.shape[said.names.index(name)]
        image = root.create_dataset("image/0/image", data=said.values.astype(said.values.dtype.newbyteorder(one.pick("<", ">"))),
                                    **_storage(one, said.shape))
        image.attrs["dimorder"] = np.bytes_(",".join(said.names))
        if said.valid:
            image.attrs["valid_range"] = said.valid
        for name, numbers in (("image-max", said.most), ("image-min", said.least)):
            data = root.create_dataset(f"image/0/{name}", data=numbers)
            if said.scales:
                data.attrs["dimorder"] = np.bytes_(",".join(said.names[:said.scales]))
    expected, options = said.expected(one, path)
    if one.chance(0.2):
        options["dataset"] = "minc-2.0/image/0/image"
    return compare.differs_in_world(one, path, expected, **options)


def itk(one):
    shape = _shape(one)
    values = compare.numbers(one, shape, one.pick(*compare.KINDS))
    components = int(one.random.integers(2, 4)) if one.chance(0.2) else 0
    direction = _rotation(one) if one.chance(0.6) else np.diag(one.random.choice([-1.0, 1], 3))
    spacing, origin = one.random.uniform(0.1, 5, 3), one.random.normal(size=3) * 100
    path = one.folder / "v.h5"
    options = {}
    with h5py.File(path, "w") as file:
        group = file.create_group("ITKImage/0")
        group["Dimension"] = np.array(shape[::-1], one.pick("u8", "u4"))
        group["Origin"], group["Spacing"] = origin, spacing
        group["Directions"] = direction  # a row is the direction of an axis, x first
        group.create_group("MetaData")
        stored = values if not components else np.stack([values] + [np.zeros_like(values)] * (components - 1), -1)
        group.create_dataset("VoxelData", data=stored, **_storage(one, stored.shape))
        group["VoxelType"] = "UCHAR"
        file["ITKVersion"] = "5.3"
    if components:
        options["index"] = {"component": 0}
    if one.chance(0.2):
        options["dataset"] = "/ITKImage/0/VoxelData"
    steps = (direction * spacing[:, None])[::-1]  # of indices z, y, x
    return compare.differs_in_world(one, path, compare.InWorld(values, _affine(steps, origin), None, "LPS"), **options)


def _letters(text):
    return np.array([c.encode() for c in text], "S1")


def imaris(one):
    shape = _shape(one)
    times, channels = int(one.random.integers(1, 4)), int(one.random.integers(1, 4))
    padded = tuple(n + int(one.random.integers(0, 9)) for n in shape)
    kind = one.pick("u1", "u2", "f4")
    low = np.round(one.random.normal(size=3) * 50, 3)
    high = low + np.round(one.random.uniform(0.5, 50, 3), 3)
    unit = one.pick(*UNITS) if one.chance(0.8) else "?"
    path = one.folder / "v.ims"
    per_channel, per_image = one.pick((True, True), (True, False), (False, True))
    t, c = int(one.random.integers(times)), int(one.random.integers(channels))
    chosen = None
    with h5py.File(path, "w") as file:
        for i in range(times):
            for j in range(channels):
                data = np.zeros(padded, kind)
                data[tuple(slice(n) for n in shape)] = compare.numbers(one, shape, kind)
                if (i, j) == (t, c):
                    chosen = data[tuple(slice(n) for n in shape)]
                group = file.create_group(f"DataSet/ResolutionLevel 0/TimePoint {i}/Channel {j}")
                group.create_dataset("Data", data=data, **_storage(one, padded))
                group["Histogram"] = np.zeros(256, "u8")
                for a in range(3):
                    if per_channel:
                        group.attrs["ImageSize" + "XYZ"[a]] = _letters(str(shape[2 - a]))
        small = tuple(max(n // 2, 1) for n in shape)
        group = file.create_group("DataSet/ResolutionLevel 1/TimePoint 0/Channel 0")
        group["Data"] = np.zeros(small, kind)
        image = file.create_group("DataSetInfo/Image")
        for a in range(3):
            image.attrs[f"ExtMin{a}"], image.attrs[f"ExtMax{a}"] = _letters(f"{low[a]:.3f}"), _letters(f"{high[a]:.3f}")
            if per_image:
                image.attrs["XYZ"[a]] = _letters(str(shape[2 - a]))
        image.attrs["Unit"] = _letters(unit) if unit.isascii() else np.bytes_(unit.encode())
    step = (high - low) / shape[::-1]
    options = {}
    if times * channels > 1 or one.chance(0.3):
        options["index"] = one.pick({"t": t, "c": c}, (t, c, None, None, None))
        if one.chance(0.2):
            options = {"dataset": f"DataSet/ResolutionLevel 0/TimePoint {t}/Channel {c}/Data"}
    expected = compare.InWorld(chosen, _affine(np.diag(step)[::-1], low + step / 2), UNITS.get(unit))
    return compare.differs_in_world(one, path, expected, **options)


def ilastik(one):
    keys = [str(k) for k in one.random.permutation(list("xyz"))]
    lengths = dict(zip("xyz", _shape(one)))
    extra = {k: int(one.random.integers(1, 4)) for k in "tc" if one.chance(0.4)}
    for key in extra:
        keys.insert(int(one.random.integers(len(keys) + 1)), key)
    lengths.update(extra)
    shape = tuple(lengths[k] for k in keys)
    values = compare.numbers(one, shape, one.pick(*compare.KINDS))
    resolution = {k: float(one.random.uniform(0.1, 9)) if one.chance(0.5) else 0 for k in "xyz"}
    path, name = one.folder / "v.h5", one.pick("exported_data", "volume/data", "x")
    with h5py.File(path, "w") as file:
        data = file.create_dataset(name, data=values, **_storage(one, shape))
        data.attrs["axistags"] = json.dumps({"axes": [{"key": k, "typeFlags": {"t": 8, "c": 1}.get(k, 2),
                                                       "resolution": resolution.get(k, 0), "description": ""} for k in keys]})
    index = {k: int(one.random.integers(n)) for k, n in extra.items()}
    options = {"index": index} if any(n > 1 for n in extra.values()) or (extra and one.chance(0.3)) else {}
    # One after the other from the last axis on, what is left is in the order of `keys`.
    for k in reversed(keys):
        if k in index:
            values = values.take(index[k], keys.index(k))
    left = [k for k in keys if k in "xyz"]
    values = values.transpose([left.index(k) for k in "zyx"])
    step = [resolution[k] or 1 for k in "zyx"]
    expected = compare.InWorld(values, _affine(np.diag(step)[:, ::-1], (0, 0, 0)))
    return compare.differs_in_world(one, path, expected, **options)


def cmap(one):
    shape = _shape(one)
    values = compare.numbers(one, shape, one.pick("i1", "u1", "i2", "u2", "f4"))
    step, origin = one.random.uniform(0.2, 4, 3), one.random.normal(size=3) * 100
    turn = np.eye(3)
    path, group = one.folder / "v.cmap", one.pick("image1", "a b")
    with h5py.File(path, "w") as file:
        image = file.create_group(f"Chimera/{group}")
        image.attrs["name"] = np.bytes_("v")
        image.attrs["step"], image.attrs["origin"] = step.astype(one.pick("f4", "f8")), origin
        step = np.array(image.attrs["step"], "f8")
        if one.chance(0.5):
            image.attrs["cell_angles"] = np.array([90.0, 90, 90], "f4")
        if one.chance(0.5):
            axis, angle = one.random.normal(size=3), float(one.random.uniform(-180, 180))
            image.attrs["rotation_axis"], image.attrs["rotation_angle"] = axis, angle
            u = axis / np.linalg.norm(axis)
            k = np.array([[0, -u[2], u[1]], [u[2], 0, -u[0]], [-u[1], u[0], 0]])  # Rodrigues
            turn = np.eye(3) + np.sin(np.radians(angle)) * k + (1 - np.cos(np.radians(angle))) * k @ k
        image.create_dataset("data_zyx", data=values, **_storage(one, shape))
        if one.chance(0.4):
            small = image.create_dataset("data_zyx_2_2_2", data=values[::2, ::2, ::2])
            small.attrs["subsample_spacing"] = np.array([2, 2, 2])
    options = {"dataset": f"/Chimera/{group}/data_zyx"} if one.chance(0.2) else {}
    steps = [turn[:, a] * step[a] for a in (2, 1, 0)]
    return compare.differs_in_world(one, path, compare.InWorld(values, _affine(steps, origin), "angstrom"), **options)


def _scaled_axes(one, shape):
    """Names, offsets, scales and a common unit."""
    names = [str(n) for n in one.random.permutation(list("xyz"))] if one.chance(0.5) else ["z", "y", "x"]
    offsets, scales = one.random.normal(size=3) * 10, one.random.uniform(0.1, 5, 3) * one.random.choice([1, 1, -1], 3)
    scales[np.array(shape) == 1] = 1
    return names, offsets, scales, one.pick(*UNITS)


def _by_axes(values, names, offsets, scales, unit):
    affine = np.zeros((4, 4))
    affine[3, 3] = 1
    for i, name in enumerate(names):
        affine["xyz".index(name), i], affine["xyz".index(name), 3] = scales[i], offsets[i]
    return compare.InWorld(values, affine, unit)


def hspy(one):
    shape = _shape(one)
    values = compare.numbers(one, shape, one.pick(*compare.KINDS))
    names, offsets, scales, unit = _scaled_axes(one, shape)
    path = one.folder / "v.hspy"
    with h5py.File(path, "w") as file:
        file.attrs["file_format"], file.attrs["file_format_version"] = "HyperSpy", "3.3"
        group = file.create_group("Experiments/" + one.pick("signal", "__unnamed__"))
        group.create_dataset("data", data=values, **_storage(one, shape))
        for i in range(3):
            axis = group.create_group(f"axis-{i}")
            axis.attrs.update({"name": names[i], "scale": scales[i], "offset": offsets[i], "size": shape[i], "units": unit,
                               "navigate": bool(i == 0), "is_binned": False, "_type": "UniformDataAxis"})
        group.create_group("metadata/General").attrs["title"] = "v"
        group.create_group("original_metadata")
    return compare.differs_in_world(one, path, _by_axes(values, names, offsets, scales, UNITS[unit]))


def emd(one):
    shape = _shape(one)
    values = compare.numbers(one, shape, one.pick(*compare.KINDS))
    names, offsets, scales, unit = _scaled_axes(one, shape)
    said = {"um": "[u_m]", "nm": "[n_m]", "mm": "[m_m]"}
    path, name = one.folder / "v.emd", one.pick("data/tomography", "experimental/a b")
    with h5py.File(path, "w") as file:
        file.attrs["version_major"], file.attrs["version_minor"] = 0, 2
        group = file.create_group(name)
        group.attrs["emd_group_type"] = one.pick(1, np.uint8(1))
        group.create_dataset("data", data=values, **_storage(one, shape))
        for i in range(3):
            numbers = offsets[i] + scales[i] * np.arange(shape[i])
            dim = group.create_dataset(f"dim{i + 1}", data=numbers[:2] if one.chance(0.3) else numbers)
            dim.attrs["name"], dim.attrs["units"] = one.pick(names[i], np.bytes_(names[i])), said.get(unit, unit)
    return compare.differs_in_world(one, path, _by_axes(values, names, offsets, scales, UNITS[unit]))


def velox(one):
    ny, nx = _shape(one, 2)
    frames = int(one.random.integers(1, 5))
    values = compare.numbers(one, (ny, nx, frames), one.pick("u2", "i2", "u1", "f4"))
    size, offset = one.random.uniform(1e-11, 1e-6, 2), one.random.normal(size=2) * 1e-6
    text = json.dumps({"Core": {"MetadataDefinitionVersion": "7.9"}, "BinaryResult": {
        "PixelSize": {"width": repr(float(size[0])), "height": repr(float(size[1]))}, "PixelUnitX": "m", "PixelUnitY": "m",
        "Offset": {"x": repr(float(offset[0])), "y": repr(float(offset[1]))}}})
    path = one.folder / "v.emd"
    with h5py.File(path, "w") as file:
        group = file.create_group("Data/Image/" + one.pick("f5a4ba0965a5444b8c46cc420cf7fef0", "a"))
        group.create_dataset("Data", data=values, **_storage(one, values.shape))
        column = np.zeros(len(text) + 200, "u1")
        column[:len(text)] = np.frombuffer(text.encode(), "u1")
        group["Metadata"] = np.repeat(column[:, None], frames, 1)
        file["Version"] = '{"format":"Velox"}'
    frame = int(one.random.integers(frames))
    options = {"index": {"frame": frame}} if frames > 1 or one.chance(0.3) else {}
    step = [size[1] if ny > 1 else 1, size[0] if nx > 1 else 1]
    affine = _affine([(0, 0, 1), (0, step[0], 0), (step[1], 0, 0)], (offset[0], offset[1], 0))
    return compare.differs_in_world(one, path, compare.InWorld(values[None, :, :, frame], affine, "m"), **options)


KINDS = {"minc1": minc1, "minc2": minc2, "itk": itk, "imaris": imaris, "ilastik": ilastik, "cmap": cmap, "hspy": hspy, "emd": emd,
         "velox": velox}
