// What a server answers before it sends bytes, and what that means for a range.
//
// Source: RFC 9110, sections 8.4, 8.8, 13, 14 and 15; RFC 9112, section 6.3.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "store/bytes/range_cache.h"
#include "store/bytes/store_bytes.h"

namespace isonest::detail {

/// "bytes 10-19/1000": [10, 20) of 1000.
struct ContentRange {
    std::optional<ByteRange> range;     ///< nothing: "*"
    std::optional<std::uint64_t> size;  ///< of the object; nothing: "*"
};

/// Nothing if it is not of that form, or contradicts itself.
std::optional<ContentRange> parse_content_range(std::string_view value);

/// The head of an answer; add_line() takes its lines from the status line on, as they come.
struct AnswerHead {
    int status = 0;
    std::string etag;  ///< as it was written; of a weak one, with its W/
    std::string last_modified;
    std::string encoding;  ///< Content-Encoding
    std::string location;
    std::string bucket_region;            ///< x-amz-bucket-region
    std::optional<std::uint64_t> length;  ///< Content-Length
    bool says_length = false;             ///< a Content-Length came, though it may be no number
    bool is_chunked = false;              ///< Transfer-Encoding
    std::string content_range;            ///< empty: none
    bool is_complete = false;             ///< the empty line behind it came, of no interim answer

    /// A status line begins the head anew.
    void add_line(std::string_view line);
};

/// How the object was when it was opened.
struct Validators {
    std::string etag;  ///< strong or weak; empty: none
    std::string last_modified;
    std::uint64_t size = 0;

    [[nodiscard]] bool is_strong() const { return !etag.empty() && etag[0] == '"'; }
};

enum class FailureClass : std::uint8_t {
    final,       ///< it would not get better
    odd,         ///< a wrong answer to a right question, as of a proxy: asked once more
    busy,        ///< the server, or the way to it, is likely to recover
    unreachable  ///< nobody answers: asked a few times more
};

enum class Verdict : std::uint8_t {
    /// 206 with bytes from where they were asked for, and not more; or, of what was asked for
    /// whole, 200.
    part,
    whole,          ///< 200: the whole object, where a part was asked for
    redirect,       ///< to `location`
    no_such_range,  ///< 416
    changed,        ///< the object is another one than that which was opened
    failed
};

struct Judgement {
    Verdict verdict = Verdict::failed;
    ByteRange range;         ///< of part and whole
    std::uint64_t size = 0;  ///< of the object, for part, whole and no_such_range
    /// Of part: the server does not say how much comes; `range` and `size` say what may come.
    bool is_open_ended = false;
    bool is_too_large = false;  ///< of failed: more than Asked::most
    std::string problem;        ///< of failed
    FailureClass failure = FailureClass::final;
};

/// What was asked for: a range, or (at opening) the last `tail` bytes, or the whole object.
struct Asked {
    ByteRange range = {};
    std::uint64_t tail = 0;  ///< 0: range
    bool is_whole = false;   ///< no range; whoever asks again begins anew
    std::uint64_t most = 0;  ///< of is_whole: bytes that it may have
};

/// `opened`: null if the object is just being opened.
Judgement judge(const AnswerHead& head, const Asked& asked, const Validators* opened);

/// "404 Not Found", as a server would say it.
std::string said_status(int status);

}  // namespace isonest::detail
