#include <cstdint>

#include "store/container/hdf5_types.h"
#include "store/container/label_table.h"
#include "store/hdf5/handles.h"

namespace isonest::detail {

CatalogueNames LabelTable::find(std::int64_t file, const std::string& name) {
    const QuietHdf5 quiet;
    const DatasetHandle table(H5Dopen2(file, kPath, H5P_DEFAULT));
    if (!table.valid()) {
        names_damaged(name, "the dataset cannot be opened");
    }
    const SpaceHandle space(H5Dget_space(table.get()));
    const TypeHandle type(H5Dget_type(table.get()));
    const hssize_t rows = H5Sget_simple_extent_npoints(space.get());
    const std::size_t row_bytes = H5Tget_size(type.get());
    const auto sum = read_integers(table.get(), "xxh64", 1);
    const haddr_t offset = H5Dget_offset(table.get());
    if (!sum || rows < 1 || offset == HADDR_UNDEF ||
        H5Dget_storage_size(table.get()) != static_cast<std::uint64_t>(rows) * row_bytes) {
        names_damaged(name, kOtherNamesForm);
    }
    return {offset, static_cast<std::uint64_t>(rows), row_bytes, (*sum)[0]};
}

}  // namespace isonest::detail
