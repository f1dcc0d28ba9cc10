// Which chunks a rank makes, in the order in which it makes them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include <isonest/int3.h>

#include "preprocess/ranks/pencils.h"
#include "store/container/format.h"

namespace isonest::detail {

struct ChunkPlace {
    const ArrayInfo* array = nullptr;
    Int3 chunk;
    bool operator==(const ChunkPlace&) const = default;
};

/// Behind that of the coarsest level, if that is kBasePass or above: a pass that makes the coarsest
/// values, in one block of whoever has the first pencil. Else kBasePass.
int last_pass(const StoreLayout& layout);

/// Those that one block of a pass makes, in its order.
std::vector<ChunkPlace> chunks_of(const StoreLayout& layout, int pass, const Int3& block);

/// Blocks of one pass that are computed together, y outside, x inside.
struct BlockRow {
    int pass = kBasePass;
    std::int64_t y_begin = 0;
    std::int64_t y_end = 0;
    std::int64_t z = 0;
};

/// A rank's rows of blocks, in order. In memory it takes a few bytes for each pencil of a pass.
class OwnRows {
  public:
    OwnRows(const StoreLayout& layout, const Pencils& pencils, int rank);
    /// False behind the last one.
    bool next(BlockRow& row);

  private:
    const StoreLayout* layout_;
    const Pencils* pencils_;
    int rank_;
    std::vector<PencilBox> boxes_;
    std::size_t box_ = 0;
    std::int64_t row_ = 0;  ///< in the box
    int pass_ = kBasePass;
    std::vector<Pencil> coarse_;  ///< of a pass above
    std::size_t at_ = 0;
};

/// A rank's chunks, in order.
class OwnChunks {
  public:
    OwnChunks(const StoreLayout& layout, const Pencils& pencils, int rank)
        : layout_(&layout), pencils_(&pencils), rows_(layout, pencils, rank) {}
    /// False behind the last one.
    bool next(ChunkPlace& place);

  private:
    const StoreLayout* layout_;
    const Pencils* pencils_;
    OwnRows rows_;
    BlockRow row_;
    Int3 size_{0, 0, 0};      ///< blocks of the row
    std::int64_t block_ = 0;  ///< the next one
    std::vector<ChunkPlace> chunks_;
    std::size_t chunk_ = 0;
};

}  // namespace isonest::detail
