// The data at one place.
#pragma once

#include <cstdint>
#include <optional>

#include <isonest/int3.h>
#include <isonest/store.h>

namespace isonest::detail::view {

struct PointValue {
    bool inside = false;               ///< of the volume
    Int3 node{};                       ///< the nearest
    std::optional<double> value = {};  ///< linear in the finest tetrahedra; nothing if missing
    std::optional<double> node_value = {};
};

/// Decodes the chunks around the place, one at a time. Throws Error{corrupt}, and Error{limit} if
/// `memory` does not hold one.
PointValue value_at(const Store& store, const Double3& world, std::uint64_t memory);

}  // namespace isonest::detail::view
