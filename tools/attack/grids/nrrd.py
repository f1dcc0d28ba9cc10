"""Random NRRD files by a writer after the definition of the format: https://teem.sourceforge.net/nrrd/format.html

teem reads each file; its numbers, and what it finds of spacings, ends, directions and origin, have to be those that were
written. VTK's reader is no judge: many of them end its process.
"""
import bz2
import gzip
import shutil
import subprocess

import attack
import numpy as np

from . import compare
from .netcdf import LENGTHS

UNU = shutil.which("teem-unu") or shutil.which("unu")
TYPES = {"i1": ("signed char", "int8", "int8_t"), "u1": ("uchar", "unsigned char", "uint8", "uint8_t"),
         "i2": ("short", "short int", "signed short", "signed short int", "int16", "int16_t"),
         "u2": ("ushort", "unsigned short", "unsigned short int", "uint16", "uint16_t"),
         "i4": ("int", "signed int", "int32", "int32_t"), "u4": ("uint", "unsigned int", "uint32", "uint32_t"),
         "i8": ("longlong", "long long", "long long int", "signed long long", "signed long long int", "int64", "int64_t"),
         "u8": ("ulonglong", "unsigned long long", "unsigned long long int", "uint64", "uint64_t"),
         "f4": ("float",), "f8": ("double",)}
ENCODINGS = {"raw": ("raw",), "text": ("txt", "text", "ascii"), "hex": ("hex",), "gzip": ("gz", "gzip"), "bzip2": ("bz2", "bzip2")}
PARTS = {1: ("scalar", "stub"), 2: ("complex", "2-vector"), 3: ("3-color", "RGB-color", "3-vector", "HSV-color", "2D-symmetric-matrix"),
         4: ("4-color", "RGBA-color", "4-vector", "quaternion", "2D-matrix"), 6: ("3D-symmetric-matrix",),
         7: ("3D-masked-symmetric-matrix",), 9: ("3D-matrix",)}
SPACES = {3: ("right-anterior-superior", "RAS", "left-anterior-superior", "LAS", "left-posterior-superior", "LPS",
              "scanner-xyz", "3D-right-handed", "3D-left-handed"),
          4: ("right-anterior-superior-time", "RAST", "left-posterior-superior-time", "LPST", "3D-right-handed-time")}
UNITS = (*LENGTHS, "s", "")
PER_AXIS = ("sizes", "spac", "axis", "cent", "kinds", "labels", "units", "thick", "meas")
COMMENTS = ("# a comment: 3", "#", "##: x", "#sizes: 1 1 1")
KEYS = ("key:=value", "a key:=sizes: 1 1", "k=:=", "space:=none", "k\\n:=a\\\\b\\n")


