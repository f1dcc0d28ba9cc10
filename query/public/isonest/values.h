// Numbers of a store: values and indicators at the nodes of any level, and values between nodes.
#pragma once

#include <cstdint>
#include <span>

#include <isonest/field.h>
#include <isonest/int3.h>
#include <isonest/progress.h>
#include <isonest/store.h>
#include <isonest/world.h>

namespace isonest {

/// Some nodes of a level: `size` nodes along each axis, from `lo` on. Node p of level L is node
/// 2^L p of the finest level.
struct NodeBox {
    Int3 lo{};
    Int3 size{};
};

struct ReadOptions {
    std::uint64_t memory = std::uint64_t{256} << 20U;  ///< maximum bytes of heap
    int threads = 0;                                   ///< 0 = all cores
};

/// The number of nodes of a level that are in the volume: every 2^level-th along each axis. Throws
/// Error{not_found} if there is no such level.
Int3 nodes_of_level(const Store& store, int level);

/// Reads the values in a box, x fastest. T is the type of the values, double, or, for integers,
/// std::int64_t; labels of 64 bits are std::int64_t. Missing values are NaN or infinite, as in the
/// volume. Each chunk that the box touches is decoded once; no others are read.
///
/// Throws Error{not_found} if there is no such level, Error{invalid_argument} if the box does not
/// lie in the volume, `values` does not have as many elements, or T cannot hold the values,
/// Error{limit} if the memory does not suffice for a chunk, Error{corrupt, io, cancelled}.
/// Thread-safety: any number of concurrent calls.
template <class T>
void read_values(const Store& store, int level, const NodeBox& box, std::span<T> values,
                 const ReadOptions& options = {}, Progress& progress = silent_progress());

/// Reads an indicator at the nodes in a box of a level, x fastest: +inf where a value is missing, 0
/// at nodes that refine no element. At level 0 these are the numbers that export_field() writes,
/// before its rounding to float32. Throws what read_values() throws, Error{not_found} if the store
/// lacks the field, Error{invalid_argument} for Field::values and fields of cells, and
/// Error{unsupported} for labels of 64 bits. Thread-safety: any number of concurrent calls.
void read_indicator(const Store& store, Field field, int level, const NodeBox& box,
                    std::span<double> numbers, const ReadOptions& options = {},
                    Progress& progress = silent_progress());

struct SampleOptions {
    int level = 0;
    /// How values are interpolated between the nodes of the level: linearly on the tetrahedra of
    /// the nested grid (in a plane its triangles), or trilinearly (bilinearly) in cubes. These are
    /// the functions whose surfaces extract() makes at full resolution, if the level is 0.
    Cells cells = Cells::tetrahedra;
    std::uint64_t memory = std::uint64_t{256} << 20U;  ///< maximum bytes of heap
    int threads = 0;                                   ///< 0 = all cores
};

/// Interpolates the values at points in world coordinates. The result is NaN outside the volume,
/// and where a node with a weight other than 0 is missing. Points are rounded to 2^-32 of a step of
/// the finest lattice, so that a point at a node gets the node's value. The result does not depend
/// on the threads or the memory. Points that are close together should follow each other: as many
/// as fit into a quarter of the memory (16 bytes each) are sorted by chunk.
///
/// Throws Error{not_found} if there is no such level, Error{invalid_argument} if `values` does not
/// have as many elements as `points`, Error{unsupported} for labels of 64 bits, Error{limit,
/// corrupt, io, cancelled}. Thread-safety: any number of concurrent calls.
void sample(const Store& store, std::span<const Double3> points, std::span<double> values,
            const SampleOptions& options = {}, Progress& progress = silent_progress());

}  // namespace isonest
