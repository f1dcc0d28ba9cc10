// Counts the bytes that a program holds from malloc and related functions, as rounded by the
// allocator, and prints the peak at exit: LD_PRELOAD=libisonest_peak_heap.so isonest extract ...
//
// File mappings and thread stacks are not counted; operator new uses malloc.
#include <malloc.h>

#include <atomic>
#include <cerrno>
#include <cstddef>
#include <cstdio>
#include <cstdlib>

namespace {

std::atomic<std::size_t> held{0};
std::atomic<std::size_t> peak{0};

// glibc's own functions.
// NOLINTBEGIN(bugprone-reserved-identifier,readability-identifier-naming)
extern "C" void* __libc_malloc(std::size_t);
extern "C" void* __libc_calloc(std::size_t, std::size_t);
extern "C" void* __libc_realloc(void*, std::size_t);
extern "C" void* __libc_memalign(std::size_t, std::size_t);
extern "C" void __libc_free(void*);
// NOLINTEND(bugprone-reserved-identifier,readability-identifier-naming)

void* taken(void* p) {
    if (p != nullptr) {
        const std::size_t size = ::malloc_usable_size(p);
        const std::size_t now = held.fetch_add(size) + size;
        std::size_t before = peak.load();
        while (now > before && !peak.compare_exchange_weak(before, now)) {
        }
    }
    return p;
}

void given_back(void* p) {
    if (p != nullptr) {
        held.fetch_sub(::malloc_usable_size(p));
    }
}

[[gnu::destructor]] void report() {
    std::fprintf(stderr, "peak heap %zu bytes\n", peak.load());
}
[[gnu::constructor]] void report_at_quick_exit_too() {
    std::at_quick_exit(&report);
}

}  // namespace

// NOLINTBEGIN(readability-inconsistent-declaration-parameter-name)
extern "C" {
void* malloc(std::size_t n) {
    return taken(__libc_malloc(n));
}
void* calloc(std::size_t n, std::size_t size) {
    return taken(__libc_calloc(n, size));
}
void* realloc(void* p, std::size_t n) {
    given_back(p);
    void* const moved = __libc_realloc(p, n);
    if (moved == nullptr && n != 0) {
        taken(p);
    }
    return taken(moved);
}
void* memalign(std::size_t alignment, std::size_t n) {
    return taken(__libc_memalign(alignment, n));
}
void* aligned_alloc(std::size_t alignment, std::size_t n) {
    return taken(__libc_memalign(alignment, n));
}
int posix_memalign(void** p, std::size_t alignment, std::size_t n) {
    *p = taken(__libc_memalign(alignment, n));
    return *p == nullptr ? ENOMEM : 0;
}
void free(void* p) {
    given_back(p);
    __libc_free(p);
}
}
// NOLINTEND(readability-inconsistent-declaration-parameter-name)
