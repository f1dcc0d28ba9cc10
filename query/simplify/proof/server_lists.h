// What each triangle of the full surface is near to, while edges of a patch are collapsed.
//
// A fine triangle is near to the patch if its *servers*, triangles of the patch, are together near
// to all of its points. A collapse changes triangles around one vertex: so only those that these
// serve have to be looked at again, and only the changed triangles are asked for them.
#pragma once

#include <tsl/robin_map.h>

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "query/simplify/collapse/corner_mesh.h"
#include "query/simplify/patch.h"
#include "query/simplify/proof/prepared_triangle.h"
#include "store/base/mixed_hash.h"

namespace isonest::detail {

/// A triangle of the patch, as it will be.
struct Server {
    std::uint32_t triangle = 0;  ///< its place
    PreparedTriangle shape;
};

/// Not thread-safe.
class ServerLists {
  public:
    /// `limit`: > 0, world units. `positions`: of the vertices of the mesh. Both have to stay.
    ServerLists(const Patch& patch, std::span<const std::array<float, 3>> positions, double limit);

    /// The fine triangle is near to these, of the patch. Once for each.
    void set(std::uint32_t fine, std::span<const std::uint32_t> servers);
    /// The same with those that are found among `hint`, a triangle of `mesh`, and the ones around
    /// it. False: these are not near enough, or it is not certain; nothing is changed.
    bool find(std::uint32_t fine, std::uint32_t hint, const CornerMesh& mesh);
    /// None: it may be as far as it likes.
    [[nodiscard]] std::span<const std::uint32_t> servers_of(std::uint32_t fine) const;

    /// Whether all that the triangles `before` serve is near to the mesh still when they are
    /// replaced by `after`, whose places are some of theirs. `moved`: a vertex of the full surface
    /// that is gone then, or kNoVertex; where it is far, the answer comes soon. `mesh`: the patch
    /// before.
    /// May be false where a search among more triangles than these found something.
    bool fits(std::uint32_t moved, std::span<const std::uint32_t> before,
              std::span<const Server> after, const CornerMesh& mesh);
    /// After fits() was true: how far this one is at most from one of the first few fine triangles
    /// that it then serves. Nothing: further than the limit from each of them.
    [[nodiscard]] std::optional<double> served_back(const Server& server) const;
    /// After fits() was true: how far this one is at most from the fine triangles that were asked
    /// about. Nothing: further than the limit, or it is not certain.
    [[nodiscard]] std::optional<double> covered_back(const Server& server);
    /// How many fine triangles fits() asked about.
    [[nodiscard]] std::size_t asked() const { return plans_.size(); }
    /// They were replaced. REQUIRES: fits() was true, and asked last.
    void take();

    /// No point of a fine triangle is further than this from the servers that it got by take().
    [[nodiscard]] double largest() const { return largest_; }

  private:
    struct Plan {
        std::uint32_t fine;
        std::uint32_t first;  ///< in planned_
        std::uint32_t count;
    };
    /// A fine triangle that is looked at, and where it is in served_.
    struct Gathered {
        std::uint32_t fine;
        std::uint32_t server;
        std::uint32_t place;
    };
    /// Around a fine triangle.
    struct Sphere {
        Double3 centre{};
        double radius = -1;  ///< < 0: not known yet
    };
    const Sphere& sphere_of(std::uint32_t fine);
    bool cover_back(const Triangle& t, std::size_t begin, std::size_t end, int depth);
    double square_off(const Triangle& t, const Triangle& from) const;
    void gather_around(std::uint32_t hint, const CornerMesh& mesh);
    void gather(std::span<const std::uint32_t> before);
    void gather(std::uint32_t server, std::uint32_t place);
    bool fits_one(std::uint32_t fine, const CornerMesh& mesh);
    bool fits_cut(const Triangle& t, int depth);
    double square_to(std::uint32_t vertex, std::size_t server);
    bool serves_alone(const PatchTriangle& t, std::size_t server);
    [[nodiscard]] bool is_changed(std::uint32_t triangle) const;

    const Patch& patch_;
    std::span<const std::array<float, 3>> positions_;
    double limit_;
    double square_limit_;
    std::vector<std::uint32_t>
        only_;  ///< of each fine triangle: its server, kNoServer or kSomeServers
    tsl::robin_map<std::uint32_t, std::vector<std::uint32_t>, MixedHash> several_;
    /// Of each triangle of the patch; the one that kept it from being replaced last comes first.
    std::vector<std::vector<std::uint32_t>> served_;

    // The question that fits() is about.
    std::span<const std::uint32_t> before_;
    std::vector<Server> servers_;  ///< those that replace others, then what else the fine one has
    std::size_t changed_ = 0;      ///< of them, how many replace others
    std::size_t last_ = 0;         ///< the one that served last
    std::uint32_t question_ = 0;
    std::vector<std::uint32_t> gathered_in_;  ///< question, of each fine triangle
    std::vector<Gathered> gathered_;
    std::vector<std::uint32_t> measured_in_;  ///< question, of each vertex
    std::vector<std::uint32_t> row_;          ///< of each vertex, in squares_
    std::vector<double> squares_;             ///< of distances from the changed ones; < 0: unknown
    std::vector<Plan> plans_;
    std::vector<std::uint32_t> planned_;
    std::vector<std::uint32_t> found_;
    double worst_ = 0;  ///< square
    double largest_ = 0;
    std::uint32_t found_last_ = kNoServer;  ///< by find()

    // The question that covered_back() is about.
    std::vector<Sphere> spheres_;      ///< of each fine triangle
    std::vector<std::uint32_t> back_;  ///< fine triangles, for each piece those that may be near
    double furthest_back_ = 0;
};

}  // namespace isonest::detail
