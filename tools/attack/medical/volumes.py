"""What the kinds of valid_medical.py share: random numbers and places, and the comparison of a store with them.

A volume is what a file means by its format's specification: `values` [z, y, x], the world's position of the node (i, j, k)
as `affine` @ (i, j, k, 1), the unit of length. The store may have turned axes around, and nothing else.
"""
import dataclasses
import math
import re

import numpy as np

import attack

SAME_PLACE = 2e-5  # of a voxel: what float32 and decimal numbers of headers leave
MOST_SHIFT = 0.1  # of a voxel: what SOURCES.md allows where axes are all but straight


@dataclasses.dataclass
class Volume:
    values: np.ndarray
    affine: np.ndarray = None
    unit: str = None
    dtype: object = None  # of the store, where a rule says it; else the values' own
    must_refuse: tuple = None  # (why, what the message has to say): a file that must not be read
    may_refuse: tuple = ()  # more such pairs, each of a file that may be refused
    options: dict = dataclasses.field(default_factory=dict)
    loose: bool = False  # its axes are all but straight: within MOST_SHIFT
    place: bool = True  # whether the place is compared


def sizes(one, most=9):
    """Nodes along x, y, z; 1 is frequent."""
    return tuple(1 if one.chance(0.12) else int(one.random.integers(2, most + 1)) for _ in range(3))


def numbers(one, dtype, shape):
    """Any number of the type, its ends among them."""
    dtype = np.dtype(dtype)
    count = int(np.prod(shape))
    if dtype.kind == "f":
        values = (one.random.normal(size=count) * 10.0 ** one.random.integers(-4, 4)).astype(dtype)
        if one.chance(0.15):
            values[one.random.integers(count)] = one.pick(np.nan, np.inf, -np.inf)
        return values.reshape(shape)
    limits = np.iinfo(dtype)
    if one.chance(0.5):
        low, high = limits.min, limits.max
    else:
        low, high = (0 if limits.min == 0 else -100), 100
    if dtype.itemsize == 8:
        low, high = max(low, -2**53), min(high, 2**53)
    values = one.random.integers(low, high, count, dtype=dtype.newbyteorder("="), endpoint=True)
    if one.chance(0.3):
        values[one.random.integers(count)] = high
        values[one.random.integers(count)] = low
    return values.reshape(shape)


def rotation(one):
    """A direction for each axis as a column, of either hand: the world's axes in any order and sense, or any."""
    way = one.random.random()
    if way < 0.25:
        return np.eye(3)
    if way < 0.5:
        return np.eye(3)[:, one.random.permutation(3)] * one.random.choice([-1.0, 1.0], 3)
    q, _ = np.linalg.qr(one.random.normal(size=(3, 3)))
    return q


def affine_of(directions, spacing, origin):
    affine = np.eye(4)
    affine[:3, :3] = np.asarray(directions) * np.asarray(spacing)
    affine[:3, 3] = origin
    return affine


def spacing(one):
    return 10.0 ** one.random.uniform(-1.5, 1.0, 3) if one.chance(0.8) else np.ones(3)


def origin(one):
    return one.random.uniform(-500, 500, 3) if one.chance(0.8) else np.zeros(3)


def scaled(stored, slope, intercept, stored_range=None):
    """Values and their type, by the rule of the manual (section 2, types); stored_range: the least and largest there can be."""
    stored = np.asarray(stored)
    if slope == 1 and intercept == 0:
        return stored, stored.dtype
    values = slope * stored.astype("f8") + intercept
    kind, width = stored.dtype.kind, stored.dtype.itemsize
    if kind in "iu" and float(slope).is_integer() and float(intercept).is_integer() and width <= 4:
        limits = stored_range or (np.iinfo(stored.dtype).min, np.iinfo(stored.dtype).max)
        ends = sorted(slope * float(end) + intercept for end in limits)
        for name in (stored.dtype.name, "uint8", "int8", "uint16", "int16", "uint32", "int32"):
            to = np.iinfo(name)
            if np.dtype(name).itemsize >= width and ends[0] >= to.min and ends[1] <= to.max:
                return values.astype(name), np.dtype(name)
    name = "f4" if width <= 2 or stored.dtype == np.float32 else "f8"
    with np.errstate(over="ignore"):
        return values.astype(name), np.dtype(name)


