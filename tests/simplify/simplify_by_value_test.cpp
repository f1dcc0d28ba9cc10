// Surfaces simplified within an error of the values: the error on the final triangles, compared
// with a search through every finest tetrahedron and with sampling; topology.
#include "tests/simplify/mesh_by_value.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

TEST_CASE(
    "All points of all triangles are within the error, and the topology is the nested grid's") {
    const Volume<float> rough({23, 30, 19},
                              [](const Int3& p) { return static_cast<float>(noise(p)); });
    for (const double error : {0.01, 0.1, 0.4}) {
        require_within(rough, 0.5, error);
    }
    const Volume<std::uint8_t> checkers({12, 15, 13}, [](const Int3& p) {
        return static_cast<std::uint8_t>(((p.x / 2 + p.y / 2 + p.z / 2) & 1) != 0 ? 200 : 10);
    });
    for (const double error : {5.0, 60.0}) {
        require_within(checkers, 100.5, error);
    }
    const Volume<float> sphere({33, 33, 33}, [](const Int3& p) {
        return static_cast<float>(ball(p, {15.3, 16.1, 15.9}));
    });
    for (const double error : {0.05, 0.5, 3.0}) {
        require_within(sphere, 11.2, error);
    }
    const Volume<double> waves({37, 22, 41}, [](const Int3& p) { return bumpy(p); });
    for (const double error : {0.3, 2.0, 8.0}) {
        require_within(waves, 1.7, error);
        require_within(waves, 1.7, error, {}, VertexPlace::exact);
        require_within(waves, 1.7, error, WorldBox{{2.5, 3, 4.25}, {31, 18.75, 36.5}});
    }
}

TEST_CASE("Node values at the isovalue, other voxels and integers stay within the error, too") {
    const Volume<std::int16_t> plateau({20, 21, 18}, [](const Int3& p) {
        return static_cast<std::int16_t>(std::clamp(3 * (ball(p, {9, 10, 8}) - 6), -5.0, 5.0) / 5 *
                                         (p.x % 5 == 0 ? 0 : 300));
    });
    for (const double error : {3.0, 50.0, 150.0}) {
        require_within(plateau, 0, error);
    }
    const Volume<float> flat_voxels(
        {24, 27, 15}, [](const Int3& p) { return static_cast<float>(bumpy(p)); }, {1, 1, 10});
    for (const double error : {0.5, 4.0}) {
        require_within(flat_voxels, 1.7, error);
    }
    const Volume<std::uint16_t> steps({26, 17, 33}, [](const Int3& p) {
        return static_cast<std::uint16_t>(1000 + 40 * bumpy(p));
    });
    for (const double error : {1.0, 30.0, 200.0}) {
        require_within(steps, 1060, error);
    }
}

TEST_CASE("Tetrahedra simplified fast are within the error, too") {
    const Volume<float> rough({23, 30, 19},
                              [](const Int3& p) { return static_cast<float>(noise(p)); });
    const Volume<double> waves({37, 22, 41}, [](const Int3& p) { return bumpy(p); });
    const Volume<float> holes({25, 24, 23}, [](const Int3& p) {
        const bool missing = p == Int3{2, 2, 2} || (ball(p, {12, 12, 12}) < 4 && p.x > 9);
        return missing ? std::numeric_limits<float>::quiet_NaN() : static_cast<float>(bumpy(p));
    });
    for (const double error : {0.05, 0.4}) {
        require_within(rough, 0.5, error, {}, VertexPlace::linear, Effort::fast);
    }
    for (const double error : {0.3, 8.0}) {
        require_within(waves, 1.7, error, {}, VertexPlace::linear, Effort::fast);
        require_within(waves, 1.7, error, WorldBox{{2.5, 3, 4.25}, {31, 18.75, 36.5}},
                       VertexPlace::exact, Effort::fast);
        require_within(holes, 1.7, error, {}, VertexPlace::linear, Effort::fast);
    }
}

