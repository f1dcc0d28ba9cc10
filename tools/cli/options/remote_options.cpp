#include "tools/cli/options/remote_options.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <fstream>
#include <utility>

#include "store/container/reader.h"
#include "store/remote/object_url.h"
#include "store/remote/open_location.h"
#include "tools/cli/options/cache_option.h"
#include "tools/cli/options/units.h"

namespace isonest::detail::cli {
namespace {

constexpr std::uint64_t kMostAside = std::uint64_t{256} << 20U;
constexpr std::size_t kMostHeaderFile = std::size_t{1} << 20U;

/// Throws Error{invalid_argument}, which does not quote it.
void require_header(const std::string& header, const std::string& where) {
    if (!is_header(header)) {
        throw Error(
            ErrorKind::invalid_argument,
            where +
                ": give a header as 'Name: value', or @FILE with one in each line; those about "
                "ranges and states of the object are isonest's own");
    }
}

/// A header, or a file of headers: its empty lines are left out.
void take_headers(const std::string& text, std::vector<std::string>& headers) {
    if (!text.starts_with('@')) {
        require_header(text, "--header");
        headers.push_back(text);
        return;
    }
    const std::string path = text.substr(1);
    std::ifstream in(path, std::ios::binary);
    if (!in) {
        throw Error(ErrorKind::not_found, {path}, "cannot be read for --header");
    }
    std::size_t read = 0;
    int number = 1;
    for (std::string line; std::getline(in, line); ++number) {
        read += line.size() + 1;
        if (read > kMostHeaderFile) {
            throw Error(ErrorKind::invalid_argument, {path}, "is too long for a file of headers");
        }
        line.erase(line.find_last_not_of(" \t\r") + 1);
        if (!line.empty()) {
            require_header(line, fmt::format("{}: line {}", path, number));
            headers.push_back(std::move(line));
        }
    }
}

std::uint64_t share_for_fetching(std::uint64_t memory) {
    return std::clamp(memory / 4, RemoteAccess::kLeastMemory, kMostAside);
}

/// Sets a share of the memory aside.
RemoteAccess access_to(const std::string& location, RemoteArguments& a, std::uint64_t& memory,
                       Progress& progress, const std::string& first) {
    const std::uint64_t share = share_for_fetching(memory);
    ++a.opened;
    memory -= std::min(memory, share);
    RemoteAccess remote;
    if (first.empty() || (is_url(first) && origin_of(first) == origin_of(location))) {
        remote.headers = a.headers;
    }
    remote.cache = a.cache;
    remote.cache_bytes = a.cache_bytes;
    remote.memory = share;
    remote.check = [&progress] {
        progress.advance(0);  // so that what is shown goes on
        progress.check();
    };
    progress.begin("opening", 0, "");
    progress.check();
    return remote;
}

void add_warning(const std::string& warning, Result& result) {
    result.warning += result.warning.empty() || warning.empty() ? warning : "\n" + warning;
}

}  // namespace

void add_remote_options(CLI::App* command, RemoteArguments& a) {
    command
        ->add_option_function<std::vector<std::string>>(
            "--header",
            [&a](const std::vector<std::string>& texts) {
                for (const std::string& text : texts) {
                    take_headers(text, a.headers);
                }
            },
            "of an input at a URL: sent with each request, to its own server\n"
            "alone ('Authorization: Bearer ...'); @FILE has one in each line,\n"
            "so that no other user sees it; may be given several times")
        ->type_name("HEADER")
        ->allow_extra_args(false);
    add_parsed(
        command, "--cache",
        [&a](const std::string& text) {
            const CacheChoice choice = parse_cache("--cache", text);
            a.cache = choice.folder;
            a.cache_bytes = choice.bytes;
        },
        "of an input at a URL: keep what was fetched in this folder, up to\n"
        "SIZE [1G]; other runs use it as long as the object is the same",
        "FOLDER[:SIZE]");
}

void require_far(const RemoteArguments& a, const std::vector<std::string>& inputs) {
    const bool far = std::any_of(inputs.begin(), inputs.end(),
                                 [](const std::string& input) { return is_url(input); });
    if (!far && (!a.headers.empty() || !a.cache.empty())) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("{} goes with an input at a URL, and there is none",
                                a.headers.empty() ? "--cache" : "--header"));
    }
}

Store open_store(const std::string& location, RemoteArguments& a, std::uint64_t& memory,
                 Progress& progress, const std::string& first) {
    if (!is_url(location)) {
        return Store(location);
    }
    const RemoteAccess remote = access_to(location, a, memory, progress, first);
    Store store(location, remote);
    if (store.reader().catalogue() == nullptr) {
        const FetchedCounts counts = store.fetched();
        a.note = fmt::format(
            "{} has no catalogue, as stores have since version 2.9 of the format: {} in {} "
            "requests "
            "were fetched to open it; preprocess the volume again to have one",
            store.path().string(), human_bytes(static_cast<double>(counts.remote_bytes)),
            counts.requests);
    }
    return store;
}

void reach_volume(const std::vector<std::string>& input, RemoteArguments& a, std::uint64_t& memory,
                  SourceOptions& options, Progress& progress, const std::string& first) {
    const auto far = std::find_if(input.begin(), input.end(),
                                  [](const std::string& name) { return is_url(name); });
    if (far != input.end()) {
        options.remote = access_to(*far, a, memory, progress, first);
    }
}

Json fetched_json(const FetchedCounts& counts) {
    return {{"remote_bytes", counts.remote_bytes},
            {"requests", counts.requests},
            {"round_trips", counts.round_trips},
            {"cache_bytes", counts.cache_bytes}};
}

std::string fetched_text(const FetchedCounts& counts) {
    return fmt::format("fetched {} in {} request{}, {} round trip{}; {} from the cache\n",
                       human_bytes(static_cast<double>(counts.remote_bytes)), counts.requests,
                       counts.requests == 1 ? "" : "s", counts.round_trips,
                       counts.round_trips == 1 ? "" : "s",
                       human_bytes(static_cast<double>(counts.cache_bytes)));
}

void add_fetched(const Store& store, Result& result) {
    if (store.is_remote()) {
        result.json["remote"] = fetched_json(store.fetched());
        result.text += fetched_text(store.fetched());
        add_warning(store.cache_warning(), result);
    }
}

void add_fetched(const VolumeSource& volume, Result& result, const char* key) {
    const FetchedCounts counts = volume.fetched();
    if (counts.requests > 0) {
        result.json[key] = fetched_json(counts);
        result.text += fetched_text(counts);
        add_warning(volume.cache_warning(), result);
    }
}

Error with_set_aside(const Error& error, const RemoteArguments& a) {
    std::vector<Remedy> remedies = error.remedies();
    for (Remedy& remedy : remedies) {
        std::uint64_t enough = 0;
        const char* const end = remedy.value.data() + remedy.value.size();
        if (remedy.kind == RemedyKind::more_memory &&
            std::from_chars(remedy.value.data(), end, enough).ec == std::errc{}) {
            for (int i = 0; i < a.opened; ++i) {
                // Of four thirds of it, a quarter is set aside.
                enough += std::clamp(enough / 3 + 1, RemoteAccess::kLeastMemory, kMostAside);
            }
            remedy.value = std::to_string(enough);
        }
    }
    return {error.kind(), error.place(), error.problem(), std::move(remedies)};
}

}  // namespace isonest::detail::cli
