// Shared by several fuzzing targets.
#pragma once

#include <cstdint>
#include <filesystem>

#include <isonest/open_volume.h>

#include "tests/fuzz/targets.h"
#include "tests/support/test_support.h"

namespace isonest::detail::fuzz {

namespace fs = std::filesystem;

constexpr std::uint64_t kMemory = std::uint64_t{64} << 20U;

/// A folder of this process, removed when it ends.
const test::TemporaryFolder& folder();

/// A file in that folder, with these bytes.
fs::path written(const char* name, Bytes bytes);

/// Prevents the compiler from removing the read.
void keep(double value);

/// Opens an input like `preprocess` and reads parts of it in every way.
void use_volume(const fs::path& path, const SourceOptions& options);

}  // namespace isonest::detail::fuzz
