#!/usr/bin/env python3
"""Random HDF5 volumes: isonest reads the same values as h5py, or refuses with an error, and no file
that is read is ever replaced.

usage: hdf5_random_test.py ISONEST PLUGIN_FOLDER

By default a short run with a fixed seed. ISONEST_RANDOM_FILES=N compares N files, ISONEST_RANDOM_SEED=S
starts with another seed; file i depends on the seed S + i alone, so that a finding can be reproduced with
ISONEST_RANDOM_FILES=1 and its seed. ISONEST_RANDOM_KEEP=FOLDER keeps the files of findings.
"""
import collections
import ctypes
import multiprocessing
import os
import pathlib
import shutil
import sys
import tempfile
import traceback

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served  # noqa: E402

os.environ["HDF5_PLUGIN_PATH"] = os.path.abspath(sys.argv[2])
os.environ["HDF5_USE_FILE_LOCKING"] = "FALSE"
try:
    import h5py
    import numpy as np
except ImportError as error:
    print(f"skipped: {error}")
    sys.exit(77)

ISONEST = os.path.abspath(sys.argv[1])
FILES = int(os.environ.get("ISONEST_RANDOM_FILES", 150))
SEED = int(os.environ.get("ISONEST_RANDOM_SEED", 1))
KEEP = os.environ.get("ISONEST_RANDOM_KEEP")
ZSTD = 32015
DONT_FILTER_PARTIAL_CHUNKS = 2


def library():
    """The HDF5 library that h5py has loaded, for functions that h5py lacks."""
    for line in open("/proc/self/maps"):
        name = line.split()[-1]
        if "libhdf5" in name and "_hl" not in name and "h5py" not in name:
            return ctypes.CDLL(name)
    return None


HDF5 = library()


