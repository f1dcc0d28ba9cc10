// Adaptive hexahedral cells: the projected function is continuous and within the error, surfaces
// and slices have no cracks.
#include <catch2/catch.hpp>
#include <set>

#include <isonest/error.h>

#include "query/traverse/adapt_traverse.h"
#include "query/traverse/hexahedra/hex_projection.h"
#include "query/values/topology.h"
#include "tests/support/test_support.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

namespace {

float smooth_f(const Int3& p) {
    return static_cast<float>(smooth(p));
}
float rough(const Int3& p) {
    return static_cast<float>(smooth(p) + 0.3 * noise(p));
}
/// Smooth except in one corner, where it is noise: cells of all sizes.
float graded(const Int3& p) {
    const double far =
        std::hypot(static_cast<double>(p.x), static_cast<double>(p.y), static_cast<double>(p.z));
    return static_cast<float>(0.02 * static_cast<double>(p.x + p.z) +
                              noise(p) * std::exp(-far / 3));
}

PreprocessOptions with_cells(int chunk) {
    PreprocessOptions options = with_chunk(chunk);
    options.fields = {Field::hex_linf, Field::hex_deviation};
    return options;
}

struct HexLeaf {
    int level;
    Int3 at;
    std::array<double, 8> value;

    [[nodiscard]] std::int64_t edge() const { return std::int64_t{1} << level; }
    /// Trilinear between the corners. REQUIRES: p is in the cell.
    [[nodiscard]] double at_point(const Double3& p) const {
        double sum = 0;
        for (unsigned c = 0; c < 8; ++c) {
            double weight = 1;
            for (int axis = 0; axis < 3; ++axis) {
                const double t =
                    (p[static_cast<std::size_t>(axis)] - static_cast<double>(at[axis] * edge())) /
                    static_cast<double>(edge());
                weight *= (c >> static_cast<unsigned>(axis) & 1U) != 0 ? t : 1 - t;
            }
            sum += weight * value[c];
        }
        return sum;
    }
    [[nodiscard]] bool holds(const Double3& p) const {
        for (int axis = 0; axis < 3; ++axis) {
            const double x = p[static_cast<std::size_t>(axis)];
            if (x < static_cast<double>(at[axis] * edge()) ||
                x > static_cast<double>((at[axis] + 1) * edge())) {
                return false;
            }
        }
        return true;
    }
};

void find_leaves(HexProjection& grid, int level, const Int3& at, std::vector<HexLeaf>& leaves) {
    if (level == 0 || !grid.is_refined(level, at)) {
        HexLeaf leaf{level, at, {}};
        for (unsigned c = 0; c < 8; ++c) {
            leaf.value[c] = grid.projected((at + corner_offset(c)) * leaf.edge());
        }
        leaves.push_back(leaf);
        return;
    }
    for (unsigned c = 0; c < 8; ++c) {
        const Int3 child = at * 2 + corner_offset(c);
        const Int3 end = grid.lattice().elements_at(level - 1);
        if (max(child + Int3{1, 1, 1}, end) == end) {
            find_leaves(grid, level - 1, child, leaves);
        }
    }
}

std::vector<HexLeaf> all_leaves(HexProjection& grid) {
    std::vector<HexLeaf> leaves;
    const int top = grid.lattice().top();
    const Int3 roots = grid.lattice().elements_at(top);
    for (std::int64_t i = 0; i < roots.product(); ++i) {
        find_leaves(grid, top, roots.unlinear(i), leaves);
    }
    return leaves;
}

struct Result {
    Mesh mesh;
    std::string bytes;
    ExtractReport report;
};

template <class T>
Result extracted(FunctionVolume<T>& volume, const std::function<void(Extraction&)>& ask,
                 int chunk = 8) {
    const TemporaryFolder folder;
    make_store(volume, folder / "s", with_cells(chunk));
    const StoreReader store(folder / "s");
    Extraction e;
    e.cells = Cells::hexahedra;
    e.threads = 2;
    ask(e);
    Result r;
    r.report = extract(store, folder / "m.ply", e, silent_progress());
    r.bytes = read_file(folder / "m.ply");
    r.mesh = read_mesh(folder / "m.ply");
    return r;
}

void require_whole(const Mesh& mesh, const Int3& n) {
    const MeshFaults faults = check_mesh(
        mesh, {0, 0, 0},
        {static_cast<double>(n.x - 1), static_cast<double>(n.y - 1), static_cast<double>(n.z - 1)});
    CHECK(faults.unused_vertices == 0);
    CHECK(faults.overused_edges == 0);
    CHECK(faults.misoriented_edges == 0);
    CHECK(faults.open_edges_inside == 0);
    CHECK(faults.flat_triangles == 0);
}

const std::vector<Int3> sizes{{33, 33, 33}, {20, 31, 17}, {3, 40, 5}, {41, 6, 13}, {2, 2, 2}};

}  // namespace

