#include <algorithm>
#include <utility>
#include <vector>

#include <isonest/error.h>

#include "query/formats/mesh_files.h"
#include "store/files/open_file.h"

namespace isonest::detail {
namespace {

/// Thread-safety: as the other sink's.
class ConvertedSink : public MeshSink {
  public:
    ConvertedSink(std::unique_ptr<MeshSink> sink, LengthUnit unit)
        : sink_(std::move(sink)), unit_(unit) {}

    void prepare(const MeshLayout& layout, std::span<const std::filesystem::path> inputs) override {
        sink_->prepare(in_unit(layout), inputs);
    }
    void begin(const MeshLayout& layout) override {
        const MeshLayout written = in_unit(layout);
        factor_ = converted_length(1, *layout.unit, unit_);
        sink_->begin(written);
    }
    void add_vertices(const VertexBatch& batch) override {
        VertexBatch written = batch;
        const auto positions = in_unit(batch.positions);
        written.positions = positions;
        sink_->add_vertices(written);
    }
    void add_elements(const ElementBatch& batch) override {
        ElementBatch written = batch;
        const auto positions = in_unit(batch.nearby.positions);
        written.nearby.positions = positions;
        sink_->add_elements(written);
    }
    [[nodiscard]] bool again() override { return sink_->again(); }
    void end() override { sink_->end(); }
    [[nodiscard]] bool concurrent() const override { return sink_->concurrent(); }
    [[nodiscard]] bool holds_float64() const override { return sink_->holds_float64(); }

  private:
    [[nodiscard]] static float times(float x, double factor) {
        return static_cast<float>(static_cast<double>(x) * factor);
    }
    [[nodiscard]] MeshLayout in_unit(const MeshLayout& layout) const {
        if (!layout.unit) {
            throw Error(ErrorKind::invalid_argument,
                        "the mesh cannot be written in another unit: that of its coordinates is "
                        "unknown",
                        {{RemedyKind::place_in_world, "unit"}});
        }
        MeshLayout written = layout;
        written.unit = unit_;
        const double factor = converted_length(1, *layout.unit, unit_);
        // The corners of an empty box stay as they are.
        for (std::size_t axis = 0; axis < 3 && layout.lo[axis] <= layout.hi[axis]; ++axis) {
            written.lo[axis] = times(layout.lo[axis], factor);
            written.hi[axis] = times(layout.hi[axis], factor);
        }
        return written;
    }
    [[nodiscard]] std::vector<std::array<float, 3>> in_unit(
        std::span<const std::array<float, 3>> positions) const {
        std::vector<std::array<float, 3>> written(positions.size());
        std::transform(positions.begin(), positions.end(), written.begin(), [this](const auto& p) {
            return std::array{times(p[0], factor_), times(p[1], factor_), times(p[2], factor_)};
        });
        return written;
    }

    std::unique_ptr<MeshSink> sink_;
    LengthUnit unit_;
    double factor_ = 1;
};

}  // namespace

void require_free_unit(const std::filesystem::path& path) {
    const std::string end = lower_extension(path);
    if (end == ".glb" || end == ".3mf" || end == ".ngmesh") {
        throw Error(ErrorKind::invalid_argument, {path.string()},
                    "files of this format have a unit of their own, to which lengths are converted "
                    "if the unit of the coordinates is known");
    }
}

std::unique_ptr<MeshSink> converted(std::unique_ptr<MeshSink> sink, LengthUnit unit) {
    return std::make_unique<ConvertedSink>(std::move(sink), unit);
}

}  // namespace isonest::detail
