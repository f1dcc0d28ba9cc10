// A mesh's triangles, measured while they are handed over.
#pragma once

#include <array>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <isonest/extract.h>
#include <isonest/mesh_sink.h>

#include "query/mesh/surface_sums.h"

namespace isonest::detail {

/// That of an equilateral triangle, degrees.
inline constexpr double kMostAngle = 60;

/// The smallest angle of a triangle, degrees, 0 ... kMostAngle; 0 where it has no area.
double smallest_angle(const std::array<float, 3>& a, const std::array<float, 3>& b,
                      const std::array<float, 3>& c);

/// How often which smallest angle occurs. The same for any order. Thread-safety: none.
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
    std::vector<std::uint64_t> counts_;  ///< of a hundredth of a degree each
    std::uint64_t triangles_ = 0;
    std::uint64_t narrow_ = 0;  ///< below TriangleQuality::kNarrow
    double least_ = kMostAngle;
};

/// Hands everything to another sink and measures the triangles of the first pass: area and volume,
/// and their angles if asked for. Thread-safety: as the other sink's.
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
    /// What was measured until now, for another one whose begin() had the same layout.
    [[nodiscard]] std::string sums() const;
    /// What another one has measured of the same mesh, too.
    void include(std::string_view sums);

    /// Fills in what was measured. After end(), or where no mesh came.
    void report(ExtractReport& report) const;

  private:
    MeshSink& sink_;
    std::mutex mutex_;
    SurfaceSums no_sums_;  ///< of the mesh's layout
    SurfaceSums sums_;
    std::optional<AngleCounts> counts_;
    bool is_first_pass_ = true;
};

}  // namespace isonest::detail
