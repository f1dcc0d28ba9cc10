// The common part of the binary mesh formats: tables with one row per vertex or triangle, each at a
// known place in the file, so that all parts can be written at the same time.
#pragma once

#include <cstddef>
#include <functional>
#include <span>
#include <vector>

#include "query/mesh/mesh_writer.h"
#include "store/files/output_file.h"

namespace isonest::detail {

/// A vertex of a part, and a triangle whose corners are numbered in the whole mesh.
struct VertexRow {
    std::array<float, 3> position;
    std::span<const AttributeWord> attributes;
};
struct TriangleRow {
    std::uint64_t index;  ///< in the whole mesh
    std::array<std::uint64_t, 3> corners;
    std::array<std::array<float, 3>, 3> positions;
};

/// A table with a row for every vertex: `fill` writes one row of `stride` bytes.
struct VertexSection {
    std::uint64_t offset = 0;
    std::size_t stride = 0;
    std::function<void(const VertexRow&, std::byte*)> fill;
};
struct TriangleSection {
    std::uint64_t offset = 0;
    std::size_t stride = 0;
    std::function<void(const TriangleRow&, std::byte*)> fill;
};

/// Fills all sections, in parallel over the parts. Throws Error{io, cancelled}.
void write_sections(const OutputFile& file, const MeshContent& mesh,
                    const std::vector<VertexSection>& vertices,
                    const std::vector<TriangleSection>& triangles, Progress& progress);

/// One of the attributes, as it is.
VertexSection attribute_section(std::uint64_t offset, const AttributeChoice::Array& array);
VertexSection position_section(std::uint64_t offset);
/// The numbers of the first `corners` corners, int64; and for each cell how many there are so far.
TriangleSection connectivity_section(std::uint64_t offset, std::size_t corners);
TriangleSection ends_section(std::uint64_t offset, std::size_t corners);

/// Writes the three numbers as uint32 and returns what is behind them.
std::byte* put_indices32(const TriangleRow& t, std::byte* out);

/// Moves all sections by the length of what stands before them.
void shift(std::uint64_t by, std::vector<VertexSection>& vertices,
           std::vector<TriangleSection>& triangles);

}  // namespace isonest::detail
