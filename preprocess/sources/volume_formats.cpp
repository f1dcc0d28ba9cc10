// The one list of the formats that are known.
#include "preprocess/sources/dicom_source.h"
#include "preprocess/sources/hdf5_source.h"
#include "preprocess/sources/meta_image_source.h"
#include "preprocess/sources/mrc_source.h"
#include "preprocess/sources/netcdf3_source.h"
#include "preprocess/sources/nifti_source.h"
#include "preprocess/sources/npy_source.h"
#include "preprocess/sources/nrrd_source.h"
#include "preprocess/sources/raw_source.h"
#include "preprocess/sources/tiff_source.h"
#include "preprocess/sources/vdb_source.h"
#include "preprocess/sources/volume_format.h"
#include "preprocess/sources/vti_source.h"
#include "preprocess/sources/vtk_source.h"
#include "preprocess/sources/zarr_source.h"

namespace isonest::detail {

const std::vector<VolumeFormat>& volume_formats() {
    static const std::vector<VolumeFormat> formats{
        nrrd_format(), hdf5_format(), netcdf3_format(), nifti_format(), meta_image_format(),
        mrc_format(), vti_format(), vtk_format(), npy_format(), npz_format(), zarr_format(),
        dicom_format(), tiff_format(), vdb_format(),
        // The last one: it takes every file.
        raw_format()};
    return formats;
}

}  // namespace isonest::detail
