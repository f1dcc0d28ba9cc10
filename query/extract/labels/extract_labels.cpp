#include "query/extract/labels/extract_labels.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <iterator>
#include <memory>
#include <numeric>
#include <optional>
#include <string>
#include <utility>

#include <isonest/error.h>
#include <isonest/neuroglancer_meshes.h>

#include "query/extract/labels/label_net.h"
#include "query/extract/report.h"
#include "query/mesh/measuring_sink.h"
#include "query/neuroglancer/cut_mesh.h"
#include "query/neuroglancer/encode_fragment.h"
#include "query/neuroglancer/label_files.h"
#include "query/neuroglancer/shards.h"
#include "query/statistics/find_labels.h"
#include "store/base/workers.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {
namespace {

/// Nodes along an edge of a cell at level 0, unless it would contain too many triangles.
constexpr std::int64_t kChunk = 64;
/// No further level is made after one with at most this many triangles.
constexpr std::uint64_t kFewTriangles = 500;

/// Maximum movement of a point by rounding in cells, as a multiple of the distance between nodes
/// along each axis.
double half_step(std::int64_t nodes_in_cell) {
    return static_cast<double>(nodes_in_cell) / kMaxInCell / 2;
}

double diagonal_of_voxel(const StoreHeader& header) {
    return header.steps().diagonal();
}

/// The grid of a label at level 0, with few enough cells to be numbered.
DetailGrid grid_of(const StoreHeader& header, const Label& label) {
    DetailGrid grid;
    grid.origin = header.origin;
    grid.steps = header.steps();
    // The mesh is in the cells of the lattice around the label's nodes.
    grid.first = label.low - Int3{1, 1, 1};
    grid.chunk = kChunk;
    const Int3 nodes = label.high - label.low + Int3{3, 3, 3};
    const auto bits = [&] {
        return ZOrderedCells(ceil_div(nodes, Int3{grid.chunk, grid.chunk, grid.chunk})).bits();
    };
    while (bits() > ZOrderedCells::kMaxBits) {
        grid.chunk *= 2;
    }
    return grid;
}

/// Writes the files of one label.
class LabelDetails {
  public:
    LabelDetails(const LabelNet& net, const StoreHeader& header, const Progress& progress)
        : net_(net), header_(header), scratch_(net.scratch()), progress_(progress) {}

    NeuroglancerReport write(std::size_t number, const Label& label,
                             const std::filesystem::path& folder, Shards* shards) {
        NeuroglancerReport report;
        DetailGrid grid = grid_of(header_, label);
        auto [finest, finest_report] = finest_of(number, label, grid);
        LabelFiles files(folder, label.id, scratch_, shards);
        add(*finest, files, 0, report);
        finest.reset();
        for (int level = 1; level < net_.levels(); ++level) {
            const std::uint64_t before = net_.triangles(number, level - 1);
            if (before <= kFewTriangles ||
                !is_worth_a_level(before, net_.triangles(number, level))) {
                break;
            }
            DetailGrid coarse = grid;
            coarse.level = level;
            CutMesh mesh(coarse, scratch_);
            net_.emit_level(number, level, mesh, progress_);
            if (mesh.largest() > kMaxInFragment) {
                break;
            }
            add(mesh, files, level, report);
        }
        const double widest = *std::max_element(header_.spacing.begin(), header_.spacing.end());
        std::vector<double> scales;
        for (std::size_t level = 0; level < report.levels.size(); ++level) {
            scales.push_back(net_.scale(static_cast<int>(level)) / widest);
        }
        files.publish(grid, scales);
        report.finest = in_cells(std::move(finest_report), half_step(grid.nodes()),
                                 rounding_of(grid), scratch_.meter()->peak());
        return report;
    }

  private:
    /// The finest mesh in cells, none of which has too many triangles.
    std::pair<std::unique_ptr<CutMesh>, ExtractReport> finest_of(std::size_t number,
                                                                 const Label& label,
                                                                 DetailGrid& grid) {
        for (;; grid.chunk /= 2) {
            auto mesh = std::make_unique<CutMesh>(grid, scratch_);
            ExtractReport report = net_.emit_label(number, *mesh, progress_, LabelNet::Axes::own);
            if (mesh->largest() <= kMaxInFragment) {
                return {std::move(mesh), std::move(report)};
            }
            if (grid.chunk == 1) {
                throw Error(ErrorKind::limit,
                            fmt::format("label {}: {} triangles lie between neighbouring nodes, "
                                        "too many for Neuroglancer's format",
                                        label.id, mesh->largest()));
            }
        }
    }
    [[nodiscard]] double rounding_of(const DetailGrid& grid) const {
        return half_step(grid.nodes()) * diagonal_of_voxel(header_);
    }
    void add(const CutMesh& mesh, LabelFiles& files, int level, NeuroglancerReport& report) const {
        DetailLevel made = files.add_level(mesh, progress_);
        made.bound = net_.bound(level) + rounding_of(mesh.grid());
        report.levels.push_back(made);
    }

