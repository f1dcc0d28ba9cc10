#!/usr/bin/env python3
"""Valid random files of TIFF, Zarr and NumPy with odd options, slices in PNG and BMP, and raw numbers: values, sizes, spacing, origin and unit.

Files are written by tifffile, libtiff's tools, zarr-python and numpy, and by writers of its own by the formats'
descriptions (arrays/), for what those do not write. Each is read by an independent reader first, where one reads it.
"""
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
import attack  # noqa: E402

attack.require("numpy", "numcodecs", "tifffile", "zarr", "PIL.Image")
from arrays import numpy_files, ome_tiff_files, ome_zarr_files, slice_files, tiff_files, zarr_files  # noqa: E402

KINDS = {"tiff": tiff_files.tiff, "tiff_series": tiff_files.tiff_series, "imagej": tiff_files.imagej, "ome_tiff": ome_tiff_files.ome_tiff,
         "zarr_v2": zarr_files.zarr_v2, "zarr_v3": zarr_files.zarr_v3, "zarr_sharded": zarr_files.zarr_sharded, "ome_zarr": ome_zarr_files.ome_zarr,
         "png": slice_files.png_slices, "bmp": slice_files.bmp_slices,
         "npy": numpy_files.npy, "npz": numpy_files.npz, "raw": numpy_files.raw}

if __name__ == "__main__":
    sys.exit(attack.main(__doc__, KINDS))
