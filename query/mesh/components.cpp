// Components by union-find (store/base/box.h), with each set's lowest vertex as its root. The
// volume within a closed surface is a sum over its triangles: C. Zhang and T. Chen, "Efficient
// feature extraction for 2D/3D objects in mesh representation", ICIP 2001.
#include "query/mesh/components.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "query/mesh/measuring_sink.h"
#include "store/base/box.h"

namespace isonest::detail {
namespace {

struct Component {
    std::uint64_t elements = 0;
    std::uint64_t first_vertex = 0;
    double volume = 0;       ///< of a closed component; positive if it faces outward
    std::uint32_t open = 0;  ///< whether it has a border
    std::uint32_t kept = 0;
};

/// Calls visit(element) for all elements, with progress.
template <class Visit>
void each_element(const ScratchMesh& mesh, Progress& progress, const Visit& visit) {
    constexpr std::size_t kOften = std::size_t{1} << 16U;
    const auto all = mesh.corners();
    for (std::size_t at = 0; at < all.size(); at += kOften) {
        progress.check();
        const auto some = all.subspan(at, std::min(kOften, all.size() - at));
        std::for_each(some.begin(), some.end(), visit);
        progress.advance(some.size());
    }
}

/// The component of each vertex; components are numbered by their lowest vertices.
class Labels {
  public:
    Labels(const ScratchMesh& mesh, const ScratchFolder& folder, Progress& progress)
        : file_(folder) {
        file_.map(mesh.layout().vertices * sizeof(std::uint64_t));
        const auto parent = file_.as<std::uint64_t>();
        std::iota(parent.begin(), parent.end(), std::uint64_t{0});
        each_element(mesh, progress, [&](const ElementCorners& e) {
            unite(parent, unite(parent, e[0], e[1]), e[2]);
        });
        // A parent is lower than its child, so it already has its number.
        for (std::uint64_t v = 0; v < parent.size(); ++v) {
            parent[v] = parent[v] == v ? count_++ : parent[parent[v]];
        }
    }
    [[nodiscard]] std::uint64_t count() const { return count_; }
    [[nodiscard]] std::span<const std::uint64_t> of_vertex() const {
        return file_.as<const std::uint64_t>();
    }
    [[nodiscard]] std::uint64_t of(const ElementCorners& e) const { return of_vertex()[e[0]]; }

  private:
    ScratchFile file_;
    std::uint64_t count_ = 0;
};

/// Six times the signed volume of the tetrahedron over a triangle.
double six_volumes(const ScratchMesh& mesh, const ElementCorners& e, std::uint64_t apex) {
    const auto at = mesh.positions();
    const auto from_apex = [&](std::uint64_t v) {
        Double3 d{};
        for (std::size_t axis = 0; axis < 3; ++axis) {
            d[axis] = static_cast<double>(at[v][axis]) - static_cast<double>(at[apex][axis]);
        }
        return d;
    };
    const Double3 a = from_apex(e[0]);
    const Double3 b = from_apex(e[1]);
    const Double3 c = from_apex(e[2]);
    return a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) +
           a[2] * (b[0] * c[1] - b[1] * c[0]);
}

/// Computes volumes and borders. Around a vertex in a closed surface every neighbour occurs equally
/// often as the first and as the second of a triangle's other corners: so the signed sum of their
/// mixed numbers is 0. At the end of a border it is a difference of two such numbers, which is not
/// 0.
void measure(const ScratchMesh& mesh, const Labels& labels, std::span<Component> components,
             const ScratchFolder& folder, Progress& progress) {
    constexpr double kOfParallelepiped = 1.0 / 6;
    ScratchFile balance_file(folder);
    balance_file.map(mesh.layout().vertices * sizeof(std::uint64_t));
    const auto balance = balance_file.as<std::uint64_t>();
    progress.begin("measure components", mesh.layout().elements, "triangles");
    each_element(mesh, progress, [&](const ElementCorners& e) {
        Component& c = components[labels.of(e)];
        c.volume += six_volumes(mesh, e, c.first_vertex) * kOfParallelepiped;
        const ElementCorners m{mixed(e[0]), mixed(e[1]), mixed(e[2])};
        balance[e[0]] += m[2] - m[1];
        balance[e[1]] += m[0] - m[2];
        balance[e[2]] += m[1] - m[0];
    });
    for (std::uint64_t v = 0; v < balance.size(); ++v) {
        if (balance[v] != 0) {
            components[labels.of_vertex()[v]].open = 1;
        }
    }
}

/// Keeps only the `most` largest of the kept components; of equal ones those with lower vertices.
void keep_largest(std::span<Component> components, std::uint64_t most,
                  const ScratchFolder& folder) {
    if (components.size() <= most) {
        return;
    }
    ScratchFile file(folder);
    file.map(components.size() * sizeof(std::uint64_t));
    const auto places = file.as<std::uint64_t>();
    auto end = places.begin();
    for (std::uint64_t i = 0; i < components.size(); ++i) {
        if (components[i].kept != 0) {
            *end++ = i;
        }
    }
    if (static_cast<std::uint64_t>(end - places.begin()) > most) {
        const auto middle = places.begin() + static_cast<std::ptrdiff_t>(most);
        std::nth_element(places.begin(), middle, end, [&](std::uint64_t a, std::uint64_t b) {
            const Component& c = components[a];
            const Component& d = components[b];
            return c.elements != d.elements ? c.elements > d.elements : a < b;
        });
        std::for_each(middle, end, [&](std::uint64_t i) { components[i].kept = 0; });
    }
}

}  // namespace

