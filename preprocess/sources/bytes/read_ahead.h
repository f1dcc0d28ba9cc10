// Bytes of an object elsewhere, announced before they are read.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <mutex>
#include <vector>

#include "preprocess/sources/bytes/input_file.h"
#include "store/bytes/store_bytes.h"

namespace isonest::detail {

/// Who reads waits for the line, not for round trips: up to a window of bytes ahead is under way.
/// Thread-safety: read() and passed() from any thread, expect() from one at a time.
class ReadAhead {
  public:
    /// REQUIRES: file.is_far().
    explicit ReadAhead(const InputFile& file)
        : bytes_(file.bytes()), window_(file.window()), size_(bytes_->size()) {}

    [[nodiscard]] std::uint64_t size() const { return size_; }
    [[nodiscard]] std::uint64_t window() const { return window_; }
    [[nodiscard]] const StoreBytes& bytes() const { return *bytes_; }

    /// What is going to be read, in this order: of it a window is announced, and more with what is
    /// read of it. Takes the place of what was expected before.
    void expect(std::vector<ByteRange> ranges);
    /// Copies bytes. Those that nobody expected, and that follow what was read before, are expected
    /// to go on like this, for as many bytes as were read so. REQUIRES: they lie in the object.
    /// Throws what StoreBytes::read() throws.
    void read(std::uint64_t at, std::byte* dst, std::uint64_t size);
    /// So many bytes of what is expected were read by other ways.
    void passed(std::uint64_t size);

  private:
    // With the lock held:
    void follow(std::uint64_t at, std::uint64_t size);
    void announce();

    std::shared_ptr<const StoreBytes> bytes_;
    std::uint64_t window_;
    std::uint64_t size_;
    std::mutex mutex_;
    std::vector<ByteRange> expected_;
    std::size_t next_ = 0;         ///< of `expected_`: the first that is not announced whole
    std::uint64_t begun_ = 0;      ///< bytes of that one that are
    std::uint64_t announced_ = 0;  ///< of all
    std::uint64_t passed_ = 0;     ///< of all, read
    std::uint64_t most_ahead_ = 0;
    bool is_told_ = false;          ///< expect() was called
    std::uint64_t run_ = 0;         ///< bytes that were read one after the other
    std::uint64_t end_of_run_ = 0;  ///< the byte behind them
};

}  // namespace isonest::detail
