// The one list of the formats that are known.
#include "preprocess/sources/hdf5_source.h"
#include "preprocess/sources/nrrd_source.h"
#include "preprocess/sources/raw_source.h"
#include "preprocess/sources/volume_format.h"

namespace isonest::detail {

const std::vector<VolumeFormat>& volume_formats() {
    static const std::vector<VolumeFormat> formats{
        nrrd_format(),
        hdf5_format(),
        raw_format(),
    };
    return formats;
}

}  // namespace isonest::detail
