#include "store/container/reader.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include <isonest/error.h>
#include <isonest/store.h>

#include "store/base/label_text.h"
#include "store/base/length_unit.h"
#include "store/bytes/store_bytes.h"
#include "store/container/chunk_cache.h"
#include "store/container/parts/header_reader.h"
#include "store/remote/open_location.h"

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
        fail_corrupt(array.place(chunk), "lies outside the file, which is cut off");
    }
    if (row.bytes > array.max_stored_bytes()) {
        fail_corrupt(array.place(chunk), "damaged: invalid stored size of a chunk");
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
        fail_corrupt(array.place(chunk), "damaged: checksum mismatch: its bytes have changed");
    }
    decode_chunk(held->bytes(), array.codec_of(r), raw, {path_.string(), array.place(chunk)});
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

namespace isonest {
namespace detail {
namespace {

/// A store's value as its user sees it: for labels the label, rounded above 2^53.
double number_of(const StoreReader& store, double value) {
    return store.layout().header().labels && std::isfinite(value)
               ? static_cast<double>(label_of_value(value))
               : value;
}

}  // namespace
}  // namespace detail

Store::Store(const std::filesystem::path& location, const RemoteAccess& remote)
    : cache_(detail::open_cache(location, remote)),
      reader_(std::make_unique<const detail::StoreReader>(
          detail::open_location(location, remote, cache_))) {}
Store::Store(Store&& other) noexcept = default;
Store& Store::operator=(Store&& other) noexcept = default;
Store::~Store() = default;

const std::filesystem::path& Store::path() const {
    return reader_->path();
}
bool Store::is_remote() const {
    return reader_->bytes().is_remote();
}
FetchedCounts Store::fetched() const {
    return reader_->bytes().fetched();
}
std::string Store::cache_warning() const {
    return detail::cache_warning(cache_.get());
}
Int3 Store::nodes() const {
    return reader_->layout().header().nodes;
}
ValueType Store::type() const {
    return reader_->layout().header().type;
}
Directions Store::direction() const {
    return reader_->layout().header().direction;
}
UnevenAxesPtr Store::uneven_axes() const {
    return reader_->layout().header().uneven;
}
CurvedNodesPtr Store::curved() const {
    return reader_->layout().header().curved;
}
std::vector<Double3> Store::positions(const Int3& first, const Int3& size) const {
    const detail::StoreHeader& h = reader_->layout().header();
    if (min(first, {0, 0, 0}) != Int3{0, 0, 0} || min(size, {0, 0, 0}) != Int3{0, 0, 0} ||
        max(first + size, h.nodes) != h.nodes) {
        throw Error(ErrorKind::invalid_argument, {path().string()},
                    fmt::format("nodes {} {} {} to {} {} {} (exclusive) are not all in a volume of "
                                "{} x {} x {}",
                                first.x, first.y, first.z, first.x + size.x, first.y + size.y,
                                first.z + size.z, h.nodes.x, h.nodes.y, h.nodes.z));
    }
    std::vector<Double3> found(static_cast<std::size_t>(size.product()));
    if (h.curved && !found.empty()) {
        detail::ChunkCache cache(*reader_, 0);
        for (std::size_t a = 0; a < 3; ++a) {
            const detail::ArrayInfo& array = reader_->layout().positions()[a];
            dispatch(h.curved->type, [&](auto tag) {
                using T = typename decltype(tag)::type;
                const std::vector<T> numbers =
                    detail::gather_components<T>(cache, array, first, size, 0, 1);
                for (std::size_t i = 0; i < numbers.size(); ++i) {
                    found[i].at(a) = static_cast<double>(numbers[i]);
                }
            });
        }
        return found;
    }
    const detail::LatticeSteps steps = h.steps();
    const Directions rotation = h.rotation();
    for (std::size_t i = 0; i < found.size(); ++i) {
        const Int3 p = first + size.unlinear(static_cast<std::int64_t>(i));
        const Double3 way = detail::rotated(
            rotation, steps.vector({static_cast<double>(p.x), static_cast<double>(p.y),
                                    static_cast<double>(p.z)}));
        found[i] = {h.origin[0] + way[0], h.origin[1] + way[1], h.origin[2] + way[2]};
    }
    return found;
}
Double3 Store::spacing() const {
    return reader_->layout().header().spacing;
}
Double3 Store::origin() const {
    return reader_->layout().header().origin;
}
std::optional<LengthUnit> Store::unit() const {
    return reader_->layout().header().unit;
}
AnatomicalFrame Store::frame() const {
    return reader_->layout().header().frame;
}
DataRounding Store::rounding() const {
    return reader_->layout().header().rounding;
}
double Store::world_units(double length, LengthUnit given) const {
    return detail::world_units(length, given, unit(), path().string());
}
int Store::levels() const {
    return reader_->layout().lattice().top() + 1;
}
const std::vector<Field>& Store::fields() const {
    return reader_->layout().header().fields;
}
double Store::min_value() const {
    return detail::number_of(*reader_, reader_->min_value());
}
double Store::max_value() const {
    return detail::number_of(*reader_, reader_->max_value());
}
bool Store::has_missing() const {
    return reader_->has_missing();
}
std::vector<LabelName> Store::label_names() const {
    const detail::LabelTable& table = reader_->label_names();
    std::vector<LabelName> names;
    names.reserve(table.size());
    for (std::size_t i = 0; i < table.size(); ++i) {
        names.push_back(table.at(i));
    }
    return names;
}
std::optional<LabelName> Store::label_name(std::int64_t id) const {
    return reader_->label_names().find(id);
}
std::vector<std::int64_t> Store::labels_named(std::string_view name) const {
    const detail::LabelTable& table = reader_->label_names();
    std::vector<std::int64_t> ids;
    for (std::size_t i = 0; !name.empty() && i < table.size(); ++i) {
        if (const LabelName label = table.at(i); label.name == name) {
            ids.push_back(label.id);
        }
    }
    return ids;
}

}  // namespace isonest
