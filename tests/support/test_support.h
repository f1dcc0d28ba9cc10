// Shared by the tests: volumes in memory, temporary folders, a mesh checker, and the finest
// function.
#pragma once

#include <unistd.h>

#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <functional>
#include <limits>
#include <map>
#include <string>
#include <type_traits>
#include <vector>

#include <isonest/preprocess.h>

#include "tests/support/any_extraction.h"

namespace isonest::detail::test {

/// Whether two values have the same bits. For types without padding.
template <class T>
requires std::is_trivially_copyable_v<T>
bool same_bits(const T& a, const T& b) {
    using Bits = std::array<std::byte, sizeof(T)>;
    return std::bit_cast<Bits>(a) == std::bit_cast<Bits>(b);
}

/// A folder that exists as long as the object.
class TemporaryFolder {
  public:
    TemporaryFolder() {
        std::string name =
            (std::filesystem::temp_directory_path() / "isonest-test-XXXXXX").string();
        path_ = ::mkdtemp(name.data());
    }
    TemporaryFolder(const TemporaryFolder&) = delete;
    TemporaryFolder& operator=(const TemporaryFolder&) = delete;
    ~TemporaryFolder() {
        std::error_code ignored;
        std::filesystem::remove_all(path_, ignored);
    }
    std::filesystem::path operator/(const char* name) const { return path_ / name; }
    [[nodiscard]] const std::filesystem::path& path() const { return path_; }
    [[nodiscard]] std::vector<std::string> names() const {
        std::vector<std::string> out;
        for (const auto& e : std::filesystem::directory_iterator(path_)) {
            out.push_back(e.path().filename().string());
        }
        return out;
    }

  private:
    std::filesystem::path path_;
};

/// The values of a function at the nodes; records what was read. Never mapped.
template <class T>
class FunctionVolume : public VolumeSource {
  public:
    FunctionVolume(const Int3& n, const std::function<T(const Int3&)>& f)
        : n_(n), data_(static_cast<std::size_t>(n.product())) {
        for (std::int64_t i = 0; i < n.product(); ++i) {
            data_[static_cast<std::size_t>(i)] = f(n.unlinear(i));
        }
    }
    [[nodiscard]] VolumeDescription describe() const override {
        return {n_, value_type_of<T>, spacing_, {0, 0, 0}, "function"};
    }
    [[nodiscard]] std::string identity() const override { return identity_; }
    [[nodiscard]] Granularity granularity() const override { return granularity_; }
    [[nodiscard]] const Int3& nodes() const { return n_; }
    void read(std::int64_t z0, std::int64_t nz, std::int64_t y0, std::int64_t ny,
              std::byte* dst) override {
        for (std::int64_t z = z0; z < z0 + nz; ++z) {
            const std::size_t bytes = static_cast<std::size_t>(ny * n_.x) * sizeof(T);
            std::memcpy(dst, data_.data() + (z * n_.y + y0) * n_.x, bytes);
            dst += bytes;
            planes_read_ += ny == n_.y ? 1 : 0;
        }
    }
    /// Clamped to the volume.
    [[nodiscard]] double at(const Int3& p) const {
        const Int3 q = max({0, 0, 0}, min(p, n_ - Int3{1, 1, 1}));
        return static_cast<double>(data_[static_cast<std::size_t>(n_.linear(q))]);
    }
    Granularity granularity_;
    std::string identity_ = "input 1\n";
    Double3 spacing_{1, 1, 1};
    std::int64_t planes_read_ = 0;

