// The report of an extraction. It is assembled only here, from the results of the steps.
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <vector>

#include <isonest/extract.h>

#include "query/apart/manifold_sink.h"
#include "query/extract/extract_query.h"
#include "query/extract/stages/stage.h"
#include "query/mesh/measuring_sink.h"
#include "query/mesh/mesh_sinks.h"
#include "query/mesh/scratch_mesh.h"
#include "query/surface_nets/make_net.h"
#include "query/surface_nets/net_mesh.h"
#include "query/traverse/traversal.h"
#include "store/container/analysis_file.h"
#include "store/container/reader.h"

namespace isonest::detail {

struct JoinedMesh;
struct SettledMesh;

/// The result of a traversal, over all ranks that shared it.
struct TraversalResult {
    TraversalCounts counts;
    std::uint64_t chunks_read = 0;
    std::uint64_t bytes_read = 0;
    std::uint64_t peak_cache_bytes = 0;
    bool has_missing = false;                ///< values, in the volume
    std::optional<double> value_range = {};  ///< of a volume without a store
};

/// Sums the results of the steps of one extraction, and tracks the position of its mesh.
class ReportSum {
  public:
    /// `store`: null for a volume without one, with `nodes` nodes.
    ReportSum(const ExtractQuery& query, const StoreReader* store, const Int3& nodes,
              const TraversalResult& traversal);

    void add(const StageResult& stage);
    void add(const EmittedMesh& mesh);
    /// Position of the mesh after the steps so far.
    [[nodiscard]] const MeshPlace& place() const { return place_; }
    /// The complete report except for measures, time, and changes by rotation.
    [[nodiscard]] ExtractReport sum(std::uint64_t scratch_bytes) const;

  private:
    bool shows_values_;  ///< the rounding of values is part of the error
    bool stops_at_distance_;
    MeshPlace place_;
    ExtractReport report_;
};

/// The report with the measurements made on the way to a sink.
ExtractReport measured(ExtractReport report, const MeasuringSink& sink);

/// The report with what was found on the way to a sink, and with the vertices that were added.
ExtractReport with_manifold(ExtractReport report, const ManifoldSink& sink);

/// Measures the triangles of a mesh in the volume's own axes, and rotates it into the world's, on
/// its way to a sink.
class WorldOutput {
  public:
    /// Sink and progress must outlive it. Throws Error{invalid_argument} for isolines that are to
    /// be a manifold.
    WorldOutput(MeshSink& sink, const ExtractQuery& query, const ExtractOptions& options,
                const Progress& progress);

    [[nodiscard]] MeshSink& sink();
    /// The report for the mesh that was passed to sink(). Rotation rounds positions again and may
    /// leave triangles without area.
    [[nodiscard]] ExtractReport report(ExtractReport report) const;

  private:
    std::optional<ManifoldSink> manifold_;
    MeshSink& sink_;
    LatticeSteps steps_;
    std::optional<RotatedSink> turning_;
    std::optional<MeasuringSink> measuring_;
};

/// The result of an extraction from a kept analysis.
struct AnalysedMesh {
    AnalysisReport analysis = {};
    EmittedMesh mesh = {};
    double asked = 0;  ///< distance, world units
    double bound = 0;
    std::optional<bool> within_budget = {};
};

ExtractReport analysed(const ExtractQuery& query, const StoreReader& store,
                       const AnalysedSurface& surface, const AnalysedMesh& mesh,
                       std::uint64_t scratch_bytes);

/// Properties of a surface net that are the same for all of its meshes.
struct SmoothedNet {
    const StoreReader& store;
    const LabelSmoothing& smoothing;
    std::optional<Outside> close;
    NetCounts counts;
    double rounding = 0;  ///< of coordinates, as a multiple of the distance between neighbouring
                          ///< nodes
};

/// A mesh made from a surface net.
struct LabelMesh {
    NetMesh net;
    std::optional<ComponentReport> components = {};
    std::optional<DistanceReport> distance = {};  ///< if it was simplified
    std::optional<bool> within_budget = {};
    std::vector<NeighbourLabel> neighbours = {};
};

/// The report for such a mesh.
ExtractReport smoothed(const SmoothedNet& net, LabelMesh mesh, std::uint64_t scratch_bytes);

/// The report for a label's finest mesh after rounding in the cells of an octree, by at most `by`
/// (as a multiple of the distance between neighbouring nodes) and `by_in_world` (world units).
ExtractReport in_cells(ExtractReport report, double by, double by_in_world,
                       std::uint64_t scratch_bytes);

/// The report for the mesh of all interfaces.
ExtractReport with_interfaces(ExtractReport report, const InterfaceReport& interfaces);

/// The report with the seconds since `start`.
ExtractReport timed(ExtractReport report, std::chrono::steady_clock::time_point start);

/// The report for a volume that was marched into arrays. `rounding`: of its lattice's coordinates.
ExtractReport marched(const MeshLayout& layout, const JoinedMesh& joined,
                      const SettledMesh& settled, double rounding, double value_range,
                      std::uint64_t scratch_bytes);

}  // namespace isonest::detail
