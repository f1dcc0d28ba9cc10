// Parts of reading remote objects, without a network: URLs and signatures, the meaning of answers,
// retries, which requests fetch a set of ranges, and what is kept in memory.
#include <algorithm>
#include <catch2/catch.hpp>
#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include <isonest/error.h>

#include "store/remote/answer.h"
#include "store/remote/fetch_loop.h"
#include "store/remote/object_url.h"
#include "store/remote/ranges.h"

using namespace isonest;
using namespace isonest::detail;
using namespace std::chrono_literals;

namespace {

std::map<std::string, std::string>& test_environment() {
    static std::map<std::string, std::string> variables;
    return variables;
}

ObjectUrl parsed_url(const std::string& text, std::map<std::string, std::string> environment = {}) {
    test_environment() = std::move(environment);
    return parse_object_url(text, [](const char* name) -> const char* {
        const auto found = test_environment().find(name);
        return found == test_environment().end() ? nullptr : found->second.c_str();
    });
}

AnswerHead head_of(const std::vector<std::string>& lines) {
    AnswerHead head;
    for (const std::string& line : lines) {
        head.add_line(line + "\r\n");
    }
    return head;
}

Verdict verdict_of(const std::vector<std::string>& lines, const Asked& asked,
                   const Validators* opened) {
    return judge(head_of(lines), asked, opened).verdict;
}

std::vector<ByteRange> ranges_of(const std::vector<JoinedRange>& joined) {
    std::vector<ByteRange> out;
    for (const JoinedRange& one : joined) {
        out.push_back(one.range);
    }
    return out;
}

bool are_same(const std::vector<ByteRange>& a, const std::vector<ByteRange>& b) {
    return a.size() == b.size() &&
           std::equal(a.begin(), a.end(), b.begin(), [](const ByteRange& x, const ByteRange& y) {
               return x.offset == y.offset && x.size == y.size;
           });
}

}  // namespace

TEST_CASE("a URL's name has no userinfo, query or fragment; its request has the query") {
    const ObjectUrl url = parsed_url("HTTPS://me%40x:p%3aw@Host.org:8443/a b/ü.isonest?sig=1#part");
    CHECK(url.name == "https://Host.org:8443/a b/ü.isonest");
    CHECK(url.request == "https://Host.org:8443/a%20b/%C3%BC.isonest?sig=1");
    CHECK(url.user == "me@x");
    CHECK(url.password == "p:w");
    CHECK_FALSE(url.keys);
    CHECK(parsed_url("http://h").request == "http://h/");
    CHECK(parsed_url("http://h/%41%2f?x").request == "http://h/%41%2f?x");
    CHECK(parsed_url("http://a@b@h/x").name == "http://h/x");
    CHECK(parsed_url("http://h?a/b@c").name == "http://h/");
    CHECK(parsed_url("http://[::1]:80/x").name == "http://[::1]:80/x");
    CHECK(parsed_url("http://[::1]:80/x@y").name == "http://[::1]:80/x@y");
    CHECK(parsed_url("http://h/x@y").name == "http://h/x@y");
    CHECK(parsed_url("http://h:80/x%40y").request == "http://h:80/x%40y");
    CHECK(parsed_url("http://u:12%2Fx@h:80/x@y").password == "12/x");
    CHECK(parsed_url("http://[::1]/x").name == "http://[::1]/x");
    CHECK_FALSE(is_url("/data/http://x"));
    CHECK_FALSE(is_url("ftp://x/y"));
    CHECK_FALSE(is_url("https://"));
    for (const char* const wrong :
         {"http://user:12/s3cret@host", "https://user:12?s3cret@host/x",
          "http://user:12#s3cret@host", "http://host:80/a@s3cret/x", "http://user:s3cret@/x",
          "http://user:s3cret/a@h/x", "http://user:12s3cret?a@h/x", "http://h:/x", "http://:80/x",
          "http://a\nb/", "x", "http://h\"h/", "s3://b", "s3://bucket", "s3://bucket/", "s3:///key",
          "s3://b ucket/key"}) {
        INFO(wrong);
        try {
            parsed_url(wrong);
            FAIL("accepted");
        } catch (const Error& error) {
            CHECK(error.kind() == ErrorKind::invalid_argument);
            CHECK(std::string(error.what()).find("s3cret") == std::string::npos);
        }
    }
}

