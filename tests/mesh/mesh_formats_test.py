"""Every mesh format, read by independent programs: VTK, h5py, and parsers of glTF and 3MF by their specifications.

Usage: mesh_formats_test.py ISONEST PLUGIN_FOLDER
"""
import base64
import json
import pathlib
import struct
import sys
import tempfile
import xml.etree.ElementTree as ElementTree
import zipfile

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served  # noqa: E402
from mesh_data import read_glb  # noqa: E402

import h5py
import numpy as np
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkIOGeometry import vtkGLTFReader, vtkOBJReader, vtkSTLReader
from vtkmodules.vtkIOPLY import vtkPLYReader
from vtkmodules.vtkIOXML import vtkXMLPolyDataReader

isonest = sys.argv[1]


def run(*arguments, expect=0):
    done = served.run([isonest, *map(str, arguments)], capture_output=True, text=True)
    assert done.returncode == expect, (arguments, done.returncode, done.stderr)
    return json.loads(done.stdout) if "--json" in arguments else done.stderr


def vtk_mesh(reader, path):
    reader.SetFileName(str(path))
    reader.Update()
    data = reader.GetOutput()
    points = vtk_to_numpy(data.GetPoints().GetData()) if data.GetNumberOfPoints() else \
        np.zeros((0, 3), "f4")
    polys = vtk_to_numpy(data.GetPolys().GetConnectivityArray()).reshape(-1, 3)
    return points, polys, data


def vtp_arrays(path):
    """The arrays of a .vtp file by name, read as plain XML without appended data, and the strings of its field data."""
    root = ElementTree.fromstring(path.read_bytes())
    assert root.attrib == {"type": "PolyData", "version": "1.0", "byte_order": "LittleEndian", "header_type": "UInt64"}
    assert not root.findall(".//AppendedData")
    arrays, texts = {}, {}
    for element in root.iter("DataArray"):
        if element.get("format") == "ascii":
            continue
        assert element.get("format") == "binary" and element.get("type") != "String", element.attrib
        raw = base64.b64decode(element.text.strip(), validate=True)
        assert struct.unpack_from("<Q", raw)[0] == len(raw) - 8, element.attrib
        kind = {"Float32": "<f4", "Float64": "<f8", "Int64": "<i8"}[element.get("type")]
        arrays[element.get("Name")] = np.frombuffer(raw, kind, offset=8)
    for element in root.iter("Array"):
        assert element.get("type") == "String" and element.get("NumberOfTuples") == "1"
        *codes, end = map(int, element.text.split())
        assert end == 0
        texts[element.get("Name")] = bytes(codes).decode()
    return arrays, texts


def corners(points, triangles):
    return points[triangles].astype("f4")


def three_mf(path):
    """Vertices as printed, and triangles; None without an object."""
    with zipfile.ZipFile(path) as z:
        assert z.testzip() is None
        entries = z.infolist()
        assert [e.filename for e in entries] == ["[Content_Types].xml", "_rels/.rels", "3D/3dmodel.model"]
        for e in entries:
            assert e.date_time == (1980, 1, 1, 0, 0, 0) and e.compress_type == zipfile.ZIP_DEFLATED
            assert e.extract_version == 20 and e.flag_bits == 0 and e.extra == b""
        types, relations, model = (ElementTree.fromstring(z.read(e)) for e in entries)
    package = "{http://schemas.openxmlformats.org/package/2006/%s}"
    kinds = {t.get("Extension"): t.get("ContentType") for t in types.iter(package % "content-types" + "Default")}
    assert kinds == {"rels": "application/vnd.openxmlformats-package.relationships+xml",
                     "model": "application/vnd.ms-package.3dmanufacturing-3dmodel+xml"}
    (start,) = relations
    assert start.tag == package % "relationships" + "Relationship" and start.get("Target") == "/3D/3dmodel.model"
    assert start.get("Type") == "http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"
    core = "{http://schemas.microsoft.com/3dmanufacturing/core/2015/02}"
    assert model.tag == core + "model" and model.get("unit") == "millimeter"
    assert [e.tag for e in model if e.tag != core + "metadata"] == [core + "resources", core + "build"]
    resources, build = model.find(core + "resources"), model.find(core + "build")
    if len(resources) == 0:
        assert len(build) == 0
        return None
    (thing,), (item,) = resources, build
    assert thing.tag == core + "object" and thing.get("id") == item.get("objectid") == "1"
    ((vertices, triangles),) = thing
    assert vertices.tag == core + "vertices" and triangles.tag == core + "triangles"
    assert {v.tag for v in vertices} == {core + "vertex"} and {t.tag for t in triangles} == {core + "triangle"}
    return ([[v.get(a) for a in "xyz"] for v in vertices],
            np.array([[int(t.get(a)) for a in ("v1", "v2", "v3")] for t in triangles]))


