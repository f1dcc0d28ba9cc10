"""Random MRC files: modes, both byte orders, axes in any order, cells, origins and starts, stacks of volumes, gzip.

mrcfile writes the header's fields by MRC2014 and reads the file again: numbers, their order, voxel size; the place is by the rule of
SOURCES.md: the origin, else the start.
"""
import gzip

import numpy as np

import attack

from . import volumes

mrcfile = attack.require("mrcfile")
from mrcfile.dtypes import HEADER_DTYPE  # noqa: E402

MODES = {0: "i1", 1: "i2", 2: "f4", 6: "u2", 12: "f2"}
IMOD = 1146047817


def mrc(one):
    mode = one.pick(*MODES)
    order = one.pick("<", ">")
    dtype = np.dtype(MODES[mode])
    shape = np.array(volumes.sizes(one))  # columns, rows, sections
    stack = int(one.random.integers(1, 4)) if one.chance(0.2) else 0
    stored = volumes.numbers(one, dtype, (*([stack] if stack else []), *shape[::-1]))
    header = np.zeros((), HEADER_DTYPE.newbyteorder(order))
    header["map"] = b"MAP "
    header["machst"] = {"<": one.pick((0x44, 0x44, 0, 0), (0x44, 0x41, 0, 0)), ">": (0x11, 0x11, 0, 0)}[order]
    header["nx"], header["ny"], header["nz"] = shape[0], shape[1], shape[2] * max(stack, 1)
    header["mode"] = mode
    along = [1, 2, 3]
    if one.chance(0.4) and not stack:
        along = [int(a) + 1 for a in one.random.permutation(3)]
    header["mapc"], header["mapr"], header["maps"] = along if one.chance(0.95) else ([0, 0, 0] if along == [1, 2, 3] else along)
    size = np.float32(volumes.spacing(one))  # of a voxel along the world's axes
    nodes = np.zeros(3, int)
    nodes[np.array(along) - 1] = shape  # along the world's
    sampling = nodes.copy()
    if one.chance(0.2) and not stack:
        sampling = nodes * 2 + 1  # the map is a part of its cell
    header["mx"], header["my"], header["mz"] = sampling
    has_cell = one.chance(0.85)
    cell = np.float32(size * sampling) if has_cell else np.zeros(3, "f4")
    header["cella"]["x"], header["cella"]["y"], header["cella"]["z"] = cell
    angles = one.pick((90, 90, 90), (90, 90, 90), (0, 0, 0), (90, 90, 120))
    header["cellb"]["alpha"], header["cellb"]["beta"], header["cellb"]["gamma"] = angles
    header["ispg"] = 401 if stack else one.pick(0, 1, 1)
    start = one.random.integers(-200, 200, 3) * one.chance(0.5)
    header["nxstart"], header["nystart"], header["nzstart"] = start
    at = np.float32(volumes.origin(one)) * np.float32(one.chance(0.5))
    header["origin"]["x"], header["origin"]["y"], header["origin"]["z"] = at
    extended = one.random.bytes(int(one.pick(0, 0, 0, 80, 1024, 13)))
    header["nsymbt"] = len(extended)
    header["nversion"] = one.pick(0, 20140, 20141)
    unsigned = mode == 0 and one.chance(0.3)
    imod = unsigned or one.chance(0.2)
    words = np.frombuffer(bytearray(header.tobytes()), order + "i4").copy()
    if imod:
        words[38], words[39] = IMOD, 0 if unsigned else int(one.pick(1, 3, 5))
    raw = stored.astype(dtype.newbyteorder(order)).tobytes()
    data = words.tobytes() + extended + raw + b"\0" * (int(one.random.integers(1, 9)) if one.chance(0.1) else 0)
    path = one.folder / one.pick("v.mrc", "v.map", "v.rec", "v.st")
    if one.chance(0.2):
        path = path.with_name(path.name + ".gz")
        data = gzip.compress(data, 1)
    path.write_bytes(data)

    chosen = stored
    options = {}
    must = None
    if stack:
        which = int(one.random.integers(stack))
        chosen = stored[which]
        if stack > 1:
            if one.chance(0.1):
                must = ("several volumes, none named", "index")
            else:
                options["index"] = {"volume": which}
    if unsigned:
        chosen = chosen.view("u1")
    judged = _mrcfile_differs(path, stored, size if has_cell else None, bool(imod))
    if judged:
        return attack.wrong("mrcfile and the attacker disagree: " + judged)
    voxel = cell.astype("f8") / sampling if has_cell else np.ones(3)
    # [sections, rows, columns] to the world's [z, y, x].
    values = np.transpose(chosen, [2 - along.index(world) for world in (3, 2, 1)])
    place = at.astype("f8") if at.any() else np.array([start[along.index(w)] * voxel[w - 1] for w in (1, 2, 3)], "f8")
    volume = volumes.Volume(values, volumes.affine_of(np.eye(3), voxel, place), "angstrom" if has_cell else None,
                            must_refuse=must, options=options)
    if has_cell and angles[2] == 120:  # skewed
        volume.must_refuse = ("angles that are not right", "not at right angles")
    return volumes.compared(one, path, volume)


def _mrcfile_differs(path, stored, size, imod):
    try:
        file = mrcfile.open(path, permissive=True)
    except Exception:
        return None
    with file:
        if file.data is None:
            return None
        data = file.data.reshape(stored.shape)
        if not imod and not np.array_equal(data, stored, equal_nan=data.dtype.kind == "f"):
            return f"values of {data.dtype}"
        if size is not None and not np.allclose([file.voxel_size[k] for k in "xyz"], size, rtol=1e-5):
            return f"voxels {file.voxel_size} and {size}"
    return None
