// The header of NumPy's .npy files.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <isonest/value_type.h>

#include "preprocess/sources/wrapping/converted_source.h"

namespace isonest::detail {

struct NpyHeader {
    ValueType type = ValueType::u8;
    std::optional<StoredNumber> stored;  ///< in place of the type
    bool big_endian = false;
    bool fortran = false;  ///< the first axis is the fastest
    std::vector<std::int64_t> shape;
    std::uint64_t bytes = 0;  ///< of the header: the numbers follow
};

/// Most bytes that a header may have.
inline constexpr std::size_t kMostNpyHeader = std::size_t{1} << 16U;

/// From the file's first byte to behind its header, by the first 12 bytes of `text`. No I/O.
std::uint64_t npy_header_bytes(std::string_view text);

/// Parses the start of a file. Throws Error{corrupt, unsupported}. No I/O.
NpyHeader parse_npy_header(std::string_view text, const std::string& name);

}  // namespace isonest::detail