with tempfile.TemporaryDirectory(dir=served.MEMORY) as name:
    folder = pathlib.Path(name)
    store = folder / "s"
    run("make-volume", "bucky", "--size", 33, "-o", folder / "v.h5")
    run("preprocess", folder / "v.h5", "-o", store, "--chunk", 16, "--spacing", "1,2,0.5",
        "--origin", "-3,4,5")
    common = ("extract", store, "--iso", 0.5, "--error-relative", 0.01, "--effort", "none", "--normals",
              "--vertex-values", store, "--vertex-error", "deviation_bar", "--json")
    report = run(*common, "-o", folder / "m.ply")
    points, polys, data = vtk_mesh(vtkPLYReader(), folder / "m.ply")
    assert len(points) == report["vertices"] > 100 and len(polys) == report["triangles"]
    expected = corners(points, polys)
    normals = vtk_to_numpy(data.GetPointData().GetNormals())
    assert np.allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-5)

    for end in ("stl", "obj", "vtp", "vtkhdf", "glb", "3mf"):
        again = run(*common, "-o", folder / f"m.{end}")
        assert again["triangles"] == report["triangles"]

    stl_points, stl_polys, _ = vtk_mesh(vtkSTLReader(), folder / "m.stl")
    key = lambda t: np.array(sorted(map(tuple, t.reshape(-1, 9).tolist())))
    assert np.array_equal(key(corners(stl_points, stl_polys)), key(expected))

    obj_points, obj_polys, obj = vtk_mesh(vtkOBJReader(), folder / "m.obj")
    assert np.array_equal(obj_polys, polys) and np.array_equal(obj_points.astype("f4"), points)
    assert np.allclose(vtk_to_numpy(obj.GetPointData().GetNormals()), normals, atol=1e-5)

    vtp_points, vtp_polys, vtp = vtk_mesh(vtkXMLPolyDataReader(), folder / "m.vtp")
    assert np.array_equal(vtp_polys, polys) and np.array_equal(vtp_points, points)
    value = vtk_to_numpy(vtp.GetPointData().GetArray("value"))
    error = vtk_to_numpy(vtp.GetPointData().GetArray("error"))
    assert np.array_equal(vtk_to_numpy(vtp.GetPointData().GetNormals()), normals)
    arrays, texts = vtp_arrays(folder / "m.vtp")
    assert texts == {} and set(arrays) == {"normal", "value", "error", "points", "connectivity", "offsets"}
    assert np.array_equal(arrays["points"].reshape(-1, 3), points) and np.array_equal(arrays["value"], value)
    assert np.array_equal(arrays["connectivity"].reshape(-1, 3), polys)
    assert np.array_equal(arrays["offsets"], 3 * np.arange(1, len(polys) + 1))
    assert np.abs(value - 0.5).max() <= 1e-5, "the store's own value at its isosurface's vertices"
    assert (error >= 0).all() and error.max() > 0

    with h5py.File(folder / "m.vtkhdf") as f:
        root = f["VTKHDF"]
        assert root.attrs["Type"] == b"PolyData" and list(root.attrs["Version"]) == [2, 0]
        assert root["NumberOfPoints"][0] == len(points)
        assert np.array_equal(root["Points"][:], points)
        group = root["Polygons"]
        assert group["NumberOfCells"][0] == len(polys)
        assert group["NumberOfConnectivityIds"][0] == 3 * len(polys)
        assert np.array_equal(group["Connectivity"][:].reshape(-1, 3), polys)
        assert np.array_equal(group["Offsets"][:], 3 * np.arange(len(polys) + 1))
        assert np.array_equal(root["PointData/normal"][:], normals)
        assert np.array_equal(root["PointData/value"][:], value)
        assert np.array_equal(root["PointData/error"][:], error)
        for other in ("Vertices", "Lines", "Strips"):
            assert root[other]["NumberOfCells"][0] == 0 and list(root[other]["Offsets"]) == [0]

    _, g = read_glb(folder / "m.glb")
    assert np.array_equal(g["POSITION"], points) and np.array_equal(g["NORMAL"], normals)
    assert np.array_equal(g["indices"].reshape(-1, 3), polys)
    assert np.array_equal(g["_VALUE"][:, 0], value) and np.array_equal(g["_ERROR"][:, 0], error)

    # The printed digits identify the same float32 and are as few as possible; meshes larger than one piece.
    printed, triangles = three_mf(folder / "m.3mf")
    assert np.array_equal(np.array(printed, "f4"), points) and np.array_equal(triangles, polys)
    full = ("extract", store, "--iso", 0.5, "--cells", "tet", "--json", "-o")
    assert run(*full, folder / "f.ply")["vertices"] > 5000
    points, polys, _ = vtk_mesh(vtkPLYReader(), folder / "f.ply")
    for options in ((), ("--threads", 1), ("--threads", 3, "--memory", "20M")):
        run(*full, folder / "f.3mf", *options)
        assert options == () or (folder / "f.3mf").read_bytes() == first, options
        first = (folder / "f.3mf").read_bytes()
    printed, triangles = three_mf(folder / "f.3mf")
    assert np.array_equal(np.array(printed, "f4"), points) and np.array_equal(triangles, polys)
    digits = lambda text: len(text.lstrip("-").partition("e")[0].replace(".", "").strip("0"))
    for text, number in zip(np.ravel(printed), points.ravel()):
        assert digits(text) == digits(np.format_float_scientific(number)), (text, number)

    # Rows of .vtp that end in the middle of three bytes of base64, from many parts and batches at once.
    run("preprocess", folder / "v.h5", "-o", folder / "um", "--chunk", 16, "--unit", "um")
    forms = {}
    for options in ((), ("--threads", 1), ("--threads", 3, "--memory", "20M")):
        for extra in ((), ("--vertex-values", folder / "um"), ("--components", "largest")):
            run("extract", folder / "um", "--iso", 0.5, "--cells", "tet", "-o", folder / "f.vtp", *options, *extra)
            whole = (folder / "f.vtp").read_bytes()
            assert forms.setdefault(extra, whole) == whole, (options, extra)
    run("extract", folder / "um", "--iso", 0.5, "--cells", "tet", "-o", folder / "f.ply")
    points, polys, _ = vtk_mesh(vtkPLYReader(), folder / "f.ply")
    run("extract", folder / "um", "--iso", 0.5, "--cells", "tet", "-o", folder / "f.vtp")
    vtp_points, vtp_polys, vtp = vtk_mesh(vtkXMLPolyDataReader(), folder / "f.vtp")
    assert np.array_equal(vtp_polys, polys) and np.array_equal(vtp_points, points) and len(points) > 5000
    assert vtp.GetFieldData().GetAbstractArray("unit").GetValue(0) == "um" == vtp_arrays(folder / "f.vtp")[1]["unit"]

    # Empty meshes are valid files of their formats.
    for end in ("ply", "stl", "obj", "vtp", "vtkhdf", "glb", "3mf"):
        r = run("extract", store, "--iso", 99, "-o", folder / f"e.{end}", "--json")
        assert r["triangles"] == 0 and (folder / f"e.{end}").stat().st_size > 0
    assert vtk_mesh(vtkXMLPolyDataReader(), folder / "e.vtp")[2].GetNumberOfPolys() == 0
    assert {len(array) for array in vtp_arrays(folder / "e.vtp")[0].values()} == {0}
    assert read_glb(folder / "e.glb")[1] is None and three_mf(folder / "e.3mf") is None
    refusals = []
    for end, whole in (("e.glb", False), ("m.glb", True)):
        reader = vtkGLTFReader()
        for what in ("ErrorEvent", "WarningEvent"):
            reader.AddObserver(what, lambda *_: refusals.append(end))
        reader.SetFileName(str(folder / end))
        reader.Update()
        assert (reader.GetOutput().GetNumberOfPoints() > 0) == whole, end
    assert refusals == [], refusals
    assert (folder / "e.stl").stat().st_size == 84

    # A slice's values, and lines.
    r = run("slice", store, "--plane", "0,0,1,9.3", "-o", folder / "c.vtp", "--json")
    cut_points, _, cut = vtk_mesh(vtkXMLPolyDataReader(), folder / "c.vtp")
    assert np.allclose(cut_points[:, 2], 9.3) and len(cut_points) == r["vertices"]
    assert cut.GetPointData().GetScalars().GetName() == "value"
    flat = np.add.outer(np.arange(21.0) ** 2, np.arange(30.0) ** 2).astype("f4")
    with h5py.File(folder / "flat.h5", "w") as f:
        f["z"] = flat
    run("preprocess", folder / "flat.h5", "-o", folder / "f")
    run("extract", folder / "f", "--iso", 200, "-o", folder / "l.vtp")
    reader = vtkXMLPolyDataReader()
    reader.SetFileName(str(folder / "l.vtp"))
    reader.Update()
    lines = reader.GetOutput()
    radius = np.linalg.norm(vtk_to_numpy(lines.GetPoints().GetData()), axis=1)
    assert lines.GetNumberOfLines() > 20 and np.abs(radius - np.sqrt(200)).max() < 0.02
    # Values that float32 cannot represent are float64, if the format supports that.
    far = 1e9 + (np.indices((9, 11, 13)).sum(0) % 4)
    with h5py.File(folder / "far.h5", "w") as f:
        f["v"] = far
    run("preprocess", folder / "far.h5", "-o", folder / "far")
    for end in ("ply", "vtp", "vtkhdf", "glb"):
        r = run("slice", folder / "far", "--plane", "0,0,1,4", "--normals", "--vertex-error",
                "deviation_bar", "-o", folder / f"far.{end}", "--json")
        if end == "vtkhdf":
            with h5py.File(folder / "far.vtkhdf") as f:
                at, value = f["VTKHDF/Points"][:], f["VTKHDF/PointData/value"][:]
                error = f["VTKHDF/PointData/error"][:]
        elif end == "glb":
            _, g = read_glb(folder / "far.glb")
            at, value, error = g["POSITION"], g["_VALUE"][:, 0], g["_ERROR"][:, 0]
        else:
            at, _, mesh = vtk_mesh({"ply": vtkPLYReader, "vtp": vtkXMLPolyDataReader}[end](),
                                   folder / f"far.{end}")
            if end == "ply":  # VTK's reader ignores properties that it does not know
                head, body = (folder / "far.ply").read_bytes().split(b"end_header\n", 1)
                kinds = [("p", "<f4", 3), ("n", "<f4", 3), ("value", "<f8"), ("error", "<f4")]
                assert b"property double value\nproperty float error" in head
                rows = np.frombuffer(body, kinds, r["vertices"])
                assert np.array_equal(rows["p"], at)
                value, error = rows["value"], rows["error"]
            else:
                value = vtk_to_numpy(mesh.GetPointData().GetArray("value"))
                error = vtk_to_numpy(mesh.GetPointData().GetArray("error"))
        i, j, k = np.round(at).astype(int).T
        off = np.abs(value.astype("f8") - far[k, j, i]).max()
        assert value.dtype == ("f4" if end == "glb" else "f8") and (error >= 0).all()
        assert off == r["value_rounding"] == r["error_bound"] and (off > 0) == (end == "glb"), end
    run("slice", folder / "far", "--plane", "0,0,1,4", "-o", folder / "far.png")

    # Several isovalues in one file: each vertex and each cell has its isovalue.
    for isovalues, kind in (((0.5, 99.0, 0.25), "f4"), ((0.5, 99.0, 0.3), "f8"), ((98.0, 99.0), "f4")):
        own = [run("extract", store, "--iso", v, "-o", folder / "one.vtp", "--json") for v in isovalues]
        of_points = np.repeat(np.array(isovalues, kind), [r["vertices"] for r in own])
        of_cells = np.repeat(np.array(isovalues, kind), [r["triangles"] for r in own])
        assert len(of_cells) > 5000 or isovalues[0] == 98
        joined = ("extract", store, "--iso", ",".join(map(str, isovalues)), "--normals", "-o")
        for options in ((), ("--threads", 1), ("--threads", 3, "--memory", "30M")):
            run(*joined, folder / "j.vtp", *options)
            run(*joined, folder / "j.vtkhdf", *options)
            _, joined_polys, mesh = vtk_mesh(vtkXMLPolyDataReader(), folder / "j.vtp")
            for data, expected in ((mesh.GetPointData(), of_points), (mesh.GetCellData(), of_cells)):
                found = vtk_to_numpy(data.GetArray("isovalue"))
                assert found.dtype == kind and np.array_equal(found, expected), (isovalues, options)
            assert mesh.GetCellData().GetNumberOfArrays() == 1
            with h5py.File(folder / "j.vtkhdf") as f:
                for data, expected in (("PointData", of_points), ("CellData", of_cells)):
                    found = f[f"VTKHDF/{data}/isovalue"]
                    assert found.dtype == kind and np.array_equal(found[:], expected), (isovalues, options)
                assert list(f["VTKHDF/CellData"]) == ["isovalue"]
                assert np.array_equal(f["VTKHDF/Polygons/Connectivity"][:].reshape(-1, 3), joined_polys)
    _, _, mesh = vtk_mesh(vtkXMLPolyDataReader(), folder / "one.vtp")
    assert mesh.GetCellData().GetNumberOfArrays() == 0
    own = [run("extract", folder / "f", "--iso", v, "-o", folder / "l.vtp", "--json")["triangles"] for v in (200, 90.5)]
    run("extract", folder / "f", "--iso", "200,90.5", "-o", folder / "j.vtp")
    reader = vtkXMLPolyDataReader()
    reader.SetFileName(str(folder / "j.vtp"))
    reader.Update()
    found = vtk_to_numpy(reader.GetOutput().GetCellData().GetArray("isovalue"))
    assert np.array_equal(found, np.repeat(np.array((200, 90.5), "f4"), own)) and min(own) > 10

    message = run("extract", folder / "f", "--iso", 200, "-o", folder / "l.ply", expect=2)
    assert ".vtp or .obj" in message, message
    message = run("extract", folder / "f", "--iso", 200, "-o", folder / "l.3mf", expect=2)
    assert ".vtp or .obj" in message, message
    message = run("extract", store, "--iso", 0.5, "-o", folder / "m.xyz", expect=2)
    assert ".vtkhdf" in message, message
    message = run("extract", store, "--iso", 0.5, "--stop", "normal_bar", "--threshold", 1, "-o",
                  folder / "m.ply", expect=3)
    assert "--indicators linf_plus,deviation_bar,normal_bar" in message, message
    message = run("extract", store, "-o", folder / "m.ply", expect=2)
    assert "values of" in message, message
    assert sorted(p.name for p in folder.glob(".*")) == [], "nothing left behind"
print("all formats agree")