TEST_CASE("an s3 URL refers to Amazon or the endpoint, with the keys of the environment") {
    CHECK(parsed_url("s3://bucket/a b?c").request == "https://bucket.s3.amazonaws.com/a%20b%3Fc");
    CHECK(parsed_url("s3://bucket/a", {{"AWS_DEFAULT_REGION", "eu-1"}}).request ==
          "https://bucket.s3.eu-1.amazonaws.com/a");
    CHECK(parsed_url("s3://my.bucket/a", {{"AWS_REGION", "eu-2"}, {"AWS_DEFAULT_REGION", "eu-1"}})
              .request == "https://s3.eu-2.amazonaws.com/my.bucket/a");
    CHECK(parsed_url("s3://bucket//a/../b", {{"AWS_ENDPOINT_URL", "http://localhost:9000/"}})
              .request == "http://localhost:9000/bucket//a/../b");
    CHECK_FALSE(parsed_url("s3://bucket/a").keys);
    const ObjectUrl url = parsed_url("s3://bucket/a", {{"AWS_ACCESS_KEY_ID", "id"},
                                                       {"AWS_SECRET_ACCESS_KEY", "secret"},
                                                       {"AWS_SESSION_TOKEN", ""}});
    REQUIRE(url.keys);
    CHECK(url.keys->region == "us-east-1");
    CHECK(url.keys->session.empty());
    CHECK_THROWS_AS(parsed_url("s3://bucket/a", {{"AWS_ACCESS_KEY_ID", "id"}}), Error);
    CHECK_THROWS_AS(parsed_url("s3://bucket/a", {{"AWS_ENDPOINT_URL", "localhost"}}), Error);
}

TEST_CASE("a query distinguishes objects, but a signature in it does not") {
    CHECK(query_without_signature("http://h/x").empty());
    CHECK(query_without_signature("http://h/x?").empty());
    CHECK(query_without_signature("http://h/x?file=a&&n=1#b?c") == "file=a&n=1");
    CHECK(query_without_signature("http://h/x?X-Amz-Date=1&x-amz-signature=2&file=a") == "file=a");
    CHECK(query_without_signature("http://h/x?sv=1&se=2&sp=r&sig=3").empty());
    CHECK(query_without_signature("http://h/x?Expires=1&Signature=2&Key-Pair-Id=3&v") == "v");
}

TEST_CASE("servers are equal if scheme, host and port are") {
    CHECK(origin_of("https://Host/a") == origin_of("https://host:443/b?c"));
    CHECK(origin_of("http://h/a") == "http://h:80");
    CHECK(origin_of("https://h") != origin_of("http://h:443"));
    CHECK(origin_of("http://u:p@h:1/x") == "http://h:1");
    CHECK(origin_of("http://[::1]/x") == "http://[::1]:80");
    CHECK(origin_of("http://[::1]:8/x") == "http://[::1]:8");
    CHECK(origin_of("http://h.evil/x") != origin_of("http://h/x"));
}

TEST_CASE("an invalid Content-Range is rejected") {
    const auto content = parse_content_range("bytes 10-19/100");
    REQUIRE(content);
    REQUIRE(content->range);
    CHECK(content->range->offset == 10);
    CHECK(content->range->size == 10);
    CHECK(content->size == std::uint64_t{100});
    CHECK_FALSE(parse_content_range("bytes */7")->range);
    CHECK_FALSE(parse_content_range("Bytes 0-0/*")->size);
    for (const char* const wrong :
         {"", "bytes", "bytes 1-2", "bytes 2-1/5", "bytes 0-5/5", "items 0-1/5", "bytes -5/9",
          "bytes 0-/9", "bytes 0-1/", "bytes 0-1/x", "bytes a-b/9", "bytes 0-1/+9",
          "bytes 0-18446744073709551615/*", "bytes 0-99999999999999999999/*", "bytes 0--1/9"}) {
        INFO(wrong);
        CHECK_FALSE(parse_content_range(wrong));
    }
}

