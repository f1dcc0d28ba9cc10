"""Random volumes that are difficult for a surface: shapes, values, positions."""
import dataclasses

import numpy as np


@dataclasses.dataclass
class Volume:
    """Values [z, y, x] and positions: node (x, y, z) is at origin + axes @ (spacing * node); the axes' columns are unit
    vectors."""
    u: np.ndarray
    spacing: np.ndarray
    origin: np.ndarray
    axes: np.ndarray
    what: str
    raw: object = None  # the values as passed to isonest, with `missing` for missing values
    missing: object = None

    @property
    def turned(self):
        return not np.array_equal(self.axes, np.eye(3))

    @property
    def unit(self):
        """The smallest spacing, the judges' unit of length."""
        return self.spacing.min()

    @property
    def scale(self):
        return self.spacing / self.unit

    def nodes(self, world):
        """World coordinates of points, which are in nodes x, y, z."""
        return ((np.asarray(world, float).reshape(-1, 3) - self.origin) @ self.axes) / self.spacing

    def world(self, nodes):
        return self.origin + (np.asarray(nodes, float) * self.spacing) @ self.axes.T

    def save(self, one, isonest, name="v", **options):
        """Its store. A rotated volume is written as an NRRD file, others are passed as arrays."""
        store = one.folder / f"{name}.isonest"
        values = self.u if self.raw is None else self.raw
        if self.missing is not None:
            options["missing"] = self.missing
        if not self.turned and options.get("labels"):
            path = one.folder / f"{name}.npy"
            np.save(path, values)
            isonest.preprocess(path, store, spacing=self.spacing[::-1], origin=self.origin[::-1], replace=True, **options)
            return isonest.open(store)
        if not self.turned:
            isonest.preprocess(values, store, spacing=self.spacing[::-1], origin=self.origin[::-1], replace=True, **options)
            return isonest.open(store)
        kinds = {"u1": "uint8", "i1": "int8", "u2": "uint16", "i2": "int16", "u4": "uint32", "i4": "int32", "f4": "float",
                 "f8": "double"}
        directions = " ".join("(" + ",".join(repr(float(c)) for c in self.axes[:, a] * self.spacing[a]) + ")" for a in range(3))
        path = one.folder / f"{name}.nrrd"
        path.write_bytes((f"NRRD0004\ntype: {kinds[values.dtype.str[1:]]}\ndimension: 3\nspace dimension: 3\nsizes: "
                          f"{' '.join(map(str, self.u.shape[::-1]))}\nendian: little\nencoding: raw\n"
                          f"space directions: {directions}\nspace origin: "
                          f"({','.join(repr(float(o)) for o in self.origin)})\n\n").encode()
                         + np.ascontiguousarray(values).tobytes())
        isonest.preprocess(path, store, replace=True, **options)
        return isonest.open(store)


def _axes(shape):
    z, y, x = np.meshgrid(*(np.arange(n, dtype=float) for n in shape), indexing="ij")
    return x, y, z


def shape(one, most=24, least=2):
    """Numbers of nodes z, y, x: small, near powers of two, or any."""
    def along():
        return int(one.pick(2, 3, 4, 5, 8, 9, 16, 17, int(one.random.integers(2, 8)), int(one.random.integers(2, most + 1)),
                            int(one.random.integers(2, most + 1))))
    kind = one.random.integers(12)
    if kind == 0:
        sizes = [1, 1, 1]
        sizes[one.random.integers(3)] = int(one.random.integers(2, 41))
    elif kind == 1:
        sizes = [2, 2, 2]
        sizes[one.random.integers(3)] = int(one.random.integers(2, 41))
    elif kind == 2:
        sizes = [int(one.pick(7, 8, 9, 15, 16, 17))] * 3
    elif kind == 3 and least == 1:
        sizes = [along() for _ in range(3)]
        sizes[one.random.integers(3)] = 1
    else:
        sizes = [along() for _ in range(3)]
    return tuple(max(least, min(n, 41)) for n in sizes)


