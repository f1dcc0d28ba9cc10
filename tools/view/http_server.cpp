// Beast's asynchronous operations, all in one thread (Boost 1.74, examples of Beast).

#include "tools/view/http_server.h"

#include <fmt/format.h>
#include <sys/random.h>

#include <algorithm>
#include <array>
#include <boost/asio/dispatch.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <boost/system/system_error.hpp>
#include <chrono>
#include <list>
#include <optional>
#include <system_error>

#include <isonest/error.h>
#include <isonest/version.h>

namespace isonest::detail::view {
namespace {

/// Constant time, so that a wrong token takes as long as the right one.
bool same(const std::string& a, const std::string& b) {
    if (a.size() != b.size()) {
        return false;
    }
    unsigned difference = 0;
    for (std::size_t i = 0; i < a.size(); ++i) {
        difference |= static_cast<unsigned>(static_cast<unsigned char>(a[i]) ^
                                            static_cast<unsigned char>(b[i]));
    }
    return difference == 0;
}

bool is_own_host(const Access& access, const std::string& host) {
    const std::string port = fmt::format(":{}", access.port);
    const std::string address =
        access.address.find(':') == std::string::npos ? access.address : "[" + access.address + "]";
    if (host == address + port || host == "localhost" + port) {
        return true;
    }
    constexpr std::uint16_t kDefaultPort = 80;  // which browsers omit
    if (access.port == kDefaultPort && (host == address || host == "localhost")) {
        return true;
    }
    return access.any_address && !host.empty();
}

}  // namespace

std::string why_refused(const Access& access, const HttpRequest& request, const std::string& token,
                        bool is_page) {
    if (!is_own_host(access, request.host)) {
        return "the Host of the request is not this server";
    }
    if (is_page) {
        return {};
    }
    if (!request.origin.empty() && request.origin != "http://" + request.host) {
        return "requests from other origins are refused";
    }
    if (!request.fetch_site.empty() && request.fetch_site != "same-origin" &&
        request.fetch_site != "none") {
        return "requests from other sites are refused";
    }
    if (!access.token.empty() && !same(access.token, token)) {
        return "the token is missing or wrong: it is in the URL that the server printed";
    }
    return {};
}

std::string new_token() {
    std::array<unsigned char, 16> bytes{};
    if (::getrandom(bytes.data(), bytes.size(), 0) != static_cast<ssize_t>(bytes.size())) {
        throw Error(ErrorKind::io, "cannot obtain random bytes");
    }
    std::string token;
    for (const unsigned char byte : bytes) {
        token += fmt::format("{:02x}", byte);
    }
    return token;
}

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
using tcp = asio::ip::tcp;

struct HttpServer::Parts {
    explicit Parts(const HttpLimits& limits_) : limits(limits_) {}

    HttpLimits limits;
    asio::io_context io{1};
    tcp::acceptor acceptor{io};
    asio::steady_timer clock{io};
    HttpHandler* handler = nullptr;
    std::list<std::weak_ptr<Connection>> all;  ///< oldest first
    std::size_t sending_bytes = 0;
    bool accepts = true;

    void accept(const std::shared_ptr<Parts>& self);
    void watch(const std::shared_ptr<Parts>& self, const std::function<bool()>& stop);
    bool make_room();
    void make_room_for_answer(std::size_t bytes, const Connection* but);
};

/// One connection: a request, its answer, the next request.
class HttpServer::Connection : public std::enable_shared_from_this<Connection> {
  public:
    enum class State : std::uint8_t { idle, working, sending, closed };

    Connection(std::shared_ptr<Parts> parts, tcp::socket&& socket)
        : parts_(std::move(parts)), stream_(std::move(socket)) {}
    Connection(const Connection&) = delete;
    Connection& operator=(const Connection&) = delete;
    ~Connection() { parts_->sending_bytes -= sent_bytes_; }

    [[nodiscard]] State state() const { return state_; }

    void read() {
        state_ = State::idle;
        since_ = std::chrono::steady_clock::now();
        parser_.emplace();
        parser_->header_limit(static_cast<std::uint32_t>(parts_->limits.header_bytes));
        parser_->body_limit(kMaxBody);
        // A connection may be idle for long, but a request that has begun must arrive soon.
        if (buffer_.size() > 0) {
            read_request();
            return;
        }
        stream_.expires_after(std::chrono::seconds(parts_->limits.idle_seconds));
        stream_.async_read_some(buffer_.prepare(kFirstRead),
                                [self = shared_from_this()](beast::error_code ec, std::size_t n) {
                                    if (ec) {
                                        self->close();
                                        return;
                                    }
                                    self->buffer_.commit(n);
                                    self->read_request();
                                });
    }

