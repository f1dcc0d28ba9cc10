#include "tools/cli/options/source_options.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <limits>
#include <string_view>
#include <utility>

#include <isonest/error.h>
#include <isonest/series.h>

#include "store/lattice/lattice.h"
#include "tools/cli/options/option_table.h"
#include "tools/cli/options/units.h"
#include "tools/cli/program.h"

namespace isonest::detail::cli {

std::vector<std::string> items_of(const std::string& text, char at) {
    std::vector<std::string> parts{""};
    for (const char c : text) {
        if (c == at) {
            parts.emplace_back();
        } else {
            parts.back() += c;
        }
    }
    return parts;
}

ValueType parse_type(const std::string& text) {
    // Names of NumPy and C. Except for f8, a trailing 8 means 8 bits, as everywhere in isonest.
    constexpr std::array<std::pair<std::string_view, std::string_view>, 14> kOthers{
        {{"u1", "uint8"},
         {"i1", "int8"},
         {"u2", "uint16"},
         {"i2", "int16"},
         {"u4", "uint32"},
         {"i4", "int32"},
         {"f4", "float32"},
         {"f8", "float64"},
         {"uchar", "uint8"},
         {"char", "int8"},
         {"ushort", "uint16"},
         {"short", "int16"},
         {"uint", "uint32"},
         {"int", "int32"}}};
    std::string_view name = text;
    for (const auto& [other, ours] : kOthers) {
        if (text == other) {
            name = ours;
        }
    }
    const std::optional<ValueType> type = value_type_from_name(name);
    if (!type) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("--type '{}': give uint8, int8, uint16, int16, uint32, int32, "
                                "float32 or float64 (or u1, i2, f4, ...)",
                                text));
    }
    return *type;
}

namespace {

/// Whether the text has the form "A,B", for data in a plane.
bool in_plane(const std::string& text) {
    return std::count(text.begin(), text.end(), ',') == 1;
}

std::int64_t parse_position(const char* option, const std::string& text) {
    constexpr std::int64_t kMax = std::int64_t{1} << 40U;
    return parse_integer(option, text, -kMax, kMax);
}

std::string without_blanks(const std::string& text) {
    const std::size_t from = text.find_first_not_of(' ');
    return from == std::string::npos ? ""
                                     : text.substr(from, text.find_last_not_of(' ') + 1 - from);
}

/// Parses "5,:,:,:", "time=5,c=0" or, with numbers of axes, "0=5,-1=:".
std::vector<AxisIndex> parse_index(const std::string& text) {
    std::vector<AxisIndex> index;
    for (const std::string& part : items_of(text, ',')) {
        const std::size_t sign = part.rfind('=');  // names may contain '='
        AxisIndex entry;
        if (sign != std::string::npos) {
            entry.axis = without_blanks(part.substr(0, sign));
        }
        const std::string at =
            without_blanks(sign == std::string::npos ? part : part.substr(sign + 1));
        if (at != ":") {
            entry.at = parse_position("--index", at);
        }
        const bool named = !index.empty() && !index.front().axis.empty();
        if ((!index.empty() && named == entry.axis.empty()) ||
            (sign != std::string::npos && entry.axis.empty())) {
            throw Error(ErrorKind::invalid_argument,
                        fmt::format("--index '{}': give a number or : for each axis (5,:,:,:), or "
                                    "axes by name or number (time=5,c=:,0=2)",
                                    text));
        }
        index.push_back(std::move(entry));
    }
    return index;
}

/// Parses "10:200,:,-64:", along x, y and z.
std::array<NodeRange, 3> parse_crop(const std::string& text) {
    std::array<NodeRange, 3> crop;
    const std::vector<std::string> parts = items_of(text, ',');
    const auto fail = [&] {
        throw Error(
            ErrorKind::invalid_argument,
            fmt::format("--crop '{}': give FROM:TO for x, y and z, such as 10:200,:,-64:", text));
    };
    if (parts.size() != 3 && parts.size() != 2) {
        fail();
    }
    for (std::size_t a = 0; a < parts.size(); ++a) {
        const std::size_t colon = parts[a].find(':');
        if (colon == std::string::npos) {
            fail();
        }
        const std::string from = parts[a].substr(0, colon);
        const std::string to = parts[a].substr(colon + 1);
        if (!from.empty()) {
            crop.at(a).from = parse_position("--crop", from);
        }
        if (!to.empty()) {
            crop.at(a).to = parse_position("--crop", to);
        }
    }
    return crop;
}

Int3 parse_nodes(const char* option, const std::string& text) {
    std::string commas = text;
    std::replace(commas.begin(), commas.end(), 'x', ',');
    return parse_int3(option, in_plane(commas) ? commas + ",1" : commas, kMaxNodesPerAxis);
}

/// Parses "x,y" or "xy".
std::array<bool, 3> parse_axes(const std::string& text) {
    std::array<bool, 3> axes{};
    for (const char c : text) {
        if (c >= 'x' && c <= 'z') {
            axes.at(static_cast<std::size_t>(c - 'x')) = true;
        } else if (c != ',') {
            throw Error(ErrorKind::invalid_argument,
                        fmt::format("--periodic '{}': give axes, such as x,y or z", text));
        }
    }
    return axes;
}

void add_parts(CLI::App* command, SourceOptions& o) {
    add_parsed(command, "--series", [&o](const std::string& text) { o.series = text; });
    add_parsed(command, "--index", [&o](const std::string& text) { o.index = parse_index(text); });
    add_parsed(command, "--crop", [&o](const std::string& text) { o.crop = parse_crop(text); });
    add_parsed(command, "--every", [&o](const std::string& text) {
        if (text.find_first_of(",x") != std::string::npos) {
            o.every = parse_nodes("--every", text);
        } else {
            const std::int64_t n = parse_integer("--every", text, 1, kMaxNodesPerAxis);
            o.every = {n, n, n};
        }
    });
    CLI::Option* const periodic = add_parsed(
        command, "--periodic", [&o](const std::string& text) { o.periodic = parse_axes(text); });
    add_parsed(command, "--repeat", [&o](const std::string& text) {
        o.repeat = parse_nodes("--repeat", text);
    })->needs(periodic);
}

}  // namespace

