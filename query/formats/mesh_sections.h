// The common part of the binary mesh formats: tables with one row per vertex or element, each at a
// known place in the file, so that all batches can be written at the same time.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "query/formats/base64_rows.h"
#include "query/formats/mesh_files.h"
#include "store/files/shared_file.h"

namespace isonest::detail {

/// A table with a row for every vertex: its position, or some bytes of its attributes, or both.
struct VertexSection {
    std::uint64_t offset = 0;
    bool position = false;
    std::size_t first = 0;  ///< of the attributes' bytes
    std::size_t bytes = 0;
    double scale = 1;    ///< of the position
    Double3 shift = {};  ///< added to it before
    /// Where the rows are in base64, the whole array; `offset` counts its bytes then.
    Base64Array base64 = {};
    /// x and y of the position are negated, and of the normal, whose first byte in a row of
    /// attributes this is; none: the section has no normal.
    bool turned = false;
    std::size_t normal = kNoNormal;
    static constexpr std::size_t kNoNormal = ~std::size_t{0};

    [[nodiscard]] std::size_t stride() const {
        return (position ? sizeof(std::array<float, 3>) : 0) + bytes;
    }
};
VertexSection position_section(std::uint64_t offset, double scale = 1);
VertexSection attribute_section(std::uint64_t offset, const VertexAttribute& attribute);

/// What an element's row has.
enum class ElementRow : std::uint32_t { corners, end, common, sides, corners32, facet };

/// A table with a row of `stride` bytes for every element.
struct ElementSection {
    std::uint64_t offset = 0;
    std::size_t stride = 0;
    ElementRow row = ElementRow::corners;
    std::size_t corners = 3;
    std::size_t first = 0;  ///< of the attributes' bytes that the vertices have in common
    std::size_t bytes = 0;
    bool has_prefix = false;  ///< corners32: behind the byte `prefix`
    bool has_sides = false;   ///< corners32: before the labels of both sides, int32
    std::byte prefix{};
    bool turned = false;      ///< facet: x and y of the corners are negated
    Base64Array base64 = {};  ///< as of VertexSection
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
/// As in STL: normal, three corners, two bytes.
ElementSection facet_section(std::uint64_t offset);

/// The tables of a file, as plain numbers.
struct Sections {
    std::vector<VertexSection> vertices;
    std::vector<ElementSection> elements;

    /// Moves all by the length of what stands before them. REQUIRES: none is in base64.
    void shift(std::uint64_t by);
};

/// A file of sections; the format's begin() creates it, writes what is around them, and names them.
class SectionedFile : public MeshFile {
  public:
    using MeshFile::MeshFile;
    void add_vertices(const VertexBatch& batch) override;
    void add_elements(const ElementBatch& batch) override;
    [[nodiscard]] bool concurrent() const override { return true; }
    void end() override;
    /// After begin(): other processes write some of the rows, by RowWriter, until end(). Returns
    /// what they need. Throws Error{io}.
    std::string share();
    /// What RowWriter::loose_ends() says in one of them, after its end() and before that of the
    /// file. Throws Error{io}.
    void include(std::string_view loose_ends);

  protected:
    /// Once the file is there. `layout`: of the mesh.
    void use(Sections sections, const MeshLayout& layout);
    /// Bytes of an array in base64 that are in no row.
    void put(const Base64Array& array, std::uint64_t at, std::span<const std::byte> bytes);

  private:
    Sections sections_;
    Base64Rows base64_;
};

/// Writes rows of a file that another process has created and publishes. The layout that begin()
/// gets means nothing; end() syncs the rows to disk.
class RowWriter : public MeshSink {
  public:
    /// `shared`: of SectionedFile::share() there. Throws Error{io}.
    explicit RowWriter(std::string_view shared);
    void begin(const MeshLayout& /*layout*/) override {}
    void add_vertices(const VertexBatch& batch) override;
    void add_elements(const ElementBatch& batch) override;
    void end() override { file_.close(); }
    [[nodiscard]] bool concurrent() const override { return true; }
    /// What of the file other processes have to complete, for SectionedFile::include() there.
    [[nodiscard]] std::string loose_ends() { return base64_.take(); }

  private:
    SharedFile file_;
    Sections sections_;
    Base64Rows base64_;
};

}  // namespace isonest::detail
