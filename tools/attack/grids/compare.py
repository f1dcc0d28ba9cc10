"""What isonest makes of a file, and what it should have made of it."""
import dataclasses
import re

import attack
import numpy as np

MOST_EXACT = 2**53
ALONG_WORLD = (1, 0, 0, 0, 1, 0, 0, 0, 1)
HALF_TURN = (-1, 0, 0, 0, 1, 0, 0, 0, -1)  # about y
KINDS = ("i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8")


@dataclasses.dataclass
class Expected:
    values: np.ndarray  # [z, y, x]; NaN is missing
    spacing: tuple = (1, 1, 1)  # x, y, z
    origin: tuple = (0, 0, 0)
    direction: tuple = ALONG_WORLD  # of axis x, then y, then z; NaN: any
    unit: object = None
    single: bool = False  # values may be rounded to float32
    refusals: tuple = ()  # expressions: what is refused on purpose
    may_be_turned: bool = False  # a stream whose z runs backward is kept in that order, turned half around y


def numbers(one, shape, kind):
    """Random numbers of a type: all of its range, a small one, few values, or smooth."""
    kind = np.dtype(kind)
    way = one.pick("wide", "narrow", "few", "smooth", "smooth")
    if kind.kind == "f":
        if way == "wide":
            made = one.random.normal(size=shape) * 10.0 ** one.random.integers(-30, 30)
        elif way == "few":
            made = one.random.integers(-2, 3, shape) * 0.5
        else:
            made = one.random.normal(size=shape) * 100
        return made.astype(kind)
    info = np.iinfo(kind)
    low, high = max(info.min, -MOST_EXACT), min(info.max, MOST_EXACT)
    if way == "narrow":
        low, high = max(low, -100), min(high, 100)
    elif way == "few":
        low, high = max(low, 0), 3
    return one.random.integers(low, high, shape, dtype=kind, endpoint=True)


def differs(one, path, expected, **options):
    """The result of a try: preprocess() of `path`, and its store against what is expected."""
    isonest = attack.package(one.program)
    store_path = one.folder / "s.isonest"
    try:
        isonest.preprocess(path, store_path, threads=1, chunk=one.pick(8, 16, 32, 64), **{"memory": "256M", **options})
    except isonest.Error as error:
        why = attack.reason(error.problem or error, one.folder)
        if any(re.search(pattern, str(error)) for pattern in expected.refusals):
            return attack.refused(why)
        return attack.wrong(f"refused: {error}\nbecause: {why}")
    if expected.refusals and "must" in expected.refusals:
        return attack.wrong("it is read, but should be refused")
    store = isonest.open(store_path)
    found = store.values(0)
    if expected.may_be_turned and np.array_equal(np.ravel(store.direction), HALF_TURN) and expected.direction == ALONG_WORLD:
        expected = _turned(expected)
    values = np.asarray(expected.values)
    if found.shape != values.shape:
        return attack.wrong(f"shape {found.shape}, not {values.shape}")
    problem = _values(found, values, expected.single)
    if problem:
        return attack.wrong(problem)
    missing = bool((~np.isfinite(values)).any()) if values.dtype.kind == "f" else False
    if store.has_missing != missing:
        return attack.wrong(f"has_missing is {store.has_missing}")
    scale = np.abs(expected.spacing)
    if not np.allclose(store.spacing[::-1], expected.spacing, rtol=1e-7, atol=0):
        return attack.wrong(f"spacing {store.spacing[::-1]}, not {expected.spacing}")
    far = np.abs(np.array(store.origin[::-1]) - expected.origin)
    if not (far <= 1e-6 * scale + 1e-9 * np.abs(expected.origin)).all():
        return attack.wrong(f"origin {store.origin[::-1]}, not {expected.origin}")
    if not (np.isnan(expected.direction) | (np.abs(np.ravel(store.direction) - expected.direction) <= 1e-6)).all():
        return attack.wrong(f"direction {np.ravel(store.direction)}, not {expected.direction}")
    if store.unit != expected.unit:
        return attack.wrong(f"unit {store.unit}, not {expected.unit}")
    return attack.SAME


@dataclasses.dataclass
class InWorld:
    """Values by the indices that an independent reader has, and the world's place of an index."""
    values: np.ndarray  # [i, j, k]; NaN is missing
    affine: np.ndarray  # 4 x 4
    unit: object = None
    frame: str = "unknown"
    refusals: tuple = ()
    tolerance: float = 2.0  # in units of the last place


