#include "query/extract/kept_analysis.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstring>
#include <memory>
#include <numbers>

#include <isonest/error.h>
#include <isonest/version.h>

#include "query/extract/extract.h"
#include "query/extract/extraction.h"
#include "query/extract/report.h"
#include "query/extract/stages/simplify_stages.h"
#include "query/mesh/weld.h"
#include "store/base/workers.h"
#include "store/container/codec.h"
#include "store/container/parts/header_reader.h"
#include "store/files/output_file.h"

namespace isonest::detail {
namespace {

constexpr const char* kSuffix = ".analysis";
constexpr std::size_t kBatch = std::size_t{1} << 13U;

/// Everything that must be the same for an analysis to belong to this store.
std::string store_key(const StoreReader& store) {
    const StoreHeader& h = store.layout().header();
    const LatticeSteps steps = h.steps();
    return fmt::format("isonest {}, store {:016x}, {} x {} x {}, spacing {} {} {}, origin {} {} {}",
                       ISONEST_VERSION, store.identity(), h.nodes.x, h.nodes.y, h.nodes.z,
                       h.spacing[0], h.spacing[1], h.spacing[2], h.origin[0], h.origin[1],
                       h.origin[2]) +
           (steps.is_sheared()
                ? fmt::format(", shear {} {} {}", steps.y_along_x, steps.z_along_x, steps.z_along_y)
                : "") +
           (h.uneven ? fmt::format(", offsets {:016x}", offsets_digest(*h.uneven)) : "");
}

std::string prefix_of(const StoreReader& store) {
    const std::string name = store.path().filename().string();
    return (name.empty() ? "store" : name) + ".iso";
}

std::filesystem::path folder_of(const std::filesystem::path& file) {
    return file.has_parent_path() ? file.parent_path() : std::filesystem::path(".");
}

/// The key's first line; the second one is AnalysisName::surface.
std::string store_line(const AnalysisFile& analysis) {
    const std::string& key = analysis.surface().key;
    return key.substr(0, key.find('\n'));
}

FoundAnalysis open(const StoreReader& store, std::filesystem::path path, AnalysisDepth depth) {
    FoundAnalysis found{std::move(path), AnalysisState::none, nullptr, {}};
    std::error_code error;
    if (!std::filesystem::exists(std::filesystem::symlink_status(found.path, error))) {
        return found;
    }
    try {
        found.file = std::make_unique<AnalysisFile>(found.path);
        const std::size_t steps = depth == AnalysisDepth::bytes ? found.file->steps().size() : 0;
        for (std::size_t i = 0; i < steps; ++i) {
            found.file->verify(i);
        }
        found.state = AnalysisState::current;
    } catch (const Error& e) {
        if (e.kind() != ErrorKind::corrupt && e.kind() != ErrorKind::unsupported) {
            throw;
        }
        found.file.reset();
        found.state =
            e.kind() == ErrorKind::corrupt ? AnalysisState::damaged : AnalysisState::stale;
        found.problem = e.problem();
        return found;
    }
    if (store_line(*found.file) != store_key(store)) {
        found.state = AnalysisState::stale;
        found.problem = "made from another store, or by another version of isonest";
    }
    return found;
}

/// Writes a mesh's arrays at their offsets in the file.
void write_mesh(const OutputFile& file, const AnalysisOffsets& offsets, const ScratchMesh& mesh) {
    const MeshLayout& layout = mesh.layout();
    if (layout.vertices == 0) {
        return;
    }
    file.write_at(offsets.positions, std::as_bytes(mesh.positions()));
    if (layout.row_bytes > 0) {
        file.write_at(offsets.rows, mesh.rows());
    }
    file.write_at(offsets.corners, std::as_bytes(mesh.corners_in_64_bits()));
}

/// Calls f(first, values) for batches of an unaligned array.
template <class T, class F>
void each_batch(std::span<const std::byte> bytes, F&& f) {
    std::vector<T> batch;
    const std::size_t count = bytes.size() / sizeof(T);
    for (std::size_t at = 0; at < count; at += kBatch) {
        batch.resize(std::min(kBatch, count - at));
        std::memcpy(batch.data(), bytes.data() + at * sizeof(T), batch.size() * sizeof(T));
        f(at, std::span<const T>(batch));
    }
}

}  // namespace

AnalysisName analysis_name(const StoreReader& store, const ExtractQuery& query) {
    const TraversalQuery& t = query.traversal;
    std::string key = fmt::format("iso {}", t.iso);
    const Int3 nodes = store.layout().header().nodes;
    bool whole = true;
    for (int axis = 0; axis < 3; ++axis) {
        const auto a = static_cast<std::size_t>(axis);
        whole = whole && t.box.lo[a] == 0 && t.box.hi[a] == static_cast<double>(nodes[axis] - 1);
    }
    if (!whole) {
        key += fmt::format(", box {},{},{} to {},{},{} (nodes)", t.box.lo[0], t.box.lo[1],
                           t.box.lo[2], t.box.hi[0], t.box.hi[1], t.box.hi[2]);
    }
    if (t.cells == Cells::hexahedra) {
        key += ", of hexahedra";
    }
    if (t.box.close) {
        key += *t.box.close == Outside::below ? ", closed" : ", closed above";
    }
    if (query.stages.components) {
        key += fmt::format(", components: largest {}, least triangles {}, least volume {}",
                           query.stages.components->largest, query.stages.components->min_triangles,
                           query.stages.components->min_volume);
    }
    const AttributeChoice& a = t.attributes;
    if (a.normal) {
        key += ", normals";
    }
    if (query.values != nullptr) {
        key += fmt::format(", values of {:016x}{}", query.values->identity(),
                           a.wide_value ? " as float64" : "");
    }
    if (a.error) {
        key += fmt::format(", error {}", stored_name_of(*a.error));
    }
    const auto sum = static_cast<std::uint32_t>(checksum_of(std::as_bytes(std::span(key))));
    return {*query.analysis_folder /
                fmt::format("{}{:g}-{:08x}{}", prefix_of(store), t.iso, sum, kSuffix),
            key};
}

FoundAnalysis find_analysis(const StoreReader& store, const AnalysisName& name) {
    FoundAnalysis found = open(store, name.path, AnalysisDepth::bytes);
    if (found.state == AnalysisState::current && query_text(*found.file) != name.surface) {
        found.state = AnalysisState::stale;
        found.problem = "of another query";
    }
    return found;
}

std::filesystem::path analysis_folder_of(const StoreReader& store) {
    return store.is_remote() ? std::filesystem::path(".") : folder_of(store.path());
}

std::vector<FoundAnalysis> all_analyses(const StoreReader& store, AnalysisDepth depth) {
    const std::filesystem::path folder = analysis_folder_of(store);
    std::vector<std::filesystem::path> paths;
    std::error_code error;
    for (const auto& entry : std::filesystem::directory_iterator(folder, error)) {
        const std::string name = entry.path().filename().string();
        if (name.starts_with(prefix_of(store)) && name.ends_with(kSuffix)) {
            paths.push_back(entry.path());
        }
    }
    // For a remote store, the folder need not be readable if no analysis is kept in it.
    if (error && !store.is_remote()) {
        throw Error(ErrorKind::io, {folder.string()}, "cannot list it: " + error.message());
    }
    std::sort(paths.begin(), paths.end());
    std::vector<FoundAnalysis> all;
    all.reserve(paths.size());
    for (const std::filesystem::path& path : paths) {
        all.push_back(open(store, path, depth));
    }
    return all;
}

std::string query_text(const AnalysisFile& analysis) {
    const std::string& key = analysis.surface().key;
    const std::size_t end = key.find('\n');
    return end == std::string::npos ? std::string() : key.substr(end + 1);
}

void require_place(const std::filesystem::path& analysis, const StoreReader& store) {
    check_output(analysis, true, {store.path()});
    if (::access(folder_of(analysis).c_str(), W_OK) != 0) {
        throw Error(ErrorKind::io, {folder_of(analysis).string()},
                    "the folder is not writable; keep the analysis in another one");
    }
}

void keep_analysis(const StoreReader& store, const AnalysisName& name, AnalysedSurface surface,
                   const std::vector<LadderStep>& ladder) {
    surface.key = store_key(store) + "\n" + name.surface;
    std::vector<AnalysisStep> steps;
    for (const LadderStep& step : ladder) {
        const MeshLayout& layout = step.mesh->layout();
        surface.row_bytes = layout.row_bytes;
        steps.push_back({step.bound, layout.vertices, layout.elements,
                         analysis_checksum(std::as_bytes(step.mesh->positions()), step.mesh->rows(),
                                           std::as_bytes(step.mesh->corners_in_64_bits()))});
    }
    std::vector<AnalysisOffsets> offsets;
    OutputFile file(name.path, true, [&](const std::filesystem::path& temporary) {
        offsets = create_analysis(temporary, surface, steps);
    });
    for (std::size_t i = 0; i < ladder.size(); ++i) {
        write_mesh(file, offsets[i], *ladder[i].mesh);
    }
    file.publish_as_named();
}

void load_step(const AnalysisFile& analysis, std::size_t step, MeshLayout layout,
               ScratchMesh& mesh) {
    const AnalysisStep& s = analysis.steps()[step];
    layout.vertices = s.vertices;
    layout.elements = s.triangles;
    mesh.begin(layout);
    const auto rows = analysis.rows(step);
    each_batch<std::array<float, 3>>(
        analysis.positions(step), [&](std::size_t first, const auto& positions) {
            mesh.add_vertices({first, positions,
                               rows.empty() ? rows
                                            : rows.subspan(first * layout.row_bytes,
                                                           positions.size() * layout.row_bytes),
                               layout.row_bytes});
        });
    each_batch<ElementCorners>(analysis.corners(step), [&](std::size_t first, const auto& corners) {
        mesh.add_elements({first, corners, {}, {}});
    });
    mesh.end();
}

// The distance of two surfaces is at most the sum of their distances from a third one (the triangle
// inequality of Hausdorff distances). So a mesh within b of the full surface that is simplified
// within D - b is within D: query/DISTANCE.md, "A kept analysis".

namespace {

/// Simplification with a smaller fraction of the distance is not worthwhile.
constexpr double kWorthwhile = 0.02;
/// Fraction of a distance: meshes nearer to the surface are not tried.
constexpr double kNearest = 0.5;
/// A mesh with at least this fraction of the requested triangles is good enough.
constexpr double kNearlyAll = 0.9;
constexpr int kMaxTries = 3;  ///< between a distance that is too small and one that is not

/// Makes the ladder of a surface and writes the file. `r`: of its extraction. `place`: of the mesh.
void make_analysis(const StoreReader& store, const AnalysisName& name, ScratchMesh& mesh,
                   const ExtractReport& r, MeshPlace place, int threads,
                   const ScratchFolder& scratch, Progress& progress) {
    // The extraction's own files existed at the same time as the mesh.
    scratch.meter()->add(r.scratch_bytes);
    scratch.meter()->remove(r.scratch_bytes);
    AnalysedSurface surface;
    surface.triangles = r.triangles;
    if (r.components) {
        surface.components = r.components->components;
        surface.dropped_components = r.components->dropped;
        surface.dropped_triangles = r.components->dropped_triangles;
        surface.largest_dropped = r.components->largest_dropped;
    }
    if (r.closing) {
        surface.border_vertices = r.closing->border_vertices;
    }
    surface.mended_triangles = r.mending.mended;
    surface.coordinate_rounding = r.coordinate_rounding;
    surface.value_rounding = r.value_rounding;
    const PatchBox faces = place.faces();
    place.rounding = r.coordinate_rounding;
    Workers(threads).execute([&] {
        MeshSimplifier simplifier(mesh, mesh.corners(), place.lattice, faces, scratch, progress);
        keep_analysis(
            store, name, surface,
            distance_ladder(simplifier, mesh, place.voxel(), place.max_moved(), scratch, progress));
    });
}

/// A mesh made from a step of the ladder.
struct FromStep {
    std::unique_ptr<ScratchMesh> mesh;  ///< the step
    std::unique_ptr<MeshSimplifier> simplifier;
    std::optional<Simplified> simplified;  ///< nothing: the unchanged step
    double bound = 0;                      ///< from the full surface

