// An output that appears whole under its name or not at all.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <span>
#include <vector>

#include "store/files/early_write_back.h"

namespace isonest::detail {

/// The temporary names for an output, in the same folder: ".NAME.partial-" and a process id; for a
/// temporary file's own, its name in place of ".NAME". A NAME of more than 200 bytes is shortened.
std::filesystem::path temporary_prefix(const std::filesystem::path& path);
/// One for this process that no file has: with the process id, or that and "-2", "-3", ...
std::filesystem::path temporary_name(const std::filesystem::path& path);

/// Decides what an output may replace, before any work: nothing, or with `force` a regular file
/// that is none of `inputs`, all the files that are read. Folders, links (also those that lead
/// nowhere), devices, FIFOs and sockets are never replaced, and no link is followed. Throws
/// Error{invalid_argument}, Error{not_found} if there is no such folder, Error{io}.
void check_output(const std::filesystem::path& path, bool force,
                  const std::vector<std::filesystem::path>& inputs);

/// An output under its temporary name: whatever lies there is removed at the end unless it was
/// published or kept. Thread-safety: one thread.
class UnfinishedFile {
  public:
    /// Chooses the name; creates nothing. Throws what check_output() throws.
    UnfinishedFile(std::filesystem::path output, bool force);
    UnfinishedFile(const UnfinishedFile&) = delete;
    UnfinishedFile& operator=(const UnfinishedFile&) = delete;
    ~UnfinishedFile();
    [[nodiscard]] const std::filesystem::path& name() const { return name_; }
    /// To be called once the file is there: who may not read the file that it is to replace may not
    /// read it either.
    void created() const;
    /// Syncs it to disk and gives it the output's name. A replaced file's permissions stay, and its
    /// owner and group where the process may set them. The rule of check_output() holds for what
    /// is there at this moment. Throws Error{io, invalid_argument}.
    void publish();
    /// It stays.
    void keep() { at_end_ = AtEnd::nothing; }

  private:
    enum class AtEnd { remove, nothing };
    std::filesystem::path output_;
    std::filesystem::path name_;
    bool force_;
    AtEnd at_end_ = AtEnd::remove;
};

/// A file under its temporary name, written at any place; removed unless published. Thread-safety:
/// write_at() from any thread.
class OutputFile {
  public:
    /// `prepare` may create the file under the temporary name (never through a link) and put
    /// something into it. Throws what check_output() throws, and Error{io}.
    OutputFile(std::filesystem::path path, bool force,
               const std::function<void(const std::filesystem::path& temporary)>& prepare = {});
    OutputFile(const OutputFile&) = delete;
    OutputFile& operator=(const OutputFile&) = delete;
    ~OutputFile();
    /// Throws Error{io}.
    void write_at(std::uint64_t offset, std::span<const std::byte> bytes) const;
    /// From now on other processes write as well, at other places (SharedFile), until it is
    /// published. Returns the temporary name. Not while another thread writes. Throws Error{io}.
    const std::filesystem::path& share();
    /// Throws as UnfinishedFile::publish() does.
    void publish_as_named();

  private:
    std::filesystem::path path_;
    UnfinishedFile unfinished_;
    int fd_ = -1;
    mutable EarlyWriteBack early_;
};

}  // namespace isonest::detail