    const LabelNet& net_;
    const StoreHeader& header_;
    const ScratchFolder& scratch_;
    const Progress& progress_;
};

/// The settings of a net with details.
DetailSetting detail_setting(const StoreHeader& header) {
    // The last level is within 32 voxels, if no distance is requested.
    constexpr int kMaxLevels = 8;
    return {half_step(kChunk) * diagonal_of_voxel(header), kMaxLevels, kFragmentHeap};
}

using Clock = std::chrono::steady_clock;

/// Labels sorted by id.
struct SortedLabels {
    std::vector<Label> labels;
    std::vector<std::size_t> places;  ///< of each in the caller's list

    explicit SortedLabels(std::span<const Label> given) : places(given.size()) {
        std::iota(places.begin(), places.end(), std::size_t{0});
        std::sort(places.begin(), places.end(),
                  [&](std::size_t a, std::size_t b) { return given[a].id < given[b].id; });
        std::transform(places.begin(), places.end(), std::back_inserter(labels),
                       [&](std::size_t i) { return given[i]; });
    }
};

}  // namespace

std::vector<LabelName> known_of(const Store& store, std::span<const Label> labels) {
    std::vector<LabelName> known;
    for (const Label& label : labels) {
        known.push_back(store.label_name(label.id).value_or(LabelName{}));
        known.back().id = label.id;
    }
    return known;
}

std::vector<LabelName> names_of(const Store& store, std::span<const Label> labels) {
    std::vector<LabelName> names = known_of(store, labels);
    const bool has_name = std::any_of(names.begin(), names.end(),
                                      [](const LabelName& name) { return !name.name.empty(); });
    return has_name ? names : std::vector<LabelName>{};
}

}  // namespace isonest::detail

