"""Arrays and groups of Zarr. The judges are zarr-python (version 2) and what was written by the specification (version 3)."""
import json
import pathlib
import zipfile

import numcodecs
import numpy as np
import zarr

from arrays import zarr3
from arrays.expect import TYPES, check, numbers

CODECS = (lambda one: None, lambda one: numcodecs.Zlib(one.pick(0, 1, 9)), lambda one: numcodecs.GZip(one.pick(0, 1, 9)),
          lambda one: numcodecs.Zstd(one.pick(-3, 0, 1, 19)), lambda one: blosc(one), lambda one: blosc(one),
          lambda one: numcodecs.LZ4(one.pick(1, 9)), lambda one: numcodecs.BZ2(one.pick(1, 9)), lambda one: numcodecs.LZMA(one.pick(1, 1, 2)))
OTHER_CODECS = (numcodecs.Base64, numcodecs.Pickle)
# Some lose digits: what zarr-python reads then is what was stored.
FILTERS = (lambda one, kind: numcodecs.Delta(kind), lambda one, kind: numcodecs.Shuffle(np.dtype(kind).itemsize),
           lambda one, kind: numcodecs.FixedScaleOffset(one.pick(0, 2.5), one.pick(1, 4), kind) if kind.kind == "f" else numcodecs.Delta(kind),
           lambda one, kind: numcodecs.CRC32(), lambda one, kind: numcodecs.Adler32(),
           lambda one, kind: numcodecs.BitRound(9) if kind.kind == "f" else numcodecs.Shuffle(4 if kind.itemsize >= 4 else kind.itemsize))


def room_for(root):
    """Options: 80 MiB are set aside for the dictionary of LZMA."""
    about = [path for name in (".zarray", "zarr.json") for path in root.rglob(name)]
    return {"memory": "1G"} if any("lzma" in path.read_text() for path in about) else {}


def blosc(one):
    return numcodecs.Blosc(one.pick(*zarr3.BLOSC), one.pick(0, 1, 5, 9), one.pick(-1, 0, 1, 2), one.pick(0, 0, 64, 256))


def fill_of(one, kind):
    """A number that chunks which are not there have."""
    kind = np.dtype(kind)
    if kind.kind == "b":
        return bool(one.chance(0.5))
    if kind.kind == "f":
        return one.pick(0.0, -0.0, np.nan, np.inf, -np.inf, 1.5, -1.0, float(np.finfo(kind).max), float(np.finfo(kind).tiny))
    if kind.itemsize == 8:
        return one.pick(0, 1, 2**53, 2**53 - 1, 0 if kind.kind == "u" else -2**53)
    whole = np.iinfo(kind)
    return one.pick(0, 1, int(whole.min), int(whole.max))


