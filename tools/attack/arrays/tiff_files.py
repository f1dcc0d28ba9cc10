"""TIFF: pages, files of a series, descriptions of ImageJ. The judges are tifffile, where it decodes, and what was written."""
import json
import struct
import subprocess

import numpy as np
import tifffile

import attack
from arrays import tiff_writer as tw
from arrays.expect import TYPES, by_unit, check, numbers

PREDICTED = (tw.LZW, tw.DEFLATE, tw.OLD_DEFLATE, tw.LZMA, tw.ZSTD)


def look_of(one, kind, samples):
    """How a page is stored."""
    kind = np.dtype(kind)
    look = {"compression": one.pick(tw.NONE, tw.NONE, tw.LZW, tw.DEFLATE, tw.OLD_DEFLATE, tw.PACKBITS, tw.LZMA, tw.ZSTD),
            "planar": one.pick(1, 2) if samples > 1 else 1, "photometric": one.pick(0, 1, 1, 1), "predictor": 1}
    if samples >= 3 and one.chance(0.5):
        look["photometric"] = 2
    if samples == 1 and kind.str[1:] in ("u1", "u2") and one.chance(0.05):
        look["photometric"] = 3
    if look["compression"] in PREDICTED and one.chance(0.6):
        look["predictor"] = 3 if kind.kind == "f" else 2
    if look["compression"] == tw.NONE and one.chance(0.03):
        look["fill_order"] = 2
    if one.chance(0.1):
        look["orientation"] = int(one.random.integers(1, 9))
    if one.chance(0.1):
        # Resolution is what a printer needs, without a word of who made the file.
        look["tags"] = {282: (5, [(one.pick(72, 300, 25400), one.pick(1, 7))]), 283: (5, [(72, 1)]), 296: (3, [one.pick(1, 2, 3)])}
    if one.chance(0.05):
        look.setdefault("tags", {})[270] = (2, one.pick(b"a picture\0", b"\0", b"spacing=3\nunit=mm\0", "\u00e4 <OM".encode() + b"\0"))
    if one.chance(0.05):
        look.setdefault("tags", {})[65000] = (one.pick(1, 3, 12), [1, 2, 3])
    return look


def page_of(one, data, look):
    """[height, width, samples], with strips or tiles of its own."""
    height = data.shape[0]
    page = {"data": np.ascontiguousarray(data), **look}
    if one.chance(0.4):
        page["rows"], page["columns"] = 16 * one.pick(1, 1, 2, 3, 5), 16 * one.pick(1, 1, 2, 3, 5)
    else:
        page["rows"] = one.pick(1, 2, 3, height, max(1, height - 1), height + 5, 2**32 - 1, int(one.random.integers(1, height + 1)))
    return page


def pages_of(one, data, look):
    """Of [pages, height, width, samples]; with smaller copies, which are not of the volume."""
    pages = []
    for plane in data:
        page = page_of(one, plane, look if one.chance(0.8) else {**look_of(one, plane.dtype, plane.shape[2]), "photometric": look["photometric"]})
        pages.append(page)
    if one.chance(0.15):
        for page in list(pages):
            small = page_of(one, page["data"][::2, ::2], {**look, "kind": 1})
            if one.chance(0.5):
                page.setdefault("below", []).append(small)
            else:
                pages.insert(next(i for i, p in enumerate(pages) if p is page) + 1, small)
    return pages


def judge(path, data, before=0, behind=0):
    """tifffile reads the same, where it has the codecs. `data`: [pages, height, width, samples]; pages before and behind them are previews."""
    try:
        with tifffile.TiffFile(path) as file:
            pages = [page for page in file.pages if not page.is_reduced]
            pages = pages[before:len(pages) - behind]
            found = [page.asarray() for page in pages]
    except (ValueError, NotImplementedError, RuntimeError) as error:
        if "imagecodecs" in str(error) or "cannot decompress" in str(error) or "predictor" in str(error).lower():
            return
        raise
    assert len(found) == len(data), f"tifffile: {len(found)} pages of {len(data)}"
    for one_page, page, plane in zip(found, pages, data):
        if page.planarconfig == 2 and page.samplesperpixel > 1:
            one_page = np.moveaxis(one_page.reshape(page.samplesperpixel, page.imagelength, page.imagewidth), 0, -1)
        np.testing.assert_array_equal(one_page.reshape(plane.shape), plane)


