#include "query/extract/query_checks.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include <isonest/error.h>
#include <isonest/value_type.h>

#include "query/extract/stages/contour_lines.h"
#include "query/view/label_view.h"

namespace isonest::detail {
namespace {

/// Throws Error{invalid_argument}.
void require_not_negative(double number, const char* what) {
    if (!(number >= 0) || !std::isfinite(number)) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("{} {}: must be a finite number >= 0", what, number));
    }
}

void require_sense(const DistanceBound& asked) {
    require_not_negative(asked.value, "distance");
}
void require_sense(const TriangleBudget& asked) {
    if (asked.most == 0) {
        throw Error(ErrorKind::invalid_argument, "a mesh of no triangles is no surface");
    }
    require_sense(asked.within.value_or(DistanceBound{}));
}

double largest_of(const StoreReader& store, Field field) {
    double largest = 0;
    for (const ArrayInfo& array : store.layout().arrays()) {
        if (array.field != field) {
            continue;
        }
        if (const double max = store.totals(array).max; std::isfinite(max)) {
            largest = std::max(largest, max);
            continue;
        }
        for (std::int64_t i = 0; i < array.grid.product(); ++i) {
            const double max = store.row(array, array.grid.unlinear(i)).max;
            largest = std::isfinite(max) ? std::max(largest, max) : largest;
        }
    }
    return largest;
}

/// In the data's units.
double error_of(const StoreReader& store, const ErrorBound& asked) {
    double error = asked.value;
    if (asked.relative && error > 1) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("relative error {}: it is a part of the data's range, from 0 to 1; "
                                "0.01 is a hundredth of it",
                                error));
    }
    if (asked.relative) {
        // Each part by itself: the range of doubles may be beyond them.
        error = store.max_value() > store.min_value()
                    ? error * store.max_value() - error * store.min_value()
                    : error * 0;
    }
    require_not_negative(error, "error");
    return error;
}

Stop stop_of(const StoreReader& store, const ErrorBound& asked) {
    Field field = Field::deviation_bar;
    switch (asked.guarantee) {
        case Guarantee::deviation:
            break;
        case Guarantee::plus:
            field = Field::linf_plus;
            break;
        case Guarantee::estimate:
            field = Field::linf_bar;
            break;
    }
    require_field(store, field, "this guarantee");
    return {field, error_of(store, asked)};
}

Stop stop_of(const StoreReader& store, const FieldThreshold& asked) {
    require_field(store, asked.field, "this stop test");
    require_not_negative(asked.value, "threshold");
    return {asked.field, asked.value * (asked.relative ? largest_of(store, asked.field) : 1.0)};
}

/// The surface at full resolution is what a distance is measured from.
Stop stop_of(const StoreReader& store, const DistanceBound& asked) {
    require_sense(asked);
    return stop_of(store, ErrorBound{});
}

Stop stop_of(const StoreReader& store, const NestedDistanceBound& asked) {
    return stop_of(store, asked.bound);
}

Stop stop_of(const StoreReader& store, const TriangleBudget& asked) {
    require_sense(asked);
    return stop_of(store, ErrorBound{});
}

/// Errors are tried before (query/extract/error_budget.h).
Stop stop_of(const StoreReader& store, const ErrorBudget& asked) {
    return stop_of(store, ErrorBound{0, false, asked.guarantee});
}

void require_float32(const StoreReader& store, double number, const std::string& what,
                     Remedy remedy) {
    constexpr float kLargest = std::numeric_limits<float>::max();
    if (!(std::fabs(number) <= kLargest)) {
        throw Error(ErrorKind::limit, {store.path().string()},
                    fmt::format("{} {:.6g}, and a mesh's 32-bit floats end at {:.6g}", what, number,
                                kLargest),
                    {std::move(remedy)});
    }
}

/// Both ends of what the values reach; 0 where all are missing.
std::array<double, 2> value_range(const StoreReader& store) {
    if (!(store.min_value() <= store.max_value())) {
        return {0, 0};
    }
    return {store.min_value(), store.max_value()};
}

Stop stop_of(const StoreReader& store, const SimplifiedErrorBound& asked) {
    return stop_of(store, asked.bound);
}

}  // namespace

void require_label(const StoreReader& store, std::int64_t label) {
    const StoreHeader& header = store.layout().header();
    if (!is_label(header, label)) {
        throw Error(
            ErrorKind::invalid_argument, {store.path().string()},
            fmt::format("label {}: the store's values are {}", label,
                        header.labels ? "labels from 0 to 2^62 - 1" : name_of(header.type)));
    }
}

void require_distance(const SurfaceStop& stop) {
    if (const auto* const distance = std::get_if<DistanceBound>(&stop)) {
        require_sense(*distance);
    } else if (const auto* const budget = std::get_if<TriangleBudget>(&stop)) {
        require_sense(*budget);
    }
}

