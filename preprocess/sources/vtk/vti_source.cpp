#include "preprocess/sources/bytes/regular_file.h"
#include "preprocess/sources/vtk/vtk_format.h"

#if ISONEST_WITH_EXPAT

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include <isonest/error.h>

#include "preprocess/sources/bytes/byte_reader.h"
#include "preprocess/sources/bytes/header_number.h"
#include "preprocess/sources/placement/placed_array.h"
#include "preprocess/sources/vtk/vti_header.h"

namespace isonest::detail {
namespace {

/// "  density [50, 40, 30] Float32" for each array.
std::string list_of(const VtiHeader& header) {
    std::string list;
    constexpr std::size_t kMostListed = 40;
    for (std::size_t i = 0; i < std::min(header.arrays.size(), kMostListed); ++i) {
        const VtiArray& a = header.arrays[i];
        list += fmt::format("\n  {} {}{}{}", a.name, a.type,
                            a.components > 1 ? fmt::format(" x {}", a.components) : "",
                            a.of_cells ? ", of cells" : "");
    }
    return list.empty() ? " none" : list;
}

const VtiArray& choose(const VtiHeader& header, const SourceOptions& options,
                       const std::string& name) {
    const VtiArray* chosen = nullptr;
    std::size_t points = 0;
    for (const VtiArray& array : header.arrays) {
        if (!options.dataset.empty() ? array.name == options.dataset : !array.of_cells) {
            chosen = chosen == nullptr ? &array : chosen;
            ++points;
        }
    }
    if (chosen == nullptr && options.dataset.empty() && header.arrays.size() == 1) {
        return header.arrays.front();
    }
    if (chosen == nullptr) {
        throw Error(ErrorKind::not_found, {name},
                    fmt::format("there is no array '{}' of points; the file has:{}",
                                options.dataset, list_of(header)),
                    {{RemedyKind::choose_dataset}});
    }
    if (options.dataset.empty() && points > 1) {
        throw Error(ErrorKind::invalid_argument, {name},
                    "there are several arrays:" + list_of(header), {{RemedyKind::choose_dataset}});
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
                    fmt::format("numbers of type '{:.40}'", given.type));
    }
}

void set_place(const VtiHeader& header, const VtiArray& given, bool straight, PlacedArray& array) {
    constexpr std::array<const char*, 3> kNames{"x", "y", "z"};
    array.first = header.origin;
    for (std::size_t i = 3; i-- > 0;) {
        const std::int64_t low = header.extent.at(2 * i);
        const std::int64_t high = header.extent.at(2 * i + 1);
        constexpr std::int64_t kMost = std::int64_t{1} << 40U;
        if (low < -kMost || high > kMost || high < low) {
            throw Error(ErrorKind::corrupt, {array.name, "WholeExtent"},
                        fmt::format("from {} to {}", low, high));
        }
        const bool between = given.of_cells && high > low;
        array.axes.push_back({kNames.at(i), high - low + (between ? 0 : 1), true});
        const Double3 step = header.grid.step(i);
        to_first_sample(array.first, step, static_cast<double>(low), between);
        if (!straight) {
            array.steps.push_back(step);
        }
    }
    if (given.components > 1) {
        array.axes.push_back({"c", given.components, false});
        if (!straight) {
            array.steps.push_back({0, 0, 0});
        }
    }
}

/// Where the numbers begin, and how.
struct Stored {
    std::uint64_t start;
    bool base64;
};

Stored stored_at(const VtiHeader& header, const VtiArray& given, const PlacedArray& array) {
    if (given.format == "appended") {
        if (header.encoding != "raw" && header.encoding != "base64") {
            throw Error(ErrorKind::corrupt, {array.name, "AppendedData"},
                        fmt::format("encoding '{:.40}'", header.encoding));
        }
        return {header.appended + given.offset, header.encoding == "base64"};
    }
    if (given.format != "binary") {
        throw Error(ErrorKind::unsupported, {array.name},
                    fmt::format("format '{:.40}'", given.format));
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
    /// Words [from, from + count) of what precedes the numbers.
    [[nodiscard]] std::vector<std::uint64_t> words(std::uint64_t count) const {
        const std::size_t width = header_.wide ? 8 : 4;
        const std::uint64_t size = regular_file_size(array_.file);
        if (stored_.start > size || count > (size - stored_.start) / width) {
            throw Error(ErrorKind::corrupt, {array_.name},
                        fmt::format("{} sizes from byte {} on do not fit into the file", count,
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

std::unique_ptr<ByteReader> packed_numbers(const PlacedArray& array, const VtiHeader& header,
                                           Stored stored, std::uint64_t most_heap) {
    const SizeReader sizes(array, header, stored);
    const std::uint64_t width = header.wide ? 8 : 4;
    const std::vector<std::uint64_t> head = sizes.words(3);
    const std::uint64_t blocks = head[0];
    const std::uint64_t block = head[1];
    const std::uint64_t last = head[2];
    constexpr std::uint64_t kMost = std::uint64_t{1} << 50U;
    if (blocks == 0 || blocks > kMost || block == 0 || block > kMost || last > block) {
        throw Error(ErrorKind::corrupt, {array.name},
                    fmt::format("{} blocks of {} bytes, the last of {}", blocks, block, last));
    }
    if (2 * block + sizeof(std::uint64_t) * 2 * blocks > most_heap) {
        throw Error(ErrorKind::limit, {array.name},
                    fmt::format("{} compressed blocks of {} bytes take more than {} MiB", blocks,
                                block, most_heap >> 20U),
                    {{RemedyKind::more_memory}});
    }
    const std::vector<std::uint64_t> words = sizes.words(3 + blocks);
    const std::vector<std::uint64_t> packed(words.begin() + 3, words.end());
    std::uint64_t all = 0;
    for (const std::uint64_t bytes : packed) {
        // What zlib makes of numbers that it cannot pack.
        if (bytes > 2 * block + 1024) {
            throw Error(ErrorKind::corrupt, {array.name},
                        fmt::format("a block of {} bytes is packed into {}", block, bytes));
        }
        all += bytes;
    }
    const std::uint64_t behind = (3 + blocks) * width;
    return zlib_blocks(sizes.bytes(all, stored.base64 ? (behind + 2) / 3 * 4 : behind), array.name,
                       packed, block, (blocks - 1) * block + (last == 0 ? block : last));
}

std::unique_ptr<VolumeSource> open_vti(const VolumeInput& input, const SourceOptions& options) {
    PlacedArray array;
    array.file = input.file;
    const std::string file = input.name();
    const VtiHeader header = read_vti_header(input.file);
    const VtiArray& given = choose(header, options, file);
    array.name = file + ":" + given.name;
    set_type(given, array);
    set_place(header, given, options.spacing.has_value(), array);
    const ValueType type = array.stored ? bits_type(*array.stored) : array.layout.type;
    const std::uint64_t count = place_in_array(array.axes, options.index, array.name).whole;
    if (given.format == "ascii") {
        return open_placed(array, options.index,
                           array.stored ? text_integers(array.file, given.content,
                                                        *array.stored == StoredNumber::i64, count)
                                        : text_numbers(array.file, given.content, type, count));
    }
    const Stored stored = stored_at(header, given, array);
    array.layout.big_endian = header.big_endian;
    if (!header.compressor.empty()) {
        if (header.compressor != "vtkZLibDataCompressor") {
            throw Error(ErrorKind::unsupported, {array.name},
                        fmt::format("compressed by {:.40}: vtkZLibDataCompressor is read",
                                    header.compressor));
        }
        return open_placed(array, options.index,
                           packed_numbers(array, header, stored, options.max_heap / 2));
    }
    const std::uint64_t width = header.wide ? 8 : 4;
    const std::uint64_t bytes = SizeReader(array, header, stored).words(1)[0];
    if (bytes != count * size_of(type)) {
        throw Error(ErrorKind::corrupt, {array.name},
                    fmt::format("it has {} bytes, but [{}] values need {}", bytes,
                                text_of(array.axes), count * size_of(type)));
    }
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

}  // namespace
}  // namespace isonest::detail

#endif

namespace isonest::detail {

VolumeFormat vti_format() {
    return {
        .about = {"VTI", ".vti", "libexpat1-dev"}, .takes = {.dataset = true, .index = true},
        .reads_urls = true,
        .recognises =
            [](const VolumeInput& input) {
                return input.head.find("<VTKFile") != std::string::npos &&
                       input.head.find("ImageData") != std::string::npos;
            },
#if ISONEST_WITH_EXPAT
        .open = open_vti
#else
        .open = nullptr
#endif
    };
}

}  // namespace isonest::detail
