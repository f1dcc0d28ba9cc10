// What the module that unpacks frames of JPEG has for the library, which loads it when there is
// one.
#pragma once

#include <cstddef>
#include <span>
#include <string>

#include "preprocess/sources/dicom/dicom_header.h"

/// Unpacks a frame into `dst` as unpack_dicom_frame() does. `problem` is what is wrong with the
/// frame, or empty. Throws Error{unsupported} for a transfer syntax of none of these formats.
extern "C" void isonest_unpack_dicom(const std::string& syntax,
                                     const isonest::detail::DicomNumbers& numbers,
                                     std::span<const char> frame, std::span<std::byte> dst,
                                     const std::string& name, std::string& problem);