void require_stored(const StoreReader& store, Field field, const std::string& what) {
    const StoreLayout& layout = store.layout();
    if (layout.has(field) || layout.lattice().top() == 0) {
        return;
    }
    const std::vector<Field>& there = layout.header().fields;
    std::vector<Field> wanted = there;
    wanted.push_back(field);
    throw Error(ErrorKind::not_found, {store.path().string()},
                fmt::format("{} needs the field {}; the store has {}", what, name_of(field),
                            there.empty() ? "none" : list_names(there)),
                {{RemedyKind::make_fields, fmt::format("{}", fmt::join(names_of(wanted), ","))},
                 {RemedyKind::other_field, fmt::format("{}", fmt::join(names_of(there), ","))}});
}

void require_field(const StoreReader& store, Field field, const std::string& what) {
    if (is_of_cells(field)) {
        throw Error(ErrorKind::invalid_argument, {store.path().string()},
                    fmt::format("{} needs a field of nodes; {} is one of hexahedral cells", what,
                                name_of(field)));
    }
    require_stored(store, field, what);
}

void require_contours(std::span<const double> values) {
    if (values.empty()) {
        throw Error(ErrorKind::invalid_argument, "contours: no values are given");
    }
    if (values.size() > kMostContours) {
        throw Error(ErrorKind::limit, fmt::format("contours: {} values; at most {} at once",
                                                  values.size(), kMostContours));
    }
    for (const double value : values) {
        if (!std::isfinite(value)) {
            throw Error(ErrorKind::invalid_argument,
                        fmt::format("contours: {}: must be a finite number", value));
        }
    }
}

Stop stop_of(const StoreReader& store, const isonest::StopTest& test) {
    return std::visit([&](const auto& asked) { return stop_of(store, asked); }, test);
}

Stop stop_of(const StoreReader& store, const SurfaceStop& test) {
    return std::visit([&](const auto& asked) { return stop_of(store, asked); }, test);
}

namespace {

Stop cell_stop_of(const StoreReader& store, const ErrorBound& asked) {
    return {asked.guarantee == Guarantee::estimate ? Field::hex_linf : Field::hex_deviation,
            error_of(store, asked)};
}

/// What is simplified within a distance is the surface at full resolution.
Stop cell_stop_of(const StoreReader& /*store*/, const DistanceBound& asked) {
    require_sense(asked);
    return {Field::hex_deviation, 0};
}

Stop cell_stop_of(const StoreReader& /*store*/, const TriangleBudget& asked) {
    require_sense(asked);
    return {Field::hex_deviation, 0};
}

Stop cell_stop_of(const StoreReader& store, const ErrorBudget& asked) {
    return cell_stop_of(store, ErrorBound{0, false, asked.guarantee});
}

/// Those that hexahedra do not know.
template <class Asked>
Stop cell_stop_of(const StoreReader& store, const Asked& asked) {
    return {Field::hex_deviation, stop_of(store, asked).threshold};
}

Stop cell_stop_of(const StoreReader& store, const FieldThreshold& asked) {
    if (!is_of_cells(asked.field)) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("hexahedral cells stop by a field of cells, {}; {} is none",
                                "hex_linf or hex_deviation", name_of(asked.field)),
                    {{RemedyKind::other_field, "hex_linf,hex_deviation"}});
    }
    require_not_negative(asked.value, "threshold");
    return {asked.field, asked.value * (asked.relative ? largest_of(store, asked.field) : 1.0)};
}

template <class Test>
Stop any_cell_stop_of(const StoreReader& store, const Test& test, bool finest_needs_none) {
    const Stop stop =
        std::visit([&](const auto& asked) { return cell_stop_of(store, asked); }, test);
    if (stop.threshold > 0 || !finest_needs_none) {
        require_stored(store, stop.field, "the error of hexahedral cells");
    }
    return stop;
}

}  // namespace

Stop stop_of_cells(const StoreReader& store, const isonest::StopTest& test,
                   bool finest_needs_none) {
    return any_cell_stop_of(store, test, finest_needs_none);
}

Stop stop_of_cells(const StoreReader& store, const SurfaceStop& test, bool finest_needs_none) {
    return any_cell_stop_of(store, test, finest_needs_none);
}

void require_components(const ComponentChoice& choice) {
    if (!(choice.least_volume >= 0) || !std::isfinite(choice.least_volume)) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("least volume {}: must be a finite number, 0 or more",
                                choice.least_volume));
    }
}

void require_float32(const StoreReader& store, const ExtractQuery& query) {
    const Int3 nodes = store.layout().header().nodes;
    for (int axis = 0; axis < 3; ++axis) {
        const auto a = static_cast<std::size_t>(axis);
        const bool height = axis == 2 && query.product == Product::graph;
        const auto ends =
            height ? value_range(store) : std::array{0.0, static_cast<double>(nodes[axis] - 1)};
        for (const double end : ends) {
            require_float32(
                store, query.origin[a] + query.spacing[a] * end,
                fmt::format("the {} reaches {} =", height ? "graph" : "volume", "xyz"[a]),
                height ? Remedy{RemedyKind::other_scale}
                       : Remedy{RemedyKind::place_in_world, "spacing,origin"});
        }
    }
    if (query.traversal.attributes.value && !query.traversal.attributes.wide_value) {
        const StoreReader& values = query.values != nullptr ? *query.values : store;
        for (const double end : value_range(values)) {
            require_float32(values, end, "values reach", {RemedyKind::scale_values});
        }
    }
}

}  // namespace isonest::detail
