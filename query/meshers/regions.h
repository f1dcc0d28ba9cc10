// The connected parts of space with one label that the interfaces of labels bound.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include <isonest/progress.h>

#include "query/mesh/scratch_mesh.h"
#include "store/base/vectors.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

/// The labels behind and in front of a triangle.
using TriangleSides = std::array<std::int64_t, 2>;

struct Region {
    std::int64_t label = 0;
    Double3 inside{};  ///< a point in it
};

/// Two triangles on either side of a wedge around a common edge bound the same region, so the sides
/// of triangles form closed shells. The outer shell of a region encloses a positive volume. From
/// each other shell a line in the direction of x meets a shell of the same region that reaches
/// farther.
class Regions {
  public:
    static constexpr std::uint64_t kMax = std::uint64_t{1} << 20U;  ///< shells
    static constexpr std::uint32_t kNone = 0xFFFFFFFF;

    /// Of the `wanted` labels, ascending. `sides`: of each triangle. REQUIRES: triangles touch in
    /// common edges and vertices only. Throws Error{invalid_argument} for an edge at which a wanted
    /// label is not closed, Error{limit, io, cancelled}.
    Regions(const ScratchMesh& mesh, std::span<const TriangleSides> sides,
            std::span<const std::int64_t> wanted, const ScratchFolder& folder,
            const Progress& progress);

    [[nodiscard]] const std::vector<Region>& all() const { return regions_; }
    /// The shell behind (0) or in front (1) of a triangle; kNone: not of a wanted label.
    [[nodiscard]] std::uint32_t shell(std::uint64_t triangle, std::size_t side) const {
        return shell_of(2 * triangle + side);
    }
    [[nodiscard]] std::uint32_t region_of(std::uint32_t shell) const {
        return region_of_shell_[shell];
    }

  private:
    struct Shell {
        std::int64_t label = 0;
        double volume = 0;
        std::array<float, 3> farthest{};  ///< the vertex with the largest x
        bool has_farthest = false;
        double largest = 0;          ///< of its triangles, the largest area seen along x
        std::uint64_t triangle = 0;  ///< that one
        std::size_t side = 0;        ///< its side
    };
    /// A line along x from a shell.
    struct Line {
        double x = 0;
        double y = 0;
        double z = 0;
        double to = 0;  ///< 1: towards larger x; -1
        std::uint32_t shell = 0;
        std::optional<std::uint64_t> not_triangle = {};  ///< where it begins; else: of its shell
        double hit_at = 0;
        std::optional<std::uint64_t> hit = {};
    };
    [[nodiscard]] std::uint32_t shell_of(std::uint64_t side) const {
        return shells_file_.as<std::uint32_t>()[side];
    }
    void unite_sides(const Progress& progress);
    void unite_around(std::span<const std::uint64_t> triangles, std::uint64_t low,
                      std::uint64_t high);
    void number_shells(const Progress& progress);
    void meet(std::span<Line> lines, const Progress& progress) const;
    void join_shells(const Progress& progress);
    [[nodiscard]] bool is_wanted(std::int64_t label) const;

    const ScratchMesh& mesh_;
    std::span<const TriangleSides> sides_;
    std::span<const std::int64_t> wanted_;
    const ScratchFolder& folder_;
    ScratchFile parent_file_;
    ScratchFile shells_file_;
    std::vector<Shell> shells_;
    std::vector<std::uint32_t> region_of_shell_;
    std::vector<Region> regions_;
};

}  // namespace isonest::detail
