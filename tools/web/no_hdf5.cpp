// A page opens stores by their catalogues alone: there is no HDF5 in it.
#include <isonest/error.h>

#include "store/container/reader.h"

namespace isonest::detail {

void StoreReader::open_by_hdf5() {
    throw Error(
        ErrorKind::unsupported, {path_.string()},
        "not a store with a footer: a page opens only what isonest has written since format "
        "2.9, and what no other program has changed since",
        {{RemedyKind::preprocess_again}});
}

}  // namespace isonest::detail
