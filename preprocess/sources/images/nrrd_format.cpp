#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <string>
#include <utility>
#include <vector>

#include <isonest/error.h>

#include "preprocess/sources/bytes/input_file.h"
#include "preprocess/sources/bytes/stream_bytes.h"
#include "preprocess/sources/images/nrrd_header.h"
#include "preprocess/sources/numbers/raw_rows.h"
#include "preprocess/sources/numbers/raw_source.h"
#include "preprocess/sources/placement/placement.h"
#include "preprocess/sources/volume_format.h"
#include "preprocess/sources/wrapping/cropped_source.h"
#include "preprocess/sources/wrapping/label_names.h"
#include "preprocess/sources/wrapping/scaled_source.h"

namespace isonest::detail {
namespace {

bool is_nrrd(const VolumeInput& input) {
    return input.head.starts_with("NRRD000");
}

/// The start of the file, including at least the whole header.
std::string read_nrrd_header(const InputFile& file) {
    constexpr std::size_t kUsual = std::size_t{1} << 16U;
    constexpr std::size_t kLongest = std::size_t{1} << 22U;
    for (const std::size_t most : {kUsual, kLongest}) {
        std::string text = first_bytes(file, most);
        if (text.size() < most || nrrd_header_ends(text)) {
            return text;
        }
    }
    throw Error(ErrorKind::unsupported, {file.name(), "NRRD header"},
                fmt::format("no empty line ends the header within the first {} bytes", kLongest));
}

/// Places the volume by its directions; an axis without one is at right angles to the others, with
/// its own spacing.
void place_oblique(NrrdHeader& header, const std::string& name) {
    std::array<Double3, 3> steps = header.steps;
    Int3 nodes = header.layout.nodes;
    std::array<double, 3> length{1, 1, 1};
    for (std::size_t a = 0; a < 3; ++a) {
        if (header.no_space.at(a)) {
            nodes[static_cast<int>(a)] = 1;
            steps.at(a) = {0, 0, 0};
            length.at(a) = header.layout.spacing.at(a);
        }
    }
    complete_steps(nodes, steps);
    for (std::size_t a = 0; a < 3; ++a) {
        for (double& part : steps.at(a)) {
            part *= length.at(a);
        }
    }
    const Placement place = place_in_world(header.layout.nodes, steps, header.layout.origin, name);
    header.layout.spacing = place.spacing;
    header.layout.origin = place.origin;
    header.layout.direction = place.direction;
    header.backward = place.backward;
}

std::unique_ptr<ByteReader> unpacked_bytes(const InputFile& data, const NrrdHeader& header) {
    const RawLayout& layout = header.layout;
    if (layout.offset_from_end) {
        throw Error(ErrorKind::unsupported, {data.name()},
                    "byte skip: -1 is not possible with this encoding");
    }
    const std::uint64_t values =
        layout.whole > 0 ? layout.whole : static_cast<std::uint64_t>(layout.nodes.product());
    const std::uint64_t count = values / std::max<std::size_t>(header.pieces.size(), 1);
    const std::uint64_t bytes = count * size_of(layout.type);
    const std::uint64_t start = behind_lines(data, data.name(), layout.start, layout.lines);
    switch (header.encoding) {
        case NrrdEncoding::bzip2:
            return bzip2_bytes({data, start, layout.offset, bytes});
        case NrrdEncoding::hex:
            return hex_bytes({data, start + layout.offset, 0, bytes});
        default:
            return header.stored
                       ? text_integers(data, start + layout.offset,
                                       *header.stored == StoredNumber::i64, count, true)
                       : text_numbers(data, start + layout.offset, layout.type, count, true);
    }
}

/// Opens the numbers that the header describes.
std::unique_ptr<VolumeSource> open_numbers(const InputFile& input, NrrdHeader& header) {
    const bool is_raw =
        header.encoding == NrrdEncoding::raw || header.encoding == NrrdEncoding::gzip;
    RawLayout& layout = header.layout;
    if (header.pieces.empty()) {
        InputFile data = input;
        if (!header.data_file.empty()) {
            data = input.beside(header.data_file);
            layout.header = input;
        } else {
            layout.start = header.header_bytes;
        }
        if (is_raw) {
            return open_raw(data, data.name(), layout);
        }
        std::unique_ptr<ByteReader> bytes = unpacked_bytes(data, header);
        layout.offset = 0;
        return open_bytes(std::move(bytes), data.name(), layout, data);
    }
    const std::vector<InputFile> files = pieces_beside(input, header.pieces);
    const std::uint64_t piece = data_bytes(layout) / files.size();
    std::unique_ptr<ByteReader> bytes;
    if (is_raw) {
        bytes = bytes_of_pieces(files, layout, piece);
    } else {
        for (const InputFile& file : files) {
            regular_file_size(file);
        }
        bytes = joined_bytes(files, piece, true, [header](const InputFile& file) {
            return unpacked_bytes(file, header);
        });
    }
    RawLayout joined = layout;
    joined.offset = 0;
    joined.header = input;
    joined.others.assign(files.begin() + 1, files.end());
    return open_bytes(std::move(bytes), input.name(), joined, files.front());
}

std::unique_ptr<VolumeSource> open_nrrd(const VolumeInput& input, const SourceOptions& options) {
    const std::string name = input.name();
    NrrdHeader header =
        parse_nrrd_header(read_nrrd_header(input.file), name, options.spacing, options.index);
    if (header.oblique && options.spacing) {
        header.layout.frame = AnatomicalFrame::unknown;  // its axes are lost with the directions
        if (std::string lost = lost_by_own_spacing(header.layout.nodes, header.steps);
            !lost.empty()) {
            header.notes.push_back(std::move(lost));
        }
    } else if (header.oblique) {
        place_oblique(header, name);
    }
    if (header.no_space != std::array<bool, 3>{}) {
        header.layout.frame = AnatomicalFrame::unknown;
    }
    std::unique_ptr<VolumeSource> source = open_numbers(input.file, header);
    if (header.stored) {
        source = converted(std::move(source), *header.stored);
    }
    if (options.labels) {
        source = with_label_names(with_notes(std::move(source), header.labels.notes()),
                                  header.labels.names());
    }
    if (header.time) {
        source = with_time(std::move(source), *header.time);
    }
    std::array<bool, 3> said = header.said;
    for (std::size_t a = 0; a < 3; ++a) {
        said.at(a) = said.at(a) || header.no_space.at(a);
    }
    source = with_notes(std::move(source), note_of_spacing(said, header.layout.nodes, options));
    return mirrored(with_notes(std::move(source), header.notes), header.backward);
}

}  // namespace

VolumeFormat nrrd_format() {
    return {.about = {"NRRD", ".nrrd .nhdr", ""},
            .takes = {.index = true},
            .reads_urls = true,
            .recognises = is_nrrd,
            .open = open_nrrd};
}

}  // namespace isonest::detail
