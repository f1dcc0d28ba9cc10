#include "store/remote/answer.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <utility>

namespace isonest::detail {
namespace {

std::string_view trimmed_value(std::string_view text) {
    const std::size_t first = text.find_first_not_of(" \t\r\n");
    if (first == std::string_view::npos) {
        return {};
    }
    return text.substr(first, text.find_last_not_of(" \t\r\n") + 1 - first);
}

bool is_same_name(std::string_view a, std::string_view b) {
    const auto lower = [](char c) { return c >= 'A' && c <= 'Z' ? c + 32 : +c; };
    return a.size() == b.size() && std::equal(a.begin(), a.end(), b.begin(),
                                              [&](char x, char y) { return lower(x) == lower(y); });
}

std::optional<std::uint64_t> whole_number(std::string_view text) {
    std::uint64_t number = 0;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
    if (text.empty() || error != std::errc{} || end != text.data() + text.size()) {
        return std::nullopt;
    }
    return number;
}

/// Whether an answer is about the object that was opened; nullopt if it does not say.
std::optional<bool> is_same_object(const AnswerHead& head, const Validators& opened) {
    if (!opened.etag.empty()) {
        return head.etag.empty() ? std::nullopt : std::optional(head.etag == opened.etag);
    }
    if (!opened.last_modified.empty()) {
        return head.last_modified.empty()
                   ? std::nullopt
                   : std::optional(head.last_modified == opened.last_modified);
    }
    return true;
}

Judgement failed(std::string problem, FailureClass failure) {
    Judgement judgement;
    judgement.problem = std::move(problem);
    judgement.failure = failure;
    return judgement;
}

Judgement of_verdict(Verdict verdict, ByteRange range, std::uint64_t size) {
    Judgement judgement;
    judgement.verdict = verdict;
    judgement.range = range;
    judgement.size = size;
    return judgement;
}

/// Whether the bytes start at the requested offset, and are not more than requested.
bool is_answer_to(const ByteRange& range, std::uint64_t size, const Asked& asked) {
    if (asked.tail == 0) {
        return range.offset == asked.range.offset && range.size <= asked.range.size;
    }
    return range.offset + range.size == size && range.size <= asked.tail;
}

Judgement judge_part(const AnswerHead& head, const Asked& asked, const Validators* opened) {
    if (head.content_range.empty()) {
        return failed("the server sent a partial answer without Content-Range", FailureClass::odd);
    }
    const std::optional<ContentRange> content = parse_content_range(head.content_range);
    if (!content || !content->range || (!content->size && opened == nullptr)) {
        return failed("the server's Content-Range is malformed", FailureClass::odd);
    }
    const std::uint64_t size = content->size ? *content->size : opened->size;
    if (opened != nullptr && size != opened->size) {
        return of_verdict(Verdict::changed, {}, size);
    }
    if (!is_answer_to(*content->range, size, asked)) {
        return failed("the server sent a different range than requested (Content-Range)",
                      FailureClass::odd);
    }
    if (head.length && *head.length != content->range->size) {
        return failed("the server's Content-Range and Content-Length contradict each other",
                      FailureClass::odd);
    }
    return of_verdict(Verdict::part, *content->range, size);
}

Judgement judge_whole(const AnswerHead& head, const Asked& asked) {
    if (head.status == 206) {
        return failed("the server sent part of the object, but all of it was requested",
                      FailureClass::odd);
    }
    if (head.length.value_or(0) > asked.most) {
        Judgement judgement = failed(
            fmt::format("it has {} bytes; at most {} are accepted", *head.length, asked.most),
            FailureClass::odd);
        judgement.is_too_large = true;
        return judgement;
    }
    const std::uint64_t size = head.length.value_or(asked.most);
    Judgement judgement = of_verdict(Verdict::part, {0, size}, size);
    judgement.is_open_ended = !head.length;
    return judgement;
}

Judgement judge_good(const AnswerHead& head, const Asked& asked, const Validators* opened) {
    if (head.is_chunked && head.says_length) {
        return failed("the server's Content-Length and Transfer-Encoding contradict each other",
                      FailureClass::odd);
    }
    if (!head.encoding.empty() && !is_same_name(head.encoding, "identity")) {
        return failed(
            "the server compresses the answer (Content-Encoding), so that ranges cannot be read",
            FailureClass::odd);
    }
    if (asked.is_whole) {
        return judge_whole(head, asked);
    }
    if (opened != nullptr) {
        const std::optional<bool> same = is_same_object(head, *opened);
        if (!same) {
            return failed("the server no longer sends an ETag", FailureClass::odd);
        }
        if (!*same) {
            return of_verdict(Verdict::changed, {}, 0);
        }
    }
    if (head.status == 206) {
        return judge_part(head, asked, opened);
    }
    if (opened != nullptr) {
        if (head.length && *head.length != opened->size) {
            return of_verdict(Verdict::changed, {}, *head.length);
        }
        return failed("the server sent the whole object, but a range was requested",
                      FailureClass::odd);
    }
    if (!head.length) {
        return failed("the server does not support range requests", FailureClass::final);
    }
    return of_verdict(Verdict::whole, {0, *head.length}, *head.length);
}

}  // namespace

std::optional<ContentRange> parse_content_range(std::string_view value) {
    const std::size_t space = value.find(' ');
    if (space == std::string_view::npos || !is_same_name(value.substr(0, space), "bytes")) {
        return std::nullopt;
    }
    value = trimmed_value(value.substr(space));
    const std::size_t slash = value.find('/');
    if (slash == std::string_view::npos) {
        return std::nullopt;
    }
    ContentRange out;
    const std::string_view range = value.substr(0, slash);
    const std::string_view size = value.substr(slash + 1);
    if (size != "*") {
        out.size = whole_number(size);
        if (!out.size) {
            return std::nullopt;
        }
    }
    if (range == "*") {
        return out;
    }
    const std::size_t dash = std::min(range.find('-'), range.size());
    const std::optional<std::uint64_t> first = whole_number(range.substr(0, dash));
    const std::optional<std::uint64_t> last =
        dash < range.size() ? whole_number(range.substr(dash + 1)) : std::nullopt;
    if (!first || !last || *last < *first || *last == ~std::uint64_t{0} ||
        (out.size && *last >= *out.size)) {
        return std::nullopt;
    }
    out.range = ByteRange{*first, *last - *first + 1};
    return out;
}

void AnswerHead::add_line(std::string_view line) {
    if (line.starts_with("HTTP/")) {
        *this = {};
        const std::size_t space = line.find(' ');
        if (space != std::string_view::npos) {
            status = static_cast<int>(whole_number(line.substr(space + 1, 3)).value_or(0));
        }
        return;
    }
    if (trimmed_value(line).empty()) {
        constexpr int kFirstOfFinal = 200;
        is_complete = status >= kFirstOfFinal;
        return;
    }
    const std::size_t colon = line.find(':');
    if (colon == std::string_view::npos) {
        return;
    }
    const std::string_view name = line.substr(0, colon);
    const std::string_view value = trimmed_value(line.substr(colon + 1));
    const std::array<std::pair<std::string_view, std::string*>, 6> texts{
        {{"ETag", &etag},
         {"Last-Modified", &last_modified},
         {"Content-Encoding", &encoding},
         {"Location", &location},
         {"x-amz-bucket-region", &bucket_region},
         {"Content-Range", &content_range}}};
    for (const auto& [known, text] : texts) {
        if (is_same_name(name, known)) {
            *text = value;
        }
    }
    if (is_same_name(name, "Content-Length")) {
        length = whole_number(value);
        says_length = true;
    }
    is_chunked = is_chunked || is_same_name(name, "Transfer-Encoding");
}

Judgement judge(const AnswerHead& head, const Asked& asked, const Validators* opened) {
    switch (head.status) {
        case 200:
        case 206:
            return judge_good(head, asked, opened);
        case 301:
        case 302:
        case 303:
        case 307:
        case 308:
            if (!head.location.empty()) {
                return of_verdict(Verdict::redirect, {}, 0);
            }
            break;
        case 412:
            if (opened != nullptr) {
                return of_verdict(Verdict::changed, {}, 0);
            }
            break;
        case 416: {
            const auto content = parse_content_range(head.content_range);
            if (opened != nullptr) {
                return of_verdict(Verdict::changed, {}, 0);
            }
            if (content && content->size) {
                return of_verdict(Verdict::no_such_range, {}, *content->size);
            }
            break;
        }
        case 408:
        case 429:
        case 500:
        case 502:
        case 503:
        case 504:
            return failed(fmt::format("the server answers {}", said_status(head.status)),
                          FailureClass::busy);
        default:
            break;
    }
    return failed(fmt::format("the server answers {}", said_status(head.status)),
                  FailureClass::final);
}

std::string said_status(int status) {
    constexpr std::array<std::pair<int, const char*>, 17> kReasons{
        {{400, "Bad Request"},
         {401, "Unauthorized"},
         {403, "Forbidden"},
         {404, "Not Found"},
         {405, "Method Not Allowed"},
         {407, "Proxy Authentication Required"},
         {408, "Request Timeout"},
         {410, "Gone"},
         {412, "Precondition Failed"},
         {416, "Range Not Satisfiable"},
         {429, "Too Many Requests"},
         {451, "Unavailable For Legal Reasons"},
         {500, "Internal Server Error"},
         {501, "Not Implemented"},
         {502, "Bad Gateway"},
         {503, "Service Unavailable"},
         {504, "Gateway Timeout"}}};
    for (const auto& [number, reason] : kReasons) {
        if (number == status) {
            return fmt::format("{} {}", status, reason);
        }
    }
    return fmt::format("{}", status);
}

namespace {

int max_attempts(FailureClass failure, const RetryPolicy& policy) {
    switch (failure) {
        case FailureClass::final:
            return 1;
        case FailureClass::odd:
            return std::min(2, policy.attempts);
        case FailureClass::unreachable:
            return std::min(policy.connect_attempts, policy.attempts);
        case FailureClass::busy:
            return policy.attempts;
    }
    return 1;
}

}  // namespace

std::optional<std::chrono::milliseconds> RetryState::wait_after(
    FailureClass failure, std::optional<std::chrono::seconds> retry_after, Clock::time_point now,
    const RetryPolicy& policy) {
    constexpr int kMaxDoublings = 20;
    if (!first_failure_) {
        first_failure_ = now;
    }
    ++failures_;
    if (failures_ >= max_attempts(failure, policy)) {
        return std::nullopt;
    }
    const std::int64_t grown = policy.first_wait.count() << std::min(failures_ - 1, kMaxDoublings);
    const double longest = static_cast<double>(std::min(grown, policy.longest_wait.count()));
    const double part = std::uniform_real_distribution<double>(0.5, 1)(random_);
    std::chrono::milliseconds wait(static_cast<std::int64_t>(longest * part));
    if (retry_after) {
        wait = std::max<std::chrono::milliseconds>(wait, *retry_after);
    }
    if (now + wait > *first_failure_ + policy.total) {
        return std::nullopt;
    }
    return wait;
}

}  // namespace isonest::detail
