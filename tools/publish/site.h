// A folder that shows stores on any web server: what is in it, and how it is written.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <isonest/int3.h>
#include <isonest/progress.h>

namespace isonest::detail::publish {

/// One of the viewer's page, or of the library that runs in it.
struct PageFile {
    std::string_view name;   ///< "main.js"
    std::string_view bytes;  ///< live as long as the program
};

/// Whether the library that runs in a page is there.
bool has_library(const std::vector<PageFile>& page);

/// What a publisher says of a site or a store; any of it may be empty.
struct About {
    std::string title;
    std::string description;
    std::string license;
};

struct SiteStore {
    std::string name;            ///< what links call it by, and its file in the site
    std::filesystem::path file;  ///< empty: it is only named
    /// That was opened to describe it, also where it is only named; empty: a URL.
    std::filesystem::path described_by;
    std::string url;  ///< where it is, percent-encoded; empty: in the site's own folder
    About about;
    std::uint64_t bytes = 0;
    Int3 nodes;
    std::string type;
    std::string unit;  ///< of length; empty: not known
};

struct Site {
    About about;
    std::vector<SiteStore> stores;
    bool hard_links = false;  ///< to stores, in place of copies
};

/// Bytes that the library in the page may hold; the page says so.
inline constexpr std::uint64_t kPageMemory = std::uint64_t{256} << 20U;

/// A name, of a file for example, as a part of a URL's path.
std::string percent_encoded(std::string_view text);
/// "stores/NAME.isonest", percent-encoded, or its url.
std::string url_in_site(const SiteStore& store);
/// The list that the page reads. `files`: all of the folder, which isonest may replace.
std::string site_list(const Site& site, const std::vector<std::string>& files);
/// The page of the viewer with the list's name, the site's title and a policy: no script but the
/// site's own, no request but to the servers of its stores. Throws Error{corrupt} if `page` is
/// none.
std::string site_page(std::string_view page, const Site& site);
/// The policy alone.
std::string content_policy(const Site& site);

/// Throws Error{invalid_argument} if `folder` holds anything that was not written by write_site().
void require_own_site(const std::filesystem::path& folder);

/// The folder appears whole or not at all; one that exists is replaced with `force`, if isonest
/// made it. Returns the names of its files. Throws Error{invalid_argument, not_found, io,
/// cancelled}.
std::vector<std::string> write_site(const std::filesystem::path& folder, const Site& site,
                                    const std::vector<PageFile>& page, bool force,
                                    Progress& progress);

}  // namespace isonest::detail::publish
