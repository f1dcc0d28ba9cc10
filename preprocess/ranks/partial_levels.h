// What a rank keeps of the levels that coarser ones are made from, outside of memory.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <utility>
#include <vector>

#include "preprocess/levels/finer_levels.h"
#include "preprocess/levels/indicator_chunks.h"
#include "preprocess/ranks/pencils.h"
#include "store/container/format.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

/// One array of a level, [z][y][x], of which a rank has some rows: those that it made, and those
/// that others sent. A file of the size of the whole, with space for these rows alone.
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
    /// The nodes of the pencil's blocks, `nodes` rows and planes each.
    void reserve(const Pencil& pencil, std::int64_t nodes) const;
    /// The element of a node; those of a row along x follow.
    [[nodiscard]] std::byte* at(const Int3& node) const;
    /// A chunk whose rows were reserved. Thread-safe for different chunks.
    void put(const EncodedChunk& chunk) const;
    [[nodiscard]] ChunkNodes chunk(const Int3& chunk) const;

  private:
    const ArrayInfo* array_;
    ScratchFile file_;
};

/// The values of level 1 and above and the stored deviations of level 1, as long as they are
/// needed; and while a pass is computed in parts, its indicators. Thread-safety: put() and chunk()
/// from any thread; the rest from one.
class PartialLevels : public FinerLevels {
  public:
    PartialLevels(const StoreLayout& layout, ScratchFolder folder)
        : layout_(&layout), folder_(std::move(folder)) {}

    /// Makes room for what a pass makes that is needed later, in a rank's pencils of so many rows
    /// of cubes; and if the pass is computed in parts, for its indicators, too. Throws Error{io}.
    void begin_pass(int pass, std::span<const Pencil> pencils, std::int64_t cells,
                    bool is_in_parts);
    /// Gives up what the passes above `pass` do not need.
    void end_pass(int pass);
    /// Takes what is needed of a chunk.
    void put(const EncodedChunk& chunk) const;
    ChunkNodes chunk(const ArrayInfo& array, const Int3& chunk) override;

    /// The values of a level, or the deviations of level 1; null if nobody needs them.
    [[nodiscard]] const PartialArray* values(int level) const;
    [[nodiscard]] const PartialArray* deviations() const { return deviations_.get(); }
    /// Of a pass in parts, until it ends; no array is stored twice.
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

/// Whether the blocks of coarser levels look at deviations.
bool carries_deviation(const StoreLayout& layout);

}  // namespace isonest::detail
