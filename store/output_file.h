// An output that appears whole under its name or not at all.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <span>

#include "store/early_write_back.h"

namespace isonest {

/// The temporary names for an output, in the same folder: ".NAME.partial-" and a process id.
std::filesystem::path temporary_prefix(const std::filesystem::path& path);
/// One for this process that no file has: with the process id, or that and "-2", "-3", ...
std::filesystem::path temporary_name(const std::filesystem::path& path);

/// Throws Error{invalid_argument} if `path` exists and `force` is false, or if it is a folder;
/// Error{not_found} if its folder does not exist.
void check_output(const std::filesystem::path& path, bool force);

/// Throws Error{invalid_argument} if `output` is the file `input`, which would be lost.
void require_other_file(const std::filesystem::path& output, const std::filesystem::path& input);

/// Syncs `temporary` to disk and gives it the name `path`; without `force` an existing file of that
/// name is never replaced. Throws Error{io, invalid_argument}; then `temporary` still exists.
void publish(const std::filesystem::path& temporary, const std::filesystem::path& path, bool force);

/// A file under its temporary name, written at any place; removed unless published. Thread-safety:
/// write_at() from any thread.
class OutputFile {
  public:
    /// `prepare` may create the file under the temporary name and put something into it.
    /// Throws what check_output() throws, and Error{io}.
    OutputFile(std::filesystem::path path, bool force,
               const std::function<void(const std::filesystem::path& temporary)>& prepare = {});
    OutputFile(const OutputFile&) = delete;
    OutputFile& operator=(const OutputFile&) = delete;
    ~OutputFile();
    /// Throws Error{io}.
    void write_at(std::uint64_t offset, std::span<const std::byte> bytes) const;
    /// Throws as publish() does.
    void publish_as_named();

  private:
    [[noreturn]] void fail(const char* what, int error) const;

    std::filesystem::path path_;
    std::filesystem::path temporary_;
    bool force_;
    int fd_ = -1;
    mutable EarlyWriteBack early_;
};

}  // namespace isonest
