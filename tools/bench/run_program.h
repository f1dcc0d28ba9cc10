// What main() of each small program of the benchmarks does.
#pragma once

#include <cstdio>
#include <exception>

namespace bench {

/// Runs a program. What it throws is said under its name; then 1.
template <class Run>
int run_program(const char* name, const Run& run) {
    try {
        return run();
    } catch (const std::exception& error) {
        std::fprintf(stderr, "%s: %s\n", name, error.what());
        return 1;
    }
}

}  // namespace bench
