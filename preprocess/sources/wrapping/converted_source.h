// Numbers of types that volumes do not have: half floats and integers of 64 bits.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>

#include <isonest/volume_source.h>

namespace isonest::detail {

enum class StoredNumber {
    f16,  ///< IEEE binary16: becomes float32
    i64,  ///< becomes float64
    u64   ///< becomes float64
};

/// The type under which `inner` has to hold the bits of such numbers: uint16 or float64.
ValueType bits_type(StoredNumber stored);

/// The bits of the nearest half float; of ties the even one.
std::uint16_t half_of(double value);

/// `inner`'s bits taken for such numbers. read() throws Error{unsupported} for integers beyond
/// 2^53, which float64 cannot hold.
std::unique_ptr<VolumeSource> converted(std::unique_ptr<VolumeSource> inner, StoredNumber stored);

/// Integers of 64 bits, in place. Throws Error{unsupported}.
void to_labels(const std::string& name, std::size_t count, std::byte* values);

/// Where `source` is such integers of 64 bits: from now on they are labels
/// (store/base/label_bits.h); read() throws Error{unsupported} for those that cannot be. Else
/// nothing.
void take_for_labels(VolumeSource& source);

}  // namespace isonest::detail
