// Indicators that are not stored, computed from the values of a volume in memory.
//
// Source: Gerstner, Rumpf, Weikard (2000), section 4, eta_p and eta_{1,p} for any p, and two
// quantities of section 3.
#pragma once

#include <array>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>

#include <isonest/computed_field.h>
#include <isonest/export_field.h>
#include <isonest/field.h>
#include <isonest/int3.h>
#include <isonest/progress.h>

#include "query/study/whole_lattice.h"
#include "store/container/reader.h"
#include "store/lattice/lattice.h"

namespace isonest::detail {

/// The factor of |d| for lp and grad_lp, for each kind of refinement node.
class OffsetFactors {
  public:
    /// REQUIRES: the indicator is one of the two; the lattice's dimension is at least 1.
    OffsetFactors(const Lattice& lattice, const Double3& spacing, const ComputedField& field);

    /// REQUIRES: p is a refinement node of a cube that exists.
    [[nodiscard]] double of(const Int3& p, const NodeInfo& node) const;

  private:
    const Lattice& lattice_;
    double power_;
    bool gradient_;
    int dimension_;
    /// For a cube of edge 2 at a node of scale 1, by the bits of its odd axes: the size of the
    /// elements that refine there, and the integral of |grad hat|^p, or the largest |grad hat|.
    std::array<double, 8> size_{};
    std::array<double, 8> hat_{};
};

// Fills a lattice with an indicator that is not stored.

/// Of an indicator of cells: see compute_cell_indicator(). Of all others: sets the lattice's
/// indicator at all refinement nodes of elements, including those outside the volume; +inf where
/// the node or an end of its refinement edge is missing. Returns the largest finite one. Saturation
/// is that of section 5 of the paper: from fine to coarse, within a level edges, faces, centres.
/// The numbers are stored as float32 (nearest), so a saturated one is at least as large as those
/// that it covers. The same for any number of threads, which are the arena's. Throws
/// Error{cancelled}.
double compute_indicator(WholeLattice& whole, const ComputedField& field, const Double3& spacing,
                         Progress& progress);

// Exports indicators that are not stored to plain volume files.

/// Writes the indicator at the nodes of the finest lattice as float32, 0 at the macro vertices, not
/// saturated if the field is not. The file type is given by the name: see create_volume_file().
/// Throws Error{limit} if the lattice does not fit into the memory (about 20 bytes per node), and
/// Error{invalid_argument, io, corrupt, cancelled}. REQUIRES: options.field
/// is computed.
void export_computed_field(const StoreReader& store, const std::filesystem::path& path,
                           const ExportOptions& options, Progress& progress);

}  // namespace isonest::detail
