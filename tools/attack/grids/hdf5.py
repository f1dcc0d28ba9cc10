"""Random HDF5 files that h5py writes, and images of VTKHDF by their description.

Sources: https://docs.hdfgroup.org/hdf5/v1_14/_f_m_t3.html and
https://docs.vtk.org/en/latest/vtk_file_formats/vtkhdf_file_format/index.html. h5py reads the numbers again; they have to
be those that were written, but for filters that lose some. VTK's reader, which knows version 1.0, reads the images.
"""
import attack
import h5py
import numpy as np
from vtkmodules.util import numpy_support
from vtkmodules.vtkCommonCore import vtkObject
from vtkmodules.vtkIOHDF import vtkHDFReader

from . import compare, vtk_images

NAMES = ("values", "v 1", "größe", "x.y", "v-1", "日本", "a,b:c", "VALUES", "0")
UNITS = {"mm": "mm", "um": "um", "µm": "um", "micron": "um", "metre": "m", "nanometers": "nm", "s": None, "": None}
LZF, NBIT = 32000, 5


def _bits(one, signed):
    """Integers of odd precision, perhaps not at the low end of their bytes, and their range."""
    size = one.pick(2, 4, 8)
    precision = int(one.random.integers(2, 8 * size + 1 if size < 8 else 50))
    made = h5py.h5t.py_create(np.dtype(one.pick("<", ">") + ("i" if signed else "u") + str(size))).copy()
    made.set_precision(precision)
    made.set_offset(int(one.random.integers(0, 8 * size - precision + 1)))
    return made, (-(2 ** (precision - 1)), 2 ** (precision - 1) - 1) if signed else (0, 2**precision - 1), f"{'i' if signed else 'u'}{size}"


def _brain_float(one):
    made = h5py.h5t.IEEE_F32LE.copy()
    made.set_fields(15, 7, 8, 0, 7)
    made.set_offset(0)
    made.set_precision(16)
    made.set_size(2)
    if one.chance(0.5):
        made.set_order(h5py.h5t.ORDER_BE)
    return made


def _numbers(one, shape):
    """A type of the file, numbers that it holds, and why it may be refused."""
    order = one.pick("<", "<", ">")
    kind = one.pick("i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8", "f2", "f4", "f8", "f4", "f8", "bool", "enum", "bits", "bits", "brain",
                    "no number" if one.chance(0.5) else "bits")
    if kind == "bool":
        values = one.random.random(shape) < 0.4
        return h5py.h5t.py_create(values.dtype, logical=True), values, ()
    if kind == "enum":
        base = np.dtype(order + one.pick("i1", "u2", "i4", "u1", "i8"))
        named = {"nothing": 0, "a b": 7, "größe": 100}
        values = one.random.choice(list(named.values()), shape).astype(base)
        return h5py.h5t.py_create(h5py.enum_dtype(named, basetype=base), logical=True), values, ()
    if kind == "bits":
        made, (low, high), numpy_kind = _bits(one, one.chance(0.5))
        return made, one.random.integers(low, high, shape, dtype=numpy_kind, endpoint=True), ()
    if kind == "brain":
        values = (np.atleast_1d(compare.numbers(one, shape, "f4")).view("u4") & 0xFFFF0000).view("f4").reshape(shape)
        return _brain_float(one), values, ()
    if kind == "no number":
        dtype = np.dtype(one.pick("c8", "c16", "S3", "g", [("a", "i2"), ("b", "f4")], "V5"))
        return h5py.h5t.py_create(dtype, logical=True), np.zeros(shape, dtype), ("another type", "must")
    with np.errstate(over="ignore"):  # of half floats
        values = compare.numbers(one, shape, kind)
    if kind[0] == "f" and values.size and values.ndim and one.chance(0.15):
        values[tuple(one.random.integers(n) for n in shape)] = one.pick(np.nan, np.inf, -np.inf)
    if kind in ("i8", "u8") and values.size and values.ndim and one.chance(0.1):
        values[tuple(one.random.integers(n) for n in shape)] = 2**53 + one.pick(1, 2, 3)
    return h5py.h5t.py_create(np.dtype(order + kind)), values, ()


