// isonest view: shows a store in the browser.
#include <fmt/format.h>
#include <malloc.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <list>
#include <memory>
#include <optional>
#include <string>
#include <system_error>
#include <thread>
#include <utility>
#include <vector>

#include <isonest/error.h>
#include <isonest/store.h>
#include <isonest/vertex_fields.h>

#include "store/files/scratch_file.h"
#include "tools/cli/commands/input_store.h"
#include "tools/cli/commands/series_command.h"
#include "tools/cli/commands/vertex_values.h"
#include "tools/cli/options/series_options.h"
#include "tools/cli/options/units.h"
#include "tools/cli/program.h"
#include "tools/cli/terminal/interrupt.h"
#include "tools/view/http_server.h"
#include "tools/view/view_service.h"
#include "tools/view/viewed_steps.h"

namespace isonest::detail::cli {
namespace {

using view::Access;
using view::HttpServer;

constexpr std::uint64_t kMinMemory = std::uint64_t{512} << 20U;
constexpr std::uint16_t kFirstPort = 7310;
constexpr std::uint16_t kLastPort = 7329;

struct ViewArguments {
    InputArguments in;
    std::string address = "127.0.0.1";
    std::optional<std::uint16_t> port;
    bool open = false;
    bool token = false;
    bool json = false;
    std::uint64_t memory = std::uint64_t{1} << 30U;
    int threads = 0;
    std::string times;                      ///< the steps of a series; empty: all
    std::vector<std::string> quantities{};  ///< NAME=STORE, by which surfaces are coloured
};

/// Cancels when the server ends; displays nothing, because waits for the network are shown in the
/// page.
class WhileServing : public Progress {
  public:
    [[nodiscard]] bool cancelled() const override { return interrupted(); }
};

bool is_own_machine(const std::string& address) {
    return address.starts_with("127.") || address == "::1";
}

/// Listens at the requested port, otherwise at the first free one.
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

/// Returns whether the desktop's handler for URLs could be started.
bool open_browser(const std::string& url) {
    std::string program = "xdg-open";
    std::string argument = url;
    char* const arguments[] = {program.data(), argument.data(), nullptr};
    // The browser may outlive this program and must not inherit the listening socket.
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

/// `name`: of the store, the volume or the series.
void announce(const ViewArguments& a, const std::string& name, const std::string& url) {
    const std::string text = a.json ? Json{{"url", url}, {"store", name}, {"pid", ::getpid()}}.dump(
                                          -1, ' ', false, Json::error_handler_t::replace) +
                                          "\n"
                                    : fmt::format("{}\nPress Ctrl-C to stop.\n", url);
    if (std::fputs(text.c_str(), stdout) == EOF || std::fflush(stdout) != 0) {
        throw Error(ErrorKind::io, "cannot write to standard output");
    }
}

/// A temporary folder for the store of a volume. The store needs a file name because the page's
/// service watches the file.
class StoreFolder {
  public:
    StoreFolder() {
        std::string name = (temporary_folder() / "isonest-view-XXXXXX").string();
        if (::mkdtemp(name.data()) == nullptr) {
            throw Error(ErrorKind::io, {name}, "cannot create a folder for the store");
        }
        path_ = name;
        view::list_folder(path_);
    }
    StoreFolder(const StoreFolder&) = delete;
    StoreFolder& operator=(const StoreFolder&) = delete;
    ~StoreFolder() {
        std::error_code ignored;
        std::filesystem::remove_all(path_, ignored);
    }
    [[nodiscard]] const std::filesystem::path& path() const { return path_; }

  private:
    std::filesystem::path path_;
};

/// File name of the store of a volume: "scan.isonest" for "data/scan.nii.gz".
std::string store_name(const std::string& volume) {
    const std::string name = std::filesystem::path(volume).filename().string();
    const std::string stem = name.substr(0, name.find('.', 1));
    return (stem.empty() || stem == "-" ? "volume" : stem) + ".isonest";
}

/// What is shown until the server ends; `folder` and `input` are empty for a series.
struct Viewed {
    std::optional<StoreFolder> folder;
    InputStore input;
    std::list<InputStore> others;  ///< of the quantities
    std::unique_ptr<view::ViewedSteps> steps;
    std::string name;
};

std::vector<view::Quantity> open_quantities(const ViewArguments& a, std::uint64_t& memory,
                                            Progress& progress, Viewed& viewed) {
    std::vector<view::Quantity> quantities;
    std::vector<VertexField> fields;
    for (const std::string& text : a.quantities) {
        const std::optional<NamedValues> named = parse_named_values(text);
        if (!named || named->sources.size() != 1) {
            throw Error(ErrorKind::invalid_argument,
                        fmt::format("--vertex-values '{}': give NAME=STORE with one store: the "
                                    "page colours by a number, not by a vector",
                                    text));
        }
        InputArguments source = arguments_of_source(named->sources.front(), a.in.remote);
        viewed.others.push_back(
            open_or_make_store(source, {{}, {}, {}, 0, a.threads}, memory, progress));
        quantities.push_back({named->name, &viewed.others.back().store()});
        fields.push_back({named->name, {quantities.back().store}});
    }
    if (!fields.empty()) {
        const VertexFields checked(std::move(fields), {memory / 16, a.threads});
    }
    return quantities;
}

/// `serving` is used by a remote store as long as it is open.
void open_viewed(ViewArguments& a, Progress& progress, Progress& serving, Viewed& viewed) {
    if (const std::optional<Series> series = open_if_series(a.in, nullptr)) {
        if (!a.in.keep.empty()) {
            throw Error(ErrorKind::invalid_argument, {a.in.shown()},
                        "is a series, so no temporary store is made: leave out --keep-store");
        }
        const std::vector<std::size_t> steps =
            series->steps().empty() ? std::vector<std::size_t>() : chosen_steps(*series, a.times);
        if (!a.quantities.empty()) {
            throw Error(ErrorKind::invalid_argument, {a.in.shown()},
                        "is a series; with --vertex-values, give the store of one of its steps");
        }
        viewed.steps = std::make_unique<view::ViewedSteps>(
            *series, steps, view::MemoryShares(a.memory), a.threads, progress);
        viewed.name = series->folder().string();
        return;
    }
    require_no_times(a.times, a.in.shown());
    InputStore& input = viewed.input;
    input.opened = open_if_store(a.in, a.memory, serving);
    if (!input.opened) {
        const std::unique_ptr<VolumeSource> volume =
            open_input_volume(a.in, a.memory, temporary_folder(), progress);
        std::filesystem::path name = a.in.keep;
        if (name.empty()) {
            viewed.folder.emplace();
            name = viewed.folder->path() / store_name(a.in.shown());
        }
        input.made.emplace(make_store_of(*volume, a.in.shown(),
                                         {name, {}, default_indicators(), a.memory, a.threads},
                                         progress));
    }
    std::vector<view::Quantity> quantities = open_quantities(a, a.memory, serving, viewed);
    viewed.steps = std::make_unique<view::ViewedSteps>(input.store(), view::MemoryShares(a.memory),
                                                       a.threads, std::move(quantities));
    viewed.name = input.name();
}

Result run(ViewArguments& a, Progress& progress) {
    if (a.memory < kMinMemory) {
        throw Error(ErrorKind::limit, {a.in.shown()},
                    fmt::format("{} of memory is not enough for the viewer",
                                human_bytes(static_cast<double>(a.memory))),
                    {{RemedyKind::more_memory, fmt::format("{}", kMinMemory)}});
    }
    // WorkLane returns freed memory with malloc_trim(), which shrinks only the first arena, so all
    // threads share that one. An answer allocates some ten thousand blocks, too few for contention
    // to matter.
    ::mallopt(M_ARENA_MAX, 1);
    WhileServing serving;  // declared first: the stores may use it
    Viewed viewed;
    open_viewed(a, progress, serving, viewed);
    view::HttpLimits limits;
    const view::MemoryShares shares(a.memory);
    limits.answer_bytes = shares.sending;
    const std::unique_ptr<HttpServer> server = listen(a, limits);
    Access access;
    access.address = server->address();  // in the form that browsers send
    access.port = server->port();
    access.any_address = access.address == "0.0.0.0" || access.address == "::";
    if (a.token || !is_own_machine(access.address)) {
        access.token = view::new_token();
    }
    const std::string url = url_of(access);
    {
        view::ViewService service(*viewed.steps, shares, a.threads, access,
                                  [&server] { return server->connections(); });
        before_a_bus_error_ends_the_program(&view::remove_listed_folders);
        announce(a, viewed.name, url);
        if (a.open) {
            // If no browser is running, the desktop's handler may run as long as the browser that
            // it starts.
            std::thread([url] {
                if (!open_browser(url) && !interrupted()) {
                    std::fputs("isonest: warning: cannot open a browser; open the URL yourself\n",
                               stderr);
                }
            }).detach();
        }
        server->run(service, interrupted);
    }
    Result result;
    result.json = {{"url", url}, {"ended", true}};
    if (const Store& store = viewed.steps->first().store; store.is_remote()) {
        result.json["remote"] = fetched_json(store.fetched());
    }
    return result;
}

}  // namespace

void add_view(CLI::App& app, Invocation& chosen) {
    const auto a = std::make_shared<ViewArguments>();
    CLI::App* const c = add_command(
        app, chosen, "view",
        {"Show a store, a series or a volume in the browser",
         "Serves a page with the surface, slices and the histogram, and prints its URL (with "
         "--json, in the first line). The page always shows the error bound of what it displays. "
         "Only this machine can open it, unless --address names another interface; the URL then "
         "contains a token. Ctrl-C or a termination signal ends the server, with exit code 0. For "
         "a volume, a temporary store is made. For a series, the page has a slider of time.",
         "isonest view scan.isonest\n"
         "isonest view scan.nii.gz --open\n"
         "isonest view run.isonest --times 0:100:10\n"
         "isonest view temperature.isonest --vertex-values pressure=p.isonest\n"
         "isonest view https://example.org/scan.isonest --cache ~/.cache/isonest:2G\n"
         "isonest view scan.isonest --address 0.0.0.0 --port 8080 --memory 2G"});
    add_input_options(c, a->in, false);
    add_parsed(
        c, "--port",
        [a](const std::string& text) {
            constexpr int kMax = 65535;
            a->port = static_cast<std::uint16_t>(parse_integer("--port", text, 0, kMax));
        },
        fmt::format("from {}", kFirstPort));
    c->add_option("--address", a->address);
    c->add_flag("--token", a->token);
    c->add_flag("--open", a->open);
    c->add_option("--vertex-values", a->quantities)->allow_extra_args(false);
    c->add_option("--times", a->times);
    add_memory(c, a->memory);
    add_threads(c, a->threads);
    c->callback([a, c, &chosen] {
        note_source_option(*c, a->in);
        chosen.run = [a, &chosen](Progress& progress) {
            require_remote(a->in.remote, a->in.input);
            a->json = chosen.json;
            return run(*a, progress);
        };
    });
}

}  // namespace isonest::detail::cli
