#include "tools/cli/options/remote_options.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <fstream>
#include <utility>

#include <isonest/error.h>
#include <isonest/open_volume.h>

#include "store/container/reader.h"
#include "store/remote/object_url.h"
#include "store/remote/open_location.h"
#include "tools/cli/options/units.h"

namespace isonest::detail::cli {

CacheChoice parse_cache(std::string_view option, std::string_view text) {
    CacheChoice choice;
    std::string_view folder = text;
    if (const std::size_t colon = text.rfind(':'); colon != std::string_view::npos) {
        try {
            choice.bytes = parse_bytes(option, text.substr(colon + 1));
            folder = text.substr(0, colon);
        } catch (const Error&) {
            folder = text;
        }
    }
    if (folder.empty() || choice.bytes == 0) {
        throw Error(
            ErrorKind::invalid_argument,
            fmt::format(
                "{} '{}': give FOLDER or FOLDER:SIZE, such as cache:2G, with a size above 0",
                option, text));
    }
    choice.folder = folder;
    return choice;
}

namespace {

constexpr std::uint64_t kMaxAside = std::uint64_t{256} << 20U;
constexpr std::size_t kMaxHeaderFile = std::size_t{1} << 20U;

/// Throws Error{invalid_argument} for a malformed header; the message does not quote it, as it may
/// be secret.
void require_header(const std::string& header, const std::string& where) {
    if (!is_header(header)) {
        throw Error(ErrorKind::invalid_argument,
                    where +
                        ": give 'Name: value', or @FILE with one header per line; headers about "
                        "ranges and conditions are reserved");
    }
}

/// Appends a header, or the headers in a file, without its empty lines.
void take_headers(const std::string& text, std::vector<std::string>& headers) {
    if (!text.starts_with('@')) {
        require_header(text, "--header");
        headers.push_back(text);
        return;
    }
    const std::string path = text.substr(1);
    std::ifstream in(path, std::ios::binary);
    if (!in) {
        throw Error(ErrorKind::not_found, {path}, "cannot be read as a file of headers");
    }
    std::size_t read = 0;
    int number = 1;
    for (std::string line; std::getline(in, line); ++number) {
        read += line.size() + 1;
        if (read > kMaxHeaderFile) {
            throw Error(ErrorKind::invalid_argument, {path}, "is too large for a file of headers");
        }
        line.erase(line.find_last_not_of(" \t\r") + 1);
        if (!line.empty()) {
            require_header(line, fmt::format("{}: line {}", path, number));
            headers.push_back(std::move(line));
        }
    }
}

std::uint64_t share_for_fetching(std::uint64_t memory) {
    return std::clamp(memory / 4, RemoteAccess::kMinMemory, kMaxAside);
}

/// Sets part of the memory aside.
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
        progress.advance(0);  // refreshes the display
        progress.check();
    };
    progress.begin("opening", 0, "");
    progress.check();
    return remote;
}

/// Extends the error with the format of a file that is a volume and not a store. An HDF5 file may
/// also be a damaged store.
Error saying_its_format(const Error& error, const std::string& file) {
    const std::string format = is_no_store(error) ? input_format_of(file) : std::string();
    if (format.empty() || format == "HDF5") {
        return error;
    }
    return {ErrorKind::invalid_argument, error.place(),
            fmt::format("a volume ({}), not a store", format), error.remedies()};
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
            })
        ->allow_extra_args(false);
    add_parsed(command, "--cache", [&a](const std::string& text) {
        const CacheChoice choice = parse_cache("--cache", text);
        a.cache = choice.folder;
        a.cache_bytes = choice.bytes;
    });
}

void require_remote(const RemoteArguments& a, const std::vector<std::string>& inputs) {
    const bool any_remote = std::any_of(inputs.begin(), inputs.end(),
                                        [](const std::string& input) { return is_url(input); });
    if (!any_remote && (!a.headers.empty() || !a.cache.empty())) {
        throw Error(
            ErrorKind::invalid_argument,
            fmt::format("{} needs an input at a URL", a.headers.empty() ? "--cache" : "--header"));
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
            "{} has no catalogue (format older than 2.9), so opening it took {} in {} requests; "
            "preprocess the volume again to add one",
            store.path().string(), human_bytes(static_cast<double>(counts.remote_bytes)),
            counts.requests);
    }
    return store;
}

bool is_no_store(const Error& error) {
    return std::any_of(error.remedies().begin(), error.remedies().end(),
                       [](const Remedy& r) { return r.kind == RemedyKind::make_store; });
}

bool may_be_folder(const Error& error, const std::string& location) {
    return is_url(location) && error.kind() == ErrorKind::not_found;
}

Store open_required_store(const std::string& location, RemoteArguments& a, std::uint64_t& memory,
                          Progress& progress, const std::string& first) {
    try {
        return open_store(location, a, memory, progress, first);
    } catch (const Error& error) {
        if (is_url(location)) {
            throw;
        }
        throw saying_its_format(error, location);
    }
}

void reach_volume(const std::vector<std::string>& input, RemoteArguments& a, std::uint64_t& memory,
                  SourceOptions& options, Progress& progress, const std::string& first) {
    const auto remote = std::find_if(input.begin(), input.end(),
                                     [](const std::string& name) { return is_url(name); });
    if (remote != input.end()) {
        options.remote = access_to(*remote, a, memory, progress, first);
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

Error with_enough_memory(const Error& error,
                         const std::function<std::uint64_t(std::uint64_t)>& total_of) {
    std::vector<Remedy> remedies = error.remedies();
    for (Remedy& remedy : remedies) {
        std::uint64_t enough = 0;
        const char* const end = remedy.value.data() + remedy.value.size();
        if (remedy.kind == RemedyKind::more_memory &&
            std::from_chars(remedy.value.data(), end, enough).ec == std::errc{}) {
            remedy.value = std::to_string(total_of(enough));
        }
    }
    return {error.kind(), error.place(), error.problem(), std::move(remedies)};
}

Error with_set_aside(const Error& error, const RemoteArguments& a) {
    return with_enough_memory(error, [&](std::uint64_t enough) {
        for (int i = 0; i < a.opened; ++i) {
            // A quarter is set aside, so x bytes for the work need a total of 4/3 x.
            enough += std::clamp(enough / 3 + 1, RemoteAccess::kMinMemory, kMaxAside);
        }
        return enough;
    });
}

}  // namespace isonest::detail::cli
