#include "preprocess/sources/numpy/numpy_format.h"

#include <fmt/format.h>

#include <algorithm>
#include <string>
#include <utility>
#include <vector>

#include <isonest/error.h>

#include "preprocess/sources/bytes/gzip_stream.h"
#include "preprocess/sources/bytes/regular_file.h"
#include "preprocess/sources/bytes/zip_directory.h"
#include "preprocess/sources/numpy/npy_header.h"
#include "preprocess/sources/placement/placed_array.h"
#include "preprocess/sources/placement/unsaid_spacing.h"

namespace isonest::detail {
namespace {

std::unique_ptr<VolumeSource> open_array(const NpyHeader& header, PlacedArray array,
                                         const SourceOptions& options) {
    for (const std::int64_t length : header.shape) {
        array.axes.push_back({"", length, true});
    }
    if (header.fortran) {
        std::uint64_t stride = 1;
        for (const std::int64_t length : header.shape) {
            array.strides.push_back(stride);
            // place_in_array() refuses what is too large to be.
            stride *= static_cast<std::uint64_t>(length);
        }
    }
    array.layout.type = header.type;
    array.stored = header.stored;
    array.layout.big_endian = header.big_endian;
    return without_spacing(open_placed(array, options.index), options);
}

bool is_npy(const VolumeInput& input) {
    return !input.folder && input.unpacked.starts_with("\x93NUMPY");
}

/// The start of a packed file is known; of long headers it is not enough.
std::string unpacked_header(const VolumeInput& input) {
    if (npy_header_bytes(input.unpacked) <= input.unpacked.size()) {
        return input.unpacked;
    }
    std::string text(kMostNpyHeader, '\0');
    GzipStream stream(input.file, input.name(), 0, DeflateWrapper::gzip);
    text.resize(stream.read(reinterpret_cast<std::byte*>(text.data()), text.size()));
    return text;
}

std::unique_ptr<VolumeSource> open_npy(const VolumeInput& input, const SourceOptions& options) {
    PlacedArray array;
    array.file = input.file;
    array.name = input.name();
    const NpyHeader header = parse_npy_header(
        input.gzip() ? unpacked_header(input) : first_bytes(input.file, kMostNpyHeader),
        array.name);
    array.layout.offset = header.bytes;
    array.layout.packing = input.gzip() ? Packing::gzip : Packing::plain;
    return open_array(header, std::move(array), options);
}

constexpr std::string_view kEnding = ".npy";

std::string array_name(const ZipMember& member) {
    return member.name.ends_with(kEnding)
               ? member.name.substr(0, member.name.size() - kEnding.size())
               : member.name;
}

/// An archive whose first member is an array.
bool is_npz(const VolumeInput& input) {
    constexpr std::size_t kName = 30;
    if (input.folder || !input.head.starts_with("PK\3\4") || input.head.size() < kName) {
        return false;
    }
    const std::size_t length = static_cast<unsigned char>(input.head[26]) +
                               256 * std::size_t{static_cast<unsigned char>(input.head[27])};
    return std::string_view(input.head).substr(kName, length).ends_with(kEnding);
}

std::string start_of(const std::filesystem::path& path, const ZipMember& member) {
    if (!member.deflated) {
        return first_bytes(
            path, static_cast<std::size_t>(std::min<std::uint64_t>(member.packed, kMostNpyHeader)),
            member.start);
    }
    std::string text(kMostNpyHeader, '\0');
    GzipStream stream(path, path.string(), member.start, DeflateWrapper::none);
    text.resize(stream.read(reinterpret_cast<std::byte*>(text.data()), text.size()));
    return text;
}

std::unique_ptr<VolumeSource> open_npz(const VolumeInput& input, const SourceOptions& options) {
    const std::filesystem::path& path = input.path();
    const std::vector<ZipMember> members = read_zip_directory(path);
    const ZipMember* chosen = nullptr;
    std::string list;
    std::size_t arrays = 0;
    constexpr std::size_t kMostListed = 40;
    for (const ZipMember& member : members) {
        if (!member.name.ends_with(kEnding)) {
            continue;
        }
        if (!options.dataset.empty()) {
            chosen = array_name(member) == options.dataset ? &member : chosen;
        } else if (arrays == 0) {
            chosen = &member;
        }
        if (arrays++ < kMostListed) {
            list += fmt::format("\n  {}", array_name(member));
        }
    }
    if (chosen == nullptr) {
        throw Error(ErrorKind::not_found, {path.string()},
                    fmt::format("there is no array '{}'; the file has:{}", options.dataset, list));
    }
    if (options.dataset.empty() && arrays > 1) {
        throw Error(ErrorKind::invalid_argument, {path.string()},
                    "there are several arrays:" + list, {{RemedyKind::choose_dataset}});
    }
    PlacedArray array;
    array.file = path;
    array.name = path.string() + ":" + array_name(*chosen);
    if (!chosen->readable) {
        throw Error(ErrorKind::unsupported, {array.name},
                    "it is encrypted, or compressed by another method than deflate");
    }
    const NpyHeader header = parse_npy_header(start_of(path, *chosen), array.name);
    array.layout.start = chosen->start;
    array.layout.offset = header.bytes;
    array.layout.packing = chosen->deflated ? Packing::deflate : Packing::plain;
    array.layout.exact_length = chosen->deflated;
    return open_array(header, std::move(array), options);
}

}  // namespace

VolumeFormat npy_format() {
    return {.about = {"NumPy", ".npy", ""},
            .takes = {.index = true},
            .reads_urls = true,
            .recognises = is_npy,
            .open = open_npy};
}

VolumeFormat npz_format() {
    return {.about = {"NumPy archive", ".npz", ""},
            .takes = {.dataset = true, .index = true},
            .recognises = is_npz,
            .open = open_npz};
}

}  // namespace isonest::detail