class File:
    """An NRRD file: its numbers, the lines of its header, and where it says that they lie."""

    def __init__(self, one):
        self.one = one
        self.version = one.pick(1, 2, 3, 4, 4, 4, 5, 5)
        self.refusals = []
        self.numbers_of = {}  # fields that teem has to find with these numbers
        self.unit = None
        self._axes()
        kind = one.pick(*TYPES)
        self.values = compare.numbers(one, self.sizes[::-1], kind)
        if kind[0] == "f" and one.chance(0.15):
            self.values[tuple(one.random.integers(n) for n in self.values.shape)] = one.pick(np.nan, np.inf, -np.inf)
        self.first = ["dimension: " + str(len(self.sizes))]
        self.fields = ["sizes: " + self.list(self.sizes), "type: " + self.word(one.pick(*TYPES[kind]))]
        if self.kinds:
            self.fields.append("kinds: " + self.list([self.word(kind) for kind in self.kinds]))
        (self._directions if self.version >= 4 and self.wide and one.chance(0.6) else self._spacings)()
        self._more()

    def _axes(self):
        one = self.one
        count = one.pick(1, 2, 2, 3, 3, 3, 3, 3, 4, 4)
        self.sizes = [int(one.random.integers(1, 9)) if one.chance(0.9) else int(one.random.integers(9, 30)) for _ in range(count)]
        if count == 4 and one.chance(0.8):
            self.sizes[one.pick(0, 3, 3, int(one.random.integers(4)))] = 1
        self.kinds = []
        others = []  # axes of several positions that are no directions in space
        if self.version >= 3 and one.chance(0.5):
            self.kinds = [one.pick("domain", "space", "???", "none", "domain", "time") for _ in self.sizes]
            if one.chance(0.3):
                at = one.pick(0, int(one.random.integers(count)))
                self.kinds[at] = one.pick("list", "vector", "point", *PARTS.get(self.sizes[at], ()))
            space = [n for n, kind in zip(self.sizes, self.kinds) if kind in ("domain", "space", "???", "none") and n > 1]
            others = [i for i, (n, kind) in enumerate(zip(self.sizes, self.kinds))
                      if n > 1 and kind not in ("domain", "space", "???", "none") and (kind != "time" or len(space) >= 3)]
        self.at = {}
        if others and one.chance(0.1):
            self.refusals += ["volumes along axis", "must"]
        elif others:
            self.at = {i: int(one.random.integers(self.sizes[i])) for i in others}
        left = [i for i in range(count) if i not in self.at]
        for i in one.random.permutation([i for i in left if self.sizes[i] > 1]):
            if sum(self.sizes[j] > 1 for j in left) > 3 and "must" not in self.refusals:
                if one.chance(0.1):
                    self.refusals += ["axes: a volume has at most 3", "must"]
                else:
                    self.at[int(i)] = int(one.random.integers(self.sizes[i]))
                    left.remove(i)
        self.wide = (left if len(left) <= 3 else [i for i in left if self.sizes[i] > 1])[:3]  # axes of the volume
        self.from_left = False
        self.shift = np.zeros(3)  # of the origin, by the positions on the other axes

    def index(self):
        """The argument that chooses `at`; a number stands for an axis, or each axis has an entry."""
        count, negative = len(self.sizes), lambda i: self.at[i] - (self.sizes[i] if self.one.chance(0.3) else 0)
        if not self.at:
            return {}
        if self.one.chance(0.3):
            return {"index": tuple(negative(i) if i in self.at else None for i in reversed(range(count)))}
        return {"index": {self.one.pick(count - 1 - i, str(-1 - i)): negative(i) for i in self.at}}

    def word(self, text):
        return "none" if text == "none" else self.one.pick(text, text, text.upper(), text.lower(), text.capitalize())

    def list(self, words):
        return self.one.pick(" ", " ", "  ", "\t").join(map(_text, words))

    def vector(self, numbers):
        blank = self.one.pick("", "", " ")
        return f"({blank}" + f"{blank},{blank}".join(map(_text, numbers)) + f"{blank})"

    def _say(self, field, numbers):
        self.numbers_of[field] = np.array(numbers, float)
        self.fields.append(f"{field}: {self.list(numbers)}")

    def _spacings(self):
        """Steps, ends and centres along each axis."""
        one, count = self.one, len(self.sizes)
        self.steps, self.origin, self.world = [1.0] * count, [0.0] * count, 0
        if one.chance(0.2):
            return
        way = one.pick("steps", "steps", "steps and ends", "steps and mins", "ends")
        nan = float("nan")
        steps = [_random(one) * one.pick(1, 1, 1, 1, 1, -1) for _ in self.sizes]
        centers = [one.pick("cell", "node", "???", "none") for _ in self.sizes] if one.chance(0.5) else ["none"] * count
        cells = [n - (center == "node") for n, center in zip(self.sizes, centers)]
        mins = [one.random.normal() * abs(step) * 10 if one.chance(0.9) else nan for step in steps]
        if way == "ends":
            steps = [step if n else nan for step, n in zip(steps, cells)]
            mins = [low if n else nan for low, n in zip(mins, cells)]
        elif way == "steps":
            steps = [step if one.chance(0.9) else nan for step in steps]
        maxs = [low + step * n for low, step, n in zip(mins, steps, cells)]
        if way != "ends":
            self._say("spacings", steps)
        if way != "steps":
            self._say("axis mins", mins)
        if way.endswith("ends"):
            self._say("axis maxs", maxs)
        if any(center != "none" for center in centers):
            self.fields.append(one.pick("centers: ", "centerings: ") + self.list([self.word(center) for center in centers]))
        known = [way != "steps" and low == low for low in mins]
        self.steps = [1.0 if step != step or (way == "ends" and not known[i]) else step for i, step in enumerate(steps)]
        self.origin = [mins[i] + (0 if centers[i] == "node" else self.steps[i] / 2) if known[i] else 0.0 for i in range(count)]
        if one.chance(0.4):
            units = one.pick([one.pick(*UNITS)] * count, [one.pick(*UNITS) for _ in self.sizes], [one.pick("mm", "cm", "um") for _ in self.sizes])
            self.fields.append("units: " + self.list([f'"{unit}"' for unit in units]))
            self._take_units([units[i] for i in self.wide], [self.sizes[i] for i in self.wide])
            for i in self.wide if self.unit else ():
                scale = LENGTHS[units[i]][1] / self.scale if units[i] in LENGTHS else 1
                self.origin[i] *= scale
                self.steps[i] *= scale if (known[i] if way == "ends" else steps[i] == steps[i]) else 1

    def _take_units(self, units, sizes):
        counted = [unit for unit, n in zip(units, sizes) if n > 1 or unit in LENGTHS]
        if any(counted) and all(unit in LENGTHS for unit in counted):
            self.unit, self.scale = LENGTHS[counted[0]]

    def _directions(self):
        """Steps as vectors in the world, in columns."""
        one, wide = self.one, self.wide
        self.world = one.pick(3, 3, 3, 3, max(len(wide), 2), len(wide), 4)
        w = min(self.world, 3)
        named = self.world in SPACES and one.chance(0.7)
        space = one.pick(*SPACES[self.world]) if named else ""
        self.first.append("space: " + self.word(space) if named else f"space dimension: {self.world}")
        self.from_left = space.lower().startswith(("left-anterior", "las"))  # which is read as RAS, with x negated
        turn = _turn(one, w)[:, :len(wide)]
        self.steps = turn * [_random(one) for _ in wide]
        long = [a for a, i in enumerate(wide) if self.sizes[i] > 1]
        if len(long) > 1 and one.chance(0.06):
            a, b = one.random.permutation(long)[:2]
            lengths = np.linalg.norm(self.steps, axis=0)
            self.steps[:, a] += self.steps[:, b] / lengths[b] * lengths[[a, b]].max() * one.random.uniform(0.4, 0.9)
            self.refusals += ["sheared", "must"]
        self.origin = np.zeros(w)
        vectors, spacings = [], []
        for i in range(len(self.sizes)):
            inside = i in wide
            if i in self.at and one.chance(0.5):
                vectors.append([float(x) for x in one.random.normal(size=self.world)])
                spacings.append(float("nan"))
                self.shift[:w] += np.array(vectors[-1][:w]) * self.at[i]
                continue
            vectors.append([*self.steps[:, wide.index(i)], 0.0][:self.world] if inside else None)
            spacings.append(float("nan") if inside else one.pick(float("nan"), 2.5))
        self.numbers_of["space directions"] = np.array([v or [np.nan] * self.world for v in vectors])
        self.fields.append("space directions: " + self.list([self.vector(v) if v else "none" for v in vectors]))
        if any(spacing == spacing for spacing in spacings) and one.chance(0.3):
            self._say("spacings", spacings)
        if one.chance(0.7):
            self.origin = one.random.normal(size=w) * np.abs(self.steps).max(initial=0.1) * 10
            numbers = [*self.origin, one.pick(0.0, 5.0)][:self.world]
            self.numbers_of["space origin"] = np.array(numbers)
            self.fields.append("space origin: " + self.vector(numbers))
        if self.version >= 5 and one.chance(0.3):
            self.fields.append("measurement frame: " + self.list([self.vector(v) for v in np.eye(self.world)]))
        if one.chance(0.4):
            units = one.pick([one.pick(*UNITS)] * self.world, [one.pick(*UNITS) for _ in range(self.world)],
                             [one.pick("mm", "cm", "um") for _ in range(self.world)])
            if "sheared" in self.refusals:  # which units that differ might undo
                units = units[:1] * self.world
            self.fields.append("space units: " + self.list([f'"{unit}"' for unit in units]))
            self._take_units(units[:w], [2] * w)
            if self.unit:
                scales = np.array([LENGTHS[unit][1] / self.scale for unit in units[:w]])
                self.steps, self.origin = self.steps * scales[:, None], self.origin * scales
                self.shift[:w] *= scales
                steps = self.steps / np.linalg.norm(self.steps, axis=0)
                if np.abs(steps.T @ steps - np.eye(len(wide))).max() > 1e-9:  # units that differ shear it
                    self.refusals.append("sheared")

    def _more(self):
        """Fields that change neither numbers nor place."""
        one = self.one
        more = ["content: a: b, c:=d", f"number: {self.values.size}", "old min: 3", "oldmin: -1e3", "old max: 7.5", "min: 0.5", "max: nan",
                "labels: " + " ".join(one.pick('""', '"x"', '"a \\"b\\" c: d"', '"größe"') for _ in self.sizes)]
        if self.version >= 4:
            more += ["thicknesses: " + " ".join("nan" for _ in self.sizes), one.pick("sample units: ", "sampleunits: ") + "K"]
        chosen = {}
        for field in more:
            if one.chance(0.12):
                chosen.setdefault(field.split(":")[0].replace(" ", ""), field)
        self.fields += chosen.values()

    def cased(self, field):
        """A field's name in other case, or without its spaces where the definition has that."""
        name, text = field.split(": ", 1)
        if name.split()[0] in ("line", "byte", "data", "axis", "old") and self.one.chance(0.3):
            name = name.replace(" ", "")
        return self.one.pick(name, name, name.upper(), name.title()) + ": " + text


