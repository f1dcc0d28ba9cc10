// An output that appears complete under its name or not at all.
#pragma once

#include <fcntl.h>

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <span>
#include <vector>

namespace isonest::detail {

// Starts writing to the disk while a file is still being made, so that the final sync has little
// left to do.

/// Thread-safe. Only a hint: if the file system refuses it, the sync does all the work.
class EarlyWriteBack {
  public:
    /// To be called after every write, with any descriptor of the file.
    void wrote(int fd, std::uint64_t bytes) {
        if (pending_.fetch_add(bytes) + bytes >= kBatch) {
            pending_ = 0;
            ::sync_file_range(fd, 0, 0, SYNC_FILE_RANGE_WRITE);
        }
    }

  private:
    static constexpr std::uint64_t kBatch = 8U << 20U;
    std::atomic<std::uint64_t> pending_ = 0;
};

/// Prefix of temporary names for an output, in the same folder: ".NAME.partial-" and a process id;
/// if the output is itself a temporary file, its name is used in place of ".NAME". A NAME of more
/// than 200 bytes is shortened.
std::filesystem::path temporary_prefix(const std::filesystem::path& path);
/// An unused temporary name for this process: with the process id, or that and "-2", "-3", ...
std::filesystem::path temporary_name(const std::filesystem::path& path);

/// ".vtp" of "mesh.VTP": the extension in lower case.
std::string lower_extension(const std::filesystem::path& path);

/// Checks what an output may replace, before any work: nothing, or with `force` a regular file that
/// is not one of `inputs` (all the files that are read). Folders, links (including dangling ones),
/// devices, FIFOs and sockets are never replaced, and no link is followed. Throws
/// Error{invalid_argument}, Error{not_found} if the folder does not exist, Error{io}.
void check_output(const std::filesystem::path& path, bool force,
                  const std::vector<std::filesystem::path>& inputs);

/// An output under its temporary name; removed by the destructor unless it was published or kept.
/// Thread-safety: one thread.
class UnfinishedFile {
  public:
    /// Chooses the name, but creates nothing. Throws what check_output() throws.
    UnfinishedFile(std::filesystem::path output, bool force);
    UnfinishedFile(const UnfinishedFile&) = delete;
    UnfinishedFile& operator=(const UnfinishedFile&) = delete;
    ~UnfinishedFile();
    [[nodiscard]] const std::filesystem::path& name() const { return name_; }
    /// To be called once the file exists: users who may not read the file that it will replace may
    /// not read it either.
    void created() const;
    /// Syncs the file to disk and renames it to the output. The permissions of a replaced file are
    /// kept, and its owner and group if the process may set them. The rule of check_output() is
    /// applied again to what exists at this moment. Throws Error{io, invalid_argument}.
    void publish();
    /// Keeps the file.
    void keep() { at_end_ = AtEnd::nothing; }

  private:
    enum class AtEnd { remove, nothing };
    std::filesystem::path output_;
    std::filesystem::path name_;
    bool force_;
    AtEnd at_end_ = AtEnd::remove;
};

/// A file under its temporary name, written at any offset; removed unless published. Thread-safety:
/// write_at() from any thread.
class OutputFile {
  public:
    /// `prepare` may create the file under the temporary name (never through a link) with initial
    /// contents. Throws what check_output() throws, and Error{io}.
    OutputFile(std::filesystem::path path, bool force,
               const std::function<void(const std::filesystem::path& temporary)>& prepare = {});
    OutputFile(const OutputFile&) = delete;
    OutputFile& operator=(const OutputFile&) = delete;
    ~OutputFile();
    /// Throws Error{io}.
    void write_at(std::uint64_t offset, std::span<const std::byte> bytes) const;
    /// From now on other processes may also write, at other places (SharedFile), until the file is
    /// published. Returns the temporary name. Must not be called while another thread writes.
    /// Throws Error{io}.
    const std::filesystem::path& share();
    /// Throws as UnfinishedFile::publish().
    void publish_as_named();

  private:
    std::filesystem::path path_;
    UnfinishedFile unfinished_;
    int fd_ = -1;
    mutable EarlyWriteBack early_;
};

// A file whose bytes are written sequentially, in small pieces.

/// Replaces an existing file when it is published, as OutputFile does, and throws what that throws.
/// Not thread-safe.
class AppendedFile {
  public:
    explicit AppendedFile(const std::filesystem::path& path) : file_(path, true) {}
    void add(std::span<const std::byte> bytes) {
        waiting_.insert(waiting_.end(), bytes.begin(), bytes.end());
        constexpr std::size_t kWaiting = std::size_t{1} << 16U;
        if (waiting_.size() >= kWaiting) {
            flush();
        }
    }
    void publish() {
        flush();
        file_.publish_as_named();
    }

  private:
    void flush() {
        file_.write_at(end_, waiting_);
        end_ += waiting_.size();
        waiting_.clear();
    }
    OutputFile file_;
    std::vector<std::byte> waiting_;
    std::uint64_t end_ = 0;
};

// A folder that appears complete under its name or not at all.

/// A folder under its temporary name, beside the output; removed with its contents by the
/// destructor unless it was published. Thread-safety: one thread.
class OutputFolder {
  public:
    /// Throws Error if the existing folder with the output's name must not be replaced.
    using MayReplace = std::function<void(const std::filesystem::path& folder)>;

    /// Creates the temporary folder. An existing output is refused; with `force` only if it is not
    /// a folder, or `may_replace` throws. Throws Error{invalid_argument, not_found, io}.
    OutputFolder(std::filesystem::path output, bool force, MayReplace may_replace);
    OutputFolder(const OutputFolder&) = delete;
    OutputFolder& operator=(const OutputFolder&) = delete;
    ~OutputFolder();

    /// The folder to be filled.
    [[nodiscard]] const std::filesystem::path& name() const { return name_; }
    /// To be called after filling the folder failed: throws Error{io} if somebody removed it;
    /// otherwise there was another reason.
    void require_there() const;
    /// Renames it to the output. An existing folder is exchanged with it in one step, if the file
    /// system supports that, and then removed. Throws as the constructor.
    void publish();

  private:
    void check() const;

    std::filesystem::path output_;
    std::filesystem::path name_;
    bool force_;
    MayReplace may_replace_;
};

}  // namespace isonest::detail
