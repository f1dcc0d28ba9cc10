// Why a library could not be loaded.
#pragma once

#include <string>
#include <string_view>

namespace isonest::detail {

/// To be called when dlopen() of a library has failed. why: what dlerror() says. Throws
/// Error{limit}, with `file` as its file, if there was no memory or no free descriptor for it: it
/// may well be installed. whole: the library as a message begins with it, "libOSMesa".
void throw_if_no_room_to_load(const std::string& file, const std::string& whole,
                              std::string_view why);

}  // namespace isonest::detail
