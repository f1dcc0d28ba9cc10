#include "store/container/reader.h"

#include <fmt/format.h>

#include <cmath>
#include <cstring>
#include <limits>

#include <isonest/error.h>

#include "store/container/handles.h"
#include "store/container/hdf5_types.h"

namespace isonest::detail {

void StoreReader::fail_corrupt(const std::string& what) const {
    throw Error(ErrorKind::corrupt, fmt::format("{}: {}", path_.string(), what));
}

StoreReader::StoreReader(const std::filesystem::path& path) : path_(path), file_(path) {
    read_header();
}

void StoreReader::read_header() {
    const QuietHdf5 quiet;
    const FileHandle file = open_hdf5(path_);
    if (!file.valid()) {
        fail_corrupt("not a store: HDF5 cannot open it (" + hdf5_message() +
                     "); make one with: isonest preprocess INPUT -o STORE");
    }
    const hid_t root = file.get();
    if (read_text(root, "format") != kFormatName) {
        fail_corrupt(
            "an HDF5 file, but not an isonest store; make one with: isonest preprocess INPUT -o "
            "STORE");
    }
    const auto version = read_integers(root, "version", 2);
    if (!version) {
        fail_corrupt("the header has no version");
    }
    if ((*version)[0] != kFormatMajor) {
        throw Error(ErrorKind::unsupported,
                    fmt::format("{}: written in format version {}.{}; this isonest reads version "
                                "{}.x: use a newer isonest",
                                path_.string(), (*version)[0], (*version)[1], kFormatMajor));
    }
    const auto flags = read_integers(root, "flags", 1);
    if (!flags || (*flags)[0] != 0) {
        throw Error(
            ErrorKind::unsupported,
            fmt::format("{}: reserved header flags are set: use a newer isonest", path_.string()));
    }
    if (read_integers(root, "complete", 1) != std::vector<std::uint64_t>{1}) {
        fail_corrupt("the store is incomplete; preprocess again");
    }
    const auto nodes = read_integers(root, "nodes", 3);
    const auto spacing = read_numbers(root, "spacing", 3);
    const auto origin = read_numbers(root, "origin", 3);
    const auto type = read_text(root, "value_type");
    const auto chunk = read_integers(root, "chunk", 1);
    const auto compression = read_integers(root, "compression", 1);
    const auto exact = read_integers(root, "exact", 1);
    const auto fields = read_text(root, "fields");
    const auto range = read_numbers(root, "range", 2);
    const auto missing = read_integers(root, "has_missing", 1);
    if (!nodes || !spacing || !origin || !type || !chunk || !compression || !exact || !fields ||
        !range || !missing || !value_type_from_name(*type) || (*chunk)[0] > kMaxChunk) {
        fail_corrupt("the header is damaged; restore the store from a good copy");
    }
    StoreHeader header;
    for (int axis = 0; axis < 3; ++axis) {
        const auto a = static_cast<std::size_t>(axis);
        header.nodes[axis] = static_cast<std::int64_t>((*nodes)[a]);
        header.spacing[a] = (*spacing)[a];
        header.origin[a] = (*origin)[a];
    }
    format_minor_ = (*version)[1];
    if (format_minor_ >= 3) {
        const auto digest = read_integers(root, "xxh64", 1);
        if (!digest || header_digest(root) != (*digest)[0]) {
            fail_corrupt(
                "the header is damaged: its attributes are not those that were written; restore "
                "the store from a good copy");
        }
    }
    header.cube_ranges = format_minor_ >= 2;
    header.outward = format_minor_ >= 3;
    header.type = *value_type_from_name(*type);
    header.chunk = static_cast<int>((*chunk)[0]);
    header.compression = static_cast<int>(std::min<std::uint64_t>((*compression)[0], 100));
    header.exact = (*exact)[0] != 0;
    for (std::size_t at = 0; at < fields->size();) {
        const std::size_t end = std::min(fields->find(',', at), fields->size());
        const auto field = field_from_name(fields->substr(at, end - at));
        if (!field || *field == Field::values) {
            throw Error(ErrorKind::unsupported,
                        fmt::format("{}: unknown field '{}': use a newer isonest", path_.string(),
                                    fields->substr(at, end - at)));
        }
        header.fields.push_back(*field);
        at = end + 1;
    }
    try {
        layout_ = StoreLayout(header);
    } catch (const Error& error) {
        fail_corrupt(std::string("the header is damaged: ") + error.what());
    }
    range_ = {(*range)[0], (*range)[1]};
    has_missing_ = (*missing)[0] != 0;

    const DatasetHandle table(H5Dopen2(root, "chunks", H5P_DEFAULT));
    const auto sum = table.valid() ? read_integers(table.get(), "xxh64", 1) : std::nullopt;
    if (table.valid()) {
        table_ = contiguous(table.get(), layout_.rows() * sizeof(ChunkRow), file_.bytes());
    }
    if (!sum || table_.empty()) {
        fail_corrupt("the chunk table is missing or cut off; restore the store from a good copy");
    }
    if (checksum_of(table_) != (*sum)[0]) {
        fail_corrupt("the chunk table is damaged; restore the store from a good copy");
    }
    compare_range((*missing)[0]);
    try {
        ranges_ = CubeRangeTable(root, layout_, file_.bytes());
    } catch (const Error& error) {
        fail_corrupt(error.what());
    }
}

/// The header's range and has_missing are those of the chunk table.
void StoreReader::compare_range(std::uint64_t has_missing) const {
    double low = std::numeric_limits<double>::infinity();
    double high = -low;
    std::uint64_t missing = 0;
    const ArrayInfo& values = layout_.array(0, Field::values);
    for (std::int64_t i = 0; i < values.grid.product(); ++i) {
        const ChunkRow chunk = row(values, values.grid.unlinear(i));
        low = std::fmin(low, chunk.min);
        high = std::fmax(high, chunk.max);
        missing |= chunk.flags & kChunkHasMissing;
    }
    if (range_ != std::array{low, high} || has_missing != missing) {
        fail_corrupt(
            fmt::format("the header says that values go from {} to {}{}, the chunk table from {} "
                        "to {}{}: one of "
                        "them is damaged; restore the store from a good copy",
                        range_[0], range_[1], has_missing != 0 ? ", some missing" : "", low, high,
                        missing != 0 ? ", some missing" : ""));
    }
}

std::optional<CubeRange> StoreReader::cube_range(int level, const Int3& cube) const {
    try {
        return ranges_.at(level, cube);
    } catch (const Error& error) {
        fail_corrupt(error.what());
    }
}

ChunkRow StoreReader::row(const ArrayInfo& array, const Int3& chunk) const {
    ChunkRow row;
    std::memcpy(&row, table_.data() + array.row_of(chunk) * sizeof(ChunkRow), sizeof(ChunkRow));
    if (row.offset > file_bytes() || row.bytes > file_bytes() - row.offset) {
        fail_corrupt(array.place(chunk) + " lies outside the file; it was cut off");
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
        fail_corrupt(array.place(chunk) +
                     " is damaged: its bytes are not those that were written; restore the store "
                     "from a good copy or preprocess again");
    }
    decode_chunk(bytes, array.codec, raw, path_.string() + ": " + array.place(chunk));
    ++chunks_read_;
    bytes_read_ += bytes.size();
}

void StoreReader::prefetch(const ArrayInfo& array, const Int3& chunk) const {
    const ChunkRow r = row(array, chunk);
    file_.prefetch(r.offset, r.bytes);
}

}  // namespace isonest::detail
