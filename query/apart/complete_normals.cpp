#include "query/apart/complete_normals.h"

#include <algorithm>
#include <bit>
#include <cstring>
#include <vector>

#include "store/base/vectors.h"

namespace isonest::detail {
namespace {

using Point = std::array<float, 3>;
constexpr std::uint64_t kAskEvery = std::uint64_t{1} << 13U;

Double3 vector_from(const Point& a, const Point& b) {
    Double3 d{};
    for (std::size_t axis = 0; axis < 3; ++axis) {
        d[axis] = static_cast<double>(b[axis]) - static_cast<double>(a[axis]);
    }
    return d;
}

/// Sums over the elements around marked vertices. Call mark() for all, seal(), then add() and
/// normal().
class NormalsAround {
  public:
    NormalsAround(std::uint64_t vertices, const MeshLayout& layout, const ScratchFolder& folder)
        : marks_file_(folder), sums_file_(folder), is_of_lines_(layout.corners == 2) {
        constexpr std::uint64_t kBits = 64;
        marks_file_.map((vertices + kBits - 1) / kBits * sizeof(Marks));
        marks_ = marks_file_.as<Marks>();
        for (std::size_t axis = 0; axis < 3; ++axis) {
            flat_axis_ = layout.lo[axis] == layout.hi[axis] ? axis : flat_axis_;
        }
    }
    void mark(std::uint64_t v) { marks_[v / 64].bits |= bit(v); }
    void seal() {
        std::uint64_t count = 0;
        for (Marks& marks : marks_) {
            marks.before = count;
            count += static_cast<std::uint64_t>(std::popcount(marks.bits));
        }
        sums_file_.map(count * sizeof(Double3));
    }
    /// Adds an element with these vertices at these positions.
    void add(const ElementCorners& vertices, const Point& a, const Point& b, const Point& c) {
        if (!is_marked(vertices[0]) && !is_marked(vertices[1]) && !is_marked(vertices[2])) {
            return;
        }
        const Double3 normal =
            is_of_lines_ ? across(vector_from(a, b)) : cross(vector_from(a, b), vector_from(a, c));
        for (std::size_t i = 0; i < (is_of_lines_ ? 2U : 3U); ++i) {
            if (is_marked(vertices[i])) {
                Double3& sum = sum_of(vertices[i]);
                for (std::size_t axis = 0; axis < 3; ++axis) {
                    sum[axis] += normal[axis];
                }
            }
        }
    }
    [[nodiscard]] bool is_marked(std::uint64_t v) const {
        return (marks_[v / 64].bits & bit(v)) != 0;
    }
    /// REQUIRES: is_marked(v).
    [[nodiscard]] Point normal(std::uint64_t v) const {
        const Point unit = unit_normal(sum_of(v));
        return has_no_direction(unit) ? Point{0, 0, 1} : unit;
    }

  private:
    struct Marks {
        std::uint64_t bits;
        std::uint64_t before;  ///< number of marked vertices with smaller numbers
    };
    static std::uint64_t bit(std::uint64_t v) { return std::uint64_t{1} << (v % 64); }
    [[nodiscard]] Double3& sum_of(std::uint64_t v) const {
        const Marks& marks = marks_[v / 64];
        const auto behind = static_cast<std::uint64_t>(std::popcount(marks.bits & (bit(v) - 1)));
        return sums_file_.as<Double3>()[marks.before + behind];
    }
    /// Perpendicular to a line, in the data's plane. Lines have no sides: of both directions, the
    /// one whose first nonzero component is positive.
    [[nodiscard]] Double3 across(const Double3& line) const {
        Double3 flat{};
        flat[flat_axis_] = 1;
        Double3 n = cross(line, flat);
        for (const double component : n) {
            if (component != 0) {
                return component > 0 ? n : Double3{-n[0], -n[1], -n[2]};
            }
        }
        return n;
    }

