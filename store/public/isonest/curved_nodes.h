// Grids whose nodes each have a position of their own (curvilinear structured grids).
#pragma once

#include <cstdint>
#include <memory>

#include <isonest/int3.h>
#include <isonest/value_type.h>

namespace isonest {

/// What a store says about the positions of its nodes as a whole.
///
/// A cell is *folded* if the determinant of the derivative of its trilinear map is 0 at one of its
/// corners, or has the other sign there than in most cells of the grid: its image is turned over,
/// or has an edge, a corner or a face without extent.
struct CurvedNodes {
    ValueType type = ValueType::f64;  ///< of the coordinates: f32 or f64
    Double3 low{};                    ///< bounding box of all nodes, world units
    Double3 high{};
    /// Mean distance of neighbouring nodes along each axis of the lattice, world units; > 0.
    Double3 step{1, 1, 1};
    /// Most cells are mirror images: their determinants are negative.
    bool mirrored = false;
    std::uint64_t folded = 0;  ///< number of folded cells
    Int3 first_folded{};       ///< low node of the first of them, in the order of the nodes

    bool operator==(const CurvedNodes&) const = default;
};

/// Null: the grid is not curvilinear.
using CurvedNodesPtr = std::shared_ptr<const CurvedNodes>;

}  // namespace isonest
