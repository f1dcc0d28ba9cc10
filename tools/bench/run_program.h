// The main() of the benchmarks' small programs.
#pragma once

#include <cstdio>
#include <exception>

namespace bench {

/// Runs a program. Prints an exception with the program's name and then returns 1.
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
