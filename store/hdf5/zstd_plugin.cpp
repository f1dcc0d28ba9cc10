// The entry points through which HDF5 loads the zstd filter from its plugin folder.
#include <H5PLextern.h>

#include "store/hdf5/zstd_filter.h"

extern "C" {

H5PL_type_t H5PLget_plugin_type(void) {
    return H5PL_TYPE_FILTER;
}

const void* H5PLget_plugin_info(void) {
    return &isonest::detail::zstd_filter_class();
}
}
