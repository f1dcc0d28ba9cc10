#include "query/extract/labels/label_sheets.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include <isonest/error.h>

#include "query/extract/extract_query.h"
#include "query/ranks/rank_mapping.h"
#include "query/surface_nets/net_interfaces.h"
#include "store/base/memory_budget.h"
#include "store/base/workers.h"
#include "store/container/extent.h"

namespace isonest::detail {
namespace {

/// What is asked for, in world units.
struct AskedSheets {
    double within = 0;
    std::optional<std::uint64_t> triangles;
    bool at_any_distance = false;
};

/// REQUIRES: a stop.
AskedSheets asked_of(const SheetSetting& s) {
    if (const auto* const bound = std::get_if<DistanceBound>(&*s.query.stop)) {
        return {world_distance(s.header, *bound), std::nullopt, false};
    }
    const auto& budget = std::get<TriangleBudget>(*s.query.stop);
    const double most = diagonal_of(s.header);
    const double within = budget.within ? world_distance(s.header, *budget.within) : most;
    return {within, budget.most, within >= most};
}

std::uint64_t memory_of(const SheetSetting& s) {
    const std::uint64_t lists = s.wanted.size() * 2 * (sizeof(std::int64_t) + sizeof(Label));
    return s.options.memory - std::min(s.options.memory, lists);
}

/// With this memory.
int threads_of(const SheetSetting& s, std::uint64_t memory) {
    require_memory(s.name, memory, kLibraryHeap + map_heap(), "simplifying its labels");
    return static_cast<int>(
        std::min((memory - kLibraryHeap) / map_heap(),
                 static_cast<std::uint64_t>(Workers::count_of(s.options.threads))));
}

/// Where vertices at the volume's border lie, half a node's distance outside.
PatchBox border_of(const StoreHeader& header) {
    PatchBox box;
    for (int axis = 0; axis < 3; ++axis) {
        const auto a = static_cast<std::size_t>(axis);
        const auto at = [&](std::int64_t cell) {
            const double node = static_cast<double>(cell) - 0.5;
            return static_cast<float>(header.origin[a] + header.spacing[a] * node) + 0.0F;
        };
        box.lo[a] = at(0);
        box.hi[a] = at(header.nodes[axis]);
    }
    return box;
}

/// What the places of a level will be moved by rounding, world units.
double rounding_of(const SheetSetting& s, int level) {
    return s.rounding + (s.details ? std::ldexp(s.details->rounding, level) : 0);
}

/// For nodes that are kept: meshes that are turned are rounded once more, and details too.
std::optional<double> margin_of(const SheetSetting& s) {
    if (!s.query.smooth->keep_nodes) {
        return std::nullopt;
    }
    const Double3& d = s.header.spacing;
    const double turned = s.header.direction != kAlongWorld ? s.rounding : 0;
    const double moved = turned + rounding_of(s, 0) - s.rounding;
    return KeptNodes::kLeastMargin + moved / std::min({d[0], d[1], d[2]});
}

double most_moved_of(std::span<const LabelPartRecord> parts) {
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

LabelSheets::LabelSheets(const NetStore& net, const SheetSetting& setting,
                         const ScratchFolder& folder, Progress& progress)
    : net_(net), wanted_(setting.wanted), sheets_(folder) {
    MeshLayout layout;
    layout.has_sides = true;
    levels_.push_back(std::make_unique<Level>());
    levels_[0]->distance.full_triangles =
        emit_net_interfaces(net, setting.outside, layout, sheets_, progress).triangles;
    sides_range_ = sheets_.sides_range();
    const std::uint64_t memory = memory_of(setting);
    const std::unique_ptr<BlockMapping> mapping = mapping_by(setting.options.team, memory);
    const int threads = threads_of(setting, memory - std::min(memory, mapping->heap()));
    Workers(threads).execute([&] { simplify(setting, *mapping, folder, progress); });
    for (const std::unique_ptr<Level>& level : levels_) {
        if (level->corners) {
            level->output.emplace(sheets_, level->corners->all(), wanted_, folder, progress);
        }
    }
}

void LabelSheets::simplify(const SheetSetting& setting, BlockMapping& mapping,
                           const ScratchFolder& folder, Progress& progress) {
    const WorldLattice lattice{setting.header.origin, setting.header.spacing, setting.header.nodes};
    MeshMapper mapper(sheets_.vertices(), lattice, border_of(setting.header), folder, progress);
    mapper.map_by(mapping);
    mapper.take_sheets(sheets_.next_copies(), margin_of(setting));
    Mapped result =
        setting.is_finest_simplified ? finest(setting, mapper) : mapper.full(sheets_.triangles());
    if (setting.is_finest_simplified) {
        levels_[0]->corners.emplace(mapper.corners(result));
    }
    if (setting.details) {
        add_details(setting, mapper, std::move(result));
    }
    mapping.finish();
}

/// Level 0, where it is simplified.
Mapped LabelSheets::finest(const SheetSetting& setting, const MeshMapper& mapper) {
    const AskedSheets asked = asked_of(setting);
    const double rounding = rounding_of(setting, 0);
    const double limit = distance_left(setting.name, asked.within, rounding);
    const auto consume = [this](std::uint64_t first, std::uint64_t count) {
        sheets_.release(first, count);
    };
    constexpr double kFirstLimit = 0.25;  // of the least distance between nodes
    const Double3& d = setting.header.spacing;
    Mapped result = asked.triangles
                        ? mapper.down_to(mapper.full(sheets_.triangles()), *asked.triangles,
                                         kFirstLimit * std::min({d[0], d[1], d[2]}), limit)
                        : mapper.within(mapper.full(sheets_.triangles(), consume), limit);
    DistanceReport& distance = levels_[0]->distance;
    distance.asked = asked.within;
    distance.bound = result.bound + (result.bound > 0 ? setting.rounding : 0);
    if (asked.triangles) {
        within_budget_ = result.triangles <= *asked.triangles;
        distance.asked = result.limit + (result.limit > 0 ? rounding : 0);
        if (!*within_budget_ && asked.at_any_distance) {
            throw Error(ErrorKind::limit, {setting.name},
                        fmt::format("{} triangles are the fewest that were found for the "
                                    "interfaces of its labels, at any distance: parts, holes and "
                                    "the ends of lines where labels meet stay",
                                    result.triangles));
        }
    }
    return result;
}

/// The levels behind that of `mapped`, as long as they have fewer triangles.
void LabelSheets::add_details(const SheetSetting& setting, const MeshMapper& mapper,
                              Mapped mapped) {
    constexpr double kFirst = 0.25;  // of the least distance between nodes
    const Double3& d = setting.header.spacing;
    first_scale_ = std::max(levels_[0]->distance.asked, kFirst * std::min({d[0], d[1], d[2]}));
    for (int level = 1; level < setting.details->most; ++level) {
        const double asked = scale(level);
        if (asked > diagonal_of(setting.header) || asked <= rounding_of(setting, level)) {
            return;
        }
        const std::uint64_t before = mapped.triangles;
        const double limit = distance_left(setting.name, asked, rounding_of(setting, level));
        mapped = mapper.within(std::move(mapped), limit);
        if (!is_worth_a_level(before, mapped.triangles)) {
            return;
        }
        levels_.push_back(std::make_unique<Level>());
        Level& made = *levels_.back();
        made.distance.asked = asked;
        made.distance.full_triangles = levels_[0]->distance.full_triangles;
        made.distance.bound = mapped.bound + (mapped.bound > 0 ? setting.rounding : 0);
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
                       most_moved_of(net_.parts(wanted_[number])));
}

}  // namespace isonest::detail
