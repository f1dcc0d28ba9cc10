#include "store/container/parts/header_writer.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <string>
#include <utility>
#include <vector>

#include <isonest/error.h>
#include <isonest/field.h>
#include <isonest/value_type.h>

#include "store/base/label_text.h"
#include "store/container/codec.h"
#include "store/container/parts/cube_range_table.h"
#include "store/container/parts/hdf5_types.h"
#include "store/container/parts/header_reader.h"

namespace isonest::detail {

std::vector<double> vtk_direction(const Directions& direction) {
    std::vector<double> rows;
    for (std::size_t w = 0; w < 3; ++w) {
        for (const Double3& axis : direction) {
            rows.push_back(axis[w]);
        }
    }
    return rows;
}

void write_version_and_flags(hid_t root, const StoreHeader& header) {
    const FormatVersion version = header.version();
    write_attribute(root, "version",
                    std::vector<std::uint32_t>{static_cast<std::uint32_t>(version.major),
                                               static_cast<std::uint32_t>(version.minor)});
    write_attribute(root, "flags",
                    (header.direction != kAlongWorld ? kHasDirection : std::uint32_t{0}) |
                        (header.labels ? kHasLabels : std::uint32_t{0}) |
                        (header.is_sheared() ? kIsSheared : std::uint32_t{0}) |
                        (header.uneven ? kIsUneven : std::uint32_t{0}) |
                        (header.curved ? kIsCurved : std::uint32_t{0}) |
                        (header.skips_shuffle ? kSkipsShuffle : std::uint32_t{0}) |
                        (header.rounding.none() ? std::uint32_t{0} : kIsRounded));
}

void write_header(hid_t root, const StoreHeader& header) {
    write_attribute(root, "format", std::string(kFormatName));
    write_version_and_flags(root, header);
    write_attribute(root, "nodes",
                    std::vector<std::uint64_t>{static_cast<std::uint64_t>(header.nodes.x),
                                               static_cast<std::uint64_t>(header.nodes.y),
                                               static_cast<std::uint64_t>(header.nodes.z)});
    write_attribute(root, "spacing",
                    std::vector<double>(header.spacing.begin(), header.spacing.end()));
    write_attribute(root, "origin",
                    std::vector<double>(header.origin.begin(), header.origin.end()));
    write_attribute(root, "value_type", std::string(name_of(header.type)));
    write_attribute(root, "chunk", static_cast<std::uint32_t>(header.chunk));
    write_attribute(root, "compression", static_cast<std::uint32_t>(header.compression));
    write_attribute(root, "exact", static_cast<std::uint32_t>(header.exact ? 1 : 0));
    std::string fields;
    for (const Field field : header.fields) {
        fields += (fields.empty() ? "" : ",") + std::string(stored_name_of(field));
    }
    write_attribute(root, "fields", fields);
    if (header.direction != kAlongWorld) {
        write_attribute(root, "direction", flat_directions(header.direction));
        write_attribute(root, "direction_xxh64", direction_digest(header.direction));
    }
    for (std::size_t a = 0; header.uneven && a < 3; ++a) {
        if (const std::vector<double>& offsets = header.uneven->offsets.at(a); !offsets.empty()) {
            write_attribute(root, kOffsets.at(a), offsets);
        }
    }
    if (header.uneven) {
        write_attribute(root, "offsets_xxh64", offsets_digest(*header.uneven));
    }
    if (header.unit) {
        const std::string symbol(symbol_of(*header.unit));
        write_attribute(root, "unit", symbol);
        write_attribute(root, "unit_xxh64", text_digest(symbol));
    }
    if (header.frame != AnatomicalFrame::unknown) {
        const std::string name(name_of(header.frame));
        write_attribute(root, "frame", name);
        write_attribute(root, "frame_xxh64", text_digest(name));
    }
    if (!header.rounding.none()) {
        write_attribute(root, "tolerance", rounding_numbers(header.rounding));
        write_attribute(root, "tolerance_xxh64", numbers_digest(rounding_numbers(header.rounding)));
    }
}

void write_curved(hid_t root, const CurvedNodes& nodes) {
    write_attribute(root, "position_type", std::string(name_of(nodes.type)));
    write_attribute(root, "position_numbers", position_numbers(nodes));
    write_attribute(root, "position_folds", position_folds(nodes));
    write_attribute(root, "position_xxh64", positions_digest(nodes));
}

void write_vtk_attributes(hid_t group, const StoreHeader& header) {
    write_attribute(group, "Version", std::vector<std::int64_t>{1, 0});
    write_attribute(group, "Type", std::string("ImageData"));
    write_attribute(group, "WholeExtent",
                    std::vector<std::int64_t>{0, header.nodes.x - 1, 0, header.nodes.y - 1, 0,
                                              header.nodes.z - 1});
    write_attribute(group, "Origin",
                    std::vector<double>(header.origin.begin(), header.origin.end()));
    write_attribute(group, "Spacing",
                    std::vector<double>(header.spacing.begin(), header.spacing.end()));
    write_attribute(group, "Direction", vtk_direction(header.direction));
}

/// Writes a few rows at a time, so that they are not in memory twice.
void write_names_of_labels(const WrittenFile& file, std::span<const LabelName> names) {
    if (const std::string why = why_no_label_names(names); !why.empty() || names.empty()) {
        throw Error(ErrorKind::invalid_argument, {file.path().string()},
                    names.empty() ? "no names of labels" : why);
    }
    const std::size_t name_bytes = name_bytes_of(names);
    const TypeHandle type = label_row_type(name_bytes);
    const std::array<hsize_t, 1> all{names.size()};
    DatasetHandle table = file.create_whole(LabelTable::kPath, type.get(), all);
    Checksum sum;
    constexpr std::size_t kAtOnce = 1024;
    for (std::size_t i = 0; i < names.size(); i += kAtOnce) {
        const std::vector<std::byte> rows =
            label_rows(names.subspan(i, std::min(kAtOnce, names.size() - i)), name_bytes);
        sum.add(rows);
        const std::array<hsize_t, 1> at{i};
        const std::array<hsize_t, 1> count{std::min(kAtOnce, names.size() - i)};
        file.write_part(table, LabelTable::kPath, type.get(), at, count, rows.data());
    }
    write_attribute(table.get(), "xxh64", sum.value());
    file.close(std::move(table), LabelTable::kPath);
}

namespace {

/// Number of ranges that are packed and written together.
constexpr std::int64_t kRangesAtOnce = 65536;

/// Converts the ranges to their stored form.
void pack(std::span<const CubeRange> ranges, ValueType type, std::vector<std::byte>& out) {
    dispatch(type, [&](auto tag) {
        using T = typename decltype(tag)::type;
        out.resize(ranges.size() * 2 * sizeof(T));
        std::byte* to = out.data();
        for (const CubeRange& range : ranges) {
            const std::array<T, 2> both{static_cast<T>(range.low), static_cast<T>(range.high)};
            std::memcpy(to, both.data(), sizeof(both));
            to += sizeof(both);
        }
    });
}

}  // namespace

void write_ranges_of_cubes(const WrittenFile& file, const StoreLayout& layout, int level,
                           std::span<const CubeRange> ranges) {
    const ValueType type = cube_range_type(layout.header().type);
    const Int3 cells = layout.lattice().cells_at(level);
    const std::string name = StoreLayout::cube_ranges_path(level);
    const TypeHandle stored = file_type(type);
    const auto dims = dims_of(cells, 2);
    DatasetHandle dataset = file.create_whole(name, stored.get(), dims);
    const std::int64_t most = std::max<std::int64_t>(1, kRangesAtOnce / cells.x);  // rows
    std::vector<std::byte> packed;
    std::vector<std::uint64_t> sums;
    sums.reserve(static_cast<std::size_t>(cells.z));
    for (std::int64_t z = 0; z < cells.z; ++z) {
        Checksum sum;
        for (std::int64_t y = 0; y < cells.y; y += most) {
            const Int3 rows{cells.x, std::min(most, cells.y - y), 1};
            pack(ranges.subspan(static_cast<std::size_t>(cells.linear({0, y, z})),
                                static_cast<std::size_t>(rows.product())),
                 type, packed);
            sum.add(packed);
            const auto at = dims_of({0, y, z}, 0);
            const auto count = dims_of(rows, 2);
            file.write_part(dataset, name, stored.get(), at, count, packed.data());
        }
        sums.push_back(sum.value());
    }
    file.close(std::move(dataset), name);
    const std::array<hsize_t, 1> count{sums.size()};
    const std::string sums_name = StoreLayout::cube_range_sums_path(level);
    DatasetHandle checksums = file.write_whole(sums_name, H5T_STD_U64LE, count, sums.data());
    write_attribute(checksums.get(), "xxh64", checksum_of(std::as_bytes(std::span(sums))));
    file.close(std::move(checksums), sums_name);
}

namespace {

PropertyHandle without_times(hid_t kind) {
    PropertyHandle creation(H5Pcreate(kind));
    H5Pset_obj_track_times(creation.get(), false);
    return creation;
}

}  // namespace

void fail_writing(const std::filesystem::path& path, const std::string& what) {
    const std::string detail = hdf5_message();
    throw Error(ErrorKind::io, {path.string()},
                fmt::format("cannot {}{}{}", what, detail.empty() ? "" : ": ", detail));
}

GroupHandle WrittenFile::create_group(const std::string& name) const {
    GroupHandle group(H5Gcreate2(file_, name.c_str(), H5P_DEFAULT,
                                 without_times(H5P_GROUP_CREATE).get(), H5P_DEFAULT));
    if (!group.valid()) {
        fail_writing(*path_, "create a group");
    }
    return group;
}

DatasetHandle WrittenFile::create_whole(const std::string& name, const hid_t type,
                                        std::span<const hsize_t> dims) const {
    const SpaceHandle space(H5Screate_simple(static_cast<int>(dims.size()), dims.data(), nullptr));
    DatasetHandle dataset(H5Dcreate2(file_, name.c_str(), type, space.get(), H5P_DEFAULT,
                                     without_times(H5P_DATASET_CREATE).get(), H5P_DEFAULT));
    if (!dataset.valid()) {
        fail_writing(*path_, "create " + name);
    }
    return dataset;
}

DatasetHandle WrittenFile::write_whole(const std::string& name, const hid_t type,
                                       std::span<const hsize_t> dims, const void* numbers) const {
    DatasetHandle dataset = create_whole(name, type, dims);
    if (H5Dwrite(dataset.get(), type, H5S_ALL, H5S_ALL, H5P_DEFAULT, numbers) < 0) {
        fail_writing(*path_, "write " + name);
    }
    return dataset;
}

void WrittenFile::write_part(const DatasetHandle& dataset, const std::string& name,
                             const hid_t type, std::span<const hsize_t> at,
                             std::span<const hsize_t> count, const void* numbers) const {
    const SpaceHandle space(H5Dget_space(dataset.get()));
    const SpaceHandle memory(
        H5Screate_simple(static_cast<int>(count.size()), count.data(), nullptr));
    if (H5Sselect_hyperslab(space.get(), H5S_SELECT_SET, at.data(), nullptr, count.data(),
                            nullptr) < 0 ||
        H5Dwrite(dataset.get(), type, memory.get(), space.get(), H5P_DEFAULT, numbers) < 0) {
        fail_writing(*path_, "write " + name);
    }
}

void WrittenFile::close(DatasetHandle dataset, const std::string& name) const {
    if (!dataset.close()) {
        fail_writing(*path_, "write " + name);
    }
}

}  // namespace isonest::detail
