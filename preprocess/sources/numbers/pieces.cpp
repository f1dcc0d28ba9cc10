#include "preprocess/sources/numbers/pieces.h"

#include <fmt/format.h>

#include <cstdlib>

#include <isonest/error.h>

#include "preprocess/sources/bytes/regular_file.h"
#include "preprocess/sources/bytes/stream_bytes.h"
#include "preprocess/sources/numbers/raw_source.h"

namespace isonest::detail {
namespace {

/// Where the numbers of a file that is not packed begin.
std::uint64_t start_of_piece(const InputFile& file, const RawLayout& layout, std::uint64_t piece) {
    const std::uint64_t size = regular_file_size(file);
    const std::uint64_t start = behind_lines(file, file.name(), layout.start, layout.lines);
    const bool fits =
        size >= start && size - start >= piece && size - start - piece >= layout.offset;
    if (!fits) {
        throw Error(
            ErrorKind::invalid_argument, {file.name()},
            fmt::format("its part of the numbers needs {} bytes behind {} that are skipped, "
                        "but the file has {}",
                        piece, start + layout.offset, size));
    }
    return layout.offset_from_end ? size - piece : start + layout.offset;
}

}  // namespace

bool is_numbered(const std::string& pattern) {
    constexpr std::size_t kMostDigits = 2;
    const std::size_t sign = pattern.find('%');
    const std::size_t letter = pattern.find_first_not_of("0123456789", sign + 1);
    return sign != std::string::npos && letter != std::string::npos && pattern[letter] == 'd' &&
           letter - sign - 1 <= kMostDigits && pattern.find('%', letter) == std::string::npos;
}

std::vector<std::string> numbered_names(const std::string& pattern, std::int64_t first,
                                        std::int64_t last, std::int64_t step) {
    constexpr std::int64_t kMost = std::int64_t{1} << 31U;
    if (!is_numbered(pattern) || step == 0 || std::abs(first) > kMost || std::abs(last) > kMost ||
        std::abs(step) > kMost || (step > 0 ? last < first : last > first) ||
        static_cast<std::uint64_t>((last - first) / step) >= kMostPieces) {
        return {};
    }
    const std::size_t sign = pattern.find('%');
    const std::size_t letter = pattern.find('d', sign);
    const std::string digits = pattern.substr(sign + 1, letter - sign - 1);
    const int width = digits.empty() ? 0 : std::stoi(digits);
    std::vector<std::string> names;
    for (std::int64_t i = 0; i <= (last - first) / step; ++i) {
        const std::int64_t number = first + i * step;
        names.push_back(pattern.substr(0, sign) +
                        (digits.starts_with('0') ? fmt::format("{:0{}}", number, width)
                                                 : fmt::format("{:{}}", number, width)) +
                        pattern.substr(letter + 1));
    }
    return names;
}

std::vector<InputFile> pieces_beside(const InputFile& header,
                                     const std::vector<std::string>& names) {
    if (header.is_far()) {
        throw Error(ErrorKind::unsupported, {header.name()},
                    "its numbers are in several files, which are not read elsewhere",
                    {{RemedyKind::download}});
    }
    std::vector<InputFile> files;
    files.reserve(names.size());
    for (const std::string& name : names) {
        files.push_back(header.beside(name));
    }
    return files;
}

std::unique_ptr<ByteReader> bytes_of_pieces(const std::vector<InputFile>& files,
                                            const RawLayout& layout, std::uint64_t piece) {
    const bool packed = layout.packing == Packing::gzip || layout.packing == Packing::zlib;
    if (packed && layout.offset_from_end) {
        throw Error(ErrorKind::unsupported, {files.front().name()},
                    "data that are the end of the file (byte skip: -1) do not go with compression");
    }
    for (const InputFile& file : files) {
        if (packed) {
            regular_file_size(file);
        } else {
            static_cast<void>(start_of_piece(file, layout, piece));
        }
    }
    return joined_bytes(files, piece, packed, [layout, piece, packed](const InputFile& file) {
        if (!packed) {
            return file_bytes(file, start_of_piece(file, layout, piece), piece);
        }
        const std::uint64_t start = behind_lines(file, file.name(), layout.start, layout.lines);
        return deflated_bytes({file, start, layout.offset, piece}, layout.packing == Packing::gzip
                                                                       ? DeflateWrapper::gzip
                                                                       : DeflateWrapper::zlib);
    });
}

}  // namespace isonest::detail
