// What each triangle of the full surface is near, while edges of a patch are collapsed.
//
// A fine triangle is near the patch if its *witnesses*, triangles of the patch, are together near
// all of its points. A witness *serves* the fine triangles that it is near. A collapse changes
// triangles around one vertex: so only the fine triangles served by these must be checked again,
// and only the changed triangles are candidates.
#pragma once

#include <tsl/robin_map.h>

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "query/simplify/collapse/corner_mesh.h"
#include "query/simplify/patch.h"
#include "query/simplify/proof/point_triangle.h"
#include "store/base/box.h"

namespace isonest::detail {

/// A triangle of the patch after the collapse.
struct Witness {
    std::uint32_t triangle = 0;  ///< its index
    PreparedTriangle shape;
};

/// Not thread-safe.
class WitnessLists {
  public:
    /// `limit`: > 0, world units. `positions`: of the vertices of the mesh. Both references must
    /// outlive this object.
    WitnessLists(const Patch& patch, std::span<const std::array<float, 3>> positions, double limit);

    /// Sets the triangles of the patch that the fine triangle is near. Call once for each.
    void set(std::uint32_t fine, std::span<const std::uint32_t> witnesses);
    /// The same with triangles searched among `hint`, a triangle of `mesh`, and its neighbours.
    /// False: these are not near enough, or it is not certain; nothing is changed.
    bool find(std::uint32_t fine, std::uint32_t hint, const CornerMesh& mesh);
    /// Empty: its distance is not limited.
    [[nodiscard]] std::span<const std::uint32_t> witnesses_of(std::uint32_t fine) const;

    /// Whether everything that the triangles `before` serve is still near the mesh when they are
    /// replaced by `after`, whose indices are some of theirs. `moved`: a vertex of the full surface
    /// that is then removed, or kNoVertex; if it is far away, the answer comes quickly. `mesh`: the
    /// patch before. May be false although a search among more triangles would succeed.
    bool fits(std::uint32_t moved, std::span<const std::uint32_t> before,
              std::span<const Witness> after, const CornerMesh& mesh);
    /// After fits() was true: maximum distance of this triangle from one of the first few fine
    /// triangles that it then serves. Nothing: further than the limit from each of them.
    [[nodiscard]] std::optional<double> served_back(const Witness& witness) const;
    /// After fits() was true: maximum distance of this triangle from the fine triangles that were
    /// checked. Nothing: further than the limit, or not certain.
    [[nodiscard]] std::optional<double> covered_back(const Witness& witness);
    /// Number of fine triangles that fits() checked.
    [[nodiscard]] std::size_t asked() const { return plans_.size(); }
    /// Performs the replacement. REQUIRES: the last fits() was true.
    void take();

    /// Maximum distance of a point of a fine triangle from the witnesses that it got by take().
    [[nodiscard]] double largest() const { return largest_; }

  private:
    struct Plan {
        std::uint32_t fine;
        std::uint32_t first;  ///< in planned_
        std::uint32_t count;
    };
    /// A fine triangle being checked, and its index in served_.
    struct Gathered {
        std::uint32_t fine;
        std::uint32_t witness;
        std::uint32_t place;
    };
    /// The bounding sphere of a fine triangle.
    struct Sphere {
        Double3 centre{};
        double radius = -1;  ///< < 0: not known yet
    };
    const Sphere& sphere_of(std::uint32_t fine);
    bool cover_back(const Triangle& t, std::size_t begin, std::size_t end, int depth);
    double square_off(const Triangle& t, const Triangle& from) const;
    void gather_around(std::uint32_t hint, const CornerMesh& mesh);
    void gather(std::span<const std::uint32_t> before);
    void gather(std::uint32_t witness, std::uint32_t place);
    bool fits_one(std::uint32_t fine, const CornerMesh& mesh);
    bool fits_cut(const Triangle& t, int depth);
    double square_to(std::uint32_t vertex, std::size_t witness);
    bool serves_alone(const PatchTriangle& t, std::size_t witness);
    [[nodiscard]] bool is_changed(std::uint32_t triangle) const;

    const Patch& patch_;
    std::span<const std::array<float, 3>> positions_;
    double limit_;
    double square_limit_;
    std::vector<std::uint32_t>
        only_;  ///< of each fine triangle: its witness, kNoWitness or kSomeWitnesses
    tsl::robin_map<std::uint32_t, std::vector<std::uint32_t>, MixedHash> several_;
    /// For each triangle of the patch; the fine triangle that last prevented its replacement comes
    /// first.
    std::vector<std::vector<std::uint32_t>> served_;

    // State of fits().
    std::span<const std::uint32_t> before_;
    std::vector<Witness>
        witnesses_;            ///< those that replace others, then what else the fine one has
    std::size_t changed_ = 0;  ///< how many of them replace others
    std::size_t last_ = 0;     ///< the one that was used last
    std::uint32_t question_ = 0;
    std::vector<std::uint32_t> gathered_in_;  ///< number of the question, for each fine triangle
    std::vector<Gathered> gathered_;
    std::vector<std::uint32_t> measured_in_;  ///< number of the question, for each vertex
    std::vector<std::uint32_t> row_;          ///< for each vertex, index into squares_
    std::vector<double> squares_;  ///< squared distances from the changed ones; < 0: unknown
    std::vector<Plan> plans_;
    std::vector<std::uint32_t> planned_;
    std::vector<std::uint32_t> found_;
    double worst_ = 0;  ///< square
    double largest_ = 0;
    std::uint32_t found_last_ = kNoWitness;  ///< by find()

    // State of covered_back().
    std::vector<Sphere> spheres_;      ///< of each fine triangle
    std::vector<std::uint32_t> back_;  ///< fine triangles that may be near, for each piece
    double furthest_back_ = 0;
};

}  // namespace isonest::detail
