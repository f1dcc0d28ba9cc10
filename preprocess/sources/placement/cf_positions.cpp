#include "preprocess/sources/placement/cf_positions.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstddef>
#include <cstring>
#include <sstream>
#include <utility>

#include <isonest/error.h>

#include "preprocess/sources/bytes/header_words.h"
#include "preprocess/sources/wrapping/wrapped_source.h"

namespace isonest::detail {
namespace {

/// One plane as every plane of a volume.
class SamePlanes : public WrappedSource {
  public:
    SamePlanes(std::unique_ptr<VolumeSource> plane, std::int64_t planes)
        : WrappedSource(std::move(plane)), described_(inner_source().describe()) {
        described_.nodes.z = planes;
    }
    [[nodiscard]] VolumeDescription describe() const override { return described_; }
    [[nodiscard]] Granularity granularity() const override {
        return {1, inner_source().granularity().rows};
    }
    void will_read(std::int64_t /*z0*/, std::int64_t /*nz*/, std::int64_t /*y0*/,
                   std::int64_t /*ny*/) override {}
    void read(std::int64_t /*z0*/, std::int64_t nz, std::int64_t y0, std::int64_t ny,
              std::byte* dst) override {
        const std::size_t bytes =
            static_cast<std::size_t>(ny * described_.nodes.x) * size_of(described_.type);
        inner_source().read(0, 1, y0, ny, dst);
        for (std::int64_t z = 1; z < nz; ++z) {
            std::memcpy(dst + static_cast<std::size_t>(z) * bytes, dst, bytes);
        }
    }

  private:
    VolumeDescription described_;
};

/// One number for each plane.
class Heights : public VolumeSource {
  public:
    Heights(std::string name, const Int3& nodes, std::vector<double> heights)
        : heights_(std::move(heights)) {
        described_.name = std::move(name);
        described_.nodes = nodes;
        described_.type = ValueType::f64;
    }
    [[nodiscard]] VolumeDescription describe() const override { return described_; }
    [[nodiscard]] std::string identity() const override {
        std::string text = "heights";
        for (const double height : heights_) {
            text += fmt::format(" {}", height);
        }
        return text + "\n";
    }
    void read(std::int64_t z0, std::int64_t nz, std::int64_t /*y0*/, std::int64_t ny,
              std::byte* dst) override {
        std::vector<double> row(static_cast<std::size_t>(described_.nodes.x));
        for (std::int64_t i = 0; i < nz * ny; ++i) {
            std::fill(row.begin(), row.end(), heights_[static_cast<std::size_t>(z0 + i / ny)]);
            std::memcpy(dst + static_cast<std::size_t>(i * described_.nodes.x) * sizeof(double),
                        row.data(), row.size() * sizeof(double));
        }
    }

  private:
    VolumeDescription described_;
    std::vector<double> heights_;
};

bool is_x(const CfCoordinate& c) {
    const std::string units = lower(c.units);
    return c.standard_name == "longitude" || c.standard_name == "projection_x_coordinate" ||
           units == "degrees_east" || units == "degree_east" || units == "degrees_e" ||
           lower(c.axis) == "x";
}

bool is_y(const CfCoordinate& c) {
    const std::string units = lower(c.units);
    return c.standard_name == "latitude" || c.standard_name == "projection_y_coordinate" ||
           units == "degrees_north" || units == "degree_north" || units == "degrees_n" ||
           lower(c.axis) == "y";
}

bool is_z(const CfCoordinate& c) {
    return !c.positive.empty() || lower(c.axis) == "z" || c.standard_name == "depth" ||
           c.standard_name == "height" || c.standard_name == "altitude";
}

std::string list_of(const Int3& nodes) {
    return fmt::format("{} x {} x {}", nodes.x, nodes.y, nodes.z);
}

}  // namespace

std::vector<std::string> words_of(const std::string& text) {
    std::istringstream words(text);
    std::vector<std::string> all;
    for (std::string word; words >> word;) {
        all.push_back(word);
    }
    return all;
}

std::optional<CfPositions> choose_positions(const std::vector<CfCoordinate>& named,
                                            const Int3& nodes) {
    const std::vector<std::int64_t> plane{nodes.y, nodes.x};
    const std::vector<std::int64_t> volume{nodes.z, nodes.y, nodes.x};
    CfPositions chosen;
    for (const CfCoordinate& c : named) {
        const bool of_volume = c.lengths == volume;
        if (!of_volume && c.lengths != plane) {
            continue;
        }
        if (is_x(c) && chosen.x.empty()) {
            chosen.x = c.name;
        } else if (is_y(c) && chosen.y.empty()) {
            chosen.y = c.name;
        } else if (of_volume && is_z(c) && chosen.z.empty()) {
            chosen.z = c.name;
        }
    }
    return chosen.x.empty() || chosen.y.empty() ? std::nullopt : std::optional(chosen);
}

NodePositionsPtr cf_positions(const CfPositions& chosen, const Int3& nodes,
                              const std::vector<double>& heights, const OpenCoordinate& open,
                              const std::string& name, std::vector<std::string>& notes) {
    const auto opened = [&](const std::string& variable) -> std::shared_ptr<VolumeSource> {
        std::unique_ptr<VolumeSource> source = open(variable);
        const Int3 own = source->describe().nodes;
        if (own == Int3{nodes.x, nodes.y, 1} && nodes.z > 1) {
            return std::make_shared<SamePlanes>(std::move(source), nodes.z);
        }
        if (own != nodes) {
            throw Error(ErrorKind::corrupt, {source->describe().name},
                        fmt::format("these coordinates are those of {} nodes, but the volume has "
                                    "{}",
                                    list_of(own), list_of(nodes)));
        }
        return source;
    };
    auto positions = std::make_shared<NodePositions>();
    positions->coordinates[0] = opened(chosen.x);
    positions->coordinates[1] = opened(chosen.y);
    if (!chosen.z.empty()) {
        positions->coordinates[2] = opened(chosen.z);
        return positions;
    }
    std::vector<double> planes = heights;
    if (static_cast<std::int64_t>(planes.size()) != nodes.z) {
        planes.clear();
        for (std::int64_t z = 0; z < nodes.z; ++z) {
            planes.push_back(static_cast<double>(z));
        }
        notes.emplace_back(
            "the planes of the curvilinear grid have no coordinates: their z is their number");
    }
    positions->coordinates[2] = std::make_shared<Heights>(name, nodes, std::move(planes));
    return positions;
}

}  // namespace isonest::detail
