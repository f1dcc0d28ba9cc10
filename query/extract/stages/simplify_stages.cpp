#include "query/extract/stages/simplify_stages.h"

#include <fmt/format.h>
#include <oneapi/tbb/task_arena.h>

#include <algorithm>
#include <cmath>

#include <isonest/error.h>

#include "query/mesh/measuring_sink.h"
#include "query/ranks/rank_mapping.h"
#include "query/simplify/collapse/map_mesh.h"
#include "query/simplify/simplify_by_value.h"
#include "query/simplify/simplify_lines.h"
#include "query/simplify/simplify_mesh.h"
#include "query/simplify/triangle_budget.h"
#include "query/traverse/traversal.h"
#include "query/values/node_sampler.h"
#include "store/base/memory.h"
#include "store/container/format.h"

namespace isonest::detail {

double first_budget_limit(const MeshPlace& place) {
    constexpr double kVoxels = 0.25;
    return kVoxels * place.voxel();
}

void refuse_budget(const std::string& name, std::uint64_t most, std::uint64_t triangles,
                   const ComponentSizes& sizes) {
    std::string problem = fmt::format(
        "the fewest triangles found at any distance are {}: parts and holes of the surface are "
        "kept",
        triangles);
    std::vector<Remedy> remedies;
    if (sizes.components > 1) {
        problem += fmt::format("; the largest of its {} components has {} of them",
                               sizes.components, sizes.largest);
        if (sizes.largest <= most) {
            remedies.push_back({RemedyKind::fewer_components});
        }
    }
    throw Error(ErrorKind::limit, {name}, problem, remedies);
}

namespace {

/// The purpose of the memory, for messages.
constexpr const char* kWithinDistance = "simplification within a distance";

/// For data in a plane.
int flat_axis(const Int3& nodes) {
    return nodes.x == 1 ? 0 : nodes.y == 1 ? 1 : 2;
}

/// Base of the stages that simplify within a distance.
class DistanceStage : public Stage {
  public:
    DistanceStage(int threads, const DistanceChoice& choice) : Stage(threads), choice_(choice) {}

  protected:
    [[nodiscard]] const DistanceChoice& choice() const { return choice_; }
    /// The requested distance minus the part used by float32. Throws Error{limit} if nothing is
    /// left.
    [[nodiscard]] double limit(const StageTools& tools) const {
        return distance_left(tools.name, choice_.within, tools.place.max_moved());
    }
    /// The surface from which the distance is measured, counted and measured.
    [[nodiscard]] DistanceReport full(const StageMesh& mesh) const {
        const MeshLayout& layout = mesh.vertices().layout();
        DistanceReport report{choice_.within, 0, layout.elements};
        if (layout.corners == 3) {
            report.full = measures_of(layout, mesh.vertices().positions(), mesh.elements());
        }
        return report;
    }
    /// The distance between a mesh within `limit` of the input mesh and the surface without
    /// rounding.
    [[nodiscard]] static double with_rounding(double limit, const StageTools& tools) {
        return limit + (limit > 0 ? tools.place.max_moved() : 0);
    }

  private:
    DistanceChoice choice_;
};

/// For isolines.
class LineStage : public DistanceStage {
  public:
    using DistanceStage::DistanceStage;
    StageResult run(StageMesh& mesh, const StageTools& tools) override;
};

/// For a surface, with the effort `best`.
class BestStage : public DistanceStage {
  public:
    using DistanceStage::DistanceStage;
    StageResult run(StageMesh& mesh, const StageTools& tools) override;

  private:
    [[nodiscard]] double first_limit(double limit, double voxel) const;
    [[nodiscard]] Simplified simplified(MeshSimplifier& simplifier, const StageMesh& mesh,
                                        const StageTools& tools, double limit) const;
};

/// For a surface, by successive mappings alone.
class MappingStage : public DistanceStage {
  public:
    MappingStage(int threads, const DistanceChoice& choice, std::unique_ptr<BlockMapping> mapping)
        : DistanceStage(threads, choice), mapping_(std::move(mapping)) {}
    StageResult run(StageMesh& mesh, const StageTools& tools) override;

