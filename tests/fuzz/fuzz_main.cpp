// libFuzzer's entry point for the target of targets.h that the environment variable
// ISONEST_FUZZ_TARGET names.
#include <cstdio>
#include <cstdlib>
#include <functional>

#include "tests/fuzz/targets.h"

namespace {

const isonest::detail::fuzz::Target& target() {
    static const isonest::detail::fuzz::Target& chosen = [] {
        const char* const name = std::getenv("ISONEST_FUZZ_TARGET");
        for (const auto& one : isonest::detail::fuzz::targets()) {
            if (name != nullptr && one.name == name) {
                return std::cref(one);
            }
        }
        std::fputs("ISONEST_FUZZ_TARGET names no target of tests/fuzz/targets.cpp\n", stderr);
        std::exit(2);
    }();
    return chosen;
}

}  // namespace

// NOLINTNEXTLINE(readability-identifier-naming)
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    target().run({data, size});
    return 0;
}