TEST_CASE("an answer is either what was requested, or the error says why not") {
    const Asked asked{{10, 10}, 0};
    const Validators opened{"\"a\"", "yesterday", 100};
    const std::string ok = "HTTP/1.1 206 Partial Content";
    const std::string etag = "etag: \"a\"";
    CHECK(verdict_of({ok, etag, "Content-Range: bytes 10-19/100"}, asked, &opened) ==
          Verdict::part);
    CHECK(verdict_of({ok, etag, "content-range: bytes 10-15/*"}, asked, &opened) == Verdict::part);
    // Only the last header block counts.
    CHECK(verdict_of({"HTTP/1.1 103 Early Hints", "Content-Range: x", ok, etag,
                      "Content-Range: bytes 10-19/100"},
                     asked, &opened) == Verdict::part);
    CHECK(verdict_of({ok, "ETag: \"b\"", "Content-Range: bytes 10-19/100"}, asked, &opened) ==
          Verdict::changed);
    CHECK(verdict_of({ok, "ETag: W/\"a\"", "Content-Range: bytes 10-19/100"}, asked, &opened) ==
          Verdict::changed);
    CHECK(verdict_of({ok, etag, "Content-Range: bytes 10-19/101"}, asked, &opened) ==
          Verdict::changed);
    CHECK(verdict_of({"HTTP/2 200", etag, "Content-Length: 99"}, asked, &opened) ==
          Verdict::changed);
    CHECK(verdict_of({"HTTP/2 412"}, asked, &opened) == Verdict::changed);
    CHECK(verdict_of({"HTTP/2 416", "Content-Range: bytes */5"}, asked, &opened) ==
          Verdict::changed);
    CHECK(verdict_of({"HTTP/2 302", "Location: /x"}, asked, &opened) == Verdict::redirect);
    for (const std::vector<std::string>& lines : std::vector<std::vector<std::string>>{
             {ok, "Content-Range: bytes 10-19/100"},
             {ok, etag},
             {ok, etag, "Content-Range: bytes 9-19/100"},
             {ok, etag, "Content-Range: bytes 10-20/100"},
             {ok, etag, "Content-Range: bytes 11-19/100"},
             {ok, etag, "Content-Range: bytes 10-19/100", "Content-Length: 9"},
             {ok, etag, "Content-Range: bytes 10-19/100", "Content-Encoding: br"},
             {ok, etag, "Content-Range: bytes 10-19/100", "Content-Length: 10",
              "transfer-encoding: chunked"},
             {"HTTP/1.0 200 OK", etag, "Content-Length: 100"}}) {
        const Judgement judgement = judge(head_of(lines), asked, &opened);
        CHECK(judgement.verdict == Verdict::failed);
        CHECK(judgement.failure == FailureClass::odd);
        CHECK_FALSE(judgement.problem.empty());
    }
    for (const int status : {408, 429, 500, 502, 503, 504}) {
        CHECK(judge(head_of({"HTTP/1.1 " + std::to_string(status)}), asked, &opened).failure ==
              FailureClass::busy);
    }
    for (const int status : {0, 204, 302, 304, 400, 401, 403, 404, 410, 501, 999}) {
        const Judgement judgement =
            judge(head_of({"HTTP/1.1 " + std::to_string(status)}), asked, &opened);
        CHECK(judgement.verdict == Verdict::failed);
        CHECK(judgement.failure == FailureClass::final);
    }
    // At opening, the end of the object is requested.
    const Asked end{{}, 20};
    CHECK(verdict_of({ok, "Content-Range: bytes 80-99/100"}, end, nullptr) == Verdict::part);
    CHECK(verdict_of({ok, "Content-Range: bytes 0-9/10"}, end, nullptr) == Verdict::part);
    CHECK(verdict_of({ok, "Content-Range: bytes 70-99/100"}, end, nullptr) == Verdict::failed);
    CHECK(verdict_of({ok, "Content-Range: bytes 80-98/100"}, end, nullptr) == Verdict::failed);
    CHECK(verdict_of({ok, "Content-Range: bytes 80-99/*"}, end, nullptr) == Verdict::failed);
    CHECK(verdict_of({"HTTP/2 200", "Content-Length: 9"}, end, nullptr) == Verdict::whole);
    CHECK(verdict_of({"HTTP/2 416", "Content-Range: bytes */0"}, end, nullptr) ==
          Verdict::no_such_range);
    CHECK(verdict_of({"HTTP/2 416"}, end, nullptr) == Verdict::failed);
    CHECK(verdict_of({"HTTP/2 416", "Content-Range: bytes */*"}, end, nullptr) == Verdict::failed);
}

