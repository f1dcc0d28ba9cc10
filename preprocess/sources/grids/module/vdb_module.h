// The interface of the module that reads OpenVDB. The library loads it when such a file is opened.
#pragma once

#include <cstdint>
#include <filesystem>

#include "preprocess/sources/volume_format.h"

namespace isonest::detail {

// Where the grids of an OpenVDB file end. This is checked because OpenVDB reads a truncated file
// without an error, with wrong values in its last leaves.

/// The end of the last grid according to the file; 0 if it does not say, like files that were
/// written to a stream and those of versions before 222 (OpenVDB 2.3, of 2014). The result is
/// arbitrary for a file that is not OpenVDB or ends within a description.
/// Source: openvdb/io/Archive.cc and GridDescriptor.cc of OpenVDB 10.
std::uint64_t end_of_vdb_grids(const std::filesystem::path& path);

}  // namespace isonest::detail

/// Returns a source that the caller owns; throws like the opening functions of formats. The module
/// then stays loaded.
extern "C" isonest::VolumeSource* isonest_open_vdb(const isonest::detail::VolumeInput& input,
                                                   const isonest::SourceOptions& options);
