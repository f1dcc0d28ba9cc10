// A file of an input, or an object elsewhere in a file's place.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "preprocess/sources/bytes/far_objects.h"
#include "store/bytes/store_bytes.h"

namespace isonest::detail {

/// What formats are read from. Thread-safety: const methods from any thread.
class InputFile {
  public:
    /// None.
    InputFile() = default;
    /// A local file, which is not opened: whoever takes an InputFile takes a path.
    // NOLINTNEXTLINE(google-explicit-constructor, hicpp-explicit-conversions)
    InputFile(std::filesystem::path path) : path_(std::move(path)) {}
    /// An object elsewhere. Opens it, and reads its first and last 64 KiB. Throws what
    /// open_location() throws, and Error{invalid_argument} for one that is empty.
    InputFile(std::string url, std::shared_ptr<FarObjects> elsewhere);

    [[nodiscard]] bool empty() const { return path_.empty(); }
    [[nodiscard]] bool is_far() const { return bytes_ != nullptr; }
    /// For messages; of an object, its URL without credentials.
    [[nodiscard]] std::string name() const { return path_.string(); }
    /// Of a local file, where it is; of an object, its name, which is no path.
    [[nodiscard]] const std::filesystem::path& path() const { return path_; }
    /// Of an object; null for a file.
    [[nodiscard]] const std::shared_ptr<const StoreBytes>& bytes() const { return bytes_; }
    /// Of an object: FarObjects::window(), or the object's size if that is less.
    [[nodiscard]] std::uint64_t window() const;
    /// Of an object: its size, version and a checksum of its first and last 64 KiB, which tell it
    /// from others. Empty where its server says no version: then nobody could tell.
    [[nodiscard]] const std::string& state() const { return state_; }

    /// The file of that name in the same folder (or by an absolute path), or the object beside this
    /// one. An object is opened. Throws what url_beside() and the constructors throw.
    [[nodiscard]] InputFile beside(const std::string& name) const;

  private:
    std::filesystem::path path_;
    std::string url_;  ///< may hold secrets
    std::shared_ptr<FarObjects> elsewhere_;
    std::shared_ptr<const StoreBytes> bytes_;
    std::string state_;
};

/// Of these, the local files: VolumeSource::files().
std::vector<std::filesystem::path> local_files(const std::vector<InputFile>& files);

}  // namespace isonest::detail