TEST_CASE("waits between retries grow, with jitter, and end") {
    const RetryPolicy policy{5, 2, 100ms, 300ms, 10s};
    const RetryState::Clock::time_point start{};
    for (std::uint32_t seed = 1; seed < 50; ++seed) {
        RetryState state(seed);
        for (const auto longest : {100ms, 200ms, 300ms, 300ms}) {
            const auto wait = state.wait_after(FailureClass::busy, std::nullopt, start, policy);
            REQUIRE(wait);
            CHECK(*wait >= longest / 2);
            CHECK(*wait <= longest);
        }
        CHECK_FALSE(state.wait_after(FailureClass::busy, std::nullopt, start, policy));
        state.got_on();
        CHECK(state.wait_after(FailureClass::busy, std::nullopt, start, policy));
        CHECK_FALSE(state.wait_after(FailureClass::busy, std::nullopt, start + 10s, policy));
    }
    CHECK_FALSE(RetryState(1).wait_after(FailureClass::final, std::nullopt, start, policy));
    CHECK(RetryState(1).wait_after(FailureClass::busy, 7s, start, policy) == 7000ms);
    CHECK_FALSE(RetryState(1).wait_after(FailureClass::busy, 11s, start, policy));
    for (const FailureClass failure : {FailureClass::odd, FailureClass::unreachable}) {
        RetryState state(1);
        CHECK(state.wait_after(failure, std::nullopt, start, policy));
        CHECK_FALSE(state.wait_after(failure, std::nullopt, start, policy));
    }
}

TEST_CASE("ranges are joined across the smallest gaps, up to the maximum waste") {
    const auto always = [](const ByteRange&) { return true; };
    const JoinLimits limits{100, 1000, 5};
    CHECK(are_same(ranges_of(join_ranges({{0, 40}, {40, 40}, {90, 40}}, limits, always)),
                   {{0, 130}}));
    // 30 of 150 are a fifth, 31 of 151 are more.
    CHECK(are_same(ranges_of(join_ranges({{0, 60}, {90, 60}}, limits, always)), {{0, 150}}));
    CHECK(
        are_same(ranges_of(join_ranges({{0, 60}, {91, 60}}, limits, always)), {{0, 60}, {91, 60}}));
    CHECK(are_same(ranges_of(join_ranges({{0, 900}, {1001, 900}}, limits, always)),
                   {{0, 900}, {1001, 900}}));
    CHECK(are_same(ranges_of(join_ranges({{0, 90}, {100, 90}}, limits,
                                         [](const ByteRange&) { return false; })),
                   {{0, 90}, {100, 90}}));
    CHECK(are_same(ranges_of(join_ranges({{7, 2001}}, limits, always)),
                   {{7, 667}, {674, 667}, {1341, 667}}));

    std::mt19937 random(1);
    for (int turn = 0; turn < 2000; ++turn) {
        std::vector<ByteRange> ranges;
        std::uint64_t at = 0;
        std::uint64_t wanted = 0;
        for (int i = random() % 30; i >= 0; --i) {
            at += random() % 3 == 0 ? 0 : random() % 150;
            ranges.push_back({at, 1 + random() % (random() % 20 == 0 ? 3000 : 200)});
            at += ranges.back().size;
            wanted += ranges.back().size;
        }
        const std::vector<JoinedRange> joined = join_ranges(ranges, limits, always);
        std::uint64_t fetched = 0;
        std::uint64_t said = 0;
        std::vector<bool> has(at, false);
        for (std::size_t i = 0; i < joined.size(); ++i) {
            const ByteRange& range = joined[i].range;
            CHECK(range.size <= limits.largest);
            CHECK(
                (i == 0 || joined[i - 1].range.offset + joined[i - 1].range.size <= range.offset));
            fetched += range.size;
            said += joined[i].wanted;
            std::fill_n(has.begin() + static_cast<std::ptrdiff_t>(range.offset), range.size, true);
        }
        CHECK(said == wanted);
        CHECK((fetched - wanted) * 5 <= fetched);
        CHECK(joined.size() <= ranges.size() + wanted / limits.largest * 2);
        for (const ByteRange& range : ranges) {
            const auto first = has.begin() + static_cast<std::ptrdiff_t>(range.offset);
            CHECK(std::find(first, first + static_cast<std::ptrdiff_t>(range.size), false) ==
                  first + static_cast<std::ptrdiff_t>(range.size));
        }
    }
}