    [[nodiscard]] std::uint64_t triangles() const {
        return simplified ? simplified->triangles : mesh->layout().elements;
    }
};

class AnalysedExtraction {
  public:
    /// `layout`: for the sink's prepare(). `place`: of the analysed surface.
    AnalysedExtraction(const AnalysisFile& analysis, MeshLayout layout, const MeshPlace& place,
                       const ScratchFolder& scratch, Progress& progress)
        : analysis_(analysis),
          layout_(std::move(layout)),
          place_(place),
          scratch_(scratch),
          progress_(progress) {}

    /// `choice`: the request, of which rounding leaves `limit`. `name`: of the store.
    AnalysedMesh mesh(const DistanceChoice& choice, double limit, const std::string& name,
                      MeshSink& sink) {
        if (choice.triangles) {
            return within_budget(choice, limit, name, sink);
        }
        return emitted(smallest_within(limit), choice.within, sink);
    }

  private:
    /// Searches for the smallest distance up to `limit` with at most the requested number of
    /// triangles.
    AnalysedMesh within_budget(const DistanceChoice& choice, double limit, const std::string& name,
                               MeshSink& sink) {
        const std::uint64_t triangles = *choice.triangles;
        const auto is_met = [&](const FromStep& from) { return from.triangles() <= triangles; };
        double too_small = 0;
        double distance = std::min(first_distance(triangles), limit);
        FromStep best = smallest_within(distance);
        while (!is_met(best) && distance < limit) {
            too_small = distance;
            distance = std::min(next_distance(distance), limit);
            best = smallest_within(distance);
        }
        for (int i = 0;
             i < kMaxTries && too_small > 0 && is_met(best) &&
             static_cast<double>(best.triangles()) < kNearlyAll * static_cast<double>(triangles);
             ++i) {
            const double middle = std::sqrt(too_small * distance);
            FromStep next = smallest_within(middle);
            if (is_met(next)) {
                best = std::move(next);
                distance = middle;
            } else {
                too_small = middle;
            }
        }
        if (!is_met(best) && choice.is_any) {
            refuse_budget(name, triangles, best.triangles(), sizes_of(best));
        }
        AnalysedMesh mesh = emitted(best, distance + place_.max_moved(), sink);
        mesh.within_budget = is_met(best);
        return mesh;
    }

