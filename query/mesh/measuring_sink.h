// Measures the triangles of a mesh while they are passed on.
#pragma once

#include <array>
#include <cstdint>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <isonest/extract.h>
#include <isonest/extract_report.h>
#include <isonest/mesh_sink.h>
#include <isonest/progress.h>

#include "query/mesh/scratch_mesh.h"
#include "query/mesh/weld.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

// Whether a mesh of triangles is closed: the number of its vertices on borders.

/// A bijection that removes patterns (the final step of splitmix64).
inline std::uint64_t mixed(std::uint64_t v) {
    v += 0x9E3779B97F4A7C15ULL;
    v = (v ^ (v >> 30U)) * 0xBF58476D1CE4E5B9ULL;
    v = (v ^ (v >> 27U)) * 0x94D049BB133111EBULL;
    return v ^ (v >> 31U);
}

/// Counts vertices around which triangles do not close up, in a table of 8 bytes per vertex, a
/// mapped temporary file. Not thread-safe.
class BorderCount {
  public:
    /// Throws Error{io}.
    BorderCount(std::uint64_t vertices, const ScratchFolder& folder);

    /// REQUIRES: corners are numbers below `vertices`.
    void add(const ElementCorners& triangle);
    [[nodiscard]] std::uint64_t vertices() const;

  private:
    ScratchFile file_;
    std::span<std::uint64_t> balance_;
};

/// Border vertices of a welded mesh, and of triangles between vertices of a complete mesh. Throw
/// Error{io, cancelled}.
std::uint64_t border_vertices(const PartStore& parts, const VertexNumbers& weld,
                              const ScratchFolder& folder, Progress& progress);
std::uint64_t border_vertices(const ScratchMesh& mesh, const CornerView& triangles,
                              const ScratchFolder& folder, Progress& progress);

// Area and volume of a mesh, summed triangle by triangle while it is passed on.

/// The same for any order of the triangles, hence for any threads and batches. Memory does not grow
/// with the mesh. Thread-safety: none.
class SurfaceSums {
  public:
    SurfaceSums() = default;
    /// For triangles within the layout's box.
    explicit SurfaceSums(const MeshLayout& layout);

    /// Adds the triangles of a batch.
    void add(const ElementBatch& batch);
    /// REQUIRES: sums for the same layout.
    void add(const SurfaceSums& other);

    /// All 0 for a mesh without triangles.
    [[nodiscard]] SurfaceMeasures measures() const;

  private:
    __extension__ using Int128 = __int128;

    Double3 centre_{};
    int area_exponent_ = 0;    ///< unit of twice_area_ is 2^area_exponent_
    int volume_exponent_ = 0;  ///< likewise for six_volumes_
    Int128 twice_area_ = 0;
    Int128 six_volumes_ = 0;       ///< with the sign of the side that the triangles face
    std::uint64_t unmatched_ = 0;  ///< 0: there is no border
};

/// Measures of elements whose corners are indices into `positions`, which lie within the layout's
/// box.
SurfaceMeasures measures_of(const MeshLayout& layout,
                            std::span<const std::array<float, 3>> positions,
                            const CornerView& elements);

/// The angle of an equilateral triangle, degrees.
inline constexpr double kMaxAngle = 60;

/// The smallest angle of a triangle, degrees, 0 ... kMaxAngle; 0 where it has no area.
double smallest_angle(const std::array<float, 3>& a, const std::array<float, 3>& b,
                      const std::array<float, 3>& c);

/// Histogram of smallest angles. The same for any order. Thread-safety: none.
class AngleCounts {
  public:
    AngleCounts();
    void add(double angle);
    void add(const AngleCounts& other);
    [[nodiscard]] std::string packed() const;
    static AngleCounts unpacked(std::string_view text);
    /// All 0 if there are no triangles.
    [[nodiscard]] TriangleQuality quality() const;

  private:
    [[nodiscard]] double quantile(double share) const;
    std::vector<std::uint64_t> counts_;  ///< in bins of a hundredth of a degree
    std::uint64_t triangles_ = 0;
    std::uint64_t narrow_ = 0;  ///< below TriangleQuality::kNarrow
    double min_ = kMaxAngle;
};

/// Passes everything to another sink and measures the triangles of the first pass: area and volume,
/// and their angles if requested. Thread-safety: as the other sink's.
class MeasuringSink : public MeshSink {
  public:
    MeasuringSink(MeshSink& sink, bool with_quality) : sink_(sink) {
        if (with_quality) {
            counts_.emplace();
        }
    }

    void prepare(const MeshLayout& layout, std::span<const std::filesystem::path> inputs) override {
        sink_.prepare(layout, inputs);
    }
    void begin(const MeshLayout& layout) override;
    void add_vertices(const VertexBatch& batch) override { sink_.add_vertices(batch); }
    void add_elements(const ElementBatch& batch) override;
    [[nodiscard]] bool again() override;
    void end() override { sink_.end(); }
    [[nodiscard]] bool concurrent() const override { return sink_.concurrent(); }
    [[nodiscard]] bool holds_float64() const override { return sink_.holds_float64(); }

    [[nodiscard]] MeshSink& inner() const { return sink_; }
    [[nodiscard]] bool measures_angles() const { return counts_.has_value(); }
    /// What was measured so far, to be included by another MeasuringSink whose begin() had the same
    /// layout.
    [[nodiscard]] std::string sums() const;
    /// Adds what another one has measured of the same mesh.
    void include(std::string_view sums);

    // Results. Valid after end(), or if there was no mesh.

    [[nodiscard]] SurfaceMeasures measures() const { return sums_.measures(); }
    /// Present if requested.
    [[nodiscard]] std::optional<TriangleQuality> quality() const {
        return counts_ ? std::optional(counts_->quality()) : std::nullopt;
    }

  private:
    MeshSink& sink_;
    std::mutex mutex_;
    SurfaceSums no_sums_;  ///< of the mesh's layout
    SurfaceSums sums_;
    std::optional<AngleCounts> counts_;
    bool is_first_pass_ = true;
};

}  // namespace isonest::detail
