#include "store/remote/remote_error.h"

#include <curl/curl.h>
#include <fmt/format.h>

#include <algorithm>
#include <cstddef>
#include <cstdlib>

namespace isonest::detail {
namespace {

std::vector<Remedy> credentials_for(bool is_s3_like) {
    return {{RemedyKind::give_credentials,
             is_s3_like ? "AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY" : "~/.netrc"},
            {RemedyKind::check_url}};
}

/// The one that counts (CurlRequest::prepare).
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
                    "the server cannot be reached in time",
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
                    "what the server sends is no HTTP",
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
                    "the object has changed since it was opened; its old and new bytes would mix",
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
        problem += fmt::format("; it asks to wait for {} s", failure.retry_after->count());
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