    /// Start of a search: two octaves below the first step with few enough triangles.
    [[nodiscard]] double first_distance(std::uint64_t triangles) const {
        const auto& steps = analysis_.steps();
        std::size_t few = 0;
        while (few + 1 < steps.size() && steps[few].triangles > triangles) {
            ++few;
        }
        constexpr std::size_t kSteps = 4;
        return steps[few < kSteps ? 0 : few - kSteps].bound;
    }
    /// The distance of the next step, or further by the factor between steps.
    [[nodiscard]] double next_distance(double distance) const {
        const auto& steps = analysis_.steps();
        const auto next = std::find_if(steps.begin(), steps.end(), [&](const AnalysisStep& step) {
            return step.bound > distance;
        });
        return next != steps.end() ? next->bound : distance * std::numbers::sqrt2;
    }
    /// The result with the fewest triangles among the steps between half the distance and the
    /// distance, each simplified within the rest. REQUIRES: the first step is within the limit.
    [[nodiscard]] FromStep smallest_within(double limit) {
        const auto& steps = analysis_.steps();
        std::size_t last = 0;
        while (last + 1 < steps.size() && steps[last + 1].bound <= limit) {
            ++last;
        }
        FromStep best = from_step(last, limit);
        for (std::size_t i = last; i > 0 && steps[i - 1].bound >= kNearest * limit; --i) {
            FromStep next = from_step(i - 1, limit);
            if (next.triangles() < best.triangles()) {
                best = std::move(next);
            }
        }
        return best;
    }
    [[nodiscard]] FromStep from_step(std::size_t step, double limit) {
        FromStep from;
        from.mesh = std::make_unique<ScratchMesh>(scratch_);
        load_step(analysis_, step, layout_, *from.mesh);
        from.bound = analysis_.steps()[step].bound;
        const double rest = limit - from.bound;
        if (rest > kWorthwhile * limit) {
            from.simplifier =
                std::make_unique<MeshSimplifier>(*from.mesh, from.mesh->corners(), place_.lattice,
                                                 place_.faces(), scratch_, progress_);
            from.simplified = from.simplifier->within(from.simplifier->full(), rest);
            from.bound += from.simplified->bound;
        }
        return from;
    }
    [[nodiscard]] ComponentSizes sizes_of(const FromStep& from) const {
        const std::uint64_t vertices = from.mesh->layout().vertices;
        if (!from.simplified) {
            return component_sizes(vertices, from.mesh->corners(), scratch_);
        }
        return component_sizes(vertices, from.simplifier->corners(*from.simplified).all(),
                               scratch_);
    }
    AnalysedMesh emitted(const FromStep& from, double asked, MeshSink& sink) {
        CornerView elements = from.mesh->corners();
        std::optional<CornerFile> corners;
        if (from.simplified) {
            corners.emplace(from.simplifier->corners(*from.simplified));
            elements = corners->all();
        }
        return {.mesh = emit_elements(*from.mesh, elements, scratch_, sink, progress_),
                .asked = asked,
                .bound = from.bound + place_.max_moved()};
    }

