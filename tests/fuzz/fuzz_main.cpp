// libFuzzer's entry; ISONEST_FUZZ_TARGET is a function of targets.h.
#include "tests/fuzz/targets.h"

// NOLINTNEXTLINE(readability-identifier-naming)
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    isonest::detail::fuzz::ISONEST_FUZZ_TARGET({data, size});
    return 0;
}
