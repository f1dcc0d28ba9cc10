// Reads ranges of a URL and compares them with a local file, controlled by lines of JSON on
// standard input; answers each line with a line. Errors are answers, too.
//
//     {"do": "open", "url": URL, "file": PATH, ...}    the options: see options_of()
//     {"do": "want", "ranges": [[offset, size], ...]}
//     {"do": "read", "ranges": [[offset, size], ...], "threads": N}
//     {"do": "forget", "ranges": [[offset, size], ...]}
//     {"do": "random", "reads": N, "threads": N, "seed": N, "most": BYTES}   opens again after
//     errors
//     {"do": "cancel", "after_ms": N}                  for the following reads
//     {"do": "counts"}, {"do": "close"}
//
// usage: isonest_fetch_ranges
#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstring>
#include <iostream>
#include <map>
#include <memory>
#include <mutex>
#include <new>
#include <nlohmann/json.hpp>
#include <optional>
#include <random>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include <isonest/error.h>

#include "store/bytes/store_bytes.h"
#include "store/remote/open_location.h"
#include "tools/cli/terminal/remedies.h"

namespace {

using namespace isonest::detail;
using isonest::Error;
using isonest::ErrorKind;
using Json = nlohmann::json;
using Clock = std::chrono::steady_clock;

Json said(const Error& error) {
    return cli::json_of(error, [](const std::string& /*option*/) { return true; });
}

/// Cached ranges, as they were kept, for each known state of an object.
class MemoryCache : public RangeCache {
  public:
    /// Sets how long it takes to keep a range, and to load one.
    void be_slow(std::chrono::milliseconds keeping, std::chrono::milliseconds loading) {
        keeping_ = keeping;
        loading_ = loading;
    }
    std::optional<std::vector<std::byte>> load(ByteRange range) override {
        std::this_thread::sleep_for(loading_.load());
        const std::lock_guard lock(mutex_);
        if (!has_memory_) {
            throw std::bad_alloc();
        }
        for (const auto& [offset, bytes] : kept_) {
            if (offset <= range.offset && range.offset + range.size <= offset + bytes.size()) {
                const auto first =
                    bytes.begin() + static_cast<std::ptrdiff_t>(range.offset - offset);
                return std::vector(first, first + static_cast<std::ptrdiff_t>(range.size));
            }
        }
        return std::nullopt;
    }
    /// Without memory, it cannot load anything.
    void set_memory(bool has_memory) {
        const std::lock_guard lock(mutex_);
        has_memory_ = has_memory;
    }
    void keep(ByteRange range, std::span<const std::byte> bytes) override {
        std::this_thread::sleep_for(keeping_.load());
        const std::lock_guard lock(mutex_);
        kept_.emplace(range.offset, std::vector(bytes.begin(), bytes.end()));
    }
    void forget(ByteRange range) override {
        const std::lock_guard lock(mutex_);
        for (auto next = kept_.begin(); next != kept_.end();) {
            const std::uint64_t end = next->first + next->second.size();
            const bool touches = next->first < range.offset + range.size && range.offset < end;
            next = touches ? kept_.erase(next) : std::next(next);
        }
    }

  private:
    std::atomic<std::chrono::milliseconds> keeping_{};
    std::atomic<std::chrono::milliseconds> loading_{};
    std::mutex mutex_;
    bool has_memory_ = true;
    std::multimap<std::uint64_t, std::vector<std::byte>> kept_;
};

class Session {
  public:
    Json run(const Json& command) {
        const std::string what = command.at("do");
        try {
            if (what == "open") {
                opening_ = command;
                return open();
            }
            if (what == "cancel") {
                cancel_at_ = Clock::now().time_since_epoch().count() +
                             std::chrono::nanoseconds(
                                 std::chrono::milliseconds(command.at("after_ms").get<int>()))
                                 .count();
                return Json::object();
            }
            if (what == "want") {
                remote_->want(ranges_of(command));
                return counts();
            }
            if (what == "forget") {
                for (const ByteRange& range : ranges_of(command)) {
                    remote_->forget(range);
                }
                return counts();
            }
            if (what == "read") {
                return read(command);
            }
            if (what == "random") {
                return read_randomly(command);
            }
            if (what == "close") {
                remote_.reset();
                return Json::object();
            }
            return counts();
        } catch (const Error& error) {
            return {{"error", said(error)}};
        }
    }

  private:
    RemoteOptions options_of(const Json& command) {
        RemoteOptions options;
        const auto milliseconds = [&](const char* name, std::chrono::milliseconds& value) {
            value = std::chrono::milliseconds(command.value(name, value.count()));
        };
        options.headers = command.value("headers", options.headers);
        options.budget_bytes = command.value("budget", options.budget_bytes);
        options.parallel_requests = command.value("parallel", options.parallel_requests);
        options.retry.attempts = command.value("attempts", options.retry.attempts);
        milliseconds("first_wait_ms", options.retry.first_wait);
        milliseconds("total_ms", options.retry.total);
        milliseconds("connect_ms", options.connect_timeout);
        milliseconds("slow_ms", options.slow_time);
        options.slow_bytes = command.value("slow_bytes", options.slow_bytes);
        options.check = [this] {
            const Clock::rep at = cancel_at_;
            if (at != 0 && Clock::now().time_since_epoch().count() >= at) {
                throw Error(ErrorKind::cancelled, "interrupted");
            }
        };
        if (command.value("known", false)) {
            options.recall = [this](const ObjectState& object) -> std::optional<ObjectState> {
                const auto found = states_.find(object.url + " " + object.query);
                return found != states_.end() ? std::optional(found->second) : std::nullopt;
            };
            options.remember = [this](const ObjectState& object) {
                states_[object.url + " " + object.query] = object;
            };
        }
        if (command.value("cache", false)) {
            options.make_cache =
                [this, keeping = std::chrono::milliseconds(command.value("keep_ms", 0)),
                 loading = std::chrono::milliseconds(command.value("load_ms", 0)),
                 has_memory = command.value("cache_memory", true)](const ObjectState& state) {
                    std::shared_ptr<MemoryCache>& cache = caches_[state.url + " " + state.version];
                    if (cache == nullptr) {
                        cache = std::make_shared<MemoryCache>();
                    }
                    cache->be_slow(keeping, loading);
                    cache->set_memory(has_memory);
                    return cache;
                };
        }
        return options;
    }

