// Meshes whose arrays lie in a file as they are: binary glTF, VTK XML (raw appended), VTKHDF.
#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <nlohmann/json.hpp>
#include <string_view>

#include <isonest/error.h>

#include "store/exports/polydata_file.h"
#include "tools/drawing/input/mesh_input.h"

namespace isonest::detail::cli {
namespace {

enum class Number { f32, f64, u16, u32, i32, i64 };

/// Numbers that follow each other in a file.
struct Numbers {
    std::uint64_t offset = 0;
    std::uint64_t count = 0;
    Number type = Number::f32;
};

std::uint64_t size_of(Number type) {
    return type == Number::u16 ? 2 : type == Number::f64 || type == Number::i64 ? 8 : 4;
}

double real(const MeshBytes& bytes, const Numbers& numbers, std::uint64_t i) {
    const std::uint64_t at = numbers.offset + i * size_of(numbers.type);
    return numbers.type == Number::f64 ? bytes.number<double>(at)
                                       : static_cast<double>(bytes.number<float>(at));
}

std::uint64_t whole(const MeshBytes& bytes, const Numbers& numbers, std::uint64_t i) {
    const std::uint64_t at = numbers.offset + i * size_of(numbers.type);
    switch (numbers.type) {
        case Number::u16:
            return bytes.number<std::uint16_t>(at);
        case Number::i64:
            return bytes.number<std::uint64_t>(at);
        default:
            return bytes.number<std::uint32_t>(at);
    }
}

void read_arrays(const MeshBytes& bytes, const Numbers& points, const std::optional<Numbers>& value,
                 const Numbers& corners, const std::optional<Numbers>& ends, PlyScratch& to,
                 Progress& progress) {
    // Nothing is believed before it is in the file.
    for (const Numbers* const n :
         {&points, value ? &*value : &points, &corners, ends ? &*ends : &corners}) {
        if (n->count > bytes.size() / size_of(n->type)) {
            bytes.fail(fmt::format("an array of {} numbers does not fit into the file", n->count));
        }
        static_cast<void>(bytes.at(n->offset, n->count * size_of(n->type)));
    }
    for (std::uint64_t i = 0; i < points.count / 3; ++i) {
        if (i % 65536 == 0) {
            progress.check();
        }
        to.vertex({real(bytes, points, 3 * i), real(bytes, points, 3 * i + 1),
                   real(bytes, points, 3 * i + 2)},
                  value && i < value->count ? real(bytes, *value, i) : NAN);
    }
    if (ends && ends->count != corners.count / 3) {
        bytes.fail("its polygons are not all triangles");
    }
    for (std::uint64_t i = 0; i < corners.count / 3; ++i) {
        if (ends && whole(bytes, *ends, i) != 3 * (i + 1)) {
            bytes.fail(fmt::format("polygon {} is no triangle", i));
        }
        to.triangle({whole(bytes, corners, 3 * i), whole(bytes, corners, 3 * i + 1),
                     whole(bytes, corners, 3 * i + 2)});
    }
}

/// An accessor of glTF whose numbers have no gaps.
Numbers accessor(const nlohmann::json& scene, std::size_t index, std::uint64_t binary,
                 const MeshBytes& bytes) {
    const nlohmann::json& a = scene.at("accessors").at(index);
    const nlohmann::json& view = scene.at("bufferViews").at(a.at("bufferView").get<std::size_t>());
    if (view.contains("byteStride") || a.contains("sparse")) {
        bytes.fail("arrays with gaps, or sparse ones, are not read");
    }
    const std::string type = a.at("type").get<std::string>();
    Numbers numbers;
    numbers.offset = binary + view.value("byteOffset", std::uint64_t{0}) +
                     a.value("byteOffset", std::uint64_t{0});
    numbers.count = a.at("count").get<std::uint64_t>() * (type == "VEC3" ? 3 : 1);
    switch (a.at("componentType").get<int>()) {
        case 5126:
            numbers.type = Number::f32;
            break;
        case 5125:
            numbers.type = Number::u32;
            break;
        case 5123:
            numbers.type = Number::u16;
            break;
        default:
            bytes.fail("numbers of 8 bits are not read");
    }
    return numbers;
}

/// An attribute's text in a tag of XML; empty if there is none.
std::string_view text_of(std::string_view tag, const std::string& name) {
    const std::size_t at = tag.find(" " + name + "=\"");
    if (at == std::string_view::npos) {
        return {};
    }
    const std::size_t begin = at + name.size() + 3;
    return tag.substr(begin, tag.find('"', begin) - begin);
}

std::uint64_t whole_of(std::string_view text) {
    std::uint64_t value = 0;
    std::from_chars(text.data(), text.data() + text.size(), value);
    return value;
}

}  // namespace

/// The first primitive of the first mesh.
void read_glb(const std::filesystem::path& path, PlyScratch& to, Progress& progress) {
    const MeshBytes bytes(path);
    constexpr std::uint32_t kMagic = 0x46546C67;
    if (bytes.number<std::uint32_t>(0) != kMagic || bytes.number<std::uint32_t>(4) != 2) {
        bytes.fail("no binary glTF of version 2");
    }
    const std::uint64_t length = bytes.number<std::uint32_t>(12);
    const char* const text = reinterpret_cast<const char*>(bytes.at(20, length));
    try {
        // Scenes of thousands of objects have some ten thousand values.
        constexpr int kMostDepth = 64;
        constexpr int kMostValues = 1000000;
        int values = 0;
        const auto within_limits = [&](int depth, nlohmann::json::parse_event_t /*event*/,
                                       nlohmann::json& /*parsed*/) {
            if (depth > kMostDepth || ++values > kMostValues) {
                bytes.fail(fmt::format("its description has more than {} values or {} levels",
                                       kMostValues, kMostDepth));
            }
            return true;
        };
        const nlohmann::json scene = nlohmann::json::parse(text, text + length, within_limits);
        if (!scene.contains("meshes")) {
            return;
        }
        const nlohmann::json& primitive = scene.at("meshes").at(0).at("primitives").at(0);
        const std::uint64_t binary = 20 + length + 8;
        const nlohmann::json& attributes = primitive.at("attributes");
        std::optional<Numbers> value;
        if (attributes.contains("_VALUE")) {
            value = accessor(scene, attributes.at("_VALUE").get<std::size_t>(), binary, bytes);
        }
        read_arrays(
            bytes, accessor(scene, attributes.at("POSITION").get<std::size_t>(), binary, bytes),
            value, accessor(scene, primitive.at("indices").get<std::size_t>(), binary, bytes),
            std::nullopt, to, progress);
    } catch (const nlohmann::json::exception& e) {
        bytes.fail(fmt::format("its description cannot be read: {}", e.what()));
    }
}

/// PolyData with raw appended arrays of 64-bit headers that are not packed, as isonest writes it.
void read_vtp(const std::filesystem::path& path, PlyScratch& to, Progress& progress) {
    const MeshBytes bytes(path);
    constexpr std::uint64_t kLongestHead = std::uint64_t{1} << 20U;
    const std::uint64_t head = std::min(bytes.size(), kLongestHead);
    const std::string_view text(reinterpret_cast<const char*>(bytes.at(0, head)), head);
    const std::size_t appended = text.find("<AppendedData encoding=\"raw\"");
    const std::size_t data =
        appended == std::string_view::npos ? appended : text.find('_', appended);
    if (data == std::string_view::npos || text.find("header_type=\"UInt64\"") > appended ||
        text.find("compressor=") < appended || text.find("LittleEndian") > appended) {
        throw Error(ErrorKind::unsupported, {path.string()},
                    "of .vtp files those with raw appended data are read: 64-bit headers, little "
                    "endian, not compressed");
    }
    std::optional<Numbers> points;
    std::optional<Numbers> value;
    std::optional<Numbers> corners;
    std::optional<Numbers> ends;
    std::string_view section;
    for (std::size_t at = text.find('<'); at < appended; at = text.find('<', at + 1)) {
        const std::string_view tag = text.substr(at, text.find('>', at) - at);
        for (const std::string_view name : {"<PointData", "<Points", "<Polys", "<CellData"}) {
            section = tag.starts_with(name) ? name : section;
        }
        if (!tag.starts_with("<DataArray")) {
            continue;
        }
        const std::uint64_t offset = data + 1 + whole_of(text_of(tag, "offset"));
        const std::string_view type = text_of(tag, "type");
        Numbers numbers;
        numbers.type = type == "Float64" ? Number::f64
                       : type == "Int64" ? Number::i64
                       : type == "Int32" ? Number::i32
                                         : Number::f32;
        numbers.offset = offset + 8;
        numbers.count = bytes.number<std::uint64_t>(offset) / size_of(numbers.type);
        const std::string_view name = text_of(tag, "Name");
        if (section == "<Points") {
            points = numbers;
        } else if (section == "<PointData" && name == "value") {
            value = numbers;
        } else if (section == "<Polys" && name == "connectivity") {
            corners = numbers;
        } else if (section == "<Polys" && name == "offsets") {
            ends = numbers;
        }
    }
    if (!points || !corners || !ends) {
        bytes.fail("there are no points, or no polygons");
    }
    read_arrays(bytes, *points, value, *corners, ends, to, progress);
}

void read_vtkhdf(const std::filesystem::path& path, PlyScratch& to, Progress& progress) {
    const PolyDataArrays arrays = find_polydata(path);
    const auto numbers = [](const PolyDataArrays::Array& a) {
        return Numbers{a.offset, a.count,
                       a.integers ? Number::i64
                       : a.wide   ? Number::f64
                                  : Number::f32};
    };
    const MeshBytes bytes(path);
    read_arrays(bytes, numbers(arrays.points),
                arrays.value ? std::optional(numbers(*arrays.value)) : std::nullopt,
                numbers(arrays.connectivity), numbers(arrays.ends), to, progress);
}

}  // namespace isonest::detail::cli