KeptComponents::KeptComponents(const ScratchMesh& mesh, const ComponentChoice& choice,
                               const ScratchFolder& folder, Progress& progress)
    : corner_file_(folder), corners_(mesh.corners()) {
    progress.begin("find components", 2 * mesh.layout().elements, "triangles");
    const Labels labels(mesh, folder, progress);
    report_.components = labels.count();
    ScratchFile file(folder);
    file.map(report_.components * sizeof(Component));
    const auto components = file.as<Component>();
    for (std::uint64_t v = mesh.layout().vertices; v-- > 0;) {
        components[labels.of_vertex()[v]].first_vertex = v;
    }
    each_element(mesh, progress,
                 [&](const ElementCorners& e) { ++components[labels.of(e)].elements; });
    if (choice.min_volume > 0) {
        measure(mesh, labels, components, folder, progress);
    }
    for (Component& c : components) {
        const bool large =
            choice.min_volume <= 0 || c.open != 0 || std::fabs(c.volume) >= choice.min_volume;
        c.kept = large && c.elements >= choice.min_triangles ? 1 : 0;
    }
    if (choice.largest > 0) {
        keep_largest(components, choice.largest, folder);
    }
    for (const Component& c : components) {
        if (c.kept == 0) {
            ++report_.dropped;
            report_.dropped_triangles += c.elements;
            report_.largest_dropped = std::max(report_.largest_dropped, c.elements);
        }
    }
    if (report_.dropped == 0) {
        return;
    }
    corner_file_.begin(mesh.layout().vertices);
    corner_file_.map(mesh.layout().elements - report_.dropped_triangles);
    std::uint64_t kept = 0;
    progress.begin("drop components", mesh.layout().elements, "triangles");
    each_element(mesh, progress, [&](const ElementCorners& e) {
        if (components[labels.of(e)].kept != 0) {
            corner_file_.set(kept++, e);
        }
    });
    corners_ = corner_file_.all();
}

ComponentSizes component_sizes(std::uint64_t vertices, const CornerView& elements,
                               const ScratchFolder& folder) {
    ScratchFile parents(folder);
    parents.map(vertices * sizeof(std::uint64_t));
    const auto parent = parents.as<std::uint64_t>();
    std::iota(parent.begin(), parent.end(), std::uint64_t{0});
    for (const ElementCorners e : elements) {
        unite(parent, unite(parent, e[0], e[1]), e[2]);
    }
    ScratchFile counts(folder);
    counts.map(vertices * sizeof(std::uint64_t));
    const auto count = counts.as<std::uint64_t>();
    ComponentSizes sizes;
    for (const ElementCorners e : elements) {
        std::uint64_t& own = count[root_of(parent, e[0])];
        sizes.components += own == 0 ? 1 : 0;
        sizes.largest = std::max(sizes.largest, ++own);
    }
    return sizes;
}

}  // namespace isonest::detail