def _filters(one, creation, made, values):
    """Filters in any order; whether they keep all numbers."""
    exact = True
    for name in one.random.permutation(["shuffle", "gzip", "gzip", "fletcher32", "lzf", "scaleoffset", "nbit"]):
        if not one.chance(0.2 if name in ("lzf", "scaleoffset", "nbit") else 0.4):
            continue
        if name == "shuffle":
            creation.set_shuffle()
        elif name == "gzip":
            creation.set_deflate(one.pick(0, 1, 6, 9))
        elif name == "fletcher32":
            creation.set_fletcher32()
        elif name == "lzf" and made.get_class() != h5py.h5t.ENUM:
            creation.set_filter(LZF, h5py.h5z.FLAG_OPTIONAL)
        elif name == "nbit" and made.get_class() in (h5py.h5t.INTEGER, h5py.h5t.FLOAT) and creation.get_nfilters() == 0:
            creation.set_filter(NBIT)
        elif name == "scaleoffset" and creation.get_nfilters() == 0 and values.dtype.kind in "iu" and made.get_class() == h5py.h5t.INTEGER:
            if made.get_precision() == 8 * made.get_size():
                creation.set_scaleoffset(h5py.h5z.SO_INT, 0)
        elif name == "scaleoffset" and creation.get_nfilters() == 0 and values.dtype.kind == "f" and np.abs(values).max(initial=0) < 1e6 and \
                made.get_size() in (4, 8):
            creation.set_scaleoffset(h5py.h5z.SO_FLOAT_DSCALE, 2)
            exact = False
    return exact


def _create(one, group, name, made, values, layouts=("contiguous", "compact", "chunked", "chunked", "chunked")):
    """A dataset with the numbers, in a layout; the numbers that it then has, if they can be told."""
    layout = one.pick(*layouts) if values.ndim else "contiguous"
    creation = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    links = h5py.h5p.create(h5py.h5p.LINK_CREATE)
    links.set_create_intermediate_group(True)
    links.set_char_encoding(h5py.h5t.CSET_UTF8)
    shape, most = values.shape, values.shape
    known = True
    fill = 0
    plain = values.dtype.kind in "iuf" and made.get_class() != h5py.h5t.ENUM
    if plain and one.chance(0.4):
        fill = one.pick(1, 7, 2) if made.get_precision() > 4 else 1
        creation.set_fill_value(np.array(fill, values.dtype))
    if layout == "compact" and values.nbytes < 60000:
        creation.set_layout(h5py.h5d.COMPACT)
    elif layout == "chunked":
        grows = one.chance(0.3)
        most = tuple(h5py.h5s.UNLIMITED if grows and one.chance(0.6) else n + (3 if grows else 0) for n in shape)
        longest = [n + 6 if m == h5py.h5s.UNLIMITED else m for n, m in zip(shape, most)]
        creation.set_chunk(tuple(int(one.random.integers(1, max(n, 1) + 1)) for n in longest))
        known = _filters(one, creation, made, values)
        if one.chance(0.2):
            creation.set_alloc_time(one.pick(h5py.h5d.ALLOC_TIME_EARLY, h5py.h5d.ALLOC_TIME_INCR))
    space = h5py.h5s.create_simple(shape, most) if values.ndim else h5py.h5s.create(h5py.h5s.SCALAR)
    data = h5py.Dataset(h5py.h5d.create(group.id, name.encode(), made, space, creation, lcpl=links))
    way = one.pick("all", "all", "all", "part", "none", "grown") if plain else "all"
    if way == "grown" and (layout != "chunked" or most == shape or values.size == 0):
        way = "part"
    if way == "part" and values.ndim and values.size:
        part = tuple(slice(int(one.random.integers(n)), None if one.chance(0.5) else n) for n in shape)
        kept = np.full_like(values, fill)
        kept[part] = values[part]
        data[part] = values[part]
        values = kept
    elif way == "grown":
        axis = int(one.random.integers(len(shape)))
        data[...] = values
        less = int(one.random.integers(shape[axis]))
        data.resize(less, axis)
        data.resize(shape[axis], axis)
        values = values.copy()
        values[(slice(None),) * axis + (slice(less, None),)] = fill
    elif way == "none" and layout != "compact":
        values = np.full_like(values, fill)
    elif made.get_class() in (h5py.h5t.INTEGER, h5py.h5t.FLOAT) and values.ndim and values.size:
        data.id.write(h5py.h5s.ALL, h5py.h5s.ALL, np.ascontiguousarray(values))
    elif values.size:
        data[...] = values
    return data, values if known else None


