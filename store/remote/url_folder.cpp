#include "store/remote/url_folder.h"

#include <fmt/format.h>

#include <algorithm>
#include <iterator>
#include <utility>

#include <isonest/error.h>

#include "store/remote/fetch_loop.h"
#include "store/remote/ranges.h"

namespace isonest::detail {
namespace {

/// Approximate memory of each entry in addition to its bytes.
constexpr std::uint64_t kEntryBytes = 1024;
/// Announcements after which unread entries are dropped as mistaken.
constexpr std::uint64_t kOldPrefetch = 4096;

}  // namespace

struct UrlFolder::Entry {
    enum class State : std::uint8_t { queued, coming, present, failed, forgotten };

    ObjectPart part;
    std::shared_ptr<FetchObject> object;
    State state = State::queued;
    FetchedPart fetched = {};  ///< without the bytes
    std::vector<std::byte> bytes = {};
    std::shared_ptr<const Error> failure = nullptr;
    std::uint64_t charge = 0;
    std::uint64_t unread = 0;  ///< of a range: bytes; else 1
    std::uint64_t generation = 0;
    std::uint64_t round = 0;
    int waiting = 0;
    bool is_in_map = true;
    std::optional<std::list<Entry*>::iterator> place = {};  ///< in read_

    [[nodiscard]] bool is_over() const { return state != State::queued && state != State::coming; }
    [[nodiscard]] std::uint64_t max_bytes() const { return part.size + kEntryBytes; }
    [[nodiscard]] bool is_kept() const {
        return part.kind == ObjectPart::Kind::first || part.kind == ObjectPart::Kind::last;
    }
};

class UrlFolder::PartJob : public FetchJob {
  public:
    PartJob(UrlFolder& owner, EntryPointer entry) : owner_(owner), entry_(std::move(entry)) {}

    [[nodiscard]] FetchObject& object() const override { return *entry_->object; }
    [[nodiscard]] Asked asked() const override {
        const ObjectPart& part = entry_->part;
        switch (part.kind) {
            case ObjectPart::Kind::whole:
                return {.is_whole = true, .most = part.size};
            case ObjectPart::Kind::last:
                return {.tail = part.size};
            case ObjectPart::Kind::first:
            case ObjectPart::Kind::range:
                break;
        }
        return {.range = {part.offset, part.size}};
    }
    void begin(const AnswerHead& head, const ByteRange& range, std::uint64_t size) override {
        Entry& entry = *entry_;
        const bool is_whole = entry.part.kind == ObjectPart::Kind::whole;
        if (!is_whole && size == 0) {
            is_empty_ = true;  // nothing comes: done() reports that
            return;
        }
        if (!is_whole) {
            if (entry.part.offset + entry.part.size > size) {
                throw Error(ErrorKind::corrupt,
                            fmt::format("it has {} bytes, but {} were expected", size,
                                        entry.part.offset + entry.part.size));
            }
            if (!entry.object->opened) {
                entry.object->opened = {head.etag, head.last_modified, size};
            }
        }
        entry.bytes.clear();
        if (!is_whole || head.length) {
            entry.bytes.reserve(range.size);
            const Lock lock(owner_.mutex_);
            owner_.set_charge(entry, range.size + kEntryBytes);
        }
        entry.fetched.object_size = size;
        entry.fetched.version = head.etag.empty() ? head.last_modified : head.etag;
    }
    void take(std::span<const std::byte> bytes) override {
        entry_->bytes.insert(entry_->bytes.end(), bytes.begin(), bytes.end());
    }
    void done() override {
        Entry& entry = *entry_;
        if (is_empty_) {
            entry.failure = std::make_shared<const Error>(
                ErrorKind::corrupt, ErrorPlace{entry.object->name},
                fmt::format("it is empty, but {} bytes were expected", entry.part.size));
            end(Entry::State::failed);
            return;
        }
        entry.fetched.is_there = true;
        if (entry.part.kind == ObjectPart::Kind::whole) {
            entry.fetched.object_size = entry.bytes.size();
        }
        end(Entry::State::present);
    }
    void failed(const Error& error, const Failure& why) override {
        Entry& entry = *entry_;
        entry.bytes = {};
        const bool may_be_missing = entry.part.kind != ObjectPart::Kind::range;
        if (may_be_missing && (why.status == 404 || why.status == 410)) {
            end(Entry::State::present);
        } else if (may_be_missing && why.status == 403) {
            entry.fetched.refusal = std::make_shared<const Error>(error);
            end(Entry::State::present);
        } else {
            entry.failure = std::make_shared<const Error>(error);
            end(Entry::State::failed);
        }
    }

