#include "query/simplify/block_grid.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <tuple>

#include "store/base/box.h"

namespace isonest::detail {
namespace {

/// The cell that contains a node, relative to the octree's corner.
Int3 cell_at(const Int3& node, std::int64_t cell) {
    return {node.x / cell, node.y / cell, node.z / cell};
}

}  // namespace

BlockGrid::BlockGrid(const WorldLattice& lattice, const ScratchMesh& mesh,
                     const CornerView& triangles, int thirds, std::uint32_t most,
                     const ScratchFolder& folder, Progress& progress)
    : BlockGrid(lattice, mesh, thirds, folder) {
    std::uint64_t i = 0;
    for (const ElementCorners triangle : triangles) {
        constexpr std::uint64_t kOften = 1U << 16U;
        if (i++ % kOften == 0) {
            progress.check();
        }
        count(triangle);
    }
    divide(most);
}

BlockGrid::BlockGrid(const WorldLattice& lattice, const ScratchMesh& mesh, int thirds,
                     const ScratchFolder& folder)
    : lattice_(lattice), mesh_(mesh), folder_(folder), file_(folder) {
    const std::int64_t longest = std::max({lattice.nodes.x, lattice.nodes.y, lattice.nodes.z});
    // Twice as large as the volume: even shifted by two thirds, it contains all of the volume.
    const auto whole = 2 * static_cast<std::int64_t>(
                               std::bit_ceil(static_cast<std::uint64_t>(std::max(longest, kCell))));
    size_ = 2 * whole / kCell;
    const std::int64_t by = whole * thirds / 3;
    shift_ = {by, by, by};
    first_ = cell_at(shift_, kCell);
    cells_ = cell_at(lattice.nodes - Int3{1, 1, 1} + shift_, kCell) - first_ + Int3{1, 1, 1};
    file_.map(static_cast<std::uint64_t>(cells_.product()) * sizeof(std::uint32_t));
}

void BlockGrid::count(const ElementCorners& triangle) {
    ++file_.as<std::uint32_t>()[cell_of(points_of(triangle))];
}

BlockGrid::Points BlockGrid::points_of(const ElementCorners& triangle) const {
    const auto positions = mesh_.positions();
    return {positions[triangle[0]], positions[triangle[1]], positions[triangle[2]]};
}

std::size_t BlockGrid::cell_of(const Points& triangle) const {
    Int3 cell;
    Double3 middle{};
    for (std::size_t a = 0; a < 3; ++a) {
        double sum = 0;
        for (const auto& point : triangle) {
            sum += static_cast<double>(point[a]);
        }
        middle[a] = sum / 3;
    }
    const Double3 position = lattice_.position_of(middle);
    for (int axis = 0; axis < 3; ++axis) {
        const double at = position[static_cast<std::size_t>(axis)];
        const auto last = static_cast<double>(lattice_.nodes[axis] - 1);
        const auto node = static_cast<std::int64_t>(std::floor(std::clamp(at, 0.0, last)));
        cell[axis] = (node + shift_[axis]) / kCell - first_[axis];
    }
    return static_cast<std::size_t>((cell.z * cells_.y + cell.y) * cells_.x + cell.x);
}

std::uint64_t BlockGrid::count_in(const Int3& low, std::int64_t size) const {
    const auto cells = file_.as<const std::uint32_t>();
    const Int3 begin = max(low - first_, {0, 0, 0});
    const Int3 end = min(low - first_ + Int3{size, size, size}, cells_);
    std::uint64_t count = 0;
    for (std::int64_t z = begin.z; z < end.z; ++z) {
        for (std::int64_t y = begin.y; y < end.y; ++y) {
            const std::int64_t row = (z * cells_.y + y) * cells_.x;
            for (std::int64_t x = begin.x; x < end.x; ++x) {
                count += cells[static_cast<std::size_t>(row + x)];
            }
        }
    }
    return count;
}

void BlockGrid::divide(std::uint32_t most) {
    GrowingFile<Begin> begins(folder_);
    divide({0, 0, 0}, size_, most, begins);
    begins.seal();
    const auto all = begins.all();
    std::sort(all.begin(), all.end(), [](const Begin& a, const Begin& b) {
        return std::tie(a.z, a.y, a.x) < std::tie(b.z, b.y, b.x);
    });
    ScratchFile rank_file(folder_);
    rank_file.map(std::max(blocks_, 1U) * sizeof(std::uint32_t));
    const auto rank = rank_file.as<std::uint32_t>();
    for (std::uint32_t i = 0; i < blocks_; ++i) {
        rank[all[i].number] = i;
    }
    for (std::uint32_t& block : file_.as<std::uint32_t>()) {
        block = rank[block];
    }
}

void BlockGrid::divide(const Int3& low, std::int64_t size, std::uint32_t most,
                       GrowingFile<Begin>& begins) {
    const Int3 begin = max(low - first_, {0, 0, 0});
    const Int3 end = min(low - first_ + Int3{size, size, size}, cells_);
    if (min(begin, end - Int3{1, 1, 1}) != begin) {
        return;
    }
    const std::uint64_t count = count_in(low, size);
    if (count > most && size > 1) {
        const std::int64_t half = size / 2;
        for (std::int64_t octant = 0; octant < 8; ++octant) {
            divide(low + Int3{2, 2, 2}.unlinear(octant) * half, half, most, begins);
        }
        return;
    }
    // The mesh has no triangles here, but a coarser mesh may: these belong to the previous block.
    if (count > 0) {
        begins.append({low.z, low.y, low.x, blocks_++});
    }
    const std::uint32_t block = std::max(blocks_, 1U) - 1;
    const auto cells = file_.as<std::uint32_t>();
    for (std::int64_t z = begin.z; z < end.z; ++z) {
        for (std::int64_t y = begin.y; y < end.y; ++y) {
            const std::int64_t row = (z * cells_.y + y) * cells_.x;
            for (std::int64_t x = begin.x; x < end.x; ++x) {
                cells[static_cast<std::size_t>(row + x)] = block;
            }
        }
    }
}

std::uint32_t BlockGrid::block_of(const ElementCorners& triangle) const {
    return block_of(points_of(triangle));
}

std::uint32_t BlockGrid::block_of(const Points& triangle) const {
    return file_.as<const std::uint32_t>()[cell_of(triangle)];
}

}  // namespace isonest::detail
