#!/usr/bin/env python3
"""ParaView's pvpython opens stores and meshes, and the readers of tools/paraview.

usage: paraview_test.py ISONEST PLUGIN_FOLDER; needs PYTHONPATH with the Python package. Skipped where pvpython is missing
(Debian: apt-get install --no-install-recommends paraview python3-paraview).
"""
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served  # noqa: E402

ISONEST, FILTERS = sys.argv[1:3]
ROOT = pathlib.Path(__file__).resolve().parents[2]
PACKAGE = pathlib.Path(ISONEST).resolve().parent.parent / "python"
if shutil.which("pvpython") is None or not PACKAGE.is_dir():
    print("skipped: no pvpython (Debian: paraview, python3-paraview), or no Python package")
    sys.exit(77)

SCRIPT = """
import json, sys
import numpy as np
from paraview import servermanager, simple
from paraview.simple import LoadPlugin, OpenDataFile
from vtkmodules.util.numpy_support import vtk_to_numpy
folder, plugin = sys.argv[1:3]
result = {}

# Stores under the name that ParaView's own reader takes.
image = OpenDataFile(folder + "/v.hdf")
image.UpdatePipeline()
data = servermanager.Fetch(image)
result["image"] = [type(image).__name__, list(data.GetDimensions()), list(data.GetSpacing()), list(data.GetOrigin())]
result["values"] = vtk_to_numpy(data.GetPointData().GetArray("values")).tolist()

LoadPlugin(plugin, remote=False, ns=globals())
reader = OpenDataFile(folder + "/v.isonest")
result["readers"] = type(reader).__name__
surface = IsonestSurface(FileName=folder + "/v.isonest", Isovalues=[30.5])

def cells(**properties):
    for name, value in properties.items():
        setattr(surface, name, value)
    surface.UpdatePipeline()
    mesh = servermanager.Fetch(surface)
    bound = mesh.GetFieldData().GetArray("bound")
    return [mesh.GetNumberOfPolys(), [bound.GetValue(i) for i in range(bound.GetNumberOfTuples())], list(mesh.GetBounds()),
            sorted(mesh.GetPointData().GetArrayName(i) for i in range(mesh.GetPointData().GetNumberOfArrays()))]

result["full"] = cells()
result["error"] = cells(Tolerance=2.0)
result["distance"] = cells(Within="distance, in voxels", Tolerance=0.5)
result["triangles"] = cells(Within="number of triangles", Tolerance=500)
result["hexahedra"] = cells(Within=0, Tolerance=0, Hexahedra=1, Normals=0)
result["region"] = cells(Hexahedra=0, UseRegion=1, Region=[0, 9, 1, 8, 2, 7])
result["two"] = cells(UseRegion=0, Isovalues=[20.5, 30.5])
volume = IsonestVolume(FileName=folder + "/v.isonest", Level=1)
volume.UpdatePipeline()
level = servermanager.Fetch(volume)
result["level"] = [list(level.GetDimensions()), list(level.GetSpacing()), list(level.GetOrigin()),
                   vtk_to_numpy(level.GetPointData().GetArray("values")).tolist()]
print("RESULT " + json.dumps(result))
"""

import numpy as np  # noqa: E402  (after the reasons to skip)

with tempfile.TemporaryDirectory(prefix="isonest-test-") as name:
    folder = pathlib.Path(name)
    z, y, x = np.mgrid[:25, :27, :30]
    data = (200 / (1 + 0.05 * ((x - 15) ** 2 + (y - 13) ** 2 + (z - 12) ** 2)) + np.sin(x + 2 * y)).astype("f4")
    np.save(folder / "v.npy", data)

    def run(*arguments):
        done = served.run([ISONEST, *map(str, arguments)], capture_output=True, text=True)
        assert done.returncode == 0, (arguments, done.stderr)
        return done.stdout

    run("preprocess", folder / "v.npy", "-o", folder / "v.isonest", "--chunk", 8, "--spacing", "0.5,1,2",
        "--origin", "3,4,5", "--indicators", "deviation_bar")
    run("preprocess", folder / "v.npy", "-o", folder / "v.hdf", "--chunk", 8)

    def triangles(*options):
        out = run("extract", folder / "v.isonest", "--iso", 30.5, "-o", folder / "m.ply", *options)
        return int(out.split(": ")[1].split()[0])

    (folder / "script.py").write_text(SCRIPT)
    environment = {**os.environ, "HDF5_PLUGIN_PATH": FILTERS,
                   "PYTHONPATH": f"{PACKAGE}:{ROOT / 'tools/paraview/debian12'}"}
    done = subprocess.run(["pvpython", "--force-offscreen-rendering", folder / "script.py", name,
                           ROOT / "tools/paraview/isonest_paraview.py"], capture_output=True, text=True, env=environment,
                          timeout=300)
    lines = [line for line in done.stdout.splitlines() if line.startswith("RESULT ")]
    assert lines, done.stdout + done.stderr
    import json
    result = json.loads(lines[0][7:])

    assert result["image"] == ["VTKHDFReader", [30, 27, 25], [1, 1, 1], [0, 0, 0]], result["image"]
    np.testing.assert_array_equal(np.float32(result["values"]), data.ravel())
    assert result["readers"] in ("IsonestSurface", "IsonestVolume"), result["readers"]
    full, bound, bounds, arrays = result["full"]
    assert full == triangles() and bound == [0] and arrays == ["isovalue", "normal"], result["full"]
    assert 3 <= bounds[0] < bounds[1] <= 18 and 5 <= bounds[4] < bounds[5] <= 53, bounds
    count, bound = result["error"][:2]
    assert count == triangles("--error", 2) < full and 0 < bound[0] <= 2, result["error"]
    count, bound = result["distance"][:2]
    assert count == triangles("--distance", "0.5voxel") and 0 < bound[0] <= 0.25, result["distance"]
    assert result["triangles"][0] == triangles("--triangles", 500) <= 500
    assert result["hexahedra"][0] == triangles("--cells", "hex") and result["hexahedra"][3] == ["isovalue"]
    count, _, bounds, _ = result["region"]
    assert count == triangles("--box", "0,1,2,9,8,7") and bounds[1] <= 9 and bounds[3] <= 8 and bounds[5] <= 7, bounds
    assert result["two"][0] > full and len(result["two"][1]) == 2
    dims, spacing, origin, values = result["level"]
    assert (dims, spacing, origin) == ([15, 14, 13], [1, 2, 4], [3, 4, 5]), result["level"][:3]
    np.testing.assert_array_equal(np.float32(values), data[::2, ::2, ::2].ravel())
print("ParaView agrees")
