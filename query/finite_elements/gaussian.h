// G_sigma * u on a lattice in memory.
#pragma once

#include <span>

#include <isonest/int3.h>

namespace isonest::detail {

/// Convolves with a Gaussian of standard deviation sigma (world units) that is sampled at the nodes
/// and cut off at four sigma, axis by axis; beyond the border the function is mirrored at the last
/// node. A constant stays. sigma = 0: nothing happens. Uses the threads of the arena that calls.
void smooth_gaussian(std::span<float> values, const Int3& nodes, const Double3& spacing,
                     double sigma);

}  // namespace isonest::detail
