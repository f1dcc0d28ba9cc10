"""Meshes as arrays, and their conversion for other libraries."""
from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any, Iterator, Literal, Mapping, Optional, Sequence, cast, overload

import numpy as np

from . import _core, _picture, _reports
from ._arguments import Bytes, Progress, reporting
from ._frame import Frame
from ._queries import options

if TYPE_CHECKING:
    from ._store import Store

_reports.register()
Space = Literal["ras", "lps", "as-stored"]
Up = Literal["y", "z"]


class Mesh:
    """A surface, a slice, or lines.

    The arrays own their memory, so a mesh outlives its store. In array coordinates, the default, vertices are as in
    scikit-image's ``marching_cubes``: positions in the array in the order of its axes (z, y, x), times the spacing. In
    world coordinates they are (x, y, z) and include the store's origin.

    A mesh can be used as the tuple of ``marching_cubes``: ``vertices, faces, normals, values = mesh``, ``mesh[0]``,
    ``len(mesh)`` is 4. It is False if it has no faces. It can be pickled and copied.
    """

    report: _core.Report
    """How the mesh was made, and its properties."""

    def __init__(self, parts: tuple, *, coordinates: str, frame: Frame, flip: bool, level: Optional[float],
                 labels: Optional[np.ndarray] = None, areas: "Optional[dict[tuple[int, int], float]]" = None) -> None:
        self._positions, elements, self._normals, self._values, self._errors, self._layout, self.report = parts
        self._elements = elements.view(np.int32) if len(self._positions) < 2**31 else elements
        self._coordinates = coordinates
        self._frame = frame
        self._flip = flip
        self._level = level
        self._labels = labels
        self._areas = areas
        self._fields: "dict[str, np.ndarray]" = {}
        self._field_bounds: "dict[str, float]" = {}
        self._vertices: Optional[np.ndarray] = None

    @property
    def coordinates(self) -> str:
        """"array" or "world"."""
        return self._coordinates

    @property
    def vertices(self) -> np.ndarray:
        """(n, 3), float32. A view if no conversion is needed (world coordinates, or origin 0 and unrotated axes)."""
        vertices = self._vertices
        if vertices is None:
            in_world = self._coordinates == "world"
            vertices = self._positions if in_world else self._frame.points_to_array(self._positions)
            self._vertices = vertices
        return vertices

    @property
    def faces(self) -> np.ndarray:
        """(m, 3), for lines (m, 2): indices of vertices; int32, or uint32 from 2**31 vertices on."""
        return self._elements[:, ::-1] if self._flip else self._elements

    @property
    def normals(self) -> Optional[np.ndarray]:
        """(n, 3), float32: unit vectors toward smaller values, from the data's gradient. None if not requested."""
        if self._normals is None or self._coordinates == "world":
            return self._normals
        return self._frame.normals_to_array(self._normals)

    @property
    def values(self) -> np.ndarray:
        """(n,), float64: the data at the vertices; for a surface, its isovalue or the values of ``vertex_values``."""
        if self._values is None:
            return np.broadcast_to(np.float64(np.nan if self._level is None else self._level), len(self._positions))
        return self._values

    @property
    def errors(self) -> Optional[np.ndarray]:
        """(n,), float32: the field of ``vertex_error``. None if not requested."""
        return self._errors

    @property
    def fields(self) -> "dict[str, np.ndarray]":
        """The quantities of :meth:`with_values` by name: (n,) for scalars, (n, 3) for vectors; NaN where missing."""
        return dict(self._fields)

    @property
    def field_bounds(self) -> "dict[str, float]":
        """By quantity, a bound on the error of linear interpolation on a face; proven for all faces that have no missing
        values near them."""
        return dict(self._field_bounds)

    @property
    def labels(self) -> "np.ndarray | Any":
        """(m, 2), int64: for interfaces, the labels on both sides of each face, the smaller one first. The outside is
        ``report.outside`` and comes second. In world coordinates, faces are oriented from the first label to the
        second. None for other meshes."""
        return self._labels

    @property
    def areas(self) -> "dict[tuple[int, int], float] | Any":
        """For interfaces, the area in square world units per pair of labels. None for other meshes."""
        return self._areas

    def _as_tuple(self) -> "tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]":
        # As in scikit-image, so that the third one needs no test; it is None if there are no normals.
        return self.vertices, self.faces, cast(np.ndarray, self.normals), self.values

    def __iter__(self) -> "Iterator[np.ndarray]":
        return iter(self._as_tuple())

    def __len__(self) -> int:
        return 4

    @overload
    def __getitem__(self, index: int) -> np.ndarray: ...
    @overload
    def __getitem__(self, index: slice) -> "tuple[np.ndarray, ...]": ...

    def __getitem__(self, index: Any) -> Any:
        return self._as_tuple()[index]

    def __bool__(self) -> bool:
        return len(self._elements) > 0

    def __array__(self, *_: Any, **__: Any) -> np.ndarray:
        raise TypeError("a mesh is several arrays: give mesh.vertices, mesh.faces, mesh.normals or mesh.values")

    def __repr__(self) -> str:
        kind = "lines" if self._elements.shape[1] == 2 else "faces"
        return f"<isonest.Mesh: {len(self._positions)} vertices, {len(self._elements)} {kind}, " \
               f"{self._coordinates} coordinates>"

    def __getstate__(self) -> "dict[str, Any]":
        # The vertices are computed again.
        return {**self.__dict__, "_vertices": None}

    def _repr_html_(self) -> str:
        return _picture.html_of(repr(self), self.in_world().vertices, self.in_world().faces)

    def _other(self, coordinates: str) -> "Mesh":
        parts = (self._positions, self._elements, self._normals, self._values, self._errors, self._layout,
                 self.report)
        other = Mesh(parts, coordinates=coordinates, frame=self._frame, flip=self._flip, level=self._level,
                     labels=self._labels, areas=self._areas)
        other._fields, other._field_bounds = self._fields, self._field_bounds
        return other

    def with_values(self, values: "Mapping[str, Store | Sequence[Store]]", *, memory: Bytes = "1G", threads: int = 0,
                    progress: Progress = None) -> "Mesh":
        """The same mesh with the values of other stores at its vertices. Both share the memory of their arrays.

        values: a store per name, or three for the x, y and z components of a vector. Each vertex gets the value at its
            position in the world, so the stores can have any lattice. Between their nodes they are trilinear.
        memory, threads, progress: as for :meth:`Store.isosurface`.

        The values are in :attr:`fields`, and in files that :meth:`save` writes; :attr:`field_bounds` has their errors
        between vertices.
        """
        stores = [(name, [one._core for one in (given if isinstance(given, Sequence) else [given])])
                  for name, given in values.items()]
        repeated = [name for name in values if name in self._fields]
        if repeated:
            raise ValueError(f"the mesh already has values with the name {repeated[0]!r}")
        other = self._other(self._coordinates)
        with reporting(progress) as report:
            other._layout, arrays, bounds = _core.fields_of_mesh(
                self._layout, self._positions, self._elements.view(np.uint32), stores, options(memory, threads, ""), report)
        other._fields = {**self._fields, **dict(zip(values, arrays))}
        other._field_bounds = {**self._field_bounds, **dict(zip(values, bounds))}
        return other

    def in_world(self) -> "Mesh":
        """The same mesh in world coordinates (x, y, z); shares the memory."""
        return self._other("world")

    def in_array(self) -> "Mesh":
        """The same mesh in array coordinates (z, y, x); shares the memory."""
        return self._other("array")

    def save(self, path: "os.PathLike[str] | str", *, space: Optional[Space] = None,
             shift: "tuple[float, float, float]" = (0, 0, 0), up: Up = "z", mesh_unit: Optional[str] = None,
             progress: Progress = None) -> None:
        """Writes the mesh to a file, in world coordinates.

        The file name extension chooses the format: .ply, .stl, .obj, .vtp, .vtkhdf, .glb, .3mf or .ngmesh; for lines
        .vtp or .obj, for interfaces .vtp, .vtkhdf or .ply. The file is identical to that of ``isonest extract``. It
        appears only when it is complete, and replaces an existing file, unless the mesh was made from that file.

        space: the patient axes of positions and normals in the file, "ras", "lps" or "as-stored". None: RAS if the
            volume's axes are known (:attr:`Store.frame`), otherwise as stored.
        shift: (x, y, z), added to all vertices; only for ``.ngmesh``. Use half the spacing if Neuroglancer shows the
            mesh over a precomputed volume, whose coordinates start at the corner of the first voxel.
        up: the axis that points up in the file, "z", or "y" as viewers of ``.glb`` and ``.obj`` expect; only for those.
        mesh_unit: the unit of the positions in the file, such as "m"; None: that of the mesh. Not for ``.glb``,
            ``.3mf`` and ``.ngmesh``, which have units of their own.
        progress: a function ``(phase, done, total, unit)``, or True for bars of tqdm.
        """
        with reporting(progress) as report:
            _core.save_mesh(os.fspath(path), self._layout, self._positions, self._elements.view(np.uint32), self._flip,
                            self._normals, self._values, self._errors, list(self._fields.values()), self._labels, space,
                            shift, up, mesh_unit, report)

    def _attributes(self) -> dict[str, np.ndarray]:
        named = {"normal": self._normals, "value": self._values, "error": self._errors}
        return {**{name: array for name, array in named.items() if array is not None}, **self._fields}

    def to_vtk(self) -> Any:
        """Converts to a ``vtkPolyData`` in world coordinates. It shares vertices and attributes; faces are copied."""
        from vtkmodules.util.numpy_support import numpy_to_vtk
        from vtkmodules.vtkCommonCore import vtkPoints, vtkTypeInt32Array, vtkTypeInt64Array
        from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData

        def shared(array: np.ndarray) -> Any:
            return numpy_to_vtk(np.ascontiguousarray(array), deep=0)

        def copied(array: np.ndarray) -> Any:
            # vtkCellArray would keep a pointer to the memory, but not a reference to the array that owns it.
            integers = (vtkTypeInt32Array if array.dtype == np.int32 else vtkTypeInt64Array)()
            view = integers.NewInstance()
            view.SetVoidArray(array, array.size, 1)
            integers.DeepCopy(view)
            return integers

        data = vtkPolyData()
        points = vtkPoints()
        points.SetData(shared(self._positions))
        data.SetPoints(points)
        corners = np.ascontiguousarray(self.faces)
        kind = np.int32 if corners.dtype == np.int32 and corners.size < 2**31 else np.int64
        offsets = np.arange(0, corners.size + 1, corners.shape[1], dtype=kind)
        cells = vtkCellArray()
        cells.SetData(copied(offsets), copied(corners.reshape(-1).astype(kind, copy=False)))
        if corners.shape[1] == 2:
            data.SetLines(cells)
        else:
            data.SetPolys(cells)
        for name, array in self._attributes().items():
            attribute = shared(array)
            attribute.SetName(name)
            if name == "normal":
                data.GetPointData().SetNormals(attribute)
            else:
                data.GetPointData().AddArray(attribute)
        if self._labels is not None:
            sides = shared(self._labels)
            sides.SetName("BoundaryLabels")
            data.GetCellData().AddArray(sides)
        if self._values is not None:
            data.GetPointData().SetActiveScalars("value")
        return data

    def to_pyvista(self) -> Any:
        """Converts to a ``pyvista.PolyData`` in world coordinates; memory as for :meth:`to_vtk`."""
        import pyvista

        return pyvista.wrap(self.to_vtk())

    def to_meshio(self) -> Any:
        """Converts to a ``meshio.Mesh`` in world coordinates."""
        import meshio

        kind = "line" if self._elements.shape[1] == 2 else "triangle"
        attributes: "dict[str, Any]" = {**self._attributes()}
        cells: "dict[str, Any]" = {} if self._labels is None else {"BoundaryLabels": [self._labels]}
        return meshio.Mesh(self._positions, [(kind, self.faces)], point_data=attributes, cell_data=cells)

    def to_trimesh(self) -> Any:
        """Converts to a ``trimesh.Trimesh`` in world coordinates. Raises ValueError for lines."""
        import trimesh

        if self._elements.shape[1] == 2:
            raise ValueError("trimesh.Trimesh has triangles; these are lines")
        attributes = {name: array for name, array in self._attributes().items() if name != "normal"}
        return trimesh.Trimesh(vertices=self._positions, faces=self.faces, vertex_normals=self._normals,
                               vertex_attributes=attributes, process=False)
