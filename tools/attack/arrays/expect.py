"""What a store of a valid file has to be, and whether it is so."""
import re

import numpy as np

import attack

STORED = {"b1": "u1", "i8": "f8", "u8": "f8", "f2": "f4"}  # the store's type of numbers that it does not have
WHOLE = 2**53
METRES = {"km": 1e3, "m": 1.0, "dm": 1e-1, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "nm": 1e-9, "angstrom": 1e-10, "pm": 1e-12,
          "ft": 0.3048, "in": 0.0254}
TYPES = ("u1", "i1", "u2", "i2", "u4", "i4", "u8", "i8", "f2", "f4", "f8")


def numbers(one, shape, kind, missing=True):
    """Of the whole range of a type, or few different ones. 64-bit integers are within 2^53."""
    kind = np.dtype(kind)
    random = one.random
    if kind.kind == "b":
        return random.random(shape) < 0.5
    few = one.chance(0.2)
    if kind.kind == "f":
        data = (random.integers(-3, 4, shape) / 2 if few else random.normal(size=shape) * 10.0 ** one.pick(-3, 0, 3)).astype(kind)
        if missing and data.size and one.chance(0.1):
            data.reshape(-1)[random.integers(data.size)] = one.pick(np.nan, np.inf, -np.inf)
        if data.size and one.chance(0.1):
            data.reshape(-1)[random.integers(data.size)] = one.pick(-0.0, np.finfo(kind).tiny, np.finfo(kind).max)
        return data
    low, high = np.iinfo(kind).min, np.iinfo(kind).max
    if kind.itemsize == 8:
        low, high = max(low, -WHOLE), WHOLE
    if few:
        low, high = max(low, -2), min(high, 5)
    return random.integers(low, high, shape, dtype=kind.newbyteorder("="), endpoint=True)


def stored(data):
    """The numbers as a store has them."""
    data = np.asarray(data)
    return data.astype(STORED.get(data.dtype.str[1:], data.dtype.str[1:]))


def reason(error):
    """An error's message without what differs from file to file."""
    text = re.sub(r"'[^']*'", "'...'", str(error).splitlines()[0])
    text = re.sub(r"(/[^\s:]*)+", "PATH", text)
    text = re.sub(r"; its axes.*|; choose .*", "", text.split(": ", 1)[-1])
    return re.sub(r"-?\d[\d.e+-]*( x N)*", "N", text)[:160]


def check(one, path, data, options=None, *, spacing=None, origin=None, unit=None, refused=None):
    """Compares the store of `path` with [z, y, x] or fewer axes of numbers.

    options: of isonest.preprocess(). spacing, origin: [z, y, x], of 1 and 0 if there are none. unit: a symbol, or none. refused: words of the error that
    has to come; with None one is wrong. Words that begin with "may: " come, or the numbers do.
    """
    isonest = attack.package(one.program)
    store = one.folder / "of.isonest"
    may = refused is not None and refused.startswith("may: ")
    words = refused[5:] if may else refused
    try:
        isonest.preprocess(path, store, chunk=8, threads=1, **{"memory": "64M", **(options or {})})
    except (isonest.Error, TypeError) as error:
        if words is None:
            return attack.wrong(f"refused: {type(error).__name__}: {error}")
        if words not in str(error):
            return attack.wrong(f"refused, but not for '{words}': {error}")
        return attack.refused(f"{type(error).__name__}: {reason(error)}")
    if words is not None and not may:
        return attack.wrong(f"it has to be refused for '{words}', and is read")
    data = stored(data)
    data = data.reshape((1,) * (3 - data.ndim) + data.shape)
    with isonest.open(store) as made:
        found = np.asarray(made.values(0))
        found = found.reshape((1,) * (3 - found.ndim) + found.shape)
        place = (made.spacing, made.origin)
        found_unit = made.unit
        misses = made.has_missing
    if found.shape != data.shape:
        return attack.wrong(f"shape {found.shape}, but {data.shape} is right")
    if found.dtype != data.dtype:
        return attack.wrong(f"type {found.dtype}, but {data.dtype} is right")
    right = np.where(np.isfinite(data), data, np.nan) if data.dtype.kind == "f" else data
    seen = np.where(np.isfinite(found), found, np.nan) if data.dtype.kind == "f" else found
    if not np.array_equal(seen, right, equal_nan=data.dtype.kind == "f"):
        bad = np.argwhere(~((seen == right) | ((seen != seen) & (right != right))))
        return attack.wrong(f"{len(bad)} of {data.size} values differ, first at {tuple(bad[0])}: "
                            f"{found[tuple(bad[0])]!r}, but {data[tuple(bad[0])]!r} is right")
    if misses != bool(data.dtype.kind == "f" and not np.isfinite(data).all()):
        return attack.wrong(f"has_missing is {misses}")
    for what, found_place, right_place in (("spacing", place[0], spacing or (1, 1, 1)), ("origin", place[1], origin or (0, 0, 0))):
        axes = [a for a in range(3) if what == "origin" or data.shape[a] > 1]
        near = np.allclose(np.asarray(found_place)[axes], np.asarray(right_place, float)[axes], rtol=1e-6, atol=1e-12)
        if not near:
            return attack.wrong(f"{what} {found_place}, but {right_place} is right")
    if found_unit != unit:
        return attack.wrong(f"unit {found_unit}, but {unit} is right")
    return attack.SAME


def by_unit(units, lengths):
    """The store's unit and the factor of each axis, both in [z, y, x]: that of x, if all axes of more than one node have one.

    units: of each axis a symbol, None for a word that is none of length, "" for nothing.
    """
    long = [a for a in (2, 1, 0) if lengths[a] > 1 or units[a] != ""]
    if not long or all(units[a] == "" for a in long) or any(not units[a] for a in long):
        return None, [1, 1, 1]
    unit = units[long[0]]
    return unit, [METRES[units[a]] / METRES[unit] if units[a] else 1 for a in range(3)]
