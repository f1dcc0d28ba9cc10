// The header of VTK's legacy images, and where the arrays lie.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>

#include <isonest/int3.h>
#include <isonest/value_type.h>

#include "preprocess/sources/bytes/input_file.h"
#include "preprocess/sources/wrapping/converted_source.h"

namespace isonest::detail {

/// A type by its name in small letters, as binary files hold it: indices (vtkIdType) as int.
struct LegacyType {
    const char* name;
    ValueType type;
    std::optional<StoredNumber> stored;  ///< of types that volumes do not have
    [[nodiscard]] std::uint64_t bytes() const { return stored ? 8 : size_of(type); }
};
/// Null for types whose numbers cannot be read.
const LegacyType* legacy_type(const std::string& name);

struct LegacyArray {
    std::string name;
    std::string type;  ///< "unsigned_short", in small letters
    std::int64_t components = 1;
    std::int64_t tuples = 0;
    std::uint64_t at = 0;  ///< the byte of the file where the numbers begin
    bool of_cells = false;
    bool colours = false;  ///< COLOR_SCALARS: as text they are fractions of 255
};

struct LegacyHeader {
    bool text = false;
    std::array<std::int64_t, 3> dimensions{1, 1, 1};
    Double3 spacing{1, 1, 1};
    Double3 origin{0, 0, 0};
    LegacyArray array;
};

/// Finds the array of points or cells that is named, or the first one; names are as VTK has them,
/// or as they are written ("my%20array"). Throws Error{corrupt, unsupported, not_found, io}.
LegacyHeader read_legacy_header(const InputFile& file, const std::string& wanted);

}  // namespace isonest::detail
