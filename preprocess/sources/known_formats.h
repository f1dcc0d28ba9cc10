// Files and folders that cannot be read as volumes but are recognised, so that the error message
// can say what they are and how to convert them.
#pragma once

#include <optional>
#include <string>

#include "preprocess/sources/volume_format.h"

namespace isonest::detail {

struct KnownFormat {
    std::string what;  ///< "a GIF picture"
    /// What to do instead, usually a command; continues "this is WHAT, which is not read: ".
    std::string advice;
};

/// Identifies a file that no format reads; none if its bytes are unknown, or for a folder. Reads no
/// more than the first bytes of the file and of a header beside it. Never throws because of damage.
std::optional<KnownFormat> known_format(const VolumeInput& input);

/// Identifies a folder that no format reads by the names in it (up to 10,000 of them). If the
/// folder only contains files, the caller may check those.
std::optional<KnownFormat> known_folder(const std::filesystem::path& folder);

}  // namespace isonest::detail