def _fillers(one, group, shape):
    """Other datasets; whether one of them has as many axes as a volume of `shape`."""
    same = False
    for name in one.random.permutation(["text", "table", "line", "scalar", "same"]):
        if not one.chance(0.15):
            continue
        if name == "text":
            group["text"] = one.pick("a b", ["x", "größe"])
        elif name == "table":
            group["table"] = np.zeros(3, [("a", "i4"), ("b", "S4")])
        elif name == "scalar":
            group["scalar"] = 3.5
        elif name == "line" and len(shape) > 1:
            group["line"] = np.arange(5)
        elif name == "same":
            group["same"] = np.zeros([2] * min(max(len(shape), 1), 3), "i2")
            same = True
    return same


def _place(one, data, expected, axes):
    """Attributes that say where a volume lies, and others."""
    if one.chance(0.3):
        data.attrs["description"] = one.pick("a b", "größe", np.bytes_("x"), np.arange(20), h5py.Empty("f4"))
    if one.chance(0.3) and axes:
        spacing = [float(s) for s in 10.0 ** one.random.uniform(-3, 3, 3)]
        count = one.pick(3, axes)
        data.attrs.create("spacing", spacing[:count], dtype=one.pick("<f8", ">f8"))
        expected.spacing = tuple(spacing[:count] + [1.0] * (3 - count))
    elif one.chance(0.15) and axes == 3:
        size = [float(s) for s in one.random.uniform(0.01, 5, 3)]
        data.attrs["element_size_um"] = size
        expected.spacing, expected.unit = tuple(size[::-1]), "um"
    if one.chance(0.3) and axes:
        expected.origin = tuple(float(o) for o in one.random.normal(size=3) * 100)
        data.attrs["origin"] = expected.origin
    if one.chance(0.2):
        said = one.pick(*UNITS)
        data.attrs["unit"] = one.pick(said, np.bytes_(said.encode()))
        expected.unit = UNITS[said] or expected.unit


def _open(one, path, **options):
    if one.chance(0.25):
        options["userblock_size"] = one.pick(512, 1024, 4096, 32768)
    libver = one.pick("earliest", "latest", ("earliest", "v108"), ("v110", "v110"), None)
    return h5py.File(path, "w", libver=libver, track_order=one.chance(0.3), **options)


def _link(one, path, name):
    """A way to a dataset: through links, and through other files; its file and name."""
    for i in range(one.pick(0, 0, 0, 1, 1, 2, 3)):
        new = f"l{i}" if one.chance(0.5) else f"links {i}/größe"
        if one.chance(0.4):
            other = one.folder / one.pick("", "sub") / f"ö {i}.h5"
            other.parent.mkdir(exist_ok=True)
            said = str(path) if one.chance(0.3) else ("../" if other.parent != one.folder and path.parent == one.folder else "") + \
                str(path.relative_to(one.folder) if other.parent == one.folder or path.parent == one.folder else path.name)
            with _open(one, other) as file:
                if one.chance(0.3):
                    file[new], new = h5py.ExternalLink(said, "/"), f"{new}/{name}"
                else:
                    file[new] = h5py.ExternalLink(said, name)
            path, name = other, new
            continue
        with h5py.File(path, "a") as file:
            way = one.pick("hard", "soft", "group")
            if way == "hard" and not isinstance(file.get(name, getlink=True), h5py.ExternalLink) and file[name].file == file:
                file[new] = file[name]
            elif way == "group" and "/" in name:
                head, _, tail = name.rpartition("/")
                file[new] = h5py.SoftLink("/" + head)
                new += "/" + tail
            else:
                file[new] = h5py.SoftLink("/" + name)
        name = new
    return path, name


