// Area and volume of a mesh, summed triangle by triangle while it is handed over.
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include <isonest/extract_report.h>
#include <isonest/mesh_sink.h>

#include "query/mesh/corner_file.h"

namespace isonest::detail {

/// The same for any order of the triangles, hence for any threads and batches. Without memory that
/// grows with the mesh. Thread-safety: none.
class SurfaceSums {
  public:
    SurfaceSums() = default;
    /// For triangles within the layout's box.
    explicit SurfaceSums(const MeshLayout& layout);

    /// Those of a batch.
    void add(const ElementBatch& batch);
    /// REQUIRES: of the same layout.
    void add(const SurfaceSums& other);

    /// Of a mesh without triangles all 0.
    [[nodiscard]] SurfaceMeasures measures() const;

  private:
    __extension__ using Int128 = __int128;

    Double3 centre_{};
    int area_exponent_ = 0;    ///< twice_area_ counts 2^area_exponent_
    int volume_exponent_ = 0;  ///< and six_volumes_ this power of two
    Int128 twice_area_ = 0;
    Int128 six_volumes_ = 0;       ///< with the sign of the side that the triangles face
    std::uint64_t unmatched_ = 0;  ///< 0: no edge has a border
};

/// Of elements whose corners are places in `positions`, which lie within the layout's box.
SurfaceMeasures measures_of(const MeshLayout& layout,
                            std::span<const std::array<float, 3>> positions,
                            const CornerView& elements);

}  // namespace isonest::detail
