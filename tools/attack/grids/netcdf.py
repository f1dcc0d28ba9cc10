"""Random NetCDF files after the conventions CF.

The numbers are evaluated here by the conventions' sections 2.5.1 and 8.1; xarray and netCDF4, which mask and scale by
themselves, have to agree. Where the volume lies is what the coordinates say, as xarray decodes them.
"""
import dataclasses
import warnings

import attack
import netCDF4
import numpy as np
import scipy.io
import xarray

from . import compare

warnings.filterwarnings("ignore", "endian-ness of dtype")
CLASSIC = ("NETCDF3_CLASSIC", "NETCDF3_64BIT_OFFSET", "NETCDF3_64BIT_DATA")
LENGTHS = {"m": ("m", 1.0), "km": ("km", 1e3), "mm": ("mm", 1e-3), "um": ("um", 1e-6), "nm": ("nm", 1e-9),
           "micron": ("um", 1e-6), "meters": ("m", 1.0), "metre": ("m", 1.0), "cm": ("cm", 1e-2),
           "µm": ("um", 1e-6), "Kilometers": ("km", 1e3), "angstrom": ("angstrom", 1e-10)}
OTHERS = ("degrees_north", "days since 2000-01-01", "K", "1", "hPa", "")
NAMES = ("time", "lev", "lat", "lon", "z", "y", "x", "member", "t", "a b", "größe", "x-1")


@dataclasses.dataclass
class Axis:
    name: str
    length: int
    coordinates: object = None  # as they mean
    unit: object = None
    unlimited: bool = False


def _kinds(fmt):
    classic = ("i1", "i2", "i4", "f4", "f8")
    return classic + ("u1", "u2", "u4", "i8", "u8") if fmt in ("NETCDF4", "NETCDF3_64BIT_DATA") else classic


def _axes(one, fmt):
    count = one.pick(1, 2, 3, 3, 3, 3, 4, 4, 5)
    names = list(one.random.permutation(NAMES))[:count]
    axes = [Axis(name, int(one.random.integers(1, 9)) if one.chance(0.9) else int(one.random.integers(9, 40)))
            for name in names]
    if one.chance(0.4):
        axes[0].unlimited = True
    if fmt == "NETCDF4":
        for axis in axes[1:]:
            axis.unlimited = one.chance(0.1)
    return axes


def _write_coordinates(one, group, axis, fmt):
    """A coordinate variable, with the numbers that it means."""
    way = one.pick("none", "even", "even", "even", "descending", "descending", "jittered", "uneven", "constant", "packed")
    if way == "none":
        return
    kind = one.pick(*(k for k in _kinds(fmt) if k not in ("i1", "u1")))
    step = one.pick(1, 2, 3, 5) if kind[0] in "iu" else 10.0 ** one.random.uniform(-3, 3)
    first = int(one.random.integers(0, 50)) if kind[0] in "iu" else one.random.normal() * step * 10
    places = first + step * np.arange(axis.length)
    if way == "descending":
        places = places[::-1]
    elif way == "jittered" and kind[0] == "f":
        places = places + step * one.random.uniform(-0.02, 0.02, axis.length)
    elif way == "uneven" and axis.length > 2:
        places = places + step * np.where(np.arange(axis.length) == 1, 0.6, 0) if kind[0] == "f" else first + np.arange(axis.length) ** 2
    elif way == "constant":
        places = np.full(axis.length, first)
    attributes = {}
    if way == "packed":
        kind = one.pick("i2", "i4")
        attributes = {"scale_factor": float(one.pick(0.5, 0.25, 2.0, -0.125, 0.1)), "add_offset": float(one.pick(0, 10.5, -3))}
        places = np.arange(axis.length)
    stored = np.asarray(places).astype(kind)
    variable = group.createVariable(axis.name, kind, (axis.name,))
    variable.set_auto_maskandscale(False)
    variable[:] = stored
    if one.chance(0.5):
        axis.unit = one.pick(*LENGTHS, *LENGTHS, *OTHERS)
        variable.units = axis.unit
    variable.setncatts(attributes)
    if one.chance(0.3):
        variable.long_name = "a coordinate"
    axis.coordinates = stored.astype("f8") * attributes.get("scale_factor", 1) + attributes.get("add_offset", 0)


