// A frame of JPEG 2000 by OpenJPEG, which knows High-Throughput JPEG 2000 too.
#pragma once

#include <cstddef>
#include <span>
#include <string>

#include "preprocess/sources/dicom/dicom_header.h"

namespace isonest::detail {

/// As unpack_dicom_frame() does, for a stream whose size was checked.
std::string unpack_jpeg2000(std::span<const char> frame, const DicomNumbers& numbers,
                            std::span<std::byte> dst);

}  // namespace isonest::detail
