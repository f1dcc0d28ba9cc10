#include "preprocess/synthetic/synthetic.h"

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <numbers>

#include <isonest/error.h>

#include "preprocess/synthetic/cahn_hilliard.h"

namespace isonest::detail {
namespace {

/// Position of node i of n in the unit interval.
double unit(std::int64_t i, std::int64_t n) {
    return n == 1 ? 0.5 : static_cast<double>(i) / static_cast<double>(n - 1);
}

/// Sum of Gaussians at the 60 atoms of C60: the corners of a truncated icosahedron.
class Bucky : public SyntheticVolume {
  public:
    explicit Bucky(const Int3& nodes) : nodes_(nodes) {
        const double phi = std::numbers::phi;
        const std::array<Double3, 3> seeds{
            {{0, 1, 3 * phi}, {1, 2 + phi, 2 * phi}, {phi, 2, 2 * phi + 1}}};
        for (const Double3& s : seeds) {
            for (unsigned signs = 0; signs < 8; ++signs) {
                Double3 p = s;
                bool again = false;
                for (std::size_t i = 0; i < 3; ++i) {
                    if ((signs >> i & 1U) != 0) {
                        again = again || p[i] == 0;
                        p[i] = -p[i];
                    }
                }
                for (std::size_t turn = 0; turn < 3 && !again; ++turn) {
                    add_atom({p[turn], p[(turn + 1) % 3], p[(turn + 2) % 3]});
                }
            }
        }
    }
    [[nodiscard]] double low() const override { return 0; }
    [[nodiscard]] double high() const override { return 1.05; }
    void row(std::int64_t y, std::int64_t z, double* out) const override {
        std::fill(out, out + nodes_.x, 0.0);
        for (const auto& atom : atoms_) {
            const double yz =
                atom[1][static_cast<std::size_t>(y)] * atom[2][static_cast<std::size_t>(z)];
            if (yz < 1e-9) {
                continue;
            }
            const double* const x = atom[0].data();
            for (std::int64_t i = 0; i < nodes_.x; ++i) {
                out[i] += yz * x[i];
            }
        }
    }

  private:
    void add_atom(const Double3& p) {
        constexpr double kRadius = 0.36;
        constexpr double kWidth = 0.05;
        const double length = std::hypot(p[0], p[1], p[2]);
        auto& atom = atoms_.emplace_back();
        for (int axis = 0; axis < 3; ++axis) {
            const auto a = static_cast<std::size_t>(axis);
            const double centre = 0.5 + kRadius * p[a] / length;
            for (std::int64_t i = 0; i < nodes_[axis]; ++i) {
                const double d = (unit(i, nodes_[axis]) - centre) / kWidth;
                atom[a].push_back(std::exp(-d * d / 2));
            }
        }
    }
    Int3 nodes_;
    std::vector<std::array<std::vector<double>, 3>> atoms_;
};

/// S. Marschner, R. Lobb, "An evaluation of reconstruction filters for volume rendering" (1994).
class MarschnerLobb : public SyntheticVolume {
  public:
    explicit MarschnerLobb(const Int3& nodes) : nodes_(nodes) {}
    [[nodiscard]] double low() const override { return 0; }
    [[nodiscard]] double high() const override { return 1; }
    void row(std::int64_t y, std::int64_t z, double* out) const override {
        constexpr double kFrequency = 6;
        constexpr double kAlpha = 0.25;
        const double pi = std::numbers::pi;
        const double py = 2 * unit(y, nodes_.y) - 1;
        const double pz = 2 * unit(z, nodes_.z) - 1;
        for (std::int64_t i = 0; i < nodes_.x; ++i) {
            const double px = 2 * unit(i, nodes_.x) - 1;
            const double rho =
                std::cos(2 * pi * kFrequency * std::cos(pi * std::sqrt(px * px + py * py) / 2));
            out[i] = (1 - std::sin(pi * pz / 2) + kAlpha * (1 + rho)) / (2 * (1 + kAlpha));
        }
    }

