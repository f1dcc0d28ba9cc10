#!/usr/bin/env python3
"""Random NRRD and raw files: isonest gives the same numbers as teem's parser, or an error.

usage: nrrd_random_test.py ISONEST PLUGIN_FOLDER
ISONEST_NRRD_FILES=5000 in the environment: number of files; ISONEST_NRRD_SEED=7: other files.
"""
import collections
import concurrent.futures
import gzip
import itertools
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served  # noqa: E402

try:
    import numpy as np
except ImportError as error:
    print(f"skipped: {error}")
    sys.exit(77)

UNU = shutil.which("teem-unu") or shutil.which("unu")
if UNU is None:
    print("skipped: no unu (Debian: teem-apps)")
    sys.exit(77)

ISONEST = sys.argv[1]
FILES = int(os.environ.get("ISONEST_NRRD_FILES", "100"))
SEED = int(os.environ.get("ISONEST_NRRD_SEED", "1"))

TYPES = {"i1": ("signed char", "int8", "int8_t"), "u1": ("uchar", "unsigned char", "uint8", "uint8_t"),
         "i2": ("short", "short int", "signed short", "signed short int", "int16", "int16_t"),
         "u2": ("ushort", "unsigned short", "unsigned short int", "uint16", "uint16_t"),
         "i4": ("int", "signed int", "int32", "int32_t"),
         "u4": ("uint", "unsigned int", "uint32", "uint32_t"), "f4": ("float",), "f8": ("double",)}
NAMES = {np.dtype(name).str[1:]: name for name in ("int8", "uint8", "int16", "uint16", "int32", "uint32",
                                                   "float32", "float64")}
SHOWN = "refused, taken by teem"


