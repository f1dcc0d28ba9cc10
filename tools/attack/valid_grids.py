#!/usr/bin/env python3
"""Valid random files of NetCDF, VTK's images, OpenVDB, NRRD, HDF5 and its dialects: values, place and unit as independent readers have them.

netcdf3, netcdf4: netCDF4, xarray and scipy read what netCDF4, scipy or xarray wrote; vtk, vti: VTK reads what VTK, or a
writer by the format's description, wrote; vdb: pyopenvdb, and the array that was written; nrrd: teem reads what a writer
by the format's definition wrote; hdf5: h5py, and the array that was written; vtkhdf: h5py and VTK; minc1, minc2: nibabel;
itk, imaris, ilastik, cmap, hspy, emd, velox: h5py, and the array and the places that were written, by each format's description.
"""
import sys

import attack

attack.require("netCDF4", "xarray", "scipy.io", "vtkmodules", "pyopenvdb", "h5py", "nibabel")

from grids import dialects, hdf5, netcdf, nrrd, vdb, vtk_images  # noqa: E402

if nrrd.UNU is None:
    print("skipped: no unu (Debian: teem-apps)")
    sys.exit(77)

if __name__ == "__main__":
    sys.exit(attack.main(__doc__, {"netcdf3": netcdf.classic, "netcdf4": netcdf.netcdf4, "vtk": vtk_images.legacy,
                                   "vti": vtk_images.xml, "vdb": vdb.grid, "nrrd": nrrd.nrrd, "hdf5": hdf5.dataset,
                                   "vtkhdf": hdf5.image, **dialects.KINDS}))
