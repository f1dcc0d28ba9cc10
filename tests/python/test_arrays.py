"""Arrays are stored unchanged: values() of a store compared bit by bit with the original array."""
import subprocess
import sys
import textwrap

import numpy as np
import pytest

import isonest

TYPES = ["uint8", "int8", "uint16", "int16", "uint32", "int32", "float32", "float64"]
SHAPE = (19, 35, 70)


def numbers(dtype, shape=SHAPE, seed=0):
    """Values over the type's whole range; floats include NaN, infinities and -0."""
    rng = np.random.default_rng(seed)
    dtype = np.dtype(dtype)
    if dtype.kind == "f":
        array = (rng.standard_normal(shape) * 10.0 ** rng.integers(-3, 4, shape)).astype(dtype)
        array.flat[::97], array.flat[5::101], array.flat[7::103] = np.nan, np.inf, -0.0
        return array
    info = np.iinfo(dtype)
    return rng.integers(info.min, info.max, shape, dtype=dtype, endpoint=True)


def same_bits(a, b):
    assert a.dtype == b.dtype and a.shape == b.shape
    np.testing.assert_array_equal(np.ascontiguousarray(a).view(np.uint8), np.ascontiguousarray(b).view(np.uint8))


def through(volume, path, **options):
    """The values of the volume's store."""
    isonest.preprocess(volume, path, **options)
    with isonest.open(path) as store:
        return store.values()


@pytest.mark.parametrize("dtype", TYPES)
def test_level_l_has_the_values_of_every_2_to_the_l_th_node(store_path, dtype):
    volume = numbers(dtype)
    isonest.preprocess(volume, store_path, chunk=16)
    store = isonest.open(store_path)
    assert store.shape == SHAPE and store.dtype == dtype and store.levels == 8
    for level in range(store.levels):
        step = 2**level
        expected = volume[::step, ::step, ::step]
        assert store.level_shape(level) == expected.shape
        same_bits(store.values(level), expected)


@pytest.mark.parametrize("box", [np.s_[3:7, 10:35, 5:66], np.s_[:, -1, ::], np.s_[8], np.s_[5:5], np.s_[2, 3, 4],
                                 np.s_[-4:100, :, 30:31]])
def test_a_box_of_values_is_a_slice(store_path, box):
    volume = numbers("int16")
    isonest.preprocess(volume, store_path, chunk=16)
    store = isonest.open(store_path)
    same_bits(store.values(0, box), volume[box])
    same_bits(store.values(1, box, memory="16M", threads=1), volume[::2, ::2, ::2][box])


@pytest.mark.parametrize("level, box, error", [(8, None, IndexError), (-1, None, IndexError),
                                               (0, np.s_[19], IndexError), (0, np.s_[::2], ValueError),
                                               (0, np.s_[1, 1, 1, 1], ValueError)])
def test_missing_levels_and_boxes_outside_raise(store_path, level, box, error):
    isonest.preprocess(numbers("uint8"), store_path)
    with pytest.raises(error):
        isonest.open(store_path).values(level, box)


def unaligned(volume):
    table = np.zeros(volume.shape, np.dtype([("pad", "u1"), ("value", volume.dtype)]))
    table["value"] = volume
    return table["value"]


STRIDES = {
    "Fortran": np.asfortranarray,
    "transposed": lambda v: np.ascontiguousarray(v.transpose(2, 0, 1)).transpose(1, 2, 0),
    "backwards": lambda v: np.ascontiguousarray(v[::-1, ::-1, ::-1])[::-1, ::-1, ::-1],
    "every second": lambda v: np.repeat(v, 2, axis=2)[..., ::2],
    "unaligned": unaligned,
    "other byte order": lambda v: v.astype(v.dtype.newbyteorder()),
    "read only": lambda v: np.frombuffer(v.tobytes(), v.dtype).reshape(v.shape),
}


@pytest.mark.parametrize("kind", STRIDES)
@pytest.mark.parametrize("dtype", ["uint8", "int16", "float32", "float64"])
def test_strides_and_byte_order_do_not_matter(store_path, kind, dtype):
    volume = numbers(dtype)
    other = STRIDES[kind](volume)
    np.testing.assert_array_equal(other, volume)
    same_bits(through(other, store_path), volume)


