#include "store/remote/curl_request.h"

#include <curl/curl.h>
#include <dlfcn.h>
#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <cstdlib>
#include <exception>
#include <memory>
#include <new>
#include <string>
#include <string_view>
#include <utility>

#include <isonest/error.h>

#include "store/base/workers.h"

namespace isonest::detail {
namespace {

[[noreturn]] void fail_to_load(const char* why) {
    // It is loaded when a URL is opened, so nothing has to be built again.
    throw Error(ErrorKind::unsupported,
                fmt::format("URLs need libcurl: {}; install Debian's libcurl4", why));
}

template <class Function>
void find_in_curl(void* library, const char* name, Function& function) {
    function = reinterpret_cast<Function>(::dlsym(library, name));
    if (function == nullptr) {
        fail_to_load(fmt::format("libcurl.so.4 is too old, it has no {}", name).c_str());
    }
}

CurlLibrary load_curl() {
    void* const library = ::dlopen("libcurl.so.4", RTLD_NOW | RTLD_LOCAL);
    if (library == nullptr) {
        const std::string why = ::dlerror();
        throw_if_no_room_to_load({}, "libcurl, which URLs need", why);
        fail_to_load(why.c_str());
    }
    CurlLibrary functions;
#define ISONEST_CURL_FIND(name) find_in_curl(library, #name, functions.name);
    ISONEST_CURL_FUNCTIONS(ISONEST_CURL_FIND)
#undef ISONEST_CURL_FIND
    if (functions.curl_global_init(CURL_GLOBAL_DEFAULT) != CURLE_OK) {
        fail_to_load("it does not start");
    }
    return functions;
}

}  // namespace

const CurlLibrary& curl() {
    static const CurlLibrary functions = load_curl();
    return functions;
}

namespace {

constexpr std::size_t kMaxErrorBody = 4096;
constexpr std::size_t kMaxHead = 256U << 10U;
constexpr long kBufferBytes = 256L << 10;
/// SHA-256 of the empty body of our requests.
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
    // libcurl 8.14 does not sign paths that it must not change; parse_s3() rejects those that it
    // would change.
    set(CURLOPT_PATH_AS_IS, is_signed_ ? 0L : 1L);
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
    set(CURLOPT_HTTP_CONTENT_DECODING, 0L);  // judge() rejects other encodings
    if (!plan_.asked.is_whole) {
        set(CURLOPT_RANGE, range_text(plan_.asked).c_str());
    }
    set(CURLOPT_ERRORBUFFER, error_text_);
    set(CURLOPT_HEADERFUNCTION, &header_callback);
    set(CURLOPT_HEADERDATA, this);
    set(CURLOPT_WRITEFUNCTION, &body_callback);
    set(CURLOPT_WRITEDATA, this);
    // Like the curl program does. The library itself only uses the path set when it was built.
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
    if (request.head_bytes_ > kMaxHead) {
        return 0;
    }
    try {
        // Headers after a body are trailers.
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
                               fmt::format("it has more than the {} bytes that are accepted",
                                           judgement_->range.size),
                               ErrorKind::corrupt,
                               {{RemedyKind::check_url}}};
            return false;
        }
        if (received_ > judgement_->range.size) {
            failure_ = Failure{FailureClass::odd,
                               "the server sent more bytes than it announced",
                               ErrorKind::io,
                               {{RemedyKind::serve_ranges}}};
            return false;
        }
        plan_.take(bytes);
        return true;
    }
    if (head_.status == 200 || head_.status == 206) {
        return false;  // it may have any size
    }
    // Reads a short body to its end, so that the connection can be reused.
    const std::size_t left = kMaxErrorBody - error_body_.size();
    error_body_.append(reinterpret_cast<const char*>(bytes.data()), std::min(left, bytes.size()));
    return error_body_.size() < kMaxErrorBody;
}

std::string CurlRequest::said(CURLcode code) const {
    std::string text = error_text_[0] != 0 ? error_text_ : curl().curl_easy_strerror(code);
    while (!text.empty() && (text.back() == '\n' || text.back() == '\r')) {
        text.pop_back();
    }
    return text;
}

