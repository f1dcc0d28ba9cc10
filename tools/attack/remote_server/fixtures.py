"""What remote.py reads from URLs: stores, volumes of each format that is read from there, folders of Zarr. Made once for each process."""
import gzip
import importlib.util
import json
import os
import pathlib
import subprocess

import numpy as np

ROOT = pathlib.Path(__file__).resolve().parents[3]


def _program(program, folder, *arguments):
    subprocess.run([program, *map(str, arguments), "-q"], cwd=folder, check=True, capture_output=True)


def _smooth(shape, seed):
    """Numbers that are no noise and nowhere the same."""
    lot = np.random.default_rng(seed)
    at = np.indices(shape)
    return (sum(np.sin(a / 5 + lot.random() * 6) for a in at) * 500 + 2000 + lot.integers(0, 9, shape)).astype("u2")


def _labels(shape, seed):
    lot = np.random.default_rng(seed)
    seeds = lot.random((6, 3)) * shape
    at = np.stack(np.indices(shape), -1)[..., None, :]
    return np.argmin(((at - seeds) ** 2).sum(-1), -1).astype("u1")


def _raw(folder, name, values):
    (folder / name).write_bytes(np.ascontiguousarray(values).tobytes())


def stores(folder, program):
    """a.isonest and b.isonest of one shape, c.isonest of labels, and what replaces and decoys them."""
    folder.mkdir(parents=True)
    for name, seed in (("a", 1), ("b", 2), ("decoy", 3)):
        _raw(folder, f"{name}.raw", _smooth((33, 29, 40), seed))
        _program(program, folder, "preprocess", f"{name}.raw", "--dims", "40,29,33", "--type", "u2", "-o", f"{name}.isonest", "--chunk", "8",
                 "--indicators", "linf_bar,linf_plus,deviation_bar,hex_deviation")
    _raw(folder, "c.raw", _labels((33, 30, 29), 4))
    _program(program, folder, "preprocess", "c.raw", "--dims", "29,30,33", "--type", "u1", "--labels", "-o", "c.isonest", "--chunk", "8")
    os.symlink(".", folder / "bucket")


def volumes(folder, program):
    """Names of volumes, each with the options that it needs."""
    folder.mkdir(parents=True)
    of = {}
    for name, seed in (("v", 5), ("decoy", 6)):
        values = _smooth((37, 45, 50), seed)
        raw = values.tobytes()
        _raw(folder, f"{name}.raw", values)
        _program(program, folder, "preprocess", f"{name}.raw", "--dims", "50,45,37", "--type", "u2", "-o", f"{name}.isonest")
        for end in ("nrrd", "nii", "vti", "npy", "mha", "h5"):
            _program(program, folder, "export", f"{name}.isonest", "--field", "values", "-o", f"{name}.{end}")
            of[f"{name}.{end}"] = []
        (folder / f"{name}.raw.gz").write_bytes(gzip.compress(raw, 1))
        (folder / f"{name}.nii.gz").write_bytes(gzip.compress((folder / f"{name}.nii").read_bytes(), 1))
        fields = "NRRD0004\ntype: uint16\ndimension: 3\nsizes: 50 45 37\nendian: little\nencoding: {}\n"
        (folder / f"{name}z.nrrd").write_bytes((fields.format("gzip") + "\n").encode() + gzip.compress(raw, 1))
        (folder / f"{name}.nhdr").write_text(fields.format("raw") + f"data file: {name}.raw\n")
        (folder / f"{name}.mhd").write_text("ObjectType = Image\nNDims = 3\nDimSize = 50 45 37\nElementType = MET_USHORT\n"
                                            f"ElementByteOrderMSB = False\nElementDataFile = {name}.raw\n")
        of[f"{name}.raw"] = ["--dims", "50,45,37", "--type", "u2"]
        of[f"{name}.raw.gz"] = of[f"{name}.raw"]
        for end in (".nii.gz", "z.nrrd", ".nhdr", ".mhd"):
            of[name + end] = []
        if importlib.util.find_spec("h5py"):
            import h5py
            with h5py.File(folder / f"{name}c.h5", "w") as file:
                file.create_dataset("data", data=values, chunks=(8, 16, 16), compression="gzip", fletcher32=True)
            of[f"{name}c.h5"] = []
        (folder / f"{name}.isonest").unlink()
    os.symlink(".", folder / "bucket")
    return {name: options for name, options in of.items() if not name.startswith("decoy")}


def zarrs(folder, _program_):
    """Names of folders of Zarr; some of their chunks do not exist."""
    import sys
    sys.path.insert(0, str(ROOT / "tests" / "support"))
    import numcodecs
    from zarr_writer import V3
    import zarr
    folder.mkdir(parents=True)
    values = _smooth((20, 26, 30), 7)
    values[:8, 8:16] = 0
    names = []
    for name, options in (("plain", {}), ("packed", {"codecs": ("zstd", "crc32c")}), ("dots", {"codecs": ("gzip",), "separator": "."}),
                          ("shards", {"shards": (16, 16, 16), "codecs": ("zstd",)}),
                          ("front", {"shards": (8, 16, 16), "index_at": "start", "codecs": ("crc32c",)})):
        V3(folder / f"{name}.zarr", values, (8, 8, 8), **options)
        names.append(f"{name}.zarr")
    for name, compressor in (("two", None), ("twoz", numcodecs.Zstd(1))):
        array = zarr.open(str(folder / f"{name}.zarr"), mode="w", shape=values.shape, chunks=(7, 9, 11), dtype="u2", fill_value=0,
                          compressor=compressor, dimension_separator="/")
        array[7:, :18] = values[7:, :18]
        names.append(f"{name}.zarr")
    group = folder / "group.zarr"
    V3(group / "0", values, (8, 8, 8), codecs=("zstd",))
    (group / "zarr.json").write_text(json.dumps({"zarr_format": 3, "node_type": "group", "attributes": {"ome": {"version": "0.5", "multiscales": [
        {"axes": [{"name": n, "type": "space", "unit": "micrometer"} for n in "zyx"], "datasets": [
            {"path": "0", "coordinateTransformations": [{"type": "scale", "scale": [2, 1, 1]}]}]}]}}}))
    return names + ["group.zarr"]
