#include <fmt/format.h>

#include <algorithm>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <set>
#include <system_error>

#include <isonest/error.h>

#include "store/base/markup_text.h"
#include "store/remote/object_url.h"
#include "tools/publish/site.h"

namespace isonest::detail::publish {
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

std::string url_in_site(const SiteStore& store) {
    return store.url.empty() ? fmt::format("stores/{}.isonest", percent_encoded(store.name))
                             : store.url;
}

std::string content_policy(const Site& site) {
    std::set<std::string> hosts;
    for (const SiteStore& store : site.stores) {
        if (!store.url.empty()) {
            hosts.insert(url_origin(store.url));
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
        if (!store.unit.empty()) {
            one["unit"] = store.unit;
        }
        list["stores"].push_back(std::move(one));
    }
    list["files"] = files;
    return list.dump(1, ' ', false, nlohmann::ordered_json::error_handler_t::replace) + "\n";
}

std::string site_page(std::string_view page, const Site& site) {
    std::string html(page);
    // Before all that the page loads.
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
    std::error_code error;
    std::uintmax_t size = std::filesystem::file_size(list, error);
    constexpr std::uintmax_t kMostList = std::uintmax_t{64} << 20U;
    bool is_ours = !error && size <= kMostList;
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
                files.insert(name.is_string() ? name.get<std::string>() : std::string());
            }
        }
    }
    if (!is_ours) {
        throw Error(ErrorKind::invalid_argument, {folder.string()},
                    "is a folder that isonest publish did not make, and is not replaced",
                    {{RemedyKind::other_name}});
    }
    for (std::filesystem::recursive_directory_iterator entry(folder, error), end;
         !error && entry != end; entry.increment(error)) {
        const std::string name = entry->path().lexically_relative(folder).generic_string();
        const bool is_folder = entry->is_directory(error) && !entry->is_symlink(error);
        if (is_folder ? name != "stores" : files.find(name) == files.end()) {
            throw Error(ErrorKind::invalid_argument, {folder.string()},
                        fmt::format("holds {}, which isonest publish did not write, and is not "
                                    "replaced: move that elsewhere first",
                                    name),
                        {{RemedyKind::other_name}});
        }
    }
    if (error) {
        throw Error(ErrorKind::io, {folder.string()}, "cannot be read: " + error.message());
    }
}

}  // namespace isonest::detail::publish
