// Stores the parts of a mesh until all are known and their vertices can be numbered: in memory up
// to a limit, then on disk.
#pragma once

#include <memory>
#include <mutex>
#include <optional>
#include <vector>

#include <isonest/mesh_sink.h>

#include "query/march/clip.h"
#include "query/march/mesh_part.h"
#include "store/base/vectors.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

/// Location of one part.
struct PartRecord {
    std::uint64_t order = 0;   ///< sort key; parts in this order make the mesh, whatever made them
    std::uint64_t offset = 0;  ///< bytes in the file, or index of the part in memory
    std::uint32_t in_memory = 0;
    std::uint32_t vertices = 0;
    std::uint32_t triangles = 0;
    std::uint32_t shared = 0;
    std::uint32_t names = 0;
    std::uint32_t cuts = 0;
    std::uint32_t not_alone = 0;
    std::uint32_t without_normal = 0;  ///< number of vertices, if counted
    std::uint32_t owned = 0;           ///< set by the weld: vertices not used by an earlier part
    std::uint64_t first_vertex = 0;    ///< set by the weld: number of the first owned vertex
    std::uint64_t first_triangle = 0;
    std::uint64_t first_shared = 0;
    std::uint64_t first_not_alone = 0;  ///< set by seal(): count in the parts before
};

/// Selects vertices that may be at the same place as another one, by their position in the lattice.
struct PlaceWatch {
    double sight = 0;  ///< distance from nodes and from the box's faces, along the axes
    ClipBox box = {};
};

/// Totals of all parts of a store.
struct PartTotals {
    std::uint64_t zero_area = 0;       ///< triangles
    std::uint64_t without_normal = 0;  ///< number of vertices, if counted
    std::uint64_t cut_fans = 0;        ///< see MeshPart
    /// Bounding box of all vertices, world coordinates; lo > hi if there are none.
    std::array<float, 3> lo{};
    std::array<float, 3> hi{};
};

/// Thread-safety: append() and add() from any thread, also put() of different parts; the rest from
/// one thread, after the last append().
class PartStore {
  public:
    /// World coordinates are origin + steps.vector(position), as float32. Parts stay in memory up
    /// to a total of `memory` bytes; the others go to a temporary file in `folder`. `attributes`:
    /// number of words per vertex.
    PartStore(const ScratchFolder& folder, const LatticeSteps& steps, const Double3& origin,
              std::uint64_t memory, std::size_t attributes = 0);

    /// Enables the search for vertices that may be at the same place as another one. REQUIRES:
    /// nothing was appended.
    void watch(const PlaceWatch& places) { watch_ = places; }
    /// Enables counting of vertices whose normal, the first of their attributes, is 0. REQUIRES:
    /// nothing was appended.
    void count_normals() { counts_normals_ = true; }
    /// Throws Error{io}.
    void append(std::uint64_t order, const MeshPart& part);
    /// Adds a part of another store of the same kind: `record` and the size of all_bytes() there.
    /// put() then supplies its bytes, piece by piece. Returns the record here. Throws Error{io}.
    PartRecord add(const PartRecord& record);
    /// `at`: offset of `bytes` in the part. Throws Error{io}.
    void put(const PartRecord& record, std::uint64_t at, std::span<const std::byte> bytes);
    /// Adds the totals of another store.
    void include(const PartTotals& other);
    /// Ends appending: maps everything and sorts the records.
    void seal();

    [[nodiscard]] std::span<PartRecord> records() const { return records_; }
    [[nodiscard]] std::span<const std::array<float, 3>> vertices(const PartRecord& r) const;
    /// For moving vertices: every part has its own copy of a vertex. The box is not updated.
    [[nodiscard]] std::span<std::array<float, 3>> changeable_vertices(const PartRecord& r);
    /// attributes_per_vertex() words for each vertex.
    [[nodiscard]] std::span<const std::uint32_t> attributes(const PartRecord& r) const;
    /// For changing normals: every part has its own copy of a vertex.
    [[nodiscard]] std::span<std::uint32_t> changeable_attributes(const PartRecord& r);
    [[nodiscard]] std::size_t attributes_per_vertex() const { return attributes_; }
    [[nodiscard]] std::span<const std::array<std::uint32_t, 3>> triangles(
        const PartRecord& r) const;
    [[nodiscard]] std::span<const MeshPart::Shared> shared(const PartRecord& r) const;
    [[nodiscard]] std::span<const MeshPart::Name> names(const PartRecord& r) const;
    [[nodiscard]] std::span<const MeshPart::Cut> cuts(const PartRecord& r) const;
    /// Vertices, ascending, that may be at the same place as another vertex of any part. All others
    /// are at different places. REQUIRES: watch() was called.
    [[nodiscard]] std::span<const std::uint32_t> not_alone(const PartRecord& r) const;
    /// Frees the space of a part; only its record may be used afterwards. May be called for
    /// different parts from any thread.
    void release(const PartRecord& r);
    /// All data of a part (names, vertices, triangles and the rest), as stored.
    [[nodiscard]] std::span<const std::byte> all_bytes(const PartRecord& r) const;
    [[nodiscard]] std::uint64_t count_bytes(const PartRecord& r) const;
    /// Size of all parts together.
    [[nodiscard]] std::uint64_t bytes() const { return bytes_; }
    [[nodiscard]] PartTotals totals() const {
        return {zero_area_, without_normal_, cut_fans_, lo_, hi_};
    }
    [[nodiscard]] std::uint64_t zero_area_triangles() const { return zero_area_; }
    [[nodiscard]] std::uint64_t without_normal() const { return without_normal_; }
    [[nodiscard]] std::uint64_t cut_fans() const { return cut_fans_; }
    /// Whether vertices or triangles change before vertices are kept apart.
    [[nodiscard]] bool is_to_be_mended() const { return zero_area_ > 0 || cut_fans_ > 0; }
    /// Bounding box of all vertices, world coordinates; lo > hi if there are none.
    [[nodiscard]] const std::array<float, 3>& lo() const { return lo_; }
    [[nodiscard]] const std::array<float, 3>& hi() const { return hi_; }

  private:
    template <class T>
    std::span<const T> slice(const PartRecord& r, std::uint64_t offset, std::uint32_t count) const {
        const std::byte* const part =
            r.in_memory != 0 ? kept_[r.offset].get() : data_.data() + r.offset;
        return {reinterpret_cast<const T*>(part + offset), count};
    }
    /// Reserves space for a part: in memory as far as possible. Returns its number.
    std::uint64_t reserve(PartRecord& record, std::uint64_t bytes);
    void keep(const PartRecord& record, std::unique_ptr<std::byte[]> bytes);
    void write_record(std::uint64_t number, const PartRecord& record);
    PiecedFile file_;
    ScratchFile record_file_;
    LatticeSteps steps_;
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
