"""OME-Zarr of versions 0.4 and 0.5 by the specification: https://ngff.openmicroscopy.org/0.4/ and /0.5/."""
import json

import numpy as np
import zarr

from arrays import zarr3
from arrays.expect import TYPES, by_unit, check, numbers
from arrays.zarr_files import CODECS, array_v3, fill_of, with_holes

# Of the specification's list, and what they are; None: no unit that a store has.
UNITS = {"micrometer": "um", "nanometer": "nm", "millimeter": "mm", "centimeter": "cm", "meter": "m", "angstrom": "angstrom", "inch": "in",
         "foot": "ft", "kilometer": "km", "picometer": "pm", "decimeter": "dm", "yard": None, "femtometer": None, "megameter": None,
         "parsec": None, "pixel": None}


def write_array(one, version, folder, data, fill):
    chunks = [int(one.pick(n, 1, one.random.integers(1, n + 1))) if len(data.shape) - i > 3 else int(one.random.integers(max(1, n // 3), n + 3))
              for i, n in enumerate(data.shape)]
    if version == "0.4":
        array = zarr.open_array(str(folder), mode="w", shape=data.shape, chunks=chunks, dtype=data.dtype.newbyteorder(one.pick("<", ">")),
                                compressor=one.pick(*CODECS)(one), dimension_separator=one.pick("/", "/", "."), order=one.pick("C", "F"), fill_value=fill,
                                write_empty_chunks=bool(one.chance(0.3)))
        array[...] = data
        return
    codecs = [*zarr3.random_transposes(one, data.ndim, 1), zarr3.random_bytes(one, data.dtype), *zarr3.random_packers(one, data.dtype)]
    array_v3(one, folder, data, chunks, [zarr3.random_shards(one, data.dtype, chunks)] if one.chance(0.4) else codecs, fill)


def write_group(version, folder, attributes):
    folder.mkdir(parents=True, exist_ok=True)
    if version == "0.4":
        (folder / ".zgroup").write_text('{"zarr_format": 2}')
        (folder / ".zattrs").write_text(json.dumps(attributes))
    else:
        ome = {"attributes": {"ome": {"version": version, **attributes}}} if attributes else {"attributes": {}}
        (folder / "zarr.json").write_text(json.dumps({"zarr_format": 3, "node_type": "group", **ome}))


def ome_zarr(one):
    version = one.pick("0.4", "0.5")
    space = "zyx" if one.chance(0.9) else "yx"
    if space == "zyx" and one.chance(0.05):  # should be zyx, and need not
        space = "".join(one.random.permutation(list("zyx")))
    axes = "".join(a for a in "tc" if one.chance(0.4)) + space
    shape = tuple(int(one.random.integers(1, 4)) if a in "tc" else int(one.random.integers(1, one.pick(3, 12, 20))) for a in axes)
    kind = one.pick(*TYPES)
    fill = fill_of(one, kind)
    data = with_holes(one, numbers(one, shape, kind), [max(1, n // 2) for n in shape], fill)
    same = one.pick("micrometer", "nanometer", "millimeter", "")
    units = {a: same if one.chance(0.85) else one.pick(*UNITS, "") for a in space}
    described = []
    for a in axes:
        about = {"name": a, "type": {"t": "time", "c": "channel"}.get(a, "space")}
        if a in space and units[a]:
            about["unit"] = units[a]
        if a == "t" and one.chance(0.5):
            about["unit"] = "second"
        described.append(about)
    levels = [data]
    for _ in range(int(one.random.integers(0, 3))):
        levels.append(np.ascontiguousarray(levels[-1][tuple(slice(None, None, 1 if a in "tc" else 2) for a in axes)]))
    names = one.pick([str(i) for i in range(3)], ["s0", "s1", "s2"], ["a/0", "a/1", "b/2"])
    base = np.array([1.0 if a in "tc" else one.pick(0.5, 0.25, 2.0, 1.0, 1e-3, 13.5) for a in axes])
    first = np.array([0.0 if a in "tc" else one.pick(0, -7.5, 100.25) for a in axes])
    shifts = one.chance(0.5)
    whole = one.chance(0.2)
    factor, offset = np.array([1.0 if a in "tc" else one.pick(2.0, 0.1) for a in axes]), np.array([0.0 if a in "tc" else 3.0 for a in axes])
    if space != "yx" and one.chance(0.04):
        base[-1] *= -1
    datasets, places = [], []
    for level, name in zip(range(len(levels)), names):
        scale = base * [1 if a in "tc" else 2**level for a in axes]
        moves = first + (scale - base) / 2 if level else first
        steps = [{"type": "scale", "scale": scale.tolist()}]
        if shifts:
            steps.append({"type": "translation", "translation": moves.tolist()})
        datasets.append({"path": name, "coordinateTransformations": steps})
        scale, moves = np.array(scale), moves if shifts else np.zeros(len(axes))
        places.append((scale * factor, moves * factor + offset) if whole else (scale, moves))
    image = {"axes": described, "datasets": datasets, **({"name": "v"} if one.chance(0.5) else {}), **({"version": version} if version == "0.4" else {})}
    if whole:
        image["coordinateTransformations"] = [{"type": "scale", "scale": factor.tolist()}, {"type": "translation", "translation": offset.tolist()}]
    root = one.folder / one.pick("v.ome.zarr", "v.zarr", "v")
    inside = one.pick("", "", "", "0", "A/1/0")
    folder = root / inside
    parents = [root, *[root / "/".join(inside.split("/")[:i]) for i in range(1, inside.count("/") + 1)]] if inside else []
    for parent in parents:
        bioformats = parent == root and inside == "0" and one.chance(0.5)
        write_group(version, parent, {"bioformats2raw.layout": 3} if bioformats else {})
    write_group(version, folder, {"multiscales": [image], **({"omero": {"channels": []}} if one.chance(0.3) else {})})
    for name, values in zip(names, levels):
        for depth in range(1, name.count("/") + 1):
            write_group(version, folder / "/".join(name.split("/")[:depth]), {})
        write_array(one, version, folder / name, values, fill)
    if one.chance(0.2):
        write_group(version, folder / "labels", {"labels": []})
    level = int(one.random.integers(len(levels))) if one.chance(0.5) else 0
    options = {}
    if level or one.chance(0.2):
        options["dataset"] = (inside + "/" if inside else "") + names[level]
    elif inside and one.chance(0.2):
        options["dataset"] = inside
    values, (scale, move) = levels[level], places[level]
    at = {a: int(one.random.integers(n)) for a, n in zip(axes, values.shape) if a in "tc" and (n > 1 or one.chance(0.3))}
    chosen = values[tuple(at.get(a, 0) if a in "tc" else slice(None) for a in axes)]
    index = None
    if at:
        index = at if one.chance(0.6) else tuple(at.get(a, 0) if a in "tc" else None for a in axes)
    # By their names, [z, y, x].
    chosen = chosen.transpose([space.index(a) for a in sorted(space, reverse=True)])
    scale = [abs(scale[axes.index(a)]) if a in axes else 1 for a in "zyx"]
    signs = [np.sign(places[level][0][axes.index(a)]) if a in axes else 1 for a in "zyx"]
    move = [move[axes.index(a)] if a in axes else 0 for a in "zyx"]
    lengths = [1] * (3 - chosen.ndim) + list(chosen.shape)
    unit, factors = by_unit([UNITS[units[a]] if units.get(a) else "" for a in "zyx"], lengths)
    for i, sign in enumerate(signs):
        if sign < 0:
            move[i] -= scale[i] * (lengths[i] - 1)
            chosen = np.flip(chosen, i - (3 - chosen.ndim))
    return check(one, root, chosen, {"index": index, **options}, spacing=[s * f for s, f in zip(scale, factors)],
                 origin=[m * f for m, f in zip(move, factors)], unit=unit)
