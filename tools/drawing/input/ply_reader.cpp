// The format: G. Turk, "The PLY Polygon File Format" (1994).
#include "tools/drawing/input/ply_reader.h"

#include <fmt/format.h>

#include <bit>
#include <charconv>
#include <cmath>
#include <cstring>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <isonest/error.h>

namespace isonest::detail::cli {
namespace {

static_assert(std::endian::native == std::endian::little);

constexpr std::size_t kLongestHeader = std::size_t{1} << 16U;
constexpr std::uint64_t kTriangleListBytes = 1 + 3 * sizeof(std::uint32_t);

std::uint64_t size_of_type(std::string_view type) {
    if (type == "char" || type == "uchar" || type == "int8" || type == "uint8") {
        return 1;
    }
    if (type == "short" || type == "ushort" || type == "int16" || type == "uint16") {
        return 2;
    }
    if (type == "int" || type == "uint" || type == "float" || type == "int32" || type == "uint32" ||
        type == "float32") {
        return 4;
    }
    return type == "double" || type == "float64" ? 8 : 0;
}

std::optional<std::uint64_t> count_of(std::string_view word) {
    std::uint64_t count = 0;
    const char* const last = word.data() + word.size();
    const auto [end, error] = std::from_chars(word.data(), last, count);
    return error == std::errc() && end == last ? std::optional(count) : std::nullopt;
}

std::vector<std::string_view> words_of(std::string_view line) {
    std::vector<std::string_view> words;
    while (true) {
        const std::size_t begin = line.find_first_not_of(" \t\r");
        if (begin == std::string_view::npos) {
            return words;
        }
        const std::size_t end = std::min(line.find_first_of(" \t\r", begin), line.size());
        words.push_back(line.substr(begin, end - begin));
        line.remove_prefix(end);
    }
}

}  // namespace

struct PlyMesh::Header {
    struct Property {
        std::string name;
        std::uint64_t offset = 0;
        bool is_double = false;
    };
    std::uint64_t bytes = 0;  ///< offset of the data
    std::uint64_t vertices = 0;
    std::uint64_t triangles = 0;
    std::uint64_t vertex_stride = 0;
    std::uint64_t face_stride = 0;
    std::array<std::optional<Property>, 3> coordinates;
    std::string wanted;  ///< name of the value
    std::optional<Property> value;
    std::array<std::optional<std::uint64_t>, 3> colors;
    std::optional<std::uint64_t> list_offset;
    bool signed_indices = true;
    bool more_elements = false;