  private:
    std::unique_ptr<BlockMapping> mapping_;
};

StageResult LineStage::run(StageMesh& mesh, const StageTools& tools) {
    const auto lines = std::make_shared<SimplifiedLines>(
        mesh.vertices(), mesh.elements(), flat_axis(tools.place.lattice.nodes), limit(tools),
        tools.scratch, tools.progress);
    DistanceReport distance = full(mesh);
    mesh.choose(lines->corners(), lines);
    distance.bound = lines->bound() + tools.place.max_moved();
    return {.distance = distance};
}

/// The part of a distance within which the full surface is simplified. Blocks of the full surface
/// are small compared to the triangles of a mesh with a large distance, and the locked edges at
/// their borders prevent collapses. So the mesh within this part is simplified again, within the
/// rest of the distance, in its own blocks.
double BestStage::first_limit(double limit, double voxel) const {
    constexpr double kFar = 1.75;  // voxels, likewise the next one
    constexpr double kNear = 0.5;
    return !choice().triangles && limit > kFar * voxel ? kNear * voxel : limit;
}

/// Simplifies within `limit`, and to the requested number of triangles, if any.
Simplified BestStage::simplified(MeshSimplifier& simplifier, const StageMesh& mesh,
                                 const StageTools& tools, double limit) const {
    const std::optional<std::uint64_t>& most = choice().triangles;
    if (!most) {
        return simplifier.within(simplifier.full(), limit);
    }
    const Simplified result =
        within_budget(simplifier, *most, first_budget_limit(tools.place), limit);
    if (result.triangles > *most && choice().is_any) {
        refuse_budget(tools.name, *most, result.triangles,
                      component_sizes(mesh.vertices().layout().vertices,
                                      simplifier.corners(result).all(), tools.scratch));
    }
    return result;
}

/// Makes a result of the simplifier the mesh of the following stages.
void choose(const MeshSimplifier& simplifier, const Simplified& result, StageMesh& mesh) {
    const auto corners = std::make_shared<CornerFile>(simplifier.corners(result));
    mesh.choose(corners->all(), corners);
}

/// Simplifies again, within `limit` of the current mesh. Returns the distance from that.
double simplify_again(StageMesh& mesh, const StageTools& tools, double limit) {
    auto near = std::make_shared<ScratchMesh>(tools.scratch);
    emit_elements(mesh.vertices(), mesh.elements(), tools.scratch, *near, tools.progress);
    mesh.replace(near);
    MeshSimplifier simplifier(*near, near->corners(), tools.place.lattice, tools.place.faces(),
                              tools.scratch, tools.progress);
    const Simplified result = simplifier.within(simplifier.full(), limit);
    choose(simplifier, result, mesh);
    return result.bound;
}

StageResult BestStage::run(StageMesh& mesh, const StageTools& tools) {
    const double max_moved = tools.place.max_moved();
    const double within = limit(tools);
    const double first = first_limit(within, tools.place.voxel());
    StageResult found;
    DistanceReport& distance = found.distance.emplace(full(mesh));
    {
        MeshSimplifier simplifier(mesh.growing(), mesh.elements(), tools.place.lattice,
                                  tools.place.faces(), tools.scratch, tools.progress);
        const Simplified result = simplified(simplifier, mesh, tools, first);
        choose(simplifier, result, mesh);
        distance.bound = result.bound + max_moved;
        if (const auto& most = choice().triangles) {
            found.within_budget = result.triangles <= *most;
            distance.asked = with_rounding(result.limit, tools);
        }
    }
    if (first < within) {
        distance.bound += simplify_again(mesh, tools, within + max_moved - distance.bound);
    }
    return found;
}

StageResult MappingStage::run(StageMesh& mesh, const StageTools& tools) {
    const double within = limit(tools);
    const std::optional<std::uint64_t>& most = choice().triangles;
    StageResult found;
    DistanceReport& distance = found.distance.emplace(full(mesh));
    MeshMapper mapper(mesh.vertices(), tools.place.lattice, tools.place.faces(), tools.scratch,
                      tools.progress);
    mapper.map_by(*mapping_);
    const auto consume = [&mesh](std::uint64_t first, std::uint64_t count) {
        mesh.consume(first, count);
    };
    const Mapped result = most ? mapper.down_to(mapper.full(mesh.elements()), *most,
                                                first_budget_limit(tools.place), within)
                               : mapper.within(mapper.full(mesh.elements(), consume), within);
    mapping_->finish();
    const auto corners = std::make_shared<CornerFile>(mapper.corners(result));
    if (most) {
        found.within_budget = result.triangles <= *most;
        distance.asked = with_rounding(result.limit, tools);
        if (!*found.within_budget && choice().is_any) {
            refuse_budget(
                tools.name, *most, result.triangles,
                component_sizes(mesh.vertices().layout().vertices, corners->all(), tools.scratch));
        }
    }
    mesh.choose(corners->all(), corners);
    distance.bound = result.bound + tools.place.max_moved();
    return found;
}

}  // namespace

int distance_stage_threads(const MemoryShare& memory) {
    return memory.threads_of(simplify_heap(), kWithinDistance);
}

std::unique_ptr<Stage> distance_stage(int corners, const DistanceChoice& choice,
                                      const MemoryShare& memory, RankTeam* team) {
    if (corners == 2) {
        const int threads = memory.threads_of(simplify_lines_heap(), kWithinDistance);
        return std::make_unique<LineStage>(threads, choice);
    }
    if (choice.effort != Effort::fast) {
        return std::make_unique<BestStage>(distance_stage_threads(memory), choice);
    }
    auto mapping = mapping_by(team, memory);
    const int threads = memory.without(mapping->heap()).threads_of(map_heap(), kWithinDistance);
    return std::make_unique<MappingStage>(threads, choice, std::move(mapping));
}

namespace {

/// A store's numbers, through its cache.
class StoreGridNumbers : public GridNumbers {
  public:
    StoreGridNumbers(ChunkCache& cache, Field field) : sampler_(cache), field_(field) {}
    double value(const Int3& node, int level) override { return sampler_.value(node, level); }
    double deviation(const Int3& node) override { return sampler_.grid_indicator(node, field_); }
    void rest() override { sampler_.leave(); }

