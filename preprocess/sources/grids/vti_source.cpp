#include <string_view>

#include "preprocess/sources/bytes/input_file.h"
#include "preprocess/sources/volume_format.h"

#if ISONEST_WITH_EXPAT

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <isonest/error.h>

#include "preprocess/sources/bytes/byte_reader.h"
#include "preprocess/sources/bytes/header_words.h"
#include "preprocess/sources/grids/vti_header.h"
#include "preprocess/sources/placement/placed_array.h"
#include "preprocess/sources/placement/placement.h"
#include "preprocess/sources/wrapping/label_names.h"

namespace isonest::detail {
namespace {

/// "  density [50, 40, 30] Float32" for each array.
std::string list_of(const std::vector<VtiArray>& arrays) {
    std::string list;
    constexpr std::size_t kMaxListed = 40;
    for (std::size_t i = 0; i < std::min(arrays.size(), kMaxListed); ++i) {
        const VtiArray& a = arrays[i];
        list += fmt::format("\n  {} {}{}{}", a.name, a.type,
                            a.components > 1 ? fmt::format(" x {}", a.components) : "",
                            a.of_cells ? ", of cells" : "");
    }
    return list.empty() ? " none" : list;
}

const VtiArray& choose(const std::vector<VtiArray>& arrays, const SourceOptions& options,
                       const std::string& name) {
    const VtiArray* chosen = nullptr;
    std::size_t points = 0;
    for (const VtiArray& array : arrays) {
        if (!options.dataset.empty() ? array.name == options.dataset : !array.of_cells) {
            chosen = chosen == nullptr ? &array : chosen;
            ++points;
        }
    }
    if (chosen == nullptr && options.dataset.empty() && arrays.size() == 1) {
        return arrays.front();
    }
    if (chosen == nullptr) {
        throw Error(ErrorKind::not_found, {name},
                    fmt::format("there is no array {}; the file has:{}",
                                options.dataset.empty() ? std::string("of points")
                                                        : fmt::format("'{}'", options.dataset),
                                list_of(arrays)),
                    options.dataset.empty() ? std::vector<Remedy>{{RemedyKind::choose_dataset}}
                                            : std::vector<Remedy>{});
    }
    if (options.dataset.empty() && points > 1) {
        throw Error(ErrorKind::invalid_argument, {name},
                    "the file has several arrays:" + list_of(arrays),
                    {{RemedyKind::choose_dataset}});
    }
    return *chosen;
}

void set_type(const VtiArray& given, PlacedArray& array) {
    static const std::map<std::string, ValueType> types{
        {"Int8", ValueType::i8},     {"UInt8", ValueType::u8},   {"Int16", ValueType::i16},
        {"UInt16", ValueType::u16},  {"Int32", ValueType::i32},  {"UInt32", ValueType::u32},
        {"Float32", ValueType::f32}, {"Float64", ValueType::f64}};
    if (const auto it = types.find(given.type); it != types.end()) {
        array.layout.type = it->second;
    } else if (given.type == "Int64" || given.type == "UInt64") {
        array.stored = given.type == "Int64" ? StoredNumber::i64 : StoredNumber::u64;
    } else {
        throw Error(ErrorKind::unsupported, {array.name},
                    fmt::format("the type '{:.40}' is not supported", given.type));
    }
}

void set_place(const VtiHeader& header, const VtiArray& given, PlacedArray& array) {
    constexpr std::array<const char*, 3> kNames{"x", "y", "z"};
    array.first = header.origin;
    for (std::size_t i = 3; i-- > 0;) {
        const std::int64_t low = header.extent.at(2 * i);
        const std::int64_t high = header.extent.at(2 * i + 1);
        constexpr std::int64_t kMax = std::int64_t{1} << 40U;
        if (low < -kMax || high > kMax || high < low) {
            throw Error(ErrorKind::corrupt, {array.name, "WholeExtent"},
                        fmt::format("invalid extent: {} to {}", low, high));
        }
        const bool between = given.of_cells && high > low;
        array.axes.push_back({kNames.at(i), high - low + (between ? 0 : 1), true});
        const Double3 step = header.grid.step(i);
        to_first_sample(array.first, step, static_cast<double>(low), between);
        array.steps.push_back(step);
    }
    if (given.components > 1) {
        array.axes.push_back({"c", given.components, false});
        array.steps.push_back({0, 0, 0});
    }
}

/// Where the numbers begin, and their encoding.
struct Stored {
    std::uint64_t start;
    bool base64;
};

Stored stored_at(const VtiHeader& header, const VtiArray& given, const PlacedArray& array) {
    if (given.format == "appended") {
        if (header.encoding != "raw" && header.encoding != "base64") {
            throw Error(ErrorKind::corrupt, {array.name, "AppendedData"},
                        fmt::format("unknown encoding '{:.40}'", header.encoding));
        }
        return {header.appended + given.offset, header.encoding == "base64"};
    }
    if (given.format != "binary") {
        throw Error(ErrorKind::unsupported, {array.name},
                    fmt::format("the format '{:.40}' is not supported", given.format));
    }
    constexpr std::size_t kBlanks = 4096;
    const std::size_t blanks =
        first_bytes(array.file, kBlanks, given.content).find_first_not_of(" \t\r\n");
    return {given.content + (blanks == std::string::npos ? 0 : blanks), true};
}

class SizeReader {
  public:
    SizeReader(const PlacedArray& array, const VtiHeader& header, Stored stored)
        : array_(array), header_(header), stored_(stored) {}
    /// The words [0, count) before the numbers.
    [[nodiscard]] std::vector<std::uint64_t> words(std::uint64_t count) const {
        const std::size_t width = header_.wide ? 8 : 4;
        const std::uint64_t size = regular_file_size(array_.file);
        if (stored_.start > size || count > (size - stored_.start) / width) {
            throw Error(ErrorKind::corrupt, {array_.name},
                        fmt::format("{} block sizes from byte {} on do not fit in the file", count,
                                    stored_.start));
        }
        std::string text(count * width, '\0');
        bytes(count * width)->read(0, reinterpret_cast<std::byte*>(text.data()), text.size());
        std::vector<std::uint64_t> words;
        for (std::size_t i = 0; i < count; ++i) {
            words.push_back(header_.wide
                                ? number_at<std::uint64_t>(text, i * width, header_.big_endian)
                                : number_at<std::uint32_t>(text, i * width, header_.big_endian));
        }
        return words;
    }
    [[nodiscard]] std::unique_ptr<ByteReader> bytes(std::uint64_t size,
                                                    std::uint64_t behind = 0) const {
        return stored_.base64 ? base64_bytes(array_.file, stored_.start + behind, size)
                              : file_bytes(array_.file, stored_.start + behind, size);
    }

