// Files and folders that are not read as volumes, but are told by their first bytes, so that the
// refusal can say what they are and how to convert them.
#pragma once

#include <optional>
#include <string>

#include "preprocess/sources/volume_format.h"

namespace isonest::detail {

struct KnownFormat {
    std::string what;  ///< "a GIF picture"
    /// What to do instead, mostly a command; goes on after "this is WHAT, which is not read: ".
    std::string advice;
};

/// What a file is that no format reads; none if its bytes are not known, or for a folder. Reads at
/// most the first bytes of the file and of a header beside it. Never throws for what is damaged.
std::optional<KnownFormat> known_format(const VolumeInput& input);

/// What a folder is by the names in it (of up to 10,000), where no format reads it. Where it only
/// holds files, the caller may look at those.
std::optional<KnownFormat> known_folder(const std::filesystem::path& folder);

}  // namespace isonest::detail
