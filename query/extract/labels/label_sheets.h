// The interfaces between smooth labels, simplified, and the meshes that are cut from them.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include <isonest/extract.h>

#include "query/simplify/mapping/block_mapping.h"
#include "query/simplify/mapping/map_mesh.h"
#include "query/simplify/sheets/sheet_mesh.h"
#include "query/simplify/sheets/sheet_output.h"
#include "query/surface_nets/net_mesh.h"
#include "query/surface_nets/net_store.h"
#include "store/container/format.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

/// Levels of detail behind the finest one: each is within twice the distance of the one before.
struct DetailSetting {
    double rounding = 0;     ///< what places will be moved at level 0, world units; doubles
    int most = 1;            ///< levels, with the finest one
    std::uint64_t heap = 0;  ///< bytes that making a mesh's levels needs
};

/// Whether a level of detail has enough triangles less than the one before.
inline bool is_worth_a_level(std::uint64_t before, std::uint64_t triangles) {
    return triangles <= before - before / 4 && triangles < before;
}

struct SheetSetting {
    const StoreHeader& header;
    const LabelQuery& query;  ///< with smooth, and with a stop if it simplifies
    const ExtractOptions& options;
    std::span<const std::int64_t> wanted;  ///< labels of the net, ascending
    std::int64_t outside = -1;             ///< what is no label
    double rounding = 0;                   ///< most by which a vertex was rounded, world units
    std::string name;                      ///< of the store
    std::optional<DetailSetting> details = {};
    bool is_finest_simplified = true;  ///< by the query's stop
};

/// Thread-safety: constant once it is made.
class LabelSheets {
  public:
    /// `net`: sealed, of pieces with sides. All but `folder` have to stay. Throws Error{limit} if
    /// rounding leaves nothing of the distance, if there is too little memory, or if there are more
    /// triangles at any distance than asked for; Error{io, cancelled}.
    LabelSheets(const NetStore& net, const SheetSetting& setting, const ScratchFolder& folder,
                Progress& progress);

    /// 1 without details.
    [[nodiscard]] int levels() const { return static_cast<int>(levels_.size()); }
    /// How far a level is from the whole net; nothing is simplified where asked is 0.
    [[nodiscard]] const DistanceReport& distance(int level = 0) const {
        return levels_[static_cast<std::size_t>(level)]->distance;
    }
    /// What the distance of a level is to be: that of level 0, or a quarter of a voxel if that is
    /// more, doubled so often.
    [[nodiscard]] double scale(int level) const;
    [[nodiscard]] std::optional<bool> within_budget() const { return within_budget_; }

    /// As emit_net_interfaces() and emit_net_mesh() do with the whole net. `number`: of a wanted
    /// label. REQUIRES of level 0: it is simplified.
    NetMesh emit_all(MeshLayout layout, MeshSink& sink, const Progress& progress) const;
    NetMesh emit_label(std::size_t number, int level, MeshLayout layout, MeshSink& sink,
                       const Progress& progress) const;
    /// How many that label has at a level. REQUIRES: as above.
    [[nodiscard]] std::uint64_t triangles(std::size_t number, int level) const {
        return output(level).triangles(number);
    }
    /// The area that a wanted label shares with each other, and with the outside. REQUIRES: level 0
    /// is simplified.
    [[nodiscard]] std::map<std::int64_t, double> areas(std::size_t number) const {
        return output(0).areas(number);
    }

  private:
    struct Level {
        DistanceReport distance;
        std::optional<CornerFile> corners;
        std::optional<SheetOutput> output;
    };
    void simplify(const SheetSetting& setting, BlockMapping& mapping, const ScratchFolder& folder,
                  Progress& progress);
    Mapped finest(const SheetSetting& setting, const MeshMapper& mapper);
    void add_details(const SheetSetting& setting, const MeshMapper& mapper, Mapped mapped);
    [[nodiscard]] const SheetOutput& output(int level) const {
        return *levels_[static_cast<std::size_t>(level)]->output;
    }

    const NetStore& net_;
    std::span<const std::int64_t> wanted_;
    std::array<std::int64_t, 2> sides_range_{};
    double first_scale_ = 0;
    SheetMesh sheets_;
    std::vector<std::unique_ptr<Level>> levels_;
    std::optional<bool> within_budget_;
};

}  // namespace isonest::detail