TEST_CASE("background work is done in order, up to the limit of the queue") {
    std::mutex mutex;
    std::vector<int> done;
    std::condition_variable changed;
    bool may_go = false;
    {
        Background background(100, "x");
        const auto add = [&](int number, std::uint64_t bytes) {
            return background.add(bytes, [&, number] {
                std::unique_lock lock(mutex);
                changed.wait(lock, [&] { return may_go; });
                done.push_back(number);
                if (number == 2) {
                    throw Error(ErrorKind::io, "lost");
                }
            });
        };
        CHECK(add(1, 1000));  // more than the limit, but nothing else is queued
        CHECK_FALSE(add(9, 1));
        {
            const std::lock_guard lock(mutex);
            may_go = true;
        }
        changed.notify_all();
        while (!add(2, 60)) {
            std::this_thread::yield();
        }
        background.finish(1h);
        CHECK(done == std::vector<int>{1, 2});
        CHECK_FALSE(add(3, 1));
    }
    may_go = false;
    bool has_begun = false;
    std::thread release;
    {
        Background background(100, "x");
        CHECK(background.add(1, [&] {
            std::unique_lock lock(mutex);
            has_begun = true;
            changed.notify_all();
            changed.wait(lock, [&] { return may_go; });
            done.push_back(4);
        }));
        CHECK(background.add(1, [&] { done.push_back(5); }));
        std::unique_lock lock(mutex);
        changed.wait(lock, [&] { return has_begun; });
        release = std::thread([&] {
            std::this_thread::sleep_for(50ms);
            const std::lock_guard releasing(mutex);
            may_go = true;
            changed.notify_all();
        });
    }
    release.join();
    // The running work was waited for; work that had not started was dropped.
    CHECK(done == std::vector<int>{1, 2, 4});
}

TEST_CASE(
    "extents know the missing ranges, and drop the least recently used ones that are not held") {
    Extents extents(100);
    CHECK(are_same(extents.absent({5, 10}), {{5, 10}}));
    const auto add = [&](std::uint64_t offset, std::uint64_t size) {
        auto extent = extents.insert({offset, size});
        extent->state = Extent::State::present;
        return extent;
    };
    std::shared_ptr<Extent> held = add(10, 30);
    add(50, 20);
    add(70, 30);
    CHECK(are_same(extents.absent({0, 120}), {{0, 10}, {40, 10}, {100, 20}}));
    CHECK(extents.absent({15, 10}).empty());
    CHECK(are_same(extents.absent({35, 20}), {{40, 10}}));
    CHECK(extents.use({55, 20}).size() == 2);
    CHECK(extents.use({40, 10}).empty());
    CHECK(extents.alive() == 80);

    CHECK(extents.use({50, 1}).size() == 1);  // so that the one at 70 is older
    CHECK(extents.make_room(40));
    CHECK(extents.alive() == 50);
    CHECK(are_same(extents.absent({0, 100}), {{0, 10}, {40, 10}, {70, 30}}));
    CHECK_FALSE(extents.make_room(80));  // extents that are held stay
    CHECK(are_same(extents.absent({0, 100}), {{0, 10}, {40, 60}}));
    extents.erase(*held);
    CHECK(extents.alive() == 30);
    held.reset();
    CHECK(extents.alive() == 0);

    // An extent that has been read is dropped first, even if it was used last.
    add(0, 60)->unread = 1;
    add(70, 30);
    CHECK(extents.make_room(20));
    CHECK(are_same(extents.absent({0, 100}), {{60, 40}}));
    // For a mere prefetch, no unread extent is dropped that was prefetched with it or before.
    CHECK_FALSE(extents.make_room_for_hint(50, 0));
    CHECK_FALSE(extents.make_room_for_hint(50, 1));
    CHECK(extents.make_room_for_hint(50, 2));
    const std::shared_ptr<Extent> replaced = extents.insert({100, 40});
    extents.erase(*replaced);
    replaced->count_no_more();
    CHECK(extents.alive() == 0);
    extents.insert({200, 90});  // still being fetched
    CHECK_FALSE(extents.make_room(20));
}
