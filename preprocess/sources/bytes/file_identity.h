// What tells the state of files from another one without reading them all.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "preprocess/sources/bytes/input_file.h"

namespace isonest::detail {

/// A line for each file: its size, its time of change in nanoseconds, and a checksum (XXH64) of its
/// first and last 64 KiB; for more than some dozen files one line for those that follow. Names are
/// left out, so that what was moved stays what it is. Files that cannot be read are said to be so.
std::string identity_of(const std::vector<std::filesystem::path>& files);
/// The same of files or objects elsewhere (InputFile::state()); empty where one of these has no
/// version.
std::string identity_of_inputs(const std::vector<InputFile>& files);

}  // namespace isonest::detail
