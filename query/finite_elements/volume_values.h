// Reads all values of a volume or a store into memory, for smoothing.
#pragma once

#include <cstdint>
#include <filesystem>
#include <vector>

#include <isonest/progress.h>
#include <isonest/volume_source.h>

#include "store/container/reader.h"

namespace isonest::detail {

/// A volume, or the finest level of a store; not owned.
class VolumeValues {
  public:
    explicit VolumeValues(const StoreReader& store) : store_(&store) {}
    explicit VolumeValues(VolumeSource& source) : source_(&source) {}

    [[nodiscard]] VolumeDescription describe() const;
    /// The input files.
    [[nodiscard]] std::vector<std::filesystem::path> files() const;
    /// Bytes needed for reading, in addition to the values.
    [[nodiscard]] std::uint64_t heap() const;
    /// The values of all nodes rounded to float32, x fastest. Throws Error{unsupported} if a value
    /// is missing or too large for float32, what the source throws, and Error{cancelled}.
    [[nodiscard]] std::vector<float> read(Progress& progress) const;

  private:
    const StoreReader* store_ = nullptr;
    VolumeSource* source_ = nullptr;
};

}  // namespace isonest::detail