    ScratchFile marks_file_;
    ScratchFile sums_file_;
    std::span<Marks> marks_;
    bool is_of_lines_;
    std::size_t flat_axis_ = 2;
};

template <class Word>
Point normal_in(std::span<Word> row) {
    Point normal{};
    std::memcpy(normal.data(), row.data(), sizeof(normal));
    return normal;
}

}  // namespace

void complete_normals(PartStore& parts, const VertexNumbers& weld, const MeshLayout& layout,
                      const ScratchFolder& folder, Progress& progress) {
    if (layout.find("normal") == nullptr || parts.without_normal() == 0) {
        return;
    }
    MeshLayout with_box = layout;
    with_box.lo = parts.lo();
    with_box.hi = parts.hi();
    NormalsAround around(weld.vertices(), with_box, folder);
    const std::size_t width = parts.attributes_per_vertex();
    std::vector<std::uint64_t> number;
    std::vector<bool> owned;
    // A vertex has the same attributes in each part that contains it.
    const auto each_part = [&](const auto& work) {
        for (const PartRecord& r : parts.records()) {
            if (r.without_normal > 0) {
                progress.check();
                weld.numbers(r, number, owned);
                work(r);
            }
        }
    };
    const auto each_without = [&](const PartRecord& r, const auto& work) {
        const auto words = parts.changeable_attributes(r);
        for (std::size_t v = 0; v < r.vertices; ++v) {
            const auto row = words.subspan(v * width, width);
            if (has_no_direction(normal_in(row))) {
                work(number[v], row);
            }
        }
    };
    each_part([&](const PartRecord& r) {
        each_without(r, [&](std::uint64_t v, const auto& /*row*/) { around.mark(v); });
    });
    around.seal();
    each_part([&](const PartRecord& r) {
        const auto at = parts.vertices(r);
        for (const auto& t : parts.triangles(r)) {
            around.add({number[t[0]], number[t[1]], number[t[2]]}, at[t[0]], at[t[1]], at[t[2]]);
        }
    });
    each_part([&](const PartRecord& r) {
        each_without(r, [&](std::uint64_t v, std::span<std::uint32_t> row) {
            const Point normal = around.normal(v);
            std::memcpy(row.data(), normal.data(), sizeof(normal));
        });
    });
}

void complete_normals(ScratchMesh& mesh, const CornerView& elements, const ScratchFolder& folder,
                      Progress& progress) {
    const MeshLayout& layout = mesh.layout();
    const VertexAttribute* const normal = layout.find("normal");
    if (normal == nullptr) {
        return;
    }
    const auto rows = mesh.changeable_rows();
    const auto each_without = [&](const auto& work) {
        for (std::uint64_t v = 0; v < layout.vertices; ++v) {
            const auto row = rows.subspan(v * layout.row_bytes + normal->offset, sizeof(Point));
            if (has_no_direction(normal_in(row))) {
                work(v, row);
            }
        }
    };
    std::uint64_t count = 0;
    each_without([&](std::uint64_t /*v*/, const auto& /*row*/) { ++count; });
    if (count == 0) {
        return;
    }
    NormalsAround around(layout.vertices, layout, folder);
    each_without([&](std::uint64_t v, const auto& /*row*/) { around.mark(v); });
    around.seal();
    const auto at = mesh.positions();
    std::uint64_t i = 0;
    for (const ElementCorners e : elements) {
        if (i++ % kAskEvery == 0) {
            progress.check();
        }
        around.add(e, at[e[0]], at[e[1]], at[e[2]]);
    }
    each_without([&](std::uint64_t v, std::span<std::byte> row) {
        const Point found = around.normal(v);
        std::memcpy(row.data(), found.data(), sizeof(found));
    });
}

void complete_normals(std::span<const std::array<float, 3>> positions,
                      std::span<const std::array<std::uint32_t, 3>> triangles,
                      std::span<std::array<float, 3>> normals, const ScratchFolder& folder,
                      Progress& progress) {
    if (std::none_of(normals.begin(), normals.end(), has_no_direction)) {
        return;
    }
    NormalsAround around(normals.size(), {}, folder);
    for (std::size_t v = 0; v < normals.size(); ++v) {
        if (has_no_direction(normals[v])) {
            around.mark(v);
        }
    }
    around.seal();
    for (std::size_t i = 0; i < triangles.size(); ++i) {
        if (i % kAskEvery == 0) {
            progress.check();
        }
        const auto& t = triangles[i];
        around.add({t[0], t[1], t[2]}, positions[t[0]], positions[t[1]], positions[t[2]]);
    }
    for (std::size_t v = 0; v < normals.size(); ++v) {
        if (around.is_marked(v)) {
            normals[v] = around.normal(v);
        }
    }
}

}  // namespace isonest::detail
