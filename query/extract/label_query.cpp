#include "query/extract/label_query.h"

#include <fmt/format.h>

#include <algorithm>

#include <isonest/error.h>
#include <isonest/value_type.h>

#include "query/view/label_view.h"

namespace isonest::detail {
namespace {

/// The other products, and what makes a surface coarser, are of values.
void require_label(const StoreReader& store, const SurfaceQuery& query, const ExtractQuery& asked) {
    const auto refuse = [&](const char* what) {
        throw Error(ErrorKind::invalid_argument, {store.path().string()}, what);
    };
    if (asked.product != Product::surface) {
        refuse("labels have surfaces in a volume, with more than one node along each axis");
    }
    if (asked.threshold > 0 || asked.value_limit || asked.nested_distance ||
        std::holds_alternative<FieldThreshold>(query.stop) ||
        std::holds_alternative<ErrorBudget>(query.stop)) {
        refuse(
            "the errors of a store are those of values, not of labels; ask for a distance or a "
            "number of triangles within one");
    }
    if (query.focus || query.camera || query.culling || query.analysis ||
        query.vertices == VertexPlace::exact) {
        refuse(
            "the surface of a label goes with neither focus, camera, backfaces, exact vertices "
            "nor an analysis");
    }
}

}  // namespace

void choose_label(const StoreReader& store, const SurfaceQuery& query, ExtractQuery& asked) {
    require_label(store, query, asked);
    const LabelChoice& label = *query.label;
    const StoreHeader& header = store.layout().header();
    if (!is_label(header, label.id)) {
        throw Error(
            ErrorKind::invalid_argument, {store.path().string()},
            fmt::format("label {}: the store's values are {}", label.id,
                        header.labels ? "labels from 0 to 2^62 - 1" : name_of(header.type)));
    }
    constexpr double kHalf = 0.5;
    asked.traversal.iso = kHalf;
    asked.label = label;
    const Int3 last = header.nodes - Int3{1, 1, 1};
    if (!label.within) {
        asked.label->within = {Int3{}, last};
        return;
    }
    const auto& [low, high] = *asked.label->within;
    for (int axis = 0; axis < 3; ++axis) {
        const auto a = static_cast<std::size_t>(axis);
        ClipBox& box = asked.traversal.box;
        const bool reached = box.lo[a] < static_cast<double>(high[axis] + 1) &&
                             box.hi[a] > static_cast<double>(low[axis] - 1);
        if (reached) {
            box.lo[a] = std::max(box.lo[a], static_cast<double>(low[axis] - 1));
            box.hi[a] = std::min(box.hi[a], static_cast<double>(high[axis] + 1));
        }
    }
}

}  // namespace isonest::detail
