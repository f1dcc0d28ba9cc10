// The types of numbers in NRRD files, by all their names.
#pragma once

#include <optional>
#include <string>

#include <isonest/volume_source.h>

#include "preprocess/sources/wrapping/converted_source.h"

namespace isonest::detail {

struct NrrdType {
    ValueType type;
    std::optional<StoredNumber> stored = {};  ///< in place of the type, which has its bits
};

/// `name` in lower case; nothing if the format knows no such number.
/// Source: http://teem.sourceforge.net/nrrd/format.html#type
std::optional<NrrdType> nrrd_type(const std::string& name);

}  // namespace isonest::detail
