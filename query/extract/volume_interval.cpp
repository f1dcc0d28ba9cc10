// Section 3 of the paper: |U - U^l| <= E everywhere, for the finest function U and the one of the
// nested grid that the error E gives. So the solid {U^l >= c + E} lies in {U >= c}, and that in
// {U^l >= c - E}. The nested grid is the same for all isovalues: both outer solids are what the
// same query extracts at c + E and c - E, and their volumes hold the one between them.
//
// Coordinates of a mesh are rounded, each vertex is off by at most d. While the vertices move
// straight from their exact places to the rounded ones, the area is at most the final area A and,
// for each of the n triangles, whose edges are at most L + 2 d long, 2 d (L + 3 d) more; and the
// volume changes by at most d times the area. The sum of volumes (query/mesh/surface_sums.cpp)
// adds L A 2^-49 for the rounding of its terms in float64, and n L^3 2^-58 for that to integers.
#include "query/extract/volume_interval.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "store/base/vector3.h"
#include "store/container/extent.h"
#include "store/container/reader.h"

namespace isonest::detail {
namespace {

/// Keeps nothing of a mesh.
class NoMesh : public MeshSink {
  public:
    void begin(const MeshLayout& /*layout*/) override {}
    void add_vertices(const VertexBatch& /*batch*/) override {}
    void add_elements(const ElementBatch& /*batch*/) override {}
    [[nodiscard]] bool concurrent() const override { return true; }
};

/// The error's guarantee.
Guarantee guarantee_of(const SurfaceStop& stop) {
    if (const auto* const bound = std::get_if<ErrorBound>(&stop)) {
        return bound->guarantee;
    }
    if (const auto* const simplified = std::get_if<SimplifiedErrorBound>(&stop)) {
        return simplified->bound.guarantee;
    }
    return std::get<ErrorBudget>(stop).guarantee;
}

/// By how much the volume of a mesh is off, at most.
double rounding_of(const ExtractReport& r, const StoreHeader& header) {
    const double longest = diagonal_of(header);
    const double moved = r.coordinate_rounding * length(header.spacing);
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
    outer.stop = ErrorBound{tolerance, false, guarantee_of(query.stop)};
    const auto extracted = [&](double iso) {
        outer.iso = iso;
        NoMesh nowhere;
        return extract(store, outer, nowhere, options, progress);
    };
    constexpr double kInfinity = std::numeric_limits<double>::infinity();
    const ExtractReport above = extracted(std::nextafter(query.iso + tolerance, kInfinity));
    const ExtractReport below = extracted(std::nextafter(query.iso - tolerance, -kInfinity));
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

}  // namespace isonest::detail
