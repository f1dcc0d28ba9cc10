#include "tools/publish/site.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstddef>
#include <cstdio>
#include <cstring>
#include <nlohmann/json.hpp>
#include <set>
#include <span>
#include <string>
#include <string_view>
#include <system_error>

#include <isonest/error.h>

#include "store/base/escaped_text.h"
#include "store/files/output_file.h"
#include "store/remote/object_url.h"

namespace isonest::detail::publish {

// Names of parameters that contain secrets: RFC 6750, section 2.3 (access_token), and those of
// common services (GitLab private_token, job_token; Google key; Azure code, sas).

namespace {

/// Only the letters and digits, in lower case, of a name that may be percent-encoded.
std::string plain_name(std::string_view name) {
    std::string plain;
    for (const char c : percent_decoded(name)) {
        if ((c >= 'a' && c <= 'z') || (c >= '0' && c <= '9')) {
            plain += c;
        } else if (c >= 'A' && c <= 'Z') {
            plain += static_cast<char>(c + ('a' - 'A'));
        }
    }
    return plain;
}

bool is_secret(std::string_view parameter) {
    constexpr std::array kNames{
        "auth",      "authorization",   "authkey",    "bearer",    "jwt",
        "sid",       "session",         "sas",        "apikey",    "accesskey",
        "code",      "sharekey",        "passwd",     "pwd",       "passphrase",
        "sessionid", "subscriptionkey", "privatekey", "secretkey", "pass"};
    constexpr std::array kEnds{"token", "secret", "password", "credential", "credentials"};
    const std::size_t equals = std::min(parameter.find('='), parameter.size());
    const std::string name = plain_name(parameter.substr(0, equals));
    const std::string_view value = parameter.substr(std::min(equals + 1, parameter.size()));
    if (value.empty()) {
        return false;
    }
    if (name == "key") {  // also the key of an object, which is a path
        return value.find('/') == std::string_view::npos &&
               value.find("%2F") == std::string_view::npos &&
               value.find("%2f") == std::string_view::npos && !value.ends_with(".isonest");
    }
    return std::find(kNames.begin(), kNames.end(), name) != kNames.end() ||
           std::any_of(kEnds.begin(), kEnds.end(),
                       [&](const char* end) { return name.ends_with(end); });
}

}  // namespace

std::string public_url(const std::string& text) {
    if (!is_url(text)) {
        throw Error(ErrorKind::invalid_argument, {text},
                    "is not the URL of a store (https://HOST/PATH)");
    }
    const ObjectUrl url = parse_object_url(text, [](const char* /*name*/) -> const char* {
        return nullptr;  // visitors of the site do not have this machine's keys
    });
    const std::size_t query = std::min(url.request.find('?'), url.request.size() - 1) + 1;
    const bool is_signed = query_without_signature(url.request) != url.request.substr(query);
    if (!url.user.empty() || !url.password.empty() || is_signed) {
        throw Error(ErrorKind::invalid_argument, {url.name},
                    "the URL has a password or signature, which everybody could read on the site; "
                    "give a URL without");
    }
    std::string_view rest = std::string_view(url.request).substr(query);
    while (!rest.empty()) {
        const std::string_view parameter = rest.substr(0, rest.find('&'));
        rest = rest.substr(std::min(parameter.size() + 1, rest.size()));
        if (is_secret(parameter)) {
            throw Error(
                ErrorKind::invalid_argument, {url.name},
                fmt::format(
                    "the URL's parameter '{}' looks like a secret, and everybody could "
                    "read it on the site: make the store available without it, and give that URL",
                    plain_name(parameter.substr(0, parameter.find('=')))));
        }
    }
    return url.request;
}

namespace {

constexpr int kListVersion = 1;

std::string url_origin(const std::string& url) {
    const std::size_t host = url.find("://") + 3;
    return url.substr(0, url.find_first_of("/?#", host));
}

void replace_once(std::string& text, std::string_view from, const std::string& to) {
    const std::size_t at = text.find(from);
    if (at == std::string::npos) {
        throw Error(ErrorKind::corrupt, {"index.html"}, fmt::format("the page has no {}", from));
    }
    text.replace(at, from.size(), to);
}

}  // namespace

/// Source: RFC 3986, section 2.3.
std::string percent_encoded(std::string_view text) {
    std::string out;
    for (const char c : text) {
        const auto byte = static_cast<unsigned char>(c);
        const bool is_plain = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') ||
                              (c >= '0' && c <= '9') || c == '-' || c == '.' || c == '_' ||
                              c == '~';
        out += is_plain ? std::string(1, c) : fmt::format("%{:02X}", byte);
    }
    return out;
}

bool has_library(const std::vector<PageFile>& page) {
    return std::any_of(page.begin(), page.end(),
                       [](const PageFile& file) { return file.name == "isonest.wasm"; });
}

namespace {

std::string url_of_step(const SiteStore& store, const SiteStep& step) {
    return step.url.empty() ? fmt::format("stores/{}/{}", percent_encoded(store.name),
                                          percent_encoded(step.name))
                            : step.url;
}

nlohmann::ordered_json series_list(const SiteStore& store) {
    const SiteSeries& series = *store.series;
    nlohmann::ordered_json list{{"time_unit", nullptr},
                                {"min_value", nullptr},
                                {"max_value", nullptr},
                                {"steps", nlohmann::ordered_json::array()}};
    if (series.time_unit) {
        list["time_unit"] = *series.time_unit;
    }
    if (series.min_value && series.max_value) {
        list["min_value"] = *series.min_value;
        list["max_value"] = *series.max_value;
    }
    for (const SiteStep& step : series.steps) {
        list["steps"].push_back(
            {{"time", step.time}, {"url", url_of_step(store, step)}, {"bytes", step.bytes}});
    }
    return list;
}

}  // namespace

std::string url_in_site(const SiteStore& store) {
    if (store.series) {
        return url_of_step(store, store.series->steps.front());
    }
    return store.url.empty() ? fmt::format("stores/{}.isonest", percent_encoded(store.name))
                             : store.url;
}

std::string content_policy(const Site& site) {
    std::set<std::string> hosts;
    for (const SiteStore& store : site.stores) {
        const std::string& url = store.series ? store.series->steps.front().url : store.url;
        if (!url.empty()) {
            hosts.insert(url_origin(url));
        }
    }
    return fmt::format(
        "default-src 'none'; script-src 'self' 'wasm-unsafe-eval'; worker-src 'self'; "
        "style-src 'self'; img-src 'self' data: blob:; connect-src 'self'{}{}; base-uri 'none'; "
        "form-action 'none'; object-src 'none'",
        hosts.empty() ? "" : " ", fmt::join(hosts, " "));
}

std::string site_list(const Site& site, const std::vector<std::string>& files) {
    nlohmann::ordered_json list{{"isonest_site", kListVersion},
                                {"title", site.about.title},
                                {"description", site.about.description},
                                {"license", site.about.license},
                                {"memory", kPageMemory},
                                {"stores", nlohmann::ordered_json::array()}};
    for (const SiteStore& store : site.stores) {
        nlohmann::ordered_json one{{"name", store.name},
                                   {"url", url_in_site(store)},
                                   {"title", store.about.title},
                                   {"description", store.about.description},
                                   {"license", store.about.license},
                                   {"bytes", store.bytes},
                                   {"nodes", {store.nodes.x, store.nodes.y, store.nodes.z}},
                                   {"type", store.type},
                                   {"unit", nullptr}};
        if (store.tolerance > 0) {
            one["tolerance"] = store.tolerance;
        }
        if (!store.unit.empty()) {
            one["unit"] = store.unit;
        }
        if (store.series) {
            one["series"] = series_list(store);
        }
        list["stores"].push_back(std::move(one));
    }
    list["files"] = files;
    return list.dump(1, ' ', false, nlohmann::ordered_json::error_handler_t::replace) + "\n";
}

std::string site_page(std::string_view page, const Site& site) {
    std::string html(page);
    // Before everything that the page loads.
    replace_once(html, "<meta charset=\"utf-8\" />",
                 fmt::format("<meta charset=\"utf-8\" />\n"
                             "    <meta http-equiv=\"Content-Security-Policy\" content=\"{}\" />\n"
                             "    <meta name=\"referrer\" content=\"no-referrer\" />\n"
                             "    <meta name=\"isonest-site\" content=\"site.json\" />\n"
                             "    <meta name=\"description\" content=\"{}\" />",
                             in_markup(content_policy(site)), in_markup(site.about.description)));
    replace_once(html, "<title>isonest</title>",
                 fmt::format("<title>{}</title>", in_markup(site.about.title)));
    return html;
}

void require_own_site(const std::filesystem::path& folder) {
    const std::filesystem::path list = folder / "site.json";
    std::set<std::string> files{"site.json"};
    std::set<std::string> folders{"stores"};
    std::error_code error;
    std::uintmax_t size = std::filesystem::file_size(list, error);
    constexpr std::uintmax_t kMaxList = std::uintmax_t{64} << 20U;
    bool is_ours = !error && size <= kMaxList;
    if (is_ours) {
        std::FILE* const file = std::fopen(list.c_str(), "rb");
        std::string text(static_cast<std::size_t>(size), '\0');
        is_ours = file != nullptr && std::fread(text.data(), 1, text.size(), file) == text.size();
        if (file != nullptr) {
            std::fclose(file);
        }
        const nlohmann::json parsed = nlohmann::json::parse(text, nullptr, false);
        is_ours = is_ours && parsed.is_object() && parsed.contains("isonest_site") &&
                  parsed.contains("files") && parsed["files"].is_array();
        if (is_ours) {
            for (const nlohmann::json& name : parsed["files"]) {
                const std::filesystem::path listed(name.is_string() ? name.get<std::string>()
                                                                    : std::string());
                files.insert(listed.generic_string());
                folders.insert(listed.parent_path().generic_string());
            }
        }
    }
    if (!is_ours) {
        throw Error(ErrorKind::invalid_argument, {folder.string()},
                    "is a folder that isonest publish did not create; it is not replaced",
                    {{RemedyKind::other_name}});
    }
    for (std::filesystem::recursive_directory_iterator entry(folder, error), end;
         !error && entry != end; entry.increment(error)) {
        const std::string name = entry->path().lexically_relative(folder).generic_string();
        const bool is_folder = entry->is_directory(error) && !entry->is_symlink(error);
        if (!(is_folder ? folders : files).contains(name)) {
            throw Error(
                ErrorKind::invalid_argument, {folder.string()},
                fmt::format(
                    "contains {}, which isonest publish did not write; move it elsewhere first",
                    name),
                {{RemedyKind::other_name}});
        }
    }
    if (error) {
        throw Error(ErrorKind::io, {folder.string()}, "cannot be read: " + error.message());
    }
}

namespace {

constexpr std::size_t kPiece = std::size_t{4} << 20U;

void write_text(const std::filesystem::path& path, std::string_view text) {
    OutputFile file(path, false);
    file.write_at(0, std::as_bytes(std::span(text)));
    file.publish_as_named();
}

[[noreturn]] void fail_store(const std::filesystem::path& path, const char* what, int error) {
    throw Error(ErrorKind::io, {path.string()},
                fmt::format("cannot {}: {}", what, std::strerror(error)));
}

class Input {
  public:
    explicit Input(const std::filesystem::path& path)
        : path_(path), fd_(::open(path.c_str(), O_RDONLY | O_CLOEXEC)) {
        if (fd_ < 0) {
            fail_store(path_, "read", errno);
        }
    }
    Input(const Input&) = delete;
    Input& operator=(const Input&) = delete;
    ~Input() { ::close(fd_); }
    /// 0 at the end.
    std::size_t read(std::span<std::byte> bytes) const {
        for (;;) {
            const ssize_t n = ::read(fd_, bytes.data(), bytes.size());
            if (n >= 0) {
                return static_cast<std::size_t>(n);
            }
            if (errno != EINTR) {
                fail_store(path_, "read", errno);
            }
        }
    }

