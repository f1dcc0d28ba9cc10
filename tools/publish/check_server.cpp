// Source: WHATWG, "Fetch" (CORS protocol; a range from a first to a last byte is a safelisted
// header, so only older browsers send a preflight request); RFC 9110, section 14.

#include "tools/publish/check_server.h"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <optional>

#include <isonest/error.h>

#include "store/remote/answer.h"
#include "store/remote/object_url.h"
#include "store/remote/open_location.h"

namespace isonest::detail::publish {
namespace {

/// The size of a store's footer, and its last bytes: store/FORMAT.md, "Footer and catalogue".
constexpr std::size_t kPart = 64;
constexpr std::string_view kFooterEnd = "IsoNest\n";
constexpr const char* kBrowserEncodings = "Accept-Encoding: gzip, deflate, br";
constexpr const char* kAsItIs = "Accept-Encoding: identity";

std::string lower_case_of(std::string text) {
    std::transform(text.begin(), text.end(), text.begin(), [](char c) {
        return c >= 'A' && c <= 'Z' ? static_cast<char>(c + ('a' - 'A')) : c;
    });
    return text;
}

/// Whether a comma-separated list of names contains this one, or "*". `name`: lower case.
bool lists(const std::string& list, std::string_view name) {
    const std::string text = lower_case_of(list);
    for (std::size_t at = 0; at <= text.size();) {
        const std::size_t end = std::min(text.find(',', at), text.size());
        std::string_view one = std::string_view(text).substr(at, end - at);
        while (!one.empty() && one.front() == ' ') {
            one.remove_prefix(1);
        }
        while (!one.empty() && one.back() == ' ') {
            one.remove_suffix(1);
        }
        if (one == name || one == "*") {
            return true;
        }
        at = end + 1;
    }
    return false;
}

std::string media_type(const ServerReply& reply) {
    const std::string type = lower_case_of(reply.header("content-type"));
    const std::string_view first = std::string_view(type).substr(0, type.find(';'));
    return std::string(first.substr(0, first.find_last_not_of(' ') + 1));
}

std::string quoted(const std::string& value) {
    return value.empty() ? "none" : "\"" + value + "\"";
}

class Checker {
  public:
    Checker(std::string origin, Progress& progress)
        : origin_(std::move(origin)), progress_(progress) {}

    ServerCheck check(const std::string& url) {
        const ServerReply page = ask({url, "GET", {kAsItIs}});
        if (page.is_whole && page.body.find("name=\"isonest-site\"") != std::string::npos) {
            check_site(url);
        } else {
            if (page.status >= 400) {
                add(url, "file", ServerFault::missing, said_status(page.status));
                return std::move(check_);
            }
            check_store(url, true);
        }
        return std::move(check_);
    }

  private:
    ServerReply ask(ServerQuestion question) {
        progress_.advance(1);
        progress_.check();
        question.max_body = std::max(question.max_body, kPart);
        return ask_server(question, [this] { progress_.check(); });
    }

    void add(const std::string& url, const char* what, ServerFault fault, std::string found,
             bool is_needed = true) {
        check_.findings.push_back({url, what, fault, is_needed, std::move(found)});
    }
    /// Adds `fault` unless `is_right`.
    void note(const std::string& url, const char* what, bool is_right, ServerFault fault,
              std::string found, bool is_needed = true) {
        add(url, what, is_right ? ServerFault::none : fault, std::move(found), is_needed);
    }

    static bool has_url(const nlohmann::json& store) {
        return store.is_object() && store.contains("url") && store["url"].is_string();
    }

    void check_site(const std::string& url) {
        check_.is_site = true;
        const std::string without_query = url.substr(0, url.find_first_of("?#"));
        const std::string folder = without_query.substr(0, without_query.rfind('/') + 1);
        origin_ = origin_of_page(folder);
        const ServerReply list = ask({folder + "site.json", "GET", {kAsItIs}});
        const nlohmann::json site = nlohmann::json::parse(list.body, nullptr, false);
        const nlohmann::json stores =
            site.is_object() ? site.value("stores", nlohmann::json()) : nlohmann::json();
        if (list.status != 200 || !stores.is_array() ||
            !std::all_of(stores.begin(), stores.end(), has_url)) {
            add(folder + "site.json", "list of stores", ServerFault::missing,
                list.status == 200 ? "is none" : said_status(list.status));
            return;
        }
        check_file(folder + "isonest.wasm", true);
        for (const char* const script : {"isonest.mjs", "worker.js", "mesh_worker.js", "main.js"}) {
            check_file(folder + script, false);
        }
        for (const nlohmann::json& store : stores) {
            const std::string named = store["url"].get<std::string>();
            const bool is_elsewhere = is_url(named);
            const std::string whole = is_elsewhere ? named : folder + named;
            check_store(whole, is_elsewhere && origin_of(whole) != origin_of(folder));
            if (store.contains("series") && store["series"].is_object()) {
                check_steps(whole, folder, store["series"].value("steps", nlohmann::json::array()));
            }
        }
    }

