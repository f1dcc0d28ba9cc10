// The quality of the indicators: the comparison of the paper's section 6.
//
// Source: Gerstner, Rumpf, Weikard (2000), section 6: the number of cells k and the error of the
// projection P U as functions of the threshold, and the efficiency E = 1 / (k ||P U - U||). There k
// is the number of visited cells, including those of coarser levels, and indicators are compared at
// the same threshold. Here the same quotient is also given for the mesh's elements.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include <isonest/computed_field.h>
#include <isonest/field.h>
#include <isonest/progress.h>
#include <isonest/store.h>
#include <isonest/world.h>

namespace isonest {

struct StudyOptions {
    /// Stop fields: those of nodes for triangles or tetrahedra, those of cells for quadrilaterals
    /// or hexahedra. They must be saturated. Empty: all fields of the store that can be studied
    /// with the other options.
    std::vector<AnyField> fields = {};
    int steps = 25;       ///< number of thresholds from 1 down to `least`, in a geometric sequence
    double least = 1e-4;  ///< relative to the field's largest value
    /// Also count what AdaptTraverse visits for this isosurface. The store must have a bound for
    /// the interest test; fields of cells only in a volume.
    std::optional<double> iso = {};
    /// Restrict the mesh and its error to this plane. Only with a volume, without an isosurface,
    /// and with fields of nodes; the last also applies to all options below.
    std::optional<WorldPlane> plane = {};
    /// Also compute the norms of section 3 in L^p with this p, from 1 to 64. Not with a plane.
    std::optional<double> power = {};
    bool graphs = false;  ///< also compute the distance of the graphs; not with a plane
    std::uint64_t memory = std::uint64_t{1} << 30U;  ///< maximum bytes of heap
    int threads = 0;                                 ///< 0 = all cores
};

/// Norms of P U - U, relative to a range of values and to the size of the domain.
struct ErrorNorms {
    double l1 = 0;
    double l2 = 0;
    double linf = 0;
};

/// Norms over the elements of the finest level without missing data.
struct TrueNorms {
    double value = 0;     ///< of P U - U in L^p, relative to the range and the volume's size^(1/p)
    double gradient = 0;  ///< of grad P U - grad U in L^p, relative to that of grad U
    double gradient_linf = 0;  ///< its largest length, relative to that of grad U
};

/// One threshold of one field. P U is the function on the mesh in which nodes (cells) below the
/// threshold are not refined: linear on each simplex, or d-linear in each cell. Norms are over the
/// volume without missing data, at the nodes of the finest lattice (the trapezoidal rule), and
/// relative to the volume's size and the data's range: so they are between 0 and 1. With a plane,
/// the elements are those whose section has an area, and the norms are over the plane's part in the
/// volume (exact, and relative to its area).
struct StudyRow {
    AnyField field = Field::linf_bar;
    double threshold = 0;       ///< relative to the field's largest finite value
    std::uint64_t visited = 0;  ///< cells of all levels that AdaptTraverse tests for interest
    std::uint64_t leaves = 0;   ///< the mesh's elements, including those that extend outside
    std::uint64_t nodes = 0;  ///< the mesh's nodes in the volume that do not hang; not for a plane
    ErrorNorms norms;         ///< ||P U - U||
    TrueNorms true_norms;     ///< with StudyOptions::power
    double graph_distance = 0;      ///< with StudyOptions::graphs
    std::uint64_t iso_visited = 0;  ///< with StudyOptions::iso: the same for the isosurface
    std::uint64_t iso_leaves = 0;   ///< the mesh's elements that it crosses

    /// The paper's E = 1 / (visited * error); +inf where the error is 0.
    [[nodiscard]] double efficiency(double error) const { return one_over(visited, error); }
    /// The same for the isosurface; the error is the volume's.
    [[nodiscard]] double iso_efficiency(double error) const { return one_over(iso_visited, error); }
    /// 1 / (leaves * error): at the same number of elements this compares the errors.
    [[nodiscard]] double element_efficiency(double error) const { return one_over(leaves, error); }

  private:
    static double one_over(std::uint64_t count, double error) {
        return 1 / (static_cast<double>(count) * error);
    }
};

struct Study {
    std::uint64_t all_elements = 0;  ///< leaves of the finest mesh of triangles or tetrahedra
    std::uint64_t all_cells = 0;     ///< of the finest grid of quadrilaterals or hexahedra
    std::vector<StudyRow> rows;      ///< field by field, with decreasing thresholds
};

/// Holds the volume in memory. Throws Error{not_found} for a field that the store lacks,
/// Error{limit} if the lattice does not fit into the memory (about 20 bytes per node),
/// Error{invalid_argument} for options that contradict each other or a plane that misses the
/// volume, Error{unsupported} for labels of 64 bits, Error{corrupt, io, cancelled}. Thread-safety:
/// any number of concurrent calls.
Study study(const Store& store, const StudyOptions& options = {},
            Progress& progress = silent_progress());

}  // namespace isonest
