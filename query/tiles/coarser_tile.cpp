#include "query/tiles/coarser_tile.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

#include "store/base/box.h"

namespace isonest::detail {
namespace {

/// In steps of the tiles below.
constexpr std::int32_t kJoinedSteps = 2 * kTileSteps;

/// Keeps the vertices that triangles use, in their order.
void drop_unused(TileMesh& mesh) {
    constexpr std::uint32_t kUnused = ~std::uint32_t{0};
    std::vector<std::uint32_t> number(mesh.vertices.size(), kUnused);
    for (const PatchTriangle& t : mesh.triangles) {
        for (const std::uint32_t v : t) {
            number[v] = 0;
        }
    }
    std::uint32_t next = 0;
    for (std::size_t v = 0; v < number.size(); ++v) {
        if (number[v] != kUnused) {
            mesh.vertices[next] = mesh.vertices[v];
            number[v] = next++;
        }
    }
    mesh.vertices.resize(next);
    for (PatchTriangle& t : mesh.triangles) {
        for (std::uint32_t& v : t) {
            v = number[v];
        }
    }
}

/// Whether a point lies in a face of the box of `size` steps at `low`.
bool is_in_face(const Steps& at, const Steps& low, std::int32_t size) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
        if (at[axis] == low[axis] || at[axis] == low[axis] + size) {
            return true;
        }
    }
    return false;
}

std::array<float, 3> position_of(const Steps& at, const Double3& step) {
    std::array<float, 3> p{};
    for (std::size_t axis = 0; axis < 3; ++axis) {
        p[axis] = static_cast<float>(at[axis] * step[axis]);
    }
    return p;
}

/// A tile alone. `low`: its low corner.
Patch patch_of(const TileMesh& tile, const Steps& low, const Double3& step) {
    Patch patch;
    for (const TileMesh::Vertex& v : tile.vertices) {
        patch.positions.push_back(position_of(v.at, step));
        patch.shared.push_back(is_in_face(v.at, low, kTileSteps));
    }
    for (std::size_t axis = 0; axis < 3; ++axis) {
        patch.box.lo[axis] = static_cast<float>(low[axis] * step[axis]);
        patch.box.hi[axis] = static_cast<float>((low[axis] + kTileSteps) * step[axis]);
    }
    patch.fine = tile.triangles;
    patch.set_full();
    return patch;
}

/// What rounding of positions to float32 needs, before simplification and by it.
double float_reserve(const Double3& step) {
    return 2 * std::ldexp(kJoinedSteps * length(step), -24);
}

}  // namespace

SimplifiedTile simplified_alone(const TileMesh& tile, const Double3& step, double limit) {
    SimplifiedTile result{tile, 0};
    // Moved vertices are rounded to steps, and lines are widened by one.
    const double reserve = float_reserve(step) + 1.5 * length(step);
    if (!(limit > reserve)) {
        return result;
    }
    const SimplifiedPatch simplified =
        simplify_patch(patch_of(tile, {}, step), simplify_limits(limit - reserve));
    for (const SimplifiedPatch::Moved& moved : simplified.moved) {
        for (std::size_t axis = 0; axis < 3; ++axis) {
            const double c = static_cast<double>(moved.to[axis]) / step[axis];
            result.mesh.vertices[moved.vertex].at[axis] =
                std::clamp(static_cast<std::int32_t>(std::lround(c)), 0, kTileSteps);
        }
    }
    result.mesh.triangles = simplified.triangles;
    drop_unused(result.mesh);
    widen_lines(result.mesh);
    result.error = simplified.largest + reserve;
    return result;
}

std::uint64_t coarser_tile_heap() {
    constexpr std::uint64_t kMeshBytes = 300;  // of a triangle in the patch, the meshes and lists
    return kMaxJoined * (kSimplifyBytesPerTriangle + kMeshBytes) +
           kMaxInTile * kSimplifyBytesPerTriangle;
}

std::size_t CoarserTile::PlaceHash::operator()(const Place& place) const {
    const MixedHash mixed;
    std::uint64_t key = place.feature;
    for (const std::int32_t c : place.at) {
        key = mixed(key) ^ static_cast<std::uint64_t>(c);
    }
    return mixed(key);
}

CoarserTile::CoarserTile(const Double3& step, double limit)
    : step_(step), reserve_(float_reserve(step)) {
    // In the end, coordinates are rounded by up to a step, and lines are widened by two.
    limit_ = limit - reserve_ - 3 * length(step);
    for (std::size_t axis = 0; axis < 3; ++axis) {
        joined_.box.lo[axis] = 0;
        joined_.box.hi[axis] = static_cast<float>(kJoinedSteps * step[axis]);
    }
}