def _text(number):
    return number if isinstance(number, str) else repr(float(number)) if isinstance(number, float) else str(number)


def _random(one):
    return float(one.pick(1, 2, 0.5, round(10 ** one.random.uniform(-3, 3), 4), 10 ** one.random.uniform(-4, 4)))


def _turn(one, size):
    way = one.pick("none", "flips", "exchange", "any", "any", "little")
    if way == "flips":
        return np.diag([one.pick(-1.0, 1.0) for _ in range(size)])
    if way == "exchange":
        return np.eye(size)[one.random.permutation(size)]
    scale = {"none": 0, "little": 1e-7, "any": 1}[way]
    turn, upper = np.linalg.qr(np.eye(size) * (way != "any") + one.random.normal(size=(size, size)) * scale)
    return turn * np.sign(np.diag(upper)) if way != "any" else turn


def _placed(file):
    """compare.Expected by the steps: along the world's axes, else in directions of its own."""
    wide = file.wide
    if "must" in file.refusals:
        return compare.Expected(values=file.values, refusals=tuple(file.refusals))
    values = file.values[tuple(file.at.get(i, slice(None)) for i in reversed(range(len(file.sizes))))]
    values = values.reshape([1] * (3 - len(wide)) + [file.sizes[i] for i in wide[::-1]])
    nodes = np.array(values.shape[::-1])
    steps, origin = np.zeros((3, 3)), np.zeros(3)
    if file.world:
        steps[:file.steps.shape[0], :len(wide)] = file.steps
        origin[:len(file.origin)] = file.origin
        origin += file.shift
        if file.from_left:
            steps[0], origin[0] = -steps[0], -origin[0]
    else:
        for a, i in enumerate(wide):
            steps[a, a], origin[a] = file.steps[i], file.origin[i]
    lengths = np.linalg.norm(steps, axis=0)
    signs = np.where(np.diag(steps) < 0, -1, 1)
    straight = np.diag(lengths * signs)
    spacing = np.where(lengths > 0, lengths, 1)
    direction = np.eye(3)
    far = (np.abs(steps - straight) * np.maximum(nodes - 1, 1)).sum(axis=1) / np.where(lengths > 0, lengths, lengths[lengths > 0].min(initial=np.inf))
    if (far < 0.1).all():  # of a voxel: which counts as along the world's axes
        for a in range(3):
            if signs[a] < 0:
                values, origin[a] = np.flip(values, 2 - a), origin[a] - lengths[a] * (nodes[a] - 1)
                if a == 2:
                    file.refusals.append("from high to low in a compressed stream")
    else:
        direction = (steps / spacing).T
        if len(wide) == 2:
            direction[2] = np.cross(direction[0], direction[1])
        elif len(wide) == 1:
            direction[1:] = np.nan
        elif np.linalg.det(direction) < 0:
            values, origin = np.flip(values, 2), origin + steps[:, 0] * (nodes[0] - 1)
            direction[0] *= -1
    return compare.Expected(values=values, spacing=tuple(spacing), origin=tuple(origin), direction=tuple(direction.ravel()),
                            unit=file.unit, refusals=(*file.refusals, "mesh's 32-bit floats"))


