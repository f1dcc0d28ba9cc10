#include "query/mesh/weld.h"

#include <oneapi/tbb/parallel_sort.h>

#include <limits>

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
    // Roots are only looked up above; from here on `parent` is the representative. A root comes
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

}  // namespace isonest::detail