class Case:
    """One random volume: makes its files, and determines the expected result."""

    def __init__(self, seed, folder):
        self.random = np.random.default_rng(seed)
        self.folder = folder
        self.inputs = set()  # all files that are read
        self.refused = None  # why it must be refused, or None
        self.refusable = set()  # why it may be refused
        self.words = []  # the random choices
        self.main = self.file("main")
        self.dataset = None
        self.make()

    def pick(self, *choices):
        return choices[self.random.integers(len(choices))]

    def chance(self, part):
        return self.random.random() < part

    def file(self, name, end=".h5"):
        """The path of a new file, sometimes in a folder of its own."""
        place = self.folder / (f"d{len(self.words)}" if self.chance(0.2) else "")
        place.mkdir(exist_ok=True)
        return place / f"{name}{len(list(self.folder.rglob('*')))}{end}"

    def open(self, path):
        options = {"libver": self.pick("earliest", "latest", ("v110", "v110"))}
        if not path.exists() and self.chance(0.25):
            options["userblock_size"] = int(self.pick(512, 1024, 4096))
            self.words.append("user block")
        f = h5py.File(path, "a", **options)
        if self.chance(0.5):  # so that offsets vary between files
            pad = f"pad{len(f)}"
            f[pad] = self.random.integers(0, 99, int(self.random.integers(1, 5000))).astype("u1")
        return f

    # ---- numbers

    def dtype(self):
        kind = self.pick("i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8", "f2", "i8", "u8", "bool",
                         "enum", "bits")
        self.words.append(kind)
        order = self.pick("<", "<", ">")
        if kind == "bool":
            return np.dtype(bool)
        if kind == "enum":
            return h5py.enum_dtype({"a": 0, "b": 700}, basetype=order + "u2")
        if kind == "bits":
            return np.dtype(order + self.pick("u2", "i4", "u4"))
        return np.dtype(order + kind)

    def values(self, shape, dtype):
        if dtype.kind == "b":
            return self.random.random(shape) < 0.4
        if dtype.kind == "f":
            v = self.random.normal(size=shape) * 100
            if self.chance(0.2):
                v[tuple(self.random.integers(n) for n in shape)] = np.nan
            return v.astype(dtype)
        if h5py.check_enum_dtype(dtype):
            return (self.random.integers(0, 2, shape) * 700).astype(dtype)
        info = np.iinfo(dtype)
        low, high = max(info.min, -2**53), min(info.max, 2**53)
        if dtype.itemsize == 8 and self.chance(0.1):
            low, high = 0, 2**62
            self.refusable.add("beyond 2^53")
        if self.chance(0.5):
            low, high = max(low, -50), min(high, 50)
        return self.random.integers(low, high, shape, endpoint=True).astype(dtype)

    # ---- datasets

    def filters(self, shape, dtype):
        """Chunks and filters."""
        options = {"chunks": tuple(int(self.random.integers(1, n + 1)) for n in shape)}
        if self.chance(0.2):
            options["maxshape"] = (None,) * len(shape)
            options["chunks"] = tuple(int(self.random.integers(1, n + 6)) for n in shape)
        if self.chance(0.4):
            options["shuffle"] = True
        if self.chance(0.25):
            options["fletcher32"] = True
        compression = self.pick(None, "gzip", "gzip", ZSTD, "lzf", "scaleoffset")
        if compression == "scaleoffset":
            if dtype.kind in "iu" and not h5py.check_enum_dtype(dtype):
                options["scaleoffset"] = 0
                options.pop("fletcher32", None)
            elif dtype.kind == "f" and dtype.itemsize > 2:
                options["scaleoffset"] = 2
                options.pop("fletcher32", None)
        elif compression:
            options["compression"] = compression
            if compression == "lzf":
                self.refusable.add("lzf")
        return options

    def create(self, group, name, data, layout=None):
        """A dataset in a random layout, in a file of its own."""
        layout = layout or self.pick("contiguous", "compact", "chunked", "chunked", "chunked",
                                     "external", "unwritten", "partly written")
        shape, dtype = data.shape, data.dtype
        options = {}
        if layout in ("chunked", "partly written"):
            options = self.filters(shape, dtype)
        if layout in ("unwritten", "partly written") and dtype.kind not in "b":
            options["fillvalue"] = self.pick(0, 7)
        self.words.append(f"{layout} {options}")
        if layout == "external":
            return self.create_external(group, name, data)
        dcpl = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        if layout == "compact":
            dcpl.set_layout(h5py.h5d.COMPACT)
        if "chunks" in options and HDF5 and self.chance(0.3) and "scaleoffset" not in options:
            if group.file.libver[1] in ("latest", "v110"):
                dcpl.set_chunk(options["chunks"])
                HDF5.H5Pset_chunk_opts(ctypes.c_int64(dcpl.id),
                                       ctypes.c_uint(DONT_FILTER_PARTIAL_CHUNKS))
                self.words.append("plain edges")
        space = h5py.h5s.create_simple(shape, tuple(
            h5py.h5s.UNLIMITED if m is None else m for m in options.pop("maxshape", shape)))
        file_type = h5py.h5t.py_create(dtype, logical=True)
        # HDF5 since 1.14.4 makes no such types by default.
        if "bits" in self.words and dtype.kind in "iu" and self.chance(0.7) and \
                h5py.version.hdf5_version_tuple < (1, 14, 4) and "scaleoffset" not in options and not h5py.check_enum_dtype(dtype):
            file_type = file_type.copy()
            file_type.set_precision(11)
            file_type.set_offset(self.pick(0, 3))
            data[...] = self.random.integers(0, 1000, shape)
            self.words.append("11 bits")
        fill = options.pop("fillvalue", None)
        dcpl = h5py._hl.filters.fill_dcpl(
            dcpl, shape, dtype, options.get("chunks"), options.get("compression"), None,
            options.get("shuffle"), options.get("fletcher32"), None, options.get("scaleoffset"),
            None)
        if fill is not None:
            dcpl.set_fill_value(np.array(fill, dtype))
        if self.chance(0.1):
            dcpl.set_fill_time(h5py.h5d.FILL_TIME_NEVER)
            if layout in ("unwritten", "partly written"):
                self.words.append("undefined")
        if self.chance(0.2):
            dcpl.set_alloc_time(h5py.h5d.ALLOC_TIME_EARLY)
        made = h5py.Dataset(h5py.h5d.create(group.id, name.encode(), file_type, space, dcpl))
        if layout == "partly written":
            part = tuple(slice(int(self.random.integers(0, n)), None) for n in shape)
            made[part] = data[part]
        elif layout != "unwritten":
            made[...] = data
        return made

    def create_external(self, group, name, data):
        size = data.nbytes
        parts = []
        raw = data.tobytes()
        at = 0
        while at < size:
            n = min(size - at, int(self.random.integers(1, size + 1)) if len(parts) < 3 else size)
            path = self.file("part", ".bin")
            skip = int(self.random.integers(0, 30))
            path.write_bytes(b"x" * skip + raw[at:at + n] + b"y" * int(self.random.integers(0, 9)))
            relative = self.chance(0.3)
            parts.append((os.path.relpath(path) if relative else str(path), skip, n))
            self.inputs.add(path)
            at += n
        if self.chance(0.15):
            path = pathlib.Path(parts[-1][0])
            path.write_bytes(path.read_bytes()[:parts[-1][1] + parts[-1][2] - 1])
            self.refused = "external storage is short"
        elif self.chance(0.05):
            path.unlink()
            self.inputs.discard(path)
            self.refused = "external storage is missing"
        elif self.chance(0.3):
            parts[-1] = (*parts[-1][:2], h5py.h5f.UNLIMITED)
        return group.create_dataset(name, data.shape, data.dtype, external=parts)

    def create_virtual(self, f, path, name, data):
        """A virtual dataset of parts along the first axis, in other files, in the same file, or by a pattern."""
        n = len(data)
        count = int(self.random.integers(1, min(n, 4) + 1))
        pattern = self.chance(0.4)
        edges = np.linspace(0, n, count + 1).astype(int)
        if pattern:
            while n % count:  # parts may be virtual themselves, and must cover everything
                count -= 1
            edges = np.arange(count + 1) * (n // count)
        tail = data.shape[1:]
        self.words.append(f"virtual {count}{' pattern' if pattern else ''}")
        odd = "100%%" if self.chance(0.2) else ""
        folder = self.pick("", "", "parts/")
        (path.parent / folder).mkdir(exist_ok=True)
        stem = f"{folder}{path.stem.replace('%', '%%')}-{len(self.words)}-{odd}"
        same_file = self.chance(0.2)
        prefix = f"p{len(self.words)}-"
        numbered_dataset = pattern and self.chance(0.3)
        lost = int(self.random.integers(count)) if self.chance(0.1) else -1
        layout = h5py.VirtualLayout(data.shape, data.dtype,
                                    **({"maxshape": (None, *tail)} if pattern else {}))
        for i in range(count):
            part = data[edges[i]:edges[i + 1]]
            own = f"{prefix}{i}" if numbered_dataset or same_file else "p"
            file_name = "." if same_file else f"{stem}{0 if numbered_dataset else i}.h5"
            source = path.parent / file_name.replace("%%", "%")
            if i != lost:
                if same_file:
                    self.create(f, own, part.copy())
                else:
                    with self.open(source) as g:
                        if self.chance(0.15):
                            other = self.file("behind")
                            with self.open(other) as h:
                                self.create(h, "q", part.copy())
                            self.inputs.add(other)
                            g[own] = h5py.ExternalLink(os.path.relpath(other, source.parent), "q")
                        elif self.chance(0.1):
                            self.create_virtual(g, source, own, part)
                        else:
                            self.create(g, own, part.copy())
                    self.inputs.add(source)
            if not pattern:
                at = h5py.VirtualSource(file_name, own, part.shape)
                layout[edges[i]:edges[i + 1]] = at
        if pattern:
            if same_file or numbered_dataset:
                name_of_file, name_of_set = file_name, prefix + "%b"
            else:
                name_of_file, name_of_set = f"{stem}%b.h5", "p"
            each = n // count
            space = h5py.h5s.create_simple(data.shape, (h5py.h5s.UNLIMITED, *tail))
            space.select_hyperslab((0,) * data.ndim, (h5py.h5s.UNLIMITED, *(1,) * len(tail)),
                                   (each, *(1,) * len(tail)), (each, *tail))
            source = h5py.h5s.create_simple((each, *tail))
            source.select_all()
            dcpl = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
            dcpl.set_virtual(space, name_of_file.encode(), name_of_set.encode(), source)
            whole = h5py.h5s.create_simple(data.shape, (h5py.h5s.UNLIMITED, *tail))
            h5py.h5d.create(f.id, name.encode(), h5py.h5t.py_create(data.dtype, logical=True),
                            whole, dcpl)
            if lost >= 0:
                if lost < count - 1 and not same_file and not numbered_dataset:
                    self.refused = "a pattern's source is missing"
                self.refusable.add("a pattern's last source is missing")
        else:
            f.create_virtual_dataset(name, layout, fillvalue=self.pick(0, 3))
            if lost >= 0:
                self.refused = "a virtual dataset's source is missing"

    # ---- links

    def link(self, f, path, target):
        """Links to `target` in `f`, perhaps through other files; returns the file and name."""
        for _ in range(int(self.random.integers(0, 4))):
            name = f"l{len(self.words)}"
            how = self.pick("hard", "soft", "group", "external", "external", "external group")
            self.words.append(how)
            if how in ("hard", "soft", "group"):
                with h5py.File(path, "a") as f:
                    if how == "hard":
                        try:
                            f[name] = f[target]
                        except OSError:  # it is in another file
                            f[name] = h5py.SoftLink("/" + target)
                    elif how == "soft":
                        f[name] = h5py.SoftLink("/" + target)
                    else:
                        f.create_group("g" + name)[name] = h5py.SoftLink("/" + target)
                        name = f"g{name}/{name}"
            else:
                other = self.file("link")
                where = os.path.relpath(path, other.parent) if self.chance(0.7) else str(path)
                with self.open(other) as g:
                    if how == "external group":
                        g[name] = h5py.ExternalLink(where, "/")
                        name = f"{name}/{target}"
                    else:
                        g[name] = h5py.ExternalLink(where, "/" + target)
                path = other
            target = name
            self.inputs.add(path)
        return path, target

    def make(self):
        rank = self.pick(1, 2, 3, 3, 3, 4)
        shape = tuple(int(n) for n in self.random.integers(1, 15, rank))
        if rank == 4:
            shape = tuple(1 if i == self.random.integers(4) else n for i, n in enumerate(shape))
            if 1 not in shape:
                shape = (1, *shape[1:])
        data = self.values(shape, self.dtype())
        self.inputs.add(self.main)
        with self.open(self.main) as f:
            if self.chance(0.3):
                self.create_virtual(f, self.main, "v", data)
            else:
                self.create(f, "v", data)
        self.main, self.dataset = self.link(None, self.main, "v")


def expected(case):
    """The values by h5py, converted to isonest's types; None if that is impossible."""
    with h5py.File(case.main, "r") as f:
        dataset = f[case.dataset]
        data = dataset[...]
    if data.dtype.kind == "b":
        data = data.astype("i1")
    data = data.astype(data.dtype.newbyteorder("="))
    if data.dtype == np.float16:
        data = data.astype("f4")
    if data.dtype.kind in "iu" and data.dtype.itemsize == 8:
        wide = data.astype("f8")
        if any(int(a) != int(b) for a, b in zip(wide.ravel(), data.ravel())):
            return None
        data = wide
    kept = list(data.shape)
    while len(kept) > 3 and 1 in kept:
        kept.remove(1)
    return data.reshape((1,) * (3 - len(kept)) + tuple(kept))


def contents(folder):
    return {p: p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def decoys(case, elsewhere):
    """Other files with the same names in the folder in which the program runs."""
    for path in case.inputs:
        if path.suffix == ".h5" and case.chance(0.3):
            with h5py.File(elsewhere / path.name, "w") as f:
                for name in ("v", "p", "q", "p0"):
                    f[name] = np.zeros((2, 2, 2), "u1")


def run(seed, top):
    folder, elsewhere = top / "files", top / "elsewhere"
    folder.mkdir()
    elsewhere.mkdir()
    os.chdir(elsewhere)
    case = Case(seed, folder)
    decoys(case, elsewhere)
    before = contents(folder)
    store = elsewhere / "s.isonest"
    replaced = None
    if case.chance(0.3):
        replaced = case.pick(*sorted(case.inputs))
    command = [ISONEST, "preprocess", case.main, "--dataset", case.dataset, "--chunk", "8",
               "--force", "-o", replaced or store, *case.pick((), ("--memory", "24M"))]
    done = served.run(command, capture_output=True, text=True, timeout=60)
    story = f"{' | '.join(case.words)}\n{case.refused} {case.refusable} {done.returncode} {done.stderr}"
    if contents(folder) != before:
        return "an input was changed", story
    if done.returncode:
        if done.returncode not in range(2, 8) or "isonest: error: " not in done.stderr or \
                done.stderr.strip().endswith(":"):
            return "a bad error", story
        if replaced:
            return ("refused", "") if done.returncode == 2 or case.refused or case.refusable else \
                ("a bad error for an input as output", story)
        if not case.refused and not case.refusable:
            try:
                if expected(case) is not None:
                    return "a good file was refused", story
            except OSError:
                pass
        return "refused", ""
    if replaced:
        return "an input as output was accepted", story
    if case.refused:
        return "taken: " + case.refused, story
    with h5py.File(store, "r") as f:
        found = f["levels/0/values"][...]
    try:
        right = expected(case)
    except OSError as error:
        return "h5py refuses what was taken", story + str(error)
    if right is None:
        return "integers that float64 cannot hold were taken", story
    if "undefined" in case.words:
        return "undefined", ""
    if found.dtype != right.dtype or found.shape != right.shape or \
            not np.array_equal(found, right, equal_nan=right.dtype.kind == "f"):
        return "other values", story + f"{found.dtype} {found.shape} {right.dtype} {right.shape}"
    return "same", ""


def one(seed):
    top = pathlib.Path(tempfile.mkdtemp(prefix="isonest-test-"))
    try:
        result, story = run(seed, top)
    except Exception:
        result, story = "the test failed", traceback.format_exc()
    os.chdir("/")
    if story and KEEP:
        shutil.copytree(top, pathlib.Path(KEEP) / str(seed), dirs_exist_ok=True)
    shutil.rmtree(top)
    return seed, result, story


def main():
    counts = collections.Counter()
    wrong = 0
    with multiprocessing.Pool(2) as pool:
        for seed, result, story in pool.imap_unordered(one, range(SEED, SEED + FILES)):
            counts[result] += 1
            if story:
                wrong += 1
                if wrong <= 20:
                    print(f"seed {seed}: {result}\n{story}\n")
    print(f"{FILES} files: " + ", ".join(f"{n} {what}" for what, n in counts.most_common()))
    if counts["same"] < FILES // 4 and FILES >= 100:
        print("too few were taken for the test to mean something")
        wrong += 1
    sys.exit(wrong != 0)


if __name__ == "__main__":
    main()