def test_an_array_with_strides_of_0(store_path):
    plane = numbers("float32", SHAPE[1:])
    same_bits(through(np.broadcast_to(plane, SHAPE), store_path), np.repeat(plane[None], SHAPE[0], axis=0))


@pytest.mark.parametrize("dtype, kept", [("float16", "float32"), ("bool", "uint8"), ("int64", "float64"),
                                         ("uint64", "float64")])
def test_other_types_become_the_smallest_type_that_can_hold_them(store_path, dtype, kept):
    volume = (np.random.default_rng(0).integers(0, 1000, SHAPE) - (0 if dtype[0] in "bu" else 500)).astype(dtype)
    same_bits(through(volume, store_path), volume.astype(kept))


@pytest.mark.parametrize("value", [2**53 + 1, -(2**53) - 1, 2**63 - 1])
def test_integers_not_exact_in_float64_are_refused(store_path, value):
    volume = np.zeros((5, 6, 7), np.int64)
    volume[3, 4, 5] = value
    with pytest.raises(ValueError, match="2\\*\\*53"):
        isonest.preprocess(volume, store_path)
    assert not list(store_path.parent.iterdir())


@pytest.mark.parametrize("volume", [np.zeros((3, 4, 5), complex), np.zeros((3, 4, 5), "U3"),
                                    np.zeros((3, 4, 5), object), np.zeros((3, 4, 5), np.longdouble)])
def test_non_numeric_types_are_refused(store_path, volume):
    with pytest.raises(TypeError, match="a volume of"):
        isonest.preprocess(volume, store_path)


@pytest.mark.parametrize("shape", [(5,), (2, 3, 4, 5), (0, 3, 4), ()])
def test_arrays_without_values_or_with_too_many_axes_are_refused(store_path, shape):
    with pytest.raises(ValueError, match="shape"):
        isonest.preprocess(np.zeros(shape), store_path)


def test_data_in_a_plane_and_nested_lists(store_path, tmp_path):
    volume = numbers("float32", (12, 17))
    same_bits(through(volume, store_path), volume[None])
    same_bits(through([[[1, 2], [3, 4]], [[5, 6], [7, 9]]], tmp_path / "lists"),
              np.array([[[1, 2], [3, 4]], [[5, 6], [7, 9]]], float))


def test_masked_and_missing_values_become_nan(store_path, tmp_path):
    volume = numbers("int16") % 50
    expected = volume.astype(np.float32)
    expected[volume == 7] = np.nan
    np.testing.assert_array_equal(through(np.ma.masked_equal(volume, 7), store_path), expected)
    np.testing.assert_array_equal(through(volume, tmp_path / "m", missing=7), expected)
    np.testing.assert_array_equal(through(volume.astype(">i2"), tmp_path / "n", missing=7), expected)
    assert isonest.open(store_path).has_missing


def test_spacing_and_origin_are_in_the_order_of_the_axes(store_path, tmp_path):
    isonest.preprocess(numbers("uint8"), store_path, spacing=(3, 2, 1), origin=(30, 20, 10))
    store = isonest.open(store_path)
    assert store.spacing == (3, 2, 1) and store.origin == (30, 20, 10)
    numbers("uint8").tofile(tmp_path / "raw")
    isonest.preprocess(tmp_path / "raw", tmp_path / "y", shape=SHAPE, dtype="u1", spacing=(3, 2, 1),
                       origin=(30, 20, 10))
    other = isonest.open(str(tmp_path / "y"))
    assert other.spacing == (3, 2, 1) and other.origin == (30, 20, 10)
    same_bits(other.values(), store.values())
    assert store_path.read_bytes() == (tmp_path / "y").read_bytes()


