// The common part of the binary mesh formats: tables with one row per vertex or element, each at a
// known place in the file, so that all batches can be written at the same time.
#pragma once

#include <cstddef>
#include <functional>
#include <span>
#include <vector>

#include "query/formats/mesh_files.h"

namespace isonest::detail {

/// A table with a row for every vertex: its position, or some bytes of its attributes, or both.
struct VertexSection {
    std::uint64_t offset = 0;
    bool position = false;
    std::size_t first = 0;  ///< of the attributes' bytes
    std::size_t bytes = 0;
    double scale = 1;  ///< of the position

    [[nodiscard]] std::size_t stride() const {
        return (position ? sizeof(std::array<float, 3>) : 0) + bytes;
    }
};
VertexSection position_section(std::uint64_t offset, double scale = 1);
VertexSection attribute_section(std::uint64_t offset, const VertexAttribute& attribute);

/// A table with a row of `stride` bytes for every element: `fill` writes those of a batch.
struct ElementSection {
    std::uint64_t offset = 0;
    std::size_t stride = 0;
    std::function<void(const ElementBatch&, std::byte*)> fill;
};
/// The numbers of the first `corners` corners, int64; and for each cell how many there are so far.
ElementSection connectivity_section(std::uint64_t offset, std::size_t corners);
ElementSection ends_section(std::uint64_t offset, std::size_t corners);
/// An attribute that the vertices of each element have in common.
ElementSection common_section(std::uint64_t offset, const VertexAttribute& attribute);
/// The labels behind and in front of each element, int64.
ElementSection sides_section(std::uint64_t offset);
/// The numbers of three corners, uint32, behind the byte `prefix` if there is one.
ElementSection indices32_section(std::uint64_t offset, std::optional<std::byte> prefix = {});
/// The same, behind a byte with the number of corners, and before the labels of both sides, int32.
ElementSection sided_indices32_section(std::uint64_t offset);

/// A file of sections; the format's begin() creates it, writes what is around them, and names them.
class SectionedFile : public MeshFile {
  public:
    using MeshFile::MeshFile;
    void add_vertices(const VertexBatch& batch) override;
    void add_elements(const ElementBatch& batch) override;
    [[nodiscard]] bool concurrent() const override { return true; }

  protected:
    struct Sections {
        std::vector<VertexSection> vertices;
        std::vector<ElementSection> elements;

        /// Moves all by the length of what stands before them.
        void shift(std::uint64_t by);
    };
    void use(Sections sections) { sections_ = std::move(sections); }

  private:
    Sections sections_;
};

}  // namespace isonest::detail