  private:
    Int3 nodes_;
};

/// Band-limited noise: hashed lattice values, blended smoothly, in octaves of half the size and
/// weight.
class Noise : public SyntheticVolume {
  public:
    Noise(const Int3& nodes, std::uint64_t seed) : nodes_(nodes), seed_(seed) {}
    [[nodiscard]] double low() const override { return -1; }
    [[nodiscard]] double high() const override { return 1; }
    void row(std::int64_t y, std::int64_t z, double* out) const override {
        std::fill(out, out + nodes_.x, 0.0);
        double weight = 0.5;
        for (std::int64_t cells = 8; cells <= 64; cells *= 2) {
            add_octave(y, z, cells, weight, out);
            weight /= 2;
        }
    }

  private:
    static double fade(double t) { return t * t * t * (t * (t * 6 - 15) + 10); }
    [[nodiscard]] double lattice(std::int64_t x, std::int64_t y, std::int64_t z,
                                 std::int64_t cells) const {
        std::uint64_t h = seed_ * 0x9E3779B97F4A7C15ULL + static_cast<std::uint64_t>(cells);
        for (const std::int64_t v : {x, y, z}) {
            h = (h ^ static_cast<std::uint64_t>(v)) * 0xFF51AFD7ED558CCDULL;
            h ^= h >> 32U;
        }
        return static_cast<double>(h >> 11U) * 0x1p-52 - 1;
    }
    void add_octave(std::int64_t y, std::int64_t z, std::int64_t cells, double weight,
                    double* out) const {
        const double py = unit(y, nodes_.y) * static_cast<double>(cells);
        const double pz = unit(z, nodes_.z) * static_cast<double>(cells);
        const auto cy = static_cast<std::int64_t>(py);
        const auto cz = static_cast<std::int64_t>(pz);
        const double fy = fade(py - static_cast<double>(cy));
        const double fz = fade(pz - static_cast<double>(cz));
        const auto column = [&](std::int64_t x) {
            const double a =
                std::lerp(lattice(x, cy, cz, cells), lattice(x, cy + 1, cz, cells), fy);
            const double b =
                std::lerp(lattice(x, cy, cz + 1, cells), lattice(x, cy + 1, cz + 1, cells), fy);
            return a + fz * (b - a);
        };
        std::int64_t at = 0;
        double left = column(0);
        double right = column(1);
        for (std::int64_t i = 0; i < nodes_.x; ++i) {
            const double px = unit(i, nodes_.x) * static_cast<double>(cells);
            const auto cx = static_cast<std::int64_t>(px);
            for (; at < cx; ++at) {
                left = right;
                right = column(at + 2);
            }
            out[i] += weight * (left + fade(px - static_cast<double>(cx)) * (right - left));
        }
    }
    Int3 nodes_;
    std::uint64_t seed_;
};

/// 0.5 minus the distance from the centre: every isosurface is a sphere.
class Sphere : public SyntheticVolume {
  public:
    explicit Sphere(const Int3& nodes) : nodes_(nodes) {}
    [[nodiscard]] double low() const override { return -0.4; }
    [[nodiscard]] double high() const override { return 0.5; }
    void row(std::int64_t y, std::int64_t z, double* out) const override {
        const double py = unit(y, nodes_.y) - 0.5;
        const double pz = unit(z, nodes_.z) - 0.5;
        for (std::int64_t i = 0; i < nodes_.x; ++i) {
            const double px = unit(i, nodes_.x) - 0.5;
            out[i] = 0.5 - std::sqrt(px * px + py * py + pz * pz);
        }
    }

  private:
    Int3 nodes_;
};

}  // namespace

const std::vector<std::string>& synthetic_names() {
    static const std::vector<std::string> names{"bucky", "cahn-hilliard", "marschner-lobb", "noise",
                                                "sphere"};
    return names;
}

std::unique_ptr<SyntheticVolume> make_synthetic(const std::string& name, const Int3& nodes,
                                                std::uint64_t seed) {
    if (name == "bucky") {
        return std::make_unique<Bucky>(nodes);
    }
    if (name == "cahn-hilliard") {
        return make_cahn_hilliard(nodes, seed);
    }
    if (name == "marschner-lobb") {
        return std::make_unique<MarschnerLobb>(nodes);
    }
    if (name == "noise") {
        return std::make_unique<Noise>(nodes, seed);
    }
    if (name == "sphere") {
        return std::make_unique<Sphere>(nodes);
    }
    throw Error(ErrorKind::invalid_argument, fmt::format("there is no volume '{}'; there are: {}",
                                                         name, fmt::join(synthetic_names(), ", ")));
}

}  // namespace isonest::detail
