// Requests to the viewer's server and its answers, independent of the network.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

namespace isonest::detail::view {

struct HttpRequest {
    std::string method;
    std::string target;  ///< path and query, as received
    // Headers; empty if absent.
    std::string host;
    std::string origin;
    std::string fetch_site;
};

/// A file that is sent and then removed, together with its folder.
class SentFile {
  public:
    /// `folder` contains only this file.
    SentFile(std::filesystem::path folder, std::filesystem::path file)
        : folder_(std::move(folder)), file_(std::move(file)) {}
    SentFile(SentFile&& other) noexcept
        : folder_(std::exchange(other.folder_, {})), file_(std::exchange(other.file_, {})) {}
    SentFile& operator=(SentFile&& other) noexcept {
        std::swap(folder_, other.folder_);
        std::swap(file_, other.file_);
        return *this;
    }
    SentFile(const SentFile&) = delete;
    SentFile& operator=(const SentFile&) = delete;
    ~SentFile();
    [[nodiscard]] const std::filesystem::path& path() const { return file_; }

  private:
    std::filesystem::path folder_;
    std::filesystem::path file_;
};

struct HttpAnswer {
    unsigned status = 200;
    std::string type = "application/json";
    /// Text or bytes; bytes that stay valid as long as the program runs; or a file.
    std::variant<std::string, std::string_view, SentFile> body = std::string();
    /// Name under which a browser saves it; empty: shown by the browser.
    std::string file_name = {};

    /// Bytes in memory that belong to this answer alone.
    [[nodiscard]] std::size_t heap() const {
        const auto* const text = std::get_if<std::string>(&body);
        return text != nullptr ? text->size() : 0;
    }
};

/// Work in progress for a request. Thread-safe.
class Waiting {
  public:
    Waiting() = default;
    Waiting(const Waiting&) = delete;
    Waiting& operator=(const Waiting&) = delete;
    virtual ~Waiting() = default;
    /// The answer is no longer wanted.
    virtual void cancel() = 0;
};

using Reply = std::function<void(HttpAnswer answer)>;

/// Answers requests.
class HttpHandler {
  public:
    HttpHandler() = default;
    HttpHandler(const HttpHandler&) = delete;
    HttpHandler& operator=(const HttpHandler&) = delete;
    virtual ~HttpHandler() = default;
    /// Called on the server's thread; does not block and does not throw. `reply` is called once,
    /// from any thread, now or later; returns null if it was already called.
    virtual std::shared_ptr<Waiting> handle(const HttpRequest& request, Reply reply) = 0;
};

}  // namespace isonest::detail::view