    Json open() {
        remote_.reset();
        local_.emplace(opening_.at("file").get<std::string>());
        remote_ = open_url(opening_.at("url").get<std::string>(), options_of(opening_));
        Json answer = counts();
        answer["name"] = remote_->name();
        answer["size"] = remote_->size();
        return answer;
    }

    static std::vector<ByteRange> ranges_of(const Json& command) {
        std::vector<ByteRange> ranges;
        for (const Json& range : command.at("ranges")) {
            ranges.push_back({range.at(0), range.at(1)});
        }
        return ranges;
    }

    [[nodiscard]] bool is_right(const ByteRange& range) const {
        const HeldBytes ours = remote_->read(range.offset, range.size);
        const HeldBytes truth = local_->read(range.offset, range.size);
        return ours.bytes().size() == range.size &&
               (range.size == 0 ||
                std::memcmp(ours.bytes().data(), truth.bytes().data(), range.size) == 0);
    }

    [[nodiscard]] Json counts() const {
        const isonest::FetchedCounts counts = remote_->fetched();
        return {{"remote_bytes", counts.remote_bytes},
                {"requests", counts.requests},
                {"round_trips", counts.round_trips},
                {"cache_bytes", counts.cache_bytes}};
    }

    /// Reads all ranges, by several threads; reports each error once.
    Json read(const Json& command) {
        const std::vector<ByteRange> ranges = ranges_of(command);
        std::atomic<std::size_t> next{0};
        std::atomic<int> wrong{0};
        std::mutex mutex;
        Json errors = Json::array();
        const auto work = [&] {
            for (std::size_t i = next++; i < ranges.size(); i = next++) {
                try {
                    wrong += is_right(ranges[i]) ? 0 : 1;
                } catch (const Error& error) {
                    const std::lock_guard lock(mutex);
                    if (std::find(errors.begin(), errors.end(), said(error)) == errors.end()) {
                        errors.push_back(said(error));
                    }
                }
            }
        };
        std::vector<std::thread> threads;
        for (int i = 0; i < command.value("threads", 1); ++i) {
            threads.emplace_back(work);
        }
        for (std::thread& thread : threads) {
            thread.join();
        }
        Json answer = counts();
        answer["wrong"] = wrong.load();
        answer["errors"] = errors;
        return answer;
    }

    Json read_randomly(const Json& command) {
        const int reads = command.at("reads");
        const std::uint64_t most = command.at("most");
        std::mt19937_64 random(command.at("seed").get<std::uint64_t>());
        Json sum{{"read", 0}, {"wrong", 0}, {"failed", Json::object()}, {"longest", 0.0}};
        std::uint64_t requests = 0;
        const auto note_errors = [&](const Json& errors) {
            for (const Json& error : errors) {
                const std::string text = error.at("message");
                sum["failed"][text] = sum["failed"].value(text, 0) + 1;
            }
        };
        for (int done = 0; done < reads;) {
            const auto start = Clock::now();
            if (remote_ == nullptr) {
                try {
                    open();
                } catch (const Error& error) {
                    note_errors(Json::array({said(error)}));
                }
            }
            if (remote_ != nullptr) {
                Json ranges = Json::array();
                for (int i = 0; i < 24; ++i) {
                    const std::uint64_t offset = random() % local_->size();
                    const std::uint64_t size = random() % std::min(most, local_->size() - offset);
                    ranges.push_back({offset, size});
                }
                if (random() % 2 == 0) {
                    remote_->want(ranges_of({{"ranges", ranges}}));
                }
                const Json answer = read({{"ranges", ranges}, {"threads", command.at("threads")}});
                sum["read"] = sum["read"].get<int>() + 24;
                sum["wrong"] = sum["wrong"].get<int>() + answer.at("wrong").get<int>();
                note_errors(answer.at("errors"));
                if (!answer.at("errors").empty() || random() % 16 == 0) {
                    requests += answer.at("requests").get<std::uint64_t>();
                    remote_.reset();
                }
            }
            done += 24;
            const double seconds = std::chrono::duration<double>(Clock::now() - start).count();
            sum["longest"] = std::max(sum["longest"].get<double>(), seconds);
        }
        remote_.reset();
        sum["requests"] = requests;
        return sum;
    }

    Json opening_;
    std::map<std::string, std::shared_ptr<MemoryCache>> caches_;
    std::map<std::string, ObjectState> states_;
    std::atomic<Clock::rep> cancel_at_{0};
    std::optional<FileBytes> local_;
    std::unique_ptr<StoreBytes> remote_;
};

}  // namespace

int main() {
    Session session;
    for (std::string line; std::getline(std::cin, line);) {
        std::cout << session.run(Json::parse(line)).dump() << '\n' << std::flush;
    }
    return 0;
}
