#include "query/simplify/sheets/sheet_mesh.h"

#include <algorithm>
#include <vector>

namespace isonest::detail {
namespace {

using SheetPoint = std::array<float, 3>;
constexpr std::uint64_t kSheetBatch = std::uint64_t{1} << 13U;

}  // namespace

SheetMesh::SheetMesh(const ScratchFolder& folder)
    : position_file_(folder),
      first_file_(folder),
      copy_file_(folder),
      next_file_(folder),
      corners_(folder),
      mesh_(folder) {}

void SheetMesh::begin(const MeshLayout& layout) {
    layout_ = layout;
    position_file_.map(layout.vertices * sizeof(SheetPoint));
    first_file_.map(layout.vertices * sizeof(std::uint64_t));
    // There are no more copies than corners.
    corners_.begin(3 * layout.elements);
    corners_.map(layout.elements);
}

void SheetMesh::add_vertices(const VertexBatch& batch) {
    std::copy(batch.positions.begin(), batch.positions.end(),
              position_file_.as<SheetPoint>().begin() + static_cast<std::ptrdiff_t>(batch.first));
}

std::uint64_t SheetMesh::copy_of(std::uint64_t original, const Sides& sides) {
    std::uint64_t* link = &first_file_.as<std::uint64_t>()[original];
    while (*link != 0) {
        Copy& copy = copy_file_.as<Copy>()[*link - 1];
        if (copy.sides == sides) {
            return *link - 1;
        }
        link = &copy.next;
    }
    *link = copies_ + 1;
    if (copies_ == room_) {  // `link` may lie in what is mapped anew
        room_ = std::max(2 * room_, kSheetBatch);
        copy_file_.map(room_ * sizeof(Copy));
    }
    copy_file_.as<Copy>()[copies_] = {sides, original, 0};
    return copies_++;
}

void SheetMesh::add_elements(const ElementBatch& batch) {
    for (std::size_t i = 0; i < batch.corners.size(); ++i) {
        ElementCorners copies{};
        for (std::size_t k = 0; k < copies.size(); ++k) {
            copies[k] = copy_of(batch.corners[i][k], batch.sides[i]);
        }
        corners_.set(batch.first + i, copies);
    }
}

void SheetMesh::end() {
    finish_vertices();
    next_file_.map(copies_ * sizeof(std::uint64_t));
    const auto next = next_file_.as<std::uint64_t>();
    const auto copies = copy_file_.as<const Copy>();
    const auto first = first_file_.as<const std::uint64_t>();
    for (std::uint64_t v = 0; v < copies_; ++v) {
        const Copy& copy = copies[v];
        next[v] = (copy.next != 0 ? copy.next : first[copy.original]) - 1;
    }
    first_file_.clear();
    position_file_.clear();
}

void SheetMesh::finish_vertices() {
    MeshLayout layout = layout_;
    layout.vertices = copies_;
    layout.elements = 0;
    layout.has_sides = false;
    mesh_.begin(layout);
    const auto positions = position_file_.as<const SheetPoint>();
    std::vector<SheetPoint> some;
    for (std::uint64_t at = 0; at < copies_; at += some.size()) {
        some.resize(static_cast<std::size_t>(std::min(kSheetBatch, copies_ - at)));
        for (std::size_t i = 0; i < some.size(); ++i) {
            some[i] = positions[original(at + i)];
        }
        mesh_.add_vertices({at, some, {}, 0});
    }
    mesh_.end();
}

}  // namespace isonest::detail
