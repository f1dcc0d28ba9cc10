"""Readers of isonest stores for ParaView: a surface within an error, and the volume at a level.

In ParaView: Tools, Manage Plugins, Load New, this file. For pvpython: paraview.simple.LoadPlugin(), or the folder of this
file in PV_PLUGIN_PATH. The Python package isonest must be installed for ParaView's own Python, or be in PYTHONPATH.
Source of the decorators: https://www.paraview.org/paraview-docs/latest/python/paraview.util.vtkAlgorithm.html
"""
import numpy as np
from paraview.util.vtkAlgorithm import smdomain, smhint, smproperty, smproxy
from vtkmodules.numpy_interface import dataset_adapter
from vtkmodules.util.numpy_support import numpy_to_vtk
from vtkmodules.util.vtkAlgorithm import VTKPythonAlgorithmBase
from vtkmodules.vtkCommonCore import vtkDataArraySelection  # noqa: F401  (ParaView requires it to be loaded)
from vtkmodules.vtkCommonExecutionModel import vtkStreamingDemandDrivenPipeline
from vtkmodules.vtkFiltersCore import vtkAppendPolyData

WITHIN = ("error", "relative error", "distance", "voxels", "triangles")


def _isonest():
    try:
        import isonest
    except ImportError as error:
        raise RuntimeError(f"this Python cannot import the package isonest: {error}; install python3-isonest, or "
                           "add the folder that holds it to PYTHONPATH before ParaView starts") from error
    return isonest


class _StoreReader(VTKPythonAlgorithmBase):
    """What both readers share: a store that stays open, memory and threads, progress."""

    def __init__(self, output):
        VTKPythonAlgorithmBase.__init__(self, nInputPorts=0, nOutputPorts=1, outputType=output)
        self._file, self._store, self._memory = None, None, 1024

    def set_file(self, name):
        if name != self._file:
            self._file, self._store = name, None
            self.Modified()

    def store(self):
        if not self._file or self._file == "None":
            raise RuntimeError("no file name is set")
        if self._store is None:
            self._store = _isonest().open(self._file)
        return self._store

    def set_memory(self, megabytes):
        if megabytes != self._memory:
            self._memory = megabytes
            self.Modified()

    def memory(self):
        return int(self._memory) << 20

    def set(self, name, value):
        if getattr(self, name) != value:
            setattr(self, name, value)
            self.Modified()

    def report(self, phase, done, total, unit):
        """Reports progress; returns whether to continue."""
        if total:
            self.UpdateProgress(min(done / total, 1.0))
        return not self.GetAbortExecute()


@smproxy.reader(name="IsonestSurface", label="Isonest Surface", extensions="isonest",
                file_description="isonest stores (surface)")
