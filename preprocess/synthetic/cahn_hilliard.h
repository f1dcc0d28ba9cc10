// A time step of the separation of two fluids, as the paper's section 6 has one.
#pragma once

#include <cstdint>
#include <memory>

#include "preprocess/synthetic/synthetic.h"

namespace isonest::detail {

/// The concentration u, -1 to 1, of the Cahn-Hilliard equation
///   du/dt = laplace(u^3 - u - laplace(u) / 2)
/// after 200 units of time from small noise, on a square with mirrored borders, one node a unit;
/// every plane of a volume is the same. Made at once in memory (24 bytes a node of a plane), by
/// explicit Euler steps. Throws Error{limit} beyond 4096 x 4096 nodes.
std::unique_ptr<SyntheticVolume> make_cahn_hilliard(const Int3& nodes, std::uint64_t seed);

}  // namespace isonest::detail
