// The surface net of some labels of a store, and the meshes that come out of it.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <vector>

#include <isonest/extract.h>

#include "query/extract/labels/label_sheets.h"
#include "query/surface_nets/make_net.h"
#include "query/surface_nets/net_mesh.h"
#include "query/surface_nets/net_store.h"
#include "store/container/reader.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

/// Most by which a coordinate of the meshes is rounded, in distances of neighbouring nodes: they
/// reach half such a distance beyond the nodes, and are turned if the volume is.
double net_rounding(const StoreHeader& header);

/// What a net is for, beside meshes of labels.
struct NetUse {
    bool interfaces = false;                    ///< their mesh is asked for
    std::optional<DetailSetting> details = {};  ///< meshes of labels come in these levels
};

/// Thread-safety: constant once it is made.
class LabelNet {
  public:
    /// In which axes a mesh's coordinates are, where the volume is turned.
    enum class Axes { world, own };

    /// `labels`: those that get meshes, ascending. What is given has to stay. Throws what
    /// make_net() and LabelSheets throw.
    LabelNet(const StoreReader& store, std::span<const Label> labels, const LabelQuery& query,
             const ExtractOptions& options, const NetUse& use, Progress& progress);

    /// For as many meshes at a time there is memory.
    [[nodiscard]] int threads() const { return threads_; }
    /// As MeshSink::prepare() takes it, of labels.
    [[nodiscard]] const MeshLayout& layout() const { return layout_; }
    /// What the mesh of interfaces calls what is no label.
    [[nodiscard]] std::int64_t outside() const { return outside_; }

    /// The mesh of labels[number], to its sink. Throws what the sink throws, Error{io, cancelled}.
    ExtractReport emit_label(std::size_t number, MeshSink& sink, const Progress& progress,
                             Axes axes = Axes::world) const;
    /// The mesh of all interfaces, likewise.
    ExtractReport emit_interfaces(MeshSink& sink, const Progress& progress) const;

    /// Levels of detail, of which emit_label() gives the first one; 1 if none are asked for.
    [[nodiscard]] int levels() const { return sheets_ ? sheets_->levels() : 1; }
    /// The distance of a level as asked for, and as proven, without what details are rounded.
    /// REQUIRES: details are asked for.
    [[nodiscard]] double scale(int level) const { return sheets_->scale(level); }
    [[nodiscard]] double bound(int level) const { return sheets_->distance(level).bound; }
    /// Of labels[number] at a level.
    [[nodiscard]] std::uint64_t triangles(std::size_t number, int level) const;
    /// Its mesh, as emit_label() gives it, in the volume's own axes. REQUIRES: level > 0.
    NetMesh emit_level(std::size_t number, int level, MeshSink& sink,
                       const Progress& progress) const {
        return sheets_->emit_label(number, level, layout_, sink, progress);
    }
    /// Where temporary files lie.
    [[nodiscard]] const ScratchFolder& scratch() const { return scratch_; }

    /// Calls `each` with every interface, as each_interface().
    void each_interface_of(const std::function<void(const SharedArea&)>& each) const;

  private:
    [[nodiscard]] ExtractReport begun_report(const NetCounts& counts) const;
    ExtractReport emit_measured(
        MeshSink& sink, Axes axes,
        const std::function<NetMesh(MeshSink&, ExtractReport&)>& emit) const;
    NetMesh emit_kept(std::int64_t label, MeshSink& sink, ExtractReport& report,
                      const Progress& progress) const;
    void report_neighbours(std::size_t number, ExtractReport& report,
                           const Progress& progress) const;

    const StoreReader& store_;
    const LabelQuery& query_;
    const ExtractOptions& options_;
    MeshLayout layout_;
    double rounding_;  ///< as of net_rounding()
    std::int64_t outside_;
    std::vector<std::int64_t> wanted_;  ///< the labels
    ScratchFolder scratch_;
    std::optional<NetStore> net_;
    bool is_simplified_;                 ///< what emit_label() and emit_interfaces() give
    std::optional<LabelSheets> sheets_;  ///< if it is, or in levels of detail
    ExtractReport begun_;
    int threads_ = 1;
};

}  // namespace isonest::detail
