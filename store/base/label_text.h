// Names of labels as text.
#pragma once

#include <span>
#include <string>
#include <string_view>

#include <isonest/label_name.h>

namespace isonest::detail {

/// Whether this is UTF-8 without control characters, and without what XML cannot hold (U+FFFE,
/// U+FFFF). Source: Unicode Standard 15, table 3-7.
bool is_printable_utf8(std::string_view text);

/// Why a store cannot hold these names; empty if it can. They have to be by rising ids.
std::string why_no_label_names(std::span<const LabelName> names);

}  // namespace isonest::detail