  private:
    void end(Entry::State state) {
        const Lock lock(owner_.mutex_);
        owner_.set_charge(*entry_, entry_->bytes.size() + kEntryBytes);
        if (entry_->is_in_map) {
            entry_->state = state;
        }
        owner_.changed_.notify_all();
    }

    UrlFolder& owner_;
    EntryPointer entry_;
    bool is_empty_ = false;
};

UrlFolder::UrlFolder(const ObjectUrl& url, RemoteOptions options)
    : name_(url.name.substr(0, url.name.find_last_not_of('/') + 1)),
      url_(url),
      options_(std::move(options)),
      loop_({url, options_}, [this] { return next_job(); }) {}

UrlFolder::Key UrlFolder::key_of(const ObjectPart& part) {
    return {part.path, part.kind, part.kind == ObjectPart::Kind::range ? part.offset : 0};
}

std::shared_ptr<FetchObject> UrlFolder::object_of(const std::string& path) {
    if (objects_.size() > 2 * entries_.size() + 64) {
        std::erase_if(objects_, [](const auto& known) { return known.second.expired(); });
    }
    std::weak_ptr<FetchObject>& known = objects_[path];
    std::shared_ptr<FetchObject> object = known.lock();
    if (object == nullptr) {
        const ObjectUrl url = object_below(url_, path);
        object = std::make_shared<FetchObject>(FetchObject{url.name, url.request});
        known = object;
    }
    return object;
}

UrlFolder::EntryPointer UrlFolder::find(const ObjectPart& part) const {
    if (part.kind != ObjectPart::Kind::range) {
        const auto same = entries_.find(key_of(part));
        return same == entries_.end() || same->second->part.size < part.size ? nullptr
                                                                             : same->second;
    }
    const auto behind = entries_.upper_bound(key_of(part));
    if (behind == entries_.begin()) {
        return nullptr;
    }
    const EntryPointer& before = std::prev(behind)->second;
    return before->part.kind == part.kind && before->part.path == part.path &&
                   part.offset + part.size <= before->part.offset + before->part.size
               ? before
               : nullptr;
}

UrlFolder::EntryPointer UrlFolder::insert(const ObjectPart& part, std::uint64_t wanted) {
    const auto entry = std::make_shared<Entry>();
    entry->part = part;
    if (part.kind == ObjectPart::Kind::whole) {
        const ObjectUrl url = object_below(url_, part.path);
        entry->object = std::make_shared<FetchObject>(FetchObject{url.name, url.request});
    } else {
        entry->object = object_of(part.path);
    }
    entry->unread = wanted;
    entry->generation = generation_;
    entry->round = rounds_ + 1;
    EntryPointer& place = entries_[key_of(part)];
    if (place != nullptr) {
        forget(*EntryPointer(place));
    }
    entries_[key_of(part)] = entry;
    return entry;
}

void UrlFolder::forget(Entry& entry) {
    set_charge(entry, 0);
    entry.is_in_map = false;
    entry.state = Entry::State::forgotten;
    if (entry.place) {
        read_.erase(*entry.place);
        entry.place.reset();
    }
    entries_.erase(key_of(entry.part));  // may be the last reference to it
}

void UrlFolder::set_charge(Entry& entry, std::uint64_t bytes) {
    if (entry.is_in_map) {
        charged_ += bytes;
        charged_ -= std::exchange(entry.charge, bytes);
    }
}

bool UrlFolder::fits(const Entry& entry) const {
    return charged_ + entry.max_bytes() <= options_.budget_bytes;
}

bool UrlFolder::make_room(const Entry& entry, bool is_urgent) {
    for (const bool drops_kept : {false, true}) {
        for (auto at = read_.begin(); at != read_.end() && !fits(entry);) {
            Entry& used = **at++;
            if (used.waiting == 0 && (drops_kept || !used.is_kept())) {
                forget(*EntryPointer(entries_.at(key_of(used.part))));
            }
        }
    }
    if (is_urgent && !fits(entry)) {
        std::vector<EntryPointer> unread;
        for (const auto& [key, other] : entries_) {
            if (other->is_over() && other->waiting == 0) {
                unread.push_back(other);  // or one that failed, which is requested again
            }
        }
        for (; !unread.empty() && !fits(entry); unread.pop_back()) {
            forget(*unread.back());
        }
    }
    return fits(entry) || (is_urgent && charged_ == 0);
}

std::shared_ptr<FetchJob> UrlFolder::next_job() {
    const Lock lock(mutex_);
    for (const bool is_urgent : {true, false}) {
        std::deque<EntryPointer>& queue = is_urgent ? urgent_ : hinted_;
        for (; !queue.empty(); queue.pop_front()) {
            const EntryPointer entry = queue.front();
            if (entry->state != Entry::State::queued) {
                continue;
            }
            if (!make_room(*entry, is_urgent)) {
                return nullptr;
            }
            auto job = std::make_shared<PartJob>(*this, entry);
            queue.pop_front();
            entry->state = Entry::State::coming;
            set_charge(*entry, entry->max_bytes());
            return job;
        }
    }
    return nullptr;
}

FetchedPart UrlFolder::take(const EntryPointer& entry, const ObjectPart& part) {
    FetchedPart out = entry->fetched;
    const std::span<const std::byte> bytes(entry->bytes);
    out.bytes = {entry, part.kind == ObjectPart::Kind::range && out.is_there
                            ? bytes.subspan(part.offset - entry->part.offset, part.size)
                            : bytes};
    entry->unread -= std::min(entry->unread,
                              part.kind == ObjectPart::Kind::range ? part.size : std::uint64_t{1});
    if (entry->place) {
        read_.splice(read_.end(), read_, *entry->place);
    } else if (entry->unread == 0 && entry->is_in_map) {
        entry->place = read_.insert(read_.end(), entry.get());
        loop_.wake();  // there may be room now
    }
    if (!urgent_.empty()) {
        loop_.wake();  // nobody waits for this any more: it may be dropped
    }
    return out;
}

FetchedPart UrlFolder::read(const ObjectPart& part) {
    Lock lock(mutex_);
    while (true) {
        EntryPointer entry = find(part);
        if (entry == nullptr) {
            entry = insert(part, part.kind == ObjectPart::Kind::range ? part.size : 1);
        }
        if (entry->state == Entry::State::queued && entry->waiting == 0) {
            urgent_.push_back(entry);
            loop_.wake();
        }
        if (!entry->is_over()) {
            struct Waiting {
                explicit Waiting(int& of) : count(of) { ++count; }
                Waiting(const Waiting&) = delete;
                Waiting& operator=(const Waiting&) = delete;
                ~Waiting() { --count; }
                int& count;
            };
            const Waiting waiting(entry->waiting);
            try {
                wait_and_check(lock, changed_, options_.check,
                               [&entry] { return entry->is_over(); });
            } catch (...) {
                if (!lock.owns_lock()) {
                    lock.lock();  // the counter needs the lock
                }
                throw;
            }
            rounds_ = std::max(rounds_, entry->round);
        }
        if (entry->state == Entry::State::failed) {
            const std::shared_ptr<const Error> failure = entry->failure;
            if (entry->is_in_map && entry->waiting == 0) {
                forget(*entry);
                loop_.wake();  // there may be room now
            }
            throw_copy_of(*failure);
        }
        if (entry->state == Entry::State::present) {
            return take(entry, part);
        }
        // It was forgotten in the meantime: try again.
    }
}

std::optional<FetchedPart> UrlFolder::look_at(const ObjectPart& part) {
    const Lock lock(mutex_);
    const EntryPointer entry = find(part);
    return entry != nullptr && entry->state == Entry::State::present
               ? std::optional(take(entry, part))
               : std::nullopt;
}

void UrlFolder::forget_unused() {
    std::vector<EntryPointer> old;
    for (const auto& [key, entry] : entries_) {
        if (!entry->place && entry->waiting == 0 && entry->state != Entry::State::coming &&
            entry->generation + kOldPrefetch < generation_) {
            old.push_back(entry);
        }
    }
    for (const EntryPointer& entry : old) {
        forget(*entry);
    }
}

void UrlFolder::want(std::span<const ObjectPart> parts) {
    const Lock lock(mutex_);
    if (++generation_ % kOldPrefetch == 0) {
        forget_unused();
    }
    for (std::size_t i = 0; i < parts.size();) {
        const ObjectPart& part = parts[i];
        std::size_t end = i + 1;
        if (part.kind == ObjectPart::Kind::range) {
            while (end < parts.size() && parts[end].kind == part.kind &&
                   parts[end].path == part.path) {
                ++end;
            }
            want_ranges(parts.subspan(i, end - i));
        } else if (const EntryPointer known = find(part)) {
            known->generation = generation_;
        } else if (part.size + kEntryBytes <= options_.budget_bytes) {
            hinted_.push_back(insert(part, 1));
        }
        i = end;
    }
    loop_.wake();
}

void UrlFolder::want_ranges(std::span<const ObjectPart> ranges) {
    std::vector<ByteRange> absent;
    JoinLimits limits;
    limits.largest = std::min(limits.largest, options_.budget_bytes / 8);
    for (const ObjectPart& part : ranges) {
        if (const EntryPointer known = find(part)) {
            known->generation = generation_;
        } else if (part.size > 0 && part.size + kEntryBytes <= options_.budget_bytes) {
            absent.push_back({part.offset, part.size});
            limits.largest = std::max(limits.largest, part.size);  // parts are not split
        }
    }
    std::sort(absent.begin(), absent.end(),
              [](const ByteRange& a, const ByteRange& b) { return a.offset < b.offset; });
    const auto overlaps = [end = std::uint64_t{0}](const ByteRange& range) mutable {
        const bool does = range.offset < end;
        end = does ? end : end_of(range);
        return does;
    };
    absent.erase(std::remove_if(absent.begin(), absent.end(), overlaps), absent.end());
    if (absent.empty()) {
        return;
    }
    ObjectPart joined{ranges.front().path, ObjectPart::Kind::range};
    const auto is_absent = [&](const ByteRange& gap) {
        const auto next = entries_.lower_bound({joined.path, ObjectPart::Kind::range, gap.offset});
        return next == entries_.end() || next->second->part.path != joined.path ||
               next->second->part.offset >= end_of(gap);
    };
    for (const JoinedRange& one : join_ranges(absent, limits, is_absent)) {
        joined.offset = one.range.offset;
        joined.size = one.range.size;
        hinted_.push_back(insert(joined, one.wanted));
    }
}

FetchedCounts UrlFolder::fetched() const {
    const RequestCounts counts = loop_.counts();
    const Lock lock(mutex_);
    return {counts.bytes, counts.requests, rounds_, 0};
}

}  // namespace isonest::detail
