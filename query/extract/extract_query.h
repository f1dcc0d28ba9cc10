// What a query asks of a store, in lattice terms: one form for all products.
#pragma once

#include <filesystem>
#include <optional>
#include <vector>

#include <isonest/extract.h>

#include "query/traverse/traversal.h"
#include "store/container/reader.h"

namespace isonest::detail {

/// What is extracted.
enum class Product : std::uint8_t { surface, isolines, slice, contours, graph };

struct ExtractQuery {
    Product product = Product::surface;
    TraversalQuery traversal;
    double threshold = 0;  ///< of the stop field, in its own units
    /// Of the mesh: world coordinates are origin + spacing * position.
    Double3 spacing{1, 1, 1};
    Double3 origin{};
    double coordinate_rounding = 0;       ///< as in the report
    const StoreReader* values = nullptr;  ///< where vertex values are from, if not the store
    double graph_scale = 1;               ///< of a graph
    /// Of a surface: the distance within which it is simplified, world units, and how many
    /// triangles it may have.
    std::optional<double> distance;
    std::optional<std::uint64_t> triangles;
    /// Of a surface: the distance at which elements of the nested grid stop, world units; > 0.
    std::optional<double> nested_distance;
    /// Of a surface: the error within which it is simplified, in units of the data; > 0.
    std::optional<double> value_limit;
    std::optional<ComponentChoice> components;
    /// The folder of a kept analysis, if there is to be one.
    std::optional<std::filesystem::path> analysis_folder;
    std::vector<double> contours;  ///< values of contour lines
    /// In place of the store's values those of a LabelView.
    std::optional<LabelChoice> label;

    /// Corners of an element.
    [[nodiscard]] int corners() const {
        return product == Product::isolines || product == Product::contours ? 2 : 3;
    }
};

/// Refuses what makes no sense for this store. `float64`: whether the mesh holds it. Throws
/// Error{invalid_argument, not_found, limit} as extract() does.
ExtractQuery extract_query(const StoreReader& store, const SurfaceQuery& query, bool float64);
ExtractQuery extract_query(const StoreReader& store, const SliceQuery& query, bool float64);
ExtractQuery extract_query(const StoreReader& store, const ContourQuery& query, bool float64);
ExtractQuery extract_query(const StoreReader& store, const GraphQuery& query, bool float64);

}  // namespace isonest::detail
