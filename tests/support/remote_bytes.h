// A remote store, in tests.
#pragma once

#include <catch2/catch.hpp>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include <isonest/error.h>

#include "store/bytes/store_bytes.h"
#include "store/container/parts/footer.h"

namespace isonest::detail::test {

/// A store as if read over a network; records what was read.
class RemoteBytes : public StoreBytes {
  public:
    explicit RemoteBytes(std::string bytes) : bytes_(std::move(bytes)) {}

    [[nodiscard]] const std::string& name() const override { return name_; }
    [[nodiscard]] std::uint64_t size() const override { return bytes_.size(); }
    [[nodiscard]] bool is_remote() const override { return true; }
    [[nodiscard]] HeldBytes read(std::uint64_t offset, std::uint64_t size) const override {
        if (!lies_within(offset, size, bytes_.size())) {
            throw std::logic_error("a read beyond the end");  // any thread may read
        }
        const std::lock_guard lock(mutex_);
        reads_.push_back({offset, size});
        // A separate copy, so that a use after its release is detected.
        auto copy = std::make_shared<std::string>(bytes_, offset, size);
        return {copy, std::as_bytes(std::span(*copy))};
    }
    void want(std::span<const ByteRange> ranges) const override {
        const std::lock_guard lock(mutex_);
        wanted_.insert(wanted_.end(), ranges.begin(), ranges.end());
    }
    [[nodiscard]] std::vector<ByteRange> reads() const {
        const std::lock_guard lock(mutex_);
        return std::exchange(reads_, {});
    }
    [[nodiscard]] std::vector<ByteRange> wanted() const {
        const std::lock_guard lock(mutex_);
        return std::exchange(wanted_, {});
    }

  private:
    std::string name_ = "far";
    std::string bytes_;
    mutable std::mutex mutex_;
    mutable std::vector<ByteRange> reads_;
    mutable std::vector<ByteRange> wanted_;
};

/// The footer of these bytes, unchanged.
inline FoundCatalogue found_in(const RemoteBytes& bytes) {
    auto found = find_catalogue(bytes);
    REQUIRE(found);
    return std::move(*found);
}

/// The kind of what f() throws.
inline std::optional<ErrorKind> failure(const std::function<void()>& f) {
    try {
        f();
    } catch (const Error& e) {
        return e.kind();
    }
    return std::nullopt;
}

}  // namespace isonest::detail::test