TEST_CASE(
    "New triangles of hexahedra are within the error, the others are those at full resolution") {
    const Volume<float> rough({23, 30, 19},
                              [](const Int3& p) { return static_cast<float>(noise(p)); });
    const Volume<std::uint8_t> checkers({12, 15, 13}, [](const Int3& p) {
        return static_cast<std::uint8_t>(((p.x / 2 + p.y / 2 + p.z / 2) & 1) != 0 ? 200 : 10);
    });
    const Volume<float> sphere({33, 33, 33}, [](const Int3& p) {
        return static_cast<float>(ball(p, {15.3, 16.1, 15.9}));
    });
    const Volume<double> waves({37, 22, 41}, [](const Int3& p) { return bumpy(p); });
    const Volume<std::int16_t> plateau({20, 21, 18}, [](const Int3& p) {
        return static_cast<std::int16_t>(std::clamp(3 * (ball(p, {9, 10, 8}) - 6), -5.0, 5.0) / 5 *
                                         (p.x % 5 == 0 ? 0 : 300));
    });
    const Volume<float> flat_voxels(
        {24, 27, 15}, [](const Int3& p) { return static_cast<float>(bumpy(p)); }, {1, 1, 10});
    const Volume<std::uint16_t> steps({26, 17, 33}, [](const Int3& p) {
        return static_cast<std::uint16_t>(1000 + 40 * bumpy(p));
    });
    const Volume<float> holes({25, 24, 23}, [](const Int3& p) {
        const bool missing = p == Int3{2, 2, 2} || (ball(p, {12, 12, 12}) < 4 && p.x > 9);
        return missing ? std::numeric_limits<float>::quiet_NaN() : static_cast<float>(bumpy(p));
    });
    for (const Effort effort : {Effort::fast, Effort::best}) {
        for (const double error : {0.1, 0.4}) {
            require_hexahedra_within(rough, 0.5, error, effort);
        }
        require_hexahedra_within(checkers, 100.5, 90.0, effort);
        for (const double error : {0.05, 0.5, 3.0}) {
            require_hexahedra_within(sphere, 11.2, error, effort);
        }
        for (const double error : {0.3, 2.0, 8.0}) {
            require_hexahedra_within(waves, 1.7, error, effort);
            require_hexahedra_within(waves, 1.7, error, effort,
                                     WorldBox{{2.5, 3, 4.25}, {31, 18.75, 36.5}});
        }
        for (const double error : {50.0, 150.0}) {
            require_hexahedra_within(plateau, 0, error, effort);
        }
        for (const double error : {0.5, 4.0}) {
            require_hexahedra_within(flat_voxels, 1.7, error, effort);
        }
        for (const double error : {1.0, 200.0}) {
            require_hexahedra_within(steps, 1060, error, effort);
        }
        for (const double error : {0.5, 4.0, 10.0}) {
            require_hexahedra_within(holes, 1.7, error, effort);
        }
        for (const Outside outside : {Outside::below, Outside::above}) {
            require_hexahedra_within(waves, 1.7, 2.0, effort, {}, outside);
            require_hexahedra_within(waves, 1.7, 2.0, effort,
                                     WorldBox{{2.5, 3, 4.25}, {31, 18.75, 36.5}}, outside);
        }
    }
    const std::size_t fast = require_hexahedra_within(waves, 1.7, 2.0, Effort::fast);
    REQUIRE(require_hexahedra_within(waves, 1.7, 2.0, Effort::best) < fast);
}

TEST_CASE(
    "Solids of hexahedra contain what is clearly inside and nothing that is clearly outside") {
    const Volume<float> volume({26, 23, 29},
                               [](const Int3& p) { return static_cast<float>(bumpy(p)); });
    std::mt19937 random(8);
    std::uniform_real_distribution<double> number(0, 1);
    for (const Effort effort : {Effort::fast, Effort::best}) {
        for (const bool has_box : {false, true}) {
            WorldBox box{{0, 0, 0}, {25, 22, 28}};
            SurfaceQuery query{.iso = 1.7};
            query.grid.cells = Cells::hexahedra;
            query.stop = ErrorBound{4};
            query.effort = effort;
            query.stages.close = Outside::below;
            if (has_box) {
                box = {{2.5, 3, 4.25}, {21, 18.75, 26.5}};
                query.box = box;
            }
            const Simple mesh = extracted(*volume.store, query);
            REQUIRE(shape_of(mesh.triangles).border_loops == 0);
            const double most =
                std::max(mesh.report.error_bound, *mesh.report.simplified_error->full_bound);
            int inside = 0;
            for (int i = 0; i < 400; ++i) {
                Double3 p{};
                for (std::size_t axis = 0; axis < 3; ++axis) {
                    p[axis] = box.lo[axis] + number(random) * (box.hi[axis] - box.lo[axis]);
                }
                const auto face = static_cast<std::size_t>(i % 3);
                if (i % 2 == 0) {
                    p[face] = i % 4 == 0 ? box.lo[face] + 1e-3 : box.hi[face] - 1e-3;
                }
                const double above = trilinear(volume.function, p) - 1.7;
                if (std::fabs(above) > most * 1.01) {
                    CAPTURE(static_cast<int>(effort), has_box, p[0], p[1], p[2], above, most);
                    REQUIRE(winding(mesh, p) == Approx(above > 0 ? 1 : 0).margin(0.01));
                    inside += above > 0 ? 1 : 0;
                }
            }
            REQUIRE(inside > 20);
        }
    }
}

