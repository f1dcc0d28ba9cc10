// The surface net of some labels of a store, and the meshes made from it.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include <isonest/extract.h>

#include "query/extract/combinations.h"
#include "query/extract/extract_query.h"
#include "query/extract/labels/label_sheets.h"
#include "query/extract/report.h"
#include "query/surface_nets/make_net.h"
#include "query/surface_nets/net_mesh.h"
#include "query/surface_nets/net_store.h"
#include "store/container/reader.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

/// Maximum rounding error of a coordinate of the meshes, as a multiple of the distance between
/// neighbouring nodes: meshes extend half that distance beyond the nodes, and are rotated if the
/// volume is.
double net_rounding(const StoreHeader& header);

/// The phase in which meshes are made from a net.
inline constexpr const char* kWriteLabels = "write mesh";

/// Calls work(i) for each of so many labels, on these threads, and reports the progress.
void each_label(const char* phase, int threads, std::size_t labels, Progress& progress,
                const std::function<void(std::size_t)>& work);

/// What a net is used for, besides meshes of labels.
struct NetUse {
    bool interfaces = false;                    ///< the mesh of all interfaces is requested
    std::optional<DetailSetting> details = {};  ///< meshes of labels are made at these levels
};

/// What is asked of smooth labels.
struct SmoothChoice {
    LabelSmoothing smoothing;
    std::optional<Outside> close;
    std::optional<ComponentChoice> components;
    std::optional<DistanceChoice> distance = {};  ///< if meshes are simplified
    bool manifold = false;                        ///< see SurfaceStages
};

/// Rejects queries that are invalid for this store. `feature`: what is requested in addition to
/// meshes of labels. Throws Error{invalid_argument, limit}. REQUIRES: query.smooth.
SmoothChoice smooth_choice(const StoreReader& store, const LabelQuery& query,
                           std::optional<Feature> feature = {});

/// Thread-safety: constant once it is made.
class LabelNet {
  public:
    /// The axes of a mesh's coordinates, if the volume is rotated.
    enum class Axes { world, own };

    /// `labels`: those that get meshes, ascending. The arguments must outlive it. Throws what
    /// make_net() and LabelSheets throw.
    LabelNet(const StoreReader& store, std::span<const Label> labels, const SmoothChoice& choice,
             const ExtractOptions& options, const NetUse& use, Progress& progress);

    /// The number of concurrent meshes for which there is memory.
    [[nodiscard]] int threads() const { return threads_; }
    /// The number for unlabelled space in the mesh of interfaces.
    [[nodiscard]] std::int64_t outside() const { return outside_; }

    /// Outputs the mesh of labels[number] to its sink. Throws what the sink throws, Error{io,
    /// cancelled}.
    ExtractReport emit_label(std::size_t number, MeshSink& sink, const Progress& progress,
                             Axes axes = Axes::world) const;
    /// The same after the sink's prepare().
    ExtractReport write_label(std::size_t number, MeshSink& sink, const Progress& progress) const;
    /// Outputs the mesh of all interfaces, like emit_label().
    ExtractReport emit_interfaces(MeshSink& sink, const Progress& progress) const;

    /// Number of levels of detail, the first of which is made by emit_label(); 1 if none are
    /// requested.
    [[nodiscard]] int levels() const { return sheets_ ? sheets_->levels() : 1; }
    /// The requested and the proven distance of a level, without the rounding of details. REQUIRES:
    /// details are requested.
    [[nodiscard]] double scale(int level) const { return sheets_->scale(level); }
    [[nodiscard]] double bound(int level) const { return sheets_->distance(level).bound; }
    /// Number of triangles of labels[number] at a level.
    [[nodiscard]] std::uint64_t triangles(std::size_t number, int level) const;
    /// Outputs its mesh like emit_label(), in the volume's own axes. REQUIRES: level > 0.
    NetMesh emit_level(std::size_t number, int level, MeshSink& sink,
                       const Progress& progress) const {
        return sheets_->emit_label(number, level, layout_, sink, progress);
    }
    /// The folder of temporary files.
    [[nodiscard]] const ScratchFolder& scratch() const { return scratch_; }

    /// Calls `each` for every interface, like each_interface().
    void each_interface_of(const std::function<void(const SharedArea&)>& each) const;

  private:
    ExtractReport emit_measured(MeshSink& sink, Axes axes,
                                const std::function<LabelMesh(MeshSink&)>& emit) const;
    ExtractReport emit_counted(MeshSink& sink, Axes axes, const Progress& progress,
                               const std::function<LabelMesh(MeshSink&)>& emit) const;
    [[nodiscard]] LabelMesh emit_kept(std::int64_t label, MeshSink& sink,
                                      const Progress& progress) const;
    [[nodiscard]] LabelMesh emit_simplified(std::size_t number, MeshSink& sink,
                                            const Progress& progress) const;

    const StoreReader& store_;
    SmoothChoice choice_;
    bool with_quality_;
    MeshLayout layout_;
    double rounding_;  ///< see net_rounding()
    std::int64_t outside_;
    std::vector<std::int64_t> wanted_;  ///< the labels
    ScratchFolder scratch_;
    std::optional<NetStore> net_;
    bool is_simplified_;  ///< whether emit_label() and emit_interfaces() output simplified meshes
    std::optional<LabelSheets> sheets_;  ///< if simplified, or with levels of detail
    NetCounts counts_;
    int threads_ = 1;
};

}  // namespace isonest::detail
