// Objects below one URL, fetched as a whole or in part, many at a time.
#pragma once

#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <list>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <tuple>
#include <vector>

#include "store/bytes/store_bytes.h"
#include "store/remote/fetch_loop.h"
#include "store/remote/object_url.h"

namespace isonest::detail {

class UrlFolder : public ObjectFolder {
  public:
    /// Sends no request yet. Throws Error{unsupported} without libcurl.
    UrlFolder(const ObjectUrl& url, RemoteOptions options);
    ~UrlFolder() override = default;

    [[nodiscard]] const std::string& name() const override { return name_; }
    [[nodiscard]] FetchedPart read(const ObjectPart& part) override;
    [[nodiscard]] std::optional<FetchedPart> look_at(const ObjectPart& part) override;
    void want(std::span<const ObjectPart> parts) override;
    /// round_trips are counted as in UrlBytes.
    [[nodiscard]] FetchedCounts fetched() const override;

  private:
    using Lock = std::unique_lock<std::mutex>;
    /// What was requested at a time, and what has arrived.
    struct Entry;
    using EntryPointer = std::shared_ptr<Entry>;
    class PartJob;
    /// Path, kind, offset.
    using Key = std::tuple<std::string, ObjectPart::Kind, std::uint64_t>;

    std::shared_ptr<FetchJob> next_job();
    static Key key_of(const ObjectPart& part);
    // With the lock held:
    std::shared_ptr<FetchObject> object_of(const std::string& path);
    /// The entry that covers the part; null if there is none.
    [[nodiscard]] EntryPointer find(const ObjectPart& part) const;
    EntryPointer insert(const ObjectPart& part, std::uint64_t wanted);
    /// Removes it from the map; whoever holds it keeps it.
    void forget(Entry& entry);
    void set_charge(Entry& entry, std::uint64_t bytes);
    /// The requested part, taken from an entry that covers it.
    FetchedPart take(const EntryPointer& entry, const ObjectPart& part);
    void want_ranges(std::span<const ObjectPart> ranges);
    void forget_unused();
    /// Whether there is room for an entry that has not been requested yet. An urgent entry is one
    /// that somebody waits for: prefetched entries that nobody waits for make room for it.
    bool make_room(const Entry& entry, bool is_urgent);
    [[nodiscard]] bool fits(const Entry& entry) const;

    std::string name_;
    ObjectUrl url_;
    RemoteOptions options_;

    mutable std::mutex mutex_;
    std::condition_variable changed_;
    std::map<Key, EntryPointer> entries_;
    std::list<Entry*> read_;  ///< of entries_: those that were read and are kept, the least
                              ///< recently used one first
    std::deque<EntryPointer> urgent_;
    std::deque<EntryPointer> hinted_;
    /// Objects from which ranges are read, as long as something holds them.
    std::map<std::string, std::weak_ptr<FetchObject>> objects_;
    std::uint64_t charged_ = 0;  ///< bytes of all requested entries
    std::uint64_t generation_ = 0;
    std::uint64_t rounds_ = 0;
    FetchLoop loop_;  ///< last, because its thread uses the members above
};

}  // namespace isonest::detail
