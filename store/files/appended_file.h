// A file of which the bytes come one after the other, in small pieces.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>
#include <vector>

#include "store/files/output_file.h"

namespace isonest::detail {

/// Replaces what has the name when it is published, as OutputFile does, and throws what that
/// throws. Not thread-safe.
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

}  // namespace isonest::detail