class Case:
    """A file, the expected numbers, and which of its axes are reversed."""

    def __init__(self, folder, seed):
        self.random = np.random.default_rng(seed)
        self.folder = folder
        self.path = folder / "v.nrrd"
        self.backward = [False] * 3
        self.options = []
        self.damage = ""
        if self.chance(0.15):
            self.raw()
        else:
            self.nrrd()

    def chance(self, p):
        return self.random.random() < p

    def pick(self, *choices):
        return choices[self.random.integers(len(choices))]

    def numbers(self, extra=True):
        """The shape, slowest first, with axes of length 1, and the bytes."""
        self.kind = self.pick(*TYPES)
        sizes = [int(n) for n in self.random.integers(1 + self.chance(0.9), 8, self.pick(1, 2, 3, 3, 3))]
        for _ in range(self.pick(0, 0, 0, 1, 2) if extra else 0):
            sizes.insert(int(self.random.integers(len(sizes) + 1)), 1)
        self.sizes = sizes
        self.big = self.chance(0.4)
        count = int(np.prod(sizes))
        if self.kind[0] == "f":
            values = self.random.normal(size=count)
        else:
            whole = np.iinfo(self.kind)
            values = self.random.integers(whole.min, whole.max, count, endpoint=True)
        stored = values.astype((">" if self.big else "<") + self.kind)
        self.values = values.astype(self.kind)
        return stored.tobytes()

    def compressed(self, data):
        if self.chance(0.2):
            cut = int(self.random.integers(len(data) + 1))
            return gzip.compress(data[:cut]) + gzip.compress(data[cut:])
        return gzip.compress(data, int(self.random.integers(10)))

    def damaged(self, stored):
        """Cuts the end of a stream, or changes a byte of it."""
        if self.chance(0.04):
            self.damage = "cut"
            return stored[:-int(self.random.integers(1, 9))]
        if self.chance(0.04):
            self.damage = "flip"
            at = int(self.random.integers(len(stored)))
            return stored[:at] + bytes([stored[at] ^ 1 << int(self.random.integers(8))]) + stored[at + 1:]
        if self.chance(0.04):
            return stored + bytes(int(self.random.integers(1, 600)))
        return stored

    def noise(self, most):
        return self.random.bytes(int(self.random.integers(most)))

    def raw(self):
        data = self.numbers(extra=False)
        self.path = self.folder / "v.raw"
        front = self.noise(50) if self.chance(0.5) else b""
        self.options = ["--dims", ",".join(map(str, [*self.sizes, 1, 1][:3])), "--type", NAMES[self.kind]]
        if front or self.chance(0.2):
            self.options += ["--offset", str(len(front))]
        if self.big or self.chance(0.2):
            self.options += ["--endian", "big" if self.big else "little"]
        stored = front + data
        self.path.write_bytes(self.damaged(self.compressed(stored)) if self.chance(0.5) else stored)

    def geometry(self):
        """Fields that give the positions of the axes; some reverse them."""
        dim = len(self.sizes)
        axes = [i for i in range(dim) if dim <= 3 or self.sizes[i] != 1]
        signs = [1] * dim
        for i in axes:
            signs[i] = self.pick(1, 1, 1, -1)
        steps = [round(float(s * self.random.uniform(0.1, 9)), 3) for s in signs]
        how = self.pick("none", "none", "spacings", "directions", "ends")
        fields = []
        if how == "spacings":
            steps = [float("nan") if self.sizes[i] == 1 and i not in axes else s for i, s in enumerate(steps)]
            fields = ["spacings: " + " ".join(f"{s:g}" for s in steps)]
        elif how == "directions" and len(axes) <= 3:
            vectors = []
            for i in range(dim):
                v = [0.0, 0.0, 0.0]
                if i in axes:
                    v[axes.index(i)] = steps[i]
                blank = self.pick("", "", " ")
                vectors.append(f"({blank}" + f",{blank}".join(f"{c:g}" for c in v) + f"{blank})"
                               if i in axes else "none")
            fields = [self.pick("space: left-posterior-superior", "space: RAS", "space dimension: 3"),
                      "space directions: " + self.pick(" ", "  ").join(vectors)]
            if self.chance(0.5):
                fields.append("space origin: (1,-2.5e3,+3)")
        elif how == "ends":
            fields = ["axis mins: " + " ".join("1" for _ in steps),
                      "axis maxs: " + " ".join(f"{1 + s:g}" for s in steps),
                      self.pick("centers: ", "centerings: ") + " ".join("cell" for _ in steps)]
        else:
            return []
        for a, i in enumerate(axes):
            self.backward[a] = signs[i] < 0
        return fields

    def nrrd(self):
        data = self.numbers()
        dim = len(self.sizes)
        encoding = self.pick("raw", "raw", "raw", "RAW", "gzip", "gzip", "gz", *(("ascii", "hex") if self.chance(0.2) else ()))
        zipped = encoding in ("gzip", "gz")
        fields = [f"type: {self.pick(*TYPES[self.kind])}", "sizes: " + " ".join(map(str, self.sizes)),
                  f"encoding: {encoding}"]
        if np.dtype(self.kind).itemsize > 1 or self.chance(0.3):
            fields.append(f"endian: {'big' if self.big else 'little'}")
        lines = int(self.random.integers(1, 4)) if self.chance(0.25) else 0
        skip = self.pick(0, 0, 0, -1, int(self.random.integers(1, 90)))
        if lines or self.chance(0.1):
            fields.append(f"{self.pick('line skip', 'lineskip', 'Line Skip')}: {lines}")
        if skip or self.chance(0.1):
            fields.append(f"{self.pick('byte skip', 'byteskip')}: {skip}")
        geometry = self.geometry()
        fields += [f for f in geometry if not f.startswith("space")]
        if self.chance(0.3):
            kinds = [self.pick("domain", "space", "???", "none", "domain") for _ in self.sizes]
            if self.chance(0.15):
                kinds[int(self.random.integers(dim))] = self.pick("RGB-color", "list", "3-vector", "scalar")
            if not any(f.startswith("space directions") for f in geometry):
                fields.append("kinds: " + " ".join(kinds))
        if self.chance(0.3):
            fields += ["content: a: b, c:=d", "units: " + " ".join('"mm"' for _ in self.sizes)][:self.pick(1, 2)]
        if self.chance(0.05):
            fields.append(self.pick(*fields))
        if self.chance(0.04):
            fields.append(self.pick("spacings: 1e400 1 1", "bytes skip: 3", "line skip: x", "sizes: 2 2",
                                    "byte skip:9", "nonsense", "old min: 0", "number: 12"))
        self.random.shuffle(fields)
        detached = self.chance(0.4)
        # Fields that others depend on come first; teem requires that, the format's description does not.
        first = [f"dimension: {dim}", *[f for f in geometry if f.startswith(("space:", "space dim"))]]
        behind = [f for f in geometry if f.startswith(("space directions", "space origin"))]
        order = first + fields + behind
        change = self.chance(0.25)
        if self.chance(0.1) and not change:
            self.random.shuffle(order)
        if detached:
            order.insert(int(self.random.integers(len(order) + 1)) if self.chance(0.5) else len(order),
                         self.pick("data file", "datafile") + ": " + self.pick("", "./") + "v.data")
        for extra in ("# a comment: 3", "#", "key:=value", "byte skip:=77", "a key:=sizes: 1 1"):
            if self.chance(0.1):
                order.insert(int(self.random.integers(len(order) + 1)), extra)
        end = self.pick("\n", "\n", "\n", "\r\n")
        header = (end.join([self.pick("NRRD0001", "NRRD0004", "NRRD0005"), *order]) + end).encode()
        front = b"".join(self.noise(30).replace(b"\n", b"").replace(b"\r", b"") + b"\n" for _ in range(lines))
        body = (self.noise(40) if skip < 0 else self.random.bytes(skip)) + data
        if encoding == "ascii":
            stored = front + body[:len(body) - len(data)] + self.pick(" ", "\n", ", ", " ,").join(
                repr(v.item()) if v.dtype != np.float32 else str(v) for v in self.values).encode()
        elif encoding == "hex":
            stored = front + body[:len(body) - len(data)] + data.hex().encode()
        else:
            stored = front + (self.damaged(self.compressed(body)) if zipped else body)
            if self.chance(0.1) and skip >= 0 and not zipped:
                stored += self.noise(50)
        if change:
            header = self.changed(header)
        if detached:
            (self.folder / "v.data").write_bytes(stored)
            self.path.write_bytes(header + (end.encode() if self.chance(0.3) else b""))
        else:
            self.path.write_bytes(header + end.encode() + stored)

    def changed(self, header):
        """Changes, inserts or removes a character somewhere, which may change the meaning of everything after it."""
        self.damage = "header"
        at = int(self.random.integers(9, len(header)))
        new = bytes([self.random.choice(list(b"0123456789 -+.,:#()\n\reinxaz"))])
        return header[:at] + self.pick(new, new, b"") + header[at + self.pick(0, 1, 1):]

    def gives(self, values, found):
        """Along reversed axes, the last value comes first. `values`: in the shape of the axes."""
        shape = [n for n in values.shape if n != 1] if values.ndim > 3 else list(values.shape)
        if len(shape) > 3:
            return False
        values = values.reshape([1, 1, 1, *shape][-3:])
        turns = (itertools.product((1, -1), repeat=3) if self.damage == "header" else
                 [[-1 if b else 1 for b in self.backward[::-1]]])
        return any(values[tuple(slice(None, None, t) for t in turn)].tobytes() == found for turn in turns)

    def teem(self):
        """The numbers by unu; None if it refuses the file, or if it is not NRRD."""
        if self.path.suffix != ".nrrd":
            return None
        out = self.folder / "teem.nrrd"
        done = subprocess.run([UNU, "save", "-f", "nrrd", "-e", "raw", "-en", "little", "-i", self.path, "-o",
                               out], capture_output=True, timeout=60)
        if done.returncode != 0 or not out.exists():
            return None
        header, numbers = out.read_bytes().split(b"\n\n", 1)
        fields = dict(line.split(": ", 1) for line in header.decode("latin-1").split("\n") if ": " in line)
        kind = next((k for k, names in TYPES.items() if fields["type"] in names), None)
        if kind is None:
            return None
        return np.frombuffer(numbers, "<" + kind).reshape([int(n) for n in fields["sizes"].split()][::-1])


