#include "query/mesh/mesh_sections.h"

#include <oneapi/tbb/task_arena.h>

#include <cstring>

#include "store/base/in_order.h"

namespace isonest::detail {

namespace {

/// The rows of one part, section after section.
using Rows = std::vector<std::vector<std::byte>>;

Rows rows_of(const MeshContent& mesh, const PartRecord& r,
             const std::vector<VertexSection>& vertices,
             const std::vector<TriangleSection>& triangles) {
    std::vector<std::uint64_t> number;
    std::vector<bool> owned;
    mesh.weld.numbers(r, number, owned);
    const auto positions = mesh.parts.vertices(r);
    const auto attributes = mesh.parts.attributes(r);
    const std::size_t width = mesh.parts.attributes_per_vertex();
    Rows rows;
    for (const VertexSection& section : vertices) {
        std::byte* row = rows.emplace_back(r.owned * section.stride).data();
        for (std::size_t v = 0; v < positions.size(); ++v) {
            if (owned[v]) {
                section.fill({positions[v], attributes.subspan(v * width, width)}, row);
                row += section.stride;
            }
        }
    }
    for (const TriangleSection& section : triangles) {
        std::byte* row = rows.emplace_back(r.triangles * section.stride).data();
        std::uint64_t index = r.first_triangle;
        for (const auto& t : mesh.parts.triangles(r)) {
            section.fill({index++,
                          {number[t[0]], number[t[1]], number[t[2]]},
                          {positions[t[0]], positions[t[1]], positions[t[2]]}},
                         row);
            row += section.stride;
        }
    }
    return rows;
}

}  // namespace

void write_sections(const OutputFile& file, const MeshContent& mesh,
                    const std::vector<VertexSection>& vertices,
                    const std::vector<TriangleSection>& triangles, Progress& progress) {
    const auto records = mesh.parts.records();
    progress.begin("write mesh", mesh.weld.triangles(), "triangles");
    in_order(
        static_cast<std::int64_t>(records.size()), tbb::this_task_arena::max_concurrency() + 1,
        [&](std::int64_t i) {
            progress.check();
            return rows_of(mesh, records[static_cast<std::size_t>(i)], vertices, triangles);
        },
        [&](std::int64_t i, const Rows& rows) {
            const PartRecord& r = records[static_cast<std::size_t>(i)];
            auto next = rows.begin();
            for (const VertexSection& section : vertices) {
                file.write_at(section.offset + r.first_vertex * section.stride, *next++);
            }
            for (const TriangleSection& section : triangles) {
                file.write_at(section.offset + r.first_triangle * section.stride, *next++);
            }
            progress.advance(r.triangles);
        });
}

VertexSection attribute_section(std::uint64_t offset, const AttributeChoice::Array& array) {
    const std::size_t bytes = array.bytes();
    return {offset, bytes, [first = array.first, bytes](const VertexRow& v, std::byte* out) {
                std::memcpy(out, v.attributes.data() + first, bytes);
            }};
}

VertexSection position_section(std::uint64_t offset) {
    return {offset, sizeof(VertexRow::position), [](const VertexRow& v, std::byte* out) {
                std::memcpy(out, v.position.data(), sizeof(v.position));
            }};
}

TriangleSection connectivity_section(std::uint64_t offset, std::size_t corners) {
    const std::size_t bytes = corners * sizeof(std::int64_t);
    return {offset, bytes, [bytes](const TriangleRow& t, std::byte* out) {
                std::memcpy(out, t.corners.data(), bytes);
            }};
}

TriangleSection ends_section(std::uint64_t offset, std::size_t corners) {
    return {offset, sizeof(std::int64_t), [corners](const TriangleRow& t, std::byte* out) {
                const std::uint64_t end = corners * (t.index + 1);
                std::memcpy(out, &end, sizeof(end));
            }};
}

std::byte* put_indices32(const TriangleRow& t, std::byte* out) {
    for (const std::uint64_t corner : t.corners) {
        const auto index = static_cast<std::uint32_t>(corner);
        std::memcpy(out, &index, sizeof(index));
        out += sizeof(index);
    }
    return out;
}

void shift(std::uint64_t by, std::vector<VertexSection>& vertices,
           std::vector<TriangleSection>& triangles) {
    for (VertexSection& section : vertices) {
        section.offset += by;
    }
    for (TriangleSection& section : triangles) {
        section.offset += by;
    }
}

}  // namespace isonest::detail
