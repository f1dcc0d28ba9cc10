"""OME-TIFF. The judges are OME's specification, whose words on planes are written here, and tifffile for what it wrote.

https://docs.openmicroscopy.org/ome-model/6.3.1/ome-tiff/specification.html
"""
import itertools

import numpy as np
import tifffile

import attack
from arrays import tiff_writer as tw
from arrays.expect import TYPES, by_unit, check, numbers
from arrays.tiff_files import judge, look_of, page_of

# As the schema enumerates them, and what they are; None: no unit that a store has. Mm is a million metres.
UNITS = {"km": "km", "m": "m", "dm": "dm", "cm": "cm", "mm": "mm", "\u00b5m": "um", "nm": "nm", "pm": "pm", "\u00c5": "angstrom", "in": "in",
         "ft": "ft", "pixel": None, "reference frame": None, "Mm": None, "Pm": None, "fm": None, "thou": None, "yd": None}
NAMES = {"u1": "uint8", "i1": "int8", "u2": "uint16", "i2": "int16", "u4": "uint32", "i4": "int32", "f4": "float", "f8": "double"}


def escaped(one, text):
    """As an attribute of XML has it."""
    return "".join(c if ord(c) < 128 else one.pick(c, f"&#{ord(c)};", f"&#x{ord(c):X};") for c in text)


def sizes_of(one):
    """PhysicalSizes and their units, of [z, y, x]: (size or None, the unit's spelling or None)."""
    if one.chance(0.2):
        return [(None, None)] * 3
    same = one.pick("\u00b5m", "nm", "mm", None)
    sizes = []
    for _ in range(3):
        size = one.pick(0.5, 1.0, 0.325, 2, 1e-3, 123.25)
        unit = same if one.chance(0.8) else one.pick(*UNITS, None)
        sizes.append((None, None) if one.chance(0.07) else (size, unit))
    return sizes


def place_of(sizes, lengths):
    """Spacing and unit in [z, y, x]. Without a word of it a size is in micrometres."""
    units = ["" if size is None else UNITS[unit] if unit else "um" for size, unit in sizes]
    unit, factors = by_unit(units, lengths)
    return [(1 if size is None else size) * f for (size, _), f in zip(sizes, factors)], unit


def tiff_data(one, order, lengths, count):
    """Elements that say where planes are, and the plane (in `order`) that each directory has."""
    dims = order[2:]
    places = [dict(zip(dims, at[::-1])) for at in np.ndindex(*[lengths[d] for d in dims[::-1]])]
    way = one.pick("one", "none", "blocks", "each", "permuted", "permuted")
    uuid = '<UUID FileName="a.ome.tif">urn:uuid:ea5ad2a2-7f1d-4f15-8d1c-1f6c7a5a4f3e</UUID>' if one.chance(0.2) else ""

    def element(attributes):
        text = "".join(f' {k}="{v}"' for k, v in attributes.items())
        return f"<TiffData{text}>{uuid}</TiffData>" if uuid else f"<TiffData{text}/>"
    if way == "none" and not uuid:
        return "<TiffData/>", list(range(count))
    if way in ("one", "none"):
        return element(one.pick({"IFD": 0, "PlaneCount": count}, {"FirstZ": 0, "FirstC": 0, "FirstT": 0, "IFD": 0, "PlaneCount": count})), list(range(count))
    if way == "blocks":
        cuts = sorted({0, *(int(i) for i in one.random.integers(0, count, 2))})
        text = ""
        for from_, to in itertools.pairwise([*cuts, count]):
            text += element({**{f"First{d}": places[from_][d] for d in dims}, "IFD": from_, "PlaneCount": to - from_})
        return text, list(range(count))
    planes = [int(i) for i in one.random.permutation(count)] if way == "permuted" else list(range(count))
    elements = []
    for directory, plane in enumerate(planes):
        first = {f"First{d}": i for d, i in places[plane].items() if i or one.chance(0.5)}
        elements.append(element({"IFD": directory, **first, **({"PlaneCount": 1} if one.chance(0.7) else {})}))
    if one.chance(0.5):
        one.random.shuffle(elements)
    return "".join(elements), planes


