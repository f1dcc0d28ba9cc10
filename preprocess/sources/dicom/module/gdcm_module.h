// The interface of the module that decompresses JPEG frames. The library loads it if it is
// installed.
#pragma once

#include <cstddef>
#include <span>
#include <string>

#include "preprocess/sources/dicom/dicom_header.h"

/// Decompresses a frame into `dst` like unpack_dicom_frame(). `problem` is set to what is wrong
/// with the frame, or to an empty text. Throws Error{unsupported} for a transfer syntax of another
/// format.
extern "C" void isonest_unpack_dicom(const std::string& syntax,
                                     const isonest::detail::DicomNumbers& numbers,
                                     std::span<const char> frame, std::span<std::byte> dst,
                                     const std::string& name, std::string& problem);
