#include "store/container/parts/by_hdf5.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <isonest/error.h>

#include "store/base/checksum.h"
#include "store/container/parts/cube_range_table.h"
#include "store/container/parts/hdf5_types.h"
#include "store/container/parts/header_reader.h"
#include "store/container/parts/header_writer.h"
#include "store/container/parts/make_catalogue.h"
#include "store/container/reader.h"
#include "store/hdf5/file_drivers.h"
#include "store/hdf5/handles.h"

namespace isonest::detail {

struct Hdf5View::Impl {
    FileHandle file;
    std::string opened;  ///< the dataset's name
    DatasetHandle dataset;

    std::string read(const ArrayInfo& array, const Int3& chunk, const ChunkRow& row,
                     std::vector<std::byte>& out);
    [[nodiscard]] std::string vtk_fault(const StoreHeader& header) const;
};

Hdf5View::Hdf5View(const StoreBytes& bytes) : impl_(std::make_unique<Impl>()) {
    const QuietHdf5 quiet;
    impl_->file = open_hdf5_of(bytes);
    if (!impl_->file.valid()) {
        throw Error(ErrorKind::corrupt, {bytes.name()}, hdf5_cannot_open());
    }
}

Hdf5View::~Hdf5View() = default;

std::string Hdf5View::read(const ArrayInfo& array, const Int3& chunk, const ChunkRow& row,
                           std::vector<std::byte>& out) const {
    return reading(impl_->file.get(), [&] { return impl_->read(array, chunk, row, out); });
}

std::string Hdf5View::vtk_fault(const StoreHeader& header) const {
    return reading(impl_->file.get(), [&] { return impl_->vtk_fault(header); });
}

std::string Hdf5View::Impl::read(const ArrayInfo& array, const Int3& chunk, const ChunkRow& row,
                                 std::vector<std::byte>& out) {
    const QuietHdf5 quiet;
    const std::string name = StoreLayout::path_of(array);
    if (opened != name) {
        opened = name;
        dataset = DatasetHandle(H5Dopen2(file.get(), name.c_str(), H5P_DEFAULT));
    }
    if (!dataset.valid()) {
        return "HDF5 cannot open the dataset: " + hdf5_message();
    }
    const hid_t data = dataset.get();
    const SpaceHandle space(H5Dget_space(data));
    std::array<hsize_t, 4> dims{};
    const int rank = rank_of(array);
    const auto expected = dims_of(array.nodes, array.components);
    if (H5Sget_simple_extent_ndims(space.get()) != rank ||
        H5Sget_simple_extent_dims(space.get(), dims.data(), nullptr) != rank ||
        !std::equal(dims.begin(), dims.begin() + rank, expected.begin())) {
        return "the dataset has other dimensions than the header says";
    }
    const auto at = dims_of(array.first_node(chunk), 0);
    hsize_t size = 0;
    if (H5Dget_chunk_storage_size(data, at.data(), &size) < 0 || size > array.max_stored_bytes()) {
        return "HDF5 does not find the chunk: " + hdf5_message();
    }
    out.resize(size);
    std::uint32_t skipped_filters = 0;
    if (H5Dread_chunk(data, H5P_DEFAULT, at.data(), &skipped_filters, out.data()) < 0) {
        return "HDF5 cannot read the chunk: " + hdf5_message();
    }
    if (skipped_filters == array.filter_mask(row)) {
        return {};
    }
    return skipped_filters == 0 ? "HDF5 reverses a shuffle that, by the table, was not applied"
                                : "HDF5 skips a filter that, by the table, was applied";
}

std::optional<std::vector<std::byte>> Hdf5View::catalogue(const StoreLayout& layout,
                                                          std::span<const std::byte> table) const {
    return reading(impl_->file.get(),
                   [&] { return make_catalogue(impl_->file.get(), layout, table); });
}

std::string Hdf5View::Impl::vtk_fault(const StoreHeader& header) const {
    if (header.uneven || header.curved) {
        return {};
    }
    const QuietHdf5 quiet;
    const GroupHandle group(H5Gopen2(file.get(), "/VTKHDF", H5P_DEFAULT));
    if (!group.valid()) {
        return "there is no group /VTKHDF: VTK and ParaView cannot open the store";
    }
    std::vector<double> extent;
    for (int axis = 0; axis < 3; ++axis) {
        extent.push_back(0);
        extent.push_back(static_cast<double>(header.nodes[axis] - 1));
    }
    const std::vector<std::pair<const char*, std::vector<double>>> expected{
        {"Version", {1, 0}},
        {"WholeExtent", extent},
        {"Origin", {header.origin.begin(), header.origin.end()}},
        {"Spacing", {header.spacing.begin(), header.spacing.end()}},
        {"Direction", vtk_direction(header.direction)}};
    for (const auto& [name, numbers] : expected) {
        if (read_numbers(group.get(), name, numbers.size()) != numbers) {
            return fmt::format("/VTKHDF: {} is not what the header says", name);
        }
    }
    if (read_text(group.get(), "Type") != "ImageData") {
        return "/VTKHDF: Type is not ImageData";
    }
    H5O_info_t ours{};
    H5O_info_t theirs{};
    if (H5Oget_info_by_name(file.get(), "/levels/0/values", &ours, H5P_DEFAULT) < 0 ||
        H5Oget_info_by_name(group.get(), "PointData/values", &theirs, H5P_DEFAULT) < 0 ||
        ours.addr != theirs.addr || ours.fileno != theirs.fileno) {
        return "/VTKHDF/PointData/values is not the dataset /levels/0/values";
    }
    return {};
}

CubeRangeTable::CubeRangeTable(std::int64_t file, const StoreLayout& layout,
                               const StoreBytes& bytes)
    : bytes_(&bytes), type_(cube_range_type(layout.header().type)) {
    for (int level = kFirstRangeLevel; layout.has_cube_ranges(level); ++level) {
        const auto open = [&](const std::string& path) {
            return DatasetHandle(H5Dopen2(file, path.c_str(), H5P_DEFAULT));
        };
        const DatasetHandle ranges = open(StoreLayout::cube_ranges_path(level));
        const DatasetHandle sums = open(StoreLayout::cube_range_sums_path(level));
        const Int3 cells = layout.lattice().cells_at(level);
        const std::uint64_t sum_bytes = static_cast<std::uint64_t>(cells.z) * sizeof(std::uint64_t);
        std::optional<std::uint64_t> offset;
        HeldBytes held;
        if (ranges.valid() && sums.valid()) {
            const auto sums_at = offset_of(sums.get(), sum_bytes, bytes.size());
            const auto sum = read_integers(sums.get(), "xxh64", 1);
            if (sums_at) {
                held = bytes.read(*sums_at, sum_bytes);
            }
            if (sum && checksum_of(held.bytes()) == (*sum)[0]) {
                offset = offset_of(ranges.get(),
                                   static_cast<std::uint64_t>(cells.product()) *
                                       cube_range_bytes(layout.header().type),
                                   bytes.size());
            }
        }
        add(layout, level, offset, std::move(held));
    }
}

namespace {

class Hdf5Attributes : public RootGroup {
  public:
    explicit Hdf5Attributes(hid_t root) : root_(root) {}
    [[nodiscard]] std::optional<std::string> text(const char* name) const override {
        return read_text(root_, name);
    }
    [[nodiscard]] std::optional<std::vector<std::uint64_t>> integers(
        const char* name, std::size_t count) const override {
        return read_integers(root_, name, count);
    }
    [[nodiscard]] std::optional<std::vector<double>> numbers(const char* name,
                                                             std::size_t count) const override {
        return read_numbers(root_, name, count);
    }
    [[nodiscard]] std::optional<std::uint64_t> digest() const override {
        return header_digest(root_);
    }
    [[nodiscard]] bool has_label_names() const override {
        return H5Lexists(root_, LabelTable::kPath, H5P_DEFAULT) > 0;
    }