std::unique_ptr<VolumeSource> open_input(const std::vector<std::string>& input,
                                         const std::filesystem::path& scratch_folder,
                                         const SourceOptions& options) {
    for (const std::string& name : input) {
        require_no_series(name);
    }
    if (input == std::vector<std::string>{"-"}) {
        return open_volume_stream(STDIN_FILENO, scratch_folder, options);
    }
    return open_volume(std::vector<std::filesystem::path>(input.begin(), input.end()), options);
}

std::string given_source_option(const CLI::App& command) {
    for (const CLI::Option* const option :
         command.get_options([](const CLI::Option* o) { return o->get_group() == kReading; })) {
        if (option->count() > 0) {
            return "--" + option->get_lnames().front();
        }
    }
    return "";
}

void require_no_source_option(const std::string& option, const std::string& store) {
    if (!option.empty()) {
        throw Error(ErrorKind::invalid_argument, {store},
                    fmt::format("is a store, and {} is an option for volumes", option));
    }
}

void add_source_options(CLI::App* command, SourceOptions& o, bool with_labels) {
    add_parsed(command, "--dataset", [&o](const std::string& text) { o.dataset = text; });
    add_parts(command, o);
    add_parsed(command, "--dims",
               [&o](const std::string& text) { o.dims = parse_nodes("--dims", text); });
    add_parsed(command, "--type", [&o](const std::string& text) {
        const bool ordered = text.starts_with('<') || text.starts_with('>');
        o.type = parse_type(ordered ? text.substr(1) : text);
        if (ordered) {
            o.big_endian = text.starts_with('>');
        }
    });
    add_parsed(command, "--endian", [&o](const std::string& text) {
        if (text != "big" && text != "little") {
            throw Error(ErrorKind::invalid_argument,
                        fmt::format("--endian '{}': give big or little", text));
        }
        o.big_endian = text == "big";
    });
    add_parsed(command, "--offset", [&o](const std::string& text) {
        o.offset = static_cast<std::uint64_t>(
            parse_integer("--offset", text, 0, std::numeric_limits<std::int64_t>::max()));
    });
    add_parsed(command, "--spacing", [&o](const std::string& text) {
        o.spacing = parse_double3("--spacing", in_plane(text) ? text + ",1" : text);
        if (!std::all_of(o.spacing->begin(), o.spacing->end(), [](double s) { return s > 0; })) {
            throw Error(ErrorKind::invalid_argument,
                        fmt::format("--spacing '{}': give three numbers > 0", text));
        }
    });
    add_parsed(command, "--origin", [&o](const std::string& text) {
        o.origin = parse_double3("--origin", in_plane(text) ? text + ",0" : text);
    });
    add_parsed(command, "--unit", [&o](const std::string& text) {
        o.unit = length_unit_from(text);
        if (!o.unit) {
            throw Error(ErrorKind::invalid_argument,
                        fmt::format("--unit '{}': give a unit of length: {}", text,
                                    list_of_length_units()));
        }
    });
    add_parsed(command, "--frame", [&o](const std::string& text) {
        o.frame = frame_from(text);
        if (!o.frame) {
            throw Error(ErrorKind::invalid_argument,
                        fmt::format("--frame '{}': give ras or lps", text));
        }
    });
    if (with_labels) {
        command->add_flag("--labels", o.labels);
    }
    add_parsed(command, "--missing",
               [&o](const std::string& text) { o.missing = parse_number("--missing", text); });
}

}  // namespace isonest::detail::cli
