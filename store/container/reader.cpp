#include "store/container/reader.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

#include <isonest/error.h>

#include "store/container/hdf5_types.h"
#include "store/container/header_reader.h"
#include "store/hdf5/handles.h"

namespace isonest::detail {

void StoreReader::fail_corrupt(const std::string& inside, const std::string& problem) const {
    throw Error(ErrorKind::corrupt, {path_.string(), inside}, problem,
                {{RemedyKind::good_copy}, {RemedyKind::preprocess_again}});
}

StoreReader::StoreReader(const std::filesystem::path& path) : path_(path), file_(path) {
    const QuietHdf5 quiet;
    const FileHandle file = open_hdf5(path_);
    if (!file.valid()) {
        throw Error(ErrorKind::corrupt, {path_.string()}, "not a store: " + hdf5_cannot_open(),
                    {{RemedyKind::make_store}});
    }
    const RootAttributes root = read_root_attributes(file.get(), path_.string());
    version_ = root.version;
    range_ = root.range;
    has_missing_ = root.has_missing != 0;
    try {
        layout_ = StoreLayout(root.header);
    } catch (const Error& error) {
        fail_corrupt("header", "damaged: " + error.problem());
    }
    map_table(file.get());
    compare_range(root.has_missing);
    ranges_ = CubeRangeTable(file.get(), layout_, file_.bytes(), path_.string());
    if (root.header.label_names) {
        label_names_ = LabelTable(file.get(), file_.bytes(), path_.string());
    }
}

/// A newer minor version may have rows behind those of the arrays that are known.
void StoreReader::map_table(std::int64_t root) {
    const DatasetHandle table(H5Dopen2(root, "chunks", H5P_DEFAULT));
    const auto sum = table.valid() ? read_integers(table.get(), "xxh64", 1) : std::nullopt;
    std::uint64_t size = layout_.rows() * sizeof(ChunkRow);
    if (table.valid()) {
        if (version_ > FormatVersion{}) {
            size = std::max<std::uint64_t>(size, H5Dget_storage_size(table.get()));
        }
        table_ = contiguous(table.get(), size, file_.bytes());
    }
    if (!sum || table_.empty()) {
        fail_corrupt("chunk table", "missing, or longer or shorter than the header says");
    }
    if (checksum_of(table_) != (*sum)[0]) {
        fail_corrupt("chunk table", "damaged");
    }
}

std::uint64_t StoreReader::identity() const {
    return checksum_of(table_);
}

/// The header's range and has_missing are those of the chunk table.
void StoreReader::compare_range(std::uint64_t has_missing) const {
    double low = std::numeric_limits<double>::infinity();
    double high = -low;
    std::uint64_t missing = 0;
    const ArrayInfo& values = layout_.array(0, Field::values);
    for (std::int64_t i = 0; i < values.grid.product(); ++i) {
        const ChunkRow chunk = StoreReader::row(values, values.grid.unlinear(i));
        low = std::fmin(low, chunk.min);
        high = std::fmax(high, chunk.max);
        missing |= chunk.flags & kChunkHasMissing;
    }
    if (range_ != std::array{low, high} || has_missing != missing) {
        fail_corrupt(
            "header",
            fmt::format("it says that values go from {} to {}{}, the chunk table from {} to {}{}: "
                        "one of them is damaged",
                        range_[0], range_[1], has_missing != 0 ? ", some missing" : "", low, high,
                        missing != 0 ? ", some missing" : ""));
    }
}

std::optional<CubeRange> StoreReader::cube_range(int level, const Int3& cube) const {
    return ranges_.at(level, cube);
}

ChunkRow StoreReader::row(const ArrayInfo& array, const Int3& chunk) const {
    ChunkRow row;
    std::memcpy(&row, table_.data() + array.row_of(chunk) * sizeof(ChunkRow), sizeof(ChunkRow));
    if (row.offset > file_bytes() || row.bytes > file_bytes() - row.offset) {
        fail_corrupt(array.place(chunk), "lies outside the file; it was cut off");
    }
    return row;
}

std::span<const std::byte> StoreReader::stored(const ArrayInfo& array, const Int3& chunk) const {
    const ChunkRow r = row(array, chunk);
    return file_.bytes().subspan(r.offset, r.bytes);
}

void StoreReader::decode(const ArrayInfo& array, const Int3& chunk,
                         std::span<std::byte> raw) const {
    const ChunkRow r = row(array, chunk);
    const auto bytes = file_.bytes().subspan(r.offset, r.bytes);
    if (checksum_of(bytes) != r.checksum) {
        fail_corrupt(array.place(chunk), "damaged: its bytes are not those that were written");
    }
    decode_chunk(bytes, array.codec, raw, {path_.string(), array.place(chunk)});
}

void StoreReader::prefetch(const ArrayInfo& array, const Int3& chunk) const {
    const ChunkRow r = row(array, chunk);
    file_.prefetch(r.offset, r.bytes);
}

}  // namespace isonest::detail
