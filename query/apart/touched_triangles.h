// The triangles at vertices that share their places.
#pragma once

#include <oneapi/tbb/task_arena.h>

#include <algorithm>
#include <cstdint>
#include <span>
#include <vector>

#include <isonest/progress.h>

#include "query/apart/keep_apart.h"
#include "query/mesh/scratch_mesh.h"
#include "store/base/in_order.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

/// In a temporary file. Thread-safety: touches() from any thread, the rest from one.
class TouchedTriangles {
  public:
    /// For a mesh of so many vertices. `vertices`: sorted by place. Throws Error{io}.
    TouchedTriangles(std::span<const PlacedVertex> vertices, std::uint64_t mesh_vertices,
                     const ScratchFolder& folder);

    /// Whether a vertex shares its place.
    [[nodiscard]] bool touches(std::uint64_t v) const {
        return (bits_[v / kBits] >> (v % kBits) & 1U) != 0;
    }
    [[nodiscard]] bool touches(const ElementCorners& c) const {
        return touches(c[0]) || touches(c[1]) || touches(c[2]);
    }

    /// Calls make(piece), a vector of triangles, from all threads of the arena, and keeps what it
    /// returns in the order of the pieces. use(triangles) comes in that order, too. Throws what
    /// they throw, and Error{io}.
    template <class Make, class Use>
    void gather(std::uint64_t pieces, const Make& make, const Use& use) {
        in_order(
            static_cast<std::int64_t>(pieces), tbb::this_task_arena::max_concurrency() + 1,
            [&](std::int64_t i) { return make(static_cast<std::size_t>(i)); },
            [&](std::int64_t /*i*/, const auto& some) {
                use(some);
                add(some.triangles);
            });
    }
    /// Those among `size` triangles of which corners(t) gives the corners.
    template <class Corners>
    void gather_among(std::uint64_t size, const Corners& corners, Progress& progress) {
        constexpr std::uint64_t kPiece = std::uint64_t{1} << 16U;
        struct Some {
            std::vector<ElementCorners> triangles;
        };
        gather((size + kPiece - 1) / kPiece,
               [&](std::size_t piece) {
                   progress.check();
                   Some some;
                   for (std::uint64_t t = piece * kPiece; t < std::min(size, (piece + 1) * kPiece);
                        ++t) {
                       if (const ElementCorners c = corners(t); touches(c)) {
                           some.triangles.push_back(c);
                       }
                   }
                   return some;
               },
               [](const Some& /*some*/) {});
    }
    /// REQUIRES: everything was gathered.
    [[nodiscard]] std::span<const ElementCorners> all();

  private:
    static constexpr std::uint64_t kBits = 64;
    void add(std::span<const ElementCorners> triangles);

    ScratchFile bit_file_;
    ScratchFile triangle_file_;
    std::span<std::uint64_t> bits_;
    std::uint64_t count_ = 0;
};

}  // namespace isonest::detail
