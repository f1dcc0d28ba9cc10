// isonest publish: whether a web server shows stores to pages that read them by themselves.
#include <fmt/format.h>

#include <memory>
#include <string>

#include <isonest/error.h>

#include "store/remote/open_location.h"
#include "tools/cli/command.h"
#include "tools/publish/check_server.h"

namespace isonest::detail::cli {
namespace {

constexpr const char* kAnyOrigin = "https://example.org";

struct PublishArguments {
    std::string checked;  ///< a URL
    std::string origin = kAnyOrigin;
};

Result check(const PublishArguments& a, Progress& progress) {
    const publish::ServerCheck found = publish::check_server(a.checked, a.origin, progress);
    const std::string shown = shown_location(a.checked);
    Result result;
    result.json = {{"url", shown},
                   {"kind", found.is_site ? "site" : "store"},
                   {"right", found.is_right()},
                   {"findings", Json::array()},
                   {"lines", Json::array()}};
    std::string url;
    for (const publish::ServerFinding& finding : found.findings) {
        const bool is_right = finding.fault == publish::ServerFault::none;
        const std::string state = is_right            ? "right"
                                  : finding.is_needed ? "wrong"
                                                      : "could be better";
        const std::string place = shown_location(finding.url);
        if (place != url) {
            url = place;
            result.text += url + "\n";
        }
        result.text += fmt::format("  {:<16} {:<15} {}\n", finding.what, state, finding.found);
        result.json["findings"].push_back({{"url", place},
                                           {"what", finding.what},
                                           {"state", state},
                                           {"fault", publish::name_of(finding.fault)},
                                           {"found", finding.found}});
    }
    for (const publish::ServerLines& lines : publish::lines_to_add(found)) {
        result.text += fmt::format("\nFor {}, {}:\n{}", lines.server, lines.where, lines.lines);
        result.json["lines"].push_back(
            {{"server", lines.server}, {"where", lines.where}, {"lines", lines.lines}});
    }
    result.text += found.is_right() ? "\nThis server shows it.\n"
                                    : "\nThis server does not show it as it is.\n";
    result.exit_code = found.is_right() ? 0 : static_cast<int>(ErrorKind::unsupported);
    return result;
}

}  // namespace

void add_publish(CLI::App& app, Invocation& chosen) {
    const auto a = std::make_shared<PublishArguments>();
    CLI::App* const c = add_command(
        app, chosen, "publish",
        {"Look whether a web server shows stores to pages without a server",
         "A page can read a store by itself from a server that answers requests for parts of a "
         "file, and,\n"
         "where it lies on another one than the page, lets pages of others read it. Says what a "
         "server\n"
         "does, and what to change for nginx, Apache and S3; exits with 5 if something is needed "
         "that\n"
         "it does not do.",
         "isonest publish --check https://example.org/data/scan.isonest\n"
         "isonest publish --check https://example.org/data/scan.isonest --origin "
         "https://me.example.net"});
    c->add_option("--check", a->checked, "the URL of a store, or of a page that names its stores")
        ->required()
        ->type_name("URL");
    c->add_option(
         "--origin", a->origin,
         fmt::format("for a store: the server of the page that is to read it [{}]", kAnyOrigin))
        ->type_name("URL");
    c->callback(
        [a, &chosen] { chosen.run = [a](Progress& progress) { return check(*a, progress); }; });
}

}  // namespace isonest::detail::cli
