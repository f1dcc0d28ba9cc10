// Numbers whose bytes a ByteReader makes, as a volume.
#pragma once

#include <memory>
#include <string>

#include <isonest/volume_source.h>

#include "preprocess/sources/bytes/byte_reader.h"
#include "preprocess/sources/bytes/input_file.h"
#include "preprocess/sources/numbers/raw_layout.h"

namespace isonest::detail {

/// The numbers of a layout (without packing, lines and offset_from_end) in such bytes. `file` is
/// what they are made from. Throws Error{invalid_argument} where the bytes are not enough, and
/// Error{unsupported} for an order of axes in which a sequential reader cannot give them.
std::unique_ptr<VolumeSource> open_bytes(std::unique_ptr<ByteReader> bytes, const std::string& name,
                                         const RawLayout& layout, const InputFile& file);

}  // namespace isonest::detail
