#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <string>
#include <utility>

#include <isonest/error.h>
#include <isonest/memory_volume.h>

#include "store/container/codec.h"

namespace isonest {
using namespace detail;
namespace {

Int3 dense_strides(const Int3& nodes, ValueType type) {
    const auto value = static_cast<std::int64_t>(size_of(type));
    return {value, value * nodes.x, value * nodes.x * nodes.y};
}

}  // namespace

MemoryVolume::MemoryVolume(const void* data, ValueType type, const Int3& nodes, MemoryLayout layout)
    : data_(static_cast<const std::byte*>(data)),
      type_(type),
      nodes_(nodes),
      strides_(layout.strides.value_or(dense_strides(nodes, type))),
      layout_(std::move(layout)) {
    if (data == nullptr || nodes.x < 1 || nodes.y < 1 || nodes.z < 1) {
        throw Error(ErrorKind::invalid_argument, {layout_.name},
                    fmt::format("{} x {} x {} nodes{}: a volume needs a data pointer and at least "
                                "one node per axis",
                                nodes.x, nodes.y, nodes.z,
                                data == nullptr ? " and a null data pointer" : ""));
    }
}

VolumeDescription MemoryVolume::describe() const {
    return {nodes_,          type_,
            layout_.spacing, layout_.origin,
            layout_.name,    layout_.direction,
            false,           layout_.unit,
            layout_.frame,   {},
            layout_.uneven};
}

std::span<const std::byte> MemoryVolume::mapped() const {
    const std::size_t value = size_of(type_);
    // The stride of an axis with one node is never used.
    const Int3 dense = dense_strides(nodes_, type_);
    for (int axis = 0; axis < 3; ++axis) {
        if (nodes_[axis] > 1 && strides_[axis] != dense[axis]) {
            return {};
        }
    }
    if (reinterpret_cast<std::uintptr_t>(data_) % value != 0) {
        return {};
    }
    return {data_, static_cast<std::size_t>(nodes_.product()) * value};
}

void MemoryVolume::copy(const Int3& from, std::int64_t count, std::byte* dst) const {
    const std::byte* at = data_ + from.x * strides_.x + from.y * strides_.y + from.z * strides_.z;
    dispatch(type_, [&](auto tag) {
        constexpr std::size_t kSize = sizeof(typename decltype(tag)::type);
        if (strides_.x == static_cast<std::int64_t>(kSize)) {
            std::memcpy(dst, at, static_cast<std::size_t>(count) * kSize);
            return;
        }
        for (std::int64_t i = 0; i < count; ++i) {
            std::memcpy(dst + i * static_cast<std::int64_t>(kSize), at + i * strides_.x, kSize);
        }
    });
}

void MemoryVolume::read(std::int64_t z0, std::int64_t nz, std::int64_t y0, std::int64_t ny,
                        std::byte* dst) {
    const std::int64_t row = nodes_.x * static_cast<std::int64_t>(size_of(type_));
    for (std::int64_t z = z0; z < z0 + nz; ++z) {
        for (std::int64_t y = y0; y < y0 + ny; ++y) {
            copy({0, y, z}, nodes_.x, dst);
            dst += row;
        }
    }
}

std::string MemoryVolume::identity() const {
    Checksum sum;
    if (const auto whole = mapped(); !whole.empty()) {
        sum.add(whole);
    } else {
        std::array<std::byte, 1U << 15U> buffer{};
        const std::size_t value = size_of(type_);
        const auto most = static_cast<std::int64_t>(buffer.size() / value);
        for (std::int64_t row = 0; row < nodes_.y * nodes_.z; ++row) {
            for (std::int64_t x = 0; x < nodes_.x; x += most) {
                const std::int64_t count = std::min(most, nodes_.x - x);
                copy({x, row % nodes_.y, row / nodes_.y}, count, buffer.data());
                sum.add(std::span(buffer).first(static_cast<std::size_t>(count) * value));
            }
        }
    }
    return fmt::format("values in memory {:016x}\n", sum.value());
}

}  // namespace isonest
