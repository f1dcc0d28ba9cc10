// Covers, which decide whether a triangle is within an error of the values, compared with every
// finest tetrahedron.
#include "tests/simplify/mesh_by_value.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

TEST_CASE("A cover accepts a triangle exactly if every finest tetrahedron does") {
    const Volume<float> volume({21, 18, 26}, [](const Int3& p) {
        return static_cast<float>(5 * smooth(p) + 4 * noise(p));
    });
    class Numbers : public GridNumbers {
      public:
        explicit Numbers(const FunctionVolume<float>& of) : of_(of) {}
        double value(const Int3& node, int /*level*/) override { return of_.at(node); }
        // No element of a level differs from the data by more than their range.
        double deviation(const Int3& /*node*/) override { return 1000; }
        void rest() override {}

      private:
        const FunctionVolume<float>& of_;
    } numbers(volume.function);
    const WorldLattice lattice{{-3, 7, 100}, Double3{1, 0.5, 10}, volume.function.nodes()};
    const double iso = 2.5;
    std::mt19937 random(3);
    for (int i = 0; i < 600; ++i) {
        const Triangle t = any_triangle(i, lattice, random);
        const Triangle world = in_world(t, lattice);
        const double most = exact_max(volume.function, iso, t);
        ValueTree tree(numbers, Lattice(lattice.nodes), iso);
        ValueCover above(tree, lattice, most * (1 + 1e-9) + 1e-9);
        CAPTURE(i, most);
        REQUIRE(above.covers(world));
        REQUIRE(above.largest() == Approx(most).margin(1e-8));
        ValueCover below(tree, lattice, most * (1 - 1e-6));
        REQUIRE_FALSE(below.covers(world));
    }
}

TEST_CASE(
    "A trilinear cover accepts if all samples are within the error, and refuses if one is not") {
    const FunctionVolume<double> volume({21, 18, 26},
                                        [](const Int3& p) { return 5 * smooth(p) + 4 * noise(p); });
    class Numbers : public GridNumbers {
      public:
        explicit Numbers(const FunctionVolume<double>& of) : of_(of) {}
        double value(const Int3& node, int level) override {
            REQUIRE(level == 0);
            return node == missing ? std::numeric_limits<double>::quiet_NaN() : of_.at(node);
        }
        double deviation(const Int3& /*node*/) override { return 0; }
        void rest() override {}
        Int3 missing{-1, -1, -1};

      private:
        const FunctionVolume<double>& of_;
    } numbers(volume);
    const WorldLattice lattice{{-3, 7, 100}, Double3{1, 0.5, 10}, volume.nodes()};
    const double iso = 2.5;
    std::mt19937 random(4);
    for (int i = 0; i < 600; ++i) {
        const Triangle t = any_triangle(i, lattice, random);
        const Triangle world = in_world(t, lattice);
        const double most = max_sampled(volume, iso, t, 200);
        CAPTURE(i, most);
        TrilinearCover above(numbers, lattice, iso, most * 1.03 + 1e-6, 3);
        REQUIRE(above.covers(world));
        REQUIRE(above.largest() >= most * (1 - 1e-9) - 1e-9);
        REQUIRE(above.max_on(world) >= most * (1 - 1e-9) - 1e-9);
        REQUIRE(above.max_on(world) <= 1.2 * most + 1e-6);
        for (const int cuts : {0, 1, 3}) {
            TrilinearCover below(numbers, lattice, iso, most * (1 - 1e-6), cuts);
            REQUIRE_FALSE(below.covers(world));
        }
        const Double3& corner = world[0];
        const bool is_far = std::fabs(trilinear(volume, t[0]) - iso) > 0.7 * most;
        TrilinearCover part(numbers, lattice, iso, 0.7 * most, 3);
        REQUIRE(part.misses(corner) == is_far);
    }
    // A missing node excludes the surrounding cells, and no others.
    numbers.missing = {9, 8, 10};
    TrilinearCover any(numbers, lattice, iso, 1e6, 3);
    REQUIRE_FALSE(
        any.covers(in_world({{{8.5, 8.5, 9.5}, {8.6, 8.5, 9.5}, {8.5, 8.6, 9.5}}}, lattice)));
    REQUIRE_FALSE(any.covers(in_world({{{2, 2, 9.2}, {17, 4, 9.4}, {9, 16, 10.9}}}, lattice)));
    REQUIRE(any.misses(in_world({{{8.5, 8.5, 9.5}, {}, {}}}, lattice)[0]));
    REQUIRE_FALSE(std::isfinite(
        any.max_on(in_world({{{8.5, 8.5, 9.5}, {8.6, 8.5, 9.5}, {8.5, 8.6, 9.5}}}, lattice))));
    REQUIRE(any.covers(in_world({{{7.5, 8.5, 9.5}, {8, 8.5, 9.5}, {7.5, 8.6, 9.5}}}, lattice)));
}

TEST_CASE("A tree that is full is cleared, and what does not fit into an empty one is refused") {
    // So rough that every finest tetrahedron is visited.
    class Numbers : public GridNumbers {
      public:
        double value(const Int3& node, int /*level*/) override { return noise(node); }
        double deviation(const Int3& /*node*/) override { return 10; }
        void rest() override { ++rests; }
        int rests = 0;
    } numbers;
    const WorldLattice lattice{{0, 0, 0}, {}, {513, 513, 513}};
    ValueTree tree(numbers, Lattice(lattice.nodes), 0.5);
    ValueCover cover(tree, lattice, 0.6);
    // About 4 * 40^2 tetrahedra, and their ancestors.
    for (int i = 0; i < 12; ++i) {
        const double z = 40 * i + 0.3;
        REQUIRE(cover.covers({{{3, 3, z}, {83, 3, z + 1}, {3, 83, z + 2}}}));
    }
    REQUIRE(numbers.rests > 0);
    const int before = numbers.rests;
    REQUIRE_FALSE(cover.covers({{{0, 0, 3}, {512, 0, 100}, {0, 512, 300}}}));
    REQUIRE(numbers.rests == before + 1);
    REQUIRE(cover.covers({{{3, 3, 5}, {83, 3, 6}, {3, 83, 7}}}));
}
