"""A module of 3D Slicer: surfaces of isonest stores within a proven error, as models, and levels of the volume.

In Slicer: Edit, Application Settings, Modules, Additional module paths: the folder of this file. The Python package isonest
must be available to Slicer's own Python (PythonSlicer -m pip install, or PYTHONPATH).

The functions before the classes need only VTK and isonest. tests/python/test_slicer.py tests them, and the logic with a
stand-in for Slicer's scene. The panel has never been run in Slicer.
Source of the classes: https://slicer.readthedocs.io/en/latest/developer_guide/script_repository.html
"""
import numpy as np
from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkPoints
from vtkmodules.vtkCommonDataModel import vtkImageData
from vtkmodules.vtkCommonMath import vtkMatrix4x4

try:
    import ctk
    import qt
    import slicer
    from slicer.ScriptedLoadableModule import (ScriptedLoadableModule, ScriptedLoadableModuleLogic,
                                               ScriptedLoadableModuleWidget)
except ImportError:  # outside Slicer: only the functions
    slicer = None
    ScriptedLoadableModule = ScriptedLoadableModuleLogic = ScriptedLoadableModuleWidget = object

# Slicer's lengths are millimetres.
MILLIMETRES = {"km": 1e6, "m": 1e3, "dm": 100.0, "cm": 10.0, "mm": 1.0, "um": 1e-3, "nm": 1e-6, "angstrom": 1e-7, "pm": 1e-9,
               "ft": 304.8, "in": 25.4}
MAX_NODES = 2**27  # of a level that is loaded unless a level is given: 512 MB as float32


def _isonest():
    try:
        import isonest
    except ImportError as error:
        raise RuntimeError(f"this Python cannot import the package isonest: {error}; install it for Slicer's own Python, or "
                           "add the folder that holds it to PYTHONPATH before Slicer starts") from error
    return isonest


def to_ras(store):
    """The 4x4 matrix from a store's world to Slicer's: millimetres, RAS. A world unit counts as a millimetre if the unit is
    unknown, and the axes as RAS if they are unknown."""
    scale = 1.0 if store.unit is None else MILLIMETRES[store.unit]
    return np.diag([-scale, -scale, scale, 1.0] if store.frame == "LPS" else [scale, scale, scale, 1.0])


def surface_polydata(store, iso, **options):
    """The surface as a vtkPolyData in Slicer's world, and its report.

    options: those of isonest.Store.isosurface, such as distance="0.5voxel". The bound is in the field data: "distance bound",
    in millimetres, or "error bound", in units of the data.
    """
    mesh = store.isosurface(iso, **{**options, "coordinates": "world"})
    data = mesh.to_vtk()
    matrix = to_ras(store)
    points = vtk_to_numpy(data.GetPoints().GetData()) @ matrix[:3, :3].T
    moved = vtkPoints()
    moved.SetData(numpy_to_vtk(np.ascontiguousarray(points, np.float32), deep=1))
    data.SetPoints(moved)
    normals = data.GetPointData().GetNormals()
    if normals is not None:
        turned = numpy_to_vtk(np.ascontiguousarray(vtk_to_numpy(normals) @ np.sign(matrix[:3, :3]), np.float32), deep=1)
        turned.SetName("Normals")
        data.GetPointData().SetNormals(turned)
    report = mesh.report
    is_distance = any(options.get(name) is not None for name in ("distance", "triangles")) and options.get("by") != "error"
    bound = numpy_to_vtk(np.array([report.distance_bound * abs(matrix[2, 2]) if is_distance else report.error_bound]), deep=1)
    bound.SetName("distance bound" if is_distance else "error bound")
    data.GetFieldData().AddArray(bound)
    return data, report