    /// Heap of the chunks held while a thread processes a block: for tetrahedra one of values and
    /// one of the field at each level. In addition, as many chunks of values as meet at a corner:
    /// with fewer in the cache they would be decoded repeatedly.
    static std::uint64_t held(const StoreLayout& layout, Cells cells, Field field) {
        std::uint64_t heap = 8 * layout.array(0, Field::values).chunk_bytes();
        if (cells == Cells::hexahedra) {
            return heap;
        }
        for (const ArrayInfo& array : layout.arrays()) {
            if (array.field == Field::values || array.field == field) {
                heap += array.chunk_bytes();
            }
        }
        return heap;
    }

  private:
    NodeSampler sampler_;
    Field field_;
};

/// Maximum number of chunks of a level; with more, reading their rows takes too long.
constexpr std::int64_t kMaxChunks = std::int64_t{1} << 15U;
/// Of the eight chunks of the next finer level within a chunk, a surface passes through this many.
constexpr std::uint64_t kFinerCrossed = 4;

/// Calls visit(chunk, row) for all chunks of values of a level that the isosurface may pass
/// through.
template <class Visit>
void each_crossed(const StoreReader& store, int level, double iso, const Visit& visit) {
    const ArrayInfo& values = store.layout().array(level, Field::values);
    for (std::int64_t i = 0; i < values.grid.product(); ++i) {
        const Int3 chunk = values.grid.unlinear(i);
        const ChunkRow row = store.row(values, chunk);
        if (row.min <= iso && iso <= row.max) {
            visit(chunk, row);
        }
    }
}

}  // namespace

bool hexahedra_are_cheaper(const StoreReader& store, double iso, double error) {
    const StoreLayout& layout = store.layout();
    if (!layout.has(Field::deviation_bar)) {
        return true;
    }
    const double threshold = nested_share(VertexPlace::linear) * error;
    std::uint64_t nested_alone = 0;
    for (int level = layout.lattice().top(); level >= 1; --level) {
        const ArrayInfo& values = layout.array(level, Field::values);
        const ArrayInfo& field = layout.array(level, Field::deviation_bar);
        if (values.grid.product() > kMaxChunks) {
            return false;
        }
        store.prefetch_rows(values, {}, values.grid);
        store.prefetch_rows(field, {}, field.grid);
        std::uint64_t going = 0;
        std::uint64_t stopping = 0;
        each_crossed(store, level, iso, [&](const Int3& chunk, const ChunkRow& row) {
            nested_alone += row.bytes;
            const bool has_field = field.has_chunk(chunk);
            const ChunkRow bound = has_field ? store.row(field, chunk) : ChunkRow{};
            nested_alone += has_field ? bound.bytes : 0;
            (has_field && bound.max < threshold ? stopping : going) += row.bytes;
        });
        // The field is saturated: if it is below the threshold here, it is below at finer levels.
        std::uint64_t finer = 1;
        std::uint64_t nested_below = 0;
        for (int l = level - 1; l >= 1; --l) {
            finer *= kFinerCrossed;
            nested_below += 2 * finer * going;
        }
        if (finer * kFinerCrossed * stopping > nested_alone + nested_below) {
            return false;
        }
    }
    return true;
}

namespace {

/// Heap that one thread needs in addition to the cache.
std::uint64_t own_heap(const StoreLayout& layout, Cells cells) {
    return simplify_by_value_heap(cells) + decode_heap(largest_chunk_bytes(layout));
}

int error_stage_threads(const StoreLayout& layout, Cells cells, Field field,
                        std::uint64_t traversal_heap, const MemoryShare& memory) {
    const std::uint64_t each =
        own_heap(layout, cells) + StoreGridNumbers::held(layout, cells, field);
    constexpr const char* kWhat = "simplification within an error";
    // The traversal needs separate memory.
    memory.require(std::max(each, traversal_heap), kWhat);
    return memory.threads_of(each, kWhat);
}

}  // namespace

ErrorStage::ErrorStage(const StoreReader& store, ValueLimit limit, Field field,
                       std::uint64_t traversal_heap, const MemoryShare& memory)
    : Stage(error_stage_threads(store.layout(), limit.cells, field, traversal_heap, memory)),
      store_(store),
      limit_(std::move(limit)),
      field_(field),
      each_(own_heap(store.layout(), limit_.cells)),
      memory_(memory.left()) {}

StageResult ErrorStage::run(StageMesh& mesh, const StageTools& tools) {
    const auto threads = static_cast<std::uint64_t>(tbb::this_task_arena::max_concurrency());
    // Held chunks are part of the cache.
    ChunkCache cache(store_, memory_ - threads * each_);
    ValueLimit limit = limit_;
    limit.numbers = [&cache, field = field_] {
        return std::make_unique<StoreGridNumbers>(cache, field);
    };
    const auto simplified = std::make_shared<SimplifiedByValue>(
        mesh.vertices(), mesh.elements(), tools.place.lattice, tools.place.faces(), limit,
        tools.scratch, tools.progress);
    mesh.choose(simplified->corners(), simplified);
    StageResult found{.error = simplified->largest()};
    found.simplified_error = ErrorSimplificationReport{mesh.vertices().layout().elements};
    if (limit.cells == Cells::hexahedra) {
        found.simplified_error->full_bound = simplified->largest_kept();
    }
    return found;
}

}  // namespace isonest::detail