@pytest.mark.parametrize("dtype", ["<u2", ">u2", "<f4", ">f8", "i1"])
def test_raw_files_in_either_byte_order(store_path, tmp_path, dtype):
    volume = numbers(np.dtype(dtype).newbyteorder("=")).astype(dtype)
    (tmp_path / "raw").write_bytes(b"header." + volume.tobytes())
    found = through(tmp_path / "raw", store_path, shape=SHAPE, dtype=dtype, offset=7)
    same_bits(found, volume.astype(volume.dtype.newbyteorder("=")))


def test_parts_of_a_file(store_path, tmp_path):
    volume = numbers("uint16")
    volume.tofile(tmp_path / "raw")
    same_bits(through(tmp_path / "raw", store_path, shape=SHAPE, dtype="u2", crop=np.s_[2:-1, 5:, :60],
                      every=(1, 2, 3)),
              np.ascontiguousarray(volume[2:-1, 5:, :60][:, ::2, ::3]))
    with pytest.raises(ValueError, match="slices without a step"):
        isonest.preprocess(tmp_path / "raw", store_path, shape=SHAPE, dtype="u2", crop=np.s_[::2, :, :])
    with pytest.raises(ValueError, match="every= is for files"):
        isonest.preprocess(volume, store_path, every=2)


def test_files_that_are_slices(store_path, tmp_path):
    tifffile = pytest.importorskip("tifffile")
    volume = numbers("uint16")
    files = [tmp_path / f"slice{z}.tif" for z in range(len(volume))]
    for file, plane in zip(files, volume):
        tifffile.imwrite(file, plane)
    same_bits(through(files, store_path), volume)


def test_an_index_by_position_and_by_name(store_path, tmp_path):
    volume = numbers("int16", (3, *SHAPE))
    np.save(tmp_path / "a.npy", volume)
    with pytest.raises(isonest.Error, match="index="):
        isonest.preprocess(tmp_path / "a.npy", store_path)
    with pytest.raises(isonest.Error, match=r"index=\{'0': 0\}"):
        isonest.preprocess(tmp_path / "a.npy", store_path)
    same_bits(through(tmp_path / "a.npy", store_path, index=(2, None, None, None)), volume[2])
    same_bits(through(tmp_path / "a.npy", tmp_path / "b", index={0: 1}), volume[1])
    same_bits(through(tmp_path / "a.npy", tmp_path / "c", index={"-4": np.int64(-1), 1: slice(None)}), volume[2])
    same_bits(through(tmp_path / "a.npy", tmp_path / "d", index={1: 3, "0": None}), volume[:, 3])
    for wrong in (0, 1, "t", {0: 1.5}, (1.5, None, None, None)):
        with pytest.raises((ValueError, TypeError)):
            isonest.preprocess(tmp_path / "a.npy", tmp_path / "e", index=wrong)
    zarr = pytest.importorskip("zarr")
    zarr.save_array(str(tmp_path / "a.zarr"), volume)
    same_bits(through(str(tmp_path / "a.zarr"), tmp_path / "z", index=(1, None, None, None)), volume[1])


def test_mapped_files(store_path, tmp_path):
    volume = numbers("float32")
    np.save(tmp_path / "a.npy", volume)
    mapped = np.load(tmp_path / "a.npy", mmap_mode="r")
    same_bits(through(mapped, store_path), volume)
    with pytest.raises(isonest.Error):  # the input must not be replaced
        isonest.preprocess(mapped, tmp_path / "a.npy", replace=True)
    np.testing.assert_array_equal(np.load(tmp_path / "a.npy"), volume)


@pytest.mark.parametrize("chunks", [None, (8, 16, 32), (1, 35, 70), (19, 1, 1)])
@pytest.mark.parametrize("dtype", ["int16", ">f4", "float16", "int64"])
def test_datasets_of_h5py(store_path, tmp_path, chunks, dtype):
    h5py = pytest.importorskip("h5py")
    volume = (numbers("int16") % 999).astype(dtype)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("group/data", data=volume, chunks=chunks, compression="gzip" if chunks else None)
    with h5py.File(tmp_path / "a.h5") as file:
        found = through(file["group/data"], store_path, resume=True)
    np.testing.assert_array_equal(found, volume)
    same_bits(through(tmp_path / "a.h5", tmp_path / "file", dataset="group/data"), found)


