// A small HTTP/1.1 server on Boost.Beast, for one user's browser. The resources that other clients
// can take are bounded.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "tools/view/http_messages.h"

namespace isonest::detail::view {

// Access control of the viewer's server.

/// What the server accepts.
struct Access {
    std::string address;  ///< that the server listens on
    std::uint16_t port = 0;
    std::string token = {};  ///< empty: none is required
    /// It listens on all addresses: any name of this machine is accepted, and the token decides.
    bool any_address = false;
};

/// Why a request is refused; empty if it is not. Pages of other origins can neither read nor start
/// anything: their requests have another Origin or Sec-Fetch-Site, and names that resolve to this
/// machine but are not its own (DNS rebinding) have another Host. `token`: of the request. The page
/// itself, which contains no data, needs neither token nor origin.
std::string why_refused(const Access& access, const HttpRequest& request, const std::string& token,
                        bool is_page);

/// 128 random bits, as hexadecimal digits.
std::string new_token();

struct HttpLimits {
    /// Above this, a new connection replaces the one that has waited longest for a request; if all
    /// have work in progress, the new one is closed.
    std::size_t connections = 128;
    std::size_t header_bytes = std::size_t{16} << 10U;
    /// Bytes of answers being sent; above this, the connection that has been sending longest is
    /// closed.
    std::size_t answer_bytes = std::size_t{64} << 20U;
    int request_seconds = 10;  ///< from the first byte of a request to the last
    int idle_seconds = 60;     ///< until the next request
    int answer_seconds = 60;   ///< for sending an answer
    /// Plus one second per this many bytes.
    std::size_t answer_bytes_per_second = std::size_t{128} << 10U;
};

/// All network operations happen on one thread, that of run().
class HttpServer {
  public:
    /// Listens from now on. With port 0 the system chooses one. Throws Error{io} if the address is
    /// not available, Error{invalid_argument} if it is invalid.
    HttpServer(const std::string& address, std::uint16_t port, const HttpLimits& limits);
    HttpServer(const HttpServer&) = delete;
    HttpServer& operator=(const HttpServer&) = delete;
    ~HttpServer();

    /// The address it listens on, as browsers write it in a Host header, without brackets.
    [[nodiscard]] std::string address() const;
    [[nodiscard]] std::uint16_t port() const;
    /// Answers requests until stop() returns true; it is called about 20 times per second.
    /// `handler` must send no reply after its destruction; replies after this call are dropped.
    void run(HttpHandler& handler, const std::function<bool()>& stop);
    /// Number of open connections. Call it on the server's thread.
    [[nodiscard]] std::size_t connections() const;

  private:
    class Connection;
    struct Parts;
    std::shared_ptr<Parts> parts_;
};

}  // namespace isonest::detail::view