  private:
    Int3 n_;
    std::vector<T> data_;
};

/// Repeatable noise in [0, 1).
inline double noise(const Int3& p, std::uint64_t seed = 7) {
    std::uint64_t h = seed;
    for (const std::int64_t v : {p.x, p.y, p.z}) {
        h = (h ^ static_cast<std::uint64_t>(v)) * 0xFF51AFD7ED558CCDULL;
        h ^= h >> 29U;
    }
    return static_cast<double>(h >> 11U) * 0x1p-53;
}

inline double smooth(const Int3& p) {
    const auto x = static_cast<double>(p.x);
    const auto y = static_cast<double>(p.y);
    const auto z = static_cast<double>(p.z);
    return std::sin(x * 0.31) * std::cos(y * 0.23) + std::sin(z * 0.19 + 0.1 * x) + 0.001 * x * y;
}

struct Mesh {
    std::vector<std::array<float, 3>> vertices;
    std::vector<std::vector<double>> attributes;  ///< the numbers of a vertex after its position
    std::vector<std::array<std::uint32_t, 3>> triangles;
};

inline std::string read_file(const std::filesystem::path& path) {
    std::ifstream in(path, std::ios::binary);
    return {std::istreambuf_iterator<char>(in), {}};
}

/// Reads exactly what the writer promises: any other number of bytes fails and gives an empty mesh.
inline Mesh read_mesh(const std::filesystem::path& path) {
    const std::string text = read_file(path);
    Mesh mesh;
    const std::size_t end = text.find("end_header\n") + 11;
    std::size_t nv = 0;
    std::size_t nt = 0;
    std::sscanf(text.c_str() + text.find("element vertex"), "element vertex %zu", &nv);
    std::sscanf(text.c_str() + text.find("element face"), "element face %zu", &nt);
    std::vector<bool> wide;
    std::size_t stride = 0;
    for (std::size_t at = text.find("property "); at < end; at = text.find("property ", at + 1)) {
        if (text.compare(at + 9, 4, "list") != 0) {
            wide.push_back(text.compare(at + 9, 6, "double") == 0);
            stride += wide.back() ? 8 : 4;
        }
    }
    if (text.size() != end + nv * stride + nt * 13) {
        return mesh;
    }
    for (std::size_t i = 0; i < nv; ++i) {
        std::vector<double> row;
        const char* at = text.data() + end + i * stride;
        for (const bool is_double : wide) {
            float narrow = 0;
            double number = 0;
            std::memcpy(&narrow, at, sizeof(narrow));
            std::memcpy(&number, at, is_double ? sizeof(number) : 0);
            row.push_back(is_double ? number : static_cast<double>(narrow));
            at += is_double ? 8 : 4;
        }
        mesh.vertices.push_back(
            {static_cast<float>(row[0]), static_cast<float>(row[1]), static_cast<float>(row[2])});
        mesh.attributes.emplace_back(row.begin() + 3, row.end());
    }
    for (std::size_t i = 0; i < nt; ++i) {
        std::array<std::uint32_t, 3> t{};
        std::memcpy(t.data(), text.data() + end + nv * stride + i * 13 + 1, 12);
        mesh.triangles.push_back(t);
    }
    return mesh;
}

struct Lines {
    std::vector<Double3> points;
    std::vector<std::array<std::size_t, 2>> segments;
};

/// The v and l lines of an OBJ file.
inline Lines read_lines(const std::filesystem::path& path) {
    std::ifstream in(path);
    Lines lines;
    std::string line;
    while (std::getline(in, line)) {
        Double3 p{};
        std::array<std::size_t, 2> s{};
        if (std::sscanf(line.c_str(), "v %lf %lf %lf", &p[0], &p[1], &p[2]) == 3) {
            lines.points.push_back(p);
        } else if (std::sscanf(line.c_str(), "l %zu %zu", &s[0], &s[1]) == 2) {
            lines.segments.push_back({s[0] - 1, s[1] - 1});
        }
    }
    return lines;
}

struct MeshFaults {
    std::size_t unused_vertices = 0;
    std::size_t overused_edges = 0;  ///< more than two triangles
    std::size_t misoriented_edges = 0;
    std::size_t open_edges_inside = 0;  ///< one triangle, not on a face of the box
    std::size_t split_vertices = 0;     ///< more than one fan
    std::size_t flat_triangles = 0;
    bool operator==(const MeshFaults&) const = default;
};

/// Independent of how the mesh was made: sorts edges, and walks around the fans.
inline MeshFaults check_mesh(const Mesh& mesh, const Double3& lo, const Double3& hi) {
    MeshFaults faults;
    std::map<std::pair<std::uint32_t, std::uint32_t>, std::pair<int, int>> edges;
    std::vector<std::vector<std::pair<std::uint32_t, std::uint32_t>>> around(mesh.vertices.size());
    for (const auto& t : mesh.triangles) {
        for (std::size_t i = 0; i < 3; ++i) {
            const std::uint32_t a = t[i];
            const std::uint32_t b = t[(i + 1) % 3];
            auto& use = edges[{std::min(a, b), std::max(a, b)}];
            (a < b ? use.first : use.second) += 1;
            around[a].emplace_back(b, t[(i + 2) % 3]);
        }
        const auto& a = mesh.vertices[t[0]];
        const auto& b = mesh.vertices[t[1]];
        const auto& c = mesh.vertices[t[2]];
        faults.flat_triangles += a == b || b == c || c == a ? 1 : 0;
    }
    for (const auto& [edge, use] : edges) {
        if (use.first + use.second > 2) {
            ++faults.overused_edges;
        } else if (use.first + use.second == 2) {
            faults.misoriented_edges += use.first != 1 ? 1 : 0;
        } else {
            bool on_face = false;
            for (std::size_t axis = 0; axis < 3; ++axis) {
                const double p = mesh.vertices[edge.first][axis];
                const double q = mesh.vertices[edge.second][axis];
                on_face = on_face ||
                          (std::fabs(p - lo[axis]) < 1e-4 && std::fabs(q - lo[axis]) < 1e-4) ||
                          (std::fabs(p - hi[axis]) < 1e-4 && std::fabs(q - hi[axis]) < 1e-4);
            }
            faults.open_edges_inside += on_face ? 0 : 1;
        }
    }
    for (const auto& fan : around) {
        if (fan.empty()) {
            ++faults.unused_vertices;
            continue;
        }
        std::map<std::uint32_t, std::uint32_t> parent;
        const std::function<std::uint32_t(std::uint32_t)> root = [&](std::uint32_t v) {
            const auto it = parent.emplace(v, v).first;
            return it->second == v ? v : it->second = root(it->second);
        };
        for (const auto& [a, b] : fan) {
            parent[root(a)] = root(b);
        }
        std::size_t fans = 0;
        for (const auto& entry : parent) {
            fans += entry.first == entry.second ? 1 : 0;
        }
        faults.split_vertices += fans > 1 ? 1 : 0;
    }
    return faults;
}

/// The finest piecewise linear function: Kuhn tetrahedra of unit cubes, mirrored by parity.
template <class T>
double fine_value(const FunctionVolume<T>& volume, const Double3& p) {
    const Int3 n = volume.nodes();
    Int3 from;
    Int3 step;
    std::array<std::pair<double, int>, 3> order;
    for (int axis = 0; axis < 3; ++axis) {
        const double x = p[static_cast<std::size_t>(axis)];
        const std::int64_t cell = std::clamp<std::int64_t>(
            static_cast<std::int64_t>(std::floor(x)), 0, std::max<std::int64_t>(n[axis] - 2, 0));
        const double t = x - static_cast<double>(cell);
        const bool odd = (cell & 1) != 0;
        from[axis] = cell + (odd ? 1 : 0);
        step[axis] = odd ? -1 : 1;
        order[static_cast<std::size_t>(axis)] = {odd ? 1 - t : t, axis};
    }
    std::sort(order.begin(), order.end(), [](auto& a, auto& b) { return a.first > b.first; });
    double value = volume.at(from) * (1 - order[0].first);
    for (std::size_t i = 0; i < 3; ++i) {
        from[order[i].second] += step[order[i].second];
        value += volume.at(from) * (order[i].first - (i < 2 ? order[i + 1].first : 0));
    }
    return value;
}

template <class T>
PreprocessReport make_store(FunctionVolume<T>& volume, const std::filesystem::path& path,
                            PreprocessOptions options = {}) {
    options.force = true;
    return preprocess(volume, path, options, silent_progress());
}

inline PreprocessOptions with_chunk(int chunk, bool exact = false) {
    PreprocessOptions options;
    options.chunk = chunk;
    options.exact = exact;
    options.fields = {Field::linf_bar, Field::linf_plus, Field::deviation_bar};
    return options;
}

/// Trilinear between the nodes of each finest cell; NaN beside a missing node, except for nodes of
/// negligible weight.
template <class T>
double trilinear(const FunctionVolume<T>& volume, const Double3& p) {
    const Int3 last = volume.nodes() - Int3{1, 1, 1};
    Int3 cell;
    Double3 share{};
    for (int axis = 0; axis < 3; ++axis) {
        const auto a = static_cast<std::size_t>(axis);
        const double x = std::clamp(p[a], 0.0, static_cast<double>(last[axis]));
        cell[axis] = std::min(static_cast<std::int64_t>(std::floor(x)), last[axis] - 1);
        share[a] = x - static_cast<double>(cell[axis]);
    }
    double sum = 0;
    for (int i = 0; i < 8; ++i) {
        const Int3 corner{i & 1, i >> 1 & 1, i >> 2 & 1};
        double weight = 1;
        for (int axis = 0; axis < 3; ++axis) {
            const auto a = static_cast<std::size_t>(axis);
            weight *= corner[axis] != 0 ? share[a] : 1 - share[a];
        }
        const auto value = static_cast<double>(volume.at(cell + corner));
        if (weight > 1e-4 || (weight > 0 && std::isfinite(value))) {
            sum += weight * value;
        }
    }
    return sum;
}

}  // namespace isonest::detail::test