def _encoded(one, values, encoding, order, skip):
    """Bytes of numbers, behind bytes to skip, of an encoding."""
    raw = values.astype(values.dtype.newbyteorder(order)).tobytes()
    if encoding == "text":
        words = [repr(v.item()) if values.dtype != np.float32 else str(v) for v in values.ravel()]
        return skip + one.pick(" ", "\n", "\t", "  ").join(words).encode() + one.pick(b"", b"\n")
    if encoding == "hex":
        width = one.pick(2, 64, 70, 10**9)
        text = one.pick(raw.hex(), raw.hex().upper())
        return skip + "\n".join(text[i:i + width] for i in range(0, len(text), width)).encode() + one.pick(b"", b"\n")
    if encoding == "gzip":
        whole = skip + raw
        cut = int(one.random.integers(len(whole) + 1)) if one.chance(0.2) else 0
        return (gzip.compress(whole[:cut]) if cut else b"") + gzip.compress(whole[cut:], one.pick(0, 1, 9))
    return bz2.compress(skip + raw) if encoding == "bzip2" else skip + raw


def _parts(one, file):
    """How the numbers lie in several files: the line that says so, with those that follow it, and the names."""
    sizes, last = file.sizes, len(file.sizes)
    below = one.pick(last, last - 1, last - 1) if last > 1 else last
    count = sizes[-1] if below < last else one.pick(*(n for n in range(1, sizes[-1] + 1) if sizes[-1] % n == 0))
    said = f" {below}" if below != last - 1 or one.chance(0.3) else ""
    if one.chance(0.5):
        names = [f"part {i}.raw" for i in range(count)]
        return ["data file: LIST" + said, *names], names
    first, step = int(one.random.integers(0, 12)), one.pick(1, 2, -1)
    first += count if step < 0 else 0
    pattern = one.pick("p%d.raw", "p%03d.raw", "./p%02d.raw")
    numbers = [first + i * step for i in range(count)]
    return [f"data file: {pattern} {first} {numbers[-1]} {step}{said}"], [pattern % i for i in numbers]


