// Finds the vertices of a mesh that may share their places.
#pragma once

#include <optional>
#include <span>

#include "query/apart/keep_apart.h"
#include "query/mesh/part_store.h"
#include "query/mesh/scratch_mesh.h"
#include "query/mesh/weld.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

/// In a temporary file.
class PlacedVertices {
  public:
    /// Those of PartStore::not_alone(), each once, with their numbers in the welded mesh. REQUIRES:
    /// PartStore::watch() was called. Throws Error{io, cancelled}.
    PlacedVertices(const PartStore& parts, const VertexNumbers& weld,
                   const std::optional<Turn>& turn, const ScratchFolder& folder,
                   Progress& progress);
    /// Those of a mesh in memory with these numbers.
    PlacedVertices(std::span<const std::array<float, 3>> positions,
                   std::span<const std::uint32_t> numbers, const ScratchFolder& folder);
    /// All of a mesh.
    PlacedVertices(const ScratchMesh& mesh, const std::optional<Turn>& turn,
                   const ScratchFolder& folder);

    [[nodiscard]] std::span<PlacedVertex> all() const {
        return file_.as<PlacedVertex>().first(count_);
    }

  private:
    ScratchFile file_;
    std::uint64_t count_ = 0;
};

}  // namespace isonest::detail
