"""Valid random files of arrays, by kind of file: TIFF, Zarr, NumPy and raw numbers."""
