// The interfaces between smooth labels, simplified, and the meshes that are cut from them.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include <isonest/extract.h>

#include "query/extract/extract_query.h"
#include "query/ranks/cube_shares.h"
#include "query/simplify/collapse/map_mesh.h"
#include "query/simplify/collapse/sheet_mesh.h"
#include "query/surface_nets/net_mesh.h"
#include "query/surface_nets/net_store.h"
#include "store/base/memory.h"
#include "store/container/format.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

/// Levels of detail after the finest one: each is within twice the distance of the previous one.
struct DetailSetting {
    double rounding = 0;     ///< later movement of positions at level 0 by rounding, world units;
                             ///< doubles with each level
    int most = 1;            ///< maximum number of levels, including the finest one
    std::uint64_t heap = 0;  ///< bytes needed to make a mesh's levels
};

/// Whether a level of detail has sufficiently fewer triangles than the previous one.
inline bool is_worth_a_level(std::uint64_t before, std::uint64_t triangles) {
    return triangles <= before - before / 4 && triangles < before;
}

struct SheetSetting {
    const StoreHeader& header;
    /// For the finest level; nothing: it is the whole net. Successive mappings for every effort.
    std::optional<DistanceChoice> distance = {};
    bool keeps_nodes = false;  ///< see LabelSmoothing::keep_nodes
    MemoryShare memory;
    RankTeam* team = nullptr;                   ///< shares the blocks, or null
    std::span<const std::int64_t> wanted = {};  ///< labels of the net, ascending
    std::int64_t outside = -1;                  ///< number of unlabelled space
    double rounding = 0;                        ///< maximum rounding error of a vertex, world units
    std::string name;                           ///< of the store
    std::optional<DetailSetting> details = {};
};

/// Thread-safety: constant once it is made.
class LabelSheets {
  public:
    /// `net`: sealed, with pieces that have sides. All arguments except `folder` must outlive it.
    /// Throws Error{limit} if rounding leaves nothing of the distance, if there is too little
    /// memory, or if there are too many triangles at any distance; Error{io, cancelled}.
    LabelSheets(const NetStore& net, SheetSetting setting, const ScratchFolder& folder,
                Progress& progress);

    /// 1 without details.
    [[nodiscard]] int levels() const { return static_cast<int>(levels_.size()); }
    /// Distance of a level from the whole net; if `asked` is 0, nothing is simplified.
    [[nodiscard]] const DistanceReport& distance(int level = 0) const {
        return levels_[static_cast<std::size_t>(level)]->distance;
    }
    /// The requested distance of a level: that of level 0, or a quarter of a voxel if that is more,
    /// doubled with each level.
    [[nodiscard]] double scale(int level) const;
    [[nodiscard]] std::optional<bool> within_budget() const { return within_budget_; }

    /// Like emit_net_interfaces() and emit_net_mesh() for the whole net. `number`: of a wanted
    /// label. REQUIRES for level 0: it is simplified.
    NetMesh emit_all(MeshLayout layout, MeshSink& sink, const Progress& progress) const;
    NetMesh emit_label(std::size_t number, int level, MeshLayout layout, MeshSink& sink,
                       const Progress& progress) const;
    /// Number of triangles of that label at a level. REQUIRES: as above.
    [[nodiscard]] std::uint64_t triangles(std::size_t number, int level) const {
        return output(level).triangles(number);
    }
    /// The areas that a wanted label shares with each other label, and with the outside. REQUIRES:
    /// level 0 is simplified.
    [[nodiscard]] std::map<std::int64_t, double> areas(std::size_t number) const {
        return output(0).areas(number);
    }

  private:
    struct Level {
        DistanceReport distance;
        std::optional<CornerFile> corners;
        std::optional<SheetOutput> output;
    };
    [[nodiscard]] double rounding_of(int level) const;
    [[nodiscard]] std::optional<double> margin() const;
    void simplify(BlockMapping& mapping, const ScratchFolder& folder, Progress& progress);
    Mapped finest(const MeshMapper& mapper);
    void add_details(const MeshMapper& mapper, Mapped mapped);
    [[nodiscard]] const SheetOutput& output(int level) const {
        return *levels_[static_cast<std::size_t>(level)]->output;
    }

    const NetStore& net_;
    SheetSetting setting_;
    std::array<std::int64_t, 2> sides_range_{};
    double first_scale_ = 0;
    SheetMesh sheets_;
    std::vector<std::unique_ptr<Level>> levels_;
    std::optional<bool> within_budget_;
};

}  // namespace isonest::detail