    void close() {
        const std::shared_ptr<Connection> until_end = std::move(alive_);
        if (state_ == State::closed) {
            return;
        }
        state_ = State::closed;
        if (work_) {
            work_->cancel();
            work_.reset();
        }
        beast::error_code ignored;
        stream_.socket().shutdown(tcp::socket::shutdown_both, ignored);
        stream_.close();
    }

    void answer(HttpAnswer&& answer) {
        if (state_ == State::closed) {
            return;
        }
        const std::shared_ptr<Connection> until_end = std::move(alive_);
        work_.reset();
        state_ = State::sending;
        since_ = std::chrono::steady_clock::now();
        beast::error_code ignored;
        stream_.socket().cancel(ignored);  // stops watching for the other end
        sent_bytes_ = answer.heap();
        parts_->make_room_for_answer(sent_bytes_, this);
        parts_->sending_bytes += sent_bytes_;
        answer_ = std::move(answer);
        if (const auto* const text = std::get_if<std::string>(&answer_.body)) {
            send_text(*text);
        } else if (const auto* const constant = std::get_if<std::string_view>(&answer_.body)) {
            send_text(*constant);
        } else {
            http::response<http::file_body> message = headers<http::file_body>();
            beast::error_code ec;
            message.body().open(std::get<SentFile>(answer_.body).path().c_str(),
                                beast::file_mode::scan, ec);
            if (ec) {
                close();
                return;
            }
            send(std::move(message));
        }
    }

    [[nodiscard]] std::chrono::steady_clock::time_point since() const { return since_; }

  private:
    static constexpr std::uint64_t kMaxBody = 1 << 10;
    static constexpr std::size_t kFirstRead = std::size_t{4} << 10U;

    void read_request() {
        stream_.expires_after(std::chrono::seconds(parts_->limits.request_seconds));
        http::async_read(stream_, buffer_, *parser_,
                         [self = shared_from_this()](beast::error_code ec, std::size_t) {
                             self->on_request(ec);
                         });
    }

    void on_request(const beast::error_code& ec) {
        if (state_ == State::closed) {
            return;
        }
        if (ec) {
            head_ = false;  // of the previous request
            if (ec == http::error::header_limit || ec == http::error::body_limit) {
                keep_alive_ = false;
                answer({431, "text/plain", std::string("the request is too long\n")});
            } else if (ec.category() == http::make_error_code(http::error::bad_target).category() &&
                       ec != http::error::end_of_stream && ec != http::error::partial_message) {
                keep_alive_ = false;
                answer({400, "text/plain", std::string("not an HTTP request\n")});
            } else {
                close();
            }
            return;
        }
        const http::request<http::string_body>& message = parser_->get();
        // Repeated headers are joined; the result is none of the valid values.
        const auto header = [&](std::string_view name) {
            const auto [begin, end] =
                message.equal_range(beast::string_view(name.data(), name.size()));
            std::string all;
            for (auto field = begin; field != end; ++field) {
                all += (field == begin ? "" : ", ") + std::string(field->value());
            }
            return all;
        };
        keep_alive_ = message.keep_alive();
        head_ = message.method() == http::verb::head;
        HttpRequest request;
        request.method = head_ ? "GET" : std::string(message.method_string());
        request.target = std::string(message.target());
        request.host = message.count(http::field::host) == 1 ? header("Host") : "";
        request.origin = header("Origin");
        request.fetch_site = header("Sec-Fetch-Site");
        state_ = State::working;
        alive_ = shared_from_this();
        stream_.expires_never();
        const std::weak_ptr<Connection> weak = weak_from_this();
        const std::weak_ptr<Parts> parts = parts_;
        // The answer may come from another thread, and after the server has ended.
        work_ = parts_->handler->handle(request, [weak, parts](HttpAnswer made) {
            if (const std::shared_ptr<Parts> alive = parts.lock()) {
                auto held = std::make_shared<HttpAnswer>(std::move(made));
                asio::post(alive->io, [weak, held] {
                    if (const std::shared_ptr<Connection> self = weak.lock()) {
                        self->answer(std::move(*held));
                    }
                });
            }
        });
        if (work_) {
            watch_other_end();
        }
    }

