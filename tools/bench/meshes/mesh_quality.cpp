// Properties of the mesh in a PLY file. Uses no code of isonest.
//
// usage: isonest_mesh_quality MESH.ply [--min-component N] [--box X0 Y0 Z0 X1 Y1 Z1]
//
// Prints JSON. Counts: triangles; vertices (used by a triangle); unused vertices; zero_area (the
// cross product of two sides is exactly zero); repeated_triangles (the same three vertices as
// another one); nonmanifold_edges (of more than two triangles); turned_edges (of two triangles that
// run along it in the same direction); boundary_edges (of one triangle), and with --box those that
// do not lie in one face of the box, within a millionth of its diagonal; fan_vertices (with several
// fans: triangles around the vertex that are not connected by shared edges); components (of
// triangles that share vertices) and the number of triangles in the smallest one; euler (vertices -
// edges + triangles). Angles in degrees: quantiles over the triangles of their smallest angle, and
// the fraction of triangles in which it is below 5. folds_72, folds_150: edges of two triangles
// with area whose normals differ by at least this many degrees. --min-component first removes the
// components of fewer than N triangles.
#include <algorithm>
#include <numbers>
#include <span>

#include "tools/bench/meshes/ply_mesh.h"

using namespace bench;

namespace {

double smallest_angle(const Mesh& mesh, const Triangle& t) {
    double smallest = 180;
    for (std::size_t i = 0; i < 3; ++i) {
        const Point a = mesh.points[t[(i + 1) % 3]] - mesh.points[t[i]];
        const Point b = mesh.points[t[(i + 2) % 3]] - mesh.points[t[i]];
        const bool none = dot(a, a) == 0 || dot(b, b) == 0;
        smallest = std::min(
            smallest,
            none ? 0 : std::atan2(length(cross(a, b)), dot(a, b)) * 180 / std::numbers::pi);
    }
    return smallest;
}

struct Edges {
    std::size_t all = 0;
    std::size_t nonmanifold = 0;
    std::size_t turned = 0;
    std::size_t boundary = 0;
    std::size_t inside = 0;  ///< boundary edges that lie in no face of the box
    std::size_t fan_vertices = 0;
    std::size_t folds_72 = 0;
    std::size_t folds_150 = 0;
};

/// An edge of a triangle: its ends, the smaller one first, and the corner (3 * triangle + 0 .. 2)
/// where it starts.
struct Side {
    std::uint64_t ends;
    std::uint32_t corner;
    bool operator<(const Side& other) const {
        return std::pair(ends, corner) < std::pair(other.ends, other.corner);
    }
};

/// In degrees; 0 if a triangle has no area.
double angle_of_normals(const Mesh& mesh, std::size_t a, std::size_t b) {
    const auto normal = [&](std::size_t i) {
        const Triangle& t = mesh.triangles[i];
        return cross(mesh.points[t[1]] - mesh.points[t[0]], mesh.points[t[2]] - mesh.points[t[0]]);
    };
    return std::atan2(length(cross(normal(a), normal(b))), dot(normal(a), normal(b))) * 180 /
           std::numbers::pi;
}

bool in_a_face(const Point& a, const Point& b, std::span<const double> box) {
    const double near = 1e-6 * length(Point{box[3] - box[0], box[4] - box[1], box[5] - box[2]});
    for (std::size_t i = 0; i < 6; ++i) {
        if (std::abs(a[i % 3] - box[i]) <= near && std::abs(b[i % 3] - box[i]) <= near) {
            return true;
        }
    }
    return false;
}

Edges edges_of(const Mesh& mesh, std::span<const double> box) {
    std::vector<Side> sides;
    sides.reserve(3 * mesh.triangles.size());
    for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
        for (std::size_t c = 0; c < 3; ++c) {
            const auto [low, high] =
                std::minmax(mesh.triangles[i][c], mesh.triangles[i][(c + 1) % 3]);
            if (low != high) {
                sides.push_back(
                    {std::uint64_t{low} << 32U | high, static_cast<std::uint32_t>(3 * i + c)});
            }
        }
    }
    std::sort(sides.begin(), sides.end());
    const auto start = [&](const Side& side) {
        return mesh.triangles[side.corner / 3][side.corner % 3];
    };
    const auto end_corner = [](const Side& side) {
        return side.corner / 3 * 3 + (side.corner + 1) % 3;
    };
    Edges found;
    Sets fans(3 * mesh.triangles.size());
    for (std::size_t first = 0; first < sides.size();) {
        std::size_t last = first + 1;
        for (; last < sides.size() && sides[last].ends == sides[first].ends; ++last) {
            const Side& a = sides[first];
            const Side& b = sides[last];
            const bool same = start(a) == start(b);
            fans.join(a.corner, same ? b.corner : end_corner(b));
            fans.join(end_corner(a), same ? end_corner(b) : b.corner);
        }
        ++found.all;
        const std::size_t count = last - first;
        found.nonmanifold += count > 2 ? 1 : 0;
        found.turned += count == 2 && start(sides[first]) == start(sides[first + 1]) ? 1 : 0;
        found.boundary += count == 1 ? 1 : 0;
        if (count == 2) {
            const double angle =
                angle_of_normals(mesh, sides[first].corner / 3, sides[first + 1].corner / 3);
            found.folds_72 += angle >= 72 ? 1 : 0;
            found.folds_150 += angle >= 150 ? 1 : 0;
        }
        if (count == 1 && !box.empty() &&
            !in_a_face(mesh.points[sides[first].ends >> 32U],
                       mesh.points[sides[first].ends & 0xffffffffU], box)) {
            ++found.inside;
        }
        first = last;
    }
    // A vertex has as many fans as its corners have different sets.
    std::vector<std::uint32_t> named(mesh.points.size());
    for (std::uint32_t corner = 0; corner < 3 * mesh.triangles.size(); ++corner) {
        if (fans.find(corner) == corner) {
            found.fan_vertices += ++named[mesh.triangles[corner / 3][corner % 3]] == 2 ? 1 : 0;
        }
    }
    return found;
}