  private:
    const PlacedArray& array_;
    const VtiHeader& header_;
    Stored stored_;
};

/// The compression of the blocks. Throws Error{unsupported}.
BlockPacking packing_of(const VtiHeader& header, const std::string& name) {
    static const std::map<std::string, BlockPacking> packings{
        {"vtkZLibDataCompressor", BlockPacking::zlib},
        {"vtkLZ4DataCompressor", BlockPacking::lz4},
        {"vtkLZMADataCompressor", BlockPacking::lzma}};
    const auto it = packings.find(header.compressor);
    if (it == packings.end()) {
        throw Error(ErrorKind::unsupported, {name},
                    fmt::format("the compressor {:.40} is not supported; vtkZLibDataCompressor, "
                                "vtkLZ4DataCompressor and vtkLZMADataCompressor are",
                                header.compressor));
    }
    const std::string package = missing_package(it->second);
    if (!package.empty()) {
        throw Error(ErrorKind::unsupported, {name},
                    fmt::format("the data are compressed by {}, which this build does not support",
                                header.compressor),
                    {{RemedyKind::install_package, package}});
    }
    return it->second;
}

std::unique_ptr<ByteReader> packed_numbers(const PlacedArray& array, const VtiHeader& header,
                                           Stored stored, std::uint64_t max_heap) {
    const BlockPacking packing = packing_of(header, array.name);
    const SizeReader sizes(array, header, stored);
    const std::uint64_t width = header.wide ? 8 : 4;
    const std::vector<std::uint64_t> head = sizes.words(3);
    const std::uint64_t blocks = head[0];
    const std::uint64_t block = head[1];
    const std::uint64_t last = head[2];
    constexpr std::uint64_t kMax = std::uint64_t{1} << 50U;
    if (blocks == 0 || blocks > kMax || block == 0 || block > kMax || last > block) {
        throw Error(ErrorKind::corrupt, {array.name},
                    fmt::format("invalid compressed blocks: {} blocks of {} bytes, the last of {}",
                                blocks, block, last));
    }
    if (2 * block + sizeof(std::uint64_t) * 2 * blocks + max_beside(packing, block) > max_heap) {
        throw Error(ErrorKind::limit, {array.name},
                    fmt::format("{} compressed blocks of {} bytes need more than {} MiB of memory",
                                blocks, block, max_heap >> 20U),
                    {{RemedyKind::more_memory}});
    }
    const std::vector<std::uint64_t> words = sizes.words(3 + blocks);
    const std::vector<std::uint64_t> packed(words.begin() + 3, words.end());
    std::uint64_t all = 0;
    for (const std::uint64_t bytes : packed) {
        // Compressors expand incompressible data by less than this.
        if (bytes > 2 * block + 1024) {
            throw Error(
                ErrorKind::corrupt, {array.name},
                fmt::format("a block of {} bytes cannot have {} compressed bytes", block, bytes));
        }
        all += bytes;
    }
    const std::uint64_t behind = (3 + blocks) * width;
    return packed_blocks(packing, sizes.bytes(all, stored.base64 ? (behind + 2) / 3 * 4 : behind),
                         array.name, packed, block,
                         (blocks - 1) * block + (last == 0 ? block : last));
}

/// Throws unless the array has exactly the bytes of `count` values.
void require_bytes(const PlacedArray& array, std::uint64_t bytes, std::uint64_t needed,
                   const std::string& values) {
    if (bytes != needed) {
        throw Error(ErrorKind::corrupt, {array.name},
                    fmt::format("it has {} bytes, but {} need {}", bytes, values, needed));
    }
}

/// The `count` numbers of a piece's array, in any encoding.
std::unique_ptr<ByteReader> numbers_of_piece(const PlacedArray& array, const VtiHeader& header,
                                             const VtiArray& given, std::uint64_t count,
                                             std::uint64_t max_heap) {
    const ValueType type = array.stored ? bits_type(*array.stored) : array.layout.type;
    const std::uint64_t needed = count * size_of(type);
    const std::string values = fmt::format("the {} values of a piece", count);
    if (given.format == "ascii") {
        return array.stored ? text_integers(array.file, given.content,
                                            *array.stored == StoredNumber::i64, count)
                            : text_numbers(array.file, given.content, type, count);
    }
    const Stored stored = stored_at(header, given, array);
    if (!header.compressor.empty()) {
        auto bytes = packed_numbers(array, header, stored, max_heap);
        require_bytes(array, bytes->size(), needed, values);
        return bytes;
    }
    const std::uint64_t width = header.wide ? 8 : 4;
    const SizeReader sizes(array, header, stored);
    require_bytes(array, sizes.words(1)[0], needed, values);
    return bytes_behind(sizes.bytes(width + needed), width);
}

/// The array of a piece that corresponds to the one chosen in another piece.
const VtiArray& same_array(const VtiPiece& piece, const VtiArray& chosen, const std::string& name) {
    const auto it = std::find_if(piece.arrays.begin(), piece.arrays.end(), [&](const VtiArray& a) {
        return a.name == chosen.name && a.of_cells == chosen.of_cells;
    });
    if (it == piece.arrays.end() || it->type != chosen.type ||
        it->components != chosen.components) {
        throw Error(ErrorKind::corrupt, {name},
                    "a piece of the image lacks this array, or has it with another type");
    }
    return *it;
}

/// Joins the bytes of all pieces to one image. REQUIRES: set_place() was called.
std::unique_ptr<ByteReader> pieces_of(const VtiHeader& header, const VtiArray& chosen,
                                      const PlacedArray& array, std::uint64_t max_heap) {
    std::array<std::int64_t, 3> image{};
    for (std::size_t i = 0; i < 3; ++i) {
        image.at(i) = array.axes.at(2 - i).length;
    }
    std::vector<PieceBox> boxes;
    std::vector<const VtiArray*> arrays;
    for (const VtiPiece& piece : header.pieces) {
        PieceBox box;
        for (std::size_t i = 0; i < 3; ++i) {
            const std::int64_t low = piece.extent.at(2 * i);
            const std::int64_t high = piece.extent.at(2 * i + 1);
            const std::int64_t first = header.extent.at(2 * i);
            const std::int64_t last = header.extent.at(2 * i + 1);
            if (low < first || high > last) {
                throw Error(
                    ErrorKind::corrupt, {array.name, "Piece"},
                    fmt::format("the piece extends from {} to {}, but the image from {} to {}", low,
                                high, first, last));
            }
            box.low.at(i) = low - first;
            box.count.at(i) = high - low + (chosen.of_cells && last > first ? 0 : 1);
        }
        if (box.count[0] > 0 && box.count[1] > 0 && box.count[2] > 0) {
            boxes.push_back(box);
            arrays.push_back(&same_array(piece, chosen, array.name));
        }
    }
    if (!cover(boxes, image)) {
        throw Error(ErrorKind::corrupt, {array.name}, "the pieces do not cover the whole image");
    }
    std::vector<PieceNumbers> pieces;
    std::uint64_t held = 0;
    const auto components = static_cast<std::uint64_t>(chosen.components);
    for (std::size_t i = 0; i < boxes.size(); ++i) {
        if (is_within_later(boxes, i)) {
            continue;  // VTK writes an image that it cannot split once per piece
        }
        const auto& count = boxes[i].count;
        const std::uint64_t values = static_cast<std::uint64_t>(count[0]) *
                                     static_cast<std::uint64_t>(count[1]) *
                                     static_cast<std::uint64_t>(count[2]) * components;
        auto numbers = numbers_of_piece(array, header, *arrays[i], values, max_heap);
        held += numbers->heap();
        if (held > max_heap) {
            throw Error(ErrorKind::limit, {array.name},
                        fmt::format("the blocks of {} pieces need more than {} MiB of memory",
                                    boxes.size(), max_heap >> 20U),
                        {{RemedyKind::more_memory}});
        }
        pieces.push_back({boxes[i], std::move(numbers)});
    }
    const ValueType type = array.stored ? bits_type(*array.stored) : array.layout.type;
    return join_pieces(std::move(pieces), image, components * size_of(type));
}

/// The numbers of a small array.
std::vector<double> all_numbers(const PlacedArray& array, const VtiHeader& header,
                                const VtiArray& given, std::uint64_t count,
                                std::uint64_t max_heap) {
    if (given.components != 1 || array.stored) {
        throw Error(ErrorKind::unsupported, {array.name},
                    fmt::format("coordinates must be single numbers of up to 32 bits or floating "
                                "point, not {} x {}",
                                given.components, given.type));
    }
    const std::unique_ptr<ByteReader> bytes =
        numbers_of_piece(array, header, given, count, max_heap);
    const bool big_endian = given.format != "ascii" && header.big_endian;
    return dispatch(array.layout.type, [&](auto tag) {
        using T = typename decltype(tag)::type;
        std::string text(static_cast<std::size_t>(count) * sizeof(T), '\0');
        bytes->read(0, reinterpret_cast<std::byte*>(text.data()), text.size());
        std::vector<double> numbers;
        for (std::size_t i = 0; i < count; ++i) {
            numbers.push_back(static_cast<double>(number_at<T>(text, i * sizeof(T), big_endian)));
        }
        return numbers;
    });
}

/// Places the nodes of a rectilinear grid by their coordinates. REQUIRES: set_place() was called.
CoordinatePlace place_by_arrays(const VtiHeader& header, const VtiArray& given,
                                const SourceOptions& options, PlacedArray& array) {
    const VtiPiece& piece = header.pieces.front();
    if (header.pieces.size() > 1 || piece.extent != header.extent) {
        throw Error(ErrorKind::unsupported, {array.name},
                    "the rectilinear grid is in several pieces; in ParaView, save it as one");
    }
    if (piece.coordinates.size() != 3) {
        throw Error(ErrorKind::corrupt, {array.name, "Coordinates"},
                    fmt::format("a rectilinear grid has three arrays of coordinates, not {}",
                                piece.coordinates.size()));
    }
    std::array<std::int64_t, 3> points{};
    for (std::size_t a = 0; a < 3; ++a) {
        points.at(a) = header.extent.at(2 * a + 1) - header.extent.at(2 * a) + 1;
    }
    const auto read = [&](std::size_t along) {
        const VtiArray& coordinates = piece.coordinates.at(along);
        PlacedArray of;
        of.file = array.file;
        of.name = fmt::format("{}:{}", array.name, coordinates.name);
        set_type(coordinates, of);
        return all_numbers(of, header, coordinates, static_cast<std::uint64_t>(points.at(along)),
                           options.max_heap / 4);
    };
    return place_rectilinear(array, points, given.of_cells, options, read);
}

/// REQUIRES: the array has its type and place.
std::unique_ptr<VolumeSource> open_array(PlacedArray& array, const VtiHeader& header,
                                         const VtiArray& given, const SourceOptions& options) {
    const ValueType type = array.stored ? bits_type(*array.stored) : array.layout.type;
    const std::uint64_t count = place_in_array(array.axes, options.index, array.name).whole;
    const bool is_text = given.format == "ascii";
    array.layout.big_endian = !is_text && header.big_endian;
    if (header.pieces.size() > 1 || header.pieces.front().extent != header.extent) {
        return open_placed(array, options.index,
                           pieces_of(header, given, array, options.max_heap / 2));
    }
    if (is_text) {
        return open_placed(array, options.index,
                           numbers_of_piece(array, header, given, count, options.max_heap / 2));
    }
    const Stored stored = stored_at(header, given, array);
    if (!header.compressor.empty()) {
        return open_placed(array, options.index,
                           packed_numbers(array, header, stored, options.max_heap / 2));
    }
    const std::uint64_t width = header.wide ? 8 : 4;
    const std::uint64_t bytes = SizeReader(array, header, stored).words(1)[0];
    require_bytes(array, bytes, count * size_of(type),
                  fmt::format("[{}] values", text_of(array.axes)));
    array.layout.exact_length = false;
    if (stored.base64) {
        array.layout.offset = width;
        return open_placed(array, options.index,
                           base64_bytes(array.file, stored.start, width + bytes));
    }
    array.layout.packing = Packing::plain;
    array.layout.offset = stored.start + width;
    return open_placed(array, options.index);
}

/// The positions of the nodes of a structured grid: one volume of the array of points for each
/// component.
NodePositionsPtr positions_of(const VtiHeader& header, const VtiArray& given,
                              const PlacedArray& array, const SourceOptions& options) {
    const VtiPiece& piece = header.pieces.front();
    if (header.pieces.size() > 1 || piece.extent != header.extent) {
        throw Error(ErrorKind::unsupported, {array.name},
                    "the structured grid is in several pieces; in ParaView, save it as one");
    }
    if (given.of_cells) {
        throw Error(ErrorKind::unsupported, {array.name},
                    "these are values of the cells of a structured grid, which has positions of "
                    "its points alone; in ParaView, apply the filter Cell Data to Point Data");
    }
    const ChosenAxes chosen = choose_axes(array.axes, options.index, array.name);
    for (std::size_t a = 0; a < 3; ++a) {
        if (chosen.axis.at(a) != 2 - a) {
            throw Error(ErrorKind::unsupported, {array.name},
                        "an index cannot select a part of a curvilinear grid; crop it",
                        {{RemedyKind::correct_numbers, "index"}});
        }
    }
    if (piece.coordinates.size() != 1 || piece.coordinates.front().components != 3) {
        throw Error(ErrorKind::corrupt, {array.name, "Points"},
                    fmt::format("a structured grid has one array of points with three components, "
                                "not {}",
                                piece.coordinates.size() == 1
                                    ? fmt::format("{}", piece.coordinates.front().components)
                                    : fmt::format("{} arrays", piece.coordinates.size())));
    }
    auto positions = std::make_shared<NodePositions>();
    for (std::int64_t a = 0; a < 3; ++a) {
        PlacedArray points;
        points.file = array.file;
        points.name = fmt::format("{}:{}", array.file.name(), "Points");
        set_type(piece.coordinates.front(), points);
        set_place(header, piece.coordinates.front(), points);
        points.own_spacing = true;
        SourceOptions own = options;
        own.labels = false;
        own.max_heap /= 4;  // there are three of them, beside the values
        own.index = {AxisIndex{"c", a}};
        positions->coordinates.at(static_cast<std::size_t>(a)) =
            open_array(points, header, piece.coordinates.front(), own);
    }
    return positions;
}

std::unique_ptr<VolumeSource> open_vti(const VolumeInput& input, const SourceOptions& options) {
    PlacedArray array;
    array.file = input.file;
    const std::string file = input.name();
    const VtiHeader header = read_vti_header(input.file);
    const VtiArray& given = choose(header.pieces.front().arrays, options, file);
    array.name = file + ":" + given.name;
    set_type(given, array);
    set_place(header, given, array);
    array.own_spacing = options.spacing.has_value();
    if (header.curved && !options.spacing) {
        NodePositionsPtr positions = positions_of(header, given, array, options);
        return with_positions(open_array(array, header, given, options), std::move(positions));
    }
    if (!header.rectilinear) {
        return open_array(array, header, given, options);
    }
    CoordinatePlace by = place_by_arrays(header, given, options, array);
    return with_notes(
        with_uneven_axes(open_array(array, header, given, options), std::move(by.uneven)),
        std::move(by.notes));
}

}  // namespace
}  // namespace isonest::detail

