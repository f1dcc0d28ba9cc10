// libcurl, loaded when the first URL is opened: what reads files alone runs, and links, without it
// and the thirty libraries that it brings. (Debian's HDF5 brings them anyway; others' need not.)
#pragma once

#include <curl/curl.h>

namespace isonest::detail {

#define ISONEST_CURL_FUNCTIONS(X) \
    X(curl_global_init)           \
    X(curl_easy_init)             \
    X(curl_easy_setopt)           \
    X(curl_easy_getinfo)          \
    X(curl_easy_perform)          \
    X(curl_easy_reset)            \
    X(curl_easy_cleanup)          \
    X(curl_easy_strerror)         \
    X(curl_slist_append)          \
    X(curl_slist_free_all)        \
    X(curl_multi_init)            \
    X(curl_multi_setopt)          \
    X(curl_multi_add_handle)      \
    X(curl_multi_remove_handle)   \
    X(curl_multi_perform)         \
    X(curl_multi_poll)            \
    X(curl_multi_wakeup)          \
    X(curl_multi_info_read)       \
    X(curl_multi_cleanup)         \
    X(curl_url)                   \
    X(curl_url_set)               \
    X(curl_url_get)               \
    X(curl_url_cleanup)           \
    X(curl_free)

/// Its functions, as its own headers declare them.
struct CurlLibrary {
#define ISONEST_CURL_MEMBER(name) \
    decltype(&::name) name = nullptr;  // NOLINT(bugprone-macro-parentheses)
    ISONEST_CURL_FUNCTIONS(ISONEST_CURL_MEMBER)
#undef ISONEST_CURL_MEMBER
};

/// Loads it once, for good. Throws Error{unsupported} if it is not there.
const CurlLibrary& curl();

}  // namespace isonest::detail
