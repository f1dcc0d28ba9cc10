// DICOM's RLE: PackBits by planes of bytes. Source: DICOM PS3.5, annex G.
#pragma once

#include <cstddef>
#include <span>
#include <string>

namespace isonest::detail {

/// Unpacks a frame of numbers of `size` bytes into `dst`. Returns what is wrong with it, or
/// nothing. No I/O.
std::string unpack_dicom_rle(std::span<const char> frame, std::size_t size,
                             std::span<std::byte> dst);

}  // namespace isonest::detail
