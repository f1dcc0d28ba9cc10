"""Reads a store with h5py alone, following store/FORMAT.md, and shows that VTK opens it.

Usage: store_h5py_test.py ISONEST PLUGIN_FOLDER
"""
import ctypes
import json
import os
import pathlib
import shutil
import sys
import tempfile

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served  # noqa: E402

isonest, plugins = sys.argv[1:3]
os.environ["HDF5_PLUGIN_PATH"] = plugins

import h5py  # noqa: E402  (the plugin path must be set first)
import numpy as np  # noqa: E402


def run(*arguments):
    return json.loads(served.run([isonest, *map(str, arguments), "--json"], check=True,
                                 capture_output=True, text=True).stdout)


def nodes_at(n, level):
    return tuple(-(-(m - 1) // 2**level) + 1 for m in n)


def brute_force_deviation(u, cube, level):
    """max |U - U_T| over the nodes of the six Kuhn tetrahedra of one cube (z, y, x)."""
    edge = 2**level
    lo = [c * edge for c in cube]
    worst = 0.0
    top = [s - 1 for s in u.shape]
    value = lambda p: float(u[tuple(min(a, t) for a, t in zip(p, top))])
    for order in ((0, 1, 2), (0, 2, 1), (1, 0, 2), (1, 2, 0), (2, 0, 1), (2, 1, 0)):
        p = [c + edge * (i & 1) for c, i in zip(lo, cube)]
        corners = [list(p)]
        for axis in order:
            p[axis] += edge * (-1 if cube[axis] & 1 else 1)
            corners.append(list(p))
        uc = [value(c) for c in corners]
        for z in range(edge + 1):
            for y in range(edge + 1):
                for x in range(edge + 1):
                    q = [lo[0] + z, lo[1] + y, lo[2] + x]
                    if any(a > t for a, t in zip(q, top)):
                        continue
                    d = [abs(q[a] - corners[0][a]) / edge for a in order]
                    if d[0] < d[1] or d[1] < d[2]:
                        continue
                    linear = (uc[0] * (1 - d[0]) + uc[1] * (d[0] - d[1]) + uc[2] * (d[1] - d[2])
                              + uc[3] * d[2])
                    worst = max(worst, abs(value(q) - linear))
    return worst


def version_of(f):
    """The version of a store with nothing newer than frames, except possibly chunks without the shuffle."""
    skips = bool((f["chunks"]["flags"] & 2).any())
    assert f.attrs["flags"] == (32 if skips else 0)
    return [2, 13] if skips else [2, 10]


with tempfile.TemporaryDirectory() as folder:
    volume, store = f"{folder}/v.h5", f"{folder}/v.isonest"
    run("make-volume", "noise", "--size", "37,30,45", "-o", volume)
    run("preprocess", volume, "-o", store, "--chunk", 16, "--spacing", "1,2,0.5", "--indicators",
        "linf_bar,linf_plus,deviation_bar")
    with h5py.File(volume) as f:
        original = f["data"][...]
    with h5py.File(store) as f:
        assert f.attrs["format"] in (b"isonest", "isonest"), f.attrs["format"]
        version = version_of(f)
        assert list(f.attrs["version"]) == version
        assert f.attrs["complete"] == 1
        n = tuple(int(i) for i in f.attrs["nodes"])[::-1]
        assert n == original.shape
        assert tuple(f.attrs["spacing"]) == (1, 2, 0.5)
        fields = f.attrs["fields"]
        fields = (fields.decode() if isinstance(fields, bytes) else fields).split(",")
        assert fields == ["linf_bar", "linf_plus", "deviation_bar"]
        u = f["levels/0/values"][...]
        assert u.dtype == np.float32 and np.array_equal(u, original)
        top = len(f["levels"]) - 1
        for level in range(1, top + 1):
            values = f[f"levels/{level}/values"][...]
            shape = nodes_at(n, level)
            assert values.shape == shape
            pick = np.ix_(*[np.minimum(np.arange(s) * 2**level, m - 1) for s, m in zip(shape, n)])
            assert np.array_equal(values, u[pick]), level
            for name in fields:
                array = f[f"levels/{level}/{name}"]
                assert array.shape == (*shape, 7 if level > 1 else 1), array.shape
                codes = array[...].astype("<f4").view("<u4") >> 16
                assert np.all(codes % 4 == 0), "16-bit numbers end in two bits 0"
        # Level 1 keeps the cube's centre: the largest offset of its 19 refinement nodes, rounded up.
        bar = f["levels/1/linf_bar"]
        got = bar[..., 0].astype(np.float64)
        for cube in np.ndindex(*[(m - 1) // 2 for m in n]):
            p = u[tuple(slice(2 * c, 2 * c + 3) for c in cube)].astype(np.float64)
            p = p[tuple(slice(None, None, -1 if c & 1 else 1) for c in cube)]
            eta = max(abs(p[m] - (p[tuple(0 if i == 1 else i for i in m)]
                                  + p[tuple(2 if i == 1 else i for i in m)]) / 2)
                      for m in np.ndindex(3, 3, 3) if 1 in m)
            assert eta * (1 - 1e-6) <= got[cube] <= eta * (1 + 2**-5) + 1e-7, (cube, eta, got[cube])
        assert f["levels/1/linf_bar"] == f["levels/1/deviation_bar"]  # one array, linked twice
        # The centre's deviation bounds what a brute-force search finds in the cube.
        rng = np.random.default_rng(1)
        for level in (1, 2, 3):
            deviation = f[f"levels/{level}/deviation_bar"][..., -1].astype(np.float64)
            for _ in range(6):
                cube = [int(rng.integers(s - 1)) for s in deviation.shape]
                worst = brute_force_deviation(u, cube, level)
                assert deviation[tuple(cube)] >= worst * (1 - 1e-6), (level, cube, worst)
        # The ranges of cubes, one checksum for each plane of them.
        for level in range(3, top + 1):
            cells = tuple(s - 1 for s in nodes_at(n, level))
            ranges = f[f"levels/{level}/cube_ranges"]
            assert ranges.shape == (*cells, 2) and ranges.dtype == u.dtype and not ranges.chunks
            for cube in np.ndindex(*cells):
                part = u[tuple(slice(c * 2**level, (c + 1) * 2**level + 1) for c in cube)]
                assert tuple(ranges[cube]) == (part.min(), part.max()), (level, cube)
            assert f[f"levels/{level}/cube_range_sums"].shape == cells[:1]
        assert top >= 5 and "cube_ranges" not in f["levels/2"]
        # The chunk table: where each chunk is, and what it contains.
        table = f["chunks"][...]
        raw = open(store, "rb").read()
        rows = 0
        for level in range(top + 1):
            for name in ["values", *fields]:
                if name not in f[f"levels/{level}"]:
                    continue
                array = f[f"levels/{level}/{name}"]
                first = int(array.attrs["first_chunk_row"])
                grid = [-(-s // c) for s, c in zip(array.shape[:3], array.chunks[:3])]
                rows = max(rows, first + int(np.prod(grid)))
                for i in range(array.id.get_num_chunks()):
                    info = array.id.get_chunk_info(i)
                    at = [o // c for o, c in zip(info.chunk_offset[:3], array.chunks[:3])]
                    row = table[first + (at[0] * grid[1] + at[1]) * grid[2] + at[2]]
                    assert row["offset"] == info.byte_offset and row["bytes"] == info.size
                    frame = raw[info.byte_offset: info.byte_offset + info.size]
                    assert frame[:4] == b"\x28\xb5\x2f\xfd" and frame[4] & 4  # zstd, with checksum
                    if name == "values":
                        block = array[tuple(slice(o, o + c) for o, c in
                                            zip(info.chunk_offset, array.chunks))]
                        assert row["min"] == block.min() and row["max"] == block.max()
        assert rows == len(table)
    print("h5py: header, values, indicators, chunk table agree with FORMAT.md")

    # The header's digest, and what it covers: any change there is detected.
    xxhash = ctypes.CDLL("libxxhash.so.0")
    xxhash.XXH64.restype = ctypes.c_uint64
    xxhash.XXH64.argtypes = [ctypes.c_char_p, ctypes.c_size_t, ctypes.c_uint64]

    def digest_of(f):
        stored = b"".join(np.asarray(f.attrs[name]).tobytes() for name in (
            "version", "flags", "nodes", "spacing", "origin", "value_type", "chunk", "compression",
            "exact", "fields", "range", "has_missing"))
        return xxhash.XXH64(stored, len(stored), 0)

    with h5py.File(store) as f:
        assert f.attrs["xxh64"] == digest_of(f)
        low, high = f.attrs["range"]
        assert (low, high) == (original.min(), original.max())

    def forged(change, before_2_3=False):
        """The result of check for a copy with other attributes."""
        copy = f"{folder}/forged.isonest"
        shutil.copyfile(store, copy)
        with h5py.File(copy, "r+") as f:
            if before_2_3:
                f.attrs.modify("version", np.array([2, 2], "<u4"))
                del f.attrs["xxh64"]
            change(f)
        done = served.run([isonest, "check", copy], capture_output=True, text=True)
        return done.returncode, done.stdout + done.stderr

    assert forged(lambda f: None) == (0, forged(lambda f: None, True)[1])
    for name, wrong in (("range", np.array([np.nan, high])), ("range", np.array([0.0, 1.0])),
                        ("range", np.array([-1e9, 1e9])), ("range", np.array([low, np.inf])),
                        ("has_missing", np.uint32(7)), ("has_missing", np.uint32(1))):
        for before_2_3 in (False, True):
            code, text = forged(lambda f: f.attrs.modify(name, wrong), before_2_3)
            words = "one of them is damaged" if before_2_3 else "header: damaged"
            assert code == 4 and words in text, (name, wrong, text)
    code, text = forged(lambda f: f.attrs.modify("spacing", np.array([1.0, 2.0, 0.25])))
    assert code == 4 and "header: damaged" in text, text

    def without_group(f):
        del f["VTKHDF"]

    def other_values(f):
        del f["VTKHDF/PointData/values"]
        f["VTKHDF/PointData/values"] = f["levels/1/values"]

    for change in (without_group, other_values,
                   lambda f: f["VTKHDF"].attrs.modify("Spacing", np.array([1.0, 2.0, 0.25])),
                   lambda f: f["VTKHDF"].attrs.modify("Origin", np.array([0.0, np.nan, 0.0])),
                   lambda f: f["VTKHDF"].attrs.modify("WholeExtent",
                                                      np.array([-1, 44, 0, 29, 0, 36]))):
        code, text = forged(change)
        assert code == 4 and "VTKHDF" in text, text
    print("h5py: damaged headers and VTKHDF groups are found")

    # The unit of length, with a checksum of its own.
    def unit_of(store_of_unit):
        with h5py.File(store_of_unit) as f:
            if "unit" not in f.attrs:
                return list(f.attrs["version"]), None
            stored = np.asarray(f.attrs["unit"]).tobytes()
            assert f.attrs["unit_xxh64"] == xxhash.XXH64(stored, len(stored), 0)
            assert f.attrs["xxh64"] == digest_of(f)
            return list(f.attrs["version"]), stored.decode()

    assert unit_of(store) == ([2, 10], None)
    for symbol in "km m dm cm mm um nm angstrom pm ft in".split():
        with_unit = f"{folder}/unit.isonest"
        run("preprocess", volume, "-o", with_unit, "--chunk", 16, "--spacing", "1,2,0.5", "--unit", symbol, "--force")
        assert unit_of(with_unit) == ([2, 10], symbol), unit_of(with_unit)
        assert run("info", with_unit)["unit"] == symbol
    print("h5py: the unit of length is the one that was said")

    # The patient's axes, with a checksum of their own; changes there are detected.
    def frame_of(framed):
        with h5py.File(framed) as f:
            if "frame" not in f.attrs:
                assert "frame_xxh64" not in f.attrs
                return None
            stored = np.asarray(f.attrs["frame"]).tobytes()
            assert stored in (b"RAS", b"LPS") and f.attrs["frame_xxh64"] == xxhash.XXH64(stored, len(stored), 0)
            assert f.attrs["xxh64"] == digest_of(f) and list(f.attrs["version"]) == [2, 10]
            return stored.decode()

    framed = f"{folder}/framed.isonest"
    assert frame_of(store) is None and run("info", store)["frame"] is None
    for word, frame in (("ras", "RAS"), ("LPS", "LPS")):
        run("preprocess", volume, "-o", framed, "--chunk", 16, "--frame", word, "--force")
        assert frame_of(framed) == frame == run("info", framed)["frame"]

    def refused(change, code=4, minor=None):
        copy = f"{folder}/reframed.isonest"
        shutil.copyfile(framed, copy)
        with h5py.File(copy, "r+") as f:
            if minor is not None:
                f.attrs.modify("version", np.array([2, minor], "<u4"))
            change(f)
            f.attrs.modify("xxh64", np.uint64(digest_of(f)))
        done = served.run([isonest, "info", copy, "--json"], capture_output=True, text=True)
        assert done.returncode == code, (done.returncode, done.stdout)
        return json.loads(done.stdout)

    def say(name, digest=True):
        def change(f):
            f.attrs.create("frame", np.bytes_(name))
            if digest:
                f.attrs.modify("frame_xxh64", np.uint64(xxhash.XXH64(name.encode(), len(name), 0)))
        return change

    for change in (say("LIA"), say("RAS", False), lambda f: f.attrs.__delitem__("frame_xxh64"),
                   lambda f: f.attrs.__delitem__("frame")):
        assert "anatomical frame" in refused(change)["error"]["message"]
    assert refused(say("LIA"), 0, 99)["frame"] is None  # of a later version
    assert refused(say("LIA"), 0, 9)["frame"] is None  # in 2.9 and before it is an arbitrary attribute
    assert refused(say("RAS"), 0, 99)["frame"] == "RAS"
    # Reserved bits are refused, in this version and in a later one; those of 2.13 to 2.15 in older ones.
    for bit in (3, 4, 5, 6):
        for minor in (10, 13) if bit == 3 else (10, 14) if bit == 4 else (10, 12) if bit > 4 else (10, 99):
            error = refused(lambda f: f.attrs.modify("flags", np.uint32(1 << bit)), 5, minor)["error"]
            assert error["kind"] == "unsupported" and "flags" in error["message"], error
    # The bit for sheared axes has existed since 2.11, and requires directions.
    refused(lambda f: f.attrs.modify("flags", np.uint32(4)), 5, 10)
    for minor in (11, 99):
        assert "sheared" in refused(lambda f: f.attrs.modify("flags", np.uint32(4)), 4, minor)["error"]["message"]
    # The bit for uneven axes requires their offsets.
    for minor in (14, 99):
        assert "uneven" in refused(lambda f: f.attrs.modify("flags", np.uint32(8)), 4, minor)["error"]["message"]
    # The bit for curvilinear grids requires what is known of the positions.
    for minor in (15, 99):
        assert "positions" in refused(lambda f: f.attrs.modify("flags", np.uint32(16)), 4, minor)["error"]["message"]
    print("h5py: the patient's axes are those that were said, and reserved bits are refused")

    # Names and colours of labels, with a checksum of their own.
    np.save(f"{folder}/labels.npy", np.arange(360, dtype="u1").reshape(6, 6, 10) % 4)
    pathlib.Path(f"{folder}/labels.txt").write_text('7 Übergang 255 0 10 255\n-2 b\n3 1 2 3 1 1 1 ""\n')
    named = f"{folder}/named.isonest"
    run("preprocess", f"{folder}/labels.npy", "-o", named, "--labels", "--label-names", f"{folder}/labels.txt")
    with h5py.File(named) as f:
        assert list(f.attrs["version"]) == [2, 10] and f.attrs["xxh64"] == digest_of(f)
        table = f["label_names"]
        rows = table[...]
        assert table.chunks is None and rows.dtype.itemsize == 12 + 9 and rows.dtype.names == ("id", "flags", "color", "name")
        assert [rows.dtype.fields[name][1] for name in rows.dtype.names] == [0, 8, 9, 12]
        assert rows.dtype["id"] == "<i8" and rows.dtype["flags"] == "u1" and rows.dtype["color"].shape == (3,)
        assert h5py.check_string_dtype(rows.dtype["name"]).encoding == "utf-8"
        assert [(r["id"], r["flags"], tuple(r["color"]), r["name"].decode()) for r in rows] == [
            (-2, 0, (0, 0, 0), "b"), (3, 1, (1, 2, 3), ""), (7, 1, (255, 0, 10), "Übergang")]
        assert table.attrs["xxh64"] == xxhash.XXH64(rows.tobytes(), rows.nbytes, 0)

    def forged_names(change):
        """The results of info and check for a copy with other names."""
        copy = f"{folder}/forged.isonest"
        shutil.copyfile(named, copy)
        with h5py.File(copy, "r+") as f:
            change(f)
        done = [served.run([isonest, command, copy, "--json"], capture_output=True, text=True)
                for command in ("info", "check")]
        assert done[0].returncode == done[1].returncode, done
        return done[0].returncode, json.loads(done[0].stdout)

    def rows_changed(change, seal=True):
        def forge(f):
            rows = f["label_names"][...]
            rows = change(rows)
            del f["label_names"]
            f.create_dataset("label_names", data=rows)
            sum_of = xxhash.XXH64(rows.tobytes(), rows.nbytes, 0)
            f["label_names"].attrs["xxh64"] = np.uint64(sum_of if seal else sum_of ^ 1)
        return forge

    def with_name(name):
        def change(rows):
            rows["name"][1] = name
            return rows
        return change

    def with_bits(rows):
        rows["flags"] |= 0xFE
        return rows

    assert forged_names(rows_changed(lambda rows: rows))[1]["label_names"][1] == {"id": 3, "color": [1, 2, 3]}
    assert forged_names(rows_changed(with_bits))[1]["label_names"][0] == {"id": -2, "name": "b"}  # ignores other bits
    wide = np.dtype({"names": ["id", "flags", "color", "name"], "formats": ["<i8", "u1", ("u1", 3), "S256"],
                     "offsets": [0, 8, 9, 12], "itemsize": 268})
    for change in (rows_changed(lambda rows: rows, False), rows_changed(lambda rows: rows[::-1]),
                   rows_changed(lambda rows: rows[[0, 0, 1]]), rows_changed(with_name(b"a\xff")),
                   rows_changed(with_name(b"a\0b")), rows_changed(with_name(b"a\nb")), rows_changed(lambda rows: rows[:0]),
                   rows_changed(lambda rows: rows.astype(wide)), rows_changed(lambda rows: rows["id"].astype("u4")),
                   rows_changed(lambda rows: np.repeat(rows, 30000)), lambda f: f["label_names"].attrs.pop("xxh64")):
        code, report = forged_names(change)
        assert code == 4 and report["error"]["inside"] == "names of labels", report

    def older_version(f):
        f.attrs.modify("version", np.array([2, 7], "<u4"))
        f.attrs["xxh64"] = np.uint64(digest_of(f))

    assert forged_names(older_version)[1]["label_names"] == []
    print("h5py: names of labels are those of the table, and damaged ones are found")

    # Own indicators: their numbers are those of the volume that was given, saturated (section 4).
    given = np.random.default_rng(3).integers(0, 50, (9, 11, 14)).astype("f4")
    np.save(f"{folder}/given.npy", given)
    np.save(f"{folder}/data.npy", np.arange(given.size, dtype="f4").reshape(given.shape))
    with_own = f"{folder}/own.isonest"
    run("preprocess", f"{folder}/data.npy", "-o", with_own, "--chunk", 8, "--exact", "--own", f"Z-9={folder}/given.npy",
        "--own", f"a_b={folder}/given.npy")
    own_names = ["own:Z-9_bar", "own:Z-9_plus", "own:a_b_bar", "own:a_b_plus"]
    own_top = 4

    def own_level(p):
        return next(level for level in range(1, 9) if any(c >> (level - 1) & 1 for c in p))

    def exists(p, level):
        return all(0 <= c <= -(-(n - 1) // 2**level) * 2**level for c, n in zip(p, given.shape))

    saturated = {}

    def saturate(p):
        """(bar, plus) of the node p, by recursion over its children."""
        if p not in saturated:
            level = own_level(p)
            s = 2**(level - 1)
            odd = [a for a in range(3) if p[a] // s % 2]
            if len(odd) == 1:
                around = [tuple(p[a] + (s // 2 if i >> a & 1 else -(s // 2)) for a in range(3)) for i in range(8)]
                children = [c for c in around if level > 1 and exists(c, level - 1)]
            else:
                children = [tuple(c + (side * s if a == axis else 0) for a, c in enumerate(p))
                            for axis in odd for side in (-1, 1)]
            of_children = [saturate(c) for c in children] or [(0, 0)]
            eta = float(given[tuple(min(c, n - 1) for c, n in zip(p, given.shape))])
            saturated[p] = max(eta, max(c[0] for c in of_children)), eta + max(c[1] for c in of_children)
        return saturated[p]

    with h5py.File(with_own) as f:
        assert list(f.attrs["version"]) == [2, 12] and f.attrs["xxh64"] == digest_of(f)
        assert f.attrs["fields"].decode().split(",")[-4:] == own_names, f.attrs["fields"]
        compared = 0
        for level in range(1, own_top + 1):
            arrays = [f[f"levels/{level}/{name}"][...] for name in own_names[2:]]
            assert all(a.shape[3] == 7 for a in arrays) and np.array_equal(arrays[0], f[f"levels/{level}/{own_names[0]}"])
            for i in np.ndindex(*arrays[0].shape):
                slot = i[3] + 1
                p = tuple(2**level * c + 2**(level - 1) * (slot >> (2 - a) & 1) for a, c in enumerate(i[:3]))
                expected = saturate(p) if exists(p, level) else (0, 0)
                assert (arrays[0][i], arrays[1][i]) == expected, (level, i, p, arrays[0][i], arrays[1][i], expected)
                compared += 1
        assert f"levels/{own_top + 1}" not in f
    assert run("check", with_own)["failures"] == 0
    run("study", with_own, "--fields", "own:a_b_bar", "--steps", 3, "--out", f"{folder}/study")
    for name in ("own:a_b_bar", "own:a_b_plus"):
        run("extract", with_own, "--iso", 700, "--stop", name, "--threshold", 20, "-o", f"{folder}/own.ply")
        run("slice", with_own, "--plane", "1,1,1,15", "--stop", name, "--threshold", 20, "-o", f"{folder}/own.vtp")
        run("export", with_own, "--field", name, "--level", 1, "-o", f"{folder}/own.npy", "--force")

    def forged_own(change, minor=12):
        """The exit code and the answer of info for a copy with other names of fields."""
        copy = f"{folder}/forged.isonest"
        shutil.copyfile(with_own, copy)
        with h5py.File(copy, "r+") as f:
            f.attrs.modify("version", np.array([2, minor], "<u4"))
            f.attrs.create("fields", np.bytes_(change(f.attrs["fields"].decode())))
            f.attrs.modify("xxh64", np.uint64(digest_of(f)))
        done = served.run([isonest, "info", copy, "--json"], capture_output=True, text=True)
        return done.returncode, json.loads(done.stdout)

    assert forged_own(lambda names: names)[0] == 0 and forged_own(lambda names: names, 99)[0] == 0
    assert forged_own(lambda names: names, 11)[0] == 5  # no name of that version
    for wrong, code in (("own:a b_bar", 5), ("own:_bar", 5), ("own:9_bar", 5), ("own:a_b", 5), ("own:a_b_bar", 4),
                        ("linf_bar", 4), ("own:A_bar", 4)):
        assert forged_own(lambda names: names.replace("own:a_b_plus", wrong))[0] == code, wrong
    # A later version's field stands before own ones; neither is read then.
    assert forged_own(lambda names: names.replace("own:Z-9_bar", "later_bar"), 99)[0] == 0
    print(f"h5py: {compared} numbers of own indicators are saturated, and wrong names are refused")

    # A store of version 2.1 has no ranges; it gives the same meshes.
    older = f"{folder}/older.isonest"
    shutil.copyfile(store, older)
    with h5py.File(older, "r+") as f:
        f.attrs.modify("version", np.array([2, 1], "<u4"))
        for level in range(3, top + 1):
            del f[f"levels/{level}/cube_ranges"], f[f"levels/{level}/cube_range_sums"]
    assert run("info", older)["format"] == "2.1" and run("info", store)["format"] == "2.10"
    iso = float(np.quantile(original, 0.999))
    reports = [run("extract", s, "--iso", iso, "--error-relative", 0.05, "--effort", "none", "-o", f"{s}.ply")
               for s in (store, older)]
    meshes = [open(f"{s}.ply", "rb").read() for s in (store, older)]
    assert meshes[0] == meshes[1] and reports[0]["triangles"] > 0
    assert reports[0]["visited_tetrahedra"] < reports[1]["visited_tetrahedra"]

    # An unknown field is refused by its name, also by `check` and `info`.
    newer = f"{folder}/newer.isonest"
    shutil.copyfile(store, newer)
    with h5py.File(newer, "r+") as f:
        f.attrs.modify("fields", np.bytes_("linf_bar,linf_plus,curvature_bar"))
        f.attrs.modify("xxh64", np.uint64(digest_of(f)))
    for command in ("info", "check"):
        done = served.run([isonest, command, newer], capture_output=True, text=True)
        assert done.returncode not in (0, 1) and "'curvature_bar'" in done.stderr, (command, done)

    try:
        import vtk
        from vtk.util import numpy_support
    except ImportError:
        print("vtk is not installed: the VTKHDF part was skipped")
        sys.exit(0)
    reader = vtk.vtkHDFReader()
    reader.SetFileName(store)
    assert reader.CanReadFile(store)
    reader.Update()
    image = reader.GetOutputDataObject(0)
    assert image.GetDimensions() == n[::-1], image.GetDimensions()
    assert image.GetSpacing() == (1, 2, 0.5)
    array = numpy_support.vtk_to_numpy(image.GetPointData().GetArray("values"))
    assert np.array_equal(array.reshape(original.shape), original)
    print("vtk: opens the store as VTKHDF ImageData, values equal")
