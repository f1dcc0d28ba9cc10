// A mesh as the viewer's page gets it (PROTOCOL.md, "A mesh").
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <exception>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include <isonest/mesh_sink.h>

namespace isonest::detail::view {

/// The mesh has more triangles than the sink was told to take.
struct TooManyTriangles : public std::exception {
    explicit TooManyTriangles(std::uint64_t triangles_) : triangles(triangles_) {}
    [[nodiscard]] const char* what() const noexcept override { return "too many triangles"; }
    std::uint64_t triangles;
};

/// Positions are rounded to 2^16 steps along each axis of the mesh's box, values to 2^16 between
/// their smallest and largest.
class MeshMessage : public MeshSink {
  public:
    /// begin() throws TooManyTriangles beyond `most` triangles.
    explicit MeshMessage(std::uint64_t most) : most_(most) {}

    /// Bytes of heap for a triangle, at most, while a message is made: a mesh has at most three
    /// vertices for a triangle, and about half of one; one without normals of its own about half.
    static constexpr std::uint64_t kTriangleHeap = 64;

    /// Throws Error{invalid_argument} for lines.
    void prepare(const MeshLayout& layout, std::span<const std::filesystem::path> inputs) override;
    void begin(const MeshLayout& layout) override;
    void add_vertices(const VertexBatch& batch) override;
    void add_elements(const ElementBatch& batch) override;
    [[nodiscard]] bool concurrent() const override { return true; }
    [[nodiscard]] bool holds_float64() const override { return false; }

    [[nodiscard]] std::uint64_t triangles() const { return indices_.size() / 3; }
    /// World units: how far rounding to the steps moves a position at most.
    [[nodiscard]] double position_rounding() const;
    /// The same of a mesh that fills a box of these lengths.
    static double rounding_of(const std::array<double, 3>& extent);
    /// Gives each vertex the mean of the normals of its triangles, weighed by their areas. After
    /// end(), of a mesh that came without.
    void make_normals();
    /// The whole message: `header` and what is known here. The mesh is gone then.
    [[nodiscard]] std::string finish(nlohmann::ordered_json header);

  private:
    using Position = std::array<std::uint16_t, 4>;
    using Normal = std::array<std::int8_t, 4>;
    void round_values(nlohmann::ordered_json& header);

    std::uint64_t most_;
    MeshLayout layout_;
    std::array<double, 3> origin_{};
    std::array<double, 3> step_{};
    std::vector<Position> positions_;
    std::vector<Normal> normals_;
    std::vector<float> values_;
    std::vector<std::uint32_t> indices_;
};

}  // namespace isonest::detail::view
