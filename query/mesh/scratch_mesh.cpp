#include "query/mesh/scratch_mesh.h"

#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/parallel_for.h>
#include <tsl/robin_map.h>

#include <algorithm>
#include <cstring>
#include <limits>
#include <vector>

#include "query/mesh/vertex_stars.h"
#include "store/base/box.h"

namespace isonest::detail {
namespace {

using Point = std::array<float, 3>;
constexpr std::uint64_t kNoNumber = std::numeric_limits<std::uint64_t>::max();
constexpr std::size_t kBatch = std::size_t{1} << 13U;

/// The vertices used by elements, in the order of their first use.
class UsedVertices {
  public:
    UsedVertices(const ScratchMesh& mesh, const CornerView& elements, const ScratchFolder& folder,
                 Progress& progress)
        : number_file_(folder), vertex_file_(folder) {
        number_file_.map(mesh.layout().vertices * sizeof(std::uint64_t));
        vertex_file_.map(mesh.layout().vertices * sizeof(std::uint64_t));
        const auto number = number_file_.as<std::uint64_t>();
        const auto vertex = vertex_file_.as<std::uint64_t>();
        for (std::size_t i = 0; i < elements.size(); ++i) {
            if (i % kBatch == 0) {
                progress.check();
            }
            for (const std::uint64_t v : elements[i]) {
                if (number[v] == 0) {
                    vertex[count_] = v;
                    number[v] = ++count_;
                }
            }
        }
    }
    [[nodiscard]] std::uint64_t count() const { return count_; }
    [[nodiscard]] std::uint64_t number_of(std::uint64_t vertex) const {
        return number_file_.as<std::uint64_t>()[vertex] - 1;
    }
    [[nodiscard]] std::span<const std::uint64_t> vertices() const {
        return {vertex_file_.as<std::uint64_t>().data(), static_cast<std::size_t>(count_)};
    }

  private:
    ScratchFile number_file_;  ///< counted from 1; 0 = unused
    ScratchFile vertex_file_;
    std::uint64_t count_ = 0;
};

/// Copies of vertices, one after another.
struct Copies {
    std::vector<Point> positions;
    std::vector<std::byte> rows;

    void clear() {
        positions.clear();
        rows.clear();
    }
    void add(const ScratchMesh& mesh, std::uint64_t v) {
        positions.push_back(mesh.positions()[v]);
        const auto row = mesh.row(v);
        rows.insert(rows.end(), row.begin(), row.end());
    }
    [[nodiscard]] VertexBatch batch(std::uint64_t first, std::size_t row_bytes) const {
        return {first, positions, rows, row_bytes};
    }
};

/// Calls work(at, count) for batches of `size` rows: in order, or from all threads if the sink is
/// concurrent. `make()` creates such a `work` for some batches of one thread.
template <class Make>
void each_batch(std::size_t size, const MeshSink& sink, Progress& progress, const Make& make) {
    const auto some = [&](std::size_t first, std::size_t last) {
        auto work = make();
        for (std::size_t batch = first; batch < last; ++batch) {
            progress.check();
            work(batch * kBatch, std::min(kBatch, size - batch * kBatch));
        }
    };
    const std::size_t batches = (size + kBatch - 1) / kBatch;
    if (!sink.concurrent()) {
        some(0, batches);
        return;
    }
    constexpr std::size_t kAtOnce = 8;
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, batches, kAtOnce),
                      [&](const auto& range) { some(range.begin(), range.end()); });
}

void emit_vertices(const ScratchMesh& mesh, const UsedVertices& used, MeshSink& sink,
                   Progress& progress) {
    const auto vertices = used.vertices();
    each_batch(vertices.size(), sink, progress, [&] {
        return [&, copies = Copies()](std::size_t at, std::size_t count) mutable {
            copies.clear();
            for (const std::uint64_t v : vertices.subspan(at, count)) {
                copies.add(mesh, v);
            }
            sink.add_vertices(copies.batch(at, mesh.layout().row_bytes));
        };
    });
}

