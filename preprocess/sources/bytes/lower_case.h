// Words that mean the same in capitals.
#pragma once

#include <string>
#include <string_view>

namespace isonest::detail {

/// ASCII letters in lower case.
std::string lower(std::string_view text);

}  // namespace isonest::detail
