// Options for opening stores that may be remote, and reports on what was fetched.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include <isonest/error.h>
#include <isonest/open_volume.h>
#include <isonest/store.h>
#include <isonest/volume_source.h>

#include "tools/cli/program.h"

namespace isonest::detail::cli {

// The cache for data fetched over the network, as given on the command line.

struct CacheChoice {
    std::filesystem::path folder;
    std::uint64_t bytes = std::uint64_t{1} << 30U;  ///< largest size of the folder
};

/// Parses "FOLDER" or "FOLDER:SIZE", such as "/var/cache/scans:20G". Text after the last colon that
/// is not a size is part of the folder's name. `option` ("--cache") starts the message. Throws
/// Error{invalid_argument} if the folder is empty or the size is 0.
CacheChoice parse_cache(std::string_view option, std::string_view text);

struct RemoteArguments {
    std::vector<std::string> headers;  ///< "Name: value"; may contain secrets
    std::filesystem::path cache;
    std::uint64_t cache_bytes = 0;
    int opened = 0;    ///< number of remote stores and volumes; each has a share of --memory
    std::string note;  ///< remark for the report
};

/// Adds --header and --cache.
void add_remote_options(CLI::App* command, RemoteArguments& a);

/// Throws Error{invalid_argument} for --header or --cache if none of the inputs is a URL.
void require_remote(const RemoteArguments& a, const std::vector<std::string>& inputs);

/// Opens a store, given as a file or URL. For a remote store, a quarter of `memory`, but 16 to 256
/// MiB, is set aside for fetched data, and `memory` is reduced by it. `progress` can cancel its
/// waits and must outlive the store. `first`: when opening a second store, the first one; headers
/// are sent only to its server. Throws what Store throws.
Store open_store(const std::string& location, RemoteArguments& a, std::uint64_t& memory,
                 Progress& progress, const std::string& first = {});

/// As open_store(), for commands that need a store: if the file is a volume, the error says so.
Store open_required_store(const std::string& location, RemoteArguments& a, std::uint64_t& memory,
                          Progress& progress, const std::string& first = {});

/// Whether opening a store failed because the file is not a store.
bool is_no_store(const Error& error);
/// Whether a store at a URL was not found, so that the URL may name a folder with a volume.
bool may_be_folder(const Error& error, const std::string& location);

/// For a remote volume: sets aside the same share of `memory`, and adds the access to `options`.
/// Does nothing for files. `first`: as in open_store().
void reach_volume(const std::vector<std::string>& input, RemoteArguments& a, std::uint64_t& memory,
                  SourceOptions& options, Progress& progress, const std::string& first = {});

/// {"remote_bytes", "requests", "round_trips", "cache_bytes"}
Json fetched_json(const FetchedCounts& counts);
/// "fetched 5.2 MB in 31 requests, 9 round trips; 0 B from the cache", terminated by a newline.
std::string fetched_text(const FetchedCounts& counts);
/// For a remote store, adds "remote" and a line of text. Does nothing for a file.
void add_fetched(const Store& store, Result& result);
/// The same for a volume; the member of the JSON is called `key`.
void add_fetched(const VolumeSource& volume, Result& result, const char* key = "remote");

/// Replaces the memory that the error's remedies ask for, bytes of a part, by total_of(bytes).
Error with_enough_memory(const Error& error,
                         const std::function<std::uint64_t(std::uint64_t)>& total_of);
/// Increases the memory that the error's remedies ask for by what is set aside.
Error with_set_aside(const Error& error, const RemoteArguments& a);

/// Returns run() with the note added, after require_remote(). In errors that it throws, the minimum
/// for --memory includes what is set aside.
template <class Run>
Result run_beside_fetching(const RemoteArguments& a, const std::vector<std::string>& inputs,
                           const Run& run) {
    require_remote(a, inputs);
    try {
        Result result = run();
        if (!a.note.empty() && !result.json.is_null()) {
            result.text += "note: " + a.note + "\n";
            result.json["remote_note"] = a.note;
        }
        return result;
    } catch (const Error& error) {
        throw with_set_aside(error, a);
    }
}

}  // namespace isonest::detail::cli