    /// Detects that the client closes the connection, because it then needs no answer.
    void watch_other_end() {
        stream_.socket().async_wait(
            tcp::socket::wait_read, [self = shared_from_this()](const beast::error_code& ec) {
                if (ec || self->state_ != State::working) {
                    return;
                }
                char byte = 0;
                beast::error_code peeked;
                const std::size_t n = self->stream_.socket().receive(
                    asio::buffer(&byte, 1), tcp::socket::message_peek, peeked);
                if (peeked || n == 0) {
                    self->close();
                }  // otherwise the next request has arrived already and waits
            });
    }

    template <class Body>
    [[nodiscard]] http::response<Body> headers() const {
        http::response<Body> message{http::int_to_status(answer_.status), 11};
        message.set(http::field::server, "isonest/" ISONEST_VERSION);
        message.set(http::field::content_type, answer_.type);
        message.set(http::field::cache_control, "no-store");
        message.set("X-Content-Type-Options", "nosniff");
        message.set("Referrer-Policy", "no-referrer");
        message.set("Cross-Origin-Resource-Policy", "same-origin");
        // Allows only what this server sends; frames only in notebooks on this machine.
        message.set("Content-Security-Policy",
                    "default-src 'self'; script-src 'self' 'wasm-unsafe-eval'; style-src 'self'; "
                    "img-src 'self' data: blob:; worker-src 'self' blob:; object-src 'none'; "
                    "base-uri 'none'; form-action 'none'; "
                    "frame-ancestors 'self' http://localhost:* http://127.0.0.1:*");
        if (!answer_.file_name.empty()) {
            message.set(http::field::content_disposition,
                        fmt::format("attachment; filename=\"{}\"", answer_.file_name));
        }
        message.keep_alive(keep_alive_);
        return message;
    }

    /// REQUIRES: the text stays valid until it is sent, like answer_.
    void send_text(std::string_view text) {
        http::response<http::span_body<const char>> message =
            headers<http::span_body<const char>>();
        message.body() = {text.data(), text.size()};
        send(std::move(message));
    }

    template <class Body>
    void send(http::response<Body>&& message) {
        auto held = std::make_shared<http::response<Body>>(std::move(message));
        held->prepare_payload();
        if (held->result() == http::status::no_content) {
            held->erase(http::field::content_length);  // RFC 9110, 8.6
        }
        const std::uint64_t bytes = Body::size(held->body());
        stream_.expires_after(
            std::chrono::seconds(static_cast<std::uint64_t>(parts_->limits.answer_seconds) +
                                 bytes / parts_->limits.answer_bytes_per_second));
        auto serializer = std::make_shared<http::response_serializer<Body>>(*held);
        auto done = [self = shared_from_this(), held, serializer](beast::error_code ec,
                                                                  std::size_t) {
            self->parts_->sending_bytes -= self->sent_bytes_;
            self->sent_bytes_ = 0;
            self->answer_ = {};
            if (ec || !self->keep_alive_) {
                self->close();
            } else if (self->state_ != State::closed) {
                self->read();
            }
        };
        if (head_) {
            http::async_write_header(stream_, *serializer, std::move(done));
        } else {
            http::async_write(stream_, *serializer, std::move(done));
        }
    }

