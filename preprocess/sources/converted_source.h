// Numbers of types that volumes do not have: half floats and integers of 64 bits.
#pragma once

#include <memory>

#include <isonest/volume_source.h>

namespace isonest::detail {

enum class StoredNumber {
    f16,  ///< IEEE binary16: becomes float32
    i64,  ///< becomes float64
    u64   ///< becomes float64
};

/// The type under which `inner` has to hold the bits of such numbers: uint16 or float64.
ValueType bits_type(StoredNumber stored);

/// `inner`'s bits taken for such numbers. read() throws Error{unsupported} for integers beyond
/// 2^53, which float64 cannot hold.
std::unique_ptr<VolumeSource> converted(std::unique_ptr<VolumeSource> inner, StoredNumber stored);

}  // namespace isonest::detail
