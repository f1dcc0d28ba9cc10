// Runs extractions of queries, and describes the contents of a store.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "query/extract/extract_query.h"
#include "store/container/reader.h"

namespace isonest::detail {

// The contents of a store.

struct ArrayReport {
    int level = 0;
    Field field = Field::values;
    Int3 nodes;
    Int3 chunk;
    std::uint64_t chunks = 0;
    std::uint64_t raw_bytes = 0;  ///< without padding
    std::uint64_t stored_bytes = 0;
    double min = 0;  ///< for a store of 64-bit labels, the label, rounded; NaN for its indicators
    double max = 0;
    /// For the values of such a store, if a node has one: the smallest and the largest label.
    std::optional<std::array<std::int64_t, 2>> labels = {};
    bool alias = false;  ///< the same stored array as another field of the level
};

/// Sizes and ranges of all arrays, from the chunk table alone.
std::vector<ArrayReport> describe_arrays(const StoreReader& store);

/// Size of the ranges of all cubes, bytes.
std::uint64_t cube_range_bytes(const StoreReader& store);

/// Like run_extraction(), but the mesh is neither rotated nor measured, and no analysis is used.
ExtractReport extract_in_own_axes(const StoreReader& store, ExtractQuery asked, MeshSink& sink,
                                  const ExtractOptions& options, Progress& progress);

/// Like the public extract(). REQUIRES: `asked` was made for this store and this sink.
ExtractReport run_extraction(const StoreReader& store, ExtractQuery asked, MeshSink& sink,
                             const ExtractOptions& options, Progress& progress);

}  // namespace isonest::detail
