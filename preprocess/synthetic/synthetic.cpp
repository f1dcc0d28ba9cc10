#include "preprocess/synthetic/synthetic.h"

#include <fmt/format.h>
#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>
#include <vector>

#include <isonest/error.h>

#include "store/base/workers.h"
#include "store/exports/volume_file.h"
#include "store/files/output_file.h"
#include "store/lattice/lattice.h"

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
    throw Error(ErrorKind::invalid_argument,
                fmt::format("there is no synthetic volume '{}'; choose one of: {}", name,
                            fmt::join(synthetic_names(), ", ")));
}

// The equation: J. Cahn, J. Hilliard, "Free energy of a nonuniform system. I. Interfacial free
// energy", J. Chem. Phys. 28 (1958).

namespace {

constexpr double kStep = 0.03;  // stable below 1/16: the square of a Laplacian's 8, times 1/2
constexpr int kSteps = 6667;
constexpr std::int64_t kMax = 4096;

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
    if (nodes.x > kMax || nodes.y > kMax) {
        throw Error(
            ErrorKind::limit,
            fmt::format(
                "cahn-hilliard: a plane has {} x {} nodes, but at most {} x {} can be computed",
                nodes.x, nodes.y, kMax, kMax));
    }
    return std::make_unique<CahnHilliard>(nodes, seed);
}

namespace {

template <class T>
T convert(double value, double low, double high) {
    if constexpr (std::is_floating_point_v<T>) {
        return static_cast<T>(value);
    } else {
        const auto from = static_cast<double>(std::numeric_limits<T>::min());
        const auto to = static_cast<double>(std::numeric_limits<T>::max());
        const double scaled = from + (value - low) / (high - low) * (to - from);
        return static_cast<T>(std::round(std::clamp(scaled, from, to)));
    }
}

template <class T>
void fill(const SyntheticVolume& volume, const Int3& nodes, VolumeFile& file, Progress& progress) {
    const std::int64_t plane = nodes.x * nodes.y;
    constexpr std::int64_t kSlabBytes = std::int64_t{32} << 20;
    const std::int64_t slab = std::clamp<std::int64_t>(
        kSlabBytes / (plane * static_cast<std::int64_t>(sizeof(T))), 1, nodes.z);
    std::vector<T> values(static_cast<std::size_t>(plane * slab));
    for (std::int64_t z = 0; z < nodes.z; z += slab) {
        progress.check();
        const std::int64_t n = std::min(slab, nodes.z - z);
        tbb::parallel_for(std::int64_t{0}, n * nodes.y, [&](std::int64_t r) {
            thread_local std::vector<double> row;
            row.resize(static_cast<std::size_t>(nodes.x));
            volume.row(r % nodes.y, z + r / nodes.y, row.data());
            T* const to = values.data() + r * nodes.x;
            for (std::int64_t x = 0; x < nodes.x; ++x) {
                to[x] = convert<T>(row[static_cast<std::size_t>(x)], volume.low(), volume.high());
            }
        });
        file.write(reinterpret_cast<const std::byte*>(values.data()), n);
        progress.advance(static_cast<std::uint64_t>(n * plane) * sizeof(T));
    }
}

}  // namespace

void make_volume(const std::filesystem::path& path, const MakeVolumeOptions& options,
                 Progress& progress) {
    for (int axis = 0; axis < 3; ++axis) {
        if (options.nodes[axis] < 1 || options.nodes[axis] > kMaxNodesPerAxis) {
            throw Error(
                ErrorKind::invalid_argument,
                fmt::format("size {} x {} x {}: each axis must have 1 to {} nodes", options.nodes.x,
                            options.nodes.y, options.nodes.z, kMaxNodesPerAxis));
        }
    }
    check_output(path, options.force, {});
    Workers workers(options.threads);
    const auto volume =
        workers.execute([&] { return make_synthetic(options.name, options.nodes, options.seed); });
    VolumeFileSpec spec;
    spec.nodes = options.nodes;
    spec.type = options.type;
    spec.force = options.force;
    const auto file = create_volume_file(path, spec);
    progress.begin(options.name,
                   static_cast<std::uint64_t>(options.nodes.product()) * size_of(options.type),
                   "B");
    workers.execute([&] {
        dispatch(options.type, [&](auto tag) {
            fill<typename decltype(tag)::type>(*volume, options.nodes, *file, progress);
        });
    });
    file->finish();
}

}  // namespace isonest::detail
