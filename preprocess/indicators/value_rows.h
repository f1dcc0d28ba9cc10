// Prepares rows of values for the kernels; compiled for several instruction sets.
#pragma once

#include <cstdint>
#include <span>

#include <isonest/value_type.h>

#include "store/base/box.h"
#include "store/container/format.h"

namespace isonest::detail {

// For every value type T, without aliasing:

/// out[i] = in[i]; 0 if that is not finite.
template <class T>
void widen_row(const T* in, RealFor<T>* out, std::int64_t n);
/// even[i] = in[2 step i], odd[i] = in[2 step i + step], converted likewise.
template <class T>
void split_row(const T* in, std::int64_t step, RealFor<T>* even, RealFor<T>* odd, std::int64_t n);
/// out[i] = in[step i].
template <class T>
void take_row(const T* in, std::int64_t step, T* out, std::int64_t n);
/// low[i] = min(low[i], in[i]) and high[i] = max(high[i], in[i]); NaN is ignored.
template <class T>
void range_row(const T* in, T* low, T* high, std::int64_t n);

/// Whether no value is NaN or infinite. Real: float or double.
template <class Real>
bool all_finite(const Real* in, std::int64_t n);

// The range of the values within each cube: see store/container/format.h.

/// Computes the ranges of the cubes of level kFirstRangeLevel in `to`. `values`: of level 0, with
/// all nodes of the cubes that are <= `last`. Thread-safe.
template <class T>
void find_cube_ranges(const Box<T>& values, const Int3& last, Box<CubeRange>& to);

/// Computes the ranges of a level from those of the next finer level; cubes [z][y][x].
void merge_cube_ranges(std::span<const CubeRange> fine, const Int3& fine_cells,
                       std::span<CubeRange> coarse, const Int3& coarse_cells);

}  // namespace isonest::detail
