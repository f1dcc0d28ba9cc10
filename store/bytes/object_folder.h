// Many objects below one URL, of which the names are known, but not which there are.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <isonest/error.h>
#include <isonest/remote.h>

#include "store/bytes/store_bytes.h"

namespace isonest::detail {

/// What of an object is fetched.
struct ObjectPart {
    enum class Kind : std::uint8_t {
        whole,  ///< up to `size` bytes; more is an error
        first,  ///< the first `size` bytes, or all of fewer
        last,   ///< the last `size` bytes, or all of fewer
        range   ///< `size` bytes from `offset` on, of an object of which first or last was read
    };
    std::string path = {};  ///< below the URL, not encoded, with '/' between its parts
    Kind kind = Kind::whole;
    std::uint64_t size = 0;
    std::uint64_t offset = 0;  ///< of a range
};

struct FetchedPart {
    bool is_there = false;  ///< false: there is no such object (404, 410)
    /// The server refused it (403). Where nobody may list an S3 bucket, it says so of objects that
    /// are not there, too. Null otherwise.
    std::shared_ptr<const Error> refusal = nullptr;
    HeldBytes bytes = {};
    std::uint64_t object_size = 0;  ///< bytes of the whole object
    std::string version = {};       ///< its ETag, else its date; empty: the server tells neither
};

/// What was read of one object by first, last and range is of one state of it, as long as it is in
/// memory: where it has changed, reading is an error. Memory: what was announced, is on its way, or
/// was read and is kept in case that it is read again, takes RemoteOptions::budget_bytes at most;
/// a part that is larger comes alone.
/// Thread-safety: all methods from any thread.
class ObjectFolder {
  public:
    ObjectFolder() = default;
    ObjectFolder(const ObjectFolder&) = delete;
    ObjectFolder& operator=(const ObjectFolder&) = delete;
    virtual ~ObjectFolder() = default;

    /// For messages: the URL without credentials, query and the last slash.
    [[nodiscard]] virtual const std::string& name() const = 0;
    /// Waits for the network. Throws Error{io, corrupt} with the object's URL, and what
    /// RemoteOptions::check throws.
    [[nodiscard]] virtual FetchedPart read(const ObjectPart& part) = 0;
    /// What read() would give, if that need not wait: nothing otherwise, or where it would throw.
    [[nodiscard]] virtual std::optional<FetchedPart> look_at(const ObjectPart& part) = 0;
    /// A hint that these are read soon, in this order, after what was announced before: returns at
    /// once. Ranges of one object that stand one after the other here may be joined.
    virtual void want(std::span<const ObjectPart> parts) = 0;
    [[nodiscard]] virtual FetchedCounts fetched() const = 0;
};

}  // namespace isonest::detail
