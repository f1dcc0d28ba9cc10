// Sheets that meet in lines are simplified together: meshes of labels compared with the full ones,
// by sampled distances, counted topology and winding numbers of every node.
#include <catch2/catch.hpp>
#include <cmath>
#include <map>
#include <random>

#include "query/simplify/collapse/map_mesh.h"
#include "query/simplify/collapse/sheet_mesh.h"
#include "store/base/workers.h"
#include "tests/support/mapping_ranks.h"
#include "tests/support/surface_samples.h"
#include "tests/support/test_support.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

namespace {

constexpr std::int64_t kOutside = 1000;

/// Labels of n^3 nodes, surrounded by kOutside.
struct LabelCube {
    std::int64_t n;
    std::vector<std::int64_t> label;

    [[nodiscard]] std::int64_t at(const Int3& p) const {
        const bool is_in = std::min({p.x, p.y, p.z}) >= 0 && std::max({p.x, p.y, p.z}) < n;
        return is_in ? label[static_cast<std::size_t>(p.x + n * (p.y + n * p.z))] : kOutside;
    }
};

template <class Of>
LabelCube cube_of(std::int64_t n, const Of& of) {
    LabelCube cube{n, {}};
    for (std::int64_t z = 0; z < n; ++z) {
        for (std::int64_t y = 0; y < n; ++y) {
            for (std::int64_t x = 0; x < n; ++x) {
                cube.label.push_back(of(Int3{x, y, z}));
            }
        }
    }
    return cube;
}

LabelCube voronoi(std::int64_t n, std::int64_t cells, unsigned seed) {
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> place(0, static_cast<double>(n));
    std::vector<Double3> seeds;
    for (std::int64_t i = 0; i < cells; ++i) {
        seeds.push_back({place(random), place(random), place(random)});
    }
    return cube_of(n, [&](const Int3& p) {
        const Double3 at{static_cast<double>(p.x), static_cast<double>(p.y),
                         static_cast<double>(p.z)};
        std::int64_t best = 0;
        for (std::int64_t i = 1; i < cells; ++i) {
            best = square(minus(seeds[static_cast<std::size_t>(i)], at)) <
                           square(minus(seeds[static_cast<std::size_t>(best)], at))
                       ? i
                       : best;
        }
        return best;
    });
}

using Corners = std::array<std::uint64_t, 3>;
using Side = SheetMesh::Sides;

struct Interfaces {
    std::vector<std::array<float, 3>> positions;
    std::vector<Corners> corners;
    std::vector<Side> sides;

    /// The triangles of a label's mesh, facing outward.
    [[nodiscard]] std::vector<Corners> of(std::int64_t label) const {
        std::vector<Corners> triangles;
        for (std::size_t i = 0; i < corners.size(); ++i) {
            const Corners& t = corners[i];
            if (sides[i][0] == label) {
                triangles.push_back(t);
            } else if (sides[i][1] == label) {
                triangles.push_back({t[0], t[2], t[1]});
            }
        }
        return triangles;
    }
};

/// Quads around the edges between nodes, with corners within `jitter` of the centres of cells.
Interfaces interfaces_of(const LabelCube& cube, double jitter, unsigned seed) {
    Interfaces mesh;
    std::mt19937 random(seed);
    std::uniform_real_distribution<float> off(static_cast<float>(-jitter),
                                              static_cast<float>(jitter));
    std::map<std::array<std::int64_t, 3>, std::uint64_t> vertex;
    const auto of_cell = [&](const Int3& c) {
        const auto [slot, is_new] = vertex.try_emplace({c.x, c.y, c.z}, mesh.positions.size());
        if (is_new) {
            mesh.positions.push_back({static_cast<float>(c.x) - 0.5F + off(random),
                                      static_cast<float>(c.y) - 0.5F + off(random),
                                      static_cast<float>(c.z) - 0.5F + off(random)});
        }
        return slot->second;
    };
    for (std::int64_t z = -1; z < cube.n; ++z) {
        for (std::int64_t y = -1; y < cube.n; ++y) {
            for (std::int64_t x = -1; x < cube.n; ++x) {
                for (int axis = 0; axis < 3; ++axis) {
                    const Int3 p{x, y, z};
                    Int3 q = p;
                    ++q[axis];
                    const std::int64_t a = cube.at(p);
                    const std::int64_t b = cube.at(q);
                    if (a == b) {
                        continue;
                    }
                    // Cell c is between the nodes c - 1 and c.
                    Int3 u{};
                    Int3 v{};
                    u[(axis + 1) % 3] = 1;
                    v[(axis + 2) % 3] = 1;
                    std::array<std::uint64_t, 4> quad{of_cell(q), of_cell(q + u),
                                                      of_cell(q + u + v), of_cell(q + v)};
                    if (a > b) {
                        std::swap(quad[1], quad[3]);
                    }
                    const Side side{std::min(a, b), std::max(a, b)};
                    mesh.corners.push_back({quad[0], quad[1], quad[2]});
                    mesh.corners.push_back({quad[0], quad[2], quad[3]});
                    mesh.sides.push_back(side);
                    mesh.sides.push_back(side);
                }
            }
        }
    }
    return mesh;
}

void fill(SheetMesh& sheets, const Interfaces& mesh) {
    MeshLayout layout;
    layout.vertices = mesh.positions.size();
    layout.elements = mesh.corners.size();
    layout.has_sides = true;
    sheets.begin(layout);
    sheets.add_vertices({0, mesh.positions, {}, 0});
    ElementBatch batch;
    batch.corners = mesh.corners;
    batch.sides = mesh.sides;
    sheets.add_elements(batch);
    sheets.end();
}

class InterfaceCollector : public MeshSink {
  public:
    Interfaces mesh;

