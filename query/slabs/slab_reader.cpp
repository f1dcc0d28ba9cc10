#include "query/slabs/slab_reader.h"

#include <algorithm>
#include <cstring>

namespace isonest::detail {

SlabReader::SlabReader(VolumeSource& volume)
    : volume_(volume),
      description_(volume.describe()),
      mapped_(volume.mapped()),
      plane_bytes_(static_cast<std::uint64_t>(description_.nodes.x * description_.nodes.y) *
                   size_of(description_.type)),
      at_once_(std::min(volume.granularity().planes, description_.nodes.z)) {}

std::uint64_t SlabReader::own_bytes(std::int64_t layers) const {
    return mapped_.empty()
               ? plane_bytes_ * static_cast<std::uint64_t>(layers + 3 + at_once_) + volume_.heap()
               : 0;
}

std::uint64_t SlabReader::slab_bytes(std::int64_t layers) const {
    return mapped_.empty() ? plane_bytes_ * static_cast<std::uint64_t>(layers + 3) : 0;
}

SlabPlanes SlabReader::read(const Slab& layers) {
    const std::int64_t planes = description_.nodes.z;
    const std::int64_t first = std::max<std::int64_t>(layers.begin - 1, 0);
    const std::int64_t end = std::min(layers.end + 2, planes);
    if (!mapped_.empty()) {
        return {mapped_.data(), 0, {}};
    }
    const auto bytes = [&](std::int64_t n) { return static_cast<std::size_t>(n) * plane_bytes_; };
    const std::int64_t dropped = std::min(first, window_end_) - window_first_;
    window_.erase(window_.begin(), window_.begin() + static_cast<std::ptrdiff_t>(bytes(dropped)));
    window_first_ += dropped;
    window_.reserve(bytes(layers.end - layers.begin + 3 + at_once_));
    while (window_end_ < end) {
        const std::int64_t next = std::min((window_end_ / at_once_ + 1) * at_once_, planes);
        window_.resize(bytes(next - window_first_));
        volume_.read(window_end_, next - window_end_, 0, description_.nodes.y,
                     window_.data() + bytes(window_end_ - window_first_));
        window_end_ = next;
    }
    SlabPlanes slab{nullptr, first, {}};
    const auto* const from = window_.data() + bytes(first - window_first_);
    slab.own.assign(from, from + bytes(end - first));
    slab.data = slab.own.data();
    return slab;
}

}  // namespace isonest::detail