TEST_CASE("By default, the cells that read less are used") {
    const Volume<float> fine({41, 38, 35},
                             [](const Int3& p) { return static_cast<float>(bumpy(p)); });
    const Volume<float> smooth_ball({129, 121, 125}, [](const Int3& p) {
        return static_cast<float>(ball(p, {64, 60, 62}) * ball(p, {64, 60, 62}));
    });
    int hexahedra = 0;
    int tetrahedra = 0;
    const auto compare = [&](const auto& volume, double iso, double error) {
        SurfaceQuery query = within(iso, error);
        const Simple nested = extracted(*volume.store, query);
        query.grid.cells.reset();
        query.effort = Effort::fast;
        const Simple fast = extracted(*volume.store, query);
        CAPTURE(error, nested.report.traversal.bytes_read, fast.report.traversal.bytes_read);
        REQUIRE(fast.report.traversal.bytes_read <= nested.report.traversal.bytes_read);
        const bool is_hexahedra = fast.report.traversal.cells == Cells::hexahedra;
        REQUIRE(fast.report.simplified_error->full_bound.has_value() == is_hexahedra);
        (is_hexahedra ? hexahedra : tetrahedra) += 1;
        query.grid.cells = fast.report.traversal.cells;
        REQUIRE(extracted(*volume.store, query).triangles == fast.triangles);
        // Options that only tetrahedra support make them the default.
        query.grid.cells.reset();
        query.grid.vertices = VertexPlace::exact;
        REQUIRE(extracted(*volume.store, query).report.traversal.cells == Cells::tetrahedra);
    };
    for (const double error : {0.1, 1.0, 4.0, 10.0}) {
        compare(fine, 1.7, error);
    }
    REQUIRE(hexahedra > 0);
    for (const double error : {0.01, 1.0, 10.0, 100.0, 1000.0}) {
        compare(smooth_ball, 900, error);
    }
    REQUIRE(tetrahedra > 0);
}

TEST_CASE("A mesh simplified by value does not depend on chunks, threads and memory") {
    FunctionVolume<float> volume(
        {58, 61, 55}, [](const Int3& p) { return static_cast<float>(bumpy(p) + 2 * noise(p, 3)); });
    std::array<std::string, 3> first;
    for (const int chunk : {8, 32}) {
        const TemporaryFolder folder;
        make_store(volume, folder / "s", with_chunk(chunk));
        const Store store(folder / "s");
        for (const auto& [threads, memory] :
             {std::pair{1, std::uint64_t{1} << 30U}, std::pair{3, std::uint64_t{80} << 20U}}) {
            ExtractOptions options;
            options.threads = threads;
            options.memory = memory;
            for (std::size_t i = 0; i < first.size(); ++i) {
                SurfaceQuery query = within(1.7, 0.5);
                if (i > 0) {
                    query.grid.cells = Cells::hexahedra;
                    query.effort = i == 1 ? Effort::fast : Effort::best;
                }
                const auto sink = open_mesh_file(folder / "m.ply", {.replace = true});
                const ExtractReport r = extract(store, query, *sink, options);
                CAPTURE(chunk, threads, memory, i);
                // Several blocks.
                REQUIRE(r.simplified_error->nested_triangles > (i == 0 ? 90000 : 40000));
                const std::string bytes = read_file(folder / "m.ply");
                first[i] = first[i].empty() ? bytes : first[i];
                REQUIRE(bytes == first[i]);
            }
        }
    }
}