def _lines(one, file, fields, last):
    """All lines of a header, in an order that the definition allows."""
    body = [file.cased(fields[i]) for i in one.random.permutation(len(fields))]
    later = next(i for i, line in enumerate(body) if line.lower().startswith(PER_AXIS))
    for field in file.first[::-1]:  # which those of axes follow
        later = int(one.random.integers(later + 1))
        body.insert(later, file.cased(field))
    for extra in COMMENTS + (KEYS if file.version > 1 else ()):
        if one.chance(0.1):
            body.insert(int(one.random.integers(len(body) + 1)), extra)
    if one.chance(0.01):
        body.insert(0, "# " + "long " * 20000)
    return [f"NRRD000{file.version}", *body, *[file.cased(line) for line in last[:1]], *last[1:], ""]


def _write(one, file):
    """The file, and the files of its numbers."""
    encoding = one.pick("raw", "raw", "raw", "raw", "gzip", "gzip", "gzip", one.pick("text", "hex", "bzip2"))
    order = one.pick("<", ">")
    fields = file.fields + ["encoding: " + file.word(one.pick(*ENCODINGS[encoding]))]
    if file.values.dtype.itemsize > 1 and encoding != "text" or one.chance(0.3):
        fields.append("endian: " + file.word("little" if order == "<" else "big"))
    lines = int(one.random.integers(1, 4)) if one.chance(0.2) else 0
    skip = one.pick(-1 if encoding == "raw" else 3, 1, int(one.random.integers(1, 300))) if one.chance(0.25) else 0
    fields += [f"line skip: {lines}"] * (lines > 0 or one.chance(0.05)) + [f"byte skip: {skip}"] * (skip != 0 or one.chance(0.05))
    where = one.pick("attached", "attached", "attached", "file", "file", "parts" if file.version >= 4 and one.chance(0.6) else "file")
    names, last = [], []
    if where == "parts":
        last, names = _parts(one, file)
    elif where == "file":
        folder = one.pick("", "", "./", "sub/", str(one.folder) + "/")
        names = [folder + one.pick("v.raw", "v.raw", "my data.raw", "größe.raw", "a#b.img", "50%.raw" if one.chance(0.2) else "v")]
        fields.append("data file: " + names[0])
    end = one.pick("\n", "\n", "\n", "\r\n")
    head = end.join(_lines(one, file, fields, last)).encode()
    stored = []
    for part in np.array_split(file.values.ravel(), max(len(names), 1)):
        front = b"".join(bytes(one.random.integers(32, 127, 20, dtype="u1")) + b"\n" for _ in range(lines))
        junk = bytes(one.random.integers(0, 128, 40 if skip < 0 else skip, dtype="u1"))
        stored.append(front + _encoded(one, part, encoding, order, junk))
    if where == "attached":
        path = one.folder / "v.nrrd"
        path.write_bytes(head + end.encode() + stored[0])
        return path
    path = one.folder / "v.nhdr"
    path.write_bytes(head + (end.encode() if one.chance(0.5) and not last[1:] else b""))
    for name, data in zip(names, stored):
        (one.folder / name).parent.mkdir(exist_ok=True)
        (one.folder / name).write_bytes(data + (b"behind" if one.chance(0.1) and skip >= 0 and encoding == "raw" else b""))
    return path


