#include "query/extract/labels/label_sheets.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include <isonest/error.h>

#include "query/extract/extract_query.h"
#include "query/ranks/rank_mapping.h"
#include "query/surface_nets/net_mesh.h"
#include "store/base/memory.h"
#include "store/base/workers.h"
#include "store/container/format.h"

namespace isonest::detail {
namespace {

/// The faces that contain vertices at the volume's border, half a node spacing outside.
PatchBox border_of(const StoreHeader& header, double rounding) {
    const Int3& n = header.nodes;
    constexpr double kMore = 4;
    return box_faces({-0.5, -0.5, -0.5},
                     {static_cast<double>(n.x) - 0.5, static_cast<double>(n.y) - 0.5,
                      static_cast<double>(n.z) - 0.5},
                     header.steps(), header.origin, kMore * rounding);
}

double max_moved_of(std::span<const LabelPartRecord> parts) {
    double moved = 0;
    for (const LabelPartRecord& part : parts) {
        moved = std::max(moved, static_cast<double>(part.moved));
    }
    return moved;
}

NetMesh net_mesh_of(const SheetCounts& counts, double moved) {
    return {counts.vertices, counts.triangles, counts.no_area, moved};
}

}  // namespace

LabelSheets::LabelSheets(const NetStore& net, SheetSetting setting, const ScratchFolder& folder,
                         Progress& progress)
    : net_(net), setting_(std::move(setting)), sheets_(folder) {
    MeshLayout layout;
    layout.has_sides = true;
    levels_.push_back(std::make_unique<Level>());
    levels_[0]->distance.full_triangles =
        emit_net_interfaces(net, setting_.outside, layout, sheets_, progress).triangles;
    sides_range_ = sheets_.sides_range();
    const MemoryShare memory = setting_.memory.without(setting_.wanted.size() * sizeof(Label));
    const std::unique_ptr<BlockMapping> mapping = mapping_by(setting_.team, memory);
    const int threads =
        memory.without(mapping->heap()).threads_of(map_heap(), "simplifying its labels");
    Workers(threads).execute([&] { simplify(*mapping, folder, progress); });
    for (const std::unique_ptr<Level>& level : levels_) {
        if (level->corners) {
            level->output.emplace(sheets_, level->corners->all(), setting_.wanted, folder,
                                  progress);
        }
    }
}

/// Later movement of the positions of a level by rounding, world units.
double LabelSheets::rounding_of(int level) const {
    return setting_.rounding +
           (setting_.details ? std::ldexp(setting_.details->rounding, level) : 0);
}

/// The margin for kept nodes: rotated meshes and details are rounded again.
std::optional<double> LabelSheets::margin() const {
    if (!setting_.keeps_nodes) {
        return std::nullopt;
    }
    const LatticeSteps steps = setting_.header.steps();
    const double turned = setting_.header.rotation() != kAlongWorld ? setting_.rounding : 0;
    const double moved = turned + rounding_of(0) - setting_.rounding;
    return KeptNodes::kMinMargin + max_in_lattice({moved, moved, moved}, steps);
}

void LabelSheets::simplify(BlockMapping& mapping, const ScratchFolder& folder, Progress& progress) {
    const WorldLattice lattice{setting_.header.origin, setting_.header.steps(),
                               setting_.header.nodes};
    MeshMapper mapper(sheets_.vertices(), lattice, border_of(setting_.header, setting_.rounding),
                      folder, progress);
    mapper.map_by(mapping);
    mapper.take_sheets(sheets_.next_copies(), margin());
    Mapped result = setting_.distance ? finest(mapper) : mapper.full(sheets_.triangles());
    if (setting_.distance) {
        levels_[0]->corners.emplace(mapper.corners(result));
    }
    if (setting_.details) {
        add_details(mapper, std::move(result));
    }
    mapping.finish();
}

/// Level 0, if it is simplified.
Mapped LabelSheets::finest(const MeshMapper& mapper) {
    const DistanceChoice& asked = *setting_.distance;
    const double rounding = rounding_of(0);
    const double limit = distance_left(setting_.name, asked.within, rounding);
    const auto consume = [this](std::uint64_t first, std::uint64_t count) {
        sheets_.release(first, count);
    };
    constexpr double kFirstLimit = 0.25;  // of the smallest distance between nodes
    Mapped result = asked.triangles
                        ? mapper.down_to(mapper.full(sheets_.triangles()), *asked.triangles,
                                         kFirstLimit * setting_.header.steps().shortest(), limit)
                        : mapper.within(mapper.full(sheets_.triangles(), consume), limit);
    DistanceReport& distance = levels_[0]->distance;
    distance.asked = asked.within;
    distance.bound = result.bound + (result.bound > 0 ? setting_.rounding : 0);
    if (asked.triangles) {
        within_budget_ = result.triangles <= *asked.triangles;
        distance.asked = result.limit + (result.limit > 0 ? rounding : 0);
        if (!*within_budget_ && asked.is_any) {
            throw Error(
                ErrorKind::limit, {setting_.name},
                fmt::format("the fewest triangles found for the interfaces at any distance are {}: "
                            "parts, holes and the ends of junction lines are kept",
                            result.triangles));
        }
    }
    return result;
}

/// Adds the levels after that of `mapped`, as long as they have fewer triangles.
void LabelSheets::add_details(const MeshMapper& mapper, Mapped mapped) {
    constexpr double kFirst = 0.25;  // of the smallest distance between nodes
    first_scale_ =
        std::max(levels_[0]->distance.asked, kFirst * setting_.header.steps().shortest());
    for (int level = 1; level < setting_.details->most; ++level) {
        const double asked = scale(level);
        if (asked > diagonal_of(setting_.header) || asked <= rounding_of(level)) {
            return;
        }
        const std::uint64_t before = mapped.triangles;
        const double limit = distance_left(setting_.name, asked, rounding_of(level));
        mapped = mapper.within(std::move(mapped), limit);
        if (!is_worth_a_level(before, mapped.triangles)) {
            return;
        }
        levels_.push_back(std::make_unique<Level>());
        Level& made = *levels_.back();
        made.distance.asked = asked;
        made.distance.full_triangles = levels_[0]->distance.full_triangles;
        made.distance.bound = mapped.bound + (mapped.bound > 0 ? setting_.rounding : 0);
        made.corners.emplace(mapper.corners(mapped));
    }
}

double LabelSheets::scale(int level) const {
    return std::ldexp(first_scale_, level);
}

NetMesh LabelSheets::emit_all(MeshLayout layout, MeshSink& sink, const Progress& progress) const {
    double moved = 0;
    for (const NetPieceRecord& piece : net_.all_pieces()) {
        moved = std::max(moved, static_cast<double>(piece.moved));
    }
    layout.sides_range = sides_range_;
    return net_mesh_of(output(0).emit_all(std::move(layout), sink, progress), moved);
}

NetMesh LabelSheets::emit_label(std::size_t number, int level, MeshLayout layout, MeshSink& sink,
                                const Progress& progress) const {
    return net_mesh_of(output(level).emit_label(number, std::move(layout), sink, progress),
                       max_moved_of(net_.parts(setting_.wanted[number])));
}

}  // namespace isonest::detail
