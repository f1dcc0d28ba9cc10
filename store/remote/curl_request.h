// One request for a part of an object, with libcurl.
#pragma once

#include <curl/curl.h>

#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <isonest/error.h>

#include "store/remote/answer.h"
#include "store/remote/object_url.h"

namespace isonest::detail {

// libcurl is loaded when the first URL is opened. Programs that only read files run and link
// without it and its thirty dependencies. (Debian's HDF5 loads them anyway; other builds of HDF5
// need not.)

#define ISONEST_CURL_FUNCTIONS(X) \
    X(curl_global_init)           \
    X(curl_easy_init)             \
    X(curl_easy_setopt)           \
    X(curl_easy_getinfo)          \
    X(curl_easy_perform)          \
    X(curl_easy_reset)            \
    X(curl_easy_cleanup)          \
    X(curl_easy_strerror)         \
    X(curl_slist_append)          \
    X(curl_slist_free_all)        \
    X(curl_multi_init)            \
    X(curl_multi_setopt)          \
    X(curl_multi_add_handle)      \
    X(curl_multi_remove_handle)   \
    X(curl_multi_perform)         \
    X(curl_multi_poll)            \
    X(curl_multi_wakeup)          \
    X(curl_multi_info_read)       \
    X(curl_multi_cleanup)         \
    X(curl_url)                   \
    X(curl_url_set)               \
    X(curl_url_get)               \
    X(curl_url_cleanup)           \
    X(curl_free)

/// The functions, as declared in libcurl's headers.
struct CurlLibrary {
#define ISONEST_CURL_MEMBER(name) \
    decltype(&::name) name = nullptr;  // NOLINT(bugprone-macro-parentheses)
    ISONEST_CURL_FUNCTIONS(ISONEST_CURL_MEMBER)
#undef ISONEST_CURL_MEMBER
};

/// Loads it once and keeps it loaded. Throws Error{unsupported} if it is not installed.
const CurlLibrary& curl();

// Messages about requests that finally failed. They contain nothing in which a server or a URL
// could have secrets: no query, no header, no body.

/// A request that did not deliver what was requested.
struct Failure {
    FailureClass failure = FailureClass::final;
    std::string problem;
    ErrorKind kind = ErrorKind::io;
    std::vector<Remedy> remedies = {};
    std::optional<std::chrono::seconds> retry_after = std::nullopt;
    bool is_change = false;  ///< the object has changed
    bool is_void = false;    ///< the body of this answer may not be bytes of the object
    int status = 0;          ///< HTTP status; 0: no answer
};

/// For an answer with an error status, with the problem found by judge(). `code`: from S3's
/// message, may be empty. `is_signed`: with S3 keys.
Failure failure_of_answer(const AnswerHead& head, const Judgement& judgement,
                          const std::string& code, bool is_signed);
/// For a transfer that libcurl aborted. `code`: the CURLcode; `text`: libcurl's message.
Failure failure_of_transfer(int code, const std::string& text);
Failure failure_of_change();
/// `tries`: number of consecutive failed requests.
Error error_of(const Failure& failure, const std::string& name, int tries);

/// "AccessDenied" from S3's <Error><Code>AccessDenied</Code>...; empty if the body has another
/// form.
std::string s3_code_in(std::string_view body);

/// Common to all requests of one object, or of all objects below one URL.
struct RequestBasis {
    ObjectUrl url;  ///< server and credentials
    RemoteOptions options;
    bool waits_for_stream = false;  ///< the server supports HTTP/2: one connection carries all
                                    ///< requests
};

/// A handle that is used for one request after the other.
/// Thread-safety: none; all calls come from the thread that runs the multi handle.
class CurlRequest {
  public:
    /// Receives the body, in order. An exception that it throws makes the request fail.
    using Take = std::function<void(std::span<const std::byte>)>;
    /// Called before the first byte of a wanted body; once for each request.
    using Begin = std::function<void(const AnswerHead&, const Judgement&)>;

    struct Plan {
        std::string url;  ///< http(s)
        /// Whether this is the server of the URL: keys, passwords and headers in the options are
        /// only for it.
        bool is_own_server = true;
        Asked asked;
        const Validators* opened = nullptr;  ///< null: the object is being opened
        Begin begin;
        Take take;
        std::atomic<std::uint64_t>* body_bytes = nullptr;  ///< counts bytes before they are passed
                                                           ///< to `take`
    };

    CurlRequest();
    CurlRequest(const CurlRequest&) = delete;
    CurlRequest& operator=(const CurlRequest&) = delete;
    ~CurlRequest();

    [[nodiscard]] CURL* handle() const { return handle_; }
    /// Prepares the handle for being added to a multi handle.
    void prepare(const RequestBasis& basis, Plan plan);
    /// REQUIRES: the multi handle reports that the request is done. Unless all bytes of a `part`
    /// have come, the result is a redirect, `whole`, `no_such_range`, or a failure.
    struct Outcome {
        Judgement judgement;
        AnswerHead head;
        std::optional<Failure> failure;
    };
    Outcome finish(CURLcode code);

    /// Bytes of bodies since prepare().
    [[nodiscard]] std::uint64_t received() const { return received_; }
    [[nodiscard]] bool has_http2() const;

  private:
    static std::size_t header_callback(char* data, std::size_t one, std::size_t size, void* self);
    static std::size_t body_callback(char* data, std::size_t one, std::size_t size, void* self);
    bool take_body(std::span<const std::byte> bytes);
    void judge_now();
    [[nodiscard]] Failure failure_of_head(CURLcode code) const;
    void append_header(const std::string& line);
    void set_authority(const RequestBasis& basis);
    std::string said(CURLcode code) const;

    template <class Value>
    void set(CURLoption option, Value value) {
        curl().curl_easy_setopt(handle_, option, value);
    }

    CURL* handle_ = nullptr;
    curl_slist* header_lines_ = nullptr;
    Plan plan_;
    AnswerHead head_;
    std::optional<Judgement> judgement_;
    std::optional<Failure> failure_;  ///< why no more of the body is accepted
    std::string error_body_;
    std::uint64_t received_ = 0;
    std::size_t head_bytes_ = 0;  ///< of all headers since prepare()
    bool is_signed_ = false;
    char error_text_[CURL_ERROR_SIZE] = {};
};

/// `location` resolved relative to `url`, without userinfo and fragment; empty if it is not an
/// http(s) URL.
std::string resolved_location(const std::string& url, const std::string& location);

}  // namespace isonest::detail
