#include "query/extract/labels/label_details.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <memory>

#include <isonest/error.h>

#include "query/neuroglancer/cut_mesh.h"
#include "query/neuroglancer/encode_fragment.h"
#include "query/neuroglancer/label_files.h"
#include "store/base/hypot3.h"

namespace isonest::detail {
namespace {

/// Nodes along an edge of a cell at level 0, where not so many triangles are in one.
constexpr std::int64_t kChunk = 64;
/// A level behind one that has no more triangles is not made.
constexpr std::uint64_t kFewTriangles = 500;

/// What rounding in cells moves a point, at most, in distances between nodes along each axis.
double half_step(std::int64_t nodes_in_cell) {
    return static_cast<double>(nodes_in_cell) / kMostInCell / 2;
}

double diagonal_of_voxel(const StoreHeader& header) {
    const Double3& d = header.spacing;
    return hypot3(d[0], d[1], d[2]);
}

/// The first cells of a label: few enough of them that all are numbered.
DetailGrid grid_of(const StoreHeader& header, const Label& label) {
    DetailGrid grid;
    grid.origin = header.origin;
    grid.spacing = header.spacing;
    // The mesh lies in the cells of the lattice around the label's nodes.
    grid.first = label.low - Int3{1, 1, 1};
    grid.chunk = kChunk;
    const Int3 nodes = label.high - label.low + Int3{3, 3, 3};
    const auto bits = [&] {
        return ZOrderedCells(ceil_div(nodes, Int3{grid.chunk, grid.chunk, grid.chunk})).bits();
    };
    while (bits() > ZOrderedCells::kMostBits) {
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
                             const std::filesystem::path& folder) {
        NeuroglancerReport report;
        DetailGrid grid = grid_of(header_, label);
        std::unique_ptr<CutMesh> finest = finest_of(number, label, grid, report.finest);
        LabelFiles files(folder, label.id, scratch_);
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
            if (mesh.largest() > kMostInFragment) {
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
        return report;
    }

  private:
    /// The finest mesh in cells none of which has too many triangles.
    std::unique_ptr<CutMesh> finest_of(std::size_t number, const Label& label, DetailGrid& grid,
                                       ExtractReport& report) {
        for (;; grid.chunk /= 2) {
            auto mesh = std::make_unique<CutMesh>(grid, scratch_);
            report = net_.emit_label(number, *mesh, progress_, LabelNet::Axes::own);
            if (mesh->largest() <= kMostInFragment) {
                add_rounding(report, grid);
                return mesh;
            }
            if (grid.chunk == 1) {
                throw Error(ErrorKind::limit,
                            fmt::format("label {}: {} triangles lie between neighbouring nodes, "
                                        "more than Neuroglancer's format takes here",
                                        label.id, mesh->largest()));
            }
        }
    }
    [[nodiscard]] double rounding_of(const DetailGrid& grid) const {
        return half_step(grid.nodes()) * diagonal_of_voxel(header_);
    }
    void add_rounding(ExtractReport& report, const DetailGrid& grid) const {
        const double moved = rounding_of(grid);
        report.coordinate_rounding += half_step(grid.nodes());
        if (report.distance) {
            report.distance->bound += moved;
        }
        if (report.smooth && report.triangles > 0) {
            report.smooth->bound += moved;
            if (report.smooth->nodes_beyond > 0) {
                report.smooth->nodes_beyond += moved;
            }
        }
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

}  // namespace

DetailSetting detail_setting(const StoreHeader& header) {
    // The last one is within 32 voxels, if nothing is asked for.
    constexpr int kMostLevels = 8;
    return {half_step(kChunk) * diagonal_of_voxel(header), kMostLevels, kFragmentHeap};
}

NeuroglancerReport write_label_details(const LabelNet& net, const StoreHeader& header,
                                       std::size_t number, const Label& label,
                                       const std::filesystem::path& folder,
                                       const Progress& progress) {
    return LabelDetails(net, header, progress).write(number, label, folder);
}

}  // namespace isonest::detail