TEST_CASE("A simplified surface does not exceed the requested number of triangles") {
    const Volume<float> volume({25, 23, 27},
                               [](const Int3& p) { return static_cast<float>(bumpy(p)); });
    SurfaceQuery at_full{.iso = 1.7};
    at_full.grid.cells = Cells::tetrahedra;
    const std::uint64_t full = extracted(*volume.store, at_full).triangles.size();
    for (const std::uint64_t most : {full / 50, full / 10}) {
        SurfaceQuery query{.iso = 1.7};
        query.grid.cells = Cells::tetrahedra;
        query.stop = TriangleBudgetByError{most};
        const Simple mesh = extracted(*volume.store, query);
        REQUIRE(mesh.report.within_budget == true);
        REQUIRE(mesh.triangles.size() <= most);
        REQUIRE(mesh.triangles.size() > most / 3);
        const Simple same = extracted(*volume.store, within(1.7, mesh.report.tolerance));
        REQUIRE(same.triangles == mesh.triangles);
        query.grid.cells = Cells::hexahedra;
        for (const Effort effort : {Effort::fast, Effort::best}) {
            query.effort = effort;
            const Simple cubes = extracted(*volume.store, query);
            REQUIRE(cubes.triangles.size() <= most);
            REQUIRE(cubes.triangles.size() > most / 3);
            SurfaceQuery again = query;
            again.stop = ErrorBound{cubes.report.tolerance};
            REQUIRE(extracted(*volume.store, again).triangles == cubes.triangles);
        }
        query.grid.cells.reset();
        query.effort = Effort::none;
        REQUIRE(extracted(*volume.store, query).report.tolerance > mesh.report.tolerance);
    }
}

TEST_CASE("Without an error nothing is simplified, and invalid queries are refused") {
    const Volume<float> volume({17, 18, 19},
                               [](const Int3& p) { return static_cast<float>(bumpy(p)); });
    SurfaceQuery at_full{.iso = 1.7};
    at_full.grid.cells = Cells::tetrahedra;
    const Simple full = extracted(*volume.store, at_full);
    at_full.stop = ErrorBound{0};
    const Simple zero = extracted(*volume.store, at_full);
    REQUIRE(zero.triangles == full.triangles);
    REQUIRE(zero.positions == full.positions);
    REQUIRE_FALSE(zero.report.simplified_error);

    SurfaceQuery query = within(1.7, 1);
    query.focus = Focus{};
    REQUIRE_THROWS_WITH(extracted(*volume.store, query), Catch::Contains("focus"));
    query.focus.reset();
    query.camera = Camera{};
    REQUIRE_THROWS_WITH(extracted(*volume.store, query), Catch::Contains("camera"));
    query.camera.reset();
    query.stop = ErrorBound{1, false, ErrorIndicator::estimate};
    REQUIRE_THROWS_WITH(extracted(*volume.store, query), Catch::Contains("estimate"));
    query.stop = ErrorBound{-1};
    REQUIRE_THROWS_AS(extracted(*volume.store, query), Error);
    query.stop = ErrorBound{0};
    REQUIRE_THROWS_WITH(extracted(*volume.store, query), Catch::Contains("effort"));
    query.stop = FieldThreshold{Field::deviation_bar, 1};
    REQUIRE_THROWS_WITH(extracted(*volume.store, query), Catch::Contains("threshold"));

    const Volume<float> flat({17, 18, 1},
                             [](const Int3& p) { return static_cast<float>(bumpy(p)); });
    REQUIRE_THROWS_WITH(extracted(*flat.store, within(1.7, 1)), Catch::Contains("distance"));

    ExtractOptions little;
    little.memory = 24U << 20U;
    try {
        extracted(*volume.store, within(1.7, 1), little);
        FAIL("24 MiB were enough");
    } catch (const Error& e) {
        REQUIRE(e.kind() == ErrorKind::limit);
        REQUIRE_THAT(e.what(), Catch::Contains("simplification within an error"));
    }
}
