// A folder that shows stores on any web server: its contents, and how it is written.
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

// Which URLs a published site may contain.

/// The URL by which a page reads a store: as given, or for s3:// in its https:// form. Throws
/// Error{invalid_argument} if it is not the URL of a store, and if it has a password, a signature,
/// or a query parameter that looks like a secret, because everybody can read the site. The message
/// contains no secret.
std::string public_url(const std::string& text);

/// A file of the viewer's page, or of the library that runs in the page.
struct PageFile {
    std::string_view name;   ///< "main.js"
    std::string_view bytes;  ///< valid as long as the program runs
};

/// Whether the library that runs in a page is among these files.
bool has_library(const std::vector<PageFile>& page);

/// What the publisher says about a site or a store; each may be empty.
struct About {
    std::string title;
    std::string description;
    std::string license;
};

/// A step of a series.
struct SiteStep {
    double time = 0;
    std::string name;            ///< of its file in the folder of the series
    std::filesystem::path file;  ///< empty: it is only linked
    std::string url;             ///< its address, percent-encoded; empty: in the site's own folder
    std::uint64_t bytes = 0;
};

struct SiteSeries {
    std::optional<std::string> time_unit;  ///< none: unknown
    /// Of all steps; none if there are no values.
    std::optional<double> min_value, max_value;
    std::vector<SiteStep> steps;  ///< at least one
};

/// A store, or a series, whose properties are those of its first step.
struct SiteStore {
    std::string name;            ///< its name in links, and of its file or folder in the site
    std::filesystem::path file;  ///< empty: the store is only linked, or a series
    /// The file or folder that was opened to describe the store, also if it is only linked; empty:
    /// a URL.
    std::filesystem::path described_by;
    std::string url;  ///< its address, percent-encoded; empty: in the site's own folder
    std::optional<SiteSeries> series;
    About about;
    std::uint64_t bytes = 0;  ///< of all steps
    Int3 nodes;
    std::string type;
    std::string unit;      ///< of length; empty: unknown
    double tolerance = 0;  ///< to which its values were rounded; 0: they were not
};

struct Site {
    About about;
    std::vector<SiteStore> stores;
    bool hard_links = false;  ///< hard links to stores instead of copies
};

/// Memory budget in bytes of the library in the page; the page shows it.
inline constexpr std::uint64_t kPageMemory = std::uint64_t{256} << 20U;

/// Percent-encodes a name, such as a file name, as part of a URL's path.
std::string percent_encoded(std::string_view text);
/// "stores/NAME.isonest", percent-encoded, or the store's url; for a series, of its first step.
std::string url_in_site(const SiteStore& store);
/// The list that the page reads. `files`: all files of the folder, which isonest may replace.
std::string site_list(const Site& site, const std::vector<std::string>& files);
/// The viewer's page with the list's name, the site's title and a content security policy: scripts
/// only from the site itself, requests only to the servers of its stores. Throws Error{corrupt} if
/// `page` is not the viewer's page.
std::string site_page(std::string_view page, const Site& site);
/// Only the policy.
std::string content_policy(const Site& site);

/// Throws Error{invalid_argument} if `folder` contains anything that write_site() did not write.
void require_own_site(const std::filesystem::path& folder);

/// The folder appears only when it is complete; with `force`, an existing one that isonest made is
/// replaced. Returns the names of its files. Throws Error{invalid_argument, not_found, io,
/// cancelled}.
std::vector<std::string> write_site(const std::filesystem::path& folder, const Site& site,
                                    const std::vector<PageFile>& page, bool force,
                                    Progress& progress);

}  // namespace isonest::detail::publish
