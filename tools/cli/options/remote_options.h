// The options of commands that read stores: how a remote store is accessed, and what a report says
// about it.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include <isonest/error.h>
#include <isonest/open_volume.h>
#include <isonest/store.h>
#include <isonest/volume_source.h>

#include "tools/cli/program.h"

namespace isonest::detail::cli {

// Where what comes over a network is kept, as it is written on a command line.

struct CacheChoice {
    std::filesystem::path folder;
    std::uint64_t bytes = std::uint64_t{1} << 30U;  ///< at most, of the folder
};

/// "FOLDER" or "FOLDER:SIZE", as "/var/cache/scans:20G". What follows the last colon is a part of
/// the folder's name if it is no size. `option` ("--cache") starts the message. Throws
/// Error{invalid_argument} for no folder, and for a size of 0.
CacheChoice parse_cache(std::string_view option, std::string_view text);

struct RemoteArguments {
    std::vector<std::string> headers;  ///< "Name: value"; they may hold secrets
    std::filesystem::path cache;
    std::uint64_t cache_bytes = 0;
    int opened = 0;    ///< stores and volumes elsewhere: each has a share of --memory
    std::string note;  ///< about opening them
};

/// Adds --header and --cache.
void add_remote_options(CLI::App* command, RemoteArguments& a);

/// Throws Error{invalid_argument} for --header and --cache where none of the inputs is a URL.
void require_remote(const RemoteArguments& a, const std::vector<std::string>& inputs);

/// A file or a URL. Of a store elsewhere a quarter of `memory`, from 16 to 256 MiB, is set aside
/// for what is fetched, and `memory` becomes the rest. `progress` ends its waits, as long as the
/// store is open. `first`: of a second store, the one whose server the headers are for. Throws what
/// Store throws.
Store open_store(const std::string& location, RemoteArguments& a, std::uint64_t& memory,
                 Progress& progress, const std::string& first = {});

/// As open_store(), for commands that need a store: for a file that is a volume the error says so.
Store open_required_store(const std::string& location, RemoteArguments& a, std::uint64_t& memory,
                          Progress& progress, const std::string& first = {});

/// Whether opening a store failed because the file is not a store.
bool is_no_store(const Error& error);
/// Whether a store at a URL was not found, so that it may be the name of a folder with a volume.
bool may_be_folder(const Error& error, const std::string& location);

/// Of a volume elsewhere: sets aside the same share of `memory`, and says in `options` how it is
/// reached. Nothing for files. `first`: as in open_store().
void reach_volume(const std::vector<std::string>& input, RemoteArguments& a, std::uint64_t& memory,
                  SourceOptions& options, Progress& progress, const std::string& first = {});

/// {"remote_bytes", "requests", "round_trips", "cache_bytes"}
Json fetched_json(const FetchedCounts& counts);
/// "fetched 5.2 MB in 31 requests, 9 round trips; 0 B from the cache", with a line's end.
std::string fetched_text(const FetchedCounts& counts);
/// Of a store elsewhere: "remote" and a line of text. Nothing for a file.
void add_fetched(const Store& store, Result& result);
/// The same of a volume, under this key.
void add_fetched(const VolumeSource& volume, Result& result, const char* key = "remote");

/// An error that says how much memory is enough, with what is set aside on top.
Error with_set_aside(const Error& error, const RemoteArguments& a);

/// What run() returns, with the note, or throws; its errors say of --memory what holds with what is
/// set aside.
template <class Run>
Result run_beside_fetching(const RemoteArguments& a, const Run& run) {
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
