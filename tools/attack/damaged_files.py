#!/usr/bin/env python3
"""Damaged and hostile files of every format that is read: a good small file with bits flipped, cut short, blocks swapped, sizes
that are huge or negative, texts of a header changed, and what each format makes possible (bombs, loops, recursion, names that lead
elsewhere). `--memory 64M`; beyond it, and what the program needs for a good file, it may take 64 MiB of data, and ten seconds.

Wrong is: a signal, a hang, exit code 1; an error without one message that names the file; an output, or any other file,
left in spite of an error; a file that was cut short and is read (with other values than the good one); other values than an independent reader
gives. The libraries of hdf5, netcdf4 and openvdb are outside of the promise: if they crash or hang, that is counted as refused.
"""
import argparse
import logging
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
import attack  # noqa: E402

np, nibabel, mrcfile, pydicom, tifffile, zarr, netCDF4, h5py, vtk = attack.require(
    "numpy", "nibabel", "mrcfile", "pydicom", "tifffile", "zarr", "netCDF4", "h5py", "vtk")

from damage import arrays, case, folders, headers, images, judge, stores  # noqa: E402

logging.disable(logging.CRITICAL)  # what readers say of damaged files
VARIANTS = 60  # good files of a format


def kind(make, *tricks, foreign=False):
    """A kind of tries: files of make(random numbers), damaged in general and by tricks."""
    made = {}

    def attempt(one):
        variant = int(one.random.integers(VARIANTS))
        if variant not in made:
            made[variant] = make(np.random.default_rng(variant))
        return judge.preprocessed(one, case.damaged(made[variant], one, tricks), foreign)
    return attempt


KINDS = {
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
