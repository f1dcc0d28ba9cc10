// ISONEST_SIMD before a function: compiled for several instruction sets, chosen when the program
// starts. The results are the same on all of them, because contraction to fused operations is off.
#pragma once

#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && \
    !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
#define ISONEST_SIMD __attribute__((target_clones("avx512f", "avx2", "default")))
#else
#define ISONEST_SIMD
#endif
