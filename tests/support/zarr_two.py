"""zarr with the interface of its version 2, writing version 2 of the format, for any installed version: Debian 12 has
2, Debian 13 has 3.

usage: from support.zarr_two import zarr
"""
import numcodecs
import zarr

if int(zarr.__version__.partition(".")[0]) >= 3:
    zarr.config.set({"default_zarr_format": 2})
    _open, _open_array = zarr.open, zarr.open_array

    def _arguments(chunks=None, compressor="auto", filters=None, fill_value=0, order="C", dimension_separator="."):
        return {"chunks": "auto" if chunks is None else chunks, "compressors": compressor, "filters": filters,
                "fill_value": fill_value, "order": order, "overwrite": True,
                "chunk_key_encoding": {"name": "v2", "separator": dimension_separator}}

    def open(store, mode="a", shape=None, dtype="f8", **options):
        if shape is None:
            return _open(store, mode=mode, **options)
        return zarr.create_array(store, shape=shape, dtype=dtype, zarr_format=2, **_arguments(**options))

    def open_array(store, mode="a", path="", shape=None, dtype="f8", write_empty_chunks=True, **options):
        if shape is None:
            return _open_array(store=store, mode=mode, path=path, **options)
        return zarr.create_array(store, name=path or None, shape=shape, dtype=dtype, zarr_format=2,
                                 config={"write_empty_chunks": write_empty_chunks}, **_arguments(**options))

    def save_array(store, data, **options):
        zarr.create_array(store, shape=data.shape, dtype=data.dtype, zarr_format=2, **_arguments(**options))[...] = data

    def create_dataset(self, name, data=None, shape=None, dtype=None, **options):
        parent = name.strip("/").rpartition("/")[0]
        if parent:
            self.require_group(parent)
        made = self.create_array(name, shape=data.shape if shape is None else shape, dtype=dtype or data.dtype, **_arguments(**options))
        if data is not None:
            made[...] = data
        return made

    zarr.open = open
    zarr.save_array, zarr.open_array = save_array, open_array
    zarr.Blosc, zarr.Zlib, zarr.Zstd, zarr.GZip = numcodecs.Blosc, numcodecs.Zlib, numcodecs.Zstd, numcodecs.GZip
    zarr.ZipStore = zarr.storage.ZipStore
    zarr.Group.create_dataset = create_dataset
    zarr.Group.array = create_dataset
