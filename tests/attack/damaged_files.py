#!/usr/bin/env python3
"""Good, damaged and hostile files of every format that is read.

Good: a random small file with the values that an independent reader gives (valid). Damaged: files of the same
generators with flipped bits, truncated, with swapped blocks, huge or negative sizes, changed header text, and what is
specific to each format (decompression bombs, loops, recursion, names that point elsewhere). The program runs with
`--memory 64M`; beyond that and what it needs for a good file, it may take 64 MiB of data, and ten seconds.

Wrong is: a signal, a hang, exit code 1; an error without exactly one message that names the file; an output, or any
other file, left after an error; a truncated file that is read with other values than the good one; values that differ
from those of an independent reader. The libraries of hdf5, netcdf4 and openvdb are not covered by the promise: if they
crash or hang, that counts as refused.
"""
import argparse
import dataclasses
import logging
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
import attack  # noqa: E402

np, nibabel, mrcfile, pydicom, tifffile, zarr, netCDF4, h5py, vtk = attack.require(
    "numpy", "nibabel", "mrcfile", "pydicom", "tifffile", "zarr", "netCDF4", "h5py", "vtk")

from damage import arrays, case, folders, headers, images, judge, stores  # noqa: E402

logging.disable(logging.CRITICAL)  # messages of the independent readers about damaged files
VARIANTS = 60  # number of good files per format


def kind(make, *tricks, foreign=False):
    """A kind of tries: files of make(random numbers), with general damage and that of `tricks`."""
    made = {}

    def attempt(one):
        variant = int(one.random.integers(VARIANTS))
        if variant not in made:
            made[variant] = make(np.random.default_rng(variant))
        return judge.preprocessed(one, case.damaged(made[variant], one, tricks), foreign)
    return attempt


MAKERS = (arrays.npy, arrays.npz, arrays.raw, headers.nifti, headers.mrc, headers.nrrd, headers.meta_image, images.vti, images.vtk_legacy,
          images.tiff, folders.dicom, folders.zarr_folder, images.netcdf3, images.netcdf4, images.hdf5, images.openvdb)


def valid(one):
    """A good file is read with the values of an independent reader, or, without one, with those that were written."""
    make = one.pick(*MAKERS)
    case = make(one.random)
    if case.read is None and case.values is not None:
        case = dataclasses.replace(case, read=lambda _: case.values)
    result = judge.preprocessed(one, case, straight=False)
    # Choosing among several volumes is left to the user; the bytes of the VTK writer may be colours.
    allowed = ("choose with", "colours as text", "the type '...' is not supported")
    if result.what == "refused" and not any(words in result.why for words in allowed):
        return attack.wrong(f"a good file of {make.__name__}: {result.why}")
    return result


KINDS = {
    "valid": valid,
    "npy": kind(arrays.npy, arrays.npy_tricks),
    "npz": kind(arrays.npz, arrays.npz_tricks),
    "nifti": kind(headers.nifti, headers.nifti_tricks),
    "mrc": kind(headers.mrc, headers.mrc_tricks),
    "nrrd": kind(headers.nrrd, headers.nrrd_tricks),
    "metaimage": kind(headers.meta_image, headers.meta_tricks),
    "raw": kind(arrays.raw, arrays.raw_tricks),
    "vti": kind(images.vti, images.xml_tricks),
    "vtk": kind(images.vtk_legacy, images.vtk_tricks),
    "tiff": kind(images.tiff, images.tiff_tricks),
    "dicom": kind(folders.dicom, folders.dicom_tricks),
    "zarr": kind(folders.zarr_folder, folders.zarr_tricks),
    "netcdf3": kind(images.netcdf3, images.netcdf_tricks),
    "store": stores.store,
    "labels": stores.labels,
    "mesh": stores.mesh_of(("ply", "stl", "obj", "glb", "3mf", "vtp"), False),
    "vtkhdf": stores.mesh_of(("vtkhdf",), True),
    "netcdf4": kind(images.netcdf4, images.hdf5_tricks, foreign=True),
    "hdf5": kind(images.hdf5, images.hdf5_tricks, foreign=True),
    "openvdb": kind(images.openvdb, foreign=True),
}

if __name__ == "__main__":
    parser = argparse.ArgumentParser(add_help=False)
    parser.add_argument("--isonest", type=pathlib.Path, default=attack.ROOT / "build/bin/isonest")
    if not judge.can_run(parser.parse_known_args()[0].isonest):
        print("skipped: this build has no library that serves (sanitizers), or no Python package")
        sys.exit(77)
    sys.exit(attack.main(__doc__, KINDS))
