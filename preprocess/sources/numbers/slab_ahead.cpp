#include "preprocess/sources/numbers/slab_ahead.h"

#include <algorithm>
#include <utility>

namespace isonest::detail {
namespace {

/// How a slab lies to the one before: 1 above it, -1 below it, 0 behind it along y; else 2.
int step_from(const Slab& last, const Slab& slab) {
    const bool same_rows = slab.y0 == last.y0 && slab.ny == last.ny;
    if (same_rows && slab.z0 == last.z0 + last.nz) {
        return 1;
    }
    if (same_rows && slab.z0 + slab.nz == last.z0) {
        return -1;
    }
    const bool same_planes = slab.z0 == last.z0 && slab.nz == last.nz;
    return same_planes && slab.y0 == last.y0 + last.ny ? 0 : 2;
}

std::uint64_t bytes_from(const std::vector<ByteRange>& ranges, std::size_t first) {
    std::uint64_t bytes = 0;
    for (std::size_t i = first; i < ranges.size(); ++i) {
        bytes += ranges[i].size;
    }
    return bytes;
}

}  // namespace

bool SlabAhead::go_on(Slab& slab, int step) const {
    if (step == 0) {
        slab.y0 += slab.ny;
        slab.ny = std::min(slab.ny, nodes_.y - slab.y0);
        return slab.ny > 0;
    }
    if (step > 0) {
        slab.z0 += slab.nz;
        slab.nz = std::min(slab.nz, nodes_.z - slab.z0);
        return slab.nz > 0;
    }
    const std::int64_t end = slab.z0;
    slab.z0 = std::max<std::int64_t>(end - slab.nz, 0);
    slab.nz = end - slab.z0;
    return slab.nz > 0;
}

void SlabAhead::begin(const Slab& slab) {
    std::vector<ByteRange> ranges;
    ranges_of_(slab, ranges);
    const int step = last_.nz > 0 ? step_from(last_, slab) : 2;
    const std::uint64_t own = bytes_from(ranges, 0);
    followed_ = step == 2 ? 0 : followed_ + own;
    const std::uint64_t most = std::min(followed_, bytes_.window());
    std::uint64_t ahead = 0;
    for (Slab next = slab; step != 2 && ahead < most && go_on(next, step);) {
        const std::size_t first = ranges.size();
        ranges_of_(next, ranges);
        ahead += bytes_from(ranges, first);
    }
    last_ = slab;
    bytes_.expect(std::move(ranges));
}

}  // namespace isonest::detail