def _numbers(text):
    """Of a field as teem writes it."""
    if "(" in text or "none" in text:
        vectors = [None if v == "none" else [float(x) for x in v.strip("()").split(",")] for v in text.split()]
        size = max((len(v) for v in vectors if v), default=1)
        return np.array([v or [np.nan] * size for v in vectors]).squeeze(0 if len(vectors) == 1 else ())
    return np.array([float(word) for word in text.split()])


def _teem(one, path, file):
    """What teem finds that was not written; empty if nothing."""
    out = one.folder / "teem.nrrd"
    done = subprocess.run([UNU, "save", "-f", "nrrd", "-e", "raw", "-en", "little", "-i", path, "-o", out], capture_output=True, text=True,
                          timeout=30)
    if done.returncode:
        return "teem refuses it: " + "; ".join(line for line in done.stderr.splitlines() if line.startswith("["))
    header, numbers = out.read_bytes().split(b"\n\n", 1)
    out.unlink()
    fields = dict(line.split(": ", 1) for line in header.decode().split("\n") if ": " in line)
    kind = next((kind for kind, names in TYPES.items() if fields["type"] in names), None)
    if kind != file.values.dtype.str[1:] or [int(n) for n in fields["sizes"].split()] != file.sizes:
        return f"teem finds {fields['type']} {fields['sizes']}"
    found = np.frombuffer(numbers, "<" + kind).reshape(file.values.shape)
    if not np.array_equal(found, file.values, equal_nan=kind[0] == "f"):
        return "teem reads other numbers"
    for field, written in file.numbers_of.items():
        read = _numbers(fields[field]) if field in fields else np.full(written.shape, np.nan)
        if np.isfinite(written).any() and not np.allclose(read.ravel(), written.ravel(), rtol=1e-12, equal_nan=True):
            return f"teem finds {field} {fields.get(field)}, not {written}"
    return ""


def nrrd(one):
    """A volume, a plane, a line, or what must be refused."""
    file = File(one)
    path = _write(one, file)
    problem = _teem(one, path, file)
    if problem:
        return attack.wrong("the judges differ: " + problem)
    expected = _placed(file)
    options = file.index()
    if not file.world and file.steps == [1.0] * len(file.sizes) and not any(file.origin) and one.chance(0.3):
        expected.spacing = tuple(float(s) for s in one.random.uniform(0.1, 9, 3))
        options["spacing"] = expected.spacing[::-1]
        if one.chance(0.5):
            expected.origin = tuple(float(o) for o in one.random.normal(size=3) * 5)
            options["origin"] = expected.origin[::-1]
    return compare.differs(one, path, expected, **options)
