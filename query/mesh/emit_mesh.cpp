#include "query/mesh/emit_mesh.h"

#include <oneapi/tbb/task_arena.h>

#include <algorithm>
#include <cstring>

#include "store/base/in_order.h"

namespace isonest::detail {
namespace {

using Point = std::array<float, 3>;

/// What of a part is not as the sink wants it.
struct Made {
    std::vector<Point> positions;  ///< of the vertices that the part is the first to name
    std::vector<std::byte> attributes;
    std::vector<std::array<std::uint64_t, 3>> corners;
};

VertexBatch all_vertices(const PartStore& parts, const PartRecord& r) {
    return {r.first_vertex, parts.vertices(r), std::as_bytes(parts.attributes(r)),
            parts.attributes_per_vertex() * sizeof(AttributeWord)};
}

/// The part's own vertices; those that earlier parts have named are left out.
VertexBatch own_vertices(const PartStore& parts, const PartRecord& r,
                         const std::vector<bool>& owned, Made& made) {
    const VertexBatch all = all_vertices(parts, r);
    if (r.owned == r.vertices) {
        return all;
    }
    made.positions.resize(r.owned);
    made.attributes.resize(r.owned * all.row_bytes);
    std::size_t to = 0;
    for (std::size_t from = 0; from < owned.size(); ++from) {
        if (owned[from]) {
            made.positions[to] = all.positions[from];
            std::copy_n(all.attributes.data() + from * all.row_bytes, all.row_bytes,
                        made.attributes.data() + to * all.row_bytes);
            ++to;
        }
    }
    return {r.first_vertex, made.positions, made.attributes, all.row_bytes};
}

ElementBatch elements_of(const PartStore& parts, const PartRecord& r,
                         const std::vector<std::uint64_t>& number, Made& made) {
    const auto triangles = parts.triangles(r);
    made.corners.resize(triangles.size());
    std::transform(triangles.begin(), triangles.end(), made.corners.begin(), [&](const auto& t) {
        return std::array{number[t[0]], number[t[1]], number[t[2]]};
    });
    return {r.first_triangle, made.corners, triangles, all_vertices(parts, r)};
}

void hand_over(MeshSink& sink, const VertexBatch& all) {
    for (std::size_t at = 0; at < all.positions.size(); at += MeshSink::kMostRows) {
        const std::size_t count = std::min(MeshSink::kMostRows, all.positions.size() - at);
        sink.add_vertices({all.first + at, all.positions.subspan(at, count),
                           all.attributes.subspan(at * all.row_bytes, count * all.row_bytes),
                           all.row_bytes});
    }
}

void hand_over(MeshSink& sink, const ElementBatch& all) {
    for (std::size_t at = 0; at < all.corners.size(); at += MeshSink::kMostRows) {
        const std::size_t count = std::min(MeshSink::kMostRows, all.corners.size() - at);
        sink.add_elements({all.first + at, all.corners.subspan(at, count),
                           all.nearby_corners.subspan(at, count), all.nearby});
    }
}

/// Batches from all threads. Calls done(record) after each part.
template <class Done>
void emit_at_once(const PartStore& parts, const VertexNumbers& weld, MeshSink& sink,
                  Progress& progress, const Done& done) {
    const auto records = parts.records();
    struct Nothing {};
    in_order(
        static_cast<std::int64_t>(records.size()), tbb::this_task_arena::max_concurrency() + 1,
        [&](std::int64_t i) {
            progress.check();
            const PartRecord& r = records[static_cast<std::size_t>(i)];
            std::vector<std::uint64_t> number;
            std::vector<bool> owned;
            weld.numbers(r, number, owned);
            Made made;
            hand_over(sink, own_vertices(parts, r, owned, made));
            hand_over(sink, elements_of(parts, r, number, made));
            done(r);
            progress.advance(r.triangles);
            return Nothing{};
        },
        [](std::int64_t /*i*/, const Nothing&) {});
}

/// Batches one after the other; `make`(record, number, owned, made) gives a part's.
template <class Batch, class Make>
void emit_in_order(const PartStore& parts, const VertexNumbers& weld, MeshSink& sink,
                   Progress& progress, const Make& make) {
    struct Prepared {
        Made made;
        Batch batch;
    };
    const auto records = parts.records();
    in_order(
        static_cast<std::int64_t>(records.size()), tbb::this_task_arena::max_concurrency() + 1,
        [&](std::int64_t i) {
            progress.check();
            const PartRecord& r = records[static_cast<std::size_t>(i)];
            std::vector<std::uint64_t> number;
            std::vector<bool> owned;
            weld.numbers(r, number, owned);
            Prepared prepared;  // a vector keeps its place when it is moved
            prepared.batch = make(r, number, owned, prepared.made);
            return prepared;
        },
        [&](std::int64_t i, const Prepared& prepared) {
            hand_over(sink, prepared.batch);
            progress.advance(records[static_cast<std::size_t>(i)].triangles);
        });
}

void count(const PartStore& parts, const VertexNumbers& weld, MeshLayout& layout) {
    layout.vertices = weld.vertices();
    layout.elements = weld.triangles();
    layout.lo = parts.lo();
    layout.hi = parts.hi();
}

}  // namespace

void move_mesh(PartStore& parts, const VertexNumbers& weld, MeshLayout layout, ScratchMesh& mesh,
               Progress& progress) {
    count(parts, weld, layout);
    mesh.begin(layout);
    progress.begin("write mesh", layout.elements, "triangles");
    emit_at_once(parts, weld, mesh, progress, [&](const PartRecord& r) { parts.release(r); });
    mesh.end();
}

MeshLayout layout_of(const AttributeChoice& attributes, int corners, std::optional<LengthUnit> unit,
                     AnatomicalFrame frame) {
    MeshLayout layout;
    layout.unit = unit;
    layout.frame = frame;
    layout.corners = corners;
    for (const AttributeChoice::Array& array : attributes.arrays()) {
        layout.attributes.push_back({array.name, static_cast<int>(array.components), array.wide,
                                     array.first * sizeof(AttributeWord)});
    }
    layout.row_bytes = attributes.width() * sizeof(AttributeWord);
    return layout;
}

void emit_parts(const PartStore& parts, const VertexNumbers& weld, MeshSink& sink,
                Progress& progress) {
    std::uint64_t triangles = 0;
    for (const PartRecord& r : parts.records()) {
        triangles += r.triangles;
    }
    progress.begin("write mesh", triangles, "triangles");
    emit_at_once(parts, weld, sink, progress, [](const PartRecord& /*r*/) {});
}

void emit_mesh(const PartStore& parts, const VertexNumbers& weld, MeshLayout layout, MeshSink& sink,
               Progress& progress) {
    count(parts, weld, layout);
    sink.begin(layout);
    const bool at_once = sink.concurrent();
    do {
        progress.begin("write mesh", (at_once ? 1 : 2) * layout.elements, "triangles");
        if (at_once) {
            emit_at_once(parts, weld, sink, progress, [](const PartRecord& /*r*/) {});
            continue;
        }
        emit_in_order<VertexBatch>(
            parts, weld, sink, progress,
            [&](const PartRecord& r, const auto&, const std::vector<bool>& owned, Made& made) {
                return own_vertices(parts, r, owned, made);
            });
        emit_in_order<ElementBatch>(
            parts, weld, sink, progress,
            [&](const PartRecord& r, const std::vector<std::uint64_t>& number, const auto&,
                Made& made) { return elements_of(parts, r, number, made); });
    } while (sink.again());
    sink.end();
}

}  // namespace isonest::detail
