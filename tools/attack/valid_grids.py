#!/usr/bin/env python3
"""Valid random files of NetCDF, VTK's images and OpenVDB: values, place and unit as independent readers have them.

netcdf3, netcdf4: netCDF4, xarray and scipy read what netCDF4, scipy or xarray wrote; vtk, vti: VTK reads what VTK, or a
writer by the format's description, wrote; vdb: pyopenvdb, and the array that was written.
"""
import sys

import attack

attack.require("netCDF4", "xarray", "scipy.io", "vtkmodules", "pyopenvdb")

from grids import netcdf, vdb, vtk_images  # noqa: E402

if __name__ == "__main__":
    sys.exit(attack.main(__doc__, {"netcdf3": netcdf.classic, "netcdf4": netcdf.netcdf4, "vtk": vtk_images.legacy,
                                   "vti": vtk_images.xml, "vdb": vdb.grid}))
