// What ranks need of each other's work for a pass: rows of nodes and cubes around their pencils.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include <isonest/int3.h>

#include "preprocess/ranks/pencils.h"
#include "store/ranks/communicator.h"

namespace isonest::detail {

/// An array [z][y][x] of which every rank has the rows that its pencils made.
struct HaloArray {
    PencilCut made;         ///< the pencils that made it
    std::int64_t rows = 1;  ///< that one of them makes, and as many planes
    Int3 size;              ///< elements
    std::uint64_t row_bytes = 0;
    std::size_t element = 1;     ///< bytes of a number: 1, 2, 4 or 8
    std::span<std::byte> bytes;  ///< the whole, of which this rank's rows are there
    /// Makes room for bytes at an offset.
    std::function<void(std::uint64_t offset, std::uint64_t bytes)> reserve;
    /// A pencil of cubes lo to hi - 1 needs rows and planes scale * lo - before to scale * hi +
    /// behind. REQUIRES: fewer before and behind than `rows`.
    std::int64_t scale = 1;
    std::int64_t before = 0;
    std::int64_t behind = 0;
};

/// The rows of `arrays` that rank `to` needs for its pencils of the cut `needing` and that rank
/// `from` has made, run by run, in an order that both know.
class HaloRuns {
  public:
    struct Run {
        std::size_t array = 0;
        std::uint64_t offset = 0;
        std::uint64_t bytes = 0;
    };
    HaloRuns(const Pencils& pencils, const PencilCut& needing, std::span<const HaloArray> arrays,
             int from, int to);
    bool next(Run& run);
    [[nodiscard]] std::size_t element(std::size_t array) const { return arrays_[array].element; }

  private:
    bool load_pencil();

    const Pencils* pencils_;
    PencilCut needing_;
    std::span<const HaloArray> arrays_;
    int from_;
    int to_;
    std::size_t array_ = 0;
    std::vector<Pencil> made_;
    std::size_t pencil_ = 0;
    std::vector<Run> runs_;
    std::size_t run_ = 0;
};

/// All ranks get what their pencils of the cut `needing` need. Collective.
void exchange_halos(Communicator& ranks, const Pencils& pencils, const PencilCut& needing,
                    std::span<const HaloArray> arrays);

}  // namespace isonest::detail
