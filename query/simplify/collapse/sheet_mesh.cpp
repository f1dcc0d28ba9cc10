#include "query/simplify/collapse/sheet_mesh.h"

#include <algorithm>
#include <optional>
#include <vector>

#include "query/mesh/vertex_stars.h"
#include "query/simplify/proof/point_triangle.h"

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
    // There are at most as many copies as corners.
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
    if (copies_ == room_) {  // `link` may be in the part that is remapped
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

namespace {

using OutputPoint = std::array<float, 3>;
constexpr std::uint64_t kOutputBatch = std::uint64_t{1} << 13U;
/// Longer lists of vertices are in a file.
constexpr std::uint64_t kMaxInHeap = std::uint64_t{1} << 18U;

/// A triangle for output.
struct OutputTriangle {
    ElementCorners copies{};
    SheetMesh::Sides sides{};
};

double area_at(const OutputPoint& a, const OutputPoint& b, const OutputPoint& c) {
    const Double3 from = point_at(a);
    return length(cross(minus(point_at(b), from), minus(point_at(c), from))) / 2;
}

/// A list of fixed size, in the heap or in a file.
template <class T>
class OutputList {
  public:
    OutputList(std::uint64_t count, const ScratchFolder& folder) {
        if (count <= kMaxInHeap) {
            in_heap_.resize(static_cast<std::size_t>(count));
            all_ = in_heap_;
        } else {
            file_.emplace(folder);
            file_->map(count * sizeof(T));
            all_ = file_->template as<T>();
        }
    }
    [[nodiscard]] std::span<T> all() const { return all_; }

  private:
    std::vector<T> in_heap_;
    std::optional<ScratchFile> file_;
    std::span<T> all_;
};

}  // namespace

SheetOutput::SheetOutput(const SheetMesh& sheets, const CornerView& triangles,
                         std::span<const std::int64_t> labels, const ScratchFolder& folder,
                         Progress& progress)
    : sheets_(sheets), triangles_(triangles), labels_(labels), folder_(folder), of_labels_(folder) {
    for (std::uint64_t i = 0; i < triangles_.size(); ++i) {
        if (i % kOutputBatch == 0) {
            progress.check();
        }
        const SheetMesh::Sides& sides = sheets_.sides(triangles_[i][0]);
        for (const bool in_front : {false, true}) {
            const auto at = std::lower_bound(labels_.begin(), labels_.end(), sides[in_front]);
            if (at != labels_.end() && *at == sides[in_front]) {
                of_labels_.append({i, static_cast<std::uint32_t>(at - labels_.begin()), in_front});
            }
        }
    }
    of_labels_.sort(static_cast<std::uint32_t>(labels_.size()));
}

/// `at(i)`: triangle i of `count`.
template <class At>
SheetCounts SheetOutput::emit(std::uint64_t count, const At& at, MeshLayout layout, MeshSink& sink,
                              const Progress& progress) const {
    const OutputList<Vertex> list(3 * count, folder_);
    SheetCounts counts;
    counts.triangles = count;
    const auto positions = sheets_.vertices().positions();
    for (std::uint64_t i = 0; i < count; ++i) {
        const OutputTriangle t = at(i);
        for (std::size_t k = 0; k < 3; ++k) {
            list.all()[3 * i + k] = {sheets_.original(t.copies[k]), t.copies[k]};
        }
        const auto& [a, b, c] = t.copies;
        counts.no_area += has_no_area(positions[a], positions[b], positions[c]) ? 1 : 0;
    }
    std::sort(list.all().begin(), list.all().end(), [](const Vertex& a, const Vertex& b) {
        return a.original != b.original ? a.original < b.original : a.copy < b.copy;
    });
    const auto end =
        std::unique(list.all().begin(), list.all().end(),
                    [](const Vertex& a, const Vertex& b) { return a.original == b.original; });
    const std::span<const Vertex> vertices =
        list.all().first(static_cast<std::size_t>(std::distance(list.all().begin(), end)));
    counts.vertices = vertices.size();
    const auto number_of = [&](std::uint64_t copy) {
        const auto found = std::lower_bound(
            vertices.begin(), vertices.end(), sheets_.original(copy),
            [](const Vertex& v, std::uint64_t original) { return v.original < original; });
        return static_cast<std::uint64_t>(found - vertices.begin());
    };

    layout.vertices = counts.vertices;
    layout.elements = count;
    layout.lo = MeshLayout::kEmptyLo;
    layout.hi = MeshLayout::kEmptyHi;
    for (const Vertex& v : vertices) {
        for (std::size_t axis = 0; axis < 3; ++axis) {
            layout.lo[axis] = std::min(layout.lo[axis], positions[v.copy][axis]);
            layout.hi[axis] = std::max(layout.hi[axis], positions[v.copy][axis]);
        }
    }
    sink.begin(layout);
    std::vector<OutputPoint> nearby;
    std::vector<ElementCorners> corners;
    std::vector<std::array<std::uint32_t, 3>> nearby_corners;
    std::vector<SheetMesh::Sides> sides;
    do {
        for (std::uint64_t first = 0; first < vertices.size(); first += nearby.size()) {
            progress.check();
            nearby.clear();
            for (const Vertex& v : vertices.subspan(
                     first, std::min<std::uint64_t>(kOutputBatch, vertices.size() - first))) {
                nearby.push_back(positions[v.copy]);
            }
            sink.add_vertices({first, nearby, {}, 0});
        }
        for (std::uint64_t first = 0; first < count; first += corners.size()) {
            progress.check();
            nearby.clear();
            corners.clear();
            nearby_corners.clear();
            sides.clear();
            for (std::uint64_t i = first; i < std::min(first + kOutputBatch, count); ++i) {
                const OutputTriangle t = at(i);
                const auto place = static_cast<std::uint32_t>(nearby.size());
                ElementCorners numbers{};
                for (std::size_t k = 0; k < 3; ++k) {
                    numbers[k] = number_of(t.copies[k]);
                    nearby.push_back(positions[t.copies[k]]);
                }
                corners.push_back(numbers);
                nearby_corners.push_back({place, place + 1, place + 2});
                sides.push_back(t.sides);
            }
            ElementBatch batch{first, corners, nearby_corners, {0, nearby, {}, 0}};
            if (layout.has_sides) {
                batch.sides = sides;
            }
            sink.add_elements(batch);
        }
    } while (sink.again());
    sink.end();
    return counts;
}

SheetCounts SheetOutput::emit_all(MeshLayout layout, MeshSink& sink,
                                  const Progress& progress) const {
    layout.has_sides = true;
    const auto at = [&](std::uint64_t i) {
        const ElementCorners copies = triangles_[i];
        return OutputTriangle{copies, sheets_.sides(copies[0])};
    };
    return emit(triangles_.size(), at, std::move(layout), sink, progress);
}

SheetCounts SheetOutput::emit_label(std::size_t number, MeshLayout layout, MeshSink& sink,
                                    const Progress& progress) const {
    const auto of_label = of_labels_.of(static_cast<std::uint32_t>(number));
    const auto at = [&](std::uint64_t i) {
        const LabelTriangle& t = of_label[i];
        OutputTriangle out{triangles_[t.triangle], {}};
        out.sides = sheets_.sides(out.copies[0]);
        if (t.is_reversed) {
            std::swap(out.copies[1], out.copies[2]);
            std::swap(out.sides[0], out.sides[1]);
        }
        return out;
    };
    return emit(of_label.size(), at, std::move(layout), sink, progress);
}

std::map<std::int64_t, double> SheetOutput::areas(std::size_t number) const {
    std::map<std::int64_t, double> areas;
    const auto positions = sheets_.vertices().positions();
    for (const LabelTriangle& t : of_labels_.of(static_cast<std::uint32_t>(number))) {
        const ElementCorners copies = triangles_[t.triangle];
        areas[sheets_.sides(copies[0])[t.is_reversed ? 0 : 1]] +=
            area_at(positions[copies[0]], positions[copies[1]], positions[copies[2]]);
    }
    return areas;
}

}  // namespace isonest::detail