def _tori(one, shape):
    step, large = one.random.uniform(6, 12), one.random.uniform(1.5, 4.5)
    x, y, z = (np.mod(c + one.random.uniform(0, 9), step) - step / 2 for c in _axes(shape))
    return one.random.uniform(0.4, 1.3) - np.hypot(np.hypot(x, y) - large, z)


def _gyroid(one, shape):
    x, y, z = (2 * np.pi * c / one.random.uniform(4, 30) for c in _axes(shape))
    return np.sin(x) * np.cos(y) + np.sin(y) * np.cos(z) + np.sin(z) * np.cos(x)


def _ball(one, shape):
    centre = one.random.random(3) * shape[::-1]
    squash = one.random.uniform(0.3, 2, 3)
    return np.sqrt(sum(((c - m) * s) ** 2 for c, m, s in zip(_axes(shape), centre, squash)))


def _sheets(one, shape):
    normal = one.random.normal(size=3) if one.chance(0.6) else np.eye(3)[one.random.integers(3)]
    level = np.floor(sum(n * c for n, c in zip(normal, _axes(shape))))
    middle = level.flat[one.random.integers(level.size)]
    return ((level == middle) | (level == middle + one.pick(0, 2, 3))).astype(float)


def _needle(one, shape):
    x, y, z = _axes(shape)
    return np.hypot(y - one.random.random() * shape[1], z - one.random.random() * shape[0]) - x / one.random.uniform(5, 60)


def _bumps(one, shape):
    u = np.zeros(shape)
    count = int(one.random.integers(1, 12))
    u[tuple(one.random.integers(0, n, count) for n in shape)] = one.pick(1, 255, 1e6)
    return u


def _plateau(one, shape):
    r = _ball(one, shape)
    a, b = np.sort(one.random.random(2)) * r.max()
    return 1 + (r > b) - (r < a).astype(float)


SHAPES = {
    "noise": lambda one, shape: one.random.random(shape),
    "few values": lambda one, shape: one.random.integers(0, one.pick(2, 3, 5), shape).astype(float),
    "checkerboard": lambda one, shape: sum(_axes(shape)) % 2,
    "blocks": lambda one, shape: sum(np.floor(c / one.pick(2, 3, 4)) for c in _axes(shape)) % 2,
    "gyroid": _gyroid,
    "noisy gyroid": lambda one, shape: _gyroid(one, shape) + one.random.normal(0, one.pick(0.01, 0.1, 1), shape),
    "ball": _ball,
    "shells": lambda one, shape: np.rint(_ball(one, shape)) % one.pick(2, 3, 4),
    "tori": _tori,
    "sheets": _sheets,
    "needle": _needle,
    "bumps": _bumps,
    "plateau": _plateau,
    "ramp": lambda one, shape: sum(int(one.random.integers(-2, 3)) * c for c in _axes(shape)),
    "constant": lambda one, shape: np.full(shape, one.pick(0.0, 3.0, -7.5)),
    "smooth": lambda one, shape: sum(np.sin(c * one.random.uniform(0.05, 0.6) + one.random.random()) for c in _axes(shape)),
    "steep": lambda one, shape: np.exp(np.clip(one.random.uniform(0.5, 3) * (_ball(one, shape) - 5), -40, 40)),
}


