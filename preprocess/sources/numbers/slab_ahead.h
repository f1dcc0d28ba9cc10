// What reading a volume elsewhere in slabs needs next.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include <isonest/int3.h>

#include "preprocess/sources/bytes/input_file.h"
#include "preprocess/sources/bytes/read_ahead.h"
#include "preprocess/sources/numbers/raw_rows.h"
#include "store/bytes/store_bytes.h"

namespace isonest::detail {

/// Announces the bytes of a slab that is about to be read, and if it follows the slab before, along
/// z up or down or along y, those of the slabs that come next if this goes on: as many bytes as
/// were read in this order, up to a window. Thread-safety: that of ReadAhead; begin() as expect().
class SlabAhead {
  public:
    /// Appends the ranges of a slab in the order in which they are read.
    using RangesOf = std::function<void(const Slab&, std::vector<ByteRange>&)>;

    SlabAhead(const InputFile& file, const Int3& nodes, RangesOf ranges_of)
        : bytes_(file), nodes_(nodes), ranges_of_(std::move(ranges_of)) {}

    void begin(const Slab& slab);
    [[nodiscard]] ReadAhead& bytes() { return bytes_; }

  private:
    /// The slab after one, if it exists. `step`: -1, 0 or 1 along z, else along y.
    [[nodiscard]] bool go_on(Slab& slab, int step) const;

    ReadAhead bytes_;
    Int3 nodes_;
    RangesOf ranges_of_;
    Slab last_;
    std::uint64_t followed_ = 0;  ///< bytes of slabs that followed each other
};

}  // namespace isonest::detail