/// Batches of elements for a sink. `number_of(vertex)`: the vertex's number in the sink.
template <class NumberOf>
class ElementBatches {
  public:
    ElementBatches(const ScratchMesh& mesh, const CornerView& elements, const NumberOf& number_of,
                   MeshSink& sink)
        : mesh_(mesh), elements_(elements), number_of_(number_of), sink_(sink) {}

    void operator()(std::size_t at, std::size_t count) {
        nearby_.clear();
        corners_.clear();
        nearby_corners_.clear();
        place_.clear();
        for (const ElementCorners e : elements_.subspan(at, count)) {
            ElementCorners numbered{};
            std::array<std::uint32_t, 3> near{};
            for (std::size_t i = 0; i < 3; ++i) {
                numbered[i] = number_of_(e[i]);
                const auto [slot, is_new] =
                    place_.try_emplace(e[i], static_cast<std::uint32_t>(nearby_.positions.size()));
                near[i] = slot->second;
                if (is_new) {
                    nearby_.add(mesh_, e[i]);
                }
            }
            corners_.push_back(numbered);
            nearby_corners_.push_back(near);
        }
        sink_.add_elements(
            {at, corners_, nearby_corners_, nearby_.batch(kNoNumber, mesh_.layout().row_bytes)});
    }

  private:
    const ScratchMesh& mesh_;
    const CornerView& elements_;
    const NumberOf& number_of_;
    MeshSink& sink_;
    Copies nearby_;
    std::vector<ElementCorners> corners_;
    std::vector<std::array<std::uint32_t, 3>> nearby_corners_;
    tsl::robin_map<std::uint64_t, std::uint32_t, MixedHash> place_;
};

template <class NumberOf>
void emit_batches(const ScratchMesh& mesh, const CornerView& elements, const NumberOf& number_of,
                  MeshSink& sink, Progress& progress) {
    each_batch(elements.size(), sink, progress, [&] {
        return [&, batches = ElementBatches<NumberOf>(mesh, elements, number_of, sink)](
                   std::size_t at, std::size_t count) mutable {
            batches(at, count);
            progress.advance(count);
        };
    });
}

}  // namespace

ScratchMesh::ScratchMesh(const ScratchFolder& folder, CornerFile::Bits bits)
    : position_file_(folder), row_file_(folder), corners_(folder, bits) {}

void ScratchMesh::begin(const MeshLayout& layout) {
    layout_ = layout;
    corners_.begin(layout.vertices);
}

void ScratchMesh::add_vertices(const VertexBatch& batch) {
    position_file_.write_at(batch.first * sizeof(Point), std::as_bytes(batch.positions));
    if (layout_.row_bytes > 0) {
        row_file_.write_at(batch.first * layout_.row_bytes, batch.attributes);
    }
}

void ScratchMesh::add_elements(const ElementBatch& batch) {
    corners_.write(batch.first, batch.corners);
}

void ScratchMesh::end() {
    position_file_.map(layout_.vertices * sizeof(Point));
    row_file_.map(layout_.vertices * layout_.row_bytes);
    corners_.map(layout_.elements);
}

void ScratchMesh::add_copies(std::span<const MovedCopy> copies) {
    if (copies.empty()) {
        return;
    }
    const std::uint64_t first = layout_.vertices;
    const std::size_t row_bytes = layout_.row_bytes;
    layout_.vertices += copies.size();
    const auto positions = position_file_.map(layout_.vertices * sizeof(Point));
    const auto rows = row_file_.map(layout_.vertices * row_bytes);
    for (std::size_t i = 0; i < copies.size(); ++i) {
        std::memcpy(positions.data() + (first + i) * sizeof(Point), &copies[i].at, sizeof(Point));
        if (row_bytes > 0) {
            std::memcpy(rows.data() + (first + i) * row_bytes,
                        rows.data() + copies[i].of * row_bytes, row_bytes);
        }
    }
}

