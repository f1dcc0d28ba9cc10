#include "store/remote/url_bytes.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstddef>
#include <cstring>
#include <exception>
#include <optional>
#include <utility>

#include <isonest/error.h>

#include "store/base/checksum.h"
#include "store/remote/fetch_loop.h"
#include "store/remote/ranges.h"

namespace isonest::detail {
namespace {

/// The checksum reveals nothing of the query, which may contain secrets.
std::string checksum_of_query(const std::string& url) {
    const std::string query = query_without_signature(url);
    return query.empty() ? ""
                         : fmt::format("{:016x}", checksum_of(std::as_bytes(std::span(query))));
}

}  // namespace

class UrlBytes::ExtentJob : public FetchJob {
  public:
    ExtentJob(const UrlBytes& owner, ExtentPointer extent)
        : owner_(owner), extent_(std::move(extent)) {}

    [[nodiscard]] Asked asked() const override { return {.range = extent_->range}; }
    [[nodiscard]] FetchObject& object() const override { return owner_.object_; }
    void begin(const AnswerHead& /*head*/, const ByteRange& /*range*/,
               std::uint64_t /*size*/) override {
        extent_->bytes.resize(extent_->range.size);
    }
    void take(std::span<const std::byte> bytes) override {
        std::memcpy(extent_->bytes.data() + extent_->received, bytes.data(), bytes.size());
        const Lock lock(owner_.mutex_);
        extent_->received += bytes.size();
        owner_.changed_.notify_all();
    }
    void done() override {
        owner_.keep_later(extent_);  // before anybody can find out that its bytes are wrong
        owner_.end_extent(*extent_, Extent::State::present, nullptr);
    }
    void failed(const Error& error, const Failure& why) override {
        const auto failure = std::make_shared<const Error>(error);
        owner_.end_extent(*extent_, Extent::State::failed, failure);
        if (why.is_change) {
            const Lock lock(owner_.mutex_);
            owner_.broken_ = failure;
            owner_.changed_.notify_all();
        }
    }

  private:
    const UrlBytes& owner_;
    ExtentPointer extent_;
};

/// Fetches the end of the object, and its properties.
class UrlBytes::OpeningJob : public FetchJob {
  public:
    explicit OpeningJob(UrlBytes& owner) : owner_(owner) {}

    [[nodiscard]] Asked asked() const override {
        return {.tail = owner_.known_ ? kKnownTailBytes : kTailBytes};
    }
    [[nodiscard]] FetchObject& object() const override { return owner_.object_; }
    void begin(const AnswerHead& head, const ByteRange& range, std::uint64_t size) override {
        const Validators opened{head.etag, head.last_modified, size};
        owner_.object_.opened = opened;
        const Lock lock(owner_.mutex_);
        owner_.state_ = {owner_.object_.name, "", size, owner_.query_};
        owner_.version_ = !opened.etag.empty() ? opened.etag : opened.last_modified;
        if (opened.is_strong()) {
            owner_.state_.version = opened.etag;
        } else if (!opened.last_modified.empty() && !owner_.has_query_) {
            owner_.state_.version = "last-modified: " + opened.last_modified;
        }
        if (range.size > 0) {
            extent_ = owner_.extents_.insert(range);
            extent_->is_started = true;
            extent_->bytes.resize(range.size);
        }
    }
    void take(std::span<const std::byte> bytes) override {
        std::memcpy(extent_->bytes.data() + extent_->received, bytes.data(), bytes.size());
        extent_->received += bytes.size();
    }
    void done() override {
        if (extent_ != nullptr) {
            owner_.end_extent(*extent_, Extent::State::present, nullptr);
        }
        const Lock lock(owner_.mutex_);
        owner_.is_open_ = true;
        owner_.changed_.notify_all();
    }
    void failed(const Error& error, const Failure& /*why*/) override {
        const Lock lock(owner_.mutex_);
        owner_.broken_ = std::make_shared<const Error>(error);
        owner_.changed_.notify_all();
    }

