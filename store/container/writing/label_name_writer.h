// Writes the names and colours of labels: FORMAT.md, section 3.
#pragma once

#include <span>

#include <isonest/label_name.h>

#include "store/container/writing/written_file.h"

namespace isonest::detail {

/// Throws Error{io}, and Error{invalid_argument} for what cannot be one.
void write_names_of_labels(const WrittenFile& file, std::span<const LabelName> names);

}  // namespace isonest::detail