    void begin(const MeshLayout& layout) override {
        layout_ = layout;
        mesh = {};
    }
    void add_vertices(const VertexBatch& batch) override {
        REQUIRE(batch.first == mesh.positions.size());
        mesh.positions.insert(mesh.positions.end(), batch.positions.begin(), batch.positions.end());
    }
    void add_elements(const ElementBatch& batch) override {
        REQUIRE(batch.first == mesh.corners.size());
        for (std::size_t i = 0; i < batch.corners.size(); ++i) {
            for (std::size_t k = 0; k < 3; ++k) {
                REQUIRE(batch.nearby.positions[batch.nearby_corners[i][k]] ==
                        mesh.positions.at(batch.corners[i][k]));
            }
        }
        mesh.corners.insert(mesh.corners.end(), batch.corners.begin(), batch.corners.end());
        mesh.sides.insert(mesh.sides.end(), batch.sides.begin(), batch.sides.end());
    }
    void end() override {
        REQUIRE(layout_.vertices == mesh.positions.size());
        REQUIRE(layout_.elements == mesh.corners.size());
    }

  private:
    MeshLayout layout_;
};

struct SimplifiedSheets {
    Interfaces all;
    std::map<std::int64_t, Interfaces> of;  ///< label
    std::map<std::int64_t, std::map<std::int64_t, double>> areas;
    double bound = 0;
};

SimplifiedSheets simplified(const Interfaces& full, const LabelCube& cube, double limit,
                            bool keeps_nodes, int threads, BlockMapping& mapping) {
    const TemporaryFolder folder;
    SheetMesh sheets(folder.path());
    fill(sheets, full);
    WorldLattice lattice;
    lattice.nodes = {cube.n, cube.n, cube.n};
    SimplifiedSheets result;
    std::vector<std::int64_t> labels;
    for (const std::int64_t label : std::set(cube.label.begin(), cube.label.end())) {
        labels.push_back(label);
    }
    Workers(threads).execute([&] {
        MeshMapper mapper(sheets.vertices(), lattice, {}, folder.path(), silent_progress());
        mapper.take_sheets(sheets.next_copies(),
                           keeps_nodes ? std::optional(KeptNodes::kMinMargin) : std::nullopt);
        mapper.map_by(mapping);
        const Mapped mapped = mapper.within(mapper.full(sheets.triangles()), limit);
        result.bound = mapped.bound;
        const CornerFile corners = mapper.corners(mapped);
        const SheetOutput output(sheets, corners.all(), labels, folder.path(), silent_progress());
        InterfaceCollector sink;
        output.emit_all({}, sink, silent_progress());
        result.all = sink.mesh;
        for (std::size_t i = 0; i < labels.size(); ++i) {
            static_cast<void>(output.emit_label(i, {}, sink, silent_progress()));
            result.areas[labels[i]] = output.areas(i);
            result.of[labels[i]] = sink.mesh;
        }
    });
    return result;
}

SimplifiedSheets simplified(const Interfaces& full, const LabelCube& cube, double limit,
                            bool keeps_nodes, int threads) {
    LocalMapping local;
    return simplified(full, cube, limit, keeps_nodes, threads, local);
}

std::multiset<std::array<std::array<float, 3>, 3>> places_of(
    const std::vector<std::array<float, 3>>& positions, const std::vector<Corners>& triangles) {
    std::multiset<std::array<std::array<float, 3>, 3>> places;
    for (const Corners& t : triangles) {
        const Corners c = from_smallest(t);
        std::array<std::array<float, 3>, 3> p{positions[c[0]], positions[c[1]], positions[c[2]]};
        std::rotate(p.begin(), std::min_element(p.begin(), p.end()), p.end());
        places.insert(p);
    }
    return places;
}

/// Winding number of a closed mesh around a point (A. van Oosterom, J. Strackee 1983).
int winding(const std::vector<std::array<float, 3>>& positions,
            const std::vector<Corners>& triangles, const Double3& p) {
    double sum = 0;
    for (const Corners& t : triangles) {
        const Double3 a = minus(point_at(positions[t[0]]), p);
        const Double3 b = minus(point_at(positions[t[1]]), p);
        const Double3 c = minus(point_at(positions[t[2]]), p);
        const double la = std::sqrt(square(a));
        const double lb = std::sqrt(square(b));
        const double lc = std::sqrt(square(c));
        sum += std::atan2(dot(a, cross(b, c)),
                          la * lb * lc + dot(a, b) * lc + dot(b, c) * la + dot(c, a) * lb);
    }
    constexpr double kHalfTurn = 6.283185307179586;  // the angles are half solid angles
    return static_cast<int>(std::lround(sum / kHalfTurn));
}

/// The vertices of b are appended to those of a, so that distances can be sampled between both.
double hausdorff(const Interfaces& a, const std::vector<Corners>& of_a, const Interfaces& b,
                 const std::vector<Corners>& of_b) {
    std::vector<std::array<float, 3>> positions = a.positions;
    positions.insert(positions.end(), b.positions.begin(), b.positions.end());
    std::vector<Corners> moved = of_b;
    for (Corners& t : moved) {
        for (std::uint64_t& v : t) {
            v += a.positions.size();
        }
    }
    return std::max(sampled_distance(positions, of_a, moved, 3),
                    sampled_distance(positions, moved, of_a, 3));
}

}  // namespace