    const AnalysisFile& analysis_;
    MeshLayout layout_;
    const MeshPlace& place_;
    const ScratchFolder& scratch_;
    Progress& progress_;
};

/// Whether the meshes of the analysis are too coarse for the request.
bool is_too_fine(const DistanceChoice& choice, const AnalysisFile& analysis, double limit) {
    const AnalysisStep& first = analysis.steps().front();
    return limit < first.bound || (choice.triangles && first.triangles <= *choice.triangles);
}

AnalysisUse use_of(AnalysisState state) {
    switch (state) {
        case AnalysisState::current:
            return AnalysisUse::found;
        case AnalysisState::stale:
            return AnalysisUse::replaced_stale;
        case AnalysisState::damaged:
            return AnalysisUse::replaced_damaged;
        case AnalysisState::none:
            break;
    }
    return AnalysisUse::made;
}

}  // namespace

std::optional<ExtractReport> extract_analysed(const StoreReader& store, const ExtractQuery& asked,
                                              MeshSink& sink, const ExtractOptions& options,
                                              Progress& progress) {
    const auto start = std::chrono::steady_clock::now();
    const DistanceChoice& choice = *asked.stages.distance;
    const std::string name = store.path().string();
    MeshPlace place = asked.place(store.layout().header().nodes);
    // Far from 0, float32 rounding may exceed the distance of the first step.
    if (choice.within < kFirstLadderStep * place.voxel() ||
        kFirstLadderStep * place.voxel() < 2 * place.max_moved()) {
        return std::nullopt;
    }
    const int threads = distance_stage_threads(memory_of(options, name));
    const ScratchFolder scratch = ScratchFolder::metered(options.scratch);
    const AnalysisName wanted = analysis_name(store, asked);
    FoundAnalysis found = find_analysis(store, wanted);
    const AnalysisUse use = use_of(found.state);
    std::vector<std::filesystem::path> inputs{store.path(), found.path};
    if (asked.values != nullptr) {
        inputs.push_back(asked.values->path());
    }
    const MeshLayout layout =
        layout_of(asked.traversal.attributes, asked.corners(), store.layout().header().unit,
                  store.layout().header().frame);
    sink.prepare(layout, inputs);
    if (use != AnalysisUse::found) {
        require_place(found.path, store);
        found.file.reset();
        ExtractQuery full = asked;
        full.stages.distance.reset();
        ScratchMesh mesh(scratch);
        const ExtractReport report = extract_in_own_axes(store, full, mesh, options, progress);
        make_analysis(store, wanted, mesh, report, place, threads, scratch, progress);
        found = find_analysis(store, wanted);
    }
    if (found.state != AnalysisState::current) {
        throw Error(ErrorKind::corrupt, {found.path.string()},
                    "it disappeared after it was written: " + found.problem);
    }
    const AnalysisFile& analysis = *found.file;
    place.rounding = analysis.surface().coordinate_rounding;
    const double limit = distance_left(name, choice.within, place.max_moved());
    if (is_too_fine(choice, analysis, limit)) {
        return std::nullopt;
    }
    AnalysedMesh mesh;
    Workers(threads).execute([&] {
        mesh = AnalysedExtraction(analysis, layout, place, scratch, progress)
                   .mesh(choice, limit, name, sink);
    });
    mesh.analysis = {use, found.path};
    return timed(analysed(asked, store, analysis.surface(), mesh, scratch.meter()->peak()), start);
}

}  // namespace isonest::detail