def stored_type(dtype):
    """The store's type of a file's numbers that are not scaled."""
    dtype = np.dtype(dtype)
    return np.dtype("f4") if dtype == np.float16 else np.dtype("f8") if dtype.itemsize == 8 else dtype.newbyteorder("=")


def _place_problem(store, volume, flips):
    """How far the corners lie beside where they should, in voxels, or what else is wrong."""
    nz, ny, nx = volume.values.shape
    steps = np.array(store.direction).T * np.array(store.spacing[::-1])
    at = np.array(store.origin[::-1])
    affine = np.eye(4) if volume.affine is None else volume.affine
    lengths = np.linalg.norm(affine[:3, :3], axis=0)
    for corner in np.ndindex(2, 2, 2):
        index = np.array(corner) * (nx - 1, ny - 1, nz - 1)
        own = np.where(flips, np.array((nx, ny, nz)) - 1 - index, index)
        off = at + steps @ own - (affine[:3, :3] @ index + affine[:3, 3])
        shift = np.abs(np.linalg.norm(off) / lengths.min())
        exact = SAME_PLACE * lengths.max() / lengths.min() * (1 + np.abs(affine[:3, 3]).max() / lengths.max() * 1e-2)
        if not shift < (math.sqrt(3) * MOST_SHIFT * lengths.max() / lengths.min() if volume.loose else exact):
            return f"node {tuple(index)} lies {shift:.3g} voxels beside its place"
    return None


def difference(store, volume):
    """What a store has otherwise than a volume, or nothing."""
    values = np.asarray(volume.values)
    have = store.values(0)
    if have.ndim == 2:
        have = have[None]
    if have.shape != values.shape:
        return f"shape {have.shape}, not {values.shape}"
    want = np.dtype(volume.dtype or stored_type(values.dtype))
    if have.dtype != want:
        return f"type {have.dtype}, not {want}"
    flips = np.zeros(3, bool)
    if volume.affine is not None:
        steps = np.array(store.direction).T
        flips = np.sum(steps * volume.affine[:3, :3], axis=0) < 0
    for axis in range(3):
        if flips[axis]:
            values = np.flip(values, 2 - axis)
    with np.errstate(over="ignore", invalid="ignore"):
        values = values.astype(want)
    missing = ~np.isfinite(values) if want.kind == "f" else np.zeros(values.shape, bool)
    if store.has_missing != bool(missing.any()):
        return f"has_missing is {store.has_missing}"
    if missing.any():
        if np.isfinite(have[missing]).any():
            return "a missing value is not missing"
        have, values = have[~missing], values[~missing]
    if not np.array_equal(have, values):
        off = np.argwhere(have != values)[0]
        return f"value at {tuple(off)}: {have[tuple(off)]!r}, not {values[tuple(off)]!r} ({np.sum(have != values)} differ)"
    if volume.place:
        if problem := _place_problem(store, volume, flips):
            return problem
        if np.linalg.det(np.array(store.direction)) < 0.99:
            return f"direction {store.direction} is no right-handed rotation"
        if store.unit != volume.unit:
            return f"unit {store.unit}, not {volume.unit}"
    return None


def compared(one, path, volume):
    """The result of a try: the store that isonest makes of `path` against `volume`."""
    isonest = attack.package(one.program)
    store = one.folder / "made.isonest"
    name = [str(p) for p in path] if isinstance(path, list) else str(path)
    try:
        isonest.preprocess(name, store, chunk=8, threads=1, indicators="linf_bar", **volume.options)
    except isonest.Error as error:
        for why, text in ([volume.must_refuse] if volume.must_refuse else []) + list(volume.may_refuse):
            if re.search(text, str(error)):
                return attack.refused(why)
        return attack.wrong(f"refused: {str(error)[:400]!r}, with {volume.must_refuse}")
    if volume.must_refuse:
        return attack.wrong(f"read, but {volume.must_refuse[0]}")
    problem = difference(isonest.open(store), volume)
    return attack.wrong(problem) if problem else attack.SAME