namespace isonest {
namespace {

/// With less memory for each, fewer labels are processed concurrently.
constexpr std::uint64_t kMemoryEach = 256U << 20U;

}  // namespace

void extract_labels(const Store& store, std::span<const Label> labels, const LabelQuery& query,
                    const std::function<std::unique_ptr<MeshSink>(const Label&)>& sink,
                    const std::function<void(std::size_t number, const ExtractReport&)>& done,
                    const ExtractOptions& options, Progress& progress) {
    if (query.smooth) {
        const detail::StoreReader& reader = store.reader();
        const detail::SmoothChoice choice = detail::smooth_choice(reader, query);
        if (labels.empty()) {
            return;
        }
        const detail::SortedLabels sorted(labels);
        const auto start = detail::Clock::now();
        const detail::LabelNet net(reader, sorted.labels, choice, options, {}, progress);
        detail::each_label(detail::kWriteLabels, net.threads(), sorted.labels.size(), progress,
                           [&](std::size_t i) {
                               const std::unique_ptr<MeshSink> to = sink(sorted.labels[i]);
                               done(sorted.places[i],
                                    detail::timed(net.write_label(i, *to, progress), start));
                           });
        return;
    }
    if (labels.empty()) {
        return;
    }
    const int threads = detail::Workers::count_of(options.threads);
    const auto most = std::min<std::uint64_t>(labels.size(), static_cast<std::uint64_t>(threads));
    const auto together =
        static_cast<int>(std::clamp<std::uint64_t>(options.memory / kMemoryEach, 1, most));
    ExtractOptions each = options;
    each.memory = options.memory / static_cast<std::uint64_t>(together);
    each.threads = std::max(threads / together, 1);
    each.team = nullptr;  // only one thread may use it at a time
    detail::LabelProgress silent(progress);
    detail::each_label("extract", together, labels.size(), progress, [&](std::size_t i) {
        LabelQuery own = query;
        own.label = LabelChoice{labels[i].id, {{labels[i].low, labels[i].high}}};
        const std::unique_ptr<MeshSink> to = sink(labels[i]);
        done(i, extract(store, own, *to, each, silent));
    });
}

ExtractReport extract_interfaces(const Store& store, std::span<const Label> labels,
                                 const LabelQuery& query, MeshSink& sink,
                                 const std::function<void(const LabelInterface&)>& each,
                                 const ExtractOptions& options, Progress& progress) {
    const auto start = detail::Clock::now();
    const detail::StoreReader& reader = store.reader();
    const detail::SmoothChoice choice =
        detail::smooth_choice(reader, query, detail::Feature::interfaces);
    MeshLayout layout;
    layout.has_sides = true;
    layout.unit = reader.layout().header().unit;
    layout.frame = reader.layout().header().frame;
    const std::filesystem::path& input = reader.path();
    sink.prepare(layout, std::span(&input, 1));
    const detail::SortedLabels sorted(labels);
    const detail::LabelNet net(reader, sorted.labels, choice, options, {.interfaces = true},
                               progress);
    progress.begin(detail::kWriteLabels, 1, "meshes");
    InterfaceReport interfaces;
    interfaces.outside = net.outside();
    ExtractReport mesh;
    detail::Workers(net.threads()).execute([&] { mesh = net.emit_interfaces(sink, progress); });
    net.each_interface_of([&](const detail::SharedArea& shared) {
        ++interfaces.interfaces;
        if (each) {
            each({shared.label, detail::has_mesh(shared.other) ? shared.other : interfaces.outside,
                  shared.area});
        }
    });
    progress.advance(1);
    return detail::timed(detail::with_interfaces(std::move(mesh), interfaces), start);
}

namespace {

/// Throws the errors of extract_neuroglancer_meshes() before any work.
void require_segments(const Store& store, std::span<const Label> labels) {
    const std::string name = store.reader().path().string();
    if (!has_neuroglancer_meshes()) {
        throw Error(ErrorKind::unsupported,
                    "levels of detail for Neuroglancer need Draco, which this build does not have",
                    {{RemedyKind::install_package, "libdraco-dev"}});
    }
    for (const Label& label : labels) {
        if (label.id < 0) {
            throw Error(
                ErrorKind::invalid_argument, {name},
                fmt::format("label {}: Neuroglancer does not support negative labels", label.id));
        }
    }
}

}  // namespace

Double3 shift_of(const Store& store, VoxelOrigin origin) {
    Double3 shift{};
    const auto& header = store.reader().layout().header();
    for (std::size_t axis = 0; axis < 3 && origin == VoxelOrigin::corner; ++axis) {
        for (std::size_t row = 0; row < 3; ++row) {
            shift[row] += header.direction[axis][row] * header.spacing[axis] / 2;
        }
    }
    return shift;
}

bool has_neuroglancer_meshes() {
    return detail::has_draco();
}

void extract_neuroglancer_meshes(
    const Store& store, std::span<const Label> labels, const LabelQuery& query,
    const std::filesystem::path& folder,
    const std::function<void(std::size_t number, const NeuroglancerReport&)>& done,
    const ExtractOptions& options, Progress& progress, VoxelOrigin origin, MeshStorage storage) {
    require_segments(store, labels);
    std::optional<detail::Shards> shards;
    if (storage == MeshStorage::shards) {
        shards.emplace(detail::ScratchFolder(options.scratch.empty() ? detail::temporary_folder()
                                                                     : options.scratch));
    }
    const auto start = detail::Clock::now();
    const detail::StoreReader& reader = store.reader();
    const detail::StoreHeader& header = reader.layout().header();
    const detail::SmoothChoice choice =
        detail::smooth_choice(reader, query, detail::Feature::details);
    {
        const detail::SortedLabels sorted(labels);
        const detail::LabelNet net(reader, sorted.labels, choice, options,
                                   {.details = detail::detail_setting(header)}, progress);
        detail::each_label(detail::kWriteLabels, net.threads(), sorted.labels.size(), progress,
                           [&](std::size_t i) {
                               NeuroglancerReport report =
                                   detail::LabelDetails(net, header, progress)
                                       .write(i, sorted.labels[i], folder,
                                              shards ? &*shards : nullptr);
                               report.finest = detail::timed(std::move(report.finest), start);
                               done(sorted.places[i], report);
                           });
    }
    std::optional<detail::Sharding> sharding;
    if (shards) {
        sharding = shards->write(folder);
    }
    const std::vector<LabelName> names = detail::names_of(store, labels);
    if (!names.empty()) {
        detail::write_segment_properties(folder, names);
    }
    detail::write_segment_colors(folder, detail::known_of(store, labels));
    detail::write_mesh_info(folder, header, shift_of(store, origin), !names.empty(), sharding);
}

}  // namespace isonest