def run(seed):
    """The outcome for a file, and why it is wrong, if it is."""
    with tempfile.TemporaryDirectory(prefix="isonest-test-", dir=served.MEMORY) as name:
        folder = pathlib.Path(name)
        case = Case(folder, (SEED, seed))
        store = folder / "s.isonest"
        done = served.run([ISONEST, "preprocess", case.path, "-o", store, "--chunk", "8", "--threads", "1",
                           "-q", *case.options], capture_output=True, text=True, timeout=60)
        teem = case.teem()
        if done.returncode != 0:
            clear = 2 <= done.returncode <= 7 and "error: /" in done.stderr
            text = done.stderr.strip().split("error: ")[-1].replace(name, "")
            wrong = "" if clear else f"exit status {done.returncode}: {done.stderr}"
            by_teem = "also refused by teem" if teem is None else "taken by teem"
            if case.options:
                by_teem = "raw"
                if not case.damage:
                    wrong = f"a good raw file is refused: {done.stderr}"
            return f"refused, {by_teem}", wrong, text
        served.run([ISONEST, "export", store, "--field", "values", "-o", folder / "s.raw", "-q"], check=True,
                   capture_output=True, timeout=60)
        found = (folder / "s.raw").read_bytes()
        as_written = case.gives(case.values.reshape(case.sizes[::-1]), found)
        kind = "changed header" if case.damage == "header" else "raw" if case.options else "NRRD"
        if teem is not None and case.gives(teem, found):
            if not as_written and case.damage != "header":
                return f"{kind}, equal to teem's alone", "not the numbers that were written", ""
            return f"{kind}, equal to teem's", "", ""
        if as_written and (teem is None or case.damage != "header"):
            return (f"{kind}, equal to what was written" + (
                "" if case.options else "; teem refuses it" if teem is None else "; teem differs")), "", ""
        if teem is None and case.damage == "header":
            return "changed header, other numbers than before; teem refuses it", "", ""
        return f"{kind}, wrong", "other numbers than " + (
            "were written, and teem refuses it" if teem is None else "teem's"), ""


def main():
    counts, reasons = collections.Counter(), collections.Counter()
    wrong = 0
    with concurrent.futures.ThreadPoolExecutor(2) as pool:
        for seed, (outcome, why, text) in zip(range(FILES), pool.map(run, range(FILES))):
            counts[outcome] += 1
            if text and outcome == SHOWN:
                reasons["".join(c for c in text if not c.isdigit())[:90]] += 1
            if why:
                wrong += 1
                print(f"file {seed}: {why}")
    for outcome, count in sorted(counts.items()):
        print(f"{count:6d} {outcome}")
    for text, count in reasons.most_common(20):
        print(f"         {count:5d} {SHOWN}: {text}")
    both = counts["NRRD, equal to teem's"]
    if both < FILES / 5:
        print(f"only {both} files were read by both")
        wrong += 1
    return wrong > 0


if __name__ == "__main__":
    sys.exit(main())