def volume_image(store, level=None):
    """Every 2^level-th node as a vtkImageData with spacing 1 at the origin, and the vtkMatrix4x4 from its indices (i, j, k) to
    Slicer's world, as a vtkMRMLScalarVolumeNode needs them. None: the finest level with at most MAX_NODES nodes."""
    if level is None:
        level = next((one for one in range(store.levels) if np.prod(store.level_shape(one), dtype=float) <= MAX_NODES),
                     store.levels - 1)
    store.require_even_axes("a volume of Slicer")
    values = store.values(level)
    image = vtkImageData()
    image.SetDimensions(*values.shape[::-1])
    array = numpy_to_vtk(np.ascontiguousarray(values).ravel(), deep=1)
    array.SetName("values")
    image.GetPointData().SetScalars(array)
    indices = np.eye(4)
    indices[:3, :3] = np.array(store.direction).T * (np.array(store.spacing[::-1]) * 2**level)
    indices[:3, 3] = store.origin[::-1]
    matrix = vtkMatrix4x4()
    matrix.DeepCopy([float(v) for v in (to_ras(store) @ indices).ravel()])
    return image, matrix


class IsonestExtract(ScriptedLoadableModule):
    def __init__(self, parent):
        ScriptedLoadableModule.__init__(self, parent)
        parent.title = "Isonest Extract"
        parent.categories = ["Surface Models"]
        parent.dependencies = []
        parent.contributors = ["The isonest authors"]
        parent.helpText = "Surfaces of isonest stores, within a distance or an error that is proven."
        parent.acknowledgementText = ""


class IsonestExtractLogic(ScriptedLoadableModuleLogic):
    def suggested(self, path):
        """The isovalue that the histogram suggests first; None if it suggests none."""
        with _isonest().open(path) as store:
            suggested = store.histogram().suggested
        return suggested[0][0] if suggested else None

    def add_surface(self, path, iso, **options):
        """Adds a model to the scene; returns its node and the report."""
        with _isonest().open(path) as store:
            data, report = surface_polydata(store, iso, **options)
            name = slicer.mrmlScene.GenerateUniqueName(f"{store.path.stem} {iso:g}")
        node = slicer.mrmlScene.AddNewNodeByClass("vtkMRMLModelNode", name)
        node.SetAndObservePolyData(data)
        node.CreateDefaultDisplayNodes()
        return node, report

    def add_volume(self, path, level=None):
        """Adds a level as a volume to the scene; returns its node."""
        with _isonest().open(path) as store:
            image, matrix = volume_image(store, level)
            name = slicer.mrmlScene.GenerateUniqueName(store.path.stem)
        node = slicer.mrmlScene.AddNewNodeByClass("vtkMRMLScalarVolumeNode", name)
        node.SetAndObserveImageData(image)
        node.SetIJKToRASMatrix(matrix)
        node.CreateDefaultDisplayNodes()
        return node


class IsonestExtractWidget(ScriptedLoadableModuleWidget):
    def setup(self):
        ScriptedLoadableModuleWidget.setup(self)
        self.logic = IsonestExtractLogic()
        form = qt.QFormLayout()
        self.layout.addLayout(form)
        self.path = ctk.ctkPathLineEdit()
        self.path.nameFilters = ["isonest stores (*.isonest)"]
        self.path.connect("currentPathChanged(QString)", self.opened)
        form.addRow("Store:", self.path)
        self.iso = qt.QLineEdit()
        form.addRow("Isovalue:", self.iso)
        self.distance = qt.QLineEdit("0.5voxel")
        self.distance.toolTip = "The largest distance from the surface at full resolution: 0.5voxel, or 0.3mm if the unit is known"
        form.addRow("Distance:", self.distance)
        for text, slot in (("Extract surface", self.extract), ("Load volume", self.load)):
            button = qt.QPushButton(text)
            button.connect("clicked(bool)", slot)
            form.addRow(button)
        self.said = qt.QLabel()
        self.said.wordWrap = True
        form.addRow(self.said)
        self.layout.addStretch(1)

    def opened(self, path):
        with slicer.util.tryWithErrorDisplay(f"{path} cannot be opened."):
            suggested = self.logic.suggested(path)
            self.iso.text = "" if suggested is None else f"{suggested:g}"

    def extract(self, _checked=False):
        with slicer.util.tryWithErrorDisplay("The surface cannot be extracted.", waitCursor=True):
            _, report = self.logic.add_surface(self.path.currentPath, float(self.iso.text), distance=self.distance.text or None)
            self.said.text = f"{report.triangles} triangles, proven within {report.distance_bound:.4g} world units"

    def load(self, _checked=False):
        with slicer.util.tryWithErrorDisplay("The volume cannot be loaded.", waitCursor=True):
            self.logic.add_volume(self.path.currentPath)
