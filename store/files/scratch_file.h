// Temporary space on disk that grows with the work while memory does not.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>

namespace isonest::detail {

/// A temporary file, unnamed unless asked for: then it has no name that could be left behind, and
/// disappears when closed.
/// Its space is allocated before it is mapped, so a full disk is an error and not a fault.
/// Thread-safety: write_at() and read_at() on disjoint ranges from any thread; the rest from one.
class ScratchFile {
  public:
    /// How names begin where a file system has no unnamed files, until the name is removed; the
    /// process id follows.
    static constexpr const char* kPrefix = ".isonest-scratch-";
    /// Creates the file in `folder`. Throws Error{io}.
    explicit ScratchFile(const std::filesystem::path& folder);
    /// Creates `file`, readable by its owner alone and removed at the end unless keep() was called.
    /// Throws Error{io}.
    static ScratchFile named(const std::filesystem::path& file);
    /// A named file stays.
    void keep() { name_.clear(); }
    /// Open as long as the file is.
    [[nodiscard]] int descriptor() const { return fd_; }
    /// Marks the file as in use for other processes, where the file system can.
    void lock() const;
    ScratchFile(ScratchFile&& other) noexcept;
    ScratchFile& operator=(ScratchFile&& other) noexcept;
    ScratchFile(const ScratchFile&) = delete;
    ScratchFile& operator=(const ScratchFile&) = delete;
    ~ScratchFile();

    /// Throws Error{io}, for example on a full disk.
    void write_at(std::uint64_t offset, std::span<const std::byte> bytes);
    void read_at(std::uint64_t offset, std::span<std::byte> bytes) const;
    /// Maps the first `bytes` for reading and writing, extending the file (with zeros) where
    /// needed. Earlier maps become invalid. Throws Error{io}.
    std::span<std::byte> map(std::uint64_t bytes);
    /// Gives the space of a range back where the file system can; it reads as zeros then.
    void release(std::uint64_t offset, std::uint64_t bytes) const;
    /// The current map as an array of T.
    template <class T>
    [[nodiscard]] std::span<T> as() const {
        return {reinterpret_cast<T*>(map_), mapped_ / sizeof(T)};
    }

  private:
    ScratchFile(int fd, std::filesystem::path folder, std::filesystem::path name)
        : fd_(fd), folder_(std::move(folder)), name_(std::move(name)) {}
    void unmap();
    void close();
    int fd_ = -1;
    std::filesystem::path folder_;
    std::filesystem::path name_;  ///< to be removed at the end
    std::byte* map_ = nullptr;
    std::uint64_t mapped_ = 0;
};

}  // namespace isonest::detail
