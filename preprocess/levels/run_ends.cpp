#include "preprocess/levels/run_ends.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

#include <isonest/error.h>
#include <isonest/field.h>
#include <isonest/value_type.h>

#include "preprocess/indicators/own_indicators.h"
#include "preprocess/indicators/value_rows.h"
#include "store/base/checksum.h"
#include "store/base/label_text.h"
#include "store/base/vectors.h"
#include "store/container/format.h"
#include "store/container/parts/header_writer.h"

namespace isonest::detail {
namespace {

/// Throws Error{invalid_argument} with the remedy to place the input elsewhere.
void require_place(const VolumeDescription& volume) {
    const std::string why = why_no_place(volume.nodes, volume.spacing, volume.origin);
    if (!why.empty()) {
        throw Error(ErrorKind::invalid_argument, {volume.name}, why,
                    {{RemedyKind::place_in_world, "spacing,origin"}});
    }
    if (const std::string other = why_no_directions(volume.nodes, volume.direction);
        !other.empty()) {
        throw Error(ErrorKind::invalid_argument, {volume.name}, other);
    }
    if (const std::string uneven = why_not_uneven(volume.nodes, volume.spacing, volume.origin,
                                                  volume.direction, volume.uneven);
        !uneven.empty()) {
        throw Error(ErrorKind::invalid_argument, {volume.name}, uneven);
    }
}

/// Throws Error{unsupported} for an indicator that is computed for even steps only.
void require_even_for(const VolumeDescription& volume, const std::vector<Field>& fields) {
    for (const Field field : fields) {
        if (!is_own(field) && !is_of_cells(field) && indicator_of(field) != Indicator::deviation &&
            indicator_of(field) != Indicator::linf) {
            require_even_axes(volume, fmt::format("the indicator {}", name_of(field)));
        }
    }
}

/// Throws Error{invalid_argument} unless rounding_of() may return this for the volume.
void require_rounding(const VolumeDescription& volume, const DataRounding& rounding) {
    if (rounding.none()) {
        return;
    }
    if (volume.labels) {
        throw Error(ErrorKind::invalid_argument, {volume.name}, "labels cannot be rounded");
    }
    const double step = rounding.step;
    const bool fits = dispatch(volume.type, [&](auto tag) {
        using T = typename decltype(tag)::type;
        if constexpr (std::is_integral_v<T>) {
            return step >= 2 && step == std::floor(step) &&
                   step <= 2.0 * std::numeric_limits<std::uint32_t>::max() &&
                   rounding.tolerance >= std::floor(step / 2);
        } else {
            return step > 0 && std::isfinite(step) && step == std::ldexp(1.0, std::ilogb(step)) &&
                   rounding.tolerance >= step / 2;
        }
    });
    if (!fits || !(rounding.tolerance <= step)) {
        throw Error(ErrorKind::invalid_argument, {volume.name},
                    fmt::format("{} cannot be rounded to multiples of {} within {}",
                                name_of(volume.type), step, rounding.tolerance));
    }
}

}  // namespace

StoreHeader header_of(const VolumeDescription& volume, const PreprocessOptions& options) {
    require_place(volume);
    require_even_for(volume, options.fields);
    StoreHeader header = header_of(volume);
    header.chunk = options.chunk;
    header.compression = options.compression;
    header.exact = options.exact;
    header.fields = options.fields;
    require_rounding(volume, options.rounding);
    header.rounding = options.rounding;
    const std::vector<Field> own = OwnIndicators(options.own, volume).fields();
    for (const Field field : options.fields) {
        if (is_own(field) && std::find(own.begin(), own.end(), field) == own.end()) {
            throw Error(
                ErrorKind::invalid_argument, {volume.name},
                fmt::format("{} needs a function or a volume of its numbers", name_of(field)));
        }
    }
    header.fields.insert(header.fields.end(), own.begin(), own.end());
    return header;
}

std::vector<LabelName> label_names_of(const VolumeSource& source) {
    std::vector<LabelName> names = source.label_names();
    if (const std::string why = why_no_label_names(names); !why.empty()) {
        throw Error(ErrorKind::invalid_argument, {source.describe().name}, why);
    }
    return names;
}

std::string own_identities(const std::vector<OwnIndicator>& own) {
    std::vector<std::string> lines;
    for (const OwnIndicator& indicator : own) {
        Checksum sum;
        sum.add(std::as_bytes(std::span(indicator.identity)));
        lines.push_back(fmt::format("own {} {:016x}\n", indicator.name, sum.value()));
    }
    std::sort(lines.begin(), lines.end());
    return fmt::format("{}", fmt::join(lines, ""));
}

namespace {

/// Positions have a digest, because the text of all sources together might be too long.
std::string identity_of(const NodePositionsPtr& positions) {
    if (!positions) {
        return {};
    }
    Checksum sum;
    for (const auto& source : positions->coordinates) {
        const std::string own = source->identity() + "\n";
        sum.add(std::as_bytes(std::span(own)));
    }
    return fmt::format("positions {:016x}\n", sum.value());
}

}  // namespace

std::string identity_of(const StoreHeader& h, const VolumeSource& source,
                        const PreprocessOptions& options) {
    const bool resume = options.resume;
    for (const OwnIndicator& indicator : options.own) {
        if (resume && indicator.identity.empty()) {
            throw Error(ErrorKind::invalid_argument, {source.describe().name},
                        fmt::format("the indicator {} has no identity, so a resumed run cannot "
                                    "check that it is the same",
                                    indicator.name),
                        {{RemedyKind::no_resume}});
        }
    }
    constexpr std::size_t kLongest = 32768;
    std::string input = source.identity();
    if (input.size() > kLongest || (input.empty() && resume)) {
        throw Error(
            ErrorKind::invalid_argument, {source.describe().name},
            input.empty()
                ? "identity() of the source is empty, so a resumed run cannot check that the input "
                  "is the same"
                : fmt::format(
                      "identity() of the source is longer than {} bytes, which is the limit",
                      kLongest),
            {{RemedyKind::no_resume}});
    }
    if (!input.empty() && input.back() != '\n') {
        input += '\n';
    }
    std::vector<std::string_view> fields(h.fields.size());
    std::transform(h.fields.begin(), h.fields.end(), fields.begin(), stored_name_of);
    return fmt::format(
               "format {}.{}\n{}nodes {} {} {}\ntype {}\nspacing {} {} {}\norigin {} {} {}\nchunk "
               "{}\n"
               "compression {}\nexact {}\nindicators {}\n",
               h.version().major, h.version().minor, input, h.nodes.x, h.nodes.y, h.nodes.z,
               name_of(h.type), h.spacing[0], h.spacing[1], h.spacing[2], h.origin[0], h.origin[1],
               h.origin[2], h.chunk, h.compression, h.exact, fmt::join(fields, ", ")) +
           (h.direction == kAlongWorld
                ? ""
                : fmt::format("direction {}\n", fmt::join(vtk_direction(h.direction), " "))) +
           (h.unit ? fmt::format("unit {}\n", symbol_of(*h.unit)) : "") +
           (h.frame == AnatomicalFrame::unknown ? ""
                                                : fmt::format("frame {}\n", name_of(h.frame))) +
           (h.uneven ? fmt::format("uneven {}\n", fmt::join(h.uneven->offsets, " ")) : "") +
           (h.rounding.none() ? "" : fmt::format("rounding {}\n", h.rounding.step)) +
           identity_of(source.describe().curved) + own_identities(options.own);
}

void write_cube_ranges(CentreStore& centres, StoreWriter& writer) {
    const Lattice& lattice = writer.layout().lattice();
    for (int level = kFirstRangeLevel; has_cube_ranges(lattice, level); ++level) {
        const auto ranges = centres.cube_ranges(level);
        if (level > kFirstRangeLevel) {
            merge_cube_ranges(centres.cube_ranges(level - 1), lattice.cells_at(level - 1), ranges,
                              lattice.cells_at(level));
        }
        writer.write_cube_ranges(level, ranges);
    }
}

void describe_store(const StoreWriter& writer, PreprocessReport& report) {
    const StoreLayout& layout = writer.layout();
    const StoreHeader& header = layout.header();
    report.nodes = header.nodes;
    report.levels = layout.lattice().top() + 1;
    report.input_bytes = static_cast<std::uint64_t>(header.nodes.product()) * size_of(header.type);
    report.chunks = layout.rows();
    report.min_value = std::numeric_limits<double>::infinity();
    report.max_value = -report.min_value;
    const ArrayInfo& values = layout.array(0, Field::values);
    for (std::int64_t i = 0; i < values.grid.product(); ++i) {
        const ChunkRow row = writer.row(values, values.grid.unlinear(i));
        report.min_value = std::min(report.min_value, row.min);
        report.max_value = std::max(report.max_value, row.max);
        report.has_missing = report.has_missing || (row.flags & kChunkHasMissing) != 0;
    }
    if (header.labels && report.min_value <= report.max_value) {
        report.labels = {static_cast<std::int64_t>(label_of_value(report.min_value)),
                         static_cast<std::int64_t>(label_of_value(report.max_value))};
        report.min_value = static_cast<double>((*report.labels)[0]);
        report.max_value = static_cast<double>((*report.labels)[1]);
    }
}

}  // namespace isonest::detail
