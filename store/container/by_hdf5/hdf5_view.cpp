#include "store/container/by_hdf5/hdf5_view.h"

#include <fmt/format.h>

#include <algorithm>

#include <isonest/error.h>

#include "store/container/footer/make_catalogue.h"
#include "store/container/hdf5_types.h"
#include "store/container/header_writer.h"
#include "store/hdf5/bytes_driver.h"

namespace isonest::detail {

struct Hdf5View::Impl {
    FileHandle file;
    std::string opened;  ///< the dataset's name
    DatasetHandle dataset;

    std::string read(const ArrayInfo& array, const Int3& chunk, std::vector<std::byte>& out);
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

std::string Hdf5View::read(const ArrayInfo& array, const Int3& chunk,
                           std::vector<std::byte>& out) const {
    return reading(impl_->file.get(), [&] { return impl_->read(array, chunk, out); });
}

std::string Hdf5View::vtk_fault(const StoreHeader& header) const {
    return reading(impl_->file.get(), [&] { return impl_->vtk_fault(header); });
}

std::string Hdf5View::Impl::read(const ArrayInfo& array, const Int3& chunk,
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
    if (H5Dget_chunk_storage_size(data, at.data(), &size) < 0 || size > array.most_stored_bytes()) {
        return "HDF5 does not find the chunk: " + hdf5_message();
    }
    out.resize(size);
    std::uint32_t skipped_filters = 0;
    if (H5Dread_chunk(data, H5P_DEFAULT, at.data(), &skipped_filters, out.data()) < 0) {
        return "HDF5 cannot read the chunk: " + hdf5_message();
    }
    return skipped_filters == 0 ? "" : "a filter of the chunk is marked as skipped";
}

std::optional<std::vector<std::byte>> Hdf5View::catalogue(const StoreLayout& layout,
                                                          std::span<const std::byte> table) const {
    return reading(impl_->file.get(),
                   [&] { return make_catalogue(impl_->file.get(), layout, table); });
}

std::string Hdf5View::Impl::vtk_fault(const StoreHeader& header) const {
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

}  // namespace isonest::detail
