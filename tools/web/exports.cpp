// The functions of isonest.wasm, and the function of the calling worker that it needs. Sizes and
// offsets are JavaScript numbers, exact up to 2^53.
#include <emscripten.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <iterator>
#include <list>
#include <memory>
#include <new>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include <isonest/error.h>

#include "tools/web/page_queries.h"
#include "tools/web/web_bytes.h"

// The worker's function `fetchNow(offset, size)` returns a Uint8Array of `size` bytes, or a text
// that says what went wrong. Returned here: malloc'ed bytes or, with *is_text = 1, zero-terminated
// text.
// clang-format off
EM_JS(char*, isonest_fetch_now, (double offset, double size, int* is_text), {
    const got = Module["fetchNow"](offset, size);
    const failed = typeof got == "string";
    const bytes = failed ? new TextEncoder().encode(got) : got;
    const at = _malloc(bytes.length + 1);
    if (!at) return 0;
    HEAPU8.set(bytes, at);
    HEAPU8[at + bytes.length] = 0;
    HEAP32[is_text >> 2] = failed ? 1 : 0;
    return at;
});
// clang-format on

namespace isonest::detail::web {
namespace {

/// Sixteenths of the memory for fetched bytes, see MemoryShares: of the current store, and of all
/// others together.
constexpr std::uint64_t kFetched = 3;
constexpr std::uint64_t kFetchedOfOthers = 1;
/// Steps of a series that stay open besides the current one.
constexpr std::size_t kMaxOthers = 8;

struct State {
    PageQueries* queries = nullptr;                  ///< of the current store
    std::list<std::unique_ptr<PageQueries>> opened;  ///< most recently used first
    view::HttpAnswer answer;
    std::vector<double> needed;  ///< offset, size, offset, ...
    double run_began = 0;
    WebTimes times;
};

State& state() {
    static State all;
    return all;
}

std::vector<std::byte> fetch_now(const ByteRange& range) {
    int is_text = 0;
    const std::unique_ptr<char, decltype(&std::free)> got(
        ::isonest_fetch_now(static_cast<double>(range.offset), static_cast<double>(range.size),
                            &is_text),
        &std::free);
    if (!got) {
        throw std::bad_alloc();
    }
    if (is_text != 0) {
        throw Error(ErrorKind::io, got.get());
    }
    const auto* const bytes = reinterpret_cast<const std::byte*>(got.get());
    return {bytes, bytes + static_cast<std::size_t>(range.size)};
}

/// Closes the stores that were not used for the longest time. REQUIRES: the current one is first.
void close_others(std::uint64_t max_bytes) {
    State& s = state();
    std::uint64_t bytes = 0;
    std::size_t count = 0;
    for (auto one = std::next(s.opened.begin()); one != s.opened.end();) {
        bytes += (*one)->bytes().held();
        const bool stays = (*one)->is_open() && ++count <= kMaxOthers && bytes <= max_bytes;
        one = stays ? std::next(one) : s.opened.erase(one);
    }
}

enum Outcome : int { kAnswered = 0, kNeedsBytes = 1 };

int outcome_of(Answered answered) {
    State& s = state();
    s.needed.clear();
    if (answered) {
        s.answer = std::move(*answered);
        return kAnswered;
    }
    for (const ByteRange& range : s.queries->bytes().needed()) {
        s.needed.push_back(static_cast<double>(range.offset));
        s.needed.push_back(static_cast<double>(range.size));
    }
    s.queries->bytes().count_round_trip();
    return kNeedsBytes;
}

void begin_run(bool may_unwind) {
    State& s = state();
    s.answer = {};
    s.queries->clear_arrays();
    s.run_began = ::emscripten_get_now();
    s.times.of_run = [] { return ::emscripten_get_now() - state().run_began; };
    s.queries->begin_run(may_unwind, s.times);
}

}  // namespace
}  // namespace isonest::detail::web

using namespace isonest::detail::web;

extern "C" {

/// Makes the store at this URL (without query) the current one, to which all other functions apply.
/// Returns 1 if it is open already; 0: isonest_open() comes next. `size`: of the object in bytes;
/// `memory`: the memory budget of the page, the same for all stores.
EMSCRIPTEN_KEEPALIVE int isonest_begin(const char* url, double size, double memory) {
    State& s = state();
    const auto most = static_cast<std::uint64_t>(memory);
    const auto found = std::find_if(s.opened.begin(), s.opened.end(), [&](const auto& one) {
        return one->is_open() && one->bytes().name() == url;
    });
    if (found != s.opened.end()) {
        s.opened.splice(s.opened.begin(), s.opened, found);
    } else {
        auto bytes = std::make_shared<WebBytes>(url, static_cast<std::uint64_t>(size),
                                                most / 16 * kFetched, fetch_now);
        s.opened.push_front(std::make_unique<PageQueries>(std::move(bytes), url, most));
    }
    s.queries = s.opened.front().get();
    close_others(most / 16 * kFetchedOfOthers);
    return found != s.opened.end() ? 1 : 0;
}

/// Milliseconds from a small request to its answer.
EMSCRIPTEN_KEEPALIVE void isonest_round_trip(double milliseconds) {
    state().times.round_trip = milliseconds;
}

/// Provides bytes of the object from `offset`, which is at the start of a block of
/// WebBytes::kBlock.
EMSCRIPTEN_KEEPALIVE void isonest_put(double offset, const char* bytes, std::size_t size) {
    state().queries->bytes().put(static_cast<std::uint64_t>(offset),
                                 {reinterpret_cast<const std::byte*>(bytes), size});
}

/// Returns 0 if answered; 1 if bytes are needed, and then this must be called again. `may_unwind`:
/// 0 if it must run to its end.
EMSCRIPTEN_KEEPALIVE int isonest_open(int may_unwind) {
    begin_run(may_unwind != 0);
    return outcome_of(state().queries->open());
}

/// The same for a request: "/api/surface?iso=1".
EMSCRIPTEN_KEEPALIVE int isonest_ask(const char* target, int may_unwind) {
    begin_run(may_unwind != 0);
    return outcome_of(state().queries->ask(target));
}

EMSCRIPTEN_KEEPALIVE std::size_t isonest_needed_count() {
    return state().needed.size();
}
EMSCRIPTEN_KEEPALIVE const double* isonest_needed() {
    return state().needed.data();
}

EMSCRIPTEN_KEEPALIVE unsigned isonest_answer_status() {
    return state().answer.status;
}
EMSCRIPTEN_KEEPALIVE const char* isonest_answer_type() {
    return state().answer.type.c_str();
}
EMSCRIPTEN_KEEPALIVE const char* isonest_answer_body() {
    const auto* const text = std::get_if<std::string>(&state().answer.body);
    return text != nullptr ? text->data() : nullptr;
}
EMSCRIPTEN_KEEPALIVE std::size_t isonest_answer_size() {
    return state().answer.heap();
}
// The arrays of an answer to "/arrays/...": positions, normals, values, indices.
EMSCRIPTEN_KEEPALIVE int isonest_array_count() {
    return NumberArrays::kCount;
}
EMSCRIPTEN_KEEPALIVE const void* isonest_array(int which) {
    return state().queries->arrays().bytes(which).data();
}
EMSCRIPTEN_KEEPALIVE std::size_t isonest_array_bytes(int which) {
    return state().queries->arrays().bytes(which).size();
}
/// The body and the arrays are no longer used.
EMSCRIPTEN_KEEPALIVE void isonest_answer_done() {
    state().answer = {};
    state().queries->clear_arrays();
}

}  // extern "C"
