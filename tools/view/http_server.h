// A small HTTP/1.1 server on Boost.Beast, for one user and her browser: what others may do to it is
// bounded.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "tools/view/http_messages.h"

namespace isonest::detail::view {

struct HttpLimits {
    /// More take the place of those that have waited longest for a request; where all have work
    /// under way, the new one is closed.
    std::size_t connections = 128;
    std::size_t header_bytes = std::size_t{16} << 10U;
    /// Answers being sent; beyond, the connection that has been at it for longest is closed.
    std::size_t answer_bytes = std::size_t{64} << 20U;
    int request_seconds = 10;  ///< from a request's first byte to its last
    int idle_seconds = 60;     ///< until the next request
    int answer_seconds = 60;   ///< for sending an answer,
    /// and a second more for so many bytes of it.
    std::size_t answer_bytes_per_second = std::size_t{128} << 10U;
};

/// One thread, that of run(), does all that has to do with the network.
class HttpServer {
  public:
    /// Listens from now on. With port 0 the system chooses one. Throws Error{io} if the address
    /// cannot be had, Error{invalid_argument} if it is none.
    HttpServer(const std::string& address, std::uint16_t port, const HttpLimits& limits);
    HttpServer(const HttpServer&) = delete;
    HttpServer& operator=(const HttpServer&) = delete;
    ~HttpServer();

    /// That it listens on, in the form that browsers write in a Host header, without brackets.
    [[nodiscard]] std::string address() const;
    [[nodiscard]] std::uint16_t port() const;
    /// Answers until stop() is true, which is asked about 20 times a second. `handler` has to be
    /// such that no reply comes after it is gone; replies after this call are dropped.
    void run(HttpHandler& handler, const std::function<bool()>& stop);
    /// Open connections. Of the server's thread.
    [[nodiscard]] std::size_t connections() const;

  private:
    class Connection;
    struct Parts;
    std::shared_ptr<Parts> parts_;
};

}  // namespace isonest::detail::view
