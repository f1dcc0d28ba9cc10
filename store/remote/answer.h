// Answers of servers, and repetition of failed requests.
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <random>
#include <string>
#include <string_view>

#include "store/bytes/store_bytes.h"
#include "store/remote/object_url.h"

namespace isonest::detail {

// The head of a server's answer, and what it means for a range.
//
// Source: RFC 9110, sections 8.4, 8.8, 13, 14 and 15; RFC 9112, section 6.3.

/// "bytes 10-19/1000": [10, 20) of 1000.
struct ContentRange {
    std::optional<ByteRange> range;     ///< nullopt: "*"
    std::optional<std::uint64_t> size;  ///< of the object; nullopt: "*"
};

/// Nullopt if the text has another form or contradicts itself.
std::optional<ContentRange> parse_content_range(std::string_view value);

/// The head of an answer; add_line() takes its lines in order, starting with the status line.
struct AnswerHead {
    int status = 0;
    std::string etag;  ///< as sent; of a weak one with its W/
    std::string last_modified;
    std::string encoding;  ///< Content-Encoding
    std::string location;
    std::string bucket_region;            ///< x-amz-bucket-region
    std::optional<std::uint64_t> length;  ///< Content-Length
    bool says_length = false;   ///< there was a Content-Length, even if it is not a number
    bool is_chunked = false;    ///< Transfer-Encoding
    std::string content_range;  ///< empty: none
    bool is_complete = false;   ///< its final empty line has arrived, and it is not an interim
                                ///< answer

    /// A status line starts a new head.
    void add_line(std::string_view line);
};

/// The state of the object when it was opened.
struct Validators {
    std::string etag;  ///< strong or weak; empty: none
    std::string last_modified;
    std::uint64_t size = 0;

    [[nodiscard]] bool is_strong() const { return !etag.empty() && etag[0] == '"'; }
};

enum class FailureClass : std::uint8_t {
    final,       ///< repeating does not help
    odd,         ///< a wrong answer to a valid request, for example by a proxy: repeated once
    busy,        ///< the server or the connection is likely to recover
    unreachable  ///< nobody answers: repeated a few times
};

enum class Verdict : std::uint8_t {
    /// 206 with bytes from the requested offset on, and not more than requested; or 200 if the
    /// whole object was requested.
    part,
    whole,          ///< 200: the whole object, although a part was requested
    redirect,       ///< to `location`
    no_such_range,  ///< 416
    changed,        ///< the object differs from the one that was opened
    failed
};

struct Judgement {
    Verdict verdict = Verdict::failed;
    ByteRange range;         ///< for part and whole
    std::uint64_t size = 0;  ///< of the object, for part, whole and no_such_range
    /// For part: the server does not say how much comes; `range` and `size` are maxima.
    bool is_open_ended = false;
    bool is_too_large = false;  ///< for failed: more than Asked::most
    std::string problem;        ///< for failed
    FailureClass failure = FailureClass::final;
};

/// The request: a range, or (when opening) the last `tail` bytes, or the whole object.
struct Asked {
    ByteRange range = {};
    std::uint64_t tail = 0;  ///< 0: range
    bool is_whole = false;   ///< no range; repeated requests start at the beginning
    std::uint64_t most = 0;  ///< for is_whole: maximum bytes of the object
};

/// `opened`: null while the object is being opened.
Judgement judge(const AnswerHead& head, const Asked& asked, const Validators* opened);

/// "404 Not Found", as in a status line.
std::string said_status(int status);

// Repetition of failed requests.
//
// Source of growing waits with jitter: M. Brooker, "Exponential Backoff And Jitter", AWS
// Architecture Blog (2015); here half of each wait is fixed.

/// The history of the requests for one range.
class RetryState {
  public:
    using Clock = std::chrono::steady_clock;

    explicit RetryState(std::uint32_t seed) : random_(seed) {}

    /// How long to wait before the next request; nullopt: give up. `retry_after`: from the server.
    std::optional<std::chrono::milliseconds> wait_after(
        FailureClass failure, std::optional<std::chrono::seconds> retry_after,
        Clock::time_point now, const RetryPolicy& policy);
    /// The last request made progress: earlier failures do not count any more, but their time does.
    void got_on() { failures_ = 0; }
    /// Failed requests since the last progress.
    [[nodiscard]] int failures() const { return failures_; }

  private:
    std::minstd_rand random_;
    int failures_ = 0;
    std::optional<Clock::time_point> first_failure_;
};

}  // namespace isonest::detail