def test_arrays_of_zarr(store_path):
    zarr = pytest.importorskip("zarr")
    volume = numbers("float32")
    same_bits(through(zarr.array(volume, chunks=(7, 9, 33)), store_path), volume)


class Recorded:
    """An object with slicing that records what was requested."""

    def __init__(self, volume, **attributes):
        self.volume, self.shape, self.dtype, self.asked = volume, volume.shape, volume.dtype, []
        self.__dict__.update(attributes)

    def __getitem__(self, place):
        self.asked.append(place)
        return self.volume[place]


@pytest.mark.parametrize("chunks", [(16, 32, 40), ((16, 16, 16, 16, 6), (32, 32, 26), (40,))])  # of h5py, dask
def test_each_value_is_read_once_in_whole_chunks(store_path, chunks):
    volume = numbers("uint8", (70, 90, 40))
    source = Recorded(volume, chunks=chunks)
    same_bits(through(source, store_path, chunk=16), volume)
    seen = np.zeros(volume.shape, int)
    for place in source.asked:
        seen[place] += 1
        assert place[0].start % 16 == 0 and place[1].start % 32 == 0
    assert (seen == 1).all() and len(source.asked) >= 5


@pytest.mark.parametrize("failure", [RuntimeError("the disk is gone"), KeyError("x"), StopIteration()])
def test_exceptions_from_slicing_propagate_and_leave_no_files(store_path, failure):
    class Failing(Recorded):
        def __getitem__(self, place):
            if len(self.asked) == 3:
                raise failure
            return super().__getitem__(place)

    with pytest.raises(type(failure)) as caught:
        isonest.preprocess(Failing(numbers("uint8"), chunks=(2, 35, 70)), store_path, chunk=8)
    assert caught.value is failure
    assert not list(store_path.parent.iterdir())


def test_a_slice_with_the_wrong_shape_is_refused(store_path):
    class Short(Recorded):
        def __getitem__(self, place):
            return self.volume[place][:, :-1]

    with pytest.raises(ValueError, match="shape"):
        isonest.preprocess(Short(numbers("uint8")), store_path)


@pytest.mark.parametrize("kind", ["memmap", "h5py", "surface"])
def test_a_volume_larger_than_the_memory_is_not_copied(tmp_path, kind):
    """A volume of 216 MB in a process that may allocate 160 MB in addition to the imports."""
    if kind == "h5py":
        pytest.importorskip("h5py")
    script = textwrap.dedent(f"""
        import resource, sys
        import numpy as np
        import isonest
        kind, folder = {kind!r}, {str(tmp_path)!r}
        shape = (600, 600, 600)
        if kind == "h5py":
            import h5py
            with h5py.File(folder + "/a.h5", "w") as file:
                data = file.create_dataset("a", shape, "u1", chunks=(32, 100, 600))
                for z in range(0, 600, 40):
                    data[z:z + 40] = np.arange(600, dtype="u1") * (z // 40)
            volume = h5py.File(folder + "/a.h5")["a"]
        else:
            volume = np.memmap(folder + "/a", "u1", "w+", shape=shape)
            part = np.s_[100:150, 200:250, :] if kind == "surface" else np.s_[7::9, 5::7]
            volume[part] = 200
            volume.flush()
        used = int(open("/proc/self/status").read().split("VmData:")[1].split()[0]) * 1024
        resource.setrlimit(resource.RLIMIT_DATA, (used + (160 << 20), resource.RLIM_INFINITY))
        if kind == "surface":
            mesh = isonest.isosurface(volume, 100, distance=0.5, memory="100M", threads=2)
            assert 12 <= len(mesh.faces) < 1000 < mesh.report.full_triangles
        else:
            report = isonest.preprocess(volume, folder + "/x.isonest", memory="100M", chunk=32, threads=2)
            assert report.input_bytes == 216_000_000
        try:
            np.ones(216_000_000, "u1")
        except MemoryError:
            print("one more did not fit")
    """)
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "did not fit" in done.stdout