void print(const Mesh& mesh, std::span<const double> box) {
    std::vector<char> used(mesh.points.size());
    Sets sets(mesh.points.size());
    std::vector<Triangle> sorted = mesh.triangles;
    std::vector<double> angles;
    std::size_t flat = 0;
    for (Triangle& t : sorted) {
        used[t[0]] = used[t[1]] = used[t[2]] = 1;
        sets.join(t[0], t[1]);
        sets.join(t[0], t[2]);
        const Point normal =
            cross(mesh.points[t[1]] - mesh.points[t[0]], mesh.points[t[2]] - mesh.points[t[0]]);
        flat += dot(normal, normal) == 0 ? 1 : 0;
        angles.push_back(smallest_angle(mesh, t));
        std::sort(t.begin(), t.end());
    }
    std::sort(sorted.begin(), sorted.end());
    const auto distinct = std::unique(sorted.begin(), sorted.end()) - sorted.begin();
    std::vector<std::size_t> sizes(mesh.points.size());
    for (const Triangle& t : mesh.triangles) {
        ++sizes[sets.find(t[0])];
    }
    std::size_t smallest = mesh.triangles.size();
    for (const std::size_t size : sizes) {
        smallest = size > 0 ? std::min(smallest, size) : smallest;
    }
    const auto components =
        std::count_if(sizes.begin(), sizes.end(), [](std::size_t size) { return size > 0; });
    const auto vertices = std::count(used.begin(), used.end(), 1);
    const Edges edges = edges_of(mesh, box);
    std::sort(angles.begin(), angles.end());
    const auto quantile = [&](double q) {
        return angles.empty()
                   ? 0
                   : angles[static_cast<std::size_t>(q * static_cast<double>(angles.size() - 1))];
    };
    const auto sharp = std::lower_bound(angles.begin(), angles.end(), 5.0) - angles.begin();
    std::printf(
        "{\"triangles\": %zu, \"vertices\": %td, \"unused_vertices\": %td, \"zero_area\": %zu, ",
        mesh.triangles.size(), vertices, std::ssize(used) - vertices, flat);
    std::printf("\"repeated_triangles\": %td, \"nonmanifold_edges\": %zu, \"turned_edges\": %zu, ",
                std::ssize(sorted) - distinct, edges.nonmanifold, edges.turned);
    std::printf("\"boundary_edges\": %zu, ", edges.boundary);
    if (!box.empty()) {
        std::printf("\"boundary_edges_inside\": %zu, ", edges.inside);
    }
    std::printf(
        "\"fan_vertices\": %zu, \"components\": %td, \"smallest_component\": %zu, \"euler\": %td, ",
        edges.fan_vertices, components, smallest,
        vertices - static_cast<std::ptrdiff_t>(edges.all) + std::ssize(mesh.triangles));
    std::printf(
        "\"angle_min\": %.6g, \"angle_0.1%%\": %.6g, \"angle_1%%\": %.6g, \"angle_50%%\": %.6g, ",
        quantile(0), quantile(0.001), quantile(0.01), quantile(0.5));
    std::printf("\"folds_72\": %zu, \"folds_150\": %zu, ", edges.folds_72, edges.folds_150);
    std::printf(
        "\"share_under_5\": %.6g}\n",
        angles.empty() ? 0 : static_cast<double>(sharp) / static_cast<double>(angles.size()));
}

int run(std::span<char*> arguments) {
    const auto usage = [](bool good) {
        if (!good) {
            throw std::runtime_error(
                "usage: isonest_mesh_quality MESH.ply [--min-component N] [--box X0 Y0 Z0 X1 Y1 "
                "Z1]");
        }
    };
    std::string path;
    std::vector<double> box;
    std::size_t least = 0;
    for (std::size_t i = 1; i < arguments.size(); ++i) {
        const std::string word = arguments[i];
        if (word == "--box") {
            usage(i + 6 < arguments.size());
            for (int number = 0; number < 6; ++number) {
                box.push_back(std::stod(arguments[++i]));
            }
        } else if (word == "--min-component") {
            usage(++i < arguments.size());
            least = std::stoul(arguments[i]);
        } else {
            usage(path.empty() && !word.starts_with("--"));
            path = word;
        }
    }
    usage(!path.empty());
    Mesh mesh = read_ply(path);
    drop_small_components(mesh, least);
    print(mesh, box);
    return 0;
}

}  // namespace

int main(int argc, char** argv) {
    try {
        return run({argv, static_cast<std::size_t>(argc)});
    } catch (const std::exception& error) {
        std::fprintf(stderr, "isonest_mesh_quality: %s\n", error.what());
        return 1;
    }
}
