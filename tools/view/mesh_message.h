// The mesh message for the viewer's page (PROTOCOL.md, "A mesh").
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <exception>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include <isonest/mesh_sink.h>

namespace isonest::detail::view {

/// The mesh has more triangles than the sink accepts.
struct TooManyTriangles : public std::exception {
    explicit TooManyTriangles(std::uint64_t triangles_) : triangles(triangles_) {}
    [[nodiscard]] const char* what() const noexcept override { return "too many triangles"; }
    std::uint64_t triangles;
};

/// Positions are rounded to 2^16 steps along each axis of the mesh's box, values to 2^16 steps
/// between the smallest and the largest.
class MeshMessage : public MeshSink {
  public:
    /// begin() throws TooManyTriangles above `most` triangles. `value_name`: the attribute that is
    /// sent as the vertices' value, if the mesh has it.
    explicit MeshMessage(std::uint64_t most, std::string value_name = "value")
        : max_(most), value_name_(std::move(value_name)) {}

    /// Maximum heap in bytes per triangle while a message is made. A mesh has at most three
    /// vertices per triangle, usually about half a vertex, and without normals of its own always
    /// about half.
    static constexpr std::uint64_t kTriangleHeap = 64;

    /// Throws Error{invalid_argument} for lines.
    void prepare(const MeshLayout& layout, std::span<const std::filesystem::path> inputs) override;
    void begin(const MeshLayout& layout) override;
    void add_vertices(const VertexBatch& batch) override;
    void add_elements(const ElementBatch& batch) override;
    [[nodiscard]] bool concurrent() const override { return true; }
    [[nodiscard]] bool holds_float64() const override { return false; }

    [[nodiscard]] std::uint64_t triangles() const { return indices_.size() / 3; }
    /// Maximum distance in world units that rounding moves a position.
    [[nodiscard]] double position_rounding() const;
    /// The same for a mesh that fills a box with these lengths.
    static double rounding_of(const std::array<double, 3>& extent);
    /// Gives each vertex the area-weighted mean of the normals of its triangles. Call it after
    /// end(), for a mesh without normals.
    void make_normals();
    /// The whole message: `header`, completed with what is known here. The mesh is released.
    [[nodiscard]] std::string finish(nlohmann::ordered_json header);

  private:
    using Position = std::array<std::uint16_t, 4>;
    using Normal = std::array<std::int8_t, 4>;
    void round_values(nlohmann::ordered_json& header);

    std::uint64_t max_;
    std::string value_name_;
    MeshLayout layout_;
    std::array<double, 3> origin_{};
    std::array<double, 3> step_{};
    std::vector<Position> positions_;
    std::vector<Normal> normals_;
    std::vector<float> values_;
    std::vector<std::uint32_t> indices_;
};

}  // namespace isonest::detail::view
