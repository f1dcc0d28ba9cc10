// The one list of the formats that are known.
#include "preprocess/sources/dicom/dicom_format.h"
#include "preprocess/sources/hdf5/hdf5_format.h"
#include "preprocess/sources/meta_image/meta_image_format.h"
#include "preprocess/sources/mgh/mgh_format.h"
#include "preprocess/sources/mrc/mrc_format.h"
#include "preprocess/sources/netcdf/netcdf_format.h"
#include "preprocess/sources/nifti/nifti_format.h"
#include "preprocess/sources/nrrd/nrrd_format.h"
#include "preprocess/sources/numpy/numpy_format.h"
#include "preprocess/sources/openvdb/openvdb_format.h"
#include "preprocess/sources/raw/raw_format.h"
#include "preprocess/sources/slices/slices_format.h"
#include "preprocess/sources/tiff/tiff_format.h"
#include "preprocess/sources/volume_format.h"
#include "preprocess/sources/vtk/vtk_format.h"
#include "preprocess/sources/zarr/zarr_format.h"
#include "store/remote/open_location.h"

namespace isonest::detail {

std::string VolumeInput::name() const {
    return shown_location(paths.front().native());
}

const std::vector<VolumeFormat>& volume_formats() {
    static const std::vector<VolumeFormat> formats{
        nrrd_format(), hdf5_format(), netcdf3_format(), nifti_format(), meta_image_format(),
        mgh_format(), mrc_format(), vti_format(), vtk_format(), npy_format(), npz_format(),
        zarr_format(), dicom_format(), tiff_format(), png_format(), bmp_format(), vdb_format(),
        // The last one: it takes every file.
        raw_format()};
    return formats;
}

}  // namespace isonest::detail
