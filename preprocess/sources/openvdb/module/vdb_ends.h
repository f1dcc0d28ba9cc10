// Where the grids of an OpenVDB file end: OpenVDB reads a file that was cut short without an error,
// with other values in its last leaves.
#pragma once

#include <cstdint>
#include <filesystem>

namespace isonest::detail {

/// The end of the last grid, as the file says it; 0 if it does not say it, as files that were
/// written to a stream, and those of versions before 222 (OpenVDB 2.3, of 2014). What is no
/// OpenVDB file, or ends within a description, gives anything.
/// Source: openvdb/io/Archive.cc and GridDescriptor.cc of OpenVDB 10.
std::uint64_t end_of_vdb_grids(const std::filesystem::path& path);

}  // namespace isonest::detail