    void add_vertex_property(const std::vector<std::string_view>& words, const ErrorPlace& line);
    void add_face_property(const std::vector<std::string_view>& words, const ErrorPlace& line);
};

void PlyMesh::Header::add_vertex_property(const std::vector<std::string_view>& words,
                                          const ErrorPlace& line) {
    const std::uint64_t size = words.size() == 3 ? size_of_type(words[1]) : 0;
    if (size == 0) {
        throw Error(ErrorKind::unsupported, line,
                    "only vertex properties of fixed size can be read");
    }
    const std::size_t axis = std::string_view("xyz").find(words[2]);
    if (axis != std::string_view::npos && words[2].size() == 1) {
        const bool is_float = words[1].starts_with("float") || size == 8;
        if (!is_float) {
            throw Error(ErrorKind::unsupported, line,
                        "only float or double coordinates can be "
                        "read");
        }
        coordinates.at(axis) = Property{std::string(words[2]), vertex_stride, size == 8};
    }
    constexpr std::array<std::string_view, 3> kColors{"red", "green", "blue"};
    for (std::size_t c = 0; c < 3; ++c) {
        if (words[2] == kColors.at(c) && (words[1] == "uchar" || words[1] == "uint8")) {
            colors.at(c) = vertex_stride;
        }
    }
    if (words[2] == wanted && (words[1].starts_with("float") || size == 8)) {
        value = Property{std::string(words[2]), vertex_stride, size == 8};
    }
    vertex_stride += size;
}

void PlyMesh::Header::add_face_property(const std::vector<std::string_view>& words,
                                        const ErrorPlace& line) {
    if (words.size() == 3 && size_of_type(words[1]) > 0) {
        face_stride += size_of_type(words[1]);
        return;
    }
    const bool list = words.size() == 5 && words[1] == "list" && !list_offset &&
                      size_of_type(words[2]) == 1 && words[2].starts_with('u') &&
                      size_of_type(words[3]) == 4 &&
                      words[3].find("int") != std::string_view::npos &&
                      (words[4] == "vertex_indices" || words[4] == "vertex_index");
    if (!list) {
        throw Error(ErrorKind::unsupported, line,
                    "faces must have one list, 'list uchar int vertex_indices' or 'list uchar uint "
                    "vertex_indices', and otherwise only properties of fixed size");
    }
    list_offset = face_stride;
    signed_indices = !words[3].starts_with('u');
    face_stride += kTriangleListBytes;
}

PlyMesh::Header PlyMesh::parse(std::string_view text, const std::string& name,
                               const std::string& value) {
    const auto corrupt = [&](const std::string& what) {
        return Error(ErrorKind::corrupt, {name}, what);
    };
    Header header;
    header.wanted = value;
    enum class Element { none, vertex, face, other } element = Element::none;
    bool has_format = false;
    std::size_t begin = 0;
    for (int line_number = 1;; ++line_number) {
        const std::size_t end = text.find('\n', begin);
        if (line_number == 1 && !text.starts_with("ply\n") && !text.starts_with("ply\r\n")) {
            throw corrupt("not a PLY file");
        }
        if (end == std::string_view::npos) {
            throw corrupt("the PLY header has no end");
        }
        const std::vector<std::string_view> words = words_of(text.substr(begin, end - begin));
        const ErrorPlace line{
            name, fmt::format("header line {} '{}'", line_number, fmt::join(words, " "))};
        begin = end + 1;
        if (line_number == 1 || words.empty() || words[0] == "comment" || words[0] == "obj_info") {
            continue;
        }
        if (words[0] == "end_header") {
            break;
        }
        if (words[0] == "format") {
            has_format = true;
            if (words.size() != 3 || words[1] != "binary_little_endian") {
                throw Error(ErrorKind::unsupported, line,
                            "only binary_little_endian PLY files "
                            "can be read");
            }
        } else if (words[0] == "element") {
            const std::optional<std::uint64_t> count =
                words.size() == 3 ? count_of(words[2]) : std::nullopt;
            if (!count) {
                throw Error(ErrorKind::corrupt, line, "needs a name and a number");
            }
            if (words[1] == "vertex" && element == Element::none) {
                element = Element::vertex;
                header.vertices = *count;
            } else if (words[1] == "face" && element == Element::vertex) {
                element = Element::face;
                header.triangles = *count;
            } else if (element == Element::face || element == Element::other) {
                element = Element::other;
                header.more_elements = true;
            } else {
                throw Error(ErrorKind::unsupported, line,
                            "the elements must begin with vertex "
                            "and face");
            }
        } else if (words[0] == "property" && element != Element::none) {
            if (element == Element::vertex) {
                header.add_vertex_property(words, line);
            } else if (element == Element::face) {
                header.add_face_property(words, line);
            }
        } else {
            throw Error(ErrorKind::corrupt, line, "unexpected in a PLY header");
        }
    }
    header.bytes = begin;
    if (!has_format || element == Element::none || element == Element::vertex) {
        throw corrupt("the PLY header lacks its format, vertices or faces");
    }
    for (const auto& coordinate : header.coordinates) {
        if (!coordinate) {
            throw corrupt("the PLY header lacks vertex properties x, y and z");
        }
    }
    if (!header.list_offset) {
        throw corrupt("the PLY header lacks the faces' property vertex_indices");
    }
    return header;
}

PlyMesh::PlyMesh(const std::filesystem::path& path, const std::string& value)
    : name_(path.string()), file_(path) {
    open(value);
}

PlyMesh::PlyMesh(int file, const std::filesystem::path& path, const std::string& value)
    : name_(path.string()), file_(file, path) {
    open(value);
}

void PlyMesh::open(const std::string& value) {
    const std::uint64_t size = file_.bytes().size();
    const std::string_view text(reinterpret_cast<const char*>(file_.bytes().data()),
                                std::min<std::size_t>(size, kLongestHeader));
    const Header header = parse(text, name_, value);
    vertices_ = header.vertices;
    triangles_ = header.triangles;
    vertex_stride_ = header.vertex_stride;
    face_stride_ = header.face_stride;
    for (std::size_t axis = 0; axis < 3; ++axis) {
        coordinate_offset_.at(axis) = header.coordinates.at(axis)->offset;
        coordinate_is_double_.at(axis) = header.coordinates.at(axis)->is_double;
    }
    if (header.value) {
        value_offset_ = header.value->offset;
        value_is_double_ = header.value->is_double;
    }
    if (header.colors[0] && header.colors[1] && header.colors[2]) {
        color_offset_ = {*header.colors[0], *header.colors[1], *header.colors[2]};
    }
    list_offset_ = *header.list_offset;
    signed_indices_ = header.signed_indices;
    // Divisions avoid overflow, as the counts are untrusted.
    const std::uint64_t data = size - header.bytes;
    bool fits = vertices_ <= data / vertex_stride_;
    if (fits) {
        const std::uint64_t rest = data - vertices_ * vertex_stride_;
        fits = triangles_ <= rest / face_stride_ &&
               (header.more_elements || rest == triangles_ * face_stride_);
    }
    if (!fits) {
        throw Error(
            ErrorKind::corrupt, {name_},
            fmt::format("{} vertices of {} bytes and {} triangles of {} do not fill the {} bytes "
                        "after the header: the file is cut off, or has faces other than triangles",
                        vertices_, vertex_stride_, triangles_, face_stride_, data));
    }
    vertex_begin_ = header.bytes;
    face_begin_ = vertex_begin_ + vertices_ * vertex_stride_;
}

namespace {

double number_at(const std::byte* at, bool is_double) {
    if (is_double) {
        double number = 0;
        std::memcpy(&number, at, sizeof(number));
        return number;
    }
    float number = 0;
    std::memcpy(&number, at, sizeof(number));
    return static_cast<double>(number);
}

}  // namespace

Double3 PlyMesh::vertex(std::uint64_t i) const {
    const std::byte* const at = file_.bytes().data() + vertex_begin_ + i * vertex_stride_;
    Double3 position{};
    for (std::size_t axis = 0; axis < 3; ++axis) {
        position[axis] = number_at(at + coordinate_offset_[axis], coordinate_is_double_[axis]);
        if (!std::isfinite(position[axis])) {
            throw Error(ErrorKind::corrupt, {name_, fmt::format("vertex {}", i)},
                        "has a coordinate that is not finite");
        }
    }
    return position;
}

double PlyMesh::value(std::uint64_t i) const {
    if (!value_offset_) {
        return 0;
    }
    return number_at(file_.bytes().data() + vertex_begin_ + i * vertex_stride_ + *value_offset_,
                     value_is_double_);
}

std::array<std::uint8_t, 3> PlyMesh::color(std::uint64_t i) const {
    const std::byte* const at = file_.bytes().data() + vertex_begin_ + i * vertex_stride_;
    std::array<std::uint8_t, 3> rgb{};
    for (std::size_t c = 0; c < 3; ++c) {
        rgb.at(c) = std::to_integer<std::uint8_t>(at[color_offset_->at(c)]);
    }
    return rgb;
}

std::array<std::uint32_t, 3> PlyMesh::triangle(std::uint64_t i) const {
    const std::byte* const at =
        file_.bytes().data() + face_begin_ + i * face_stride_ + list_offset_;
    if (*at != std::byte{3}) {
        throw Error(
            ErrorKind::unsupported, {name_, fmt::format("face {}", i)},
            fmt::format("has {} corners; only triangles can be read", std::to_integer<int>(*at)));
    }
    std::array<std::uint32_t, 3> corners{};
    std::memcpy(corners.data(), at + 1, sizeof(corners));
    for (const std::uint32_t v : corners) {
        // A negative int is >= 2^31 here; that many vertices are only possible with uint.
        if (v >= vertices_ || (signed_indices_ && v > 0x7FFFFFFFU)) {
            throw Error(ErrorKind::corrupt, {name_, fmt::format("face {}", i)},
                        fmt::format("refers to vertex {}, but there are {}",
                                    signed_indices_
                                        ? static_cast<std::int64_t>(static_cast<std::int32_t>(v))
                                        : static_cast<std::int64_t>(v),
                                    vertices_));
        }
    }
    return corners;
}

}  // namespace isonest::detail::cli
