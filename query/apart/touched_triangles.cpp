#include "query/apart/touched_triangles.h"

namespace isonest::detail {

TouchedTriangles::TouchedTriangles(std::span<const PlacedVertex> vertices,
                                   std::uint64_t mesh_vertices, const ScratchFolder& folder)
    : bit_file_(folder), triangle_file_(folder) {
    bit_file_.map((mesh_vertices / kBits + 1) * sizeof(std::uint64_t));
    bits_ = bit_file_.as<std::uint64_t>();
    const auto mark = [&](const PlacedVertex& v) {
        bits_[v.number / kBits] |= std::uint64_t{1} << (v.number % kBits);
    };
    for (std::size_t i = 1; i < vertices.size(); ++i) {
        if (vertices[i - 1].at == vertices[i].at) {
            mark(vertices[i - 1]);
            mark(vertices[i]);
        }
    }
}

void TouchedTriangles::add(std::span<const ElementCorners> triangles) {
    if (!triangles.empty()) {
        triangle_file_.write_at(count_ * sizeof(ElementCorners), std::as_bytes(triangles));
        count_ += triangles.size();
    }
}

std::span<const ElementCorners> TouchedTriangles::all() {
    if (count_ == 0) {
        return {};
    }
    triangle_file_.map(count_ * sizeof(ElementCorners));
    return triangle_file_.as<const ElementCorners>().first(count_);
}

}  // namespace isonest::detail
