#include "store/container/reader.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include <isonest/error.h>

#include "store/bytes/file_bytes.h"
#include "store/bytes/read_whole.h"
#include "store/container/header_reader.h"

namespace isonest::detail {

void StoreReader::fail_corrupt(const std::string& inside, const std::string& problem) const {
    throw Error(ErrorKind::corrupt, {path_.string(), inside}, problem,
                {{RemedyKind::good_copy}, {RemedyKind::preprocess_again}});
}

StoreReader::StoreReader(const std::filesystem::path& path)
    : StoreReader(std::make_shared<const FileBytes>(path)) {}

StoreReader::StoreReader(std::shared_ptr<const StoreBytes> bytes)
    : path_(bytes->name()), bytes_(std::move(bytes)), found_(find_catalogue(*bytes_)) {
    if (found_) {
        open_by_catalogue();
    } else {
        open_by_hdf5();
    }
}

void StoreReader::take_header(const RootAttributes& root) {
    version_ = root.version;
    range_ = root.range;
    has_missing_ = root.has_missing;
    try {
        layout_ = StoreLayout(root.header);
    } catch (const Error& error) {
        fail_corrupt("header", "damaged: " + error.problem());
    }
}

void StoreReader::open_by_catalogue() {
    const Catalogue& catalogue = found_->catalogue;
    take_header(read_root_attributes(catalogue, path_.string()));
    const auto& table = catalogue.table;
    const bool newer = version_ > FormatVersion{};
    if (!table || table->rows > file_bytes() / sizeof(ChunkRow) ||
        !lies_within(table->offset, table->rows * sizeof(ChunkRow), file_bytes()) ||
        table->rows < layout_.rows() || (table->rows > layout_.rows() && !newer)) {
        fail_corrupt("chunk table", "missing, or longer or shorter than the header says");
    }
    identity_ = table->xxh64;
    table_ = ChunkTable(*bytes_, *found_);
    ranges_ = CubeRangeTable(catalogue, layout_, *bytes_);
    if (catalogue.names) {
        label_names_ = LabelTable(*catalogue.names, *bytes_);
    }
}

void StoreReader::compare_range() const {
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
    if (range_ != std::array{low, high} || has_missing_ != missing) {
        fail_corrupt(
            "header",
            fmt::format("it says that values go from {} to {}{}, the chunk table from {} to {}{}: "
                        "one of them is damaged",
                        range_[0], range_[1], has_missing_ != 0 ? ", some missing" : "", low, high,
                        missing != 0 ? ", some missing" : ""));
    }
}

std::optional<CubeRange> StoreReader::cube_range(int level, const Int3& cube) const {
    return ranges_.at(level, cube);
}

ChunkRow StoreReader::row(const ArrayInfo& array, const Int3& chunk) const {
    const ChunkRow row = table_.row(array.row_of(chunk));
    if (!lies_within(row.offset, row.bytes, file_bytes())) {
        fail_corrupt(array.place(chunk), "lies outside the file; it was cut off");
    }
    if (row.bytes > array.most_stored_bytes()) {
        fail_corrupt(array.place(chunk), "damaged: no chunk is stored in as many bytes as it says");
    }
    return row;
}

ArrayTotals StoreReader::totals(const ArrayInfo& array) const {
    const auto chunks = static_cast<std::uint64_t>(array.grid.product());
    if (found_) {
        const ArrayTotals* const totals = found_->catalogue.totals_of(array.first_row, chunks);
        if (totals != nullptr) {
            return *totals;
        }
    }
    ArrayTotals totals{.first_row = array.first_row, .chunks = chunks};
    for (std::int64_t i = 0; i < array.grid.product(); ++i) {
        totals.add(StoreReader::row(array, array.grid.unlinear(i)));
    }
    return totals;
}

HeldBytes StoreReader::stored(const ArrayInfo& array, const Int3& chunk) const {
    const ChunkRow r = row(array, chunk);
    return bytes_->read(r.offset, r.bytes);
}

void StoreReader::decode(const ArrayInfo& array, const Int3& chunk,
                         std::span<std::byte> raw) const {
    const ChunkRow r = row(array, chunk);
    const auto held = read_whole(*bytes_, {r.offset, r.bytes}, r.checksum);
    if (!held) {
        fail_corrupt(array.place(chunk), "damaged: its bytes are not those that were written");
    }
    decode_chunk(held->bytes(), array.codec, raw, {path_.string(), array.place(chunk)});
}

void StoreReader::prefetch(const ArrayInfo& array, const Int3& chunk) const {
    const ChunkRow r = row(array, chunk);
    const ByteRange range{r.offset, r.bytes};
    bytes_->want({&range, 1});
}

void StoreReader::prefetch_all(std::span<const WantedChunk> chunks) const {
    std::vector<std::uint64_t> rows;
    std::vector<const WantedChunk*> inside;
    for (const WantedChunk& wanted : chunks) {
        if (wanted.array->has_chunk(wanted.chunk)) {
            rows.push_back(wanted.array->row_of(wanted.chunk));
            inside.push_back(&wanted);
        }
    }
    table_.want(rows);
    std::vector<ByteRange> ranges;
    for (const WantedChunk* const wanted : inside) {
        const ChunkRow r = row(*wanted->array, wanted->chunk);
        ranges.push_back({r.offset, r.bytes});
    }
    if (!ranges.empty()) {
        bytes_->want(ranges);
    }
}

}  // namespace isonest::detail