std::uint32_t CoarserTile::number_of(const TileMesh::Vertex& vertex) {
    const auto [slot, is_new] = numbers_.try_emplace(Place{vertex.at, vertex.feature},
                                                     static_cast<std::uint32_t>(vertices_.size()));
    if (is_new) {
        vertices_.push_back(vertex);
        moved_.push_back(false);
        joined_.positions.push_back(position_of(vertex.at, step_));
        joined_.near.push_back(slot->second);
        joined_.shared.push_back(is_in_face(vertex.at, {}, kJoinedSteps));
    }
    return slot->second;
}

void CoarserTile::add(const TileMesh& tile, const std::array<std::uint32_t, 3>& place) {
    TileMesh shifted = tile;
    Steps low{};
    for (std::size_t axis = 0; axis < 3; ++axis) {
        low[axis] = static_cast<std::int32_t>(place.at(axis)) * kTileSteps;
    }
    std::vector<std::uint32_t> numbers;
    for (TileMesh::Vertex& v : shifted.vertices) {
        for (std::size_t axis = 0; axis < 3; ++axis) {
            v.at[axis] += low[axis];
        }
        numbers.push_back(number_of(v));
    }
    const Patch patch = patch_of(shifted, low, step_);
    if (limit_ > 0) {
        take(shifted, simplify_patch(patch, simplify_limits(limit_)), numbers);
        return;
    }
    SimplifiedPatch same;
    same.triangles = patch.triangles;
    same.displacements = patch.displacements;
    same.kept.resize(same.triangles.size());
    same.tried.resize(same.triangles.size());
    same.witnesses = patch.witnesses;
    same.first_witness.resize(same.triangles.size() + 1);
    std::iota(same.first_witness.begin(), same.first_witness.end(), 0U);
    take(shifted, same, numbers);
}

/// Adds a simplified tile. `numbers`: of its vertices in the joined mesh.
void CoarserTile::take(const TileMesh& tile, const SimplifiedPatch& simplified,
                       const std::vector<std::uint32_t>& numbers) {
    largest_ = std::max(largest_, simplified.largest);
    std::vector<std::uint32_t> now = numbers;
    for (const SimplifiedPatch::Moved& moved : simplified.moved) {
        now[moved.vertex] = static_cast<std::uint32_t>(vertices_.size());
        vertices_.push_back(tile.vertices[moved.vertex]);
        moved_.push_back(true);
        joined_.positions.push_back(moved.to);
        joined_.near.push_back(numbers[moved.vertex]);
        joined_.shared.push_back(false);
    }
    const auto first = static_cast<std::uint32_t>(joined_.triangles.size());
    for (std::size_t i = 0; i < simplified.triangles.size(); ++i) {
        const PatchTriangle& t = simplified.triangles[i];
        joined_.triangles.push_back({now[t[0]], now[t[1]], now[t[2]]});
        joined_.stay.push_back(simplified.kept[i] ? Stay::forever : Stay::no);
        joined_.tried.push_back(simplified.tried[i]);
        joined_.displacements.push_back(simplified.displacements[i]);
    }
    for (std::size_t i = 0; i < tile.triangles.size(); ++i) {
        const PatchTriangle& t = tile.triangles[i];
        joined_.fine.push_back({numbers[t[0]], numbers[t[1]], numbers[t[2]]});
        const auto witnesses = simplified.witnesses_of(i);
        joined_.witnesses.push_back(witnesses.empty()
                                        ? kNoWitness
                                        : (first + witnesses.front()) |
                                              (witnesses.size() > 1 ? kWithOthers : 0U));
    }
}

SimplifiedTile CoarserTile::finish() {
    SimplifiedTile result;
    if (limit_ > 0) {
        const SimplifiedPatch simplified = simplify_patch(joined_, simplify_limits(limit_));
        largest_ = std::max(largest_, simplified.largest);
        result.mesh.triangles = simplified.triangles;
        for (const SimplifiedPatch::Moved& moved : simplified.moved) {
            moved_[moved.vertex] = true;
            joined_.positions[moved.vertex] = moved.to;
        }
    } else {
        result.mesh.triangles = joined_.triangles;
    }
    result.error = largest_ + (largest_ > 0 ? reserve_ : 0);
    TileMesh& mesh = result.mesh;
    mesh.vertices = std::move(vertices_);
    bool rounded = false;
    for (std::size_t v = 0; v < mesh.vertices.size(); ++v) {
        for (std::size_t axis = 0; axis < 3; ++axis) {
            std::int32_t& c = mesh.vertices[v].at[axis];
            rounded = rounded || moved_[v] || c % 2 != 0;
            const double half = static_cast<double>(joined_.positions[v][axis]) / step_[axis] / 2;
            c = moved_[v] ? std::clamp(static_cast<std::int32_t>(std::lround(half)), 0, kTileSteps)
                          : (c + 1) / 2;
        }
    }
    drop_unused(mesh);
    result.error += rounded ? length(step_) : 0;
    if (widen_lines(mesh)) {
        result.error += 2 * length(step_);
    }
    return result;
}

}  // namespace isonest::detail