def _attributes(one, kind, data):
    """Attributes of packed and missing data, as their type demands, or as programs write them."""
    kind = np.dtype(kind)
    attributes, fill = {}, None
    values = np.unique(data)
    pick = lambda: values[one.random.integers(len(values))]  # noqa: E731
    if one.chance(0.3):
        fill = pick()
    if one.chance(0.25):
        attributes["missing_value"] = pick() if one.chance(0.7) else np.array([pick(), pick()], kind)
        if kind == np.float32 and one.chance(0.5):
            attributes["missing_value"] = np.float64(str(np.asarray(attributes["missing_value"]).flat[0]))
    if one.chance(0.15):
        low, high = sorted((pick(), pick()))
        way = one.pick("range", "min", "max", "both")
        if way == "range":
            attributes["valid_range"] = np.array([low, high], kind)
        else:
            attributes.update({"valid_min": low} if way != "max" else {})
            attributes.update({"valid_max": high} if way != "min" else {})
    if one.chance(0.3):
        attributes["scale_factor"] = one.pick(np.float64(0.01), np.float32(0.1), np.float64(2), np.int16(3), np.float64(-0.5))
    if one.chance(0.3):
        attributes["add_offset"] = one.pick(np.float64(273.15), np.float32(-0.3), np.float64(-5), np.int32(100))
    if kind.kind == "i" and kind.itemsize < 8 and one.chance(0.15):
        attributes["_Unsigned"] = one.pick("true", "True", "false")
    return attributes, fill


def _decoded(raw, attributes, fill):
    """What CF says that the stored numbers mean, in float64 or as they are."""
    unsigned = str(attributes.get("_Unsigned", "")).lower() == "true"
    meant = raw.view(raw.dtype.str.replace("i", "u")) if unsigned else raw

    def as_stored(number):
        array = np.atleast_1d(np.asarray(number))
        if meant.dtype.kind == "f":
            return array.astype(meant.dtype)
        return array.astype(raw.dtype).view(meant.dtype) if unsigned else array
    mask = np.zeros(raw.shape, bool)
    for number in ([] if fill is None else [fill]) + [attributes[k] for k in ("missing_value",) if k in attributes]:
        mask |= np.isin(meant, as_stored(number))
    low = attributes["valid_range"][0] if "valid_range" in attributes else attributes.get("valid_min")
    high = attributes["valid_range"][1] if "valid_range" in attributes else attributes.get("valid_max")
    low, high = (None if end is None else as_stored(end)[0] for end in (low, high))
    if low is not None:
        mask |= ~(meant >= low)
    if high is not None:
        mask |= ~(meant <= high)
    scaled = any(key in attributes for key in ("scale_factor", "add_offset"))
    bounded = low is not None or high is not None or fill is not None or "missing_value" in attributes
    if not scaled and not bounded:
        return meant, mask
    values = meant.astype("f8") * np.float64(attributes.get("scale_factor", 1)) + np.float64(attributes.get("add_offset", 0))
    values[mask] = np.nan
    return values, mask


def _filler(one, group, fmt, axes, name):
    """Another variable of fewer axes, or of text, so that the file is not of one variable alone."""
    way = one.pick("record", "scalar", "text", "flat")
    if way == "record" and axes[0].unlimited:
        group.createVariable(name, one.pick(*_kinds(fmt)), (axes[0].name,))[:] = np.arange(axes[0].length)
    elif way == "scalar":
        group.createVariable(name, "i4", ())
    elif way == "text":
        group.createVariable(name, "S1", (axes[-1].name,))[:] = np.array(["a"] * axes[-1].length, "S1")
    elif len([axis for axis in axes if axis.length > 1]) > 1:
        group.createVariable(name, one.pick(*_kinds(fmt)), (axes[-1].name,))[:] = np.arange(axes[-1].length)