def shape_and_chunks(one, axes=None):
    axes = axes or one.pick(1, 2, 3, 3, 3, 3, 4, 5)
    shape, chunks = [], []
    for _ in range(axes):
        n = int(one.random.integers(1, one.pick(2, 8, 18)))
        shape.append(n)
        chunks.append(one.pick(n, int(one.random.integers(1, n + 1)), int(one.random.integers(1, n + 4)), max(1, n // 2)))
    while np.prod([-(-n // c) for n, c in zip(shape, chunks)]) > 60:
        chunks[int(one.random.integers(axes))] += 3
    return shape, chunks


def with_holes(one, data, chunks, fill):
    """Some chunks are all the fill value."""
    data = data.copy()
    if one.chance(0.7):
        for place in np.ndindex(*[-(-n // c) for n, c in zip(data.shape, chunks)]):
            if one.chance(0.3):
                data[tuple(slice(p * c, (p + 1) * c) for p, c in zip(place, chunks))] = fill
    return data


def chosen_of(one, data, names=None):
    """An index (by position, or by name) where there are more than three axes, and what it chooses."""
    long = [a for a, n in enumerate(data.shape) if n > 1]
    if data.ndim <= 3 and one.chance(0.9):
        return None, data
    if len(long) <= 3 and one.chance(0.5):
        return None, data.reshape([data.shape[a] for a in long]) if data.ndim > 3 else data
    keep = set(one.random.permutation(data.ndim)[:min(3, data.ndim)].tolist())
    at = {a: int(one.random.integers(-n, n)) for a, n in enumerate(data.shape) if a not in keep}
    chosen = data[tuple(at.get(a, slice(None)) for a in range(data.ndim))]
    if names and all(names) and len(set(names)) == len(names) and at and one.chance(0.5):
        return {names[a]: i for a, i in at.items()}, chosen
    return tuple(at.get(a) for a in range(data.ndim)), chosen


def zipped(one, root, stored_alone=False):
    """A folder, or it in a ZIP archive, as its top or below a folder."""
    if one.chance(0.85):
        return root
    archive = one.folder / "archive.zip"
    below = one.pick("", "v.zarr")
    method = zipfile.ZIP_STORED if stored_alone else one.pick(zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
    with zipfile.ZipFile(archive, "w", method) as file:
        for one_file in root.rglob("*"):
            if one_file.is_file():
                file.write(one_file, pathlib.PurePosixPath(below) / one_file.relative_to(root))
    return archive


def zarr_v2(one):
    kind = one.pick(*TYPES, "b1")
    order = one.pick("<", ">")
    shape, chunks = shape_and_chunks(one)
    fill = None if one.chance(0.2) else fill_of(one, kind)
    data = with_holes(one, numbers(one, shape, kind), chunks, 0 if fill is None else fill)
    kind = np.dtype(kind).newbyteorder(order)
    refused, filters, compressor = None, None, one.pick(*CODECS)(one)
    if one.chance(0.03):
        compressor, refused = one.pick(*OTHER_CODECS)(), "codec"
    elif one.chance(0.25) and kind.kind != "b":
        filters = [one.pick(*FILTERS)(one, kind) for _ in range(one.pick(1, 1, 2))]
        if len(filters) > 1 and isinstance(filters[0], (numcodecs.CRC32, numcodecs.Adler32)):
            filters.reverse()  # numbers come first
        if len(filters) > 1 and isinstance(filters[0], (numcodecs.CRC32, numcodecs.Adler32, numcodecs.Shuffle)):
            filters = filters[:1]
        if kind.str[1:] == "f2" and any(isinstance(f, (numcodecs.Delta, numcodecs.FixedScaleOffset)) for f in filters):
            refused = "filter"
    elif one.chance(0.02):
        kind, data, fill = one.pick((np.dtype("<c8"), data.astype("c8"), 0), (np.dtype([("a", "<i2"), ("b", "u1")]),
                                    np.zeros(shape, [("a", "<i2"), ("b", "u1")]), None), (np.dtype("S3"), data.astype("S3"), b""))
        refused = "fields" if kind.names else "numbers of type"
    root = one.folder / one.pick("v.zarr", "v", "a b.zarr", "v.tif")
    inside = one.pick("", "", "a", "a/b/c")
    options = {}
    if inside:
        group = zarr.open_group(str(root), mode="w")
        if one.chance(0.3):
            group.attrs["note"] = [1, {"a": None}]
    array = zarr.open_array(str(root), mode="w", path=inside, shape=shape, chunks=chunks, dtype=kind, order=one.pick("C", "F"), compressor=compressor,
                            filters=filters, fill_value=fill, dimension_separator=one.pick(".", "/"),
                            write_empty_chunks=bool(one.chance(0.3)))
    array[...] = data
    if one.chance(0.3):
        array.attrs["units"] = "counts"
    if inside:
        if one.chance(0.3):
            other = zarr.open(str(root / "other"), mode="w", shape=(3,), dtype="f8")
            other[:] = 1
            options["dataset"] = inside
        if one.chance(0.3):
            options["dataset"] = one.pick(inside, "/" + inside, inside + "/")
        if one.chance(0.3):
            zarr.consolidate_metadata(str(root))
    if refused is None:
        read = zarr.open_array(str(root), mode="r", path=inside)[...]
        if filters is None:
            np.testing.assert_array_equal(read, data)
        data = read
    index, chosen = chosen_of(one, data) if refused is None else (None, data)
    if index is None and sum(n > 1 for n in data.shape) > 3:
        refused = refused or "axes: volumes of one scalar"
    return check(one, zipped(one, root), chosen, {"index": index, **room_for(root), **options}, refused=refused)


def fill_text(one, fill, kind):
    """As the description has it: a number, a word, or bits."""
    kind = np.dtype(kind)
    if kind.kind == "f" and (not np.isfinite(fill) or one.chance(0.2)):
        word = "NaN" if np.isnan(fill) else ("Infinity" if fill > 0 else "-Infinity") if not np.isfinite(fill) else None
        if word is None or one.chance(0.3):
            return "0x" + np.asarray(fill, kind).newbyteorder("=").astype(kind.newbyteorder(">")).tobytes().hex()
        return word
    if kind.kind == "f" and float(fill).is_integer() and abs(fill) < 2**53 and one.chance(0.3):
        return int(fill)
    return fill


def array_v3(one, folder, data, outer, codecs, fill, names=None, attributes=None):
    description = {"fill_value": fill_text(one, fill, data.dtype)}
    if names or one.chance(0.5):
        description["dimension_names"] = names
    if attributes or one.chance(0.5):
        description["attributes"] = attributes or {}
    if one.chance(0.2):
        description["storage_transformers"] = []
    if one.chance(0.1):
        description["something_new"] = {"must_understand": False, "name": "x"}
    keys = one.pick(("default", None), ("default", "/"), ("default", "."), ("v2", None), ("v2", "."), ("v2", "/"))
    zarr3.Writer(one, codecs, fill).write(folder, data, outer, keys, {k: v for k, v in description.items() if k != "dimension_names" or v})


def in_groups(one, root):
    """The folder of an array, perhaps in groups."""
    inside = one.pick("", "", "a", "a/b")
    if inside:
        for folder in (root, *[root / "/".join(inside.split("/")[:i + 1]) for i in range(inside.count("/"))]):
            folder.mkdir(parents=True, exist_ok=True)
            (folder / "zarr.json").write_text(json.dumps({"zarr_format": 3, "node_type": "group", "attributes": {}} if one.chance(0.7) else
                                                         {"zarr_format": 3, "node_type": "group"}))
    return root / inside, {"dataset": inside} if inside and one.chance(0.3) else {}


def version_3(one, codecs_of):
    kind = one.pick(*TYPES, "b1")
    shape, chunks = shape_and_chunks(one)
    fill = fill_of(one, kind)
    data = with_holes(one, numbers(one, shape, kind), chunks, fill)
    codecs, refused = codecs_of(one, kind, chunks)
    names = [one.pick("x", "y", "z", "t", "c", None, "") for _ in shape] if one.chance(0.3) else None
    folder, options = in_groups(one, one.folder / "v.zarr")
    array_v3(one, folder, data, chunks, codecs, fill, names)
    index, chosen = chosen_of(one, data, names)
    if index is None and sum(n > 1 for n in data.shape) > 3:
        refused = refused or "axes: volumes of one scalar"
    root = zipped(one, one.folder / "v.zarr", stored_alone=any(c["name"] == "sharding_indexed" for c in codecs))
    return check(one, root, chosen, {"index": index, **room_for(root), **options}, refused=refused)


def zarr_v3(one):
    def codecs_of(one, kind, chunks):
        return [*zarr3.random_transposes(one, len(chunks)), zarr3.random_bytes(one, kind), *zarr3.random_packers(one, kind, 3)], None
    return version_3(one, codecs_of)


def zarr_sharded(one):
    def codecs_of(one, kind, chunks):
        refused, before, behind = None, [], []
        shape = list(chunks)
        if one.chance(0.05) and len(chunks) > 1:
            order = [int(i) for i in one.random.permutation(len(chunks))]
            before = [{"name": "transpose", "configuration": {"order": order}}]
            shape = [shape[i] for i in order]
            refused = "may: shards that are transposed"
        shard = zarr3.random_shards(one, kind, shape)
        if one.chance(0.05):
            behind, refused = zarr3.random_packers(one, kind, 1), refused or "may: at this place of the list"
        if one.chance(0.05):
            inner = shard["configuration"]["chunk_shape"]
            shard["configuration"]["codecs"] = [zarr3.random_shards(one, kind, inner)]
            refused = "shards that are transposed" if before and order != sorted(order) else "at this place of the list"
        return [*before, shard, *behind], refused
    return version_3(one, codecs_of)
