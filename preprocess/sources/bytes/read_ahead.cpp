#include "preprocess/sources/bytes/read_ahead.h"

#include <algorithm>
#include <cstring>
#include <utility>

namespace isonest::detail {
namespace {

/// What is copied at a time: it is held in memory whole.
constexpr std::uint64_t kCopied = std::uint64_t{1} << 20U;

}  // namespace

void ReadAhead::expect(std::vector<ByteRange> ranges) {
    const std::lock_guard lock(mutex_);
    is_told_ = true;
    expected_ = std::move(ranges);
    next_ = 0;
    begun_ = 0;
    announced_ = 0;
    passed_ = 0;
    most_ahead_ = window_;
    announce();
}

void ReadAhead::announce() {
    // A quarter of the window at a time, so that requests are few.
    if (announced_ > passed_ + most_ahead_ - most_ahead_ / 4) {
        return;
    }
    std::vector<ByteRange> batch;
    while (next_ < expected_.size() && announced_ < passed_ + most_ahead_) {
        const ByteRange& range = expected_[next_];
        const std::uint64_t size =
            std::min(range.size - begun_, passed_ + most_ahead_ - announced_);
        if (size > 0) {
            batch.push_back({range.offset + begun_, size});
        }
        announced_ += size;
        begun_ += size;
        if (begun_ == range.size) {
            ++next_;
            begun_ = 0;
        }
    }
    if (!batch.empty()) {
        bytes_->want(batch);
    }
}

void ReadAhead::follow(std::uint64_t at, std::uint64_t size) {
    if (at != end_of_run_) {
        run_ = 0;
        expected_.clear();
    }
    if (run_ > 0 && expected_.empty()) {
        expected_ = {{at, size_ - at}};
        next_ = 0;
        begun_ = 0;
        announced_ = 0;
        passed_ = 0;
    }
    run_ += size;
    end_of_run_ = at + size;
    most_ahead_ = std::min(window_, run_);
    announce();
}

void ReadAhead::passed(std::uint64_t size) {
    const std::lock_guard lock(mutex_);
    passed_ += size;
    announce();
}

void ReadAhead::read(std::uint64_t at, std::byte* dst, std::uint64_t size) {
    while (size > 0) {
        const std::uint64_t n = std::min({size, kCopied, std::max(window_, kCopied / 4)});
        if (!is_told_) {
            const std::lock_guard lock(mutex_);
            follow(at, n);
        }
        const HeldBytes held = bytes_->read(at, n);
        std::memcpy(dst, held.bytes().data(), n);
        passed(n);
        at += n;
        dst += n;
        size -= n;
    }
}

}  // namespace isonest::detail
