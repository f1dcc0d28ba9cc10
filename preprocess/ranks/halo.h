// What ranks need of each other's work for a pass: rows of nodes and cubes around their pencils.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include <isonest/int3.h>

#include "preprocess/ranks/pencils.h"
#include "store/container/format.h"
#include "store/ranks/communicator.h"

namespace isonest::detail {

/// An array [z][y][x] of which every rank has the rows that its pencils of an earlier pass made.
struct HaloArray {
    int made_in = kBasePass;  ///< the pass
    std::int64_t rows = 1;    ///< that a pencil of that pass makes, and as many planes
    Int3 size;                ///< elements
    std::uint64_t row_bytes = 0;
    std::span<std::byte> bytes;  ///< the whole, of which this rank's rows are there
    /// Makes room for bytes at an offset.
    std::function<void(std::uint64_t offset, std::uint64_t bytes)> reserve;
    /// A pencil that makes cubes lo to hi of its level needs rows and planes scale * lo - before to
    /// scale * hi + behind. REQUIRES: fewer before and behind than `rows`.
    std::int64_t scale = 1;
    std::int64_t before = 0;
    std::int64_t behind = 0;
};

/// The rows of `arrays` that rank `to` needs for its pencils of `pass` and that rank `from` has
/// made, run by run, in an order that both know.
class HaloRuns {
  public:
    struct Run {
        std::size_t array = 0;
        std::uint64_t offset = 0;
        std::uint64_t bytes = 0;
    };
    HaloRuns(const StoreLayout& layout, const Pencils& pencils, int pass,
             std::span<const HaloArray> arrays, int from, int to);
    bool next(Run& run);

  private:
    bool load_pencil();

    const StoreLayout* layout_;
    const Pencils* pencils_;
    int pass_;
    std::span<const HaloArray> arrays_;
    int from_;
    int to_;
    std::size_t array_ = 0;
    std::vector<Pencil> made_;
    std::size_t pencil_ = 0;
    std::vector<Run> runs_;
    std::size_t run_ = 0;
};

/// All ranks get what they need. Collective.
void exchange_halos(Communicator& ranks, const StoreLayout& layout, const Pencils& pencils,
                    int pass, std::span<const HaloArray> arrays);

}  // namespace isonest::detail
