// Properties of every correct mesh.
#pragma once

#include <catch2/catch.hpp>

#include "tests/support/test_support.h"

namespace isonest::detail::test {

/// Checks the mesh of a surface in the box from `lo` to `hi`.
inline void require_whole(const Mesh& mesh, const Double3& lo, const Double3& hi) {
    const MeshFaults faults = check_mesh(mesh, lo, hi);
    CHECK(faults.unused_vertices == 0);
    CHECK(faults.overused_edges == 0);
    CHECK(faults.misoriented_edges == 0);
    CHECK(faults.open_edges_inside == 0);
    CHECK(faults.split_vertices == 0);
    CHECK(faults.flat_triangles == 0);
}

}  // namespace isonest::detail::test
