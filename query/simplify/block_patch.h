// A block of a mesh as a patch, with its own numbers of vertices.
#pragma once

#include <tsl/robin_map.h>

#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "query/mesh/scratch_mesh.h"
#include "query/simplify/block_triangles.h"
#include "query/simplify/patch.h"
#include "store/base/mixed_hash.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

/// How many triangles of the mesh have each vertex, in a temporary file; of very many it knows no
/// number. Thread-safety: constant once all are counted.
class Valences {
  public:
    Valences(std::uint64_t vertices, const ScratchFolder& folder) : file_(folder) {
        file_.map(vertices * sizeof(std::uint16_t));
    }
    /// Of `triangles`, which have `corners`.
    template <class T>
    Valences(std::uint64_t vertices, std::span<const T> triangles, const ScratchFolder& folder)
        : Valences(vertices, folder) {
        for (const T& t : triangles) {
            count(t.corners);
        }
    }
    void count(const ElementCorners& triangle) {
        for (const std::uint64_t v : triangle) {
            std::uint16_t& n = file_.as<std::uint16_t>()[v];
            n = static_cast<std::uint16_t>(n + (n < kMany ? 1 : 0));
        }
    }
    /// More than there can be for 65,535 and more.
    [[nodiscard]] std::uint32_t of(std::uint64_t vertex) const {
        const std::uint16_t n = file_.as<const std::uint16_t>()[vertex];
        return n < kMany ? n : std::numeric_limits<std::uint32_t>::max();
    }

  private:
    static constexpr std::uint16_t kMany = std::numeric_limits<std::uint16_t>::max();
    ScratchFile file_;
};

/// A patch and the numbers of its vertices in the mesh.
struct BlockPatch {
    Patch patch;
    std::vector<std::uint64_t> vertex;
};

/// Gives the vertices of a mesh numbers in a patch, in the order in which they come. Not
/// thread-safe.
class PatchNumbering {
  public:
    /// Both have to stay.
    PatchNumbering(const ScratchMesh& mesh, BlockPatch& block) : mesh_(mesh), block_(block) {}

    PatchTriangle local(const ElementCorners& corners) {
        PatchTriangle t{};
        for (std::size_t i = 0; i < 3; ++i) {
            const auto [slot, is_new] =
                place_.try_emplace(corners[i], static_cast<std::uint32_t>(block_.vertex.size()));
            t[i] = slot->second;
            if (is_new) {
                block_.vertex.push_back(corners[i]);
                block_.patch.positions.push_back(mesh_.positions()[corners[i]]);
            }
        }
        return t;
    }
    /// kNoVertex: it has not come.
    [[nodiscard]] std::uint32_t number_of(std::uint64_t vertex) const {
        const auto slot = place_.find(vertex);
        return slot == place_.end() ? kNoVertex : slot->second;
    }

  private:
    const ScratchMesh& mesh_;
    BlockPatch& block_;
    tsl::robin_map<std::uint64_t, std::uint32_t, MixedHash> place_;
};

/// Of each vertex of a patch, whose number in the mesh is `vertex`, whether triangles that are not
/// in the patch have it, too. None that no triangle here has.
inline std::vector<bool> shared_vertices(const Valences& valences,
                                         std::span<const std::uint64_t> vertex,
                                         std::span<const PatchTriangle> triangles) {
    std::vector<std::uint32_t> here(vertex.size());
    for (const PatchTriangle& t : triangles) {
        for (const std::uint32_t v : t) {
            ++here[v];
        }
    }
    std::vector<bool> shared(here.size());
    for (std::size_t v = 0; v < here.size(); ++v) {
        shared[v] = here[v] > 0 && here[v] != valences.of(vertex[v]);
    }
    return shared;
}

}  // namespace isonest::detail
