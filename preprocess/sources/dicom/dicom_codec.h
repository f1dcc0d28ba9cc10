// Frames of DICOM files that are packed as streams of some image format: JPEG, JPEG-LS, JPEG 2000,
// RLE. JPEG and JPEG-LS by GDCM, JPEG 2000 (High-Throughput too) by OpenJPEG: in a module.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "preprocess/sources/dicom/dicom_header.h"

namespace isonest::detail {

/// Whether this build unpacks more than RLE.
bool dicom_codec_is_built();

/// Unpacks a frame into `dst`, numbers.frame_bytes() bytes, native endianness, bits as they are
/// allocated. `frame` is the whole stream. Returns what is wrong with it, or nothing.
/// Throws Error{unsupported} for a transfer syntax that this build does not unpack, or if the
/// module is not there; `name` is the file's.
std::string unpack_dicom_frame(const std::string& syntax, const DicomNumbers& numbers,
                               std::span<const char> frame, std::span<std::byte> dst,
                               const std::string& name);

}  // namespace isonest::detail
