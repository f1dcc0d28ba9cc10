// An input file, or a remote object in its place.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include "preprocess/sources/bytes/remote_objects.h"
#include "store/bytes/store_bytes.h"

namespace isonest::detail {

/// What formats read from. Thread-safety: const methods from any thread.
class InputFile {
  public:
    /// Empty.
    InputFile() = default;
    /// A local file, which is not opened. Implicit, so that a path can be passed for an InputFile.
    // NOLINTNEXTLINE(google-explicit-constructor, hicpp-explicit-conversions)
    InputFile(std::filesystem::path path) : path_(std::move(path)) {}
    /// A remote object. Opens it, and reads its first and last 64 KiB. Throws what open_location()
    /// throws, and Error{invalid_argument} if the object is empty.
    InputFile(std::string url, std::shared_ptr<RemoteObjects> elsewhere);

    [[nodiscard]] bool empty() const { return path_.empty(); }
    [[nodiscard]] bool is_remote() const { return bytes_ != nullptr; }
    /// For messages; a URL is shown without credentials.
    [[nodiscard]] std::string name() const { return path_.string(); }
    /// The path of a local file; for a remote object its name, which is not a path.
    [[nodiscard]] const std::filesystem::path& path() const { return path_; }
    /// The bytes of a remote object; null for a local file.
    [[nodiscard]] const std::shared_ptr<const StoreBytes>& bytes() const { return bytes_; }
    /// For a remote object: RemoteObjects::window(), or the object's size if that is less.
    [[nodiscard]] std::uint64_t window() const;
    /// For a remote object: its size, version, and a checksum of its first and last 64 KiB, which
    /// identify its contents. Empty if the server gives no version, because changes would then go
    /// undetected.
    [[nodiscard]] const std::string& state() const { return state_; }

    /// The file of that name in the same folder (or at an absolute path), or the object beside this
    /// one. An object is opened. Throws what url_beside() and the constructors throw.
    [[nodiscard]] InputFile beside(const std::string& name) const;

  private:
    std::filesystem::path path_;
    std::string url_;  ///< may contain credentials
    std::shared_ptr<RemoteObjects> elsewhere_;
    std::shared_ptr<const StoreBytes> bytes_;
    std::string state_;
};

/// The local files among these, for VolumeSource::files().
std::vector<std::filesystem::path> local_files(const std::vector<InputFile>& files);

// The size and bytes of a file, before its format is known.

/// `count` bytes from byte `at`, or fewer if the file ends before. Throws Error{io}.
std::string first_bytes(const InputFile& file, std::size_t count, std::uint64_t at = 0);

/// Returns the size of a regular file or object. Throws Error{not_found, invalid_argument, io} if
/// `file` is not a readable regular file or an object.
std::uint64_t regular_file_size(const InputFile& file);

/// Whether a folder entry is a regular file, or a broken link: if broken links were left out, their
/// files would be missing silently.
bool is_file_of_folder(const std::filesystem::directory_entry& entry);

// Identifying the state of files without reading all of them.

/// One line per file: its size, its modification time in nanoseconds, and a checksum (XXH64) of its
/// first and last 64 KiB; above some dozen files, one line for all the rest. Names are left out, so
/// that moved files keep their identity. Files that cannot be read are listed as such.
std::string identity_of(const std::vector<std::filesystem::path>& files);
/// The same for files or remote objects (InputFile::state()); empty if one of them has no version.
std::string identity_of_inputs(const std::vector<InputFile>& files);

// Bytes of a remote object, prefetched before they are read.

/// Hides round trips: up to a window of bytes ahead is requested before it is read, so that readers
/// wait for the bandwidth only. Thread-safety: read() and passed() from any thread, expect() from
/// one at a time.
class ReadAhead {
  public:
    /// REQUIRES: file.is_remote().
    explicit ReadAhead(const InputFile& file)
        : bytes_(file.bytes()), window_(file.window()), size_(bytes_->size()) {}

    [[nodiscard]] std::uint64_t size() const { return size_; }
    [[nodiscard]] std::uint64_t window() const { return window_; }
    [[nodiscard]] const StoreBytes& bytes() const { return *bytes_; }

    /// Announces what will be read, in this order. One window is prefetched at once, and more as
    /// reading proceeds. Replaces what was expected before.
    void expect(std::vector<ByteRange> ranges);
    /// Copies bytes. Unannounced reads that continue the read before are expected to go on, for as
    /// many bytes as were read consecutively so far. REQUIRES: the range lies in the object. Throws
    /// what StoreBytes::read() throws.
    void read(std::uint64_t at, std::byte* dst, std::uint64_t size);
    /// Reports that this many of the expected bytes were read in another way.
    void passed(std::uint64_t size);

  private:
    // With the lock held:
    void follow(std::uint64_t at, std::uint64_t size);
    void prefetch();

    std::shared_ptr<const StoreBytes> bytes_;
    std::uint64_t window_;
    std::uint64_t size_;
    std::mutex mutex_;
    std::vector<ByteRange> expected_;
    std::size_t next_ = 0;          ///< the first of `expected_` that is not fully prefetched
    std::uint64_t begun_ = 0;       ///< bytes of that range that are prefetched
    std::uint64_t prefetched_ = 0;  ///< total bytes prefetched
    std::uint64_t passed_ = 0;      ///< total bytes read
    std::uint64_t max_ahead_ = 0;
    bool is_told_ = false;          ///< expect() was called
    std::uint64_t run_ = 0;         ///< bytes read consecutively
    std::uint64_t end_of_run_ = 0;  ///< the byte after them
};

}  // namespace isonest::detail
