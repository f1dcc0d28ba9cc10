#include <fmt/format.h>

#include <isonest/error.h>

#include "preprocess/sources/numbers/raw_source.h"
#include "preprocess/sources/volume_format.h"

namespace isonest::detail {
namespace {

std::unique_ptr<VolumeSource> open_numbers(const VolumeInput& input, const SourceOptions& options) {
    if (!options.dims || !options.type) {
        std::string names;
        for (const InputFormat& format : input_formats()) {
            names += fmt::format("{}{}{}", names.empty() ? "" : ", ", format.name,
                                 format.package.empty() ? "" : " (not in this build)");
        }
        throw Error(
            ErrorKind::invalid_argument, {input.name()},
            fmt::format("the format is not recognised as one of {}; raw numbers need a description",
                        names),
            {{RemedyKind::describe_numbers, "dims,type"}});
    }
    RawLayout layout;
    layout.nodes = *options.dims;
    layout.type = *options.type;
    layout.big_endian = options.big_endian.value_or(false);
    layout.offset = options.offset.value_or(0);
    return open_raw(input.file, input.name(), layout);
}

}  // namespace

VolumeFormat raw_format() {
    return {.about = {"raw numbers", ".raw .bin .gz", ""},
            .takes = {.numbers = true},
            .reads_urls = true,
            .recognises = [](const VolumeInput& input) { return !input.folder; },
            .open = open_numbers};
}

}  // namespace isonest::detail
