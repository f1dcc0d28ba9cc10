#include "tests/oracle/simplex.h"

#include <algorithm>
#include <cstdlib>

namespace isonest::oracle {
namespace {

Int3 cross(const Int3& a, const Int3& b) {
    return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

std::int64_t dot(const Int3& a, const Int3& b) {
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

}  // namespace

std::array<std::int64_t, 4> Barycentric::at(const Int3& p) const {
    std::array<std::int64_t, 4> b{};
    for (std::size_t i = 0; i < 4; ++i) {
        b[i] = at0[i] + dot(slope[i], p);
    }
    return b;
}

bool Simplex::is_finest() const {
    const Int3 d = end1() - end0();
    return tag == 3 && std::abs(d.x) == 1;
}

Int3 Simplex::refinement_node() const {
    const Int3 sum = end0() + end1();
    return {sum.x / 2, sum.y / 2, sum.z / 2};
}

std::array<Simplex, 2> Simplex::bisect() const {
    const auto d = static_cast<std::size_t>(tag);
    const Int3 z = refinement_node();
    Simplex first = *this;
    first.v[d] = z;
    Simplex second = *this;
    std::copy_n(v.begin() + 1, d, second.v.begin());
    second.v[d] = z;
    first.tag = second.tag = tag == 1 ? 3 : tag - 1;
    return {first, second};
}

Int3 Simplex::low() const {
    return min(min(v[0], v[1]), min(v[2], v[3]));
}

Int3 Simplex::high() const {
    return max(max(v[0], v[1]), max(v[2], v[3]));
}

Barycentric Simplex::barycentric() const {
    Barycentric b{};
    for (std::size_t i = 0; i < 4; ++i) {
        // The plane through the other three vertices, scaled so that it is positive at v[i].
        const Int3& p = v[(i + 1) % 4];
        Int3 normal = cross(v[(i + 2) % 4] - p, v[(i + 3) % 4] - p);
        if (dot(normal, v[i] - p) < 0) {
            normal = normal * -1;
        }
        b.slope[i] = normal;
        b.at0[i] = -dot(normal, p);
        b.total = dot(normal, v[i] - p);
    }
    return b;
}

std::array<Simplex, 6> kuhn_simplices(const Int3& index, std::int64_t edge) {
    Int3 even;
    Int3 odd;
    for (int axis = 0; axis < 3; ++axis) {
        const std::int64_t i = index[axis];
        even[axis] = (i % 2 == 0 ? i : i + 1) * edge;
        odd[axis] = (i % 2 == 0 ? i + 1 : i) * edge;
    }
    std::array<Simplex, 6> all;
    std::array<int, 3> axes{0, 1, 2};
    for (Simplex& t : all) {
        t.v[0] = even;
        for (std::size_t i = 0; i < 3; ++i) {
            t.v[i + 1] = t.v[i];
            t.v[i + 1][axes[i]] = odd[axes[i]];
        }
        std::next_permutation(axes.begin(), axes.end());
    }
    return all;
}

}  // namespace isonest::oracle
