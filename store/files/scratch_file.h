// Temporary space on disk, for work larger than memory.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <mutex>
#include <span>
#include <utility>
#include <vector>

namespace isonest::detail {

/// The system's folder for temporary files, from TMPDIR. Throws Error{io} if it is not a folder.
std::filesystem::path temporary_folder();

/// Counts temporary space in use. Thread-safe.
class ScratchMeter {
  public:
    void add(std::uint64_t bytes);
    void remove(std::uint64_t bytes) { now_ -= bytes; }
    /// Maximum number of bytes in use at a time.
    [[nodiscard]] std::uint64_t peak() const { return peak_; }

  private:
    std::atomic<std::uint64_t> now_ = 0;
    std::atomic<std::uint64_t> peak_ = 0;
};

/// Folder for temporary files, with an optional meter: `meter` counts all files that are created
/// with this object or a copy of it.
class ScratchFolder {
  public:
    ScratchFolder(std::filesystem::path path,  // NOLINT(google-explicit-constructor): mere folder
                  std::shared_ptr<ScratchMeter> meter = nullptr)
        : path_(std::move(path)), meter_(std::move(meter)) {}

    /// With its own meter. `path`: empty = the system's folder for temporary files.
    static ScratchFolder metered(const std::filesystem::path& path);

    [[nodiscard]] const std::filesystem::path& path() const { return path_; }
    [[nodiscard]] const std::shared_ptr<ScratchMeter>& meter() const { return meter_; }

  private:
    std::filesystem::path path_;
    std::shared_ptr<ScratchMeter> meter_;
};

/// A temporary file, unnamed by default: then no name can be left behind, and the file disappears
/// when it is closed. Its space is allocated before it is mapped, so that a full disk is an error
/// and not a fault.
/// Thread-safety: write_at() and read_at() on disjoint ranges from any thread; the rest from one.
class ScratchFile {
  public:
    /// Prefix of names on file systems without unnamed files, until the name is removed; the
    /// process id follows.
    static constexpr const char* kPrefix = ".isonest-scratch-";
    /// Creates the file in `folder`. Throws Error{io}.
    explicit ScratchFile(const ScratchFolder& folder);
    /// Creates `file`, readable only by its owner; removed by the destructor unless keep() was
    /// called. Throws Error{io}.
    static ScratchFile named(const std::filesystem::path& file);
    /// Keeps a named file.
    void keep() { name_.clear(); }
    /// Valid as long as this object has the file open.
    [[nodiscard]] int descriptor() const { return fd_; }
    /// Marks the file as in use for other processes, if the file system supports it; waits for
    /// processes that are just checking it.
    void lock() const;
    ScratchFile(ScratchFile&& other) noexcept;
    ScratchFile& operator=(ScratchFile&& other) noexcept;
    ScratchFile(const ScratchFile&) = delete;
    ScratchFile& operator=(const ScratchFile&) = delete;
    ~ScratchFile();

    /// Throws Error{io}, for example on a full disk.
    void write_at(std::uint64_t offset, std::span<const std::byte> bytes);
    void read_at(std::uint64_t offset, std::span<std::byte> bytes) const;
    /// Maps the first `bytes` for reading and writing; extends the file with zeros if needed.
    /// Earlier maps become invalid. Throws Error{io}.
    std::span<std::byte> map(std::uint64_t bytes);
    /// As map(), but without reserving the space: ranges neither reserved by fill_hole() nor
    /// written may only be read. Not counted by the meter.
    std::span<std::byte> map_hole(std::uint64_t bytes);
    /// Reserves the space of a range, so that it can be written through a map; existing contents
    /// are kept. Throws Error{io}, for example on a full disk.
    void fill_hole(std::uint64_t offset, std::uint64_t bytes) const;
    /// Maps the first `bytes` at `address`, replacing any map there; the caller owns the map.
    /// Throws Error{io}.
    void map_at(std::byte* address, std::uint64_t bytes);
    /// Releases the space of a range, once, if the file system supports it; it then reads as zeros.
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
    std::filesystem::path name_;                      ///< removed by the destructor
    std::byte* map_ = nullptr;
    std::uint64_t mapped_ = 0;
};

// Temporary space on disk that is released piece by piece.

/// Like one ScratchFile, but consisting of several files whose maps are adjacent in memory. So
/// unneeded space can be released by closing a file, at no cost; a hole in a file is often first
/// written to the disk. Pieces are larger the farther they are from the beginning, so that there
/// are few of them, each a small share of the space before it. Thread-safety: write_at() and
/// release() of disjoint ranges from any thread; the rest from one.
class PiecedFile {
  public:
    explicit PiecedFile(ScratchFolder folder) : folder_(std::move(folder)) {}
    PiecedFile(PiecedFile&& other) noexcept;
    PiecedFile& operator=(PiecedFile&& other) = delete;
    PiecedFile(const PiecedFile&) = delete;
    PiecedFile& operator=(const PiecedFile&) = delete;
    ~PiecedFile() { unmap(); }

    /// Throws Error{io}, for example on a full disk.
    void write_at(std::uint64_t offset, std::span<const std::byte> bytes);
    /// Maps the first `bytes` for reading and writing; unwritten bytes are 0. REQUIRES: nothing was
    /// released. Throws Error{io}, std::bad_alloc.
    std::span<std::byte> map(std::uint64_t bytes);
    /// The range is not needed any more; each byte is released only once. The space is freed when a
    /// whole piece was released. REQUIRES: map() was called.
    void release(std::uint64_t offset, std::uint64_t bytes);
    /// Frees all space. Earlier maps become invalid.
    void clear();
    /// The current map as an array of T.
    template <class T>
    [[nodiscard]] std::span<T> as() const {
        return {reinterpret_cast<T*>(map_), static_cast<std::size_t>(mapped_ / sizeof(T))};
    }

  private:
    struct Piece {
        explicit Piece(const ScratchFolder& folder) : file(folder) {}
        ScratchFile file;
        std::atomic<std::uint64_t> released = 0;
    };
    /// Calls f(piece, offset in it, bytes) for each piece of a range.
    template <class F>
    static void each_piece(std::uint64_t offset, std::uint64_t bytes, const F& f);
    Piece& piece(std::size_t number);
    void unmap();

    ScratchFolder folder_;
    std::mutex mutex_;
    std::vector<std::unique_ptr<Piece>> pieces_;
    std::byte* map_ = nullptr;
    std::uint64_t mapped_ = 0;
};

}  // namespace isonest::detail