  private:
    const std::filesystem::path& path_;
    int fd_;
};

/// A file to copy or to link.
struct StoreFile {
    const std::filesystem::path* from;
    std::string to;  ///< in the site
    std::uint64_t bytes;
};

std::vector<StoreFile> store_files(const Site& site) {
    std::vector<StoreFile> files;
    for (const SiteStore& store : site.stores) {
        if (!store.file.empty()) {
            files.push_back(
                {&store.file, fmt::format("stores/{}.isonest", store.name), store.bytes});
        }
        if (store.series) {
            for (const SiteStep& step : store.series->steps) {
                if (!step.file.empty()) {
                    files.push_back({&step.file, fmt::format("stores/{}/{}", store.name, step.name),
                                     step.bytes});
                }
            }
        }
    }
    return files;
}

void copy_store(const StoreFile& store, const std::filesystem::path& to, Progress& progress) {
    const Input from(*store.from);
    OutputFile file(to, false);
    std::vector<std::byte> piece(kPiece);
    std::uint64_t at = 0;
    while (const std::size_t size = from.read(piece)) {
        progress.check();
        file.write_at(at, std::span(piece).first(size));
        at += size;
        progress.advance(size);
    }
    if (at != store.bytes) {
        throw Error(ErrorKind::io, {store.from->string()}, "changed while it was copied",
                    {{RemedyKind::open_again}});
    }
    file.publish_as_named();
}

void link_store(const StoreFile& store, const std::filesystem::path& to) {
    if (::linkat(AT_FDCWD, store.from->c_str(), AT_FDCWD, to.c_str(), AT_SYMLINK_FOLLOW) == 0) {
        return;
    }
    const int error = errno;
    throw Error(
        ErrorKind::io, {store.from->string()},
        error == EXDEV
            ? std::string(
                  "is on a different file system from the site, so it cannot be hard-linked")
            : fmt::format("cannot be linked: {}", std::strerror(error)),
        {{RemedyKind::leave_out, "hard-link"}});
}

/// The stores that are read must not be removed with the folder that is replaced.
void require_outside(const std::filesystem::path& folder, const Site& site) {
    std::error_code error;
    const std::filesystem::path whole = std::filesystem::canonical(folder, error);
    for (const SiteStore& store : site.stores) {
        std::error_code ignored;
        const std::filesystem::path file = std::filesystem::canonical(store.described_by, ignored);
        const auto [end, unused] =
            std::mismatch(whole.begin(), whole.end(), file.begin(), file.end());
        if (!error && !ignored && !store.described_by.empty() && end == whole.end()) {
            throw Error(ErrorKind::invalid_argument, {store.described_by.string()},
                        "is an input, and is in the folder that would be replaced",
                        {{RemedyKind::other_name}});
        }
    }
}

/// Returns the names of all files.
std::vector<std::string> fill(const OutputFolder& output, const Site& site,
                              const std::vector<PageFile>& page, Progress& progress) {
    std::vector<std::string> files;
    const std::vector<StoreFile> stores = store_files(site);
    std::uint64_t all = 0;
    for (const StoreFile& store : stores) {
        all += site.hard_links ? 0 : store.bytes;
    }
    if (all > 0) {
        progress.begin("copying", all, "B");
    }
    for (const StoreFile& store : stores) {
        files.push_back(store.to);
        const std::filesystem::path to = output.name() / store.to;
        std::filesystem::create_directories(to.parent_path());
        if (site.hard_links) {
            link_store(store, to);
        } else {
            copy_store(store, to, progress);
        }
    }
    for (const PageFile& file : page) {
        files.emplace_back(file.name);
        write_text(output.name() / file.name, file.name == "index.html"
                                                  ? site_page(file.bytes, site)
                                                  : std::string(file.bytes));
    }
    progress.check();
    files.emplace_back("site.json");
    std::sort(files.begin(), files.end());
    write_text(output.name() / "site.json", site_list(site, files));
    return files;
}

}  // namespace

std::vector<std::string> write_site(const std::filesystem::path& folder, const Site& site,
                                    const std::vector<PageFile>& page, bool force,
                                    Progress& progress) {
    OutputFolder output(folder, force, [&](const std::filesystem::path& old) {
        require_own_site(old);
        require_outside(old, site);
    });
    std::vector<std::string> files;
    try {
        files = fill(output, site, page, progress);
    } catch (...) {
        output.require_there();
        throw;
    }
    output.publish();
    return files;
}

}  // namespace isonest::detail::publish
