// A sequence that grows in a temporary file and is then read or changed as an array.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "store/files/pieced_file.h"

namespace isonest::detail {

/// Thread-safety: append() and seal() from one thread; all() from any.
template <class T>
class GrowingFile {
  public:
    explicit GrowingFile(const ScratchFolder& folder) : file_(folder) {}

    /// Throws Error{io}.
    void append(const T& item) {
        waiting_.push_back(item);
        if (waiting_.size() == kWaiting) {
            flush();
        }
    }
    /// After the last append(), or the last one for now. Throws Error{io}.
    void seal() {
        flush();
        waiting_ = {};
        file_.map(bytes());
    }
    /// REQUIRES: seal() was called.
    [[nodiscard]] std::span<T> all() const {
        return {file_.as<T>().data(), static_cast<std::size_t>(flushed_)};
    }
    /// Nobody will look at these items any more, each of which is released once. REQUIRES: seal()
    /// was called.
    void release(std::uint64_t first, std::uint64_t count) {
        file_.release(first * sizeof(T), count * sizeof(T));
    }
    /// Gives all the space back: nobody will look at anything any more, but for size().
    void clear() { file_.clear(); }
    /// What was appended.
    [[nodiscard]] std::uint64_t size() const { return flushed_ + waiting_.size(); }
    [[nodiscard]] std::uint64_t bytes() const { return size() * sizeof(T); }

  private:
    static constexpr std::size_t kWaiting = std::size_t{1} << 12U;
    void flush() {
        file_.write_at(flushed_ * sizeof(T), std::as_bytes(std::span(waiting_)));
        flushed_ += waiting_.size();
        waiting_.clear();
    }
    PiecedFile file_;
    std::vector<T> waiting_;
    std::uint64_t flushed_ = 0;
};

}  // namespace isonest::detail