/// Why the head is incomplete: it is too large, or the connection broke. For a line that is too
/// long, libcurl reports out of memory, and since 8.6 a value that is too large; for a connection
/// that ends within the head, it reports nothing.
Failure CurlRequest::failure_of_head(CURLcode code) const {
    constexpr auto kTooLarge = static_cast<CURLcode>(100);  // CURLE_TOO_LARGE
    const bool is_too_large = head_bytes_ > kMaxHead || code == kTooLarge ||
                              (code == CURLE_OUT_OF_MEMORY && head_.status != 0);
    if (is_too_large) {
        return {FailureClass::odd,
                "the headers of the server's answer are too large",
                ErrorKind::io,
                {{RemedyKind::check_url}}};
    }
    return code == CURLE_OK
               ? failure_of_transfer(CURLE_RECV_ERROR, "the answer ended within its headers")
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
                // If the chunked encoding is invalid, libcurl has passed on what it took for the
                // first chunks; only its message distinguishes this from a broken connection.
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

namespace {

std::vector<Remedy> credentials_for(bool is_s3_like) {
    return {{RemedyKind::give_credentials,
             is_s3_like ? "AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY" : "~/.netrc"},
            {RemedyKind::check_url}};
}

/// The variable that is used (CurlRequest::prepare).
std::string certificates_variable() {
    const char* const bundle = std::getenv("CURL_CA_BUNDLE");
    return bundle != nullptr && *bundle != 0 ? "CURL_CA_BUNDLE" : "SSL_CERT_FILE";
}

void say_status(Failure& failure, const AnswerHead& head, const std::string& code, bool is_signed) {
    switch (head.status) {
        case 404:
        case 410:
            failure.kind = ErrorKind::not_found;
            failure.remedies = {{RemedyKind::check_url}};
            return;
        case 401:
        case 403:
        case 407:
            failure.remedies = credentials_for(is_signed || !code.empty());
            return;
        case 400:
        case 405:
        case 451:
            failure.remedies = {{RemedyKind::check_url}};
            return;
        default:
            if (failure.failure == FailureClass::busy) {
                failure.remedies = {{RemedyKind::try_later}};
            } else if (failure.failure == FailureClass::odd || head.status == 200 ||
                       head.status == 416 || head.status == 501) {
                failure.remedies = {{RemedyKind::serve_ranges}};
            }
    }
}

}  // namespace

Failure failure_of_answer(const AnswerHead& head, const Judgement& judgement,
                          const std::string& code, bool is_signed) {
    Failure failure{judgement.failure, judgement.problem};
    failure.status = head.status;
    if (failure.problem.empty()) {
        failure.problem = fmt::format("the server answers {}", said_status(head.status));
    }
    if (!code.empty()) {
        failure.problem += fmt::format(" ({})", code);
    }
    say_status(failure, head, code, is_signed);
    if (judgement.is_too_large) {
        failure.kind = ErrorKind::corrupt;
        failure.remedies = {{RemedyKind::check_url}};
    }
    const bool names_region =
        !head.bucket_region.empty() && head.bucket_region.size() <= 32 &&
        std::all_of(head.bucket_region.begin(), head.bucket_region.end(), [](char c) {
            return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '-';
        });
    if (names_region && head.status != 404 && failure.failure == FailureClass::final) {
        failure.problem += fmt::format("; the bucket is in the region {}", head.bucket_region);
        failure.remedies.insert(failure.remedies.begin(),
                                {RemedyKind::set_variable, "AWS_REGION=" + head.bucket_region});
    }
    return failure;
}

Failure failure_of_transfer(int code, const std::string& text) {
    switch (code) {
        case CURLE_COULDNT_RESOLVE_HOST:
        case CURLE_COULDNT_RESOLVE_PROXY:
        case CURLE_COULDNT_CONNECT:
            return {FailureClass::unreachable, text, ErrorKind::io, {{RemedyKind::check_url}}};
        case CURLE_OPERATION_TIMEDOUT:
            return {FailureClass::unreachable,
                    "connecting to the server timed out",
                    ErrorKind::io,
                    {{RemedyKind::try_later}, {RemedyKind::check_url}}};
        case CURLE_PEER_FAILED_VERIFICATION:
        case CURLE_SSL_CERTPROBLEM:
        case CURLE_SSL_ISSUER_ERROR:
        case CURLE_SSL_CACERT_BADFILE:
        case CURLE_SSL_INVALIDCERTSTATUS:
            return {FailureClass::final,
                    fmt::format("the server's certificate is not trusted: {}", text),
                    ErrorKind::io,
                    {{RemedyKind::set_variable, certificates_variable() + "=CERTIFICATES.pem"}}};
        case CURLE_GOT_NOTHING:
        case CURLE_PARTIAL_FILE:
        case CURLE_RECV_ERROR:
        case CURLE_SEND_ERROR:
        case CURLE_HTTP2:
        case CURLE_HTTP2_STREAM:
        case CURLE_SSL_CONNECT_ERROR:
        case CURLE_WEIRD_SERVER_REPLY:
            return {FailureClass::busy,
                    fmt::format("the connection broke: {}", text),
                    ErrorKind::io,
                    {{RemedyKind::try_later}}};
        case CURLE_OUT_OF_MEMORY:
            return {FailureClass::final,
                    "there is no memory left",
                    ErrorKind::limit,
                    {{RemedyKind::more_memory}}};
        case CURLE_UNSUPPORTED_PROTOCOL:
            return {FailureClass::odd,
                    "the server's answer is not HTTP",
                    ErrorKind::io,
                    {{RemedyKind::check_url}}};
        case CURLE_URL_MALFORMAT:
            return {
                FailureClass::final, text, ErrorKind::invalid_argument, {{RemedyKind::check_url}}};
        default:
            return {FailureClass::busy, text, ErrorKind::io, {{RemedyKind::try_later}}};
    }
}

Failure failure_of_change() {
    Failure failure{FailureClass::final,
                    "the object has changed since it was opened",
                    ErrorKind::io,
                    {{RemedyKind::open_again}}};
    failure.is_change = true;
    return failure;
}

Error error_of(const Failure& failure, const std::string& name, int tries) {
    std::string problem = failure.problem;
    if (tries > 1) {
        problem += fmt::format(" ({} tries)", tries);
    }
    if (failure.retry_after && failure.retry_after->count() > 0) {
        problem += fmt::format("; it asks clients to wait {} s", failure.retry_after->count());
    }
    return {failure.kind, {name}, problem, failure.remedies};
}

std::string s3_code_in(std::string_view body) {
    constexpr std::string_view kBegin = "<Code>";
    constexpr std::size_t kLongest = 64;
    const std::size_t at = body.find(kBegin);
    if (at == std::string_view::npos || body.find("<Error") == std::string_view::npos) {
        return {};
    }
    const std::string_view rest = body.substr(at + kBegin.size());
    const std::string_view code = rest.substr(0, rest.find("</Code>"));
    const bool is_word = std::all_of(code.begin(), code.end(), [](char c) {
        return (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9');
    });
    return code.size() <= kLongest && is_word ? std::string(code) : std::string();
}

}  // namespace isonest::detail