void ScratchMesh::compact(const ScratchFolder& folder, Progress& progress) {
    ScratchFile number_file(folder);
    number_file.map(layout_.vertices * sizeof(std::uint64_t));
    const auto number = number_file.as<std::uint64_t>();
    std::uint64_t elements = 0;
    for (std::uint64_t i = 0; i < corners_.size(); ++i) {
        if (i % kBatch == 0) {
            progress.check();
        }
        const ElementCorners e = corners_[i];
        if (e[0] != kNoVertex) {
            corners_.set(elements++, e);
            number[e[0]] = number[e[1]] = number[e[2]] = 1;
        }
    }
    const auto positions = changeable_positions();
    std::byte* const rows = row_file_.as<std::byte>().data();
    std::uint64_t vertices = 0;
    for (std::uint64_t v = 0; v < layout_.vertices; ++v) {
        if (number[v] != 0) {
            positions[vertices] = positions[v];
            if (layout_.row_bytes > 0 && vertices != v) {
                std::memcpy(rows + vertices * layout_.row_bytes, rows + v * layout_.row_bytes,
                            layout_.row_bytes);
            }
            number[v] = vertices++;
        }
    }
    layout_.elements = elements;
    layout_.vertices = vertices;
    corners_.shrink(elements);
    for (std::uint64_t i = 0; i < elements; ++i) {
        const ElementCorners e = corners_[i];
        corners_.set(i, {number[e[0]], number[e[1]], number[e[2]]});
    }
}

EmittedMesh emit_elements(const ScratchMesh& mesh, const CornerView& elements,
                          const ScratchFolder& folder, MeshSink& sink, Progress& progress) {
    const UsedVertices used(mesh, elements, folder, progress);
    MeshLayout layout = mesh.layout();
    layout.vertices = used.count();
    layout.elements = elements.size();
    layout.lo = MeshLayout::kEmptyLo;
    layout.hi = MeshLayout::kEmptyHi;
    for (const std::uint64_t v : used.vertices()) {
        for (std::size_t axis = 0; axis < 3; ++axis) {
            layout.lo[axis] = std::min(layout.lo[axis], mesh.positions()[v][axis]);
            layout.hi[axis] = std::max(layout.hi[axis], mesh.positions()[v][axis]);
        }
    }
    EmittedMesh emitted{used.count(), elements.size(), 0};
    if (layout.corners == 3) {
        const auto at = mesh.positions();
        for (const ElementCorners e : elements) {
            emitted.zero_area_triangles += has_no_area(at[e[0]], at[e[1]], at[e[2]]) ? 1 : 0;
        }
    }
    sink.begin(layout);
    do {
        progress.begin("write mesh", elements.size(),
                       layout.corners == 2 ? "line segments" : "triangles");
        emit_vertices(mesh, used, sink, progress);
        emit_batches(
            mesh, elements, [&](std::uint64_t v) { return used.number_of(v); }, sink, progress);
    } while (sink.again());
    sink.end();
    return emitted;
}

void emit_vertices(const ScratchMesh& mesh, MeshSink& sink, Progress& progress) {
    const std::size_t row_bytes = mesh.layout().row_bytes;
    for (std::size_t at = 0; at < mesh.positions().size(); at += kBatch) {
        progress.check();
        const std::size_t count = std::min(kBatch, mesh.positions().size() - at);
        sink.add_vertices({at, mesh.positions().subspan(at, count),
                           mesh.rows().subspan(at * row_bytes, count * row_bytes), row_bytes});
    }
}

void emit_elements(const ScratchMesh& mesh, MeshSink& sink, Progress& progress) {
    emit_batches(
        mesh, mesh.corners(), [](std::uint64_t v) { return v; }, sink, progress);
}

}  // namespace isonest::detail
