#include "query/extract/stages/contour_lines.h"

#include <tsl/robin_map.h>

#include <algorithm>
#include <cmath>

#include <isonest/error.h>

namespace isonest::detail {
namespace {

constexpr unsigned kVertexBits = 48;

/// A vertex of the mesh, with its number in the whole mesh.
struct MeshVertex {
    std::uint64_t number;
    std::array<float, 3> position;
    double value;
};

class LinePart {
  public:
    explicit LinePart(const AttributeChoice& attributes) : attributes_(attributes) {}

    void march(const std::array<MeshVertex, 3>& t, double value, std::size_t index) {
        std::array<std::uint32_t, 2> ends{};
        std::size_t count = 0;
        for (std::size_t i = 0; i < 3; ++i) {
            const MeshVertex& a = t[i];
            const MeshVertex& b = t[(i + 1) % 3];
            if ((a.value < value) != (b.value < value)) {
                const bool a_above = b.value < value;
                ends.at(count++) = vertex(a_above ? b : a, a_above ? a : b, value, index);
            }
        }
        if (count == 2 && ends[0] != ends[1]) {
            part_.triangles.push_back({ends[0], ends[1], ends[1]});
        }
    }
    [[nodiscard]] std::size_t size() const { return part_.positions.size(); }
    [[nodiscard]] MeshPart take() {
        numbers_.clear();
        return std::exchange(part_, {});
    }

  private:
    std::uint32_t vertex(const MeshVertex& below, const MeshVertex& above, double value,
                         std::size_t index) {
        // In a fixed order of the ends: bit for bit the same from both triangles at the edge.
        const bool exact = above.value == value;
        const MeshVertex& p = exact || above.number < below.number ? above : below;
        const MeshVertex& q = exact ? above : &p == &above ? below : above;
        const VertexKey key{p.number | static_cast<std::uint64_t>(index) << kVertexBits, q.number,
                            VertexKind::edge};
        const auto next = static_cast<std::uint32_t>(part_.positions.size());
        const auto [it, inserted] = numbers_.try_emplace(key, next);
        if (!inserted) {
            return it->second;
        }
        const double t = exact ? 0 : (value - p.value) / (q.value - p.value);
        Double3 at{};
        for (std::size_t axis = 0; axis < 3; ++axis) {
            const auto from = static_cast<double>(p.position[axis]);
            at[axis] = from + t * (static_cast<double>(q.position[axis]) - from);
        }
        part_.positions.push_back(at);
        VertexAttributes words{};
        attributes_.put_value(value, words);
        part_.attributes.insert(part_.attributes.end(), words.begin(),
                                words.begin() + static_cast<std::ptrdiff_t>(attributes_.width()));
        part_.shared.push_back({next});
        part_.names.push_back({key, next});
        return next;
    }

    AttributeChoice attributes_;
    MeshPart part_;
    tsl::robin_map<VertexKey, std::uint32_t, VertexKeyHash> numbers_;
};

}  // namespace

void contour_lines(const PartStore& parts, const VertexNumbers& weld,
                   std::span<const double> values, const AttributeChoice& attributes,
                   std::size_t part_vertices, const PartSink& sink, Progress& progress) {
    if (weld.vertices() >> kVertexBits != 0) {
        throw Error(ErrorKind::limit, "contour lines: the slice has more than 2^48 vertices");
    }
    progress.begin("contours", weld.triangles(), "triangles");
    LinePart part(attributes);
    std::uint64_t order = 0;
    std::vector<std::uint64_t> number;
    std::vector<bool> owned;
    const std::size_t width = parts.attributes_per_vertex();
    for (const PartRecord& record : parts.records()) {
        weld.numbers(record, number, owned);
        const auto positions = parts.vertices(record);
        const auto words = parts.attributes(record);
        for (const auto& t : parts.triangles(record)) {
            std::array<MeshVertex, 3> corners{};
            for (std::size_t i = 0; i < 3; ++i) {
                corners[i] = {number[t[i]], positions[t[i]],
                              attributes.value_of(words.subspan(t[i] * width, width))};
            }
            for (std::size_t index = 0; index < values.size(); ++index) {
                part.march(corners, values[index], index);
            }
            if (part.size() >= part_vertices) {
                sink(order++, part.take());
            }
        }
        progress.advance(record.triangles);
        progress.check();
    }
    if (part.size() > 0) {
        sink(order, part.take());
    }
}

double contour_rounding(std::span<const double> values, const AttributeChoice& attributes) {
    double most = 0;
    for (const double value : values) {
        VertexAttributes words{};
        most = std::max(most, std::fabs(attributes.put_value(value, words) - value));
    }
    return most;
}

}  // namespace isonest::detail
