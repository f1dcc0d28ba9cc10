// Meshes whose arrays are stored directly or in base64: binary glTF, VTK XML, VTKHDF.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <bit>
#include <charconv>
#include <cmath>
#include <nlohmann/json.hpp>
#include <string_view>
#include <vector>

#include <isonest/error.h>

#include "store/exports/polydata_file.h"
#include "tools/drawing/input/mesh_input.h"

namespace isonest::detail::cli {
namespace {

enum class Number { f32, f64, u16, u32, i32, i64 };

/// Consecutive numbers in a file.
struct Numbers {
    std::uint64_t offset = 0;
    std::uint64_t count = 0;
    Number type = Number::f32;
    bool base64 = false;  ///< `offset` is that of the letters, which begin with a length of 8 bytes
};
constexpr std::uint64_t kVtkLength = 8;

std::uint64_t size_of(Number type) {
    return type == Number::u16 ? 2 : type == Number::f64 || type == Number::i64 ? 8 : 4;
}

/// Base64 letters for this many bytes.
std::uint64_t letters_of(std::uint64_t bytes) {
    return bytes / 3 * 4 + (bytes % 3 > 0 ? 4 : 0);
}

/// The six bits of a base64 letter.
unsigned bits_of(const MeshBytes& bytes, std::uint64_t place) {
    const char c = bytes.number<char>(place);
    if (c >= 'A' && c <= 'Z') {
        return static_cast<unsigned>(c - 'A');
    }
    if (c >= 'a' && c <= 'z') {
        return static_cast<unsigned>(c - 'a' + 26);
    }
    if (c >= '0' && c <= '9') {
        return static_cast<unsigned>(c - '0' + 52);
    }
    if (c != '+' && c != '/') {
        bytes.fail(fmt::format("byte {} is not base64", place));
    }
    return c == '+' ? 62 : 63;
}

/// The number at byte `at` of the data decoded from the letters at `place`.
template <class T>
T base64_number(const MeshBytes& bytes, std::uint64_t place, std::uint64_t at) {
    std::array<std::byte, sizeof(T)> out{};
    for (std::byte& byte : out) {
        const std::uint64_t bit = 8 * at++;  // offset in bits
        const unsigned pair =
            bits_of(bytes, place + bit / 6) << 6U | bits_of(bytes, place + bit / 6 + 1);
        byte = static_cast<std::byte>(pair >> (4 - bit % 6) & 0xFFU);
    }
    return std::bit_cast<T>(out);
}

template <class T>
T number(const MeshBytes& bytes, const Numbers& numbers, std::uint64_t i) {
    return numbers.base64 ? base64_number<T>(bytes, numbers.offset, kVtkLength + i * sizeof(T))
                          : bytes.number<T>(numbers.offset + i * sizeof(T));
}

double real(const MeshBytes& bytes, const Numbers& numbers, std::uint64_t i) {
    return numbers.type == Number::f64 ? number<double>(bytes, numbers, i)
                                       : static_cast<double>(number<float>(bytes, numbers, i));
}

std::uint64_t whole(const MeshBytes& bytes, const Numbers& numbers, std::uint64_t i) {
    switch (numbers.type) {
        case Number::u16:
            return number<std::uint16_t>(bytes, numbers, i);
        case Number::i64:
            return number<std::uint64_t>(bytes, numbers, i);
        default:
            return number<std::uint32_t>(bytes, numbers, i);
    }
}

void read_arrays(const MeshBytes& bytes, const Numbers& points, const std::optional<Numbers>& value,
                 const Numbers& corners, const std::optional<Numbers>& ends, PlyScratch& to,
                 Progress& progress) {
    // Check that everything is in the file before using it.
    for (const Numbers* const n :
         {&points, value ? &*value : &points, &corners, ends ? &*ends : &corners}) {
        if (n->count > bytes.size() / size_of(n->type)) {
            bytes.fail(fmt::format("an array of {} numbers does not fit into the file", n->count));
        }
        const std::uint64_t size = n->count * size_of(n->type);
        static_cast<void>(bytes.at(n->offset, n->base64 ? letters_of(kVtkLength + size) : size));
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
            bytes.fail(fmt::format("polygon {} is not a triangle", i));
        }
        to.triangle({whole(bytes, corners, 3 * i), whole(bytes, corners, 3 * i + 1),
                     whole(bytes, corners, 3 * i + 2)});
    }
}

/// A glTF accessor for numbers without gaps.
Numbers accessor(const nlohmann::json& scene, std::size_t index, std::uint64_t binary,
                 const MeshBytes& bytes) {
    const nlohmann::json& a = scene.at("accessors").at(index);
    const nlohmann::json& view = scene.at("bufferViews").at(a.at("bufferView").get<std::size_t>());
    if (view.contains("byteStride") || a.contains("sparse")) {
        bytes.fail("interleaved and sparse arrays are not supported");
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
            bytes.fail("8-bit numbers are not supported");
    }
    return numbers;
}

/// The value of an attribute in an XML tag; empty if there is none.
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

/// Reads the first primitive of the first mesh.
void read_glb(const std::filesystem::path& path, PlyScratch& to, Progress& progress) {
    const MeshBytes bytes(path);
    constexpr std::uint32_t kMagic = 0x46546C67;
    if (bytes.number<std::uint32_t>(0) != kMagic || bytes.number<std::uint32_t>(4) != 2) {
        bytes.fail("not a binary glTF file of version 2");
    }
    const std::uint64_t length = bytes.number<std::uint32_t>(12);
    const char* const text = reinterpret_cast<const char*>(bytes.at(20, length));
    try {
        // Scenes with thousands of objects have some ten thousand values.
        constexpr int kMaxDepth = 64;
        constexpr int kMaxValues = 1000000;
        int values = 0;
        const auto within_limits = [&](int depth, nlohmann::json::parse_event_t /*event*/,
                                       nlohmann::json& /*parsed*/) {
            if (depth > kMaxDepth || ++values > kMaxValues) {
                bytes.fail(fmt::format("its JSON has more than {} values or {} levels", kMaxValues,
                                       kMaxDepth));
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
        bytes.fail(fmt::format("its JSON cannot be parsed: {}", e.what()));
    }
}

/// PolyData whose arrays have 64-bit headers and are uncompressed, as isonest writes them: in
/// base64 in the XML or, until version 0.4, raw and appended.
void read_vtp(const std::filesystem::path& path, PlyScratch& to, Progress& progress) {
    const MeshBytes bytes(path);
    const std::string_view text(reinterpret_cast<const char*>(bytes.at(0, bytes.size())),
                                bytes.size());
    const auto refuse = [&] {
        throw Error(ErrorKind::unsupported, {path.string()},
                    "unsupported .vtp file: its arrays must be binary or raw appended, "
                    "uncompressed, little-endian, with 64-bit headers");
    };
    std::optional<Numbers> points;
    std::optional<Numbers> value;
    std::optional<Numbers> corners;
    std::optional<Numbers> ends;
    std::vector<Numbers*> appended;
    std::string_view section;
    bool is_ours = false;
    for (std::size_t at = text.find('<'); at != std::string_view::npos; at = text.find('<', at)) {
        const std::size_t end = text.find('>', at);
        const std::string_view tag = text.substr(at, end - at);
        at = std::min(end, text.size());
        if (tag.starts_with("<VTKFile")) {
            is_ours = text_of(tag, "header_type") == "UInt64" &&
                      text_of(tag, "byte_order") == "LittleEndian" &&
                      text_of(tag, "compressor").empty();
        }
        for (const std::string_view name : {"<PointData", "<Points", "<Polys", "<CellData"}) {
            section = tag.starts_with(name) ? name : section;
        }
        if (tag.starts_with("<AppendedData")) {
            const std::size_t data = text.find('_', at);
            if (text_of(tag, "encoding") != "raw" || data == std::string_view::npos) {
                refuse();
            }
            for (Numbers* const numbers : appended) {
                const std::uint64_t head = data + 1 + numbers->offset;
                numbers->count = bytes.number<std::uint64_t>(head) / size_of(numbers->type);
                numbers->offset = head + kVtkLength;
            }
            appended.clear();
            break;
        }
        if (!tag.starts_with("<DataArray")) {
            continue;
        }
        const std::string_view name = text_of(tag, "Name");
        std::optional<Numbers>* const wanted = section == "<Points" ? &points
                                               : section == "<PointData" && name == "value" ? &value
                                               : section == "<Polys" && name == "connectivity"
                                                   ? &corners
                                               : section == "<Polys" && name == "offsets" ? &ends
                                                                                          : nullptr;
        const std::string_view type = text_of(tag, "type");
        Numbers numbers;
        numbers.type = type == "Float64" ? Number::f64
                       : type == "Int64" ? Number::i64
                       : type == "Int32" ? Number::i32
                                         : Number::f32;
        const std::string_view format = text_of(tag, "format");
        if (format == "appended") {
            numbers.offset = whole_of(text_of(tag, "offset"));
        } else if (format == "binary" && is_ours) {
            const std::size_t begin = text.find_first_not_of("> \t\r\n", at);
            numbers.base64 = true;
            numbers.offset = std::min(begin, text.size());
            const std::uint64_t length = base64_number<std::uint64_t>(bytes, numbers.offset, 0);
            numbers.count = length / size_of(numbers.type);
            // Skips to the tags after the array.
            at = numbers.offset +
                 std::min(letters_of(kVtkLength + length), bytes.size() - numbers.offset);
        } else if (wanted != nullptr) {
            refuse();
        }
        if (wanted != nullptr) {
            *wanted = numbers;
            if (format == "appended") {
                appended.push_back(&**wanted);
            }
        }
    }
    if (!is_ours || !appended.empty()) {
        refuse();
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
