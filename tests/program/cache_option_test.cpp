// --cache: a folder, and its maximum size.
#include <catch2/catch.hpp>
#include <string>
#include <tuple>
#include <vector>

#include <isonest/error.h>

#include "tools/cli/options/remote_options.h"

using namespace isonest;
using namespace isonest::detail::cli;

TEST_CASE("a cache is a folder, optionally followed by a colon and its size") {
    const std::uint64_t usual = CacheChoice().bytes;
    CHECK(usual == std::uint64_t{1} << 30U);
    const std::vector<std::tuple<const char*, const char*, std::uint64_t>> cases{
        {"cache", "cache", usual},
        {"cache:2G", "cache", 2ULL << 30U},
        {"/var/cache/scans:1.5 MiB", "/var/cache/scans", 3ULL << 19U},
        {"a:b", "a:b", usual},
        {"a:b:512K", "a:b", 512ULL << 10U},
        {"a:5:10", "a:5", 10},
        {"C:/scans", "C:/scans", usual},
        {"cache:10X", "cache:10X", usual},
        {"cache:-1G", "cache:-1G", usual},
        {"cache:", "cache:", usual},
        {"2G", "2G", usual},
    };
    for (const auto& [text, folder, bytes] : cases) {
        CAPTURE(text);
        const CacheChoice choice = parse_cache("--cache", text);
        CHECK(choice.folder == folder);
        CHECK(choice.bytes == bytes);
    }
}

TEST_CASE("an empty folder and a size of zero are refused, and the message names the option") {
    for (const char* text : {"", ":1G", "cache:0", "cache:0M"}) {
        CAPTURE(text);
        try {
            parse_cache("--cache", text);
            FAIL("was taken");
        } catch (const Error& error) {
            CHECK(error.kind() == ErrorKind::invalid_argument);
            CHECK(std::string(error.what()).find("--cache '" + std::string(text) + "'") !=
                  std::string::npos);
        }
    }
}
