// A file mapped read-only.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>

namespace isonest::detail {

/// Thread-safety: const methods from any thread.
class MappedFile {
  public:
    /// Throws Error{not_found, io}. An empty file maps to an empty span.
    explicit MappedFile(const std::filesystem::path& path);
    /// A file that is open already, which stays open; `path` is for messages.
    MappedFile(int file, const std::filesystem::path& path);
    MappedFile(const MappedFile&) = delete;
    MappedFile& operator=(const MappedFile&) = delete;
    ~MappedFile();

    [[nodiscard]] std::span<const std::byte> bytes() const { return bytes_; }
    /// Tells the kernel that this range is needed soon.
    void prefetch(std::uint64_t offset, std::uint64_t size) const;

  private:
    void map(int file, const std::filesystem::path& path);

    std::span<const std::byte> bytes_;
};

}  // namespace isonest::detail
