// The parts that a rank keeps on disk of the levels from which coarser ones are made.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <utility>
#include <vector>

#include <isonest/int3.h>

#include "preprocess/levels/level_blocks.h"
#include "preprocess/levels/level_sink.h"
#include "preprocess/levels/pass_context.h"
#include "preprocess/ranks/pencils.h"
#include "store/container/format.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

/// One array of a level, [z][y][x], of which a rank has some rows: those that it made, and those
/// received from others. Stored in a file of the size of the whole array, with space only for these
/// rows.
class PartialArray {
  public:
    PartialArray(const ArrayInfo& array, const ScratchFolder& folder);
    [[nodiscard]] const ArrayInfo& array() const { return *array_; }
    [[nodiscard]] std::span<std::byte> bytes() const { return file_.as<std::byte>(); }
    [[nodiscard]] std::uint64_t row_bytes() const;
    /// Throws Error{io}, for example on a full disk.
    void reserve(std::uint64_t offset, std::uint64_t bytes) const {
        file_.fill_hole(offset, bytes);
    }
    /// Reserves the nodes of the pencil's blocks, `nodes` rows and planes each.
    void reserve(const Pencil& pencil, std::int64_t nodes) const;
    /// The element of a node; those of the row along x follow.
    [[nodiscard]] std::byte* at(const Int3& node) const;
    /// Stores a chunk whose rows were reserved. Thread-safe for different chunks.
    void put(const EncodedChunk& chunk) const;
    [[nodiscard]] ChunkNodes chunk(const Int3& chunk) const;

  private:
    const ArrayInfo* array_;
    ScratchFile file_;
};

/// The values of level 1 and above and the stored deviations of level 1, as long as they are
/// needed; and the indicators of a pass while it is computed in parts. Thread-safety: put() and
/// chunk() from any thread; the rest from one.
class PartialLevels : public FinerLevels {
  public:
    PartialLevels(const StoreLayout& layout, ScratchFolder folder)
        : layout_(&layout), folder_(std::move(folder)) {}

    /// Reserves space for the results of a pass that are needed later, in a rank's pencils of
    /// `cells` rows of cubes; if the pass is computed in parts, also for its indicators. Throws
    /// Error{io}.
    void begin_pass(int pass, std::span<const Pencil> pencils, std::int64_t cells,
                    bool is_in_parts);
    /// Frees what the passes after `pass` do not need.
    void end_pass(int pass);
    /// Stores the parts of a chunk that are needed later.
    void put(const EncodedChunk& chunk) const;
    ChunkNodes chunk(const ArrayInfo& array, const Int3& chunk) override;

    /// The values of a level, or the deviations of level 1; null if they are not needed.
    [[nodiscard]] const PartialArray* values(int level) const;
    [[nodiscard]] const PartialArray* deviations() const { return deviations_.get(); }
    /// The indicators of a pass in parts, until it ends; no array is listed twice.
    [[nodiscard]] std::span<const std::unique_ptr<PartialArray>> indicators() const {
        return indicators_;
    }
    [[nodiscard]] const PartialArray* indicators(const ArrayInfo& array) const;

  private:
    [[nodiscard]] const PartialArray* find(const ArrayInfo& array) const;

    const StoreLayout* layout_;
    ScratchFolder folder_;
    std::vector<std::unique_ptr<PartialArray>> values_;
    std::unique_ptr<PartialArray> deviations_;
    std::vector<std::unique_ptr<PartialArray>> indicators_;
};

/// Whether the blocks of coarser levels need deviations.
bool carries_deviation(const StoreLayout& layout);

// Blocks of coarser levels in parts: each rank computes what lies on its own pencils of the base
// pass, and the owner of a block assembles its chunks.

/// Computes the cubes of a part of a pass: `count` per axis starting at `first`, as far as they
/// exist. Their values and indicators go to `levels` in stored form, their centres to those of
/// `context`. Thread-safe for different parts.
template <class T>
void compute_part(const PassContext& context, PartialLevels& levels, int pass, const Int3& first,
                  const Int3& count);

/// The chunks of a block, from the rows in `levels`. Thread-safe.
template <class T>
std::vector<EncodedChunk> assemble_block(const StoreLayout& layout, const PartialLevels& levels,
                                         int pass, const Int3& block);

}  // namespace isonest::detail
