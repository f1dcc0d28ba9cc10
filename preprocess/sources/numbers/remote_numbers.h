// Uncompressed numbers in a remote object, with any axis order.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include <isonest/int3.h>
#include <isonest/volume_source.h>

#include "preprocess/sources/bytes/input_file.h"
#include "preprocess/sources/numbers/raw_rows.h"
#include "store/bytes/store_bytes.h"

namespace isonest::detail {

// Predicts what reading a remote volume in slabs needs next.

/// Announces the bytes of a slab that is about to be read. If the slab follows the one before, up
/// or down along z or along y, it also announces the slabs that come next if this continues: as
/// many bytes as were read in this order so far, up to a window. Thread-safety: that of ReadAhead,
/// where begin() counts as expect().
class SlabAhead {
  public:
    /// Appends the ranges of a slab in the order in which they are read.
    using RangesOf = std::function<void(const Slab&, std::vector<ByteRange>&)>;

    SlabAhead(const InputFile& file, const Int3& nodes, RangesOf ranges_of)
        : bytes_(file), nodes_(nodes), ranges_of_(std::move(ranges_of)) {}

    void begin(const Slab& slab);
    [[nodiscard]] ReadAhead& bytes() { return bytes_; }

  private:
    /// Moves to the next slab; false if there is none. `step`: -1, 0 or 1 along z, otherwise along
    /// y.
    [[nodiscard]] bool go_on(Slab& slab, int step) const;

    ReadAhead bytes_;
    Int3 nodes_;
    RangesOf ranges_of_;
    Slab last_;
    std::uint64_t followed_ = 0;  ///< bytes of consecutive slabs
};

/// Reads by byte ranges, prefetched. REQUIRES: file.is_remote(); not compressed; the layout's
/// offset is relative to the object, and the array lies in the object. Throws Error{unsupported} if
/// the pieces of a slab are so small and numerous that each slab would fetch the whole object
/// again, or would need too many requests.
std::unique_ptr<VolumeSource> open_remote_numbers(const InputFile& file, const std::string& name,
                                                  const RawLayout& layout);

}  // namespace isonest::detail
