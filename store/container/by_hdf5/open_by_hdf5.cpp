// How a store opens that has no footer.
#include <algorithm>
#include <cstdint>
#include <optional>

#include <isonest/error.h>

#include "store/base/checksum.h"
#include "store/container/hdf5_types.h"
#include "store/container/header_reader.h"
#include "store/container/reader.h"
#include "store/hdf5/bytes_driver.h"
#include "store/hdf5/handles.h"

namespace isonest::detail {

/// Of stores before 2.9, and of those that an HDF5 program has changed, whose footer is gone then.
void StoreReader::open_by_hdf5() {
    if (is_far()) {
        close_nothing_at_exit();
    }
    const QuietHdf5 quiet;
    const FileHandle file = open_hdf5_of(*bytes_);
    if (!file.valid()) {
        throw Error(ErrorKind::corrupt, {path_.string()}, "not a store: " + hdf5_cannot_open(),
                    {{RemedyKind::make_store}});
    }
    reading(file.get(), [&] {
        const RootAttributes root = read_root_attributes(file.get(), path_.string());
        take_header(root);
        read_table(file.get());
        compare_range();
        ranges_ = CubeRangeTable(file.get(), layout_, *bytes_);
        if (root.header.label_names) {
            label_names_ = LabelTable(LabelTable::find(file.get(), path_.string()), *bytes_);
        }
    });
}

/// A newer minor version may have rows behind those of the arrays that are known.
void StoreReader::read_table(std::int64_t root) {
    const DatasetHandle table(H5Dopen2(root, "chunks", H5P_DEFAULT));
    const auto sum = table.valid() ? read_integers(table.get(), "xxh64", 1) : std::nullopt;
    std::uint64_t size = layout_.rows() * sizeof(ChunkRow);
    std::optional<std::uint64_t> offset;
    if (table.valid()) {
        if (version_ > FormatVersion{}) {
            size = std::max<std::uint64_t>(size, H5Dget_storage_size(table.get()));
        }
        offset = offset_of(table.get(), size, file_bytes());
    }
    if (!sum || !offset) {
        fail_corrupt("chunk table", "missing, or longer or shorter than the header says");
    }
    const HeldBytes rows = bytes_->read(*offset, size);
    identity_ = checksum_of(rows.bytes());
    if (identity_ != (*sum)[0]) {
        fail_corrupt("chunk table", "damaged");
    }
    table_ = ChunkTable(rows);
}

}  // namespace isonest::detail
