// isonest publish: writes a site that shows stores on any web server, and checks servers (--check).
#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <memory>
#include <optional>
#include <set>
#include <utility>

#include <isonest/error.h>
#include <isonest/series.h>
#include <isonest/store.h>

#include "store/container/reader.h"
#include "store/remote/object_url.h"
#include "store/remote/open_location.h"
#include "tools/cli/commands/series_command.h"
#include "tools/cli/options/remote_options.h"
#include "tools/cli/options/series_options.h"
#include "tools/cli/options/units.h"
#include "tools/cli/program.h"
#include "tools/cli/terminal/interrupt.h"
#include "tools/cli/terminal/terminal_text.h"
#include "tools/publish/check_server.h"
#include "tools/publish/site.h"

namespace isonest::detail::cli {
namespace {

using publish::public_url;
using publish::Site;
using publish::SiteSeries;
using publish::SiteStore;

constexpr const char* kAnyOrigin = "https://example.org";
/// Enough to open stores; no values are read.
constexpr std::uint64_t kMemory = std::uint64_t{256} << 20U;

struct PublishArguments {
    std::vector<std::string> stores;
    std::string output;
    std::vector<std::string> links;
    std::vector<std::string> titles;
    std::vector<std::string> descriptions;
    std::vector<std::string> licenses;
    bool hard_links = false;
    bool force = false;
    std::string times;    ///< the steps of series; empty: all
    std::string checked;  ///< a URL
    std::string origin = kAnyOrigin;
    std::vector<publish::PageFile> page;
};

/// The name of a file, folder or URL without its folder and extension.
std::string short_name(const std::string& location) {
    std::string path =
        location.substr(0, is_url(location) ? location.find_first_of("?#") : std::string::npos);
    while (path.size() > 1 && path.ends_with('/')) {
        path.pop_back();
    }
    std::string name = path.substr(path.rfind('/') + 1);
    if (name.ends_with(".isonest")) {
        name.resize(name.size() - std::string_view(".isonest").size());
    }
    return name;
}

/// The name with every character except letters, digits and "._-" replaced, for use in links.
std::string name_in_links(std::string name) {
    for (char& c : name) {
        const bool is_plain = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') ||
                              (c >= '0' && c <= '9') || c == '.' || c == '_' || c == '-';
        c = is_plain ? c : '-';
    }
    return name.empty() || name.front() == '.' ? "store" + name : name;
}

/// The value for store `i` of an option that is given once for all stores or once per store.
std::string said_of(const std::vector<std::string>& values, std::size_t i) {
    return values.empty() ? "" : values.size() == 1 ? values[0] : values[i];
}

void require_count(const char* option, const std::vector<std::string>& values, std::size_t stores) {
    if (values.size() > 1 && values.size() != stores) {
        throw Error(
            ErrorKind::invalid_argument,
            fmt::format("{} is given {} times for {} store{}; give it once, or once per store",
                        option, values.size(), stores, stores == 1 ? "" : "s"));
    }
}

void check_counts(const PublishArguments& a) {
    const std::size_t stores = a.stores.size();
    require_count("--title", a.titles, stores);
    require_count("--description", a.descriptions, stores);
    require_count("--license", a.licenses, stores);
    require_count("--link", a.links, stores);
    if (a.links.size() == 1 && stores > 1 && !a.links[0].ends_with('/')) {
        throw Error(ErrorKind::invalid_argument,
                    "--link is given once for several stores: end it with / if it is the folder of "
                    "all of them, or give it once per store");
    }
}

std::string link_of(const PublishArguments& a, std::size_t i) {
    if (a.links.empty()) {
        return is_url(a.stores[i]) ? public_url(a.stores[i]) : "";
    }
    const std::string& link = said_of(a.links, i);
    if (!link.ends_with('/')) {
        return public_url(link);
    }
    std::string store = a.stores[i];
    while (store.size() > 1 && store.ends_with('/')) {
        store.pop_back();
    }
    const std::string name = store.substr(store.rfind('/') + 1);
    // A file name may contain # or ?; a URL is already encoded.
    return public_url(link + (is_url(store) ? name : publish::percent_encoded(name)));
}

Store open_for_page(const std::string& location, Progress& progress) {
    RemoteArguments remote;
    std::uint64_t memory = kMemory;
    Store opened = open_required_store(location, remote, memory, progress);
    require_even_axes(opened.reader().layout().header(), shown_location(location), "a page");
    if (opened.reader().catalogue() == nullptr) {
        throw Error(ErrorKind::unsupported, {shown_location(location)},
                    fmt::format("is a store of version {}, without the footer that pages need",
                                opened.reader().version().text()),
                    {{RemedyKind::preprocess_again}});
    }
    return opened;
}

/// The properties of the store, or of the first step of a series.
void describe(const Store& opened, SiteStore& store) {
    store.nodes = opened.nodes();
    store.type = name_of(opened.type());
    store.unit = opened.unit() ? std::string(symbol_of(*opened.unit())) : "";
}

void describe_steps(const PublishArguments& a, std::size_t i, Progress& progress,
                    SiteStore& store) {
    const Series series(a.stores[i]);
    if (series.steps().empty()) {
        throw Error(ErrorKind::invalid_argument, {series.folder().string()},
                    "is a series without steps: nothing can be shown yet");
    }
    std::string link = link_of(a, i);
    if (link.find('?') != std::string::npos) {
        throw Error(ErrorKind::invalid_argument, {series.folder().string()},
                    "is a series: --link has to be the URL of its folder, without a query");
    }
    link += link.empty() || link.ends_with('/') ? "" : "/";
    SiteSeries& all = store.series.emplace();
    all.time_unit = series.time_unit();
    std::optional<Store> first;
    for (const std::size_t step : chosen_steps(series, a.times)) {
        progress.check();
        Store opened = open_for_page(series.store(step).string(), progress);
        const SeriesStep& listed = series.steps()[step];
        const std::string url = link.empty() ? "" : link + publish::percent_encoded(listed.store);
        const std::uint64_t bytes = opened.reader().file_bytes();
        all.steps.push_back({listed.time, listed.store,
                             link.empty() ? series.store(step) : std::filesystem::path(), url,
                             bytes});
        store.bytes += bytes;
        store.tolerance = std::max(store.tolerance, opened.rounding().tolerance);
        if (opened.min_value() <= opened.max_value()) {
            all.min_value =
                std::min(all.min_value.value_or(opened.min_value()), opened.min_value());
            all.max_value =
                std::max(all.max_value.value_or(opened.max_value()), opened.max_value());
        }
        if (first) {
            require_same_place(*first, opened);
        } else {
            describe(opened, store);
            first.emplace(std::move(opened));
        }
    }
}

SiteStore described(const PublishArguments& a, std::size_t i, Progress& progress) {
    SiteStore store;
    if (!is_url(a.stores[i])) {
        store.described_by = a.stores[i];
    }
    if (is_series(a.stores[i])) {
        describe_steps(a, i, progress, store);
    } else {
        require_no_times(a.times, shown_location(a.stores[i]));
        const Store opened = open_for_page(a.stores[i], progress);
        describe(opened, store);
        store.bytes = opened.reader().file_bytes();
        store.tolerance = opened.rounding().tolerance;
        store.url = link_of(a, i);
        if (store.url.empty()) {
            store.file = a.stores[i];
        }
    }
    store.name = name_in_links(short_name(a.stores[i]));
    // With several stores, titles and descriptions that are given once belong to the site.
    const bool each = a.stores.size() == 1;
    const auto own = [&](const std::vector<std::string>& values) {
        return each || values.size() > 1 ? said_of(values, i) : std::string();
    };
    store.about = {own(a.titles), own(a.descriptions), own(a.licenses)};
    if (store.about.title.empty()) {
        store.about.title = short_name(a.stores[i]);
    }
    return store;
}

void give_own_names(std::vector<SiteStore>& stores) {
    std::set<std::string> taken;
    for (SiteStore& store : stores) {
        const std::string name = store.name;
        for (int i = 2; !taken.insert(store.name).second; ++i) {
            store.name = fmt::format("{}-{}", name, i);
        }
    }
}

Site site_of(const PublishArguments& a, Progress& progress) {
    check_counts(a);
    Site site;
    site.hard_links = a.hard_links;
    for (std::size_t i = 0; i < a.stores.size(); ++i) {
        site.stores.push_back(described(a, i, progress));
    }
    give_own_names(site.stores);
    const bool one = site.stores.size() == 1;
    const auto once = [&](const std::vector<std::string>& values) {
        return values.size() == 1 ? values[0] : std::string();
    };
    site.about = {once(a.titles), once(a.descriptions), once(a.licenses)};
    if (site.about.title.empty()) {
        site.about.title =
            one ? site.stores[0].about.title : fmt::format("{} volumes", site.stores.size());
    }
    return site;
}

std::string frame_line(const SiteStore& store) {
    std::string title;
    for (const char c : store.about.title) {
        title += c == '"' ? "&quot;" : c == '&' ? "&amp;" : c == '<' ? "&lt;" : std::string(1, c);
    }
    return fmt::format(
        "<iframe src=\"https://YOUR.HOST/PATH/?store={}\" title=\"{}\" "
        "width=\"960\" height=\"640\" loading=\"lazy\"></iframe>",
        store.name, title);
}

Result write(const PublishArguments& a, Progress& progress) {
    if (!publish::has_library(a.page)) {
        throw Error(ErrorKind::unsupported,
                    "this build cannot write sites: it lacks the WebAssembly library",
                    {{RemedyKind::install_package, kPublishNeeds}});
    }
    if (a.output.empty()) {
        throw Error(ErrorKind::invalid_argument, "give the folder to write with -o");
    }
    const Site site = site_of(a, progress);
    const std::vector<std::string> files =
        publish::write_site(a.output, site, a.page, a.force, progress);
    Result result;
    result.warning =
        leftovers_of(a.output.ends_with('/') ? a.output.substr(0, a.output.size() - 1) : a.output);
    result.json = {{"output", a.output}, {"files", files}, {"stores", Json::array()}};
    std::uint64_t bytes = 0;
    std::string frames;
    std::string rounded;
    for (const SiteStore& store : site.stores) {
        if (store.tolerance > 0) {
            rounded += fmt::format("{}: values rounded within {:.6g}, as the page says\n",
                                   store.name, store.tolerance);
        }
        const std::string frame = frame_line(store);
        frames += frame + "\n";
        const bool is_here =
            store.series ? !store.series->steps.front().file.empty() : !store.file.empty();
        bytes += is_here ? store.bytes : 0;
        result.json["stores"].push_back({{"name", store.name},
                                         {"url", publish::url_in_site(store)},
                                         {"bytes", store.bytes},
                                         {"tolerance", store.tolerance},
                                         {"iframe", frame}});
        if (store.series) {
            result.json["stores"].back()["steps"] = store.series->steps.size();
        }
    }
    result.text = fmt::format(
        "{}: {} files, with {} of stores. Put the folder on a web server, then:\n"
        "  isonest publish --check https://YOUR.HOST/PATH/\n"
        "In a page of your own:\n{}{}",
        a.output, files.size(), human_bytes(static_cast<double>(bytes)), frames, rounded);
    return result;
}

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
            result.text += shown_text(url) + "\n";
        }
        result.text +=
            fmt::format("  {:<16} {:<15} {}\n", finding.what, state, shown_text(finding.found));
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
    result.text += found.is_right()
                       ? "\nThis server can serve the site.\n"
                       : "\nThis server cannot serve the site with its current configuration.\n";
    result.exit_code = found.is_right() ? 0 : static_cast<int>(ErrorKind::unsupported);
    return result;
}

}  // namespace

