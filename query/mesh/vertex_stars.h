// The triangles around some vertices of a mesh that is being changed.
#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "query/mesh/scratch_mesh.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

/// For each marked vertex a chain of the corners that name it. A corner is a number: 3 * triangle +
/// place. The chains lie in mapped temporary files, of which only what belongs to marked vertices
/// is touched. Thread-safety: from one thread.
class VertexStars {
  public:
    /// Throws Error{io}.
    VertexStars(std::uint64_t vertices, std::uint64_t triangles, const ScratchFolder& folder);

    /// Before the first add().
    void mark(std::uint64_t v) { first_[v] = std::max(first_[v], kEnd); }
    [[nodiscard]] bool is_marked(std::uint64_t v) const { return first_[v] != 0; }

    /// The corner names `v` from now on; nothing happens if `v` is not marked.
    void add(std::uint64_t corner, std::uint64_t v) {
        if (is_marked(v)) {
            next_[corner] = first_[v];
            first_[v] = corner + kFirst;
        }
    }
    /// The corner names `v` no more; nothing happens if `v` is not marked. REQUIRES: it did.
    void remove(std::uint64_t corner, std::uint64_t v);
    void remove_all(std::uint64_t v) { first_[v] = kEnd; }

    /// All corners that name `v`; the last that was added first. REQUIRES: is_marked(v).
    void corners_of(std::uint64_t v, std::vector<std::uint64_t>& corners) const;

  private:
    static constexpr std::uint64_t kEnd = 1;    ///< 0: not marked
    static constexpr std::uint64_t kFirst = 2;  ///< stands for corner 0
    ScratchFile first_file_;
    ScratchFile next_file_;
    std::span<std::uint64_t> first_;
    std::span<std::uint64_t> next_;
};

}  // namespace isonest::detail
