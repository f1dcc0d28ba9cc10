#include "store/remote/curl_request.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <exception>
#include <memory>
#include <new>
#include <string_view>
#include <utility>

namespace isonest::detail {
namespace {

constexpr std::size_t kMostErrorBody = 4096;
constexpr std::size_t kMostHead = 256U << 10U;
constexpr long kBufferBytes = 256L << 10;
/// SHA-256 of nothing, which is the body of our requests.
constexpr const char* kHashOfNothing =
    "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855";

const char* variable(const char* name) {
    const char* const value = std::getenv(name);
    return value != nullptr && *value != 0 ? value : nullptr;
}

std::string range_text(const Asked& asked) {
    return asked.tail != 0 ? fmt::format("-{}", asked.tail)
                           : fmt::format("{}-{}", asked.range.offset,
                                         asked.range.offset + asked.range.size - 1);
}

}  // namespace

CurlRequest::CurlRequest() : handle_(curl().curl_easy_init()) {
    if (handle_ == nullptr) {
        throw std::bad_alloc();
    }
}

CurlRequest::~CurlRequest() {
    curl().curl_easy_cleanup(handle_);
    curl().curl_slist_free_all(header_lines_);
}

void CurlRequest::append_header(const std::string& line) {
    curl_slist* const longer = curl().curl_slist_append(header_lines_, line.c_str());
    if (longer == nullptr) {
        throw std::bad_alloc();
    }
    header_lines_ = longer;
}

void CurlRequest::set_authority(const RequestBasis& basis) {
    for (const std::string& line : basis.options.headers) {
        append_header(line);
    }
    if (basis.url.keys) {
        const SigningKeys& keys = *basis.url.keys;
        set(CURLOPT_AWS_SIGV4, fmt::format("aws:amz:{}:s3", keys.region).c_str());
        set(CURLOPT_USERNAME, keys.id.c_str());
        set(CURLOPT_PASSWORD, keys.secret.c_str());
        append_header(fmt::format("x-amz-content-sha256: {}", kHashOfNothing));
        if (!keys.session.empty()) {
            append_header("x-amz-security-token: " + keys.session);
        }
        return;
    }
    if (basis.url.is_s3) {
        return;
    }
    if (!basis.url.user.empty() || !basis.url.password.empty()) {
        set(CURLOPT_HTTPAUTH, static_cast<long>(CURLAUTH_BASIC));
        set(CURLOPT_USERNAME, basis.url.user.c_str());
        set(CURLOPT_PASSWORD, basis.url.password.c_str());
    } else {
        set(CURLOPT_NETRC, static_cast<long>(CURL_NETRC_OPTIONAL));
    }
}

void CurlRequest::prepare(const RequestBasis& basis, Plan plan) {
    curl().curl_easy_reset(handle_);
    curl().curl_slist_free_all(std::exchange(header_lines_, nullptr));
    plan_ = std::move(plan);
    head_ = {};
    judgement_.reset();
    failure_.reset();
    error_body_.clear();
    received_ = 0;
    head_bytes_ = 0;
    error_text_[0] = 0;
    is_signed_ = plan_.is_own_server && basis.url.keys.has_value();
    set(CURLOPT_URL, plan_.url.c_str());
    set(CURLOPT_PATH_AS_IS, 1L);
    set(CURLOPT_PROTOCOLS_STR, "https,http");
    set(CURLOPT_HTTP_VERSION, static_cast<long>(CURL_HTTP_VERSION_2TLS));
    set(CURLOPT_PIPEWAIT, basis.waits_for_stream ? 1L : 0L);
    set(CURLOPT_NOSIGNAL, 1L);
    set(CURLOPT_QUICK_EXIT, 1L);
    set(CURLOPT_TCP_KEEPALIVE, 1L);
    set(CURLOPT_SUPPRESS_CONNECT_HEADERS, 1L);
    set(CURLOPT_BUFFERSIZE, kBufferBytes);
    set(CURLOPT_CONNECTTIMEOUT_MS, static_cast<long>(basis.options.connect_timeout.count()));
    set(CURLOPT_USERAGENT, "isonest");
    set(CURLOPT_ACCEPT_ENCODING, "identity");
    set(CURLOPT_HTTP_CONTENT_DECODING, 0L);  // judge() refuses other encodings
    if (!plan_.asked.is_whole) {
        set(CURLOPT_RANGE, range_text(plan_.asked).c_str());
    }
    set(CURLOPT_ERRORBUFFER, error_text_);
    set(CURLOPT_HEADERFUNCTION, &header_callback);
    set(CURLOPT_HEADERDATA, this);
    set(CURLOPT_WRITEFUNCTION, &body_callback);
    set(CURLOPT_WRITEDATA, this);
    // As the program curl does; the library alone knows only what it was built with.
    if (const char* const bundle = variable("CURL_CA_BUNDLE")) {
        set(CURLOPT_CAINFO, bundle);
    } else {
        if (const char* const folder = variable("SSL_CERT_DIR")) {
            set(CURLOPT_CAPATH, folder);
        }
        if (const char* const file = variable("SSL_CERT_FILE")) {
            set(CURLOPT_CAINFO, file);
        }
    }
    if (plan_.is_own_server) {
        set_authority(basis);
    }
    if (plan_.opened != nullptr && plan_.opened->is_strong()) {
        append_header("If-Match: " + plan_.opened->etag);
    } else if (plan_.opened != nullptr && plan_.opened->etag.empty() &&
               !plan_.opened->last_modified.empty()) {
        append_header("If-Unmodified-Since: " + plan_.opened->last_modified);
    }
    set(CURLOPT_HTTPHEADER, header_lines_);
}

std::size_t CurlRequest::header_callback(char* data, std::size_t /*one*/, std::size_t size,
                                         void* self) {
    auto& request = *static_cast<CurlRequest*>(self);
    request.head_bytes_ += size;
    if (request.head_bytes_ > kMostHead) {
        return 0;
    }
    try {
        // What follows a body are trailers.
        if (!request.judgement_) {
            request.head_.add_line({data, size});
        }
        return size;
    } catch (...) {
        return 0;
    }
}

std::size_t CurlRequest::body_callback(char* data, std::size_t /*one*/, std::size_t size,
                                       void* self) {
    auto& request = *static_cast<CurlRequest*>(self);
    request.received_ += size;
    *request.plan_.body_bytes += size;
    try {
        return request.take_body(std::as_bytes(std::span(data, size))) ? size : 0;
    } catch (const std::bad_alloc&) {
        request.failure_ = failure_of_transfer(CURLE_OUT_OF_MEMORY, "");
    } catch (const Error& error) {
        request.failure_ =
            Failure{FailureClass::final, error.problem(), error.kind(), error.remedies()};
    } catch (const std::exception& error) {
        request.failure_ = Failure{FailureClass::final, error.what()};
    }
    return 0;
}

void CurlRequest::judge_now() {
    if (judgement_) {
        return;
    }
    judgement_ = judge(head_, plan_.asked, plan_.opened);
    if (judgement_->verdict == Verdict::whole && plan_.opened == nullptr &&
        plan_.asked.tail >= judgement_->size) {
        judgement_->verdict = Verdict::part;
    }
    if (judgement_->verdict == Verdict::part) {
        plan_.begin(head_, *judgement_);
    }
}

bool CurlRequest::take_body(std::span<const std::byte> bytes) {
    judge_now();
    if (judgement_->verdict == Verdict::part) {
        if (received_ > judgement_->range.size && judgement_->is_open_ended) {
            failure_ = Failure{FailureClass::odd,
                               fmt::format("it has more bytes than the {} that it can have",
                                           judgement_->range.size),
                               ErrorKind::corrupt,
                               {{RemedyKind::check_url}}};
            return false;
        }
        if (received_ > judgement_->range.size) {
            failure_ = Failure{FailureClass::odd,
                               "the server sends more bytes than it announced",
                               ErrorKind::io,
                               {{RemedyKind::serve_ranges}}};
            return false;
        }
        plan_.take(bytes);
        return true;
    }
    if (head_.status == 200 || head_.status == 206) {
        return false;  // it could be of any size
    }
    // A short body is read to its end, so that the connection can be used again.
    const std::size_t left = kMostErrorBody - error_body_.size();
    error_body_.append(reinterpret_cast<const char*>(bytes.data()), std::min(left, bytes.size()));
    return error_body_.size() < kMostErrorBody;
}

std::string CurlRequest::said(CURLcode code) const {
    std::string text = error_text_[0] != 0 ? error_text_ : curl().curl_easy_strerror(code);
    while (!text.empty() && (text.back() == '\n' || text.back() == '\r')) {
        text.pop_back();
    }
    return text;
}

/// Why the head is not whole: it is too large, or the connection broke. libcurl says of a line that
/// it finds too long that memory is missing, and of a connection that ends within the head nothing.
Failure CurlRequest::failure_of_head(CURLcode code) const {
    const bool is_too_large =
        head_bytes_ > kMostHead || (code == CURLE_OUT_OF_MEMORY && head_.status != 0);
    if (is_too_large) {
        return {FailureClass::odd,
                "the head of the server's answer is too large",
                ErrorKind::io,
                {{RemedyKind::check_url}}};
    }
    return code == CURLE_OK ? failure_of_transfer(CURLE_RECV_ERROR, "it ended within the head")
                            : failure_of_transfer(code, said(code));
}

CurlRequest::Outcome CurlRequest::finish(CURLcode code) {
    if (failure_) {
        return {judgement_.value_or(Judgement{}), head_, failure_};
    }
    if (!judgement_ && !head_.is_complete) {
        return {{}, head_, failure_of_head(code)};
    }
    const bool ended_early = code != CURLE_OK;
    if (ended_early && !judgement_) {
        return {{}, head_, failure_of_transfer(code, said(code))};
    }
    try {
        judge_now();
    } catch (const std::bad_alloc&) {
        return {{}, head_, failure_of_transfer(CURLE_OUT_OF_MEMORY, "")};
    } catch (const Error& error) {
        return {{},
                head_,
                Failure{FailureClass::final, error.problem(), error.kind(), error.remedies()}};
    }
    Outcome outcome{*judgement_, head_, std::nullopt};
    switch (judgement_->verdict) {
        case Verdict::part:
            if (ended_early) {
                outcome.failure = failure_of_transfer(code, said(code));
                // Of chunks that are none, libcurl has handed on what it took for the first ones;
                // only its text tells that from a connection that broke.
                outcome.failure->is_void = head_.is_chunked && code == CURLE_RECV_ERROR &&
                                           received_ > 0 &&
                                           said(code).find("chunk") != std::string::npos;
            } else if (received_ < judgement_->range.size && !judgement_->is_open_ended) {
                outcome.failure = failure_of_transfer(CURLE_PARTIAL_FILE, "bytes are missing");
            }
            break;
        case Verdict::changed:
            outcome.failure = failure_of_change();
            break;
        case Verdict::failed: {
            outcome.failure =
                failure_of_answer(head_, *judgement_, s3_code_in(error_body_), is_signed_);
            curl_off_t seconds = 0;
            curl().curl_easy_getinfo(handle_, CURLINFO_RETRY_AFTER, &seconds);
            if (seconds > 0) {
                outcome.failure->retry_after = std::chrono::seconds(seconds);
            }
            break;
        }
        case Verdict::whole:
        case Verdict::redirect:
        case Verdict::no_such_range:
            break;
    }
    return outcome;
}

bool CurlRequest::has_http2() const {
    long version = 0;
    curl().curl_easy_getinfo(handle_, CURLINFO_HTTP_VERSION, &version);
    return version >= CURL_HTTP_VERSION_2_0;
}

std::string resolved_location(const std::string& url, const std::string& location) {
    const CurlLibrary& c = curl();
    const std::unique_ptr<CURLU, decltype(c.curl_url_cleanup)> parts(c.curl_url(),
                                                                     c.curl_url_cleanup);
    char* text = nullptr;
    std::string out;
    if (parts != nullptr &&
        c.curl_url_set(parts.get(), CURLUPART_URL, url.c_str(), CURLU_PATH_AS_IS) == CURLUE_OK &&
        c.curl_url_set(parts.get(), CURLUPART_URL, location.c_str(), CURLU_URLENCODE) ==
            CURLUE_OK &&
        c.curl_url_set(parts.get(), CURLUPART_USER, nullptr, 0) == CURLUE_OK &&
        c.curl_url_set(parts.get(), CURLUPART_PASSWORD, nullptr, 0) == CURLUE_OK &&
        c.curl_url_set(parts.get(), CURLUPART_FRAGMENT, nullptr, 0) == CURLUE_OK &&
        c.curl_url_get(parts.get(), CURLUPART_URL, &text, 0) == CURLUE_OK) {
        out = text;
        c.curl_free(text);
    }
    const std::string_view start(out);
    return start.starts_with("http://") || start.starts_with("https://") ? out : "";
}

}  // namespace isonest::detail