def _chosen(one, values, labels, expected):
    """--index for an array, and the part of it that this is."""
    shape = values.shape
    wide = sum(n > 1 for n in shape) > 3
    if not one.chance(0.1 if len(shape) <= 3 else 0.9 if wide else 0.3) or len(shape) < 2 or not all(shape):
        return {}, values
    left = one.random.permutation(len(shape))[:int(one.random.integers(1, 4))]
    index = {i: int(one.random.integers(-shape[i], shape[i])) for i in range(len(shape)) if i not in left}
    if not index:
        return {}, values
    options = {"index": tuple(index.get(i) for i in range(len(shape)))}
    if labels and one.chance(0.6):
        options["index"] = {labels[i]: at for i, at in index.items()}
    if len(left) < min(len(shape), 3):  # the attributes are of other axes
        options.update(spacing=(1, 1, 1), origin=(0, 0, 0), unit="mm")
        expected.spacing, expected.origin, expected.unit = (1, 1, 1), (0, 0, 0), "mm"
    return options, values[tuple(index.get(i, slice(None)) for i in range(len(shape)))]


def dataset(one):
    """One dataset among others, in a layout, behind links."""
    count = one.pick(1, 2, 2, 3, 3, 3, 3, 4, 4, 5)
    shape = tuple(int(one.random.integers(1, 9)) if one.chance(0.9) else int(one.random.integers(9, 30)) for _ in range(count))
    if count > 3 and one.chance(0.5):
        shape = tuple(1 if one.chance(0.5) else n for n in shape)
    if one.chance(0.02):
        shape = one.pick((), (0, *shape[1:]))
    made, values, refusals = _numbers(one, shape)
    path = one.folder / one.pick("v.h5", "größe 1.hdf5", "v")
    first = name = one.pick("", "", "g/h/", "ä b/") + one.pick(*NAMES)
    expected = compare.Expected(values=values, single=values.dtype.kind != "f" or values.dtype.itemsize < 8)
    with _open(one, path) as file:
        same = _fillers(one, file, shape)
        data, known = _create(one, file, name, made, values)
        labels = [f"axis{i}" for i in range(len(shape))] if shape and one.chance(0.2) else []
        for i, label in enumerate(labels):
            data.dims[i].label = label
        _place(one, data, expected, min(len(shape), 3))
    path, name = _link(one, path, name)
    if not refusals:
        with h5py.File(path) as file:
            values = file[name][()]
        if known is not None and not np.array_equal(values, known, equal_nan=values.dtype.kind == "f"):
            return attack.wrong("the judges differ: h5py reads other numbers than were written")
    options, values = _chosen(one, values, labels, expected)
    if one.chance(0.7) or name != first or same or refusals:
        options["dataset"] = one.pick(name, "/" + name)
    while values.ndim > 3 and 1 in values.shape:
        values = values.squeeze(values.shape.index(1))
    if values.ndim > 3:
        refusals += ("1 to 3 axes", "at most 3 axes", "must")
    if not all(shape) or shape == ():
        refusals += (".", "must")
    if values.dtype.kind in "iu" and values.dtype.itemsize == 8:
        if any(int(float(v)) != int(v) for v in values.ravel()):
            refusals += ("beyond 2\\^53", "must")
        elif values.size and max(abs(int(v)) for v in values.ravel()) > compare.MOST_EXACT:
            refusals += ("beyond 2\\^53",)
    if values.dtype.kind == "b":
        values = values.astype("i1")
    expected.values = values.reshape((1,) * (3 - values.ndim) + values.shape) if values.ndim <= 3 else values
    expected.refusals = (*refusals, "HDF5 filter")
    if values.ndim == 3 and not options.get("index") and one.chance(0.1):
        expected.spacing = tuple(float(s) for s in one.random.uniform(0.1, 9, 3))
        options["spacing"] = expected.spacing[::-1]
    return compare.differs(one, path, expected, **options)


