// What a query asks of a store, in lattice terms: one form for all products.
#pragma once

#include <filesystem>
#include <optional>
#include <vector>

#include <isonest/extract.h>
#include <isonest/volume_source.h>

#include "query/apart/keep_apart.h"
#include "query/traverse/traversal.h"
#include "store/container/reader.h"

namespace isonest::detail {

/// What is extracted.
enum class Product : std::uint8_t { surface, isolines, slice, contours, graph };

/// The distance within which a surface is simplified.
struct DistanceChoice {
    double within = 0;                       ///< world units; 0 = not simplified
    std::optional<std::uint64_t> triangles;  ///< how many it may have
    Effort effort = Effort::best;
};

/// What is done to the whole mesh, beside closing it (traversal.box.close).
struct StageChoice {
    std::optional<ComponentChoice> components;
    std::optional<DistanceChoice> distance;
    std::optional<double> error;  ///< within which it is simplified, in units of the data; > 0

    /// Whether there is anything to do beside mending.
    [[nodiscard]] bool any() const { return components || simplifies() || error; }
    /// Whether it is simplified within a distance.
    [[nodiscard]] bool simplifies() const { return distance && distance->within > 0; }
};

struct ExtractQuery {
    Product product = Product::surface;
    TraversalQuery traversal;
    double threshold = 0;  ///< of the stop field, in its own units
    /// Of a surface: the distance at which elements of the nested grid stop, world units; > 0.
    std::optional<double> nested_distance;
    /// In place of the store's values those of a LabelView.
    std::optional<LabelChoice> label;
    /// The traversal's box before it was narrowed to where the label is, if it was.
    std::optional<ClipBox> asked_box;
    std::vector<double> contours;  ///< values of contour lines
    double graph_scale = 1;        ///< of a graph
    /// Of the mesh: world coordinates are origin + spacing * position.
    Double3 spacing{1, 1, 1};
    Double3 origin{};
    double coordinate_rounding = 0;       ///< as in the report
    std::optional<Turn> turn;             ///< of a volume that is not along the world's axes
    double least_apart = kLeastApart;     ///< least step by which vertices are kept apart
    bool moves_apart = true;              ///< else they stay together
    const StoreReader* values = nullptr;  ///< where vertex values are from, if not the store
    StageChoice stages;
    /// The folder of a kept analysis, if there is to be one.
    std::optional<std::filesystem::path> analysis_folder;

    /// Corners of an element.
    [[nodiscard]] int corners() const {
        return product == Product::isolines || product == Product::contours ? 2 : 3;
    }
    /// Whether no two vertices may lie in one place.
    [[nodiscard]] bool keeps_apart() const {
        return product == Product::surface || product == Product::slice;
    }
    /// As in the report.
    [[nodiscard]] std::optional<double> asked_distance() const {
        return nested_distance   ? nested_distance
               : stages.distance ? std::optional(stages.distance->within)
                                 : std::nullopt;
    }
};

/// In world units; voxels are the least distances between neighbouring nodes.
double world_distance(const StoreHeader& header, const DistanceBound& asked);

/// What is left of a distance, world units, where float32 moves vertices by up to `moved`. `name`:
/// of the store. Throws Error{limit} if that is nothing.
double distance_left(const std::string& name, double distance, double moved);

/// Refuses what makes no sense for this store. `float64`: whether the mesh holds it. Throws
/// Error{invalid_argument, not_found, limit} as extract() does. REQUIRES: the stop of a surface is
/// no ErrorBudget.
ExtractQuery extract_query(const StoreReader& store, const SurfaceQuery& query, bool float64);
ExtractQuery extract_query(const StoreReader& store, const LabelQuery& query, bool float64);
/// Of a volume without a store, in its own axes. Throws Error{unsupported} too.
ExtractQuery extract_query(const VolumeDescription& volume, const SurfaceQuery& query);
ExtractQuery extract_query(const StoreReader& store, const SliceQuery& query, bool float64);
ExtractQuery extract_query(const StoreReader& store, const ContourQuery& query, bool float64);
ExtractQuery extract_query(const StoreReader& store, const GraphQuery& query, bool float64);

}  // namespace isonest::detail
