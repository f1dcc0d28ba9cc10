#include "query/extract/query_checks.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <limits>
#include <utility>
#include <vector>

#include <isonest/error.h>
#include <isonest/value_type.h>

#include "query/extract/combinations.h"
#include "query/extract/stages/contour_lines.h"
#include "query/mesh/vertex_stars.h"
#include "query/values/label_view.h"
#include "store/base/vectors.h"
#include "store/container/format.h"
#include "store/container/reader.h"

namespace isonest::detail {

// Section 3 of the paper: |U - U^l| <= E everywhere, for the finest function U and that of the
// nested grid for the error E. So the solid {U^l >= c + E} is contained in {U >= c}, and that in
// {U^l >= c - E}. The nested grid is the same for all isovalues: both outer solids are what the
// same query extracts at c + E and c - E, and their volumes bound the one between them.
//
// Coordinates of a mesh are rounded; each vertex is off by at most d. While the vertices move
// straight from their exact positions to the rounded ones, the area is at most the final area A
// plus, for each of the n triangles, whose edges have a length of at most L + 2 d, 2 d (L + 3 d);
// and the volume changes by at most d times the area. The sum of volumes
// (query/mesh/measuring_sink.cpp) adds L A 2^-49 for the rounding of its terms in float64, and n
// L^3 2^-58 for that to integers.

namespace {

/// Discards a mesh.
class NoMesh : public MeshSink {
  public:
    void begin(const MeshLayout& /*layout*/) override {}
    void add_vertices(const VertexBatch& /*batch*/) override {}
    void add_elements(const ElementBatch& /*batch*/) override {}
    [[nodiscard]] bool concurrent() const override { return true; }
};

/// The error's indicator.
ErrorIndicator error_indicator(const SurfaceStop& stop) {
    if (const auto* const bound = std::get_if<ErrorBound>(&stop)) {
        return bound->indicator;
    }
    return std::get<TriangleBudgetByError>(stop).indicator;
}

/// Maximum error of the volume of a mesh.
double rounding_of(const ExtractReport& r, const StoreHeader& header) {
    const double longest = diagonal_of(header);
    const double moved =
        r.coordinate_rounding *
        (header.steps().is_regular() ? length(header.spacing) : header.steps().diagonal());
    const double area = r.measures->area;
    const auto triangles = static_cast<double>(r.triangles);
    return moved * (area + triangles * 2 * moved * (longest + 3 * moved)) +
           longest *
               (area * std::ldexp(1.0, -49) + triangles * longest * longest * std::ldexp(1.0, -58));
}

}  // namespace

std::optional<VolumeInterval> volume_interval(const Store& store, const SurfaceQuery& query,
                                              double tolerance, const ExtractOptions& options,
                                              Progress& progress) {
    SurfaceQuery outer = query;
    outer.attributes = {};
    const double error = std::max(tolerance, tolerance_of(store.reader()));
    outer.stop = ErrorBound{error, false, error_indicator(query.stop)};
    outer.effort = Effort::none;
    outer.grid.cells = Cells::tetrahedra;
    const auto extracted = [&](double iso) {
        outer.iso = iso;
        NoMesh nowhere;
        return extract(store, outer, nowhere, options, progress);
    };
    constexpr double kInfinity = std::numeric_limits<double>::infinity();
    const ExtractReport above = extracted(std::nextafter(query.iso + error, kInfinity));
    const ExtractReport below = extracted(std::nextafter(query.iso - error, -kInfinity));
    const bool is_above = *query.stages.close == Outside::below;
    const ExtractReport& least = is_above ? above : below;
    const ExtractReport& most = is_above ? below : above;
    if (!least.measures->volume || !most.measures->volume) {
        return std::nullopt;
    }
    const StoreHeader& header = store.reader().layout().header();
    return VolumeInterval{std::max(*least.measures->volume - rounding_of(least, header), 0.0),
                          *most.measures->volume + rounding_of(most, header)};
}

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
void require_sense(const TriangleBudgetByDistance& asked) {
    if (asked.most == 0) {
        throw Error(ErrorKind::invalid_argument, "the number of triangles must be positive");
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

/// The field of an error.
Field field_of(ErrorIndicator indicator, Cells cells) {
    const bool has_cells = cells == Cells::hexahedra;
    switch (indicator) {
        case ErrorIndicator::deviation:
            break;
        case ErrorIndicator::plus:
            return has_cells ? Field::hex_deviation : Field::linf_plus;
        case ErrorIndicator::estimate:
            return has_cells ? Field::hex_linf : Field::linf_bar;
    }
    return has_cells ? Field::hex_deviation : Field::deviation_bar;
}

Stop stop_at(const StoreReader& store, Field field, const ErrorBound& asked) {
    const double error = error_of(store, asked);
    return {field, error_left(store, error), error};
}

Stop stop_at(const StoreReader& store, const FieldThreshold& asked) {
    require_not_negative(asked.value, "threshold");
    const double threshold = asked.value * (asked.relative ? largest_of(store, asked.field) : 1.0);
    return {asked.field, threshold, threshold};
}

Stop stop_of(const StoreReader& store, const ErrorBound& asked) {
    Field field = field_of(asked.indicator, Cells::tetrahedra);
    if (asked.indicator == ErrorIndicator::estimate && !store.layout().has(field) &&
        store.layout().has(Field::deviation_bar)) {
        field = Field::deviation_bar;  // promises more
    }
    require_field(store, field, "this indicator");
    return stop_at(store, field, asked);
}

Stop stop_of(const StoreReader& store, const FieldThreshold& asked) {
    require_field(store, asked.field, "this stop test");
    return stop_at(store, asked);
}

/// A distance is measured from the surface at full resolution.
Stop stop_of(const StoreReader& store, const DistanceBound& asked) {
    require_sense(asked);
    return stop_of(store, ErrorBound{});
}

Stop stop_of(const StoreReader& store, const TriangleBudgetByDistance& asked) {
    require_sense(asked);
    return stop_of(store, ErrorBound{});
}

/// Errors are tried before this is used (query/extract/extraction.h).
Stop stop_of(const StoreReader& store, const TriangleBudgetByError& asked) {
    return stop_of(store, ErrorBound{0, false, asked.indicator});
}

void require_float32(const StoreReader& store, double number, const std::string& what,
                     Remedy remedy) {
    constexpr float kLargest = std::numeric_limits<float>::max();
    if (!(std::fabs(number) <= kLargest)) {
        throw Error(ErrorKind::limit, {store.path().string()},
                    fmt::format("{} {:.6g} is beyond the range of a mesh's 32-bit floats, {:.6g}",
                                what, number, kLargest),
                    {std::move(remedy)});
    }
}

/// The smallest and the largest value; 0 if all are missing.
std::array<double, 2> value_range(const StoreReader& store) {
    if (!(store.min_value() <= store.max_value())) {
        return {0, 0};
    }
    return {store.min_value(), store.max_value()};
}

}  // namespace

double error_of(const StoreReader& store, const ErrorBound& asked) {
    double error = asked.value;
    if (asked.relative && error > 1) {
        throw Error(
            ErrorKind::invalid_argument,
            fmt::format(
                "relative error {}: give a fraction of the data's range, from 0 to 1; 0.01 is 1 %",
                error));
    }
    if (asked.relative) {
        // Separately for each term: the range may exceed double.
        error = store.max_value() > store.min_value()
                    ? error * store.max_value() - error * store.min_value()
                    : error * 0;
    }
    require_not_negative(error, "error");
    return error;
}

double tolerance_of(const StoreReader& store) {
    return store.layout().header().rounding.tolerance;
}

double error_left(const StoreReader& store, double error) {
    const double tolerance = tolerance_of(store);
    if (tolerance == 0 || error == 0) {
        return error;
    }
    if (error < tolerance) {
        throw Error(ErrorKind::invalid_argument, {store.path().string()},
                    fmt::format("error {:.6g}: the values were rounded within {:.6g} when the "
                                "store was made; give {:.6g} or more, or 0 for full resolution",
                                error, tolerance, tolerance));
    }
    // Rounded down, so that the sum of both is at most the error.
    return error > tolerance ? std::nextafter(error - tolerance, 0.0) : 0.0;
}

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
    } else if (const auto* const budget = std::get_if<TriangleBudgetByDistance>(&stop)) {
        require_sense(*budget);
    }
}

