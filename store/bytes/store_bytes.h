// The bytes of a store: a map of a local file, or ranges of a remote object.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <isonest/error.h>
#include <isonest/remote.h>

#include "store/base/checksum.h"
#include "store/files/open_file.h"

namespace isonest::detail {

/// Bytes [offset, offset + size) of a store.
struct ByteRange {
    std::uint64_t offset = 0;
    std::uint64_t size = 0;
};

/// Whether `size` bytes starting at `offset` lie in a file of `of` bytes.
inline bool lies_within(std::uint64_t offset, std::uint64_t size, std::uint64_t of) {
    return offset <= of && size <= of - offset;
}

/// Bytes that stay valid while this or a copy of it is held.
class HeldBytes {
  public:
    HeldBytes() = default;
    /// `owner`: keeps `bytes` alive; null for a map that outlives all users.
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
    /// What the server reports to identify the object's state: its ETag or its modification time.
    /// Empty for a local file, or if the server reports neither.
    [[nodiscard]] virtual std::string version() const { return {}; }
    /// Whether bytes that were not prefetched by want() cost a round trip.
    [[nodiscard]] virtual bool is_remote() const = 0;
    /// REQUIRES: the range lies within size(). May wait for the network. Throws Error{io}.
    [[nodiscard]] virtual HeldBytes read(std::uint64_t offset, std::uint64_t size) const = 0;
    /// A hint that these ranges are needed soon, and together; returns at once. Parts outside
    /// size() are ignored. Later reads wait for requests that are under way.
    virtual void want(std::span<const ByteRange> ranges) const = 0;
    /// These bytes are not those that were written: the next read fetches them again if the object
    /// is remote. HeldBytes that were returned earlier do not change.
    virtual void forget(const ByteRange& /*range*/) const {}
    [[nodiscard]] virtual FetchedCounts fetched() const { return {}; }
};

// Caches of ranges of a remote object, for example on a disk.

/// The cached ranges of one object in one state.
/// Thread-safety: all methods from any thread.
class RangeCache {
  public:
    RangeCache() = default;
    RangeCache(const RangeCache&) = delete;
    RangeCache& operator=(const RangeCache&) = delete;
    virtual ~RangeCache() = default;

    /// The bytes of this range, which may have been kept as parts of other ranges. Nullopt if any
    /// of them is missing or damaged; they are then fetched. Does not throw for failures of the
    /// cache itself.
    [[nodiscard]] virtual std::optional<std::vector<std::byte>> load(ByteRange range) = 0;
    /// Offers the bytes of this range, range.size of them. Failures are ignored silently: the cache
    /// only saves time.
    virtual void keep(ByteRange range, std::span<const std::byte> bytes) = 0;
    /// The cached bytes of this range are not those that were written; removes them.
    virtual void forget(ByteRange range) = 0;
};

/// An object in the state in which it was opened: the key of a cache.
struct ObjectState {
    std::string url;  ///< without userinfo and query
    /// The strong ETag as the server sent it, or "last-modified: ..." if there is none and the URL
    /// has no query. Empty without either: then nothing may be kept beyond this opening.
    std::string version;
    std::uint64_t size = 0;  ///< bytes
    /// Distinguishes URLs with the same `url` by their queries; contains no secrets.
    std::string query = {};
};

// Many objects below one URL. Their names are known, but not which of them exist.

/// The part of an object to fetch.
struct ObjectPart {
    enum class Kind : std::uint8_t {
        whole,  ///< up to `size` bytes; a larger object is an error
        first,  ///< the first `size` bytes, or all if there are fewer
        last,   ///< the last `size` bytes, or all if there are fewer
        range   ///< `size` bytes from `offset` on, of an object of which first or last was read
    };
    std::string path = {};  ///< below the URL, not encoded, separated by '/'
    Kind kind = Kind::whole;
    std::uint64_t size = 0;
    std::uint64_t offset = 0;  ///< of a range
};

struct FetchedPart {
    bool is_there = false;  ///< false: there is no such object (404, 410)
    /// Set if the server refused the object (403). S3 also answers 403 for an object that does not
    /// exist if the client may not list the bucket.
    std::shared_ptr<const Error> refusal = nullptr;
    HeldBytes bytes = {};
    std::uint64_t object_size = 0;  ///< bytes of the whole object
    std::string version = {};       ///< its ETag, else its date; empty: the server reports neither
};

/// The objects below a URL. All parts of an object that are in memory at the same time are of the
/// same state of it: if the object has changed, reading throws an error. Memory: bytes that were
/// prefetched, are being fetched, or are kept after reading in case they are read again take at
/// most RemoteOptions::budget_bytes; a larger part is fetched alone. Thread-safety: all methods
/// from any thread.
class ObjectFolder {
  public:
    ObjectFolder() = default;
    ObjectFolder(const ObjectFolder&) = delete;
    ObjectFolder& operator=(const ObjectFolder&) = delete;
    virtual ~ObjectFolder() = default;

    /// For messages: the URL without credentials, query and trailing slash.
    [[nodiscard]] virtual const std::string& name() const = 0;
    /// Waits for the network. Throws Error{io, corrupt} with the object's URL, and what
    /// RemoteOptions::check throws.
    [[nodiscard]] virtual FetchedPart read(const ObjectPart& part) = 0;
    /// What read() would return, if no waiting is needed; nullopt otherwise, or if read() would
    /// throw.
    [[nodiscard]] virtual std::optional<FetchedPart> look_at(const ObjectPart& part) = 0;
    /// A hint that these parts are read soon, in this order, after everything prefetched before;
    /// returns at once. Ranges of one object that follow each other in this list may be joined.
    virtual void want(std::span<const ObjectPart> parts) = 0;
    [[nodiscard]] virtual FetchedCounts fetched() const = 0;
};

// The bytes of a local file, through a read-only map.

class FileBytes : public StoreBytes {
  public:
    /// Throws Error{not_found, io}.
    explicit FileBytes(const std::filesystem::path& path) : name_(path.string()), file_(path) {}

    [[nodiscard]] const std::string& name() const override { return name_; }
    [[nodiscard]] std::uint64_t size() const override { return file_.bytes().size(); }
    [[nodiscard]] bool is_remote() const override { return false; }
    [[nodiscard]] HeldBytes read(std::uint64_t offset, std::uint64_t size) const override {
        return {nullptr, file_.bytes().subspan(offset, size)};
    }
    void want(std::span<const ByteRange> ranges) const override {
        for (const ByteRange& range : ranges) {
            file_.prefetch(range.offset, range.size);
        }
    }

  private:
    std::string name_;
    MappedFile file_;
};

// Reading bytes with a known checksum.

/// Nullopt if the bytes are not those that were written. For a remote store they are first fetched
/// once more, because they may have been damaged on the way. REQUIRES: the range lies within
/// bytes.size(). Throws Error{io}.
inline std::optional<HeldBytes> read_whole(const StoreBytes& bytes, const ByteRange& range,
                                           std::uint64_t xxh64) {
    HeldBytes held = bytes.read(range.offset, range.size);
    if (checksum_of(held.bytes()) != xxh64 && bytes.is_remote()) {
        bytes.forget(range);
        held = bytes.read(range.offset, range.size);
    }
    return checksum_of(held.bytes()) == xxh64 ? std::optional(std::move(held)) : std::nullopt;
}

}  // namespace isonest::detail