def size_of(one):
    return int(one.random.integers(1, one.pick(3, 12, 40))), int(one.random.integers(1, one.pick(3, 12, 40)))


def random_volume(one, most_pages=5, kind=None):
    kind = kind or one.pick(*TYPES)
    samples = one.pick(1, 1, 1, 1, 2, 3, 4)
    return numbers(one, (int(one.random.integers(1, most_pages + 1)), *size_of(one), samples), kind)


def sample_of(one, data, name="c"):
    """An index of a sample, where there are several, and what it chooses of [pages, height, width, samples]."""
    samples = data.shape[-1]
    if samples == 1:
        return None, data[..., 0], None
    if one.chance(0.05):
        return None, data[..., 0], "volumes along axis"
    s = int(one.random.integers(-samples, samples))
    return ({name: s} if one.chance(0.7) else (None, None, None, s)), data[..., s], None


def by_own_writer(one):
    data = random_volume(one)
    look = look_of(one, data.dtype, data.shape[-1])
    path = one.folder / one.pick("a.tif", "a.tiff", "a", "a.raw")
    order = one.pick("<", ">")
    pages, before, behind = pages_of(one, data, look), [], []
    if min(data.shape[1:3]) > 1 and one.chance(0.15):
        # Previews, at most half as wide and as high, at the ends of the file.
        before, behind = one.pick((1, 0), (0, 1), (1, 1) if len(data) > 2 else (1, 0))
        before, behind = ([preview_of(one, data)] * n for n in (before, behind))
    tw.Tiff(one, order, bool(one.chance(0.3))).write(path, [*before, *pages, *behind])
    judge(path, data, len(before), len(behind))
    index, chosen, refused = sample_of(one, data)
    return check(one, path, chosen, {"index": index}, refused=refused)