void add_publish(CLI::App& app, Invocation& chosen, const std::vector<publish::PageFile>& page) {
    const auto a = std::make_shared<PublishArguments>();
    a->page = page;
    const std::string lacking =
        publish::has_library(page)
            ? ""
            : fmt::format(
                  "\nThis build only checks servers: to write sites, install {} (Debian) "
                  "and build isonest again.",
                  kPublishNeeds);
    CLI::App* const c = add_command(
        app, chosen, "publish",
        {"Write a site that shows stores, for any web server",
         "The folder contains the viewer's page, a library that runs in the browser, and the "
         "stores. The server only has to support range requests; --check tests this, and says what "
         "to change for nginx, Apache and S3 (exit code 5 if something required is missing). A "
         "single --link for several stores is the URL of their folder and ends with /; for a "
         "series, "
         "--link is the URL of its folder, and the page has a slider of time. The folder "
         "appears only when it is complete." +
             lacking,
         "isonest publish scan.isonest -o site\n"
         "isonest publish scan.isonest -o site --link https://example.org/data/scan.isonest\n"
         "isonest publish head.isonest foot.isonest -o site --title Head --title Foot\n"
         "isonest publish run.isonest -o site --times 0:100:10\n"
         "isonest publish --check https://example.org/site/"});
    CLI::Option* const stores = c->add_option("STORE", a->stores);
    CLI::Option* const output = c->add_option("-o,--output", a->output);
    CLI::Option* const link = c->add_option("--link", a->links)->allow_extra_args(false);
    CLI::Option* const hard = c->add_flag("--hard-link", a->hard_links);
    CLI::Option* const times = c->add_option("--times", a->times);
    std::vector<CLI::Option*> others{output, link, hard, times};
    for (const auto& [name, values] :
         {std::pair{"--title", &a->titles}, std::pair{"--description", &a->descriptions},
          std::pair{"--license", &a->licenses}}) {
        others.push_back(c->add_option(name, *values)->allow_extra_args(false));
    }
    others.push_back(c->add_flag("--force", a->force));
    CLI::Option* const check_option = c->add_option("--check", a->checked);
    c->add_option("--origin", a->origin, kAnyOrigin)->needs(check_option);
    check_option->excludes(stores);
    for (CLI::Option* const other : others) {
        check_option->excludes(other);
    }
    hard->excludes(link);
    c->callback([a, stores, &chosen] {
        chosen.run = [a, has_stores = stores->count() > 0](Progress& progress) {
            if (!a->checked.empty()) {
                return check(*a, progress);
            }
            if (!has_stores) {
                throw Error(ErrorKind::invalid_argument,
                            "give the stores to publish, or --check URL");
            }
            return write(*a, progress);
        };
    });
}

}  // namespace isonest::detail::cli