    std::shared_ptr<Parts> parts_;
    beast::tcp_stream stream_;
    beast::flat_buffer buffer_{std::size_t{64} << 10U};
    std::optional<http::request_parser<http::string_body>> parser_;
    std::shared_ptr<Waiting> work_;
    std::shared_ptr<Connection> alive_;  ///< keeps this object alive while it waits for an answer
    HttpAnswer answer_;
    std::size_t sent_bytes_ = 0;
    std::chrono::steady_clock::time_point since_ = std::chrono::steady_clock::now();
    State state_ = State::idle;
    bool keep_alive_ = true;
    bool head_ = false;
};

/// Closes the connection that has waited longest for a request, if there are too many.
bool HttpServer::Parts::make_room() {
    all.remove_if([](const std::weak_ptr<Connection>& c) {
        const std::shared_ptr<Connection> alive = c.lock();
        return !alive || alive->state() == Connection::State::closed;
    });
    if (all.size() < limits.connections) {
        return true;
    }
    std::shared_ptr<Connection> longest;
    for (const std::weak_ptr<Connection>& c : all) {
        const std::shared_ptr<Connection> alive = c.lock();
        if (alive && alive->state() == Connection::State::idle &&
            (!longest || alive->since() < longest->since())) {
            longest = alive;
        }
    }
    if (longest) {
        longest->close();
        return true;
    }
    return false;
}

void HttpServer::Parts::make_room_for_answer(std::size_t bytes, const Connection* but) {
    while (sending_bytes + bytes > limits.answer_bytes) {
        std::shared_ptr<Connection> slowest;
        for (const std::weak_ptr<Connection>& c : all) {
            const std::shared_ptr<Connection> alive = c.lock();
            if (alive && alive.get() != but && alive->state() == Connection::State::sending &&
                (!slowest || alive->since() < slowest->since())) {
                slowest = alive;
            }
        }
        if (!slowest) {
            return;
        }
        slowest->close();
    }
}

void HttpServer::Parts::accept(const std::shared_ptr<Parts>& self) {
    acceptor.async_accept([this, self](beast::error_code ec, tcp::socket socket) {
        if (ec == asio::error::operation_aborted) {
            return;
        }
        if (!ec && make_room()) {
            beast::error_code ignored;
            socket.set_option(tcp::no_delay(true), ignored);
            auto connection = std::make_shared<Connection>(self, std::move(socket));
            all.push_back(connection);
            connection->read();
        } else if (ec) {
            // For example, no file descriptors are left: tried again at the next clock tick.
            accepts = false;
            return;
        }
        accept(self);
    });
}

void HttpServer::Parts::watch(const std::shared_ptr<Parts>& self,
                              const std::function<bool()>& stop) {
    constexpr auto kOften = std::chrono::milliseconds(50);
    clock.expires_after(kOften);
    clock.async_wait([this, self, stop](beast::error_code) {
        if (!stop()) {
            if (!accepts) {
                accepts = true;
                accept(self);
            }
            watch(self, stop);
            return;
        }
        acceptor.close();
        for (const std::weak_ptr<Connection>& c : all) {
            if (const std::shared_ptr<Connection> alive = c.lock()) {
                alive->close();
            }
        }
        // Nothing is in progress then, and run() returns.
    });
}

HttpServer::HttpServer(const std::string& address, std::uint16_t port, const HttpLimits& limits)
    : parts_([&limits] {
          try {
              return std::make_shared<Parts>(limits);
          } catch (const boost::system::system_error& e) {  // no file descriptor for its event loop
              throw Error(ErrorKind::io, fmt::format("cannot start a server: {}", e.what()),
                          {{RemedyKind::raise_limit, "ulimit -n"}});
          }
      }()) {
    beast::error_code ec;
    const asio::ip::address ip = asio::ip::make_address(address, ec);
    if (ec) {
        throw Error(
            ErrorKind::invalid_argument,
            fmt::format("'{}' is not the address of a network interface (such as 127.0.0.1)",
                        address));
    }
    const tcp::endpoint endpoint(ip, port);
    tcp::acceptor& acceptor = parts_->acceptor;
    const auto step = [&](auto&& work) {
        work();
        if (ec) {
            throw Error(ErrorKind::io, fmt::format("cannot listen on {} port {}: {}", address, port,
                                                   ec.message()));
        }
    };
    step([&] { acceptor.open(endpoint.protocol(), ec); });
    step([&] { acceptor.set_option(asio::socket_base::reuse_address(true), ec); });
    step([&] { acceptor.bind(endpoint, ec); });
    step([&] { acceptor.listen(asio::socket_base::max_listen_connections, ec); });
}

HttpServer::~HttpServer() = default;

std::string HttpServer::address() const {
    beast::error_code ignored;
    return parts_->acceptor.local_endpoint(ignored).address().to_string();
}

std::uint16_t HttpServer::port() const {
    beast::error_code ignored;
    return parts_->acceptor.local_endpoint(ignored).port();
}

std::size_t HttpServer::connections() const {
    return static_cast<std::size_t>(
        std::count_if(parts_->all.begin(), parts_->all.end(), [](const auto& c) {
            const std::shared_ptr<Connection> alive = c.lock();
            return alive && alive->state() != Connection::State::closed;
        }));
}

void HttpServer::run(HttpHandler& handler, const std::function<bool()>& stop) {
    parts_->handler = &handler;
    parts_->accept(parts_);
    parts_->watch(parts_, stop);
    parts_->io.run();
}

}  // namespace isonest::detail::view