def turn(one):
    """Random right-handed directions: orthogonal columns."""
    q, r = np.linalg.qr(one.random.normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    if np.linalg.det(q) < 0:
        q[:, 0] = -q[:, 0]
    return q


def place(one, extremes=True):
    """Spacing, origin, axes."""
    spacing, origin, axes = np.ones(3), np.zeros(3), np.eye(3)
    kind = one.random.integers(10)
    if kind < 3:
        spacing = one.random.uniform(0.3, 3, 3)
    elif kind == 3:
        spacing[one.random.integers(3)] = one.pick(100, 0.01, 10)
    elif kind == 4 and extremes:
        spacing = spacing * one.pick(1e-6, 1e6, 1e-20, 1e20, 1e-30, 1e30)
    if one.chance(0.3):
        origin = one.random.normal(size=3) * 20 * spacing
    elif one.chance(0.15) and extremes:
        origin = one.random.normal(size=3) * spacing * one.pick(1e4, 1e6)
    if one.chance(0.2):
        axes = turn(one)
    return spacing, origin, axes


def volume(one, most=24, least=2, missing=True, turned=True, extremes=True):
    """A volume of any kind."""
    sizes = shape(one, most, least)
    what = list(SHAPES)[one.random.integers(len(SHAPES))]
    u = SHAPES[what](one, sizes)
    kind = one.random.integers(10)
    if kind < 3:
        u = u.astype("f4")
    elif kind == 3:
        u = 1e9 + one.pick(1, 1e-3, 100) * u
    elif kind == 4:
        u = (u * one.pick(1e-20, 1e-6, 1e12)).astype("f4")
    elif kind < 9:
        dtype = np.dtype(one.pick("u1", "i1", "u2", "i2", "u4", "i4"))
        info, low, high = np.iinfo(dtype), u.min(), u.max()
        if one.chance(0.5) or low < info.min or high > info.max:  # all of the type's range, or part of it
            part = one.pick(1, 1, 0.1) if info.bits > 8 else 1
            u = (u - low) / ((high - low) or 1) * (float(info.max) - info.min) * part + info.min
        u = np.clip(np.rint(u), info.min, info.max).astype(dtype)
    if u.dtype.kind == "f" and missing and one.chance(0.3):
        u = u.copy()
        bad = one.pick(np.nan, np.inf, -np.inf)
        how = one.random.integers(5)
        if how == 0:
            u[one.random.random(sizes) < 0.02] = bad
        elif how == 1:
            u[_ball(one, sizes) < one.random.uniform(1, 6)] = bad
        elif how == 2:
            u[one.random.integers(sizes[0])] = bad
        elif how == 3:
            u[:, :, :one.random.integers(sizes[2] + 1)] = bad
        elif one.chance(0.3):
            u[...] = bad
        what += ", missing"
    spacing, origin, axes = place(one, extremes)
    if not turned:
        axes = np.eye(3)
    made = Volume(u, spacing, origin, axes, what)
    if missing and u.dtype.kind != "f" and one.chance(0.1):
        made.raw, made.missing = u, float(u.flat[one.random.integers(u.size)])
        made.u = np.where(u == made.missing, np.nan, u.astype(float))
        made.what += ", missing"
    return made


def isovalue(one, u):
    """Between the values, equal to one of them, or at the ends."""
    good = u[np.isfinite(u)].astype(float) if u.dtype.kind == "f" else u.astype(float).ravel()
    if not good.size:
        return 0.5
    kind = one.random.integers(8)
    if kind < 2:
        return float(good[one.random.integers(good.size)])
    if kind == 2:
        return float(one.pick(good.min(), good.max()))
    if kind == 3:
        return float(np.nextafter(good[one.random.integers(good.size)], one.pick(-np.inf, np.inf)))
    if kind == 4:
        return float((good.min() + good.max()) / 2)
    a, b = one.random.choice(good, 2)
    return float(a + (b - a) * one.random.random())


def error(one, u):
    """A tolerance: none, tiny, some, or more than the range."""
    good = u[np.isfinite(u)].astype(float) if u.dtype.kind == "f" else u.astype(float).ravel()
    size = float(np.ptp(good)) if good.size else 1.0
    return float(one.pick(0, 1e-6 * size, size * one.random.random() ** 2, size * one.random.random() ** 2,
                          size * one.random.random() ** 4, 2 * size, 1))