    /// Whether all steps of a series are there as a whole; only the first one, `url`, is checked
    /// like a store.
    void check_steps(const std::string& url, const std::string& folder,
                     const nlohmann::json& steps) {
        bool are_right = true;
        for (const nlohmann::json& step : steps) {
            if (!has_url(step) || !step.contains("bytes") || !step["bytes"].is_number_unsigned()) {
                add(folder + "site.json", "list of stores", ServerFault::missing, "is damaged");
                return;
            }
            const auto named = step["url"].get<std::string>();
            const std::string whole = is_url(named) ? named : folder + named;
            const ServerReply head = ask({whole, "HEAD", {kAsItIs}});
            const std::string length = head.header("content-length");
            const std::string expected = std::to_string(step["bytes"].get<std::uint64_t>());
            if (head.status != 200) {
                add(whole, "file", ServerFault::missing, said_status(head.status));
                are_right = false;
            } else if (!length.empty() && length != expected) {
                add(whole, "file", ServerFault::missing,
                    fmt::format("{} bytes in place of {}", length, expected));
                are_right = false;
            }
        }
        if (are_right) {
            add(url, "steps", ServerFault::none,
                fmt::format("all {} steps of the series are there", steps.size()));
        }
    }

    /// As browsers write it: without the scheme's default port.
    static std::string origin_of_page(const std::string& url) {
        std::string origin = origin_of(url);
        for (const std::string_view port : {":443", ":80"}) {
            const bool is_own = origin.starts_with(port == ":443" ? "https:" : "http:");
            if (is_own && origin.ends_with(port)) {
                origin.resize(origin.size() - port.size());
            }
        }
        return origin;
    }

    void check_file(const std::string& url, bool is_library) {
        const ServerReply file = ask({url, "GET", {kBrowserEncodings}, 0});
        if (file.status != 200) {
            add(url, "file", ServerFault::missing, said_status(file.status));
            return;
        }
        const std::string type = media_type(file);
        if (is_library) {
            note(url, "type", type == "application/wasm", ServerFault::wasm_type,
                 fmt::format("Content-Type: {}", quoted(type)));
            const std::string encoding = file.header("content-encoding");
            note(url, "compression", !encoding.empty(), ServerFault::compression,
                 fmt::format("Content-Encoding: {}", quoted(encoding)), false);
        } else {
            note(url, "type",
                 type == "text/javascript" || type == "application/javascript" ||
                     type == "application/x-javascript",
                 ServerFault::script_type, fmt::format("Content-Type: {}", quoted(type)));
        }
    }

    ServerReply ask_part(const std::string& url, const std::string& range) {
        // A browser that requests a range does not accept compression.
        return ask({url, "GET", {"Range: bytes=" + range, kAsItIs, "Origin: " + origin_}});
    }

    void check_store(const std::string& url, bool is_elsewhere) {
        const ServerReply part = ask_part(url, fmt::format("0-{}", kPart - 1));
        if (part.status >= 400) {
            add(url, "file", ServerFault::missing, said_status(part.status));
            return;
        }
        shares_parts_ = shares(part);
        const std::optional<std::uint64_t> size = check_first_part(url, part);
        if (size) {
            check_end(url, *size);
        }
        check_head(url, size, is_elsewhere);
        const std::string encoding = part.header("content-encoding");
        note(url, "encoding", encoding.empty() || encoding == "identity", ServerFault::encoding,
             fmt::format("Content-Encoding: {}", quoted(encoding)));
        const std::string etag = part.header("etag");
        note(url, "state", !etag.empty() || part.has("last-modified"), ServerFault::etag,
             fmt::format("ETag: {}", etag.empty() ? "none" : etag), false);
        if (is_elsewhere) {
            check_sharing(url, part);
        }
    }

    /// The size of the store, if the answer is a range.
    std::optional<std::uint64_t> check_first_part(const std::string& url, const ServerReply& part) {
        if (part.status != 206) {
            add(url, "ranges", ServerFault::ranges,
                fmt::format("{} in place of 206 for the first {} bytes", part.status, kPart));
            return std::nullopt;
        }
        const std::string text = part.header("content-range");
        const std::optional<ContentRange> range = parse_content_range(text);
        const bool is_right = range && range->range && range->size && range->range->offset == 0 &&
                              range->range->size == kPart && part.body.size() == kPart &&
                              part.is_whole;
        note(url, "ranges", is_right, ServerFault::ranges,
             fmt::format("206, Content-Range: {}, {} bytes", quoted(text),
                         part.is_whole ? std::to_string(part.body.size()) : "more"));
        return is_right ? range->size : std::nullopt;
    }

