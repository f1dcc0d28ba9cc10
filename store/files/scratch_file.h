// Temporary space on disk that grows with the work while memory does not.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <utility>

namespace isonest::detail {

/// The system's folder for temporary files, which TMPDIR names. Throws Error{io} if it is none.
std::filesystem::path temporary_folder();

/// How much temporary space is in use. Thread-safe.
class ScratchMeter {
  public:
    void add(std::uint64_t bytes);
    void remove(std::uint64_t bytes) { now_ -= bytes; }
    /// Bytes at a time, at most.
    [[nodiscard]] std::uint64_t peak() const { return peak_; }

  private:
    std::atomic<std::uint64_t> now_ = 0;
    std::atomic<std::uint64_t> peak_ = 0;
};

/// Where temporary files go, and what counts them, if anything does: `meter` is told of all files
/// that are made with this folder or a copy of it.
class ScratchFolder {
  public:
    ScratchFolder(std::filesystem::path path,  // NOLINT(google-explicit-constructor): mere folder
                  std::shared_ptr<ScratchMeter> meter = nullptr)
        : path_(std::move(path)), meter_(std::move(meter)) {}

    /// With a meter of its own. `path`: empty = the system's folder for temporary files.
    static ScratchFolder metered(const std::filesystem::path& path);

    [[nodiscard]] const std::filesystem::path& path() const { return path_; }
    [[nodiscard]] const std::shared_ptr<ScratchMeter>& meter() const { return meter_; }

  private:
    std::filesystem::path path_;
    std::shared_ptr<ScratchMeter> meter_;
};

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
    explicit ScratchFile(const ScratchFolder& folder);
    /// Creates `file`, readable by its owner alone and removed at the end unless keep() was called.
    /// Throws Error{io}.
    static ScratchFile named(const std::filesystem::path& file);
    /// A named file stays.
    void keep() { name_.clear(); }
    /// Open as long as the file is.
    [[nodiscard]] int descriptor() const { return fd_; }
    /// Marks the file as in use for other processes, where the file system can; waits for those
    /// that look at it meanwhile.
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
    /// As map(), but without reserving the space: what was not reserved by fill_hole() nor written
    /// may only be read. A meter is not told of it.
    std::span<std::byte> map_hole(std::uint64_t bytes);
    /// Reserves the space of a range, so that it can be written through a map; what is there stays.
    /// Throws Error{io}, for example on a full disk.
    void fill_hole(std::uint64_t offset, std::uint64_t bytes) const;
    /// Maps the first `bytes` at `address`, in place of what is mapped there; the map is the
    /// caller's. Throws Error{io}.
    void map_at(std::byte* address, std::uint64_t bytes);
    /// Gives the space of a range back, once, where the file system can; it reads as zeros then.
    void release(std::uint64_t offset, std::uint64_t bytes) const;
    /// Empties the file. Earlier maps become invalid. Throws Error{io}.
    void clear();
    /// The current map as an array of T.
    template <class T>
    [[nodiscard]] std::span<T> as() const {
        return {reinterpret_cast<T*>(map_), static_cast<std::size_t>(mapped_ / sizeof(T))};
    }

  private:
    ScratchFile(int fd, std::filesystem::path folder, std::filesystem::path name)
        : fd_(fd), folder_(std::move(folder)), name_(std::move(name)) {}
    void unmap();
    void close();
    void reserve(std::uint64_t bytes);
    std::span<std::byte> map_reserved(std::uint64_t bytes);
    void count_to(std::uint64_t end);
    void uncount(std::uint64_t bytes) const;
    void take(ScratchFile& other) noexcept;
    int fd_ = -1;
    std::filesystem::path folder_;
    std::shared_ptr<ScratchMeter> meter_;
    std::atomic<std::uint64_t> end_ = 0;              ///< of what was written or mapped
    mutable std::atomic<std::uint64_t> counted_ = 0;  ///< by the meter
    std::filesystem::path name_;                      ///< to be removed at the end
    std::byte* map_ = nullptr;
    std::uint64_t mapped_ = 0;
};

}  // namespace isonest::detail