def preview_of(one, data):
    kind, samples = one.pick("u1", "u2", data.dtype), one.pick(1, 3)
    height, width = (int(one.random.integers(1, n // 2 + 1)) for n in data.shape[1:3])
    return page_of(one, numbers(one, (height, width, samples), kind), {"compression": tw.NONE, "planar": 1, "photometric": 1, "predictor": 1})


def by_tifffile(one):
    """A last axis of one position it takes for samples."""
    data = random_volume(one)
    if min(data.shape[1:3]) < 2:
        data = np.repeat(np.repeat(data, 2, 1), 2, 2)
    samples = data.shape[-1]
    options = {"byteorder": one.pick("<", ">"), "bigtiff": bool(one.chance(0.3)), "metadata": one.pick(None, {}, {"axes": "ZYX"})}
    planar = "separate" if samples > 1 and one.chance(0.5) else "contig"
    options["photometric"] = "rgb" if samples in (3, 4) and one.chance(0.5) else one.pick("minisblack", "miniswhite")
    if samples > 1:
        options["planarconfig"] = planar
    options.update(one.pick({"tile": (16 * one.pick(1, 2, 4), 16 * one.pick(1, 3))}, {"rowsperstrip": one.pick(1, 3, 7)}, {}))
    if one.chance(0.4):
        options["compression"] = "zlib"
    if samples > 1 and isinstance(options["metadata"], dict):
        options["metadata"] = {}
    if one.chance(0.2):
        options["description"], options["metadata"] = one.pick("words", "spacing=7", json.dumps({"shape": [1]})), None
    path = one.folder / "a.tif"
    stack = data[..., 0] if samples == 1 else np.moveaxis(data, -1, 1) if planar == "separate" else data
    tifffile.imwrite(path, stack, **options)
    judge(path, data)
    index, chosen, refused = sample_of(one, data)
    return check(one, path, chosen, {"index": index}, refused=refused)


def by_tiffcp(one):
    """libtiff's own program writes it anew."""
    data = random_volume(one)
    kind, samples = data.dtype, data.shape[-1]
    plain = one.folder / "plain.tif"
    look = {"compression": tw.NONE, "planar": 1, "photometric": 2 if samples == 3 else 1, "predictor": 1}
    order = one.pick("<", ">")
    tw.Tiff(one, order, False).write(plain, [page_of(one, plane, look) for plane in data])
    target = one.pick("-B", "-L")
    # Under -B, on machines that are little-endian, tiffcp itself stores the bytes of predictor 3 in the wrong order.
    predictors = ["", ":2"] if kind.kind != "f" else [""] if target == "-B" or kind.itemsize == 2 else ["", ":3"]
    way = one.pick("none", "packbits", *[c + p for c in ("lzw", "zip", "zstd", "lzma") for p in predictors])
    layout = one.pick(("-s", "-r", str(one.pick(1, 3, 7, 100))), ("-t", "-w", str(16 * one.pick(1, 2, 5)), "-l", str(16 * one.pick(1, 2, 5))))
    if samples > 1 and one.chance(0.5):
        layout = (*layout, "-p", one.pick("contig", "separate"))
    path = one.folder / "a.tif"
    done = subprocess.run(["tiffcp", "-c", way, target, *layout, *(["-8"] if one.chance(0.3) else []), plain, path], capture_output=True)
    if done.returncode != 0:
        return attack.refused("tiffcp: " + done.stderr.decode(errors="replace").split(":")[-1][:80])
    judge(path, data)
    plain.unlink()
    index, chosen, refused = sample_of(one, data)
    return check(one, path, chosen, {"index": index}, refused=refused)


def unreadable(one):
    """What has to be refused, because its numbers are others than they look."""
    path = one.folder / "a.tif"
    what = one.pick("complex", "complex integers", "bits", "depth", "truncated", "differs", "volumetric")
    look = {"compression": tw.NONE, "planar": 1, "photometric": 1, "predictor": 1}
    data = numbers(one, (3, *size_of(one), 1), one.pick("u2", "f4"))
    refused = ""
    if what == "complex":
        data, refused = data.astype(one.pick("c8", "c16")), "complex"
    elif what == "complex integers":
        data, look["format"], refused = data.astype(one.pick("u4", "u8")), 5, "complex"
    elif what == "bits":
        mask = one.random.random(data.shape[:3]) < 0.5
        tifffile.imwrite(path, mask, photometric=one.pick("minisblack", "miniswhite"), byteorder=one.pick("<", ">"), metadata=None)
        np.testing.assert_array_equal(tifffile.imread(path).reshape(mask.shape), mask)
        packed = one.folder / "packed.tif"
        done = subprocess.run(["tiffcp", "-c", one.pick("none", "packbits", "g3", "g3:2d", "g4", "zip", "lzw"), "-f", one.pick("lsb2msb", "msb2lsb"),
                               *one.pick(("-s", "-r", str(one.pick(1, 3, 100))), ("-t", "-w", "16", "-l", str(16 * one.pick(1, 2)))), path, packed],
                              capture_output=True)
        return check(one, packed if done.returncode == 0 else path, mask.astype("u1"))
    elif what == "depth":
        look["tags"], refused = {one.pick(32997, 32998): (4, [one.pick(2, 3)])}, "planes in one page"
    elif what == "truncated":
        # One directory for all pages: what is behind the first is not to be lost without a word.
        data = numbers(one, (one.pick(2, 3, 5), 5, int(one.random.integers(2, 9))), one.pick("u1", "u2", "f4"))
        tifffile.imwrite(path, data, photometric="minisblack", truncate=True, byteorder=one.pick("<", ">"))
        np.testing.assert_array_equal(tifffile.imread(path), data)
        return check(one, path, data)
    elif what == "volumetric":
        data = numbers(one, (one.pick(2, 3, 20), 5, int(one.random.integers(2, 9))), one.pick("u1", "u2", "f4"))
        tifffile.imwrite(path, data, photometric="minisblack", volumetric=True, **one.pick({}, {"tile": (16, 16, 16)}), metadata=one.pick(None, {}))
        return check(one, path, data, refused="planes in one page")
    pages = [page_of(one, plane, look) for plane in data]
    if what == "depth":  # that of tiles means nothing where there are none
        for page in pages:
            page["tags"] = {tag: value for tag, value in page["tags"].items() if tag == 32997 or "columns" in page}
        refused = refused if any(page["tags"] for page in pages) else None
    if what == "differs":
        at = int(one.random.integers(3))
        other = one.pick(lambda d: np.concatenate([d, d[-1:]]), lambda d: np.concatenate([d, d[:, -1:]], 1), lambda d: d.astype("f8"),
                         lambda d: np.concatenate([d, d], 2))(pages[at]["data"])
        pages[at] = page_of(one, other, look)
        refused = "but most pages are"
    tw.Tiff(one, one.pick("<", ">"), False).write(path, pages)
    return check(one, path, data[..., 0], refused=refused)


def tiff(one):
    return one.pick(*[by_own_writer] * 5, *[by_tifffile] * 3, *[by_tiffcp] * 2, unreadable)(one)


def natural_names(one, count):
    """Names of files in the order of the volume: numbers count as numbers."""
    first, step = int(one.random.integers(0, 120)), one.pick(1, 1, 2, 10)
    digits = one.pick(0, 0, 3, 5)
    front, back = one.pick("slice", "a_", "", "Z", "img 2 ", "b1c", "\u00e4"), one.pick("", "", "_ch0", "x", "-5")
    return [f"{front}{first + step * i:0{digits}d}{back}" for i in range(count)]


def tiff_series(one):
    """Files of one or several pages, in a folder or a list."""
    count = int(one.random.integers(1, 13))
    pages = [int(one.random.integers(1, 4)) if one.chance(0.3) else 1 for _ in range(count)]
    kind = one.pick(*TYPES)
    data = numbers(one, (sum(pages), *size_of(one), one.pick(1, 1, 1, 3)), kind)
    names = natural_names(one, count)
    ending = one.pick(".tif", ".tiff", ".TIF", ".Tiff")
    folder = one.folder / one.pick("stack", "a b", "stack.tif")
    folder.mkdir()
    look = look_of(one, kind, data.shape[-1])
    imagej = one.chance(0.2)
    spacing, unit = None, None
    if imagej:
        step, pixel, unit = one.pick(1, 2.5), one.pick((1, 2), (4, 1), (1, 1)), one.pick("um", "mm")
        text = f"ImageJ=1.53t\nunit={unit}\nspacing={step}\n".encode() + b"\0"
        tags = {270: (2, text), 282: (5, [pixel]), 283: (5, [pixel]), 296: (3, [1])}
        spacing = (step, pixel[1] / pixel[0], pixel[1] / pixel[0])
    at = 0
    files = []
    for number, name in zip(pages, names):
        path = folder / (name + ending)
        looks = look if one.chance(0.5) else {**look_of(one, kind, data.shape[-1]), "photometric": look["photometric"]}
        parts = [page_of(one, plane, looks) for plane in data[at:at + number]]
        if imagej:
            parts[0]["tags"] = tags
        elif 270 in parts[0].get("tags", {}) and parts[0]["tags"][270][1].startswith(b"ImageJ"):
            del parts[0]["tags"]
        tw.Tiff(one, one.pick("<", ">"), bool(one.chance(0.3))).write(path, parts)
        files.append(path)
        at += number
    for path, part in zip(files, np.split(data, np.cumsum(pages)[:-1])):
        judge(path, part)
    index, chosen, refused = sample_of(one, data)
    if one.chance(0.5):
        if one.chance(0.5):
            (folder / "readme.txt").write_text("words")
            (folder / f".hidden{ending}").write_bytes(b"II*\0")
            (folder / "below").mkdir()
        return check(one, folder, chosen, {"index": index}, refused=refused, spacing=spacing, unit=unit)
    order = [files[i] for i in one.random.permutation(count)]
    return check(one, order if count > 1 or one.chance(0.5) else order[0], chosen, {"index": index}, refused=refused, spacing=spacing,
                 unit=unit)


# What ImageJ calls units, and what they are. An unknown word is none.
IMAGEJ_UNITS = {"um": "um", "micron": "um", "\\u00B5m": "um", "mm": "mm", "nm": "nm", "cm": "cm", "inch": "in", "pixel": "", "pixels": "",
                "": "", "m": "m", "km": "km", "sec": None, "\u00b5m": "um"}


def imagej(one):
    """Hyperstacks, whose planes lie in one order, as tifffile and ImageJ write them."""
    lengths = {a: int(one.random.integers(1, one.pick(2, 4, 6))) for a in "TZC"}
    height, width = (int(n) for n in one.random.integers(2, 20, 2))
    samples = 3 if one.chance(0.15) else 1
    kind = "u1" if samples == 3 else one.pick("u1", "u2", "f4")
    data = numbers(one, (lengths["T"], lengths["Z"], lengths["C"], height, width, samples), kind)
    written = one.pick(*IMAGEJ_UNITS)
    own = {a: one.pick(*IMAGEJ_UNITS) for a in "yz"} if one.chance(0.2) else {}
    step = one.pick(None, 1.0, 0.25, 3.5, -2.0)
    pixel = one.pick((1, 1), (2, 4), (1000000, 333333), (72, 72))
    lines = {"ImageJ": one.pick("1.53t", "1.11a"), "images": lengths["T"] * lengths["Z"] * lengths["C"]}
    for key, axis in (("channels", "C"), ("slices", "Z"), ("frames", "T")):
        if lengths[axis] > 1:
            lines[key] = lengths[axis]
    if one.chance(0.5):
        lines["hyperstack"] = "true"
        lines["mode"] = "grayscale"
    if written:
        lines["unit"] = written
    for axis, word in own.items():
        if word:
            lines[axis + "unit"] = word
    if step is not None:
        lines["spacing"] = step
    if one.chance(0.3):
        lines["loop"] = "false"
        lines["min"], lines["max"] = 0.0, 255.0
    text = "".join(f"{k}={v}\n" for k, v in lines.items()).encode() + b"\0"
    planes = data.reshape(-1, height, width, samples)
    path = one.folder / "a.tif"
    look = {"compression": tw.NONE, "planar": 1, "photometric": 2 if samples == 3 else one.pick(0, 1), "predictor": 1}
    tags = {270: (2, text), 282: (5, [(pixel[0], 1)]), 283: (5, [(pixel[1], 1)]), 296: (3, [1])}
    contiguous = len(planes) > 1 and one.chance(0.3)
    if contiguous:
        # More than 4 GiB do not fit into the directories' offsets: one directory, then all numbers.
        file = tw.Tiff(one, one.pick("<", ">"), False)
        stack = {"data": planes.reshape(-1, width, samples), "rows": 2**32 - 1, **look}
        place = file.blocks(stack)
        page = {"data": planes[0], "rows": height, **look, "tags": tags}
        at, _ = file.directory(page, ([place[0][0]], [place[1][0] // len(planes)]))
        struct.pack_into(file.order + "I", file.out, 4, at)
        path.write_bytes(file.out)
    else:
        pages = [page_of(one, plane, look) for plane in planes]
        pages[0]["tags"] = tags
        tw.Tiff(one, one.pick("<", ">"), bool(one.chance(0.1))).write(path, pages)
    if contiguous:
        with tifffile.TiffFile(path) as file:
            np.testing.assert_array_equal(file.series[0].asarray().reshape(planes.shape), planes)
    else:
        judge(path, planes)
    at = {a: int(one.random.integers(lengths[a])) for a in "TC"}
    index = {a.lower(): i for a, i in at.items() if lengths[a] > 1}
    has_axes = lengths["T"] > 1 or lengths["C"] > 1
    chosen = data[at["T"], :, at["C"], :, :, 0]
    if samples == 3:
        s = int(one.random.integers(3))
        # Without channels of their own the samples are the axis c.
        index["sample" if has_axes else "c"] = s
        chosen = data[at["T"], :, at["C"], :, :, s]
    told = "unit" in lines or "spacing" in lines
    units = [IMAGEJ_UNITS[own.get("z") or written], IMAGEJ_UNITS[own.get("y") or written], IMAGEJ_UNITS[written]]
    unit, factors = by_unit(units, (2, 2, 2))
    spacing = [abs(step) if step else 1, 1 / pixel[1] if told else 1, 1 / pixel[0] if told else 1]
    return check(one, path, chosen, {"index": index or None}, spacing=[s * f for s, f in zip(spacing, factors)], unit=unit)
