#include "store/exports/polydata_file.h"

#include <algorithm>
#include <cstring>
#include <string>
#include <vector>

#include <isonest/error.h>

#include "store/container/parts/hdf5_types.h"
#include "store/hdf5/handles.h"

namespace isonest::detail {

// Source of the alphabet: RFC 4648, section 4.

namespace {

constexpr std::string_view kLetters =
    "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";

/// Two letters for each 12 bits.
constexpr auto kPairs = [] {
    std::array<std::array<char, 2>, 4096> pairs{};
    for (std::size_t i = 0; i < pairs.size(); ++i) {
        pairs[i] = {kLetters[i / 64], kLetters[i % 64]};
    }
    return pairs;
}();

void put_letters(std::uint8_t a, std::uint8_t b, std::uint8_t c, char* out) {
    std::memcpy(out, kPairs[a * 16U + b / 16U].data(), 2);
    std::memcpy(out + 2, kPairs[(b % 16U) * 256U + c].data(), 2);
}

}  // namespace

void Base64Rows::put(const Base64Array& array, std::uint64_t at, std::span<const std::byte> bytes,
                     const Write& write) {
    const auto* const data = reinterpret_cast<const std::uint8_t*>(bytes.data());
    const std::uint64_t end = at + bytes.size();
    const auto add_some = [&](std::uint64_t from, std::uint64_t to) {
        Group group;
        for (std::uint64_t i = from; i < to; ++i) {
            group.bytes.at(i % 3) = data[i - at];
            group.has = static_cast<std::uint8_t>(group.has | 1U << (i % 3));
        }
        const std::uint64_t size = std::min<std::uint64_t>(3, array.bytes - from / 3 * 3);
        group.all = static_cast<std::uint8_t>((1U << size) - 1);
        add(array.text + from / 3 * 4, group, write);
    };
    const std::uint64_t whole_begin = std::min((at + 2) / 3 * 3, end);
    if (at < whole_begin) {
        add_some(at, whole_begin);
    }
    const std::uint64_t whole_end = std::max(end / 3 * 3, whole_begin);
    constexpr std::uint64_t kAtOnce = kLetters / 4 * 3;
    std::vector<char> letters(std::min(whole_end - whole_begin, kAtOnce) / 3 * 4);
    for (std::uint64_t from = whole_begin; from < whole_end; from += kAtOnce) {
        const std::uint64_t to = std::min(from + kAtOnce, whole_end);
        char* out = letters.data();
        for (const std::uint8_t* in = data + (from - at); in != data + (to - at); in += 3) {
            put_letters(in[0], in[1], in[2], out);
            out += 4;
        }
        write(array.text + from / 3 * 4,
              std::as_bytes(std::span(letters).first((to - from) / 3 * 4)));
    }
    if (whole_end < end) {
        add_some(whole_end, end);
    }
}

void Base64Rows::add(std::uint64_t place, const Group& some, const Write& write) {
    Group group;
    {
        const std::lock_guard lock(mutex_);
        Group& waiting = waiting_[place];
        for (std::size_t i = 0; i < some.bytes.size(); ++i) {
            waiting.bytes.at(i) |= some.bytes.at(i);
        }
        waiting.has |= some.has;
        waiting.all = some.all;
        group = waiting;
        if (group.has != group.all) {
            return;
        }
        waiting_.erase(place);
    }
    std::array<char, 4> letters{};
    put_letters(group.bytes[0], group.bytes[1], group.bytes[2], letters.data());
    for (std::size_t i = 1; i < group.bytes.size(); ++i) {
        if ((group.all >> i & 1U) == 0) {
            letters.at(i + 1) = '=';
        }
    }
    write(place, std::as_bytes(std::span(letters)));
}

std::string Base64Rows::take() {
    const std::lock_guard lock(mutex_);
    std::string taken;
    for (const auto& [place, group] : waiting_) {
        taken.append(reinterpret_cast<const char*>(&place), sizeof(place));
        taken.append(reinterpret_cast<const char*>(&group), sizeof(group));
    }
    waiting_.clear();
    return taken;
}

void Base64Rows::include(std::string_view taken, const Write& write) {
    while (!taken.empty()) {
        std::uint64_t place = 0;
        Group group;
        std::memcpy(&place, taken.data(), sizeof(place));
        std::memcpy(&group, taken.data() + sizeof(place), sizeof(group));
        add(place, group, write);
        taken.remove_prefix(sizeof(place) + sizeof(group));
    }
}

bool Base64Rows::is_complete() const {
    const std::lock_guard lock(mutex_);
    return waiting_.empty();
}

namespace {

/// Returns the offset of the data.
std::uint64_t add_attribute(const Hdf5Frame& frame, hid_t where, const PolyDataShape::Attribute& a,
                            std::uint64_t rows) {
    std::vector<hsize_t> dims{rows};
    if (a.components > 1) {
        dims.push_back(static_cast<hsize_t>(a.components));
    }
    return frame.array(where, a.name.c_str(), a.wide ? H5T_IEEE_F64LE : H5T_IEEE_F32LE, dims);
}

/// Fills the group of a mesh.
PolyDataOffsets add_polydata(const Hdf5Frame& frame, hid_t root, const PolyDataShape& shape) {
    write_attribute(root, "Version", std::vector<std::int64_t>{2, 0});
    write_attribute(root, "Type", std::string("PolyData"));
    if (!shape.unit.empty()) {
        write_attribute(root, "unit", shape.unit);
    }
    if (!shape.space.empty()) {
        write_attribute(root, "SPACE", shape.space);
    }
    PolyDataOffsets offsets;
    frame.number(root, "NumberOfPoints", shape.points);
    offsets.points = frame.array(root, "Points", H5T_IEEE_F32LE, {shape.points, 3});
    for (const char* const name : {"Vertices", "Lines", "Strips", "Polygons"}) {
        const std::uint64_t cells = name == std::string("Polygons") ? shape.triangles : 0;
        const GroupHandle group = frame.group(root, name);
        frame.number(group.get(), "NumberOfCells", cells);
        frame.number(group.get(), "NumberOfConnectivityIds", 3 * cells);
        const std::uint64_t connectivity =
            frame.array(group.get(), "Connectivity", H5T_STD_I64LE, {3 * cells});
        if (cells == 0) {
            frame.number(group.get(), "Offsets", 0);
            continue;
        }
        offsets.connectivity = connectivity;
        offsets.ends =
            frame.array(group.get(), "Offsets", H5T_STD_I64LE, {cells + 1}) + sizeof(std::int64_t);
    }
    const GroupHandle of_points = frame.group(root, "PointData");
    const GroupHandle of_cells = frame.group(root, "CellData");
    for (const PolyDataShape::Attribute& a : shape.attributes) {
        offsets.attributes.push_back(add_attribute(frame, of_points.get(), a, shape.points));
        offsets.attributes_of_triangles.push_back(
            a.of_triangles ? add_attribute(frame, of_cells.get(), a, shape.triangles) : 0);
    }
    if (shape.labels_of_triangles) {
        offsets.labels_of_triangles =
            frame.array(of_cells.get(), "BoundaryLabels", H5T_STD_I64LE, {shape.triangles, 2});
    }
    return offsets;
}

}  // namespace

PolyDataOffsets create_polydata(const std::filesystem::path& path, const PolyDataShape& shape) {
    const QuietHdf5 quiet;
    Hdf5Frame frame(path);
    PolyDataOffsets offsets;
    {
        const GroupHandle root = frame.group(frame.file(), "VTKHDF");
        offsets = add_polydata(frame, root.get(), shape);
    }
    frame.close();
    return offsets;
}

std::vector<PolyDataOffsets> create_polydata_collection(const std::filesystem::path& path,
                                                        std::span<const PolyDataBlock> blocks) {
    const QuietHdf5 quiet;
    Hdf5Frame frame(path);
    std::vector<PolyDataOffsets> offsets;
    {
        const GroupHandle root = frame.group(frame.file(), "VTKHDF");
        write_attribute(root.get(), "Version", std::vector<std::int64_t>{2, 1});
        write_attribute(root.get(), "Type", std::string("PartitionedDataSetCollection"));
        const GroupHandle assembly = frame.group(root.get(), "Assembly", true);
        for (const PolyDataBlock& block : blocks) {
            const GroupHandle own = frame.group(root.get(), block.name.c_str());
            write_attribute(own.get(), "Index", std::uint64_t{offsets.size()});
            if (!block.title.empty()) {
                write_attribute(own.get(), "Name", block.title);
            }
            if (block.color) {
                constexpr double kMax = 255;
                std::vector<double> color;
                for (const std::uint8_t part : *block.color) {
                    color.push_back(part / kMax);
                }
                write_attribute(own.get(), "Color", color);
            }
            offsets.push_back(add_polydata(frame, own.get(), block.shape));
            frame.soft_link(assembly.get(), block.name.c_str(), ("/VTKHDF/" + block.name).c_str());
        }
    }
    frame.close();
    return offsets;
}

namespace {

std::optional<PolyDataArrays::Array> find_array(hid_t root, const char* name) {
    const DatasetHandle dataset(H5Dopen2(root, name, H5P_DEFAULT));
    if (!dataset.valid()) {
        return std::nullopt;
    }
    const TypeHandle type(H5Dget_type(dataset.get()));
    const SpaceHandle space(H5Dget_space(dataset.get()));
    PolyDataArrays::Array array;
    array.offset = H5Dget_offset(dataset.get());
    array.count = static_cast<std::uint64_t>(
        std::max<hssize_t>(H5Sget_simple_extent_npoints(space.get()), 0));
    array.integers = H5Tequal(type.get(), H5T_STD_I64LE) > 0;
    array.wide = array.integers || H5Tequal(type.get(), H5T_IEEE_F64LE) > 0;
    const bool is_known = array.wide || H5Tequal(type.get(), H5T_IEEE_F32LE) > 0;
    // An array without an offset is chunked or empty.
    if (!is_known || (array.offset == HADDR_UNDEF && array.count > 0)) {
        return std::nullopt;
    }
    return array;
}

}  // namespace

PolyDataArrays find_polydata(const std::filesystem::path& path) {
    const QuietHdf5 quiet;
    const FileHandle file = open_hdf5(path);
    if (!file.valid()) {
        throw Error(ErrorKind::corrupt, {path.string()}, "HDF5 cannot open it",
                    {{RemedyKind::good_copy}});
    }
    const GroupHandle root(H5Gopen2(file.get(), "VTKHDF", H5P_DEFAULT));
    const auto points = root.valid() ? find_array(root.get(), "Points") : std::nullopt;
    const auto corners =
        root.valid() ? find_array(root.get(), "Polygons/Connectivity") : std::nullopt;
    auto ends = root.valid() ? find_array(root.get(), "Polygons/Offsets") : std::nullopt;
    if (!points || !corners || !ends || !ends->integers || points->integers || !corners->integers) {
        throw Error(ErrorKind::unsupported, {path.string()},
                    "only VTKHDF files of polygons with contiguous little-endian arrays can be "
                    "read");
    }
    // The offsets begin with a 0.
    if (ends->count > 0) {
        --ends->count;
        ends->offset += sizeof(std::int64_t);
    }
    return {*points, *corners, *ends, find_array(root.get(), "PointData/value")};
}

}  // namespace isonest::detail
