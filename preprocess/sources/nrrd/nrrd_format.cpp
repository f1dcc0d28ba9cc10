#include "preprocess/sources/nrrd/nrrd_format.h"

#include <fmt/format.h>

#include <string>
#include <utility>

#include <isonest/error.h>

#include "preprocess/sources/bytes/input_file.h"
#include "preprocess/sources/bytes/regular_file.h"
#include "preprocess/sources/nrrd/nrrd_header.h"
#include "preprocess/sources/numbers/raw_source.h"
#include "preprocess/sources/placement/placement.h"
#include "preprocess/sources/wrapping/converted_source.h"
#include "preprocess/sources/wrapping/mirrored_source.h"
#include "preprocess/sources/wrapping/named_labels_source.h"
#include "preprocess/sources/wrapping/noted_source.h"

namespace isonest::detail {
namespace {

bool is_nrrd(const VolumeInput& input) {
    return input.head.starts_with("NRRD000");
}

/// The file's start, with at least the whole header.
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
                fmt::format("no empty line ends it within the first {} bytes", kLongest));
}

std::unique_ptr<VolumeSource> open_nrrd(const VolumeInput& input, const SourceOptions& options) {
    const std::string name = input.name();
    NrrdHeader header = parse_nrrd_header(read_nrrd_header(input.file), name, options.spacing);
    if (header.oblique && !options.spacing) {
        const Placement place =
            place_in_world(header.layout.nodes, header.steps, header.layout.origin, name);
        header.layout.spacing = place.spacing;
        header.layout.origin = place.origin;
        header.layout.direction = place.direction;
        header.backward = place.backward;
    }
    InputFile data = input.file;
    if (!header.data_file.empty()) {
        data = input.file.beside(header.data_file);
        header.layout.header = input.file;
    } else {
        header.layout.start = header.header_bytes;
    }
    std::unique_ptr<VolumeSource> source = open_raw(data, data.name(), header.layout);
    if (header.stored) {
        source = converted(std::move(source), *header.stored);
    }
    if (options.labels) {
        source = with_label_names(with_notes(std::move(source), header.labels.notes()),
                                  header.labels.names());
    }
    return mirrored(with_notes(std::move(source), header.notes), header.backward);
}

}  // namespace

VolumeFormat nrrd_format() {
    return {.about = {"NRRD", ".nrrd .nhdr", ""},
            .takes = {},
            .reads_urls = true,
            .recognises = is_nrrd,
            .open = open_nrrd};
}

}  // namespace isonest::detail