def _write(one, path, fmt):
    axes = _axes(one, fmt)
    kind = one.pick(*_kinds(fmt))
    data = compare.numbers(one, [axis.length for axis in axes], kind)
    attributes, fill = _attributes(one, kind, data)
    storage = {}
    if fmt.startswith("NETCDF4"):
        if one.chance(0.5):
            storage = {"zlib": one.chance(0.7), "shuffle": one.chance(0.5), "fletcher32": one.chance(0.3),
                       "chunksizes": [int(one.random.integers(1, axis.length + 1)) for axis in axes]}
        if one.chance(0.3):
            kind = ">" + kind
    name = one.pick("values", "temperature", "grö", "v 1", "x_1")
    nested = fmt == "NETCDF4" and one.chance(0.3)
    with netCDF4.Dataset(path, "w", format=fmt) as file:
        file.set_fill_on() if one.chance(0.5) else file.set_fill_off()
        if one.chance(0.5):
            file.title, file.numbers = "t" * int(one.random.integers(1, 6)), np.arange(one.random.integers(1, 4), dtype="i2")
        group = file.createGroup("g/h") if nested else file
        for axis in axes:
            (file if nested and one.chance(0.5) else group).createDimension(axis.name, None if axis.unlimited else axis.length)
        before = one.chance(0.5)
        if before:
            _filler(one, group, fmt, axes, "f1")
        variable = group.createVariable(name, kind, [axis.name for axis in axes], fill_value=fill, **storage)
        variable.set_auto_maskandscale(False)
        for key, value in attributes.items():
            variable.setncattr(key, value)
        if one.chance(0.3):
            variable.units = "m"
        if one.chance(0.5):
            _filler(one, group, fmt, axes, "f2")
        for axis in axes:
            _write_coordinates(one, file if axis.name in file.dimensions else group, axis, fmt)
        variable[:] = data
    return ("g/h/" if nested else "") + name, axes, data, attributes, fill


def _judges(path, name, raw, values, mask, attributes, fill, fmt):
    """What the readers say against what was written, and what it means here; empty if they agree."""
    *groups, variable = name.split("/")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with netCDF4.Dataset(path) as file:
            here = file["/".join(groups)] if groups else file
            here[variable].set_auto_maskandscale(False)
            if not np.array_equal(here[variable][:], raw, equal_nan=raw.dtype.kind == "f"):
                return "netCDF4 reads other stored numbers"
            here[variable].set_auto_maskandscale(True)
            masked = here[variable][:]
            found = np.ma.getmaskarray(masked) | (np.isnan(masked.data) if masked.dtype.kind == "f" else False)
            cast = np.asarray(attributes.get("missing_value", 0)).dtype == np.float64 and raw.dtype == np.float32  # xarray has it
            default = cast | (raw == netCDF4.default_fillvals[raw.dtype.str[1:]])  # which means nothing here, as in xarray
            ranged = any(key.startswith("valid_") for key in attributes)
            # netCDF4's own mistake (1.6.2): it compares with unsigned bounds where "_Unsigned" is there, "false", too.
            as_unsigned = ranged and attributes.get("_Unsigned") == "false"
            if not default.any() and not as_unsigned and not np.array_equal(found, mask | np.isnan(values) if values.dtype.kind == "f" else mask):
                return f"netCDF4 masks {found.sum()}, not {mask.sum()}"
        if fmt in CLASSIC[:2]:
            with scipy.io.netcdf_file(path, mmap=False, maskandscale=False) as file:
                if not np.array_equal(file.variables[variable.encode().decode("latin1")][:], raw, equal_nan=raw.dtype.kind == "f"):
                    return "scipy reads other stored numbers"
        with xarray.open_dataset(path, group="/".join(groups) or None, decode_times=False) as file:
            decoded = file[variable].values
            if not ranged and "_Unsigned" not in attributes:
                if not np.allclose(decoded.astype("f8"), values.astype("f8"), rtol=2e-6, equal_nan=True,
                                   atol=1e-4 if "scale_factor" in attributes or "add_offset" in attributes else 0):
                    return "xarray decodes other values"
    return ""


