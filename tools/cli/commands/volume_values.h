// Reads all values of a volume file or a store into memory.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include <isonest/error.h>
#include <isonest/open_volume.h>
#include <isonest/progress.h>
#include <isonest/store.h>

namespace isonest::detail::cli {

/// A volume file, or the finest level of a store.
class VolumeValues {
  public:
    /// The finest level.
    explicit VolumeValues(std::shared_ptr<const Store> store);
    /// `name`: shown in messages.
    VolumeValues(std::unique_ptr<VolumeSource> source, std::string name);

    [[nodiscard]] VolumeDescription describe() const;
    [[nodiscard]] const Store* store() const { return store_.get(); }
    [[nodiscard]] const VolumeSource* source() const { return source_.get(); }
    /// The input files.
    [[nodiscard]] std::vector<std::filesystem::path> files() const;
    /// Bytes needed for reading, in addition to the values.
    [[nodiscard]] std::uint64_t heap() const;
    /// The values of all nodes rounded to float32, x fastest. Throws Error{unsupported} if a value
    /// is missing or too large for float32, what the source throws, and Error{cancelled}.
    [[nodiscard]] std::vector<float> read(Progress& progress);

  private:
    std::string path_;
    std::shared_ptr<const Store> store_;
    std::unique_ptr<VolumeSource> source_;
};

}  // namespace isonest::detail::cli