TEST_CASE("Each interface is within its own bound, and neighbours share the simplified mesh") {
    const LabelCube cube = voronoi(34, 9, 5);
    const Interfaces full = interfaces_of(cube, 0.1, 7);
    for (const double limit : {0.3, 0.8}) {
        const SimplifiedSheets s = simplified(full, cube, limit, false, 2);
        REQUIRE(s.bound <= limit);
        REQUIRE(s.all.corners.size() < full.corners.size() * (limit < 0.5 ? 6 : 4) / 10);
        std::map<Side, std::vector<Corners>> of_full;
        std::map<Side, std::vector<Corners>> of_left;
        for (std::size_t i = 0; i < full.corners.size(); ++i) {
            of_full[full.sides[i]].push_back(full.corners[i]);
        }
        for (std::size_t i = 0; i < s.all.corners.size(); ++i) {
            of_left[s.all.sides[i]].push_back(s.all.corners[i]);
        }
        REQUIRE(of_left.size() == of_full.size());
        for (const auto& [side, triangles] : of_left) {
            REQUIRE(of_full.contains(side));
            REQUIRE(shape_of(triangles) == shape_of(of_full[side]));
            REQUIRE(hausdorff(full, of_full[side], s.all, triangles) <= s.bound * (1 + 1e-9));
        }
        for (const auto& [label, mesh] : s.of) {
            REQUIRE(places_of(mesh.positions, mesh.corners) ==
                    places_of(s.all.positions, s.all.of(label)));
            REQUIRE(shape_of(mesh.corners) == shape_of(full.of(label)));
            double area = 0;
            for (const auto& [other, part] : s.areas.at(label)) {
                area += part;
                if (other != kOutside) {
                    REQUIRE(s.areas.at(other).at(label) == Approx(part));
                }
            }
            REQUIRE(area > 0);
        }
    }
}