class IsonestSurface(_StoreReader):
    """Isosurfaces of a store of any size, within an error, a distance or a number of triangles."""

    def __init__(self):
        super().__init__("vtkPolyData")
        self._values, self._within, self._tolerance = [], 0, 0.0
        self._use_region, self._region, self._normals, self._hexahedra = False, (0.0,) * 6, True, False

    @smproperty.stringvector(name="FileName", panel_visibility="never")
    @smdomain.filelist()
    @smhint.filechooser(extensions="isonest", file_description="isonest stores")
    def SetFileName(self, name):
        self.set_file(name)

    @smproperty.doublevector(name="Range", information_only="1", number_of_elements=2, default_values=(0, 0))
    def GetRange(self):
        try:
            return self.store().range or (0.0, 0.0)
        except Exception:  # pylint: disable=broad-except
            return (0.0, 0.0)

    @smproperty.xml("""
        <DoubleVectorProperty name="Isovalues" command="AddIsovalue" clean_command="ClearIsovalues" repeat_command="1"
                              number_of_elements_per_command="1">
          <Documentation>The isovalues of the surfaces; none: the one that the store's histogram suggests
          first.</Documentation>
        </DoubleVectorProperty>""")
    def AddIsovalue(self, value):
        self._values.append(value)
        self.Modified()

    def ClearIsovalues(self):
        self._values = []
        self.Modified()

    @smproperty.xml("""
        <IntVectorProperty name="Within" command="SetWithin" number_of_elements="1" default_values="0">
          <EnumerationDomain name="enum">
            <Entry value="0" text="error, in units of the data"/>
            <Entry value="1" text="error, as a part of the range"/>
            <Entry value="2" text="distance, in world units"/>
            <Entry value="3" text="distance, in voxels"/>
            <Entry value="4" text="number of triangles"/>
          </EnumerationDomain>
          <Documentation>The kind of tolerance. It holds everywhere on the surface.</Documentation>
        </IntVectorProperty>""")
    def SetWithin(self, which):
        self.set("_within", int(which))

    @smproperty.doublevector(name="Tolerance", default_values=0.0)
    def SetTolerance(self, tolerance):
        self.set("_tolerance", float(tolerance))

    @smproperty.intvector(name="UseRegion", default_values=0)
    @smdomain.xml('<BooleanDomain name="bool"/>')
    def SetUseRegion(self, use):
        self.set("_use_region", bool(use))

    @smproperty.doublevector(name="Region", default_values=[0, 1, 0, 1, 0, 1])
    def SetRegion(self, x0, x1, y0, y1, z0, z1):
        """As ParaView's bounds: x0, x1, y0, y1, z0, z1."""
        self.set("_region", (x0, x1, y0, y1, z0, z1))

    @smproperty.intvector(name="Normals", default_values=1)
    @smdomain.xml('<BooleanDomain name="bool"/>')
    def SetNormals(self, normals):
        self.set("_normals", bool(normals))

    @smproperty.intvector(name="Hexahedra", default_values=0)
    @smdomain.xml('<BooleanDomain name="bool"/>')
    def SetHexahedra(self, hexahedra):
        self.set("_hexahedra", bool(hexahedra))

    @smproperty.intvector(name="MemoryMiB", default_values=1024)
    def SetMemoryMiB(self, megabytes):
        self.set_memory(megabytes)

    def _options(self):
        options = {"normals": self._normals, "coordinates": "world", "memory": self.memory(), "progress": self.report,
                   "cells": "hex" if self._hexahedra else "tet"}
        kind = WITHIN[self._within]
        if kind == "triangles":
            options["triangles"] = max(int(self._tolerance), 1)
        elif kind in ("distance", "voxels"):
            options["distance"] = self._tolerance if kind == "distance" else f"{self._tolerance!r}voxel"
        else:
            options["error_relative" if kind == "relative error" else "error"] = self._tolerance
        if self._use_region:
            x0, x1, y0, y1, z0, z1 = self._region
            options["box"] = (x0, y0, z0), (x1, y1, z1)
        return options

    def RequestData(self, request, inputs, outputs):
        store = self.store()
        values = self._values
        if not values:
            suggested = store.histogram().suggested
            values = [suggested[0][0]] if suggested else []
        append = vtkAppendPolyData()
        bounds = []
        for value in values:
            mesh = store.isosurface(value, **self._options())
            data = mesh.to_vtk()
            level = numpy_to_vtk(np.full(len(mesh.vertices), value), deep=1)
            level.SetName("isovalue")
            data.GetPointData().AddArray(level)
            append.AddInputData(data)
            report = mesh.report
            bounds.append(report.distance_bound if WITHIN[self._within] in ("distance", "voxels", "triangles")
                          else report.error_bound)
        output = dataset_adapter.WrapDataObject(self.GetOutputData(outputs, 0))
        if values:
            append.Update()
            output.ShallowCopy(append.GetOutput())
            # The proven bound for each isovalue.
            bound = numpy_to_vtk(np.array(bounds), deep=1)
            bound.SetName("bound")
            output.GetFieldData().AddArray(bound)
        return 1


@smproxy.reader(name="IsonestVolume", label="Isonest Volume", extensions="isonest",
                file_description="isonest stores (volume at a level)")
class IsonestVolume(_StoreReader):
    """Every 2^level-th node of a store as an image: of manageable size, however large the store."""

    def __init__(self):
        super().__init__("vtkImageData")
        self._level = -1

    @smproperty.stringvector(name="FileName", panel_visibility="never")
    @smdomain.filelist()
    @smhint.filechooser(extensions="isonest", file_description="isonest stores")
    def SetFileName(self, name):
        self.set_file(name)

    @smproperty.intvector(name="Level", default_values=-1)
    def SetLevel(self, level):
        """0 is the finest; -1: the finest that takes no more than a quarter of the memory."""
        self.set("_level", int(level))

    @smproperty.intvector(name="MemoryMiB", default_values=1024)
    def SetMemoryMiB(self, megabytes):
        self.set_memory(megabytes)

    def _chosen_level(self):
        store = self.store()
        level = self._level
        if level < 0:
            level = next((k for k in range(store.levels)
                          if np.prod(store.level_shape(k), dtype=float) * store.dtype.itemsize <= self.memory() / 4),
                         store.levels - 1)
        return min(level, store.levels - 1)

    def RequestInformation(self, request, inputs, outputs):
        shape = self.store().level_shape(self._chosen_level())
        extent = [part for n in shape[::-1] for part in (0, n - 1)]
        outputs.GetInformationObject(0).Set(vtkStreamingDemandDrivenPipeline.WHOLE_EXTENT(), extent, 6)
        return 1

    def RequestData(self, request, inputs, outputs):
        store, level = self.store(), self._chosen_level()
        store.require_even_axes("an image of ParaView")
        values = store.values(level, memory=self.memory(), progress=self.report)
        image = self.GetOutputData(outputs, 0)
        image.SetDimensions(*values.shape[::-1])
        image.SetSpacing(*(step * 2**level for step in store.spacing[::-1]))
        image.SetOrigin(*store.origin[::-1])
        image.GetDirectionMatrix().DeepCopy([v for row in np.array(store.direction).T for v in row])
        array = numpy_to_vtk(np.ascontiguousarray(values).ravel(), deep=1)
        array.SetName("values")
        image.GetPointData().SetScalars(array)
        return 1