TEST_CASE(
    "AdaptTraverse on cells finds the leaves of an explicit refinement, in space and in planes") {
    using Leaf = std::array<std::int64_t, 4>;
    for (const Int3& n : {Int3{33, 33, 33}, Int3{20, 31, 17}, Int3{3, 40, 5}, Int3{2, 2, 2},
                          Int3{33, 20, 1}, Int3{2, 50, 1}}) {
        FunctionVolume<float> volume(n, graded);
        const TemporaryFolder folder;
        make_store(volume, folder / "s", with_cells(8));
        const StoreReader store(folder / "s");
        ChunkCache cache(store, 1U << 24U);
        for (const double error : {0.0, 0.02, 0.4, 1e9}) {
            CAPTURE(n.x, n.y, n.z, error);
            HexProjection grid(cache, Field::hex_deviation, error);
            const Lattice& lattice = grid.lattice();
            std::set<Leaf> by_hand;
            const auto refine = [&](const auto& self, int level, const Int3& at) -> void {
                if (level == 0 || !grid.is_refined(level, at)) {
                    by_hand.insert({level, at.x, at.y, at.z});
                    return;
                }
                const Int3 end = min(at * 2 + Int3{2, 2, 2}, lattice.elements_at(level - 1));
                const Int3 children = end - at * 2;
                for (std::int64_t i = 0; i < children.product(); ++i) {
                    self(self, level - 1, at * 2 + children.unlinear(i));
                }
            };
            refine(refine, lattice.top(), {0, 0, 0});
            std::set<Leaf> found;
            AdaptTraverse<Cell, HexProjection, InBox, Everything, StopsBelow> traversal(
                grid, InBox{volume_box(lattice)}, Everything{},
                StopsBelow{{error, {}, {}, {}, {}}, Field::hex_deviation});
            auto collect = [&](const Cell& cell, double number, Overlap /*where*/) {
                found.insert({cell.level, cell.at.x, cell.at.y, cell.at.z});
                CHECK((cell.level == 0 || number < error));
            };
            for (const Cell& root : traversal.roots(lattice)) {
                traversal.subtree(root, collect);
            }
            CHECK(found == by_hand);
            CHECK(traversal.counts().leaves == by_hand.size());
        }
    }
}

TEST_CASE("the projection is the same on both sides of every face between cells of two levels") {
    for (const Int3& n : sizes) {
        for (const auto function : {smooth_f, rough, graded}) {
            FunctionVolume<float> volume(n, function);
            const TemporaryFolder folder;
            make_store(volume, folder / "s", with_cells(8));
            const StoreReader store(folder / "s");
            ChunkCache cache(store, 1U << 24U);
            for (const double error : {0.02, 0.1, 0.4, 1.5}) {
                CAPTURE(n.x, n.y, n.z, error);
                HexProjection grid(cache, Field::hex_deviation, error);
                const std::vector<HexLeaf> leaves = all_leaves(grid);
                double jump = 0;
                int levels_apart = 0;
                std::size_t faces = 0;
                for (const HexLeaf& a : leaves) {
                    for (const HexLeaf& b : leaves) {
                        if (b.level <= a.level) {
                            continue;
                        }
                        const Int3 low = max(a.at * a.edge(), b.at * b.edge());
                        const Int3 high = min((a.at + Int3{1, 1, 1}) * a.edge(),
                                              (b.at + Int3{1, 1, 1}) * b.edge());
                        if (max(low, high) != high) {
                            continue;
                        }
                        levels_apart = std::max(levels_apart, b.level - a.level);
                        ++faces;
                        for (std::int64_t s = 0; s < 27; ++s) {
                            const Int3 at = Int3{3, 3, 3}.unlinear(s);
                            Double3 p{};
                            for (int axis = 0; axis < 3; ++axis) {
                                p[static_cast<std::size_t>(axis)] =
                                    static_cast<double>(low[axis]) +
                                    0.5 * static_cast<double>(at[axis]) *
                                        static_cast<double>(high[axis] - low[axis]);
                            }
                            jump = std::max(jump, std::fabs(a.at_point(p) - b.at_point(p)));
                        }
                    }
                }
                CHECK(levels_apart <= 1);
                CHECK(jump < 1e-12);
                CHECK((faces > 0 || error != 0.1 || function != graded || n.x != 33));
            }
        }
    }
}

