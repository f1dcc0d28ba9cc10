// The equation: J. Cahn, J. Hilliard, "Free energy of a nonuniform system. I. Interfacial free
// energy", J. Chem. Phys. 28 (1958).
#include "preprocess/synthetic/cahn_hilliard.h"

#include <fmt/format.h>
#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <random>

#include <isonest/error.h>

namespace isonest::detail {
namespace {

constexpr double kStep = 0.03;  // stable below 1/16: the square of a Laplacian's 8, times 1/2
constexpr int kSteps = 6667;
constexpr std::int64_t kMost = 4096;

class CahnHilliard : public SyntheticVolume {
  public:
    CahnHilliard(const Int3& nodes, std::uint64_t seed)
        : nx_(nodes.x), ny_(nodes.y), u_(static_cast<std::size_t>(nx_ * ny_)) {
        // The generator's own numbers, because distributions differ between libraries.
        std::mt19937_64 random(seed);
        for (double& u : u_) {
            u = 0.1 * (static_cast<double>(random() >> 11U) * 0x1p-53 - 0.5);
        }
        std::vector<double> potential(u_.size());
        for (int step = 0; step < kSteps; ++step) {
            each_row([&](std::int64_t y) {
                for (std::int64_t x = 0; x < nx_; ++x) {
                    const std::size_t i = at(x, y);
                    potential[i] = u_[i] * u_[i] * u_[i] - u_[i] - 0.5 * laplace(u_, x, y);
                }
            });
            each_row([&](std::int64_t y) {
                for (std::int64_t x = 0; x < nx_; ++x) {
                    u_[at(x, y)] += kStep * laplace(potential, x, y);
                }
            });
        }
    }
    [[nodiscard]] double low() const override { return -1.2; }
    [[nodiscard]] double high() const override { return 1.2; }
    void row(std::int64_t y, std::int64_t /*z*/, double* out) const override {
        std::copy_n(u_.begin() + static_cast<std::ptrdiff_t>(y * nx_), nx_, out);
    }

  private:
    [[nodiscard]] std::size_t at(std::int64_t x, std::int64_t y) const {
        return static_cast<std::size_t>(y * nx_ + x);
    }
    template <class F>
    void each_row(const F& f) const {
        tbb::parallel_for(std::int64_t{0}, ny_, f);
    }
    [[nodiscard]] double laplace(const std::vector<double>& v, std::int64_t x,
                                 std::int64_t y) const {
        const double west = v[at(std::max<std::int64_t>(x - 1, 0), y)];
        const double east = v[at(std::min(x + 1, nx_ - 1), y)];
        const double south = v[at(x, std::max<std::int64_t>(y - 1, 0))];
        const double north = v[at(x, std::min(y + 1, ny_ - 1))];
        return west + east + south + north - 4 * v[at(x, y)];
    }

    std::int64_t nx_;
    std::int64_t ny_;
    std::vector<double> u_;
};

}  // namespace

std::unique_ptr<SyntheticVolume> make_cahn_hilliard(const Int3& nodes, std::uint64_t seed) {
    if (nodes.x > kMost || nodes.y > kMost) {
        throw Error(ErrorKind::limit,
                    fmt::format("cahn-hilliard: a plane of {} x {} nodes: at most "
                                "{} x {} can be computed",
                                nodes.x, nodes.y, kMost, kMost));
    }
    return std::make_unique<CahnHilliard>(nodes, seed);
}

}  // namespace isonest::detail
