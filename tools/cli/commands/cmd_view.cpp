// isonest view: a store in a window of the browser.
#include <fmt/format.h>
#include <malloc.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdio>
#include <memory>
#include <optional>
#include <thread>

#include <isonest/error.h>
#include <isonest/store.h>

#include "store/remote/open_location.h"
#include "tools/cli/command.h"
#include "tools/cli/options/remote_options.h"
#include "tools/cli/options/units.h"
#include "tools/cli/terminal/interrupt.h"
#include "tools/view/http_server.h"
#include "tools/view/listed_folders.h"
#include "tools/view/view_service.h"

namespace isonest::detail::cli {
namespace {

using view::Access;
using view::HttpServer;

constexpr std::uint64_t kLeastMemory = std::uint64_t{512} << 20U;
constexpr std::uint16_t kFirstPort = 7310;
constexpr std::uint16_t kLastPort = 7329;

struct ViewArguments {
    std::string store;
    std::string address = "127.0.0.1";
    std::optional<std::uint16_t> port;
    bool open = false;
    bool token = false;
    bool json = false;
    std::uint64_t memory = std::uint64_t{1} << 30U;
    int threads = 0;
    RemoteArguments remote;
};

/// Ends with the server, and shows nothing: who waits for the network are the page's requests.
class WhileServing : public Progress {
  public:
    [[nodiscard]] bool cancelled() const override { return interrupted(); }
};

bool is_own_machine(const std::string& address) {
    return address.starts_with("127.") || address == "::1";
}

/// At the port asked for, or at the first free one.
std::unique_ptr<HttpServer> listen(const ViewArguments& a, const view::HttpLimits& limits) {
    if (a.port) {
        return std::make_unique<HttpServer>(a.address, *a.port, limits);
    }
    for (std::uint16_t port = kFirstPort; port <= kLastPort; ++port) {
        try {
            return std::make_unique<HttpServer>(a.address, port, limits);
        } catch (const Error& e) {
            if (e.kind() != ErrorKind::io) {
                throw;
            }
        }
    }
    return std::make_unique<HttpServer>(a.address, 0, limits);
}

std::string url_of(const Access& access) {
    const std::string host = access.any_address ? "localhost"
                             : access.address.find(':') != std::string::npos
                                 ? "[" + access.address + "]"
                                 : access.address;
    return fmt::format("http://{}:{}/{}", host, access.port,
                       access.token.empty() ? "" : "?token=" + access.token);
}

/// Whether the desktop's program for URLs could be started.
bool open_browser(const std::string& url) {
    std::string program = "xdg-open";
    std::string argument = url;
    char* const arguments[] = {program.data(), argument.data(), nullptr};
    // A browser that outlives this program must not hold its port.
    posix_spawn_file_actions_t actions;
    ::posix_spawn_file_actions_init(&actions);
    ::posix_spawn_file_actions_addclosefrom_np(&actions, STDERR_FILENO + 1);
    pid_t child = 0;
    const int failed =
        ::posix_spawnp(&child, program.c_str(), &actions, nullptr, arguments, environ);
    ::posix_spawn_file_actions_destroy(&actions);
    if (failed != 0) {
        return false;
    }
    int status = 0;
    return ::waitpid(child, &status, 0) == child && WIFEXITED(status) && WEXITSTATUS(status) == 0;
}

void announce(const ViewArguments& a, const std::string& url) {
    const std::string text =
        a.json ? Json{{"url", url}, {"store", shown_location(a.store)}, {"pid", ::getpid()}}.dump(
                     -1, ' ', false, Json::error_handler_t::replace) +
                     "\n"
               : fmt::format("{}\nCtrl-C ends it.\n", url);
    if (std::fputs(text.c_str(), stdout) == EOF || std::fflush(stdout) != 0) {
        throw Error(ErrorKind::io, "cannot write to standard output");
    }
}

Result run(ViewArguments& a) {
    if (a.memory < kLeastMemory) {
        throw Error(ErrorKind::limit, {shown_location(a.store)},
                    fmt::format("{} of memory are too little for a window",
                                human_bytes(static_cast<double>(a.memory))),
                    {{RemedyKind::more_memory, fmt::format("{}", kLeastMemory)}});
    }
    // WorkLane returns freed memory by malloc_trim(), which gives back the end of the first arena
    // alone: so all threads share that one. An answer takes some ten thousand blocks, few enough
    // for threads not to wait for each other.
    ::mallopt(M_ARENA_MAX, 1);
    WhileServing serving;
    const Store store = open_store(a.store, a.remote, a.memory, serving);
    const view::MemoryShares shares(a.memory);
    view::HttpLimits limits;
    limits.answer_bytes = shares.sending;
    const std::unique_ptr<HttpServer> server = listen(a, limits);
    Access access;
    access.address = server->address();  // as browsers write it
    access.port = server->port();
    access.any_address = access.address == "0.0.0.0" || access.address == "::";
    if (a.token || !is_own_machine(access.address)) {
        access.token = view::new_token();
    }
    const std::string url = url_of(access);
    {
        view::ViewService service(store, shares, a.threads, access,
                                  [&server] { return server->connections(); });
        before_a_bus_error_ends_the_program(&view::remove_listed_folders);
        announce(a, url);
        if (a.open) {
            // Where no browser runs yet, the desktop's program may last as long as the new one.
            std::thread([url] {
                if (!open_browser(url) && !interrupted()) {
                    std::fputs(
                        "isonest: warning: no browser could be opened: open the URL by hand\n",
                        stderr);
                }
            }).detach();
        }
        server->run(service, interrupted);
    }
    Result result;
    result.json = {{"url", url}, {"ended", true}};
    if (store.is_remote()) {
        result.json["remote"] = fetched_json(store.fetched());
    }
    return result;
}

}  // namespace

void add_view(CLI::App& app, Invocation& chosen) {
    const auto a = std::make_shared<ViewArguments>();
    CLI::App* const c = add_command(
        app, chosen, "view",
        {"Look at a store in a window of the browser",
         "Serves a page with the surface, slices and the histogram, and prints its URL. What is "
         "on\n"
         "the screen always says how wrong it can be. Only this machine can open the page, unless\n"
         "--address names another one; the URL then holds a token. Ctrl-C ends the server; so "
         "does\n"
         "a signal, with exit code 0. With --json the first line says the URL.",
         "isonest view scan.isonest\n"
         "isonest view scan.isonest --open\n"
         "isonest view https://example.org/scan.isonest --cache ~/.cache/isonest:2G\n"
         "isonest view scan.isonest --address 0.0.0.0 --port 8080 --memory 2G"});
    c->add_option("STORE", a->store, "made by isonest preprocess: a file or a URL")->required();
    add_parsed(
        c, "--port",
        [a](const std::string& text) {
            constexpr int kMost = 65535;
            a->port = static_cast<std::uint16_t>(parse_integer("--port", text, 0, kMost));
        },
        fmt::format("to listen on; 0 = any that is free [the first free one from {} on]",
                    kFirstPort),
        "P");
    c->add_option("--address", a->address,
                  "of the network interface; 0.0.0.0 = all of them [127.0.0.1]")
        ->type_name("IP");
    c->add_flag("--token", a->token, "ask for a token on this machine too (it has other users)");
    c->add_flag("--open", a->open, "open the page in the desktop's browser");
    add_memory(c, a->memory);
    add_threads(c, a->threads);
    add_remote_options(c, a->remote);
    c->callback([a, &chosen] {
        chosen.run = [a, &chosen](Progress& /*progress*/) {
            require_far(a->remote, {a->store});
            a->json = chosen.json;
            return run(*a);
        };
    });
}

}  // namespace isonest::detail::cli