#endif

namespace isonest::detail {
namespace {

/// Decides by the type in the VTKFile tag or, if that is beyond the first bytes, by the words
/// ImageData, RectilinearGrid and StructuredGrid.
bool is_vti(std::string_view head) {
    const std::size_t tag = head.find("<VTKFile");
    if (tag == std::string_view::npos) {
        return false;
    }
    std::string_view rest = head.substr(tag, head.find('>', tag) - tag);
    constexpr std::string_view kType = "type=";
    for (std::size_t at = rest.find(kType); at != std::string_view::npos; at = rest.find(kType)) {
        const bool is_whole = at > 0 && rest[at - 1] != '_';  // not header_type
        rest.remove_prefix(at + kType.size());
        if (is_whole) {
            return rest.size() > 1 && (rest.substr(1).starts_with("ImageData") ||
                                       rest.substr(1).starts_with("RectilinearGrid") ||
                                       rest.substr(1).starts_with("StructuredGrid"));
        }
    }
    return head.find("ImageData") != std::string_view::npos ||
           head.find("RectilinearGrid") != std::string_view::npos ||
           head.find("StructuredGrid") != std::string_view::npos;
}

}  // namespace

VolumeFormat vti_format() {
    return {
        .about = {"VTI", ".vti .vtr .vts", "libexpat1-dev"},
        .takes = {.dataset = true, .index = true}, .reads_urls = true,
        .recognises = [](const VolumeInput& input) { return is_vti(input.head); },
#if ISONEST_WITH_EXPAT
        .open = open_vti
#else
        .open = nullptr
#endif
    };
}

}  // namespace isonest::detail
