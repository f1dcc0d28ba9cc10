// Where the bytes of a store come from: a map of a local file, or ranges of an object elsewhere.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <utility>

#include <isonest/remote.h>

namespace isonest::detail {

/// Bytes [offset, offset + size) of a store.
struct ByteRange {
    std::uint64_t offset = 0;
    std::uint64_t size = 0;
};

/// Whether `size` bytes from `offset` on lie in a file of `of` bytes.
inline bool lies_within(std::uint64_t offset, std::uint64_t size, std::uint64_t of) {
    return offset <= of && size <= of - offset;
}

/// Bytes that stay where they are while this is held; copies hold them, too.
class HeldBytes {
  public:
    HeldBytes() = default;
    /// `owner`: what keeps `bytes` alive; null for a map that outlives all users.
    HeldBytes(std::shared_ptr<const void> owner, std::span<const std::byte> bytes)
        : owner_(std::move(owner)), bytes_(bytes) {}
    [[nodiscard]] std::span<const std::byte> bytes() const { return bytes_; }

  private:
    std::shared_ptr<const void> owner_;
    std::span<const std::byte> bytes_;
};

/// Thread-safety: all methods from any thread.
class StoreBytes {
  public:
    StoreBytes() = default;
    StoreBytes(const StoreBytes&) = delete;
    StoreBytes& operator=(const StoreBytes&) = delete;
    virtual ~StoreBytes() = default;

    /// For messages: a path, or a URL without credentials.
    [[nodiscard]] virtual const std::string& name() const = 0;
    [[nodiscard]] virtual std::uint64_t size() const = 0;
    /// What the server says that tells the object's state from others, its ETag or its time of
    /// change. Empty for a local file, and where the server says nothing.
    [[nodiscard]] virtual std::string version() const { return {}; }
    /// Whether bytes that nobody announced by want() cost a round trip.
    [[nodiscard]] virtual bool is_far() const = 0;
    /// REQUIRES: the range lies within size(). May wait for the network. Throws Error{io}.
    [[nodiscard]] virtual HeldBytes read(std::uint64_t offset, std::uint64_t size) const = 0;
    /// A hint that these ranges are needed soon, and together: returns at once. Parts outside
    /// size() are left out. Those who ask later wait for what is under way.
    virtual void want(std::span<const ByteRange> ranges) const = 0;
    /// These bytes are not those that were written: who reads them next gets them anew, if they
    /// came from elsewhere. What somebody holds of them stays as it is.
    virtual void forget(const ByteRange& /*range*/) const {}
    [[nodiscard]] virtual FetchedCounts fetched() const { return {}; }
};

}  // namespace isonest::detail
