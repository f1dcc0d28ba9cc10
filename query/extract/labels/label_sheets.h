// The interfaces between smooth labels, simplified, and the meshes that are cut from them.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <span>

#include <isonest/extract.h>

#include "query/simplify/mapping/block_mapping.h"
#include "query/simplify/sheets/sheet_mesh.h"
#include "query/simplify/sheets/sheet_output.h"
#include "query/surface_nets/net_mesh.h"
#include "query/surface_nets/net_store.h"
#include "store/container/format.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

struct SheetSetting {
    const StoreHeader& header;
    const LabelQuery& query;  ///< with smooth and stop
    const ExtractOptions& options;
    std::span<const std::int64_t> wanted;  ///< labels of the net, ascending
    std::int64_t outside = -1;             ///< what is no label
    double rounding = 0;                   ///< most by which a vertex was rounded, world units
    std::string name;                      ///< of the store
};

/// Thread-safety: constant once it is made.
class LabelSheets {
  public:
    /// `net`: sealed, of pieces with sides. All but `folder` have to stay. Throws Error{limit} if
    /// rounding leaves nothing of the distance, if there is too little memory, or if there are more
    /// triangles at any distance than asked for; Error{io, cancelled}.
    LabelSheets(const NetStore& net, const SheetSetting& setting, const ScratchFolder& folder,
                Progress& progress);

    [[nodiscard]] const DistanceReport& distance() const { return distance_; }
    [[nodiscard]] std::optional<bool> within_budget() const { return within_budget_; }

    /// As emit_net_interfaces() and emit_net_mesh() do with the whole net. `number`: of a wanted
    /// label.
    NetMesh emit_all(MeshLayout layout, MeshSink& sink, const Progress& progress) const;
    NetMesh emit_label(std::size_t number, MeshLayout layout, MeshSink& sink,
                       const Progress& progress) const;
    /// The area that a wanted label shares with each other, and with the outside.
    [[nodiscard]] std::map<std::int64_t, double> areas(std::size_t number) const {
        return output_->areas(number);
    }

  private:
    void simplify(const SheetSetting& setting, BlockMapping& mapping, const ScratchFolder& folder,
                  Progress& progress);

    const NetStore& net_;
    std::span<const std::int64_t> wanted_;
    std::array<std::int64_t, 2> sides_range_{};
    SheetMesh sheets_;
    std::optional<CornerFile> corners_;
    std::optional<SheetOutput> output_;
    DistanceReport distance_;
    std::optional<bool> within_budget_;
};

}  // namespace isonest::detail
