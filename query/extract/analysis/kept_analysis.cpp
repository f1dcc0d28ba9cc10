#include "query/extract/analysis/kept_analysis.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstring>

#include <isonest/error.h>
#include <isonest/version.h>

#include "store/container/codec.h"
#include "store/files/output_file.h"

namespace isonest::detail {
namespace {

constexpr const char* kSuffix = ".analysis";
constexpr std::size_t kBatch = std::size_t{1} << 13U;

/// What has to be the same for an analysis to be that of this store.
std::string store_key(const StoreReader& store) {
    const StoreHeader& h = store.layout().header();
    return fmt::format("isonest {}, store {:016x}, {} x {} x {}, spacing {} {} {}, origin {} {} {}",
                       ISONEST_VERSION, store.identity(), h.nodes.x, h.nodes.y, h.nodes.z,
                       h.spacing[0], h.spacing[1], h.spacing[2], h.origin[0], h.origin[1],
                       h.origin[2]);
}

/// All that the meshes depend on beside the store.
std::string query_key(const StoreReader& store, const ExtractQuery& query) {
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
        key +=
            fmt::format(", components: largest {}, least triangles {}, least volume {}",
                        query.stages.components->largest, query.stages.components->least_triangles,
                        query.stages.components->least_volume);
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
        key += fmt::format(", error {}", name_of(*a.error));
    }
    return key;
}

std::string prefix_of(const StoreReader& store) {
    const std::string name = store.path().filename().string();
    return (name.empty() ? "store" : name) + ".iso";
}

std::filesystem::path folder_of(const std::filesystem::path& file) {
    return file.has_parent_path() ? file.parent_path() : std::filesystem::path(".");
}

std::filesystem::path path_of(const StoreReader& store, const ExtractQuery& query) {
    const std::string key = query_key(store, query);
    return *query.analysis_folder /
           fmt::format("{}{:g}-{:08x}{}", prefix_of(store), query.traversal.iso,
                       static_cast<std::uint32_t>(checksum_of(std::as_bytes(std::span(key)))),
                       kSuffix);
}

/// The key's first line; the second one is query_key().
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

/// Where a mesh's arrays begin in the file, and the file itself.
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

/// Calls f(first, values) for batches of an array without alignment.
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

FoundAnalysis find_analysis(const StoreReader& store, const ExtractQuery& query) {
    FoundAnalysis found = open(store, path_of(store, query), AnalysisDepth::bytes);
    if (found.state == AnalysisState::current &&
        query_text(*found.file) != query_key(store, query)) {
        found.state = AnalysisState::stale;
        found.problem = "of another query";
    }
    return found;
}

std::filesystem::path analysis_folder_of(const StoreReader& store) {
    return store.is_far() ? std::filesystem::path(".") : folder_of(store.path());
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
    // That of a store elsewhere need not be readable for who keeps nothing in it.
    if (error && !store.is_far()) {
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
                    "nothing can be written there; keep the analysis in another folder");
    }
}

void keep_analysis(const StoreReader& store, const ExtractQuery& query, AnalysedSurface surface,
                   const std::vector<LadderStep>& ladder) {
    surface.key = store_key(store) + "\n" + query_key(store, query);
    std::vector<AnalysisStep> steps;
    for (const LadderStep& step : ladder) {
        const MeshLayout& layout = step.mesh->layout();
        surface.row_bytes = layout.row_bytes;
        steps.push_back({step.bound, layout.vertices, layout.elements,
                         analysis_checksum(std::as_bytes(step.mesh->positions()), step.mesh->rows(),
                                           std::as_bytes(step.mesh->corners_in_64_bits()))});
    }
    std::vector<AnalysisOffsets> offsets;
    OutputFile file(path_of(store, query), true, [&](const std::filesystem::path& temporary) {
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

}  // namespace isonest::detail