  private:
    hid_t root_;
};

}  // namespace

RootAttributes read_root_attributes(std::int64_t root, const std::string& file) {
    return read_root_attributes(Hdf5Attributes(root), file);
}

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

// Opening a store that has no footer.

namespace {

/// Stores have no user block: the signature is their first 8 bytes (HDF5 File Format
/// Specification, III.A).
bool has_signature(const StoreBytes& bytes) {
    constexpr std::array<unsigned char, 8> kSignature{0x89, 'H', 'D', 'F', '\r', '\n', 0x1a, '\n'};
    if (bytes.size() < kSignature.size()) {
        return false;
    }
    const HeldBytes first = bytes.read(0, kSignature.size());
    return std::memcmp(first.bytes().data(), kSignature.data(), kSignature.size()) == 0;
}

}  // namespace

/// For stores before version 2.9, and stores that another HDF5 program has changed, which removes
/// the footer.
void StoreReader::open_by_hdf5() {
    if (is_remote()) {
        close_nothing_at_exit();
    }
    const QuietHdf5 quiet;
    const FileHandle file = open_hdf5_of(*bytes_);
    if (!file.valid()) {
        const std::string why = hdf5_cannot_open();
        throw Error(has_signature(*bytes_) ? ErrorKind::corrupt : ErrorKind::invalid_argument,
                    {path_.string()}, "not a store: " + why, {{RemedyKind::make_store}});
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

/// A newer minor version may have more rows, after those of the known arrays.
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