def image(one):
    """An image of VTKHDF with several arrays."""
    said = vtk_images.Image(one, turned=True)
    path = one.folder / one.pick("v.vtkhdf", "v.hdf", "größe.h5")
    version = one.pick((1, 0), (1, 0), (2, 0), (2, 3))
    paths, known = [], True
    with _open(one, path) as file:
        group = file.create_group("VTKHDF")
        group.attrs["Version"] = np.array(version, one.pick("i4", "i8"))
        group.attrs.create("Type", np.bytes_("ImageData"))
        group.attrs["WholeExtent"] = np.array(said.extent, one.pick("i4", "i8"))
        group.attrs["Origin"], group.attrs["Spacing"] = np.array(said.origin), np.array(said.spacing)
        group.attrs["Direction"] = np.ravel(said.direction)
        for i, (name, cells, values) in enumerate(said.arrays):
            cells = cells and min(said.nodes) > 1
            if not cells and list(values.shape[:3]) != said.nodes:
                values = compare.numbers(one, [*said.nodes, values.shape[3]], values.dtype)
            name = f"{name.replace('/', '_').replace('.', '_')} {i}"
            paths.append(f"VTKHDF/{'CellData' if cells else 'PointData'}/{name}")
            made = h5py.h5t.py_create(values.dtype.newbyteorder(one.pick("<", "<", ">")))
            _, kept = _create(one, file, paths[i], made, values[..., 0] if values.shape[-1] == 1 else values)
            said.arrays[i] = (name, cells, (values if kept is None else kept).reshape(values.shape))
            known = known and kept is not None
        if one.chance(0.3):
            file.create_group("VTKHDF/FieldData")["time"] = np.arange(3.0)
    with h5py.File(path) as file:
        for i, (name, cells, values) in enumerate(said.arrays):
            found = file[paths[i]][()].reshape(values.shape).astype(values.dtype)
            if known and not np.array_equal(found, values, equal_nan=values.dtype.kind == "f"):
                return attack.wrong("the judges differ: h5py reads other numbers than were written")
            said.arrays[i] = (name, cells, found)
    at = int(one.random.integers(len(paths)))
    name, cells, values = said.arrays[at]
    vtk = said.vtk(one)
    no_cells = not any(cells for _, cells, _ in said.arrays)
    if version == (1, 0) and said.extent[::2] == [0, 0, 0] and min(said.nodes) > 1 and no_cells:  # others VTK 9.1 does not read
        vtk, problem = _by_vtk(path, said)
        if problem:
            return attack.wrong("the judges differ: " + problem)
    part = int(one.random.integers(values.shape[-1]))
    values = values[..., part]
    expected = vtk_images.placed(vtk, cells, values)
    options = {} if len(paths) == 1 and one.chance(0.3) and expected.values.ndim == 3 else {"dataset": paths[at]}
    if said.arrays[at][2].shape[-1] > 1:
        options["index"] = (None, None, None, part)
    expected.single = values.dtype == np.float32
    expected.refusals += ("HDF5 filter", "several volumes")
    if values.dtype.kind in "iu" and values.dtype.itemsize == 8 and np.abs(values.astype("f8")).max() > compare.MOST_EXACT:
        expected.refusals += ("beyond 2\\^53",)
    return compare.differs(one, path, expected, **options)


def _by_vtk(path, said):
    """The image that VTK reads, and what in it was not written."""
    vtkObject.GlobalWarningDisplayOff()
    reader = vtkHDFReader()
    reader.SetFileName(str(path))
    reader.Update()
    read = reader.GetOutput()
    matrix = read.GetDirectionMatrix()
    direction = np.array([[matrix.GetElement(r, c) for c in range(3)] for r in range(3)])
    if list(read.GetExtent()) != said.extent or not np.allclose(direction, said.direction, atol=1e-12):
        return read, "VTK finds another extent or direction"
    for name, cells, values in said.arrays:
        array = (read.GetCellData() if cells else read.GetPointData()).GetArray(name)
        if array is None:
            return read, f"VTK finds no {name}"
        if not np.array_equal(numpy_support.vtk_to_numpy(array).reshape(values.shape), values, equal_nan=values.dtype.kind == "f"):
            return read, "VTK reads other numbers"
    return read, ""
