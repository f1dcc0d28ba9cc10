// The parts of a mesh, until all are known and their vertices can be numbered: in memory as far as
// that is allowed, then on disk.
#pragma once

#include <memory>
#include <mutex>
#include <optional>
#include <vector>

#include <isonest/mesh_sink.h>

#include "query/march/clip.h"
#include "query/march/mesh_part.h"
#include "store/files/pieced_file.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

/// Where one part lies.
struct PartRecord {
    std::uint64_t order = 0;   ///< parts in this order make the mesh, whatever made them
    std::uint64_t offset = 0;  ///< bytes in the file, or number of the part in memory
    std::uint32_t in_memory = 0;
    std::uint32_t vertices = 0;
    std::uint32_t triangles = 0;
    std::uint32_t shared = 0;
    std::uint32_t names = 0;
    std::uint32_t cuts = 0;
    std::uint32_t not_alone = 0;
    std::uint32_t without_normal = 0;  ///< vertices, if they are counted
    std::uint32_t owned = 0;           ///< set by the weld: vertices not named by an earlier part
    std::uint64_t first_vertex = 0;    ///< set by the weld: number of the first owned vertex
    std::uint64_t first_triangle = 0;
    std::uint64_t first_shared = 0;
    std::uint64_t first_not_alone = 0;  ///< set by seal(): those of the parts before
};

/// Which vertices may share their place with another one, by where they are in the lattice.
struct PlaceWatch {
    double sight = 0;  ///< from nodes and from the box's faces, along the axes
    ClipBox box = {};
};

/// What is known of all parts of a store together.
struct PartTotals {
    std::uint64_t zero_area = 0;       ///< triangles
    std::uint64_t without_normal = 0;  ///< vertices, if they are counted
    std::uint64_t cut_fans = 0;        ///< of MeshPart
    /// The smallest box that holds all vertices, world coordinates; lo > hi if there is none.
    std::array<float, 3> lo{};
    std::array<float, 3> hi{};
};

/// Thread-safety: append() and add() from any thread, put() of different parts, too; the rest from
/// one, after the last append.
class PartStore {
  public:
    /// World coordinates are origin + spacing * position, as float32. Parts of up to `memory` bytes
    /// in all stay in memory, the others go to a temporary file in `folder`. `attributes`: how
    /// many words each vertex has.
    PartStore(const ScratchFolder& folder, const Double3& spacing, const Double3& origin,
              std::uint64_t memory, std::size_t attributes = 0);

    /// From now on vertices are looked for that may share their place with another one. REQUIRES:
    /// nothing was appended.
    void watch(const PlaceWatch& places) { watch_ = places; }
    /// From now on vertices are counted whose normal, the first of their attributes, is 0.
    /// REQUIRES: nothing was appended.
    void count_normals() { counts_normals_ = true; }
    /// Throws Error{io}.
    void append(std::uint64_t order, const MeshPart& part);
    /// A part that another store like this one has: `record` and what all_bytes() says there. put()
    /// gives it its bytes afterwards, piece by piece. Returns the record here. Throws Error{io}.
    PartRecord add(const PartRecord& record);
    /// `at`: of the first of `bytes` in the part. Throws Error{io}.
    void put(const PartRecord& record, std::uint64_t at, std::span<const std::byte> bytes);
    /// What is said of all parts of another store.
    void include(const PartTotals& other);
    /// Ends the appending: maps everything and sorts the records.
    void seal();

    [[nodiscard]] std::span<PartRecord> records() const { return records_; }
    [[nodiscard]] std::span<const std::array<float, 3>> vertices(const PartRecord& r) const;
    /// For whoever moves vertices: every part has its own copy of one. The box stays as it is.
    [[nodiscard]] std::span<std::array<float, 3>> changeable_vertices(const PartRecord& r);
    /// attributes_per_vertex() words for each vertex.
    [[nodiscard]] std::span<const std::uint32_t> attributes(const PartRecord& r) const;
    /// For whoever changes normals: every part has its own copy of a vertex.
    [[nodiscard]] std::span<std::uint32_t> changeable_attributes(const PartRecord& r);
    [[nodiscard]] std::size_t attributes_per_vertex() const { return attributes_; }
    [[nodiscard]] std::span<const std::array<std::uint32_t, 3>> triangles(
        const PartRecord& r) const;
    [[nodiscard]] std::span<const MeshPart::Shared> shared(const PartRecord& r) const;
    [[nodiscard]] std::span<const MeshPart::Name> names(const PartRecord& r) const;
    [[nodiscard]] std::span<const MeshPart::Cut> cuts(const PartRecord& r) const;
    /// Vertices, ascending, that may share their place with another one of any part. Others are
    /// alone. REQUIRES: watch() was called.
    [[nodiscard]] std::span<const std::uint32_t> not_alone(const PartRecord& r) const;
    /// Gives back what a part takes, of which nothing but the record is looked at any more. Of
    /// different parts from any thread.
    void release(const PartRecord& r);
    /// Of a part: names, vertices, triangles and all else, as it lies in the store.
    [[nodiscard]] std::span<const std::byte> all_bytes(const PartRecord& r) const;
    [[nodiscard]] std::uint64_t count_bytes(const PartRecord& r) const;
    /// Of all parts together.
    [[nodiscard]] std::uint64_t bytes() const { return bytes_; }
    [[nodiscard]] PartTotals totals() const {
        return {zero_area_, without_normal_, cut_fans_, lo_, hi_};
    }
    [[nodiscard]] std::uint64_t zero_area_triangles() const { return zero_area_; }
    [[nodiscard]] std::uint64_t without_normal() const { return without_normal_; }
    [[nodiscard]] std::uint64_t cut_fans() const { return cut_fans_; }
    /// Whether vertices or triangles change before vertices are kept apart.
    [[nodiscard]] bool is_to_be_mended() const { return zero_area_ > 0 || cut_fans_ > 0; }
    /// The smallest box that holds all vertices, world coordinates; lo > hi if there is none.
    [[nodiscard]] const std::array<float, 3>& lo() const { return lo_; }
    [[nodiscard]] const std::array<float, 3>& hi() const { return hi_; }

  private:
    template <class T>
    std::span<const T> slice(const PartRecord& r, std::uint64_t offset, std::uint32_t count) const {
        const std::byte* const part =
            r.in_memory != 0 ? kept_[r.offset].get() : data_.data() + r.offset;
        return {reinterpret_cast<const T*>(part + offset), count};
    }
    /// Room for a part of so many bytes: in memory as far as that goes. Returns its number.
    std::uint64_t reserve(PartRecord& record, std::uint64_t bytes);
    void keep(const PartRecord& record, std::unique_ptr<std::byte[]> bytes);
    void write_record(std::uint64_t number, const PartRecord& record);
    PiecedFile file_;
    ScratchFile record_file_;
    Double3 spacing_;
    Double3 origin_;
    std::uint64_t memory_;
    std::size_t attributes_;
    std::optional<PlaceWatch> watch_;
    bool counts_normals_ = false;
    std::mutex mutex_;
    std::vector<std::unique_ptr<std::byte[]>> kept_;
    std::uint64_t end_ = 0;
    std::uint64_t count_ = 0;
    std::uint64_t bytes_ = 0;
    std::uint64_t zero_area_ = 0;
    std::uint64_t without_normal_ = 0;
    std::uint64_t cut_fans_ = 0;
    std::array<float, 3> lo_ = MeshLayout::kEmptyLo;
    std::array<float, 3> hi_ = MeshLayout::kEmptyHi;
    std::span<std::byte> data_;
    std::span<PartRecord> records_;
};

}  // namespace isonest::detail
