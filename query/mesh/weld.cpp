#include "query/mesh/weld.h"

#include <oneapi/tbb/parallel_sort.h>
#include <oneapi/tbb/task_arena.h>

#include <algorithm>
#include <cstring>
#include <limits>

#include "store/base/in_order.h"

namespace isonest::detail {
namespace {

constexpr std::uint64_t kUnset = std::numeric_limits<std::uint64_t>::max();

struct NameEntry {
    VertexKey key;
    std::uint64_t element;
};

struct CutEntry {
    std::uint64_t end0;
    std::uint64_t end1;
    std::uint64_t plane;
    std::uint64_t element;
};

}  // namespace

std::uint64_t Weld::root(std::uint64_t e) {
    while (elements_[e].parent != e) {
        elements_[e].parent = elements_[elements_[e].parent].parent;
        e = elements_[e].parent;
    }
    return e;
}

void Weld::unite(std::uint64_t a, std::uint64_t b) {
    a = root(a);
    b = root(b);
    elements_[std::max(a, b)].parent = std::min(a, b);
}

void Weld::unite_names(const ScratchFolder& folder) {
    std::uint64_t count = 0;
    for (const PartRecord& r : parts_.records()) {
        count += r.names;
    }
    ScratchFile file(folder);
    file.map(count * sizeof(NameEntry));
    const auto entries = file.as<NameEntry>();
    std::uint64_t at = 0;
    for (const PartRecord& r : parts_.records()) {
        for (const MeshPart::Name& name : parts_.names(r)) {
            entries[at++] = {name.key, r.first_shared + name.shared};
        }
    }
    tbb::parallel_sort(entries.begin(), entries.end(), [](const NameEntry& a, const NameEntry& b) {
        return a.key != b.key ? a.key < b.key : a.element < b.element;
    });
    for (std::uint64_t i = 1; i < entries.size(); ++i) {
        if (entries[i].key == entries[i - 1].key) {
            unite(entries[i].element, entries[i - 1].element);
        }
    }
}

void Weld::unite_cuts(const ScratchFolder& folder) {
    std::uint64_t count = 0;
    for (const PartRecord& r : parts_.records()) {
        count += r.cuts;
    }
    if (count == 0) {
        return;
    }
    ScratchFile file(folder);
    file.map(count * sizeof(CutEntry));
    const auto entries = file.as<CutEntry>();
    std::uint64_t at = 0;
    for (const PartRecord& r : parts_.records()) {
        for (const MeshPart::Cut& c : parts_.cuts(r)) {
            const std::uint64_t a = root(r.first_shared + c.end0);
            const std::uint64_t b = root(r.first_shared + c.end1);
            entries[at++] = {std::min(a, b), std::max(a, b), c.plane, r.first_shared + c.shared};
        }
    }
    const auto edge = [](const CutEntry& c) { return std::tie(c.end0, c.end1, c.plane); };
    tbb::parallel_sort(entries.begin(), entries.end(), [&](const CutEntry& a, const CutEntry& b) {
        return edge(a) != edge(b) ? edge(a) < edge(b) : a.element < b.element;
    });
    for (std::uint64_t i = 1; i < entries.size(); ++i) {
        if (edge(entries[i]) == edge(entries[i - 1])) {
            unite(entries[i].element, entries[i - 1].element);
        }
    }
}

Weld::Weld(PartStore& parts, const ScratchFolder& folder, Cuts cuts)
    : parts_(parts), element_file_(folder) {
    std::uint64_t shared = 0;
    for (PartRecord& r : parts_.records()) {
        r.first_shared = shared;
        shared += r.shared;
    }
    element_file_.map(shared * sizeof(Element));
    elements_ = element_file_.as<Element>();
    std::uint32_t index = 0;
    for (const PartRecord& r : parts_.records()) {
        std::uint64_t e = r.first_shared;
        for (const MeshPart::Shared& s : parts_.shared(r)) {
            elements_[e] = {e, index, s.vertex, 0};
            ++e;
        }
        ++index;
    }
    unite_names(folder);
    if (cuts == Cuts::united) {
        unite_cuts(folder);
    }

    // The owner is the first element of the class that has a vertex.
    ScratchFile owner_file(folder);
    owner_file.map(shared * sizeof(std::uint64_t));
    const auto owner = owner_file.as<std::uint64_t>();
    std::fill(owner.begin(), owner.end(), kUnset);
    for (std::uint64_t e = 0; e < elements_.size(); ++e) {
        if (elements_[e].vertex != MeshPart::kNoVertex) {
            std::uint64_t& first = owner[root(e)];
            first = std::min(first, e);
        }
    }
    for (PartRecord& r : parts_.records()) {
        std::uint32_t skipped = 0;
        for (std::uint64_t e = r.first_shared; e < r.first_shared + r.shared; ++e) {
            elements_[e].skipped = skipped;
            skipped += elements_[e].vertex != MeshPart::kNoVertex && owner[root(e)] != e ? 1U : 0U;
        }
        r.owned = r.vertices - skipped;
        r.first_vertex = vertices_;
        r.first_triangle = triangles_;
        vertices_ += r.owned;
        triangles_ += r.triangles;
    }
    // Above, roots are only looked up; from here on `parent` is the representative. A root comes
    // after the others of its class.
    for (std::uint64_t e = elements_.size(); e-- > 0;) {
        const std::uint64_t r = root(e);
        owner[e] = owner[r] == kUnset ? r : owner[r];
    }
    for (std::uint64_t e = 0; e < elements_.size(); ++e) {
        elements_[e].parent = owner[e];
    }
}

void Weld::numbers(const PartRecord& record, std::vector<std::uint64_t>& number,
                   std::vector<bool>& owned) const {
    number.assign(record.vertices, kUnset);
    owned.assign(record.vertices, true);
    for (std::uint64_t e = record.first_shared; e < record.first_shared + record.shared; ++e) {
        const Element& element = elements_[e];
        if (element.vertex == MeshPart::kNoVertex || element.parent == e) {
            continue;
        }
        const Element& first = elements_[element.parent];
        number[element.vertex] =
            parts_.records()[first.part].first_vertex + first.vertex - first.skipped;
        owned[element.vertex] = false;
    }
    std::uint64_t next = record.first_vertex;
    for (std::size_t v = 0; v < number.size(); ++v) {
        if (owned[v]) {
            number[v] = next++;
        }
    }
}

namespace {

using Point = std::array<float, 3>;

/// Data of a part that must be converted for the sink.
struct Made {
    std::vector<Point> positions;  ///< vertices first used by the part
    std::vector<std::byte> attributes;
    std::vector<std::array<std::uint64_t, 3>> corners;
};

VertexBatch all_vertices(const PartStore& parts, const PartRecord& r) {
    return {r.first_vertex, parts.vertices(r), std::as_bytes(parts.attributes(r)),
            parts.attributes_per_vertex() * sizeof(AttributeWord)};
}

/// The part's own vertices, without those used by earlier parts.
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
    for (std::size_t at = 0; at < all.positions.size(); at += MeshSink::kMaxRows) {
        const std::size_t count = std::min(MeshSink::kMaxRows, all.positions.size() - at);
        sink.add_vertices({all.first + at, all.positions.subspan(at, count),
                           all.attributes.subspan(at * all.row_bytes, count * all.row_bytes),
                           all.row_bytes});
    }
}

void hand_over(MeshSink& sink, const ElementBatch& all) {
    for (std::size_t at = 0; at < all.corners.size(); at += MeshSink::kMaxRows) {
        const std::size_t count = std::min(MeshSink::kMaxRows, all.corners.size() - at);
        sink.add_elements({all.first + at, all.corners.subspan(at, count),
                           all.nearby_corners.subspan(at, count), all.nearby});
    }
}

/// For each vertex of a part its number, and whether the part owns it.
struct PartNumbers {
    PartNumbers(const VertexNumbers& weld, const PartRecord& record) {
        weld.numbers(record, number, owned);
    }
    std::vector<std::uint64_t> number;
    std::vector<bool> owned;
};

/// Outputs batches from all threads. Calls done(record) after each part.
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
            const PartNumbers numbers(weld, r);
            Made made;
            hand_over(sink, own_vertices(parts, r, numbers.owned, made));
            hand_over(sink, elements_of(parts, r, numbers.number, made));
            done(r);
            progress.advance(r.triangles);
            return Nothing{};
        },
        [](std::int64_t /*i*/, const Nothing&) {});
}

/// Outputs batches one after another; `make`(record, numbers, made) gives those of a part.
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
            Prepared prepared;  // a vector's data keeps its address when the vector is moved
            prepared.batch = make(r, PartNumbers(weld, r), prepared.made);
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
            [&](const PartRecord& r, const PartNumbers& numbers, Made& made) {
                return own_vertices(parts, r, numbers.owned, made);
            });
        emit_in_order<ElementBatch>(
            parts, weld, sink, progress,
            [&](const PartRecord& r, const PartNumbers& numbers, Made& made) {
                return elements_of(parts, r, numbers.number, made);
            });
    } while (sink.again());
    sink.end();
}

}  // namespace isonest::detail