  private:
    UrlBytes& owner_;
    ExtentPointer extent_;
};

UrlBytes::UrlBytes(ObjectUrl url, RemoteOptions options)
    : object_{url.name, url.request},
      has_query_(url.request.find('?') != std::string::npos),
      query_(checksum_of_query(url.request)),
      options_(std::move(options)),
      known_(options_.recall ? options_.recall({object_.name, "", 0, query_}) : std::nullopt),
      extents_(options_.budget_bytes),
      opening_(std::make_shared<OpeningJob>(*this)),
      loop_({std::move(url), options_}, [this] { return next_job(); }) {
    use_cache();
}

UrlBytes::~UrlBytes() {
    {
        const Lock lock(mutex_);
        is_closing_ = true;
    }
    loop_.stop();
    loading_.reset();
    if (keeping_ == nullptr) {
        return;
    }
    constexpr std::chrono::milliseconds kUntilAllIsKept = std::chrono::minutes(1);
    constexpr std::chrono::milliseconds kOfCancelled{200};
    const auto is_stopped = [this] {
        try {
            check_whoever_waits();
        } catch (...) {  // NOLINT(bugprone-empty-catch): it is noted
        }
        return was_cancelled_.load();
    };
    if (was_cancelled_) {
        keeping_->finish(kOfCancelled);
    } else {
        keeping_->finish(kUntilAllIsKept, is_stopped);
    }
}

/// Waits until the object is open. Meanwhile loads its end from the cache, which is used if the
/// object is still in the same state.
void UrlBytes::use_cache() {
    std::shared_ptr<RangeCache> known_cache;
    std::optional<std::vector<std::byte>> tail;
    if (known_ && options_.make_cache) {
        known_cache = options_.make_cache(*known_);
        for (const std::uint64_t most : {kTailBytes, kKnownTailBytes}) {
            const std::uint64_t bytes = std::min(most, known_->size);
            if (known_cache != nullptr && !tail) {
                tail = known_cache->load({known_->size - bytes, bytes});
            }
        }
    }
    Lock lock(mutex_);
    wait_until(lock, [this] { return is_open_; });
    rounds_ = 1;
    // Nothing may be kept of an object in an unknown state.
    if (!options_.make_cache || state_.version.empty()) {
        return;
    }
    const bool is_known =
        known_ && known_->version == state_.version && known_->size == state_.size;
    if (is_known && tail && !take_known_tail(*tail)) {
        return;  // another object with the same ETag
    }
    lock.unlock();
    cache_ = is_known && known_cache != nullptr ? known_cache : options_.make_cache(state_);
    if (cache_ == nullptr) {
        return;
    }
    loading_ = std::make_unique<Background>(~std::uint64_t{0}, object_.name);
    keeping_ = std::make_unique<Background>(options_.budget_bytes / 4, object_.name);
    lock.lock();
    const std::vector<ExtentPointer> end =
        extents_.use({state_.size - std::min(state_.size, kKnownTailBytes), kKnownTailBytes});
    lock.unlock();
    if (!(is_known && tail)) {
        for (const ExtentPointer& extent : end) {
            keep_later(extent);
        }
    }
    if (!is_known && options_.remember) {
        keeping_->add(0, [this] { options_.remember(state_); });
    }
}

/// Takes the end of the object from the cache, if it agrees with the part that the server sent.
bool UrlBytes::take_known_tail(const std::vector<std::byte>& tail) {
    const ByteRange range{state_.size - tail.size(), tail.size()};
    for (const ExtentPointer& extent : extents_.use(range)) {
        if (!std::equal(extent->bytes.begin(), extent->bytes.end(),
                        tail.end() - static_cast<std::ptrdiff_t>(extent->bytes.size()))) {
            return false;
        }
    }
    for (const ByteRange& absent : extents_.absent(range)) {
        const ExtentPointer extent = extents_.insert(absent);
        const auto first = tail.begin() + static_cast<std::ptrdiff_t>(absent.offset - range.offset);
        extent->bytes.assign(first, first + static_cast<std::ptrdiff_t>(absent.size));
        extent->received = absent.size;
        extent->is_started = true;
        extent->state = Extent::State::present;
        cache_bytes_ += absent.size;
    }
    return true;
}

/// When the extent has been kept and released, there may be room for prefetched ranges.
void UrlBytes::keep_later(const ExtentPointer& extent) const {
    if (keeping_ == nullptr) {
        return;
    }
    {
        const Lock lock(mutex_);
        if (extent->is_forgotten) {
            return;
        }
    }
    keeping_->add(extent->range.size, [this, held = extent]() mutable {
        cache_->keep(held->range, held->bytes);
        held.reset();
        const Lock lock(mutex_);
        ask_for_hints();
    });
}

void UrlBytes::forget(const ByteRange& range) const {
    constexpr std::size_t kMaxDistrusted = 4096;
    const Lock lock(mutex_);
    for (const ExtentPointer& extent : extents_.use(range)) {
        // Places that wait for the cache have no bytes yet.
        if (extent->state == Extent::State::present || extent->received > 0) {
            extent->is_forgotten = extent->state != Extent::State::present;
            extents_.erase(*extent);
        }
    }
    if (keeping_ != nullptr) {
        distrusted_.push_back(range);
        if (distrusted_.size() > kMaxDistrusted) {
            distrusted_.pop_front();
        }
        keeping_->add(0, [this, range] { cache_->forget(range); });
    }
}

bool UrlBytes::is_distrusted(const ByteRange& range) const {
    return std::any_of(distrusted_.begin(), distrusted_.end(), [&](const ByteRange& wrong) {
        return wrong.offset < end_of(range) && range.offset < end_of(wrong);
    });
}

void UrlBytes::check_whoever_waits() const {
    if (options_.check) {
        try {
            options_.check();
        } catch (...) {
            was_cancelled_ = true;
            throw;
        }
    }
}

void UrlBytes::wait_until(Lock& lock, const std::function<bool()>& is_over) const {
    wait_and_check(
        lock, changed_, [this] { check_whoever_waits(); },
        [&] {
            if (broken_ != nullptr) {
                throw_copy_of(*broken_);
            }
            return is_over();
        });
}

void UrlBytes::end_extent(Extent& extent, Extent::State state,
                          std::shared_ptr<const Error> failure) const {
    const Lock lock(mutex_);
    extent.state = state;
    extent.failure = std::move(failure);
    if (state != Extent::State::present) {
        extents_.erase(extent);
    }
    changed_.notify_all();
}

HeldBytes UrlBytes::held(const std::vector<ExtentPointer>& extents, const ByteRange& range) {
    const std::uint64_t first = range.offset - extents[0]->range.offset;
    if (extents.size() == 1) {
        const std::span<const std::byte> bytes(extents[0]->bytes);
        return {extents[0], bytes.subspan(first, range.size)};
    }
    auto whole = std::make_shared<std::vector<std::byte>>(range.size);
    for (const ExtentPointer& extent : extents) {
        const std::uint64_t from = std::max(range.offset, extent->range.offset);
        const std::uint64_t until = std::min(end_of(range), end_of(extent->range));
        std::memcpy(whole->data() + (from - range.offset),
                    extent->bytes.data() + (from - extent->range.offset), until - from);
    }
    const std::span<const std::byte> bytes(*whole);
    return {std::move(whole), bytes};
}

HeldBytes UrlBytes::read(std::uint64_t offset, std::uint64_t size) const {
    if (size == 0) {
        return {};
    }
    const ByteRange range{offset, size};
    Lock lock(mutex_);
    while (true) {
        if (broken_ != nullptr) {
            throw_copy_of(*broken_);
        }
        const std::vector<ExtentPointer> extents = extents_for(lock, range);
        const bool all_there =
            std::all_of(extents.begin(), extents.end(), [&](const ExtentPointer& extent) {
                return wait_for(
                    lock, extent,
                    std::min(end_of(range), end_of(extent->range)) - extent->range.offset);
            });
        if (!all_there) {
            continue;
        }
        bool was_read_up = false;
        std::uint64_t covered = 0;
        for (const ExtentPointer& extent : extents) {
            const std::uint64_t from = std::max(offset, extent->range.offset);
            const std::uint64_t until = std::min(end_of(range), end_of(extent->range));
            const std::uint64_t read_now = std::min(extent->unread, until - from);
            extent->unread -= read_now;
            was_read_up = was_read_up || (read_now > 0 && extent->unread == 0);
            covered += until - from;
        }
        if (covered != size) {
            continue;  // an extent failed between the request and this check
        }
        lock.unlock();
        HeldBytes bytes = held(extents, range);
        if (was_read_up) {
            lock.lock();
            ask_for_hints();
        }
        return bytes;
    }
}

std::vector<UrlBytes::ExtentPointer> UrlBytes::extents_for(Lock& lock,
                                                           const ByteRange& range) const {
    const std::vector<ByteRange> absent = extents_.absent(range);
    if (absent.empty()) {
        return extents_.use(range);
    }
    // Holds the present extents, so that they are not dropped to make room for the rest.
    const std::vector<ExtentPointer> there = extents_.use(range);
    if (cache_ == nullptr) {
        ask(absent, {rounds_ + 1, generation_}, true);
        return extents_.use(range);
    }
    const std::vector<ExtentPointer> wanted = hold_places(absent, {rounds_ + 1, generation_}, true);
    lock.unlock();
    load_from_cache(wanted);
    lock.lock();
    return extents_.use(range);
}

bool UrlBytes::wait_for(Lock& lock, const ExtentPointer& extent, std::uint64_t until) const {
    const auto is_there = [&] {
        return extent->state != Extent::State::coming || extent->received >= until;
    };
    if (!is_there()) {
        if (!std::exchange(extent->is_urgent, true) && !extent->is_started) {
            urgent_.push_back(extent);
            loop_.wake();
        }
        load_prefetched(lock, extent);
        wait_until(lock, is_there);
        if (extent->state != Extent::State::failed && extent->state != Extent::State::replaced) {
            rounds_ = std::max(rounds_, extent->round);
        }
    }
    if (extent->state == Extent::State::failed) {
        throw_copy_of(*extent->failure);
    }
    return extent->state != Extent::State::replaced;
}

/// Loads this batch first: the batches before it may not help the thread that waits.
void UrlBytes::load_prefetched(Lock& lock, const ExtentPointer& extent) const {
    const auto batch = std::find_if(to_load_.begin(), to_load_.end(), [&](const auto& extents) {
        return std::find(extents.begin(), extents.end(), extent) != extents.end();
    });
    if (batch == to_load_.end()) {
        return;
    }
    const std::vector<ExtentPointer> wanted = std::move(*batch);
    to_load_.erase(batch);
    lock.unlock();
    load_from_cache(wanted);
    lock.lock();
}

void UrlBytes::load_next_batch() const {
    Lock lock(mutex_);
    if (to_load_.empty() || is_closing_) {
        return;
    }
    const std::vector<ExtentPointer> wanted = std::move(to_load_.front());
    to_load_.pop_front();
    lock.unlock();
    load_from_cache(wanted);
}

std::shared_ptr<FetchJob> UrlBytes::next_job() const {
    const Lock lock(mutex_);
    if (opening_ != nullptr) {
        return std::exchange(opening_, nullptr);
    }
    while (true) {
        std::deque<ExtentPointer>& queue = urgent_.empty() ? hinted_ : urgent_;
        if (queue.empty()) {
            return nullptr;
        }
        Extent& extent = *queue.front();
        std::shared_ptr<FetchJob> job;
        // An extent that somebody started to wait for is in both queues.
        if (!extent.is_started && broken_ == nullptr) {
            job = std::make_shared<ExtentJob>(*this, queue.front());
            extent.is_started = true;
        }
        queue.pop_front();
        if (job != nullptr) {
            return job;
        }
    }
}

FetchedCounts UrlBytes::fetched() const {
    const RequestCounts counts = loop_.counts();
    const Lock lock(mutex_);
    return {counts.bytes, counts.requests, rounds_, cache_bytes_};
}

// The requests of UrlBytes: prefetched ranges as far as they fit into the budget, and ranges that
// somebody waits for.

namespace {

constexpr std::size_t kMaxHints = 8;
constexpr JoinLimits kJoinLimits{};

/// The parts inside the object, sorted by offset, without overlap; ranges that only touch stay
/// separate.
std::vector<ByteRange> tidied(std::span<const ByteRange> ranges, std::uint64_t size) {
    std::vector<ByteRange> sorted;
    for (const ByteRange& range : ranges) {
        if (range.offset < size && range.size > 0) {
            sorted.push_back({range.offset, std::min(range.size, size - range.offset)});
        }
    }
    std::sort(sorted.begin(), sorted.end(),
              [](const ByteRange& a, const ByteRange& b) { return a.offset < b.offset; });
    std::vector<ByteRange> out;
    for (const ByteRange& range : sorted) {
        if (!out.empty() && range.offset < end_of(out.back())) {
            out.back().size = std::max(end_of(out.back()), end_of(range)) - out.back().offset;
        } else {
            out.push_back(range);
        }
    }
    return out;
}

}  // namespace

void UrlBytes::want(std::span<const ByteRange> ranges) const {
    Hint hint;
    hint.ranges = tidied(ranges, state_.size);
    const Lock lock(mutex_);
    if (broken_ != nullptr || hint.ranges.empty()) {
        return;
    }
    hint.place = {rounds_ + 1, ++generation_};
    hints_.push_back(std::move(hint));
    if (hints_.size() > kMaxHints) {
        hints_.pop_front();
    }
    ask_for_hints();
}

void UrlBytes::ask_for_hints() const {
    while (!hints_.empty() && !is_closing_) {
        Hint& hint = hints_.front();
        std::vector<ByteRange> batch;
        std::uint64_t bytes = 0;
        bool fits = true;
        for (; hint.next < hint.ranges.size() && fits; ++hint.next) {
            const ByteRange& range = hint.ranges[hint.next];
            const std::vector<ByteRange> absent = extents_.absent(range);
            // Includes the maximum waste of joined requests.
            const std::uint64_t more = bytes + range.size + range.size / 4;
            if (absent.empty() || range.size > options_.budget_bytes / 2) {
                continue;
            }
            if (!extents_.make_room_for_hint(more, hint.place.generation)) {
                fits = false;
                break;
            }
            bytes = more;
            batch.insert(batch.end(), absent.begin(), absent.end());
        }
        if (!batch.empty() && cache_ != nullptr) {
            to_load_.push_back(hold_places(batch, hint.place, false));
            loading_->add(0, [this] { load_next_batch(); });
        } else if (!batch.empty()) {
            ask(batch, hint.place, false);
        }
        if (!fits) {
            return;
        }
        hints_.pop_front();
    }
}

void UrlBytes::ask(const std::vector<ByteRange>& absent, const Place& place, bool is_urgent) const {
    const auto is_absent = [this](const ByteRange& gap) {
        const std::vector<ByteRange> parts = extents_.absent(gap);
        return parts.size() == 1 && parts[0].size == gap.size;
    };
    for (const JoinedRange& joined : join_ranges(absent, kJoinLimits, is_absent)) {
        extents_.make_room(joined.range.size);
        ExtentPointer extent = extents_.insert(joined.range);
        extent->unread = joined.wanted;
        extent->round = place.round;
        extent->generation = place.generation;
        extent->is_urgent = is_urgent;
        (is_urgent ? urgent_ : hinted_).push_back(std::move(extent));
    }
    loop_.wake();
}

std::vector<UrlBytes::ExtentPointer> UrlBytes::hold_places(const std::vector<ByteRange>& absent,
                                                           const Place& place,
                                                           bool is_urgent) const {
    std::vector<ExtentPointer> out;
    for (const ByteRange& range : absent) {
        extents_.make_room(range.size);
        out.push_back(extents_.insert(range));
        out.back()->unread = range.size;
        out.back()->round = place.round;
        out.back()->generation = place.generation;
        out.back()->is_urgent = is_urgent;
        out.back()->is_started = true;
    }
    return out;
}

/// Whatever fails here, no place remains that somebody waits for and nobody fills.
void UrlBytes::load_from_cache(const std::vector<ExtentPointer>& wanted) const {
    for (const ExtentPointer& extent : wanted) {
        std::optional<std::vector<std::byte>> bytes;
        try {
            Lock lock(mutex_);
            const bool may_be_wrong = is_distrusted(extent->range);
            lock.unlock();
            if (!may_be_wrong) {
                bytes = cache_->load(extent->range);
            }
        } catch (const std::exception&) {
            bytes.reset();  // as if the cache had none
        }
        if (!bytes || bytes->size() != extent->range.size) {
            continue;
        }
        cache_bytes_ += bytes->size();
        const Lock lock(mutex_);
        extent->bytes = std::move(*bytes);
        extent->received = extent->range.size;
        extent->round = 0;
        extent->state = Extent::State::present;
        changed_.notify_all();
    }
    const Lock lock(mutex_);
    Place place;
    bool is_urgent = false;
    std::size_t missing = 0;
    for (const ExtentPointer& extent : wanted) {
        if (extent->state == Extent::State::coming) {
            place = {extent->round, extent->generation};
            is_urgent = is_urgent || extent->is_urgent;
            ++missing;
            extent->state = Extent::State::replaced;
            extents_.erase(*extent);
            extent->count_no_more();  // before making room for what replaces it
        }
    }
    if (missing == 0) {
        return;
    }
    changed_.notify_all();
    std::vector<ByteRange> absent;
    absent.reserve(missing);
    for (const ExtentPointer& extent : wanted) {
        if (extent->state == Extent::State::replaced) {
            absent.push_back(extent->range);
        }
    }
    ask(absent, place, is_urgent);
}

}  // namespace isonest::detail