TEST_CASE("the projection is within the error of the data at every node") {
    for (const Int3& n : sizes) {
        for (const auto function : {smooth_f, rough, graded}) {
            FunctionVolume<float> volume(n, function);
            const TemporaryFolder folder;
            make_store(volume, folder / "s", with_cells(8));
            const StoreReader store(folder / "s");
            ChunkCache cache(store, 1U << 24U);
            for (const double error : {0.02, 0.1, 0.4, 1.5}) {
                CAPTURE(n.x, n.y, n.z, error);
                HexProjection grid(cache, Field::hex_deviation, error);
                const std::vector<HexLeaf> leaves = all_leaves(grid);
                double most = 0;
                std::int64_t covered = 0;
                for (const HexLeaf& leaf : leaves) {
                    covered += leaf.edge() * leaf.edge() * leaf.edge();
                    const Int3 nodes = Int3{1, 1, 1} * (leaf.edge() + 1);
                    for (std::int64_t i = 0; i < nodes.product(); ++i) {
                        const Int3 p = leaf.at * leaf.edge() + nodes.unlinear(i);
                        const double u =
                            leaf.at_point({static_cast<double>(p.x), static_cast<double>(p.y),
                                           static_cast<double>(p.z)});
                        most = std::max(most, std::fabs(u - volume.at(p)));
                    }
                }
                CHECK(covered >= (n - Int3{1, 1, 1}).product());
                CHECK(most < error);
            }
        }
    }
}

TEST_CASE("adaptive hexahedral surfaces have no cracks, and their vertices are within the error") {
    for (const Int3& n : sizes) {
        for (const auto function : {smooth_f, rough, graded}) {
            FunctionVolume<float> volume(n, function);
            for (const double iso : {-0.4, 0.13, 0.5}) {
                for (const double error : {0.02, 0.1, 0.4, 1.5}) {
                    CAPTURE(n.x, n.y, n.z, iso, error);
                    const Result r = extracted(volume, [&](Extraction& e) {
                        e.iso = iso;
                        e.error = error;
                    });
                    require_whole(r.mesh, n);
                    CHECK(r.report.error_bound < error);
                    double most = 0;
                    for (const auto& v : r.mesh.vertices) {
                        bool cut = false;
                        for (std::size_t axis = 0; axis < 3; ++axis) {
                            cut =
                                cut || v[axis] == static_cast<float>(n[static_cast<int>(axis)] - 1);
                        }
                        // At the border the side of a coarse triangle is clipped, but not the
                        // function.
                        most =
                            cut ? most
                                : std::max(most,
                                           std::fabs(trilinear(volume, {v[0], v[1], v[2]}) - iso));
                    }
                    // Vertices are on edges of cells, centres of polygons elsewhere.
                    CHECK(most < 2 * error + 1e-4);
                }
            }
        }
    }
}

TEST_CASE("the reported error of adaptive hexahedra includes that of adjacent larger cells") {
    // All cells with a surface are finest ones, but some corners have the values of a larger cell.
    constexpr Int3 kSize{3, 11, 4};
    constexpr std::array<int, 132> kHundredths{
        -261, -260, -263, -255, -256, -254, -272, -278, -268, -306, -322, -293, -322, -357, -305,
        -294, -305, -285, -264, -268, -261, -254, -254, -255, -269, -267, -271, -255, -254, -256,
        -261, -264, -259, -274, -273, -276, -268, -269, -267, -285, -290, -280, -317, -333, -305,
        -333, -368, -316, -306, -317, -297, -277, -280, -274, -267, -267, -268, -282, -280, -284,
        -268, -267, -269, -274, -277, -271, -177, -175, -179, -168, -169, -167, -191, -198, -185,
        -232, -251, -217, -252, -293, -231, -217, -231, -206, -180, -185, -176, -167, -167, -168,
        -187, -184, -189, -168, -168, -169, -176, -180, -173, -81,  -78,  -85,  -69,  -70,  -68,
        -102, -112, -93,  -157, -181, -138, -182, -232, -156, -138, -156, -123, -87,  -93,  -81,
        -67,  -67,  -68,  -96,  -92,  -100, -69,  -68,  -70,  -81,  -86,  -76};
    FunctionVolume<float> volume(kSize, [&](const Int3& p) {
        const auto i = static_cast<std::size_t>(p.x + kSize.x * (p.y + kSize.y * p.z));
        return static_cast<float>(kHundredths.at(i)) / 100;
    });
    const double iso = -0.882;
    const Result r = extracted(volume, [&](Extraction& e) {
        e.iso = iso;
        e.error = 0.622;
    });
    double most = 0;
    for (const auto& v : r.mesh.vertices) {
        int between = 0;
        bool cut = false;
        for (std::size_t axis = 0; axis < 3; ++axis) {
            between += std::fabs(v[axis] - std::rint(v[axis])) > 1e-5F ? 1 : 0;
            cut = cut || v[axis] == static_cast<float>(kSize[static_cast<int>(axis)] - 1);
        }
        if (between == 1 && !cut) {
            most = std::max(most, std::fabs(trilinear(volume, {v[0], v[1], v[2]}) - iso));
        }
    }
    CHECK(most > 0.02);
    CHECK(most <= r.report.error_bound);
    CHECK(r.report.error_bound < 0.622);
}