void require_stored(const StoreReader& store, Field field, const std::string& what) {
    const StoreLayout& layout = store.layout();
    if (layout.has(field) || layout.lattice().top() == 0) {
        return;
    }
    const std::vector<Field>& there = layout.header().fields;
    std::vector<Field> wanted;
    std::copy_if(there.begin(), there.end(), std::back_inserter(wanted),
                 [](Field f) { return !is_own(f); });
    wanted.push_back(field);
    std::vector<Remedy> remedies;
    if (!is_own(field)) {
        remedies.push_back(
            {RemedyKind::make_fields, fmt::format("{}", fmt::join(names_of(wanted), ","))});
    }
    remedies.push_back(
        {RemedyKind::other_field, fmt::format("{}", fmt::join(names_of(there), ","))});
    throw Error(ErrorKind::not_found, {store.path().string()},
                fmt::format("{} needs the field {}; the store has {}", what, name_of(field),
                            there.empty() ? "none" : list_names(there)),
                std::move(remedies));
}

void require_field(const StoreReader& store, Field field, const std::string& what) {
    if (is_of_cells(field)) {
        throw Error(ErrorKind::invalid_argument, {store.path().string()},
                    fmt::format("{} needs a field of nodes; {} is a field of hexahedral cells",
                                what, name_of(field)));
    }
    require_stored(store, field, what);
}

