#include "query/mesh/vertex_stars.h"

namespace isonest::detail {

VertexStars::VertexStars(std::uint64_t vertices, std::uint64_t triangles,
                         const ScratchFolder& folder)
    : first_file_(folder), next_file_(folder) {
    first_file_.map(vertices * sizeof(std::uint64_t));
    next_file_.map(3 * triangles * sizeof(std::uint64_t));
    first_ = first_file_.as<std::uint64_t>();
    next_ = next_file_.as<std::uint64_t>();
}

void VertexStars::remove(std::uint64_t corner, std::uint64_t v) {
    if (!is_marked(v)) {
        return;
    }
    std::uint64_t* link = &first_[v];
    while (*link != corner + kFirst) {
        link = &next_[*link - kFirst];
    }
    *link = next_[corner];
}

void VertexStars::corners_of(std::uint64_t v, std::vector<std::uint64_t>& corners) const {
    corners.clear();
    for (std::uint64_t link = first_[v]; link != kEnd; link = next_[link - kFirst]) {
        corners.push_back(link - kFirst);
    }
}

}  // namespace isonest::detail