    [[nodiscard]] bool shares(const ServerReply& reply) const {
        const std::string allowed = reply.header("access-control-allow-origin");
        return allowed == "*" || lower_case_of(allowed) == lower_case_of(origin_);
    }

    /// A page first asks for the length of the store, accepting compression as browsers do.
    void check_head(const std::string& url, std::optional<std::uint64_t> size, bool is_elsewhere) {
        const ServerReply head = ask({url, "HEAD", {kBrowserEncodings, "Origin: " + origin_}});
        const std::string length = head.header("content-length");
        const std::string encoding = head.header("content-encoding");
        if (head.status == 200 && !encoding.empty() && encoding != "identity") {
            add(url, "length", ServerFault::encoding,
                fmt::format("HEAD: Content-Encoding: {}", quoted(encoding)));
            return;
        }
        const bool is_right = head.status == 200 && !length.empty() &&
                              (!size || length == std::to_string(*size)) &&
                              (!is_elsewhere || shares(head) || !shares_parts_);
        note(url, "length", is_right, ServerFault::length,
             fmt::format("HEAD: {}, Content-Length: {}", head.status, quoted(length)));
    }

    void check_end(const std::string& url, std::uint64_t size) {
        const std::uint64_t from = size - std::min<std::uint64_t>(size, kPart);
        const ServerReply end = ask_part(url, fmt::format("{}-{}", from, size - 1));
        const bool is_part = end.status == 206 && end.body.size() == size - from;
        const bool is_footer = is_part && end.body.ends_with(kFooterEnd);
        note(url, "store", is_footer, ServerFault::missing,
             is_footer  ? fmt::format("{} bytes, with a footer", size)
             : !is_part ? fmt::format("{} in place of its last {} bytes", end.status, kPart)
                        : "the file has no store footer: it is not a store, is cut off, or has a "
                          "format older than 2.9");
    }

    void check_sharing(const std::string& url, const ServerReply& part) {
        note(url, "CORS origin", shares(part), ServerFault::origin,
             fmt::format("Access-Control-Allow-Origin: {} for {}",
                         quoted(part.header("access-control-allow-origin")), origin_));
        const std::string exposed = part.header("access-control-expose-headers");
        note(url, "CORS headers", lists(exposed, "etag"), ServerFault::exposed,
             fmt::format("Access-Control-Expose-Headers: {}", quoted(exposed)), false);
        const ServerReply before = ask({url,
                                        "OPTIONS",
                                        {"Origin: " + origin_, "Access-Control-Request-Method: GET",
                                         "Access-Control-Request-Headers: range"}});
        const std::string headers = before.header("access-control-allow-headers");
        note(url, "CORS preflight",
             before.status >= 200 && before.status < 300 && shares(before) &&
                 lists(headers, "range"),
             ServerFault::preflight,
             fmt::format("OPTIONS: {}, Access-Control-Allow-Headers: {}", before.status,
                         quoted(headers)),
             false);
    }