void require_volume(const StoreReader& store) {
    if (store.layout().lattice().dimension() == 2) {
        throw Error(ErrorKind::invalid_argument, {store.path().string()}, "a slice needs a volume",
                    {{RemedyKind::graph}});
    }
}

void require_plane(const StoreReader& store) {
    const Lattice& lattice = store.layout().lattice();
    if (lattice.dimension() != 2 || lattice.nodes().z != 1) {
        throw Error(ErrorKind::invalid_argument, {store.path().string()},
                    "a graph needs data in a plane, one node along z");
    }
}

void require_contours(std::span<const double> values) {
    if (values.empty()) {
        throw Error(ErrorKind::invalid_argument, "contours: no values are given");
    }
    if (values.size() > kMaxContours) {
        throw Error(ErrorKind::limit, fmt::format("contours: {} values; at most {} at once",
                                                  values.size(), kMaxContours));
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
    return stop_at(store, field_of(asked.indicator, Cells::hexahedra), asked);
}

/// The surface at full resolution is what is simplified within a distance.
Stop cell_stop_of(const StoreReader& /*store*/, const DistanceBound& asked) {
    require_sense(asked);
    return {Field::hex_deviation, 0, 0};
}

Stop cell_stop_of(const StoreReader& /*store*/, const TriangleBudgetByDistance& asked) {
    require_sense(asked);
    return {Field::hex_deviation, 0, 0};
}

Stop cell_stop_of(const StoreReader& store, const TriangleBudgetByError& asked) {
    return cell_stop_of(store, ErrorBound{0, false, asked.indicator});
}

Stop cell_stop_of(const StoreReader& store, const FieldThreshold& asked) {
    if (!is_of_cells(asked.field)) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("hexahedral cells need a field of cells, {}; {} is not one",
                                "hex_linf or hex_deviation", name_of(asked.field)),
                    {{RemedyKind::other_field, "hex_linf,hex_deviation"}});
    }
    return stop_at(store, asked);
}

template <class Test>
Stop any_cell_stop_of(const StoreReader& store, const Test& test, CellField cell_field) {
    const Stop stop =
        std::visit([&](const auto& asked) { return cell_stop_of(store, asked); }, test);
    if (cell_field == CellField::needed ||
        (cell_field == CellField::needed_by_errors && stop.threshold > 0)) {
        require_stored(store, stop.field, "the error of hexahedral cells");
    }
    return stop;
}

}  // namespace

Stop stop_of_cells(const StoreReader& store, const isonest::StopTest& test, CellField cell_field) {
    return any_cell_stop_of(store, test, cell_field);
}

Stop stop_of_cells(const StoreReader& store, const SurfaceStop& test, CellField cell_field) {
    return any_cell_stop_of(store, test, cell_field);
}

bool is_full_resolution(const SurfaceStop& stop) {
    const auto* const bound = std::get_if<ErrorBound>(&stop);
    return bound != nullptr && bound->value == 0;
}

void require_simplifiable(const std::optional<Effort>& effort, bool may_change) {
    if (effort.value_or(Effort::none) != Effort::none && !may_change) {
        throw Error(
            ErrorKind::invalid_argument,
            "the efforts fast and best need an error above 0, a distance or a number of triangles");
    }
}

