// What several fuzzing targets need.
#pragma once

#include <cstdint>
#include <filesystem>

#include <isonest/open_volume.h>

#include "tests/fuzz/targets.h"
#include "tests/support/test_support.h"

namespace isonest::detail::fuzz {

namespace fs = std::filesystem;

constexpr std::uint64_t kMemory = std::uint64_t{64} << 20U;

/// A folder of this process, removed at its end.
const test::TemporaryFolder& folder();

/// A file in that folder, with these bytes.
fs::path written(const char* name, Bytes bytes);

/// So that reading is not left out.
void keep(double value);

/// Opens an input as `preprocess` does, and reads some of it, all ways of it.
void use_volume(const fs::path& path, const SourceOptions& options);

}  // namespace isonest::detail::fuzz