def by_own_xml(one):
    lengths = {a: int(one.random.integers(1, one.pick(2, 4, 5))) for a in "TZC"}
    height, width = (int(n) for n in one.random.integers(1, 20, 2))
    kind = one.pick(*NAMES)
    rgb = one.chance(0.1)
    samples = 3 if rgb else 1
    if rgb:
        lengths["C"] = 1
    data = numbers(one, (lengths["T"], lengths["Z"], lengths["C"], height, width, samples), kind)
    order = "XY" + "".join(one.random.permutation(list("ZCT")))
    count = lengths["T"] * lengths["Z"] * lengths["C"]
    planes = data.transpose(*["TZC".index(a) for a in order[:1:-1]], 3, 4, 5).reshape(count, height, width, samples)
    elements, at = tiff_data(one, order, lengths, count)
    stored = planes[at]
    sizes = sizes_of(one)
    attributes = {"ID": "Pixels:0", "DimensionOrder": order, "Type": NAMES[kind], "SizeX": width, "SizeY": height,
                  **{f"Size{a}": n * (samples if a == "C" else 1) for a, n in lengths.items()}}
    for axis, (size, unit) in zip("ZYX", sizes):
        if size is not None:
            attributes[f"PhysicalSize{axis}"] = size
            if unit:
                attributes[f"PhysicalSize{axis}Unit"] = escaped(one, unit)
    if one.chance(0.3):
        attributes["BigEndian"] = "true"
    keys = list(attributes)
    if one.chance(0.5):
        one.random.shuffle(keys)
    mark, blank = one.pick('"', '"', "'"), one.pick(" ", "  ", "\n   ", "\t")
    front = one.pick("", "", "", "ome:")
    channels = "".join(f'<Channel ID="Channel:0:{c}" SamplesPerPixel="{samples}"/>' for c in range(lengths["C"]))
    pixels = f"<{front}Pixels" + "".join(f"{blank}{k}={mark}{attributes[k]}{mark}" for k in keys) + ">"
    name = one.pick("a", "a &gt; b", "x=\u00e4", "Pixels SizeZ=99")
    remark = one.pick("", "", "<!-- Pixels SizeX -->", "<!-- <Pixels SizeZ=\"9\"> -->")
    schema = "http://www.openmicroscopy.org/Schemas/OME/2016-06"
    space = f'xmlns:ome="{schema}"' if front else f'xmlns="{schema}"'
    if front:
        channels, elements = (t.replace("<", "<ome:").replace("<ome:/", "</ome:") for t in (channels, elements))
    text = (one.pick("", '<?xml version="1.0" encoding="UTF-8"?>', '<?xml version="1.0" encoding="UTF-8" standalone="no"?>\n') + remark +
            f'<{front}OME {space}><{front}Image ID="Image:0" Name="{name}">{pixels}{channels}{elements}</{front}Pixels></{front}Image></{front}OME>')
    look = {**look_of(one, kind, samples), "photometric": 2 if rgb else 1}
    pages = [page_of(one, plane, look) for plane in stored]
    for page in pages:
        page.pop("tags", None)
        if one.chance(0.2):  # levels of a pyramid
            page["below"] = [page_of(one, page["data"][::2, ::2], {**look, "tags": {}, "kind": 1})]
    pages[0]["tags"] = {270: (2, text.encode() + b"\0"), 282: (5, [(72, 1)]), 283: (5, [(72, 1)]), 296: (3, [one.pick(1, 2, 3)])}
    path = one.folder / "a.ome.tif"
    tw.Tiff(one, one.pick("<", ">"), bool(one.chance(0.3))).write(path, pages)
    judge(path, stored)
    place = {a: int(one.random.integers(lengths[a])) for a in "TC"}
    index = {a.lower(): i for a, i in place.items() if lengths[a] > 1}
    chosen = data[place["T"], :, place["C"], :, :, 0]
    if rgb:
        s = int(one.random.integers(3))
        index["c"], chosen = s, data[place["T"], :, 0, :, :, s]
    spacing, unit = place_of(sizes, chosen.shape)
    return check(one, path, chosen, {"index": index or None}, spacing=spacing, unit=unit)


def write_by_tifffile(one, path, data, metadata, several):
    with tifffile.TiffWriter(path, ome=True, byteorder=one.pick("<", ">"), bigtiff=bool(one.chance(0.3))) as file:
        pyramid = int(one.pick(0, 0, 1, 2))
        options = {"photometric": "minisblack", **one.pick({}, {"tile": (16, 16)}, {"rowsperstrip": 3}, {"compression": "zlib"})}
        file.write(data, subifds=pyramid, metadata=metadata, **options)
        for level in range(pyramid):
            file.write(data[..., ::2 ** (level + 1), ::2 ** (level + 1)], subfiletype=1, metadata=None, **options)
        if several:
            file.write(data[..., ::-1], metadata=metadata, photometric="minisblack")


def by_tifffile(one):
    axes = "".join(a for a in one.random.permutation(list("TCZ")) if one.chance(0.7)) + "YX"
    shape = tuple(int(one.random.integers(1, 5)) for _ in axes[:-2]) + tuple(int(n) for n in one.random.integers(2, 20, 2))
    data = numbers(one, shape, one.pick(*[t for t in TYPES if t in NAMES]))
    sizes = sizes_of(one)
    metadata = {"axes": axes}
    for axis, (size, unit) in zip("ZYX", sizes):
        if size is not None:
            metadata[f"PhysicalSize{axis}"] = size
            if unit:
                metadata[f"PhysicalSize{axis}Unit"] = unit
    path = one.folder / "a.ome.tif"
    several = one.chance(0.05)
    try:
        write_by_tifffile(one, path, data, metadata, several)
    except IndexError:
        return attack.refused("tifffile does not write some pyramids")
    try:
        with tifffile.TiffFile(path) as file:
            np.testing.assert_array_equal(file.series[0].asarray().reshape(shape), data)
    except tifffile.TiffFileError as error:
        if "tag list" not in str(error):  # it does not always find the levels that it wrote
            raise
    whole = {a: n for a, n in zip(axes, shape)}
    place = {a: int(one.random.integers(whole.get(a, 1))) for a in "TC"}
    chosen = data[tuple(place.get(a, slice(None)) for a in axes)]
    chosen = chosen.reshape((whole.get("Z", 1), *shape[-2:]))
    spacing, unit = place_of(sizes, chosen.shape)
    return check(one, path, chosen, {"index": {a.lower(): i for a, i in place.items() if whole.get(a, 1) > 1} or None}, spacing=spacing,
                 unit=unit, refused="several images" if several else None)


def ome_tiff(one):
    return one.pick(by_own_xml, by_own_xml, by_tifffile)(one)