namespace {

/// Adds the field of a stop test to those that are needed. `cells`: at which the nested grid stops.
struct FieldOfStop {
    Cells cells;
    std::vector<Field>& fields;

    void operator()(const ErrorBound& stop) const {
        fields.push_back(field_of(stop.indicator, cells));
    }
    void operator()(const FieldThreshold& stop) const { fields.push_back(stop.field); }
    void operator()(const TriangleBudgetByError& stop) const {
        fields.push_back(field_of(stop.indicator, cells));
    }
    template <class Distance>
    void operator()(const Distance& /*stop*/) const {}
};

/// The fields of stop test and attributes, and those of every store.
template <class StopTest>
std::vector<Field> fields_of(const StopTest& stop, Cells cells, const MeshAttributes& attributes) {
    std::vector<Field> fields = default_indicators();
    std::visit(FieldOfStop{cells, fields}, stop);
    if (attributes.error) {
        fields.push_back(*attributes.error);
    }
    return fields;
}

/// In the order of a store, without duplicates and the values, which every store has.
std::vector<Field> in_order_of_store(std::vector<Field> fields) {
    std::sort(fields.begin(), fields.end(), precedes);
    fields.erase(std::unique(fields.begin(), fields.end()), fields.end());
    fields.erase(std::remove(fields.begin(), fields.end(), Field::values), fields.end());
    return fields;
}

}  // namespace

void require_components(const ComponentChoice& choice) {
    if (!(choice.min_volume >= 0) || !std::isfinite(choice.min_volume)) {
        throw Error(
            ErrorKind::invalid_argument,
            fmt::format("least volume {}: must be a finite number, 0 or more", choice.min_volume));
    }
}

void require_float32_places(const StoreReader& store, const LatticeSteps& steps,
                            const Double3& origin, bool has_heights) {
    const Int3 nodes = store.layout().header().nodes;
    for (int axis = 0; axis < 3; ++axis) {
        const auto a = static_cast<std::size_t>(axis);
        const bool height = axis == 2 && has_heights;
        const auto ends =
            height ? value_range(store) : std::array{0.0, static_cast<double>(nodes[axis] - 1)};
        const auto reach =
            height || !steps.is_sheared()
                ? std::array{origin[a] + steps.offset(a, ends[0]),
                             origin[a] + steps.offset(a, ends[1])}
                : reach_of({0, 0, 0},
                           {static_cast<double>(nodes.x - 1), static_cast<double>(nodes.y - 1),
                            static_cast<double>(nodes.z - 1)},
                           steps, origin, a);
        for (const double end : reach) {
            require_float32(
                store, end,
                fmt::format("the {} reaches {} =", height ? "graph" : "volume", "xyz"[a]),
                height ? Remedy{RemedyKind::other_scale}
                       : Remedy{RemedyKind::place_in_world, "spacing,origin"});
        }
    }
}

void require_float32_values(const StoreReader& store) {
    for (const double end : value_range(store)) {
        require_float32(store, end, "values reach", {RemedyKind::scale_values});
    }
}

}  // namespace isonest::detail

namespace isonest {

std::vector<Field> fields_needed(const SurfaceQuery& query) {
    using namespace detail;
    // Hexahedra are simplified from full resolution, which needs no field of cells.
    const bool stops_at_cells =
        features_of(query).test(static_cast<std::size_t>(Feature::coarse_hexahedra));
    std::vector<Field> fields = fields_of(
        query.stop, stops_at_cells ? Cells::hexahedra : Cells::tetrahedra, query.attributes);
    if (query.grid.bound) {
        fields.push_back(*query.grid.bound);
    }
    if (query.grid.culling) {
        fields.push_back(query.grid.culling->field.value_or(Field::normal_turn_plus));
    }
    return in_order_of_store(std::move(fields));
}

std::vector<Field> fields_needed(const SliceQuery& query) {
    using namespace detail;
    return in_order_of_store(fields_of(query.stop, query.cells, query.attributes));
}

std::vector<Field> fields_needed(const GraphQuery& query) {
    using namespace detail;
    return in_order_of_store(fields_of(query.stop, query.cells, query.attributes));
}

}  // namespace isonest
