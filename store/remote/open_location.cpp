#include "store/remote/open_location.h"

#include <algorithm>
#include <array>
#include <cstdlib>
#include <utility>

#include <isonest/error.h>
#include <isonest/series.h>

#include "store/bytes/disk_cache.h"
#include "store/bytes/store_bytes.h"
#include "store/remote/object_url.h"

#if ISONEST_WITH_REMOTE
#include <exception>
#include <memory>
#include <new>

#include "store/remote/curl_request.h"
#include "store/remote/url_bytes.h"
#include "store/remote/url_folder.h"
#endif

namespace isonest::detail {
namespace {

ObjectUrl parsed_url(std::string_view url) {
    return parse_object_url(url, [](const char* name) -> const char* { return std::getenv(name); });
}

#if !ISONEST_WITH_REMOTE
[[noreturn]] void refuse_urls(const ObjectUrl& url) {
    throw Error(ErrorKind::unsupported, {url.name},
                "this build cannot read URLs: it has no libcurl",
                {{RemedyKind::install_package, "libcurl4-openssl-dev"}});
}
#endif

}  // namespace

std::unique_ptr<StoreBytes> open_url(std::string_view url,
                                     [[maybe_unused]] const RemoteOptions& options) {
    ObjectUrl parsed = parsed_url(url);
#if ISONEST_WITH_REMOTE
    return std::make_unique<UrlBytes>(std::move(parsed), options);
#else
    refuse_urls(parsed);
#endif
}

std::unique_ptr<ObjectFolder> open_url_folder(std::string_view url,
                                              [[maybe_unused]] const RemoteOptions& options) {
    const ObjectUrl parsed = parsed_url(url);
#if ISONEST_WITH_REMOTE
    return std::make_unique<UrlFolder>(parsed, options);
#else
    refuse_urls(parsed);
#endif
}

std::string ServerReply::header(std::string_view name) const {
    std::string all;
    for (const auto& [key, value] : headers) {
        if (key == name) {
            all += (all.empty() ? "" : ", ") + value;
        }
    }
    return all;
}

bool ServerReply::has(std::string_view name) const {
    for (const auto& [key, value] : headers) {
        if (key == name) {
            return true;
        }
    }
    return false;
}

#if ISONEST_WITH_REMOTE
namespace {

constexpr long kMaxRedirects = 5;
constexpr long kConnectSeconds = 10;
constexpr long kSlowSeconds = 20;
constexpr std::size_t kMaxHeaderBytes = std::size_t{1} << 20U;

struct Asking {
    ServerReply reply;
    std::size_t max_body = 0;
    std::size_t header_bytes = 0;
    const std::function<void()>* check = nullptr;
    std::exception_ptr thrown;
};

std::size_t take_header(char* data, std::size_t /*one*/, std::size_t size, void* self) {
    auto& asking = *static_cast<Asking*>(self);
    try {
        std::string_view line(data, size);
        asking.header_bytes += size;
        if (asking.header_bytes > kMaxHeaderBytes) {
            return 0;
        }
        if (line.starts_with("HTTP/")) {  // also after a redirect, whose headers are discarded
            asking.reply.headers.clear();
            return size;
        }
        const std::size_t colon = line.find(':');
        if (colon == std::string_view::npos) {
            return size;
        }
        std::string name(line.substr(0, colon));
        std::transform(name.begin(), name.end(), name.begin(), [](char c) {
            return c >= 'A' && c <= 'Z' ? static_cast<char>(c + ('a' - 'A')) : c;
        });
        line.remove_prefix(colon + 1);
        const std::size_t first = std::min(line.find_first_not_of(" \t"), line.size());
        const std::size_t last = line.find_last_not_of(" \t\r\n");
        asking.reply.headers.emplace_back(std::move(name),
                                          last == std::string_view::npos || last < first
                                              ? ""
                                              : std::string(line.substr(first, last + 1 - first)));
        return size;
    } catch (...) {
        asking.thrown = std::current_exception();
        return 0;
    }
}

std::size_t take_bytes(char* data, std::size_t /*one*/, std::size_t size, void* self) {
    auto& asking = *static_cast<Asking*>(self);
    try {
        const std::size_t left = asking.max_body - asking.reply.body.size();
        asking.reply.body.append(data, std::min(left, size));
        asking.reply.is_whole = size <= left;
        return size <= left ? size : 0;
    } catch (...) {
        asking.thrown = std::current_exception();
        return 0;
    }
}

int go_on(void* self, curl_off_t /*unused*/, curl_off_t /*unused*/, curl_off_t /*unused*/,
          curl_off_t /*unused*/) {
    auto& asking = *static_cast<Asking*>(self);
    try {
        (*asking.check)();
        return 0;
    } catch (...) {
        asking.thrown = std::current_exception();
        return 1;
    }
}

}  // namespace

ServerReply ask_server(const ServerQuestion& question, const std::function<void()>& check) {
    const ObjectUrl url = parse_object_url(
        question.url, [](const char* name) -> const char* { return std::getenv(name); });
    const CurlLibrary& c = curl();
    const std::unique_ptr<CURL, decltype(c.curl_easy_cleanup)> handle(c.curl_easy_init(),
                                                                      c.curl_easy_cleanup);
    if (!handle) {
        throw std::bad_alloc();
    }
    std::unique_ptr<curl_slist, decltype(c.curl_slist_free_all)> lines(nullptr,
                                                                       c.curl_slist_free_all);
    for (const std::string& header : question.headers) {
        curl_slist* const longer = c.curl_slist_append(lines.get(), header.c_str());
        if (longer == nullptr) {
            throw std::bad_alloc();
        }
        static_cast<void>(lines.release());
        lines.reset(longer);
    }
    Asking asking;
    asking.max_body = question.max_body;
    asking.check = &check;
    char said[CURL_ERROR_SIZE] = {};
    CURL* const h = handle.get();
    c.curl_easy_setopt(h, CURLOPT_URL, url.request.c_str());
    c.curl_easy_setopt(h, CURLOPT_PATH_AS_IS, 1L);
    c.curl_easy_setopt(h, CURLOPT_PROTOCOLS_STR, "https,http");
    c.curl_easy_setopt(h, CURLOPT_REDIR_PROTOCOLS_STR, "https,http");
    c.curl_easy_setopt(h, CURLOPT_FOLLOWLOCATION, 1L);
    c.curl_easy_setopt(h, CURLOPT_MAXREDIRS, kMaxRedirects);
    c.curl_easy_setopt(h, CURLOPT_CUSTOMREQUEST, question.method.c_str());
    c.curl_easy_setopt(h, CURLOPT_NOBODY, question.method == "HEAD" ? 1L : 0L);
    c.curl_easy_setopt(h, CURLOPT_HTTPHEADER, lines.get());
    c.curl_easy_setopt(h, CURLOPT_HTTP_CONTENT_DECODING, 0L);
    c.curl_easy_setopt(h, CURLOPT_NOSIGNAL, 1L);
    c.curl_easy_setopt(h, CURLOPT_CONNECTTIMEOUT, kConnectSeconds);
    c.curl_easy_setopt(h, CURLOPT_LOW_SPEED_LIMIT, 1L);
    c.curl_easy_setopt(h, CURLOPT_LOW_SPEED_TIME, kSlowSeconds);
    c.curl_easy_setopt(h, CURLOPT_SUPPRESS_CONNECT_HEADERS, 1L);
    c.curl_easy_setopt(h, CURLOPT_USERAGENT, "isonest");
    c.curl_easy_setopt(h, CURLOPT_ERRORBUFFER, said);
    c.curl_easy_setopt(h, CURLOPT_HEADERFUNCTION, &take_header);
    c.curl_easy_setopt(h, CURLOPT_HEADERDATA, &asking);
    c.curl_easy_setopt(h, CURLOPT_WRITEFUNCTION, &take_bytes);
    c.curl_easy_setopt(h, CURLOPT_WRITEDATA, &asking);
    c.curl_easy_setopt(h, CURLOPT_NOPROGRESS, 0L);
    c.curl_easy_setopt(h, CURLOPT_XFERINFOFUNCTION, &go_on);
    c.curl_easy_setopt(h, CURLOPT_XFERINFODATA, &asking);
    for (const auto& [variable, option] :
         {std::pair{"SSL_CERT_FILE", CURLOPT_CAINFO}, std::pair{"SSL_CERT_DIR", CURLOPT_CAPATH},
          std::pair{"CURL_CA_BUNDLE", CURLOPT_CAINFO}}) {
        if (const char* const value = std::getenv(variable); value != nullptr && *value != 0) {
            c.curl_easy_setopt(h, option, value);
        }
    }
    const CURLcode code = c.curl_easy_perform(h);
    if (asking.thrown) {
        std::rethrow_exception(asking.thrown);
    }
    if (code != CURLE_OK && !(code == CURLE_WRITE_ERROR && !asking.reply.is_whole)) {
        throw error_of(failure_of_transfer(code, said[0] != 0 ? said : c.curl_easy_strerror(code)),
                       url.name, 1);
    }
    long number = 0;
    c.curl_easy_getinfo(h, CURLINFO_RESPONSE_CODE, &number);
    asking.reply.status = static_cast<int>(number);
    c.curl_easy_getinfo(h, CURLINFO_REDIRECT_COUNT, &number);
    asking.reply.redirects = static_cast<int>(number);
    return std::move(asking.reply);
}
#else
ServerReply ask_server(const ServerQuestion& question, const std::function<void()>& /*check*/) {
    throw Error(ErrorKind::unsupported, {question.url},
                "this build cannot contact servers: it has no libcurl",
                {{RemedyKind::install_package, "libcurl4-openssl-dev"}});
}
#endif

namespace {

RemoteOptions options_of(const RemoteAccess& remote,
                         const std::shared_ptr<const DiskCache>& cache) {
    RemoteOptions options;
    options.headers = remote.headers;
    options.budget_bytes = std::max(remote.memory, RemoteAccess::kMinMemory) - kRemoteHeap;
    options.connect_timeout = remote.connect_timeout;
    options.slow_time = remote.slow_time;
    options.retry.total = remote.retry_time;
    options.check = remote.check;
    if (cache) {
        options.make_cache = [cache](const ObjectState& object) -> std::shared_ptr<RangeCache> {
            return cache->of(object);
        };
        options.recall = [cache](const ObjectState& object) { return cache->last_of(object); };
        options.remember = [cache](const ObjectState& object) { cache->remember(object); };
    }
    return options;
}

void check_headers(const std::filesystem::path& location, const RemoteAccess& remote) {
    if (!std::all_of(remote.headers.begin(), remote.headers.end(), is_header)) {
        throw Error(ErrorKind::invalid_argument, {shown_location(location.native())},
                    "a header must be one line 'Name: value'; headers about ranges and conditions "
                    "are reserved");
    }
}

}  // namespace

std::shared_ptr<const StoreBytes> open_location(const std::filesystem::path& location,
                                                const RemoteAccess& remote,
                                                const std::shared_ptr<const DiskCache>& cache) {
    if (!is_url(location.native())) {
        require_no_series(location);
        return std::make_shared<FileBytes>(location);
    }
    check_headers(location, remote);
    return open_url(location.native(), options_of(remote, cache));
}

std::shared_ptr<ObjectFolder> open_folder_location(const std::filesystem::path& location,
                                                   const RemoteAccess& remote) {
    check_headers(location, remote);
    return open_url_folder(location.native(), options_of(remote, nullptr));
}

std::shared_ptr<const DiskCache> open_cache(const std::filesystem::path& location,
                                            const RemoteAccess& remote) {
    return !remote.cache.empty() && is_url(location.native())
               ? std::make_shared<const DiskCache>(remote.cache, remote.cache_bytes)
               : nullptr;
}

std::string cache_warning(const DiskCache* cache) {
    return cache != nullptr ? cache->warning() : std::string();
}

bool is_header(std::string_view line) {
    constexpr std::string_view kOthers = "!#$%&'*+-.^_`|~";
    constexpr std::array<std::string_view, 8> kOurs{
        "range",           "if-range",          "if-match",
        "if-none-match",   "if-modified-since", "if-unmodified-since",
        "accept-encoding", "content-length"};
    const std::size_t colon = line.find(':');
    std::string name(line.substr(0, colon));
    std::transform(name.begin(), name.end(), name.begin(),
                   [](char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c + 32) : c; });
    return colon != std::string_view::npos && !name.empty() &&
           std::all_of(name.begin(), name.end(),
                       [&](char c) {
                           return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') ||
                                  kOthers.find(c) != std::string_view::npos;
                       }) &&
           std::find(kOurs.begin(), kOurs.end(), name) == kOurs.end() &&
           std::all_of(line.begin(), line.end(), [](char c) {
               return (static_cast<unsigned char>(c) >= ' ' && c != 0x7F) || c == '\t';
           });
}

std::string shown_location(std::string_view location) {
    if (!is_url(location)) {
        return std::string(location);
    }
    try {
        return parse_object_url(location,
                                [](const char* name) -> const char* { return std::getenv(name); })
            .name;
    } catch (const Error& error) {
        return error.place().file;
    }
}

}  // namespace isonest::detail