TEST_CASE("No node far from interfaces changes sides, and no node at all if nodes are kept") {
    const LabelCube cube = voronoi(15, 6, 3);
    const Interfaces full = interfaces_of(cube, 0.2, 1);
    for (const bool keeps : {false, true}) {
        const double limit = 1.2;
        const SimplifiedSheets s = simplified(full, cube, limit, keeps, 1);
        REQUIRE(s.all.corners.size() < full.corners.size() / 2);
        int changed = 0;
        for (const auto& [label, mesh] : s.of) {
            std::vector<TriangleTree::Corners> narrow;
            for (const Corners& t : full.corners) {
                narrow.push_back({static_cast<std::uint32_t>(t[0]),
                                  static_cast<std::uint32_t>(t[1]),
                                  static_cast<std::uint32_t>(t[2])});
            }
            const TriangleTree tree(full.positions, narrow);
            for (std::int64_t z = 0; z < cube.n; ++z) {
                for (std::int64_t y = 0; y < cube.n; ++y) {
                    for (std::int64_t x = 0; x < cube.n; ++x) {
                        const Double3 p{static_cast<double>(x), static_cast<double>(y),
                                        static_cast<double>(z)};
                        const int expected = cube.at({x, y, z}) == label ? 1 : 0;
                        if (winding(mesh.positions, mesh.corners, p) != expected) {
                            ++changed;
                            REQUIRE_FALSE(keeps);
                            REQUIRE(std::sqrt(tree.nearest(p, 1e300).square_distance) <=
                                    s.bound * (1 + 1e-9));
                        }
                    }
                }
            }
        }
        REQUIRE((changed == 0) == keeps);  // the limit is large enough for some to change
    }
}

TEST_CASE("Sheets of noise keep their topology, and are the same for any threads") {
    for (const unsigned seed : {1U, 2U, 3U}) {
        std::mt19937 random(seed);
        const LabelCube cube = cube_of(40, [&](const Int3& p) {
            return p.x < 8 ? random() % 4 : (p.x + p.y) / 17 + p.z / 23;
        });
        const Interfaces full = interfaces_of(cube, 0.3, seed);
        const SimplifiedSheets one = simplified(full, cube, 0.5, false, 1);
        const SimplifiedSheets many = simplified(full, cube, 0.5, false, 5);
        REQUIRE(one.all.positions == many.all.positions);
        REQUIRE(one.all.corners == many.all.corners);
        REQUIRE(one.all.sides == many.all.sides);
        REQUIRE(one.all.corners.size() < full.corners.size());
        for (const auto& [label, mesh] : one.of) {
            REQUIRE(shape_of(mesh.corners) == shape_of(full.of(label)));
        }
    }
}

TEST_CASE("Sheets mapped by ranks are the same as those mapped by one process") {
    std::mt19937 random(8);
    const LabelCube cube = cube_of(
        40, [&](const Int3& p) { return p.x < 8 ? random() % 4 : (p.x + p.y) / 17 + p.z / 23; });
    const Interfaces full = interfaces_of(cube, 0.2, 8);
    for (const bool keeps : {false, true}) {
        const SimplifiedSheets alone = simplified(full, cube, 0.5, keeps, 1);
        for (const int size : {2, 3, 7}) {
            SimplifiedSheets shared;
            const std::vector<RankWork> done =
                isonest::test::map_on_ranks(size, {}, [&](BlockMapping& mapping) {
                    shared = simplified(full, cube, 0.5, keeps, 1, mapping);
                });
            REQUIRE(shared.all.positions == alone.all.positions);
            REQUIRE(shared.all.corners == alone.all.corners);
            REQUIRE(shared.all.sides == alone.all.sides);
            REQUIRE(shared.bound == alone.bound);
            REQUIRE(done.back().mapped_triangles > 0);
        }
    }
}
