// A triangle mesh from a binary PLY file, for the programs that judge meshes. They are an
// independent check, so no code of isonest is used here.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <numeric>
#include <sstream>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace bench {

using Point = std::array<double, 3>;
using Triangle = std::array<std::uint32_t, 3>;

struct Mesh {
    std::vector<Point> points;
    std::vector<Triangle> triangles;
};

inline Point operator-(const Point& a, const Point& b) {
    return {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
}
inline Point operator+(const Point& a, const Point& b) {
    return {a[0] + b[0], a[1] + b[1], a[2] + b[2]};
}
inline Point operator*(double s, const Point& a) {
    return {s * a[0], s * a[1], s * a[2]};
}
inline double dot(const Point& a, const Point& b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}
inline Point cross(const Point& a, const Point& b) {
    return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}
inline double length(const Point& a) {
    return std::sqrt(dot(a, a));
}

/// A union-find structure for the numbers below n; each set is represented by its smallest member.
class Sets {
  public:
    explicit Sets(std::size_t n) : parent_(n) { std::iota(parent_.begin(), parent_.end(), 0U); }

    std::uint32_t find(std::uint32_t i) {
        while (parent_[i] != i) {
            parent_[i] = parent_[parent_[i]];
            i = parent_[i];
        }
        return i;
    }
    void join(std::uint32_t a, std::uint32_t b) {
        a = find(a);
        b = find(b);
        parent_[std::max(a, b)] = std::min(a, b);
    }

  private:
    std::vector<std::uint32_t> parent_;
};

/// Removes components of fewer than `least` triangles; triangles that share a vertex belong to the
/// same component. Returns the number of removed triangles. The points stay.
inline std::size_t drop_small_components(Mesh& mesh, std::size_t least) {
    Sets sets(mesh.points.size());
    for (const Triangle& t : mesh.triangles) {
        sets.join(t[0], t[1]);
        sets.join(t[0], t[2]);
    }
    std::vector<std::size_t> size(mesh.points.size());
    for (const Triangle& t : mesh.triangles) {
        ++size[sets.find(t[0])];
    }
    return std::erase_if(mesh.triangles,
                         [&](const Triangle& t) { return size[sets.find(t[0])] < least; });
}

/// Reads a binary little-endian PLY file whose vertices begin with x, y, z of one type, float or
/// double, and whose faces are one list of three indices and nothing else. Other vertex properties
/// are skipped. Throws std::runtime_error for anything else.
inline Mesh read_ply(const std::string& path) {
    static_assert(std::endian::native == std::endian::little);
    const auto fail = [&](const char* what) { throw std::runtime_error(path + ": " + what); };
    std::ifstream file(path, std::ios::binary);
    std::string line;
    if (!file || !std::getline(file, line) || line != "ply") {
        fail("no PLY file");
    }
    const auto bytes_of = [&](const std::string& type) -> std::size_t {
        for (const auto& [name, bytes] :
             std::initializer_list<std::pair<const char*, std::size_t>>{{"char", 1},
                                                                        {"uchar", 1},
                                                                        {"int8", 1},
                                                                        {"uint8", 1},
                                                                        {"short", 2},
                                                                        {"ushort", 2},
                                                                        {"int16", 2},
                                                                        {"uint16", 2},
                                                                        {"int", 4},
                                                                        {"uint", 4},
                                                                        {"int32", 4},
                                                                        {"uint32", 4},
                                                                        {"float", 4},
                                                                        {"float32", 4},
                                                                        {"double", 8},
                                                                        {"float64", 8}}) {
            if (type == name) {
                return bytes;
            }
        }
        fail("a property of unknown type");
        return 0;
    };
    std::string element;
    std::size_t points = 0;
    std::size_t faces = 0;
    std::size_t row = 0;
    std::size_t coordinate = 0;
    while (std::getline(file, line) && line != "end_header") {
        std::istringstream words(line);
        std::string word;
        std::string type;
        words >> word;
        if (word == "format" && line != "format binary_little_endian 1.0") {
            fail("only binary little-endian files are read");
        } else if (word == "element") {
            std::size_t count = 0;
            words >> element >> count;
            (element == "vertex" ? points : element == "face" ? faces : count) = count;
            if (element != "vertex" && element != "face" && count > 0) {
                fail("elements other than vertices and faces");
            }
        } else if (word == "property" && element == "vertex") {
            words >> type;
            coordinate = row == 0 ? bytes_of(type) : coordinate;
            row += bytes_of(type);
        } else if (word == "property" && element == "face") {
            std::string count;
            std::string index;
            words >> type >> count >> index;
            if (type != "list" || bytes_of(count) != 1 || bytes_of(index) != 4) {
                fail("faces that are not lists of 32-bit indices");
            }
        }
    }
    if (points > 0 && coordinate != 4 && coordinate != 8) {
        fail("coordinates that are neither float nor double");
    }
    Mesh mesh;
    mesh.points.resize(points);
    std::vector<char> bytes(points * row);
    file.read(bytes.data(), static_cast<std::streamsize>(bytes.size()));
    for (std::size_t i = 0; i < points; ++i) {
        for (std::size_t axis = 0; axis < 3; ++axis) {
            const char* at = bytes.data() + i * row + axis * coordinate;
            float single = 0;
            std::memcpy(coordinate == 4 ? static_cast<void*>(&single) : &mesh.points[i][axis], at,
                        coordinate);
            mesh.points[i][axis] = coordinate == 4 ? single : mesh.points[i][axis];
            if (!std::isfinite(mesh.points[i][axis])) {
                fail("a coordinate is not a number");
            }
        }
    }
    mesh.triangles.resize(faces);
    bytes.resize(faces * 13);
    file.read(bytes.data(), static_cast<std::streamsize>(bytes.size()));
    for (std::size_t i = 0; i < faces; ++i) {
        const char* at = bytes.data() + i * 13;
        std::memcpy(mesh.triangles[i].data(), at + 1, 12);
        for (const std::uint32_t corner : mesh.triangles[i]) {
            if (*at != 3 || corner >= points) {
                fail("a face that is no triangle of its vertices");
            }
        }
    }
    if (!file || file.peek() != std::ifstream::traits_type::eof()) {
        fail("not as many bytes as its header says");
    }
    return mesh;
}

}  // namespace bench