def _is_even(places):
    step = (places[-1] - places[0]) / (len(places) - 1)
    return step != 0 and (np.abs(places - places[0] - step * np.arange(len(places))) < 0.1 * abs(step)).all()


def _is_uneven(places):
    """Coordinates that mean places, but that even ones cannot stand for."""
    return places is not None and len(places) > 1 and np.isfinite(places).all() and np.ptp(places) > 0 and not _is_even(places)


def _placed(axes, values):
    """Spacing, origin, unit, and the values with ascending axes; axes are slowest first."""
    spacing, origin, units = [], [], []
    for i, axis in enumerate(axes):
        step, first, unit = 1.0, 0.0, ""
        places = axis.coordinates
        if places is not None and len(places) == 1:
            first, unit = places[0], axis.unit or ""
        elif places is not None and _is_even(places):
            step, first, unit = (places[-1] - places[0]) / (len(places) - 1), places[0], axis.unit or ""
            if step < 0:
                step, first = -step, places[-1]
                values = np.flip(values, i)
        spacing.append(step)
        origin.append(first)
        units.append(unit)
    known = [LENGTHS.get(unit.strip()) for unit in units]
    counts = [axis.length > 1 or known[i] for i, axis in enumerate(axes)]
    common = None
    if any(counts) and all(known[i] for i in range(len(axes)) if counts[i]):
        common = next(known[i] for i in reversed(range(len(axes))) if counts[i])
        for i in range(len(axes)):
            if known[i]:
                spacing[i] *= known[i][1] / common[1] if axes[i].length > 1 and axes[i].coordinates is not None else 1
                origin[i] *= known[i][1] / common[1]
            else:
                origin[i] = 0.0
    return values, spacing, origin, common and common[0]


def _try(one, fmt):
    path = one.folder / "v.nc"
    name, axes, raw, attributes, fill = _write(one, path, fmt)
    values, mask = _decoded(raw, attributes, fill)
    problem = _judges(path, name, raw, values, mask, attributes, fill, fmt)
    if problem:
        return attack.wrong("the judges differ: " + problem)
    options = {"dataset": name} if one.chance(0.7) or "/" in name else {}
    refusals = [] if options else ["several volumes", "no variable", "no dataset"]
    if raw.dtype.itemsize == 8 and raw.dtype.kind in "iu" and np.abs(values.astype("f8")).max() > compare.MOST_EXACT:
        refusals.append("beyond 2\\^53")
    wide = [axis for axis in axes if axis.length > 1] if len(axes) > 3 else axes
    if len(wide) > 3 or one.chance(0.2):
        index = []
        for i, axis in enumerate(axes):
            index.append(int(one.random.integers(axis.length)) if i < len(axes) - 3 or one.chance(0.1) else None)
        index[-1] = None
        values = values[tuple(slice(None) if i is None else i for i in index)]
        axes = [axis for axis, i in zip(axes, index) if i is None]
        options["index"] = tuple(index)
    elif len(axes) > 3:  # NetCDF-3: without all axes of length 1; HDF5: without those beyond three
        while len(axes) > 3 or (fmt in CLASSIC and any(axis.length == 1 for axis in axes)):
            at = next(i for i, axis in enumerate(axes) if axis.length == 1)
            values = values.squeeze(at)
            del axes[at]
    if any(_is_uneven(axis.coordinates) for axis in axes):
        refusals += ["are not evenly spaced", "must"]
    values, spacing, origin, unit = _placed(axes, values)
    pad = 3 - len(axes)
    return compare.differs(one, path, compare.Expected(
        values=values.reshape((1,) * pad + values.shape), spacing=tuple(spacing[::-1]) + (1.0,) * pad,
        origin=tuple(origin[::-1]) + (0.0,) * pad, unit=unit, refusals=tuple(refusals),
        single=raw.dtype.itemsize <= 2 or raw.dtype == np.float32), **options)


def classic(one):
    return _try(one, one.pick(*CLASSIC))


def netcdf4(one):
    return _try(one, one.pick("NETCDF4", "NETCDF4", "NETCDF4_CLASSIC"))