def differs_in_world(one, path, expected, **options):
    """The result of a try: every node of the store has the value that the reader has at its place."""
    isonest = attack.package(one.program)
    store_path = one.folder / "s.isonest"
    try:
        isonest.preprocess(path, store_path, threads=1, chunk=one.pick(8, 16, 32, 64), **{"memory": "256M", **options})
    except isonest.Error as error:
        why = attack.reason(error.problem or error, one.folder)
        if any(re.search(pattern, str(error)) for pattern in expected.refusals):
            return attack.refused(why)
        return attack.wrong(f"refused: {error}\nbecause: {why}")
    if "must" in expected.refusals:
        return attack.wrong("it is read, but should be refused")
    store = isonest.open(store_path)
    found = store.values(0)
    values = np.asarray(expected.values)
    if found.size != values.size:
        return attack.wrong(f"{found.size} values ({found.shape}), not {values.size} ({values.shape})")
    spacing, origin = np.array(store.spacing[::-1]), np.array(store.origin[::-1])
    steps = np.reshape(store.direction, (3, 3)) * spacing[:, None]
    nodes = np.stack(np.meshgrid(*(np.arange(n) for n in found.shape), indexing="ij"), -1).reshape(-1, 3)[:, ::-1]
    world = origin + nodes @ steps
    at = (world - expected.affine[:3, 3]) @ np.linalg.inv(expected.affine[:3, :3]).T
    index = np.rint(at).astype(int)
    if np.abs(at - index).max() > 0.11:  # a tenth of a voxel is taken for straight
        return attack.wrong(f"nodes lie up to {np.abs(at - index).max()} of a step beside the reader's")
    if (index < 0).any() or (index >= values.shape).any() or len(np.unique(index, axis=0)) != len(index):
        return attack.wrong(f"nodes lie elsewhere: {index.min(0)} to {index.max(0)} of {values.shape}")
    problem = _near(found.ravel(), values[tuple(index.T)], expected.tolerance)
    if problem:
        return attack.wrong(problem)
    if store.unit != expected.unit:
        return attack.wrong(f"unit {store.unit}, not {expected.unit}")
    if hasattr(store, "frame") and str(store.frame or "unknown").upper() != expected.frame.upper():
        return attack.wrong(f"frame {store.frame}, not {expected.frame}")
    return attack.SAME


def _near(found, values, tolerance):
    with np.errstate(over="ignore", invalid="ignore"):
        scale = np.nanmax(np.abs(values[np.isfinite(values)]), initial=0) if values.dtype.kind == "f" else 0
        eps = np.finfo(found.dtype).eps * scale * tolerance if found.dtype.kind == "f" else 0
        same = (np.abs(found.astype("f8") - values.astype("f8")) <= eps) | (found == values) | \
            (np.isnan(found.astype("f8")) & np.isnan(values.astype("f8")))
    if same.all():
        return ""
    at = int(np.argmin(same))
    return f"{(~same).sum()} of {same.size} values differ, first: {found[at]}, not {values[at]}"


def _turned(expected):
    shape, spacing = np.array(expected.values.shape[::-1]), np.array(expected.spacing)
    origin = np.array(expected.origin) + spacing * (shape - 1) * (1, 0, 1)
    return dataclasses.replace(expected, values=expected.values[::-1, :, ::-1], origin=tuple(origin), direction=HALF_TURN)


def _values(found, values, single):
    if values.dtype.kind != "f" and found.dtype.kind != "f":
        same = found.astype(object) == values.astype(object) if found.dtype != values.dtype else found == values
    else:
        if found.dtype == np.float32 and not single and values.dtype != np.float32:
            return "float32, which the numbers do not fit into"
        with np.errstate(over="ignore", invalid="ignore"):  # rounding to float32; differences of infinities
            to = values.astype(found.dtype)
            # A scale may be applied in another order of operations: the last place may differ.
            near = np.abs(found - to) <= (np.finfo(found.dtype).eps * np.abs(to) * 2 if found.dtype.kind == "f" else 0)
        same = (found == to) | near | (np.isnan(found) & np.isnan(to)) if found.dtype.kind == "f" else found == to
    if not same.all():
        at = tuple(int(i) for i in np.argwhere(~same)[0])
        return f"{(~same).sum()} of {same.size} values differ, first at {at}: {found[at]}, not {values[at]}"
    return ""