    std::string origin_;
    Progress& progress_;
    bool shares_parts_ = true;  ///< so that a fault of range requests is reported once
    ServerCheck check_;
};

}  // namespace

bool ServerCheck::is_right() const {
    return std::none_of(findings.begin(), findings.end(), [](const ServerFinding& finding) {
        return finding.fault != ServerFault::none && finding.is_needed;
    });
}

bool ServerCheck::has(ServerFault fault) const {
    return std::any_of(findings.begin(), findings.end(),
                       [&](const ServerFinding& finding) { return finding.fault == fault; });
}

std::string_view name_of(ServerFault fault) {
    switch (fault) {
        case ServerFault::none:
            return "none";
        case ServerFault::missing:
            return "missing";
        case ServerFault::length:
            return "length";
        case ServerFault::ranges:
            return "ranges";
        case ServerFault::encoding:
            return "encoding";
        case ServerFault::etag:
            return "etag";
        case ServerFault::origin:
            return "cors_origin";
        case ServerFault::exposed:
            return "cors_headers";
        case ServerFault::preflight:
            return "cors_preflight";
        case ServerFault::wasm_type:
            return "wasm_type";
        case ServerFault::script_type:
            return "script_type";
        case ServerFault::compression:
            return "compression";
    }
    return "none";
}

ServerCheck check_server(const std::string& url, const std::string& origin, Progress& progress) {
    progress.begin("querying the server", 0, "requests");
    return Checker(origin, progress).check(url);
}

namespace {

/// Whether something is missing that pages of other servers need to read the store.
bool lacks_sharing(const ServerCheck& check) {
    return check.has(ServerFault::origin) || check.has(ServerFault::exposed) ||
           check.has(ServerFault::preflight);
}

ServerLines nginx_lines(const ServerCheck& check) {
    const bool shares = lacks_sharing(check);
    std::string text;
    if (shares || check.has(ServerFault::encoding)) {
        text += "location ~ \\.isonest$ {\n";
        if (check.has(ServerFault::encoding)) {
            text += "    gzip off;\n";
        }
        if (shares) {
            text +=
                "    add_header Access-Control-Allow-Origin \"*\" always;\n"
                "    add_header Access-Control-Expose-Headers \"ETag\" always;\n"
                "    if ($request_method = OPTIONS) {\n"
                "        add_header Access-Control-Allow-Origin \"*\";\n"
                "        add_header Access-Control-Allow-Headers \"Range\";\n"
                "        add_header Access-Control-Max-Age 86400;\n"
                "        return 204;\n"
                "    }\n";
        }
        text += "}\n";
    }
    if (check.has(ServerFault::ranges)) {
        text +=
            "max_ranges 1;             # 0 switches ranges off\n"
            "proxy_force_ranges on;    # where it passes on what another server sends\n";
    }
    if (check.has(ServerFault::etag)) {
        text += "etag on;\n";
    }
    if (check.has(ServerFault::wasm_type)) {
        text += "location ~ \\.wasm$ { types { application/wasm wasm; } }\n";
    }
    if (check.has(ServerFault::script_type)) {
        text += "location ~ \\.m?js$ { types { text/javascript js mjs; } }\n";
    }
    if (check.has(ServerFault::compression)) {
        text += "gzip on;\ngzip_types application/wasm text/javascript;\n";
    }
    return {"nginx", "in the server block; then run nginx -s reload", text};
}

ServerLines apache_lines(const ServerCheck& check) {
    const bool shares = lacks_sharing(check);
    std::string text;
    if (shares || check.has(ServerFault::encoding)) {
        text += "<FilesMatch \"\\.isonest$\">\n";
        if (check.has(ServerFault::encoding)) {
            text += "    SetEnv no-gzip 1\n";
        }
        if (shares) {
            text +=
                "    Header always set Access-Control-Allow-Origin \"*\"\n"
                "    Header always set Access-Control-Expose-Headers \"ETag\"\n"
                "    Header always set Access-Control-Allow-Headers \"Range\"\n"
                "    Header always set Access-Control-Max-Age \"86400\"\n";
        }
        text += "</FilesMatch>\n";
    }
    if (check.has(ServerFault::ranges)) {
        text += "MaxRanges default    # in the server's own configuration\n";
    }
    if (check.has(ServerFault::etag)) {
        text += "FileETag MTime Size\n";
    }
    if (check.has(ServerFault::wasm_type)) {
        text += "AddType application/wasm .wasm\n";
    }
    if (check.has(ServerFault::script_type)) {
        text += "AddType text/javascript .js .mjs\n";
    }
    if (check.has(ServerFault::compression)) {
        text += "AddOutputFilterByType DEFLATE application/wasm text/javascript\n";
    }
    return {"Apache",
            "in .htaccess of the folder, with the modules headers, env and deflate (a2enmod)",
            text};
}

ServerLines s3_lines(const ServerCheck& check) {
    std::string text;
    if (lacks_sharing(check)) {
        text +=
            "aws s3api put-bucket-cors --bucket BUCKET --cors-configuration '{\"CORSRules\": "
            "[{\"AllowedOrigins\": [\"*\"], \"AllowedMethods\": [\"GET\", \"HEAD\"], "
            "\"AllowedHeaders\": [\"Range\"], \"ExposeHeaders\": [\"ETag\"], \"MaxAgeSeconds\": "
            "86400}]}'\n";
    }
    if (check.has(ServerFault::encoding)) {
        text += "aws s3 cp STORE s3://BUCKET/STORE    # without --content-encoding\n";
    }
    if (check.has(ServerFault::wasm_type)) {
        text += "aws s3 cp isonest.wasm s3://BUCKET/isonest.wasm --content-type application/wasm\n";
    }
    if (check.has(ServerFault::script_type)) {
        text +=
            "aws s3 cp . s3://BUCKET/ --recursive --exclude '*' --include '*.js' --include '*.mjs' "
            "--content-type text/javascript\n";
    }
    if (check.has(ServerFault::compression)) {
        text +=
            "gzip -k isonest.wasm && aws s3 cp isonest.wasm.gz s3://BUCKET/isonest.wasm "
            "--content-type application/wasm --content-encoding gzip\n";
    }
    return {"S3", "once, with the bucket's name; S3 itself answers ranges and has ETags", text};
}

}  // namespace

std::vector<ServerLines> lines_to_add(const ServerCheck& check) {
    std::vector<ServerLines> all;
    for (ServerLines& lines :
         std::vector{nginx_lines(check), apache_lines(check), s3_lines(check)}) {
        if (!lines.lines.empty()) {
            all.push_back(std::move(lines));
        }
    }
    return all;
}

}  // namespace isonest::detail::publish
