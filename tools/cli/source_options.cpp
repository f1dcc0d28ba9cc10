#include "tools/cli/source_options.h"

#include <fmt/format.h>

#include <algorithm>
#include <limits>

#include <isonest/error.h>

#include "store/lattice/lattice.h"
#include "tools/cli/command.h"
#include "tools/cli/units.h"

namespace isonest::detail::cli {

ValueType parse_type(const std::string& text) {
    const std::optional<ValueType> type = value_type_from_name(text);
    if (!type) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("--type '{}': give uint8, int8, uint16, int16, uint32, int32, "
                                "float32 or float64",
                                text));
    }
    return *type;
}

namespace {

/// "A,B": for data in a plane.
bool in_plane(const std::string& text) {
    return std::count(text.begin(), text.end(), ',') == 1;
}

}  // namespace

void add_source_options(CLI::App* command, SourceOptions& o) {
    const char* const group = "How to read INPUT";
    add_parsed(
        command, "--dataset", [&o](const std::string& text) { o.dataset = text; },
        "HDF5: the dataset's path, if there are several", "PATH")
        ->group(group);
    add_parsed(
        command, "--dims",
        [&o](const std::string& text) {
            o.dims = parse_int3("--dims", in_plane(text) ? text + ",1" : text, kMaxNodesPerAxis);
        },
        "raw: nodes per axis, fastest first", "X,Y[,Z]")
        ->group(group);
    add_parsed(
        command, "--type", [&o](const std::string& text) { o.type = parse_type(text); },
        "raw: uint8, int16, float32, ...", "T")
        ->group(group);
    add_parsed(
        command, "--endian",
        [&o](const std::string& text) {
            if (text != "big" && text != "little") {
                throw Error(ErrorKind::invalid_argument,
                            fmt::format("--endian '{}': give big or little", text));
            }
            o.big_endian = text == "big";
        },
        "raw: big or little [little]", "END")
        ->group(group);
    add_parsed(
        command, "--offset",
        [&o](const std::string& text) {
            o.offset = static_cast<std::uint64_t>(
                parse_integer("--offset", text, 0, std::numeric_limits<std::int64_t>::max()));
        },
        "raw: bytes to skip (after decompression) [0]", "BYTES")
        ->group(group);
    add_parsed(
        command, "--spacing",
        [&o](const std::string& text) {
            o.spacing = parse_double3("--spacing", in_plane(text) ? text + ",1" : text);
            if (!std::all_of(o.spacing->begin(), o.spacing->end(),
                             [](double s) { return s > 0; })) {
                throw Error(ErrorKind::invalid_argument,
                            fmt::format("--spacing '{}': give three numbers > 0", text));
            }
        },
        "node distance in world units, instead of the file's", "X,Y[,Z]")
        ->group(group);
    add_parsed(
        command, "--origin",
        [&o](const std::string& text) {
            o.origin = parse_double3("--origin", in_plane(text) ? text + ",0" : text);
        },
        "world position of the first node, instead of the file's", "X,Y[,Z]")
        ->group(group);
    add_parsed(
        command, "--missing",
        [&o](const std::string& text) { o.missing = parse_number("--missing", text); },
        "this value stands for missing data, as NaN does", "V")
        ->group(group);
}

}  // namespace isonest::detail::cli
