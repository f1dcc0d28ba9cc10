// One request for a part of an object, by libcurl.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>

#include "store/remote/answer.h"
#include "store/remote/curl_library.h"
#include "store/remote/object_url.h"
#include "store/remote/remote_error.h"
#include "store/remote/remote_options.h"

namespace isonest::detail {

/// What is the same for all requests of one object, or of all objects below one URL.
struct RequestBasis {
    ObjectUrl url;  ///< who asks whom
    RemoteOptions options;
    bool waits_for_stream = false;  ///< the server has HTTP/2: one connection carries all requests
};

/// A handle that is used for one request after the other.
/// Thread-safety: none; all calls are by the thread that runs the multi handle.
class CurlRequest {
  public:
    /// Of the body, in order. What it throws is a failure of the request.
    using Take = std::function<void(std::span<const std::byte>)>;
    /// Before the first byte of a body that is wanted; once for each request.
    using Begin = std::function<void(const AnswerHead&, const Judgement&)>;

    struct Plan {
        std::string url;  ///< http(s)
        /// The server is the URL's own: keys, passwords and headers of the options are for it.
        bool is_own_server = true;
        Asked asked;
        const Validators* opened = nullptr;  ///< null: the object is being opened
        Begin begin;
        Take take;
        std::atomic<std::uint64_t>* body_bytes = nullptr;  ///< counts them before they are taken
    };

    CurlRequest();
    CurlRequest(const CurlRequest&) = delete;
    CurlRequest& operator=(const CurlRequest&) = delete;
    ~CurlRequest();

    [[nodiscard]] CURL* handle() const { return handle_; }
    /// Makes the handle ready to be added to a multi handle.
    void prepare(const RequestBasis& basis, Plan plan);
    /// REQUIRES: the multi handle says that it is done. What is not `part` with all its bytes is a
    /// redirect, `whole`, `no_such_range`, or a failure.
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
    std::optional<Failure> failure_;  ///< why the body is not taken any more
    std::string error_body_;
    std::uint64_t received_ = 0;
    std::size_t head_bytes_ = 0;  ///< of all heads since prepare()
    bool is_signed_ = false;
    char error_text_[CURL_ERROR_SIZE] = {};
};

/// `location` as seen from `url`, without userinfo and fragment; empty if it is no http(s) URL.
std::string resolved_location(const std::string& url, const std::string& location);

}  // namespace isonest::detail