TEST_CASE("adaptive hexahedral surfaces through nodes, and beside missing values") {
    FunctionVolume<std::uint8_t> levels({25, 22, 20}, [](const Int3& p) {
        return static_cast<std::uint8_t>(20 * (smooth(p) + 2.2) + 3 * noise(p));
    });
    FunctionVolume<float> holes({21, 20, 19}, [](const Int3& p) {
        return noise(p, 3) < 0.001 ? std::numeric_limits<float>::quiet_NaN() : smooth_f(p);
    });
    for (const double error : {1.0, 4.0, 20.0}) {
        for (const double iso : {30.0, 44.0, 50.0}) {
            const Result r = extracted(levels, [&](Extraction& e) {
                e.iso = iso;
                e.error = error;
            });
            const MeshFaults faults = check_mesh(r.mesh, {0, 0, 0}, {24, 21, 19});
            CHECK(faults.overused_edges == 0);
            CHECK(faults.misoriented_edges == 0);
            CHECK(faults.open_edges_inside == 0);
        }
    }
    const Result r = extracted(holes, [&](Extraction& e) {
        e.iso = 0.1;
        e.error = 0.3;
    });
    const MeshFaults faults = check_mesh(r.mesh, {0, 0, 0}, {20, 19, 18});
    CHECK(r.mesh.triangles.size() > 100);
    CHECK(faults.overused_edges == 0);
    CHECK(faults.misoriented_edges == 0);
}

TEST_CASE("adaptive hexahedral slices have no cracks, and the values of the projection") {
    for (const Int3& n : {Int3{33, 33, 33}, Int3{20, 31, 17}}) {
        for (const auto function : {smooth_f, rough, graded}) {
            FunctionVolume<float> volume(n, function);
            for (const WorldPlane& plane :
                 {WorldPlane{{1, 0.7, 0.3}, 15}, WorldPlane{{0, 0, 1}, 7.3},
                  WorldPlane{{0, 1, 0}, 8}, WorldPlane{{1, 1, 0}, 16}}) {
                for (const double error : {0.0, 0.1, 0.4, 1.5}) {
                    CAPTURE(n.x, plane.normal[0], error);
                    const Result r = extracted(volume, [&](Extraction& e) {
                        e.plane = plane;
                        e.error = error;
                    });
                    const MeshFaults faults =
                        check_mesh(r.mesh, {0, 0, 0},
                                   {static_cast<double>(n.x - 1), static_cast<double>(n.y - 1),
                                    static_cast<double>(n.z - 1)});
                    CHECK(r.mesh.triangles.size() > 1);
                    CHECK(faults.overused_edges == 0);
                    CHECK(faults.misoriented_edges == 0);
                    CHECK(faults.open_edges_inside == 0);
                }
            }
        }
    }
}

TEST_CASE("adaptive hexahedral surfaces have the same bytes for any chunks, threads and memory") {
    FunctionVolume<float> volume({61, 47, 53}, graded);
    const auto by = [&](int chunk, int threads, std::uint64_t memory) {
        return extracted(
                   volume,
                   [&](Extraction& e) {
                       e.iso = 0.7;
                       e.error = 0.05;
                       e.threads = threads;
                       e.memory = memory;
                   },
                   chunk)
            .bytes;
    };
    const std::string bytes = by(8, 2, 1U << 30U);
    CHECK(bytes.size() > 1000);
    CHECK(bytes == by(16, 1, 1U << 30U));
    CHECK(bytes == by(8, 1, 40U << 20U));
}

TEST_CASE("for a store without the fields of cells the message says how to make them") {
    const TemporaryFolder folder;
    FunctionVolume<float> volume({9, 9, 9}, smooth_f);
    make_store(volume, folder / "s");
    const StoreReader store(folder / "s");
    SurfaceQuery query;
    query.grid.cells = Cells::hexahedra;
    query.effort = Effort::none;
    query.stop = ErrorBound{0.1};
    REQUIRE_THROWS_WITH(extract_query(store, query, false),
                        Catch::Matchers::Contains("hex_deviation"));
    query.grid.cells = Cells::tetrahedra;
    query.stop = FieldThreshold{Field::hex_linf, 0.1};
    REQUIRE_THROWS_WITH(extract_query(store, query, false),
                        Catch::Matchers::Contains("hexahedral cells"));
}
