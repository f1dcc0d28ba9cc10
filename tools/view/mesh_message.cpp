// Compression: meshoptimizer's codecs for vertex and index buffers (Kapoulkine, meshoptimizer,
// "Vertex/index buffer compression").
#include "tools/view/mesh_message.h"

#include <meshoptimizer.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <utility>

#include <isonest/error.h>

#include "store/base/vectors.h"

namespace isonest::detail::view {
namespace {

using Json = nlohmann::ordered_json;

constexpr double kSteps = 65535;
constexpr std::uint16_t kMissing = 65535;
constexpr std::size_t kAlignment = 16;
constexpr std::uint32_t kVersion = 1;
/// Below this size, uncompressed bytes cost less than decoding.
constexpr std::uint64_t kMinEncoded = 256;

std::uint16_t rounded(double steps) {
    return static_cast<std::uint16_t>(std::lround(std::clamp(steps, 0.0, kSteps)));
}

/// A component of a unit normal.
std::int8_t rounded_normal(double component) {
    constexpr double kUnit = 127;
    return static_cast<std::int8_t>(std::lround(kUnit * std::clamp(component, -1.0, 1.0)));
}

void append_number(std::string& out, std::uint32_t number) {
    for (unsigned i = 0; i < 4; ++i) {
        out += static_cast<char>((number >> (8 * i)) & 0xFFU);
    }
}

/// Sections with their descriptions and bytes.
class Sections {
  public:
    template <class T>
    void add_vertices(const std::string& name, std::vector<T>& rows) {
        std::string bytes;
        const bool encoded = rows.size() >= kMinEncoded;
        if (encoded) {
            bytes.resize(::meshopt_encodeVertexBufferBound(rows.size(), sizeof(T)));
            bytes.resize(
                ::meshopt_encodeVertexBuffer(reinterpret_cast<unsigned char*>(bytes.data()),
                                             bytes.size(), rows.data(), rows.size(), sizeof(T)));
        } else {
            bytes.assign(reinterpret_cast<const char*>(rows.data()), rows.size() * sizeof(T));
        }
        add(name, encoded ? "meshopt_vertex" : "raw", sizeof(T), rows.size(), std::move(bytes));
        rows = {};
    }
    void add_indices(std::vector<std::uint32_t>& indices, std::size_t vertices) {
        std::string bytes;
        const bool encoded = indices.size() >= kMinEncoded;
        if (encoded) {
            bytes.resize(::meshopt_encodeIndexBufferBound(indices.size(), vertices));
            bytes.resize(::meshopt_encodeIndexBuffer(reinterpret_cast<unsigned char*>(bytes.data()),
                                                     bytes.size(), indices.data(), indices.size()));
        } else {
            bytes.assign(reinterpret_cast<const char*>(indices.data()),
                         indices.size() * sizeof(std::uint32_t));
        }
        add("indices", encoded ? "meshopt_index" : "raw", sizeof(std::uint32_t), indices.size(),
            std::move(bytes));
        indices = {};
    }
    [[nodiscard]] const Json& described() const { return described_; }
    [[nodiscard]] const std::vector<std::string>& bytes() const { return bytes_; }

  private:
    void add(const std::string& name, const char* encoding, std::size_t stride, std::size_t count,
             std::string&& bytes) {
        described_.push_back({{"name", name},
                              {"encoding", encoding},
                              {"bytes", bytes.size()},
                              {"stride", stride},
                              {"count", count}});
        bytes_.push_back(std::move(bytes));
    }
    Json described_ = Json::array();
    std::vector<std::string> bytes_;
};

}  // namespace

void MeshMessage::prepare(const MeshLayout& layout,
                          std::span<const std::filesystem::path> /*inputs*/) {
    if (layout.corners != 3) {
        throw Error(ErrorKind::invalid_argument,
                    "data in a plane have isolines and no surface; ask for their slice");
    }
}

void MeshMessage::begin(const MeshLayout& layout) {
    if (layout.elements > max_) {
        throw TooManyTriangles(layout.elements);
    }
    layout_ = layout;
    for (std::size_t axis = 0; axis < 3; ++axis) {
        const double extent = static_cast<double>(layout.hi[axis]) - layout.lo[axis];
        origin_[axis] = layout.vertices > 0 ? layout.lo[axis] : 0;
        step_[axis] = layout.vertices > 0 && extent > 0 ? extent / kSteps : 0;
    }
    positions_.assign(layout.vertices, {});
    normals_.assign(layout.find("normal") != nullptr ? layout.vertices : 0, {});
    values_.assign(layout.find(value_name_) != nullptr ? layout.vertices : 0, 0);
    indices_.assign(layout.elements * 3, 0);
}

void MeshMessage::add_vertices(const VertexBatch& batch) {
    const VertexAttribute* const normal = layout_.find("normal");
    const VertexAttribute* const value = layout_.find(value_name_);
    for (std::size_t i = 0; i < batch.positions.size(); ++i) {
        Position& out = positions_[batch.first + i];
        for (std::size_t axis = 0; axis < 3; ++axis) {
            out[axis] = step_[axis] > 0
                            ? rounded((batch.positions[i][axis] - origin_[axis]) / step_[axis])
                            : std::uint16_t{0};
        }
        if (normal != nullptr) {
            for (int axis = 0; axis < 3; ++axis) {
                normals_[batch.first + i][static_cast<std::size_t>(axis)] =
                    rounded_normal(batch.number(i, *normal, axis));
            }
        }
        if (value != nullptr) {
            values_[batch.first + i] = static_cast<float>(batch.number(i, *value));
        }
    }
}

void MeshMessage::add_elements(const ElementBatch& batch) {
    for (std::size_t i = 0; i < batch.corners.size(); ++i) {
        for (std::size_t k = 0; k < 3; ++k) {
            indices_[3 * (batch.first + i) + k] = static_cast<std::uint32_t>(batch.corners[i][k]);
        }
    }
}

double MeshMessage::position_rounding() const {
    return hypot3(step_[0], step_[1], step_[2]) / 2;
}

double MeshMessage::rounding_of(const std::array<double, 3>& extent) {
    return hypot3(extent[0], extent[1], extent[2]) / kSteps / 2;
}

void MeshMessage::round_values(Json& header) {
    if (layout_.find(value_name_) == nullptr) {
        return;
    }
    double low = std::numeric_limits<double>::infinity();
    double high = -low;
    for (const float value : values_) {
        if (std::isfinite(value)) {
            low = std::min<double>(low, value);
            high = std::max<double>(high, value);
        }
    }
    low = low <= high ? low : 0;
    const bool has_missing = std::any_of(values_.begin(), values_.end(),
                                         [](float value) { return !std::isfinite(value); });
    // The last step stands for a missing value.
    const double steps = has_missing ? kSteps - 1 : kSteps;
    const double step = low < high ? (high - low) / steps : 0;
    for (std::size_t i = 0; i < values_.size(); ++i) {
        const bool is_missing = !std::isfinite(values_[i]);
        positions_[i][3] = is_missing ? kMissing
                           : step > 0 ? rounded((values_[i] - low) / step)
                                      : std::uint16_t{0};
    }
    if (has_missing) {
        header["value_missing"] = kMissing;
    }
    header["value_origin"] = low;
    header["value_step"] = step;
    header["value_rounding"] = step / 2;
    values_ = {};
}

void MeshMessage::make_normals() {
    std::vector<std::array<float, 3>> sum(positions_.size());
    const auto side = [&](std::uint32_t from, std::uint32_t to) {
        Double3 d{};
        for (std::size_t axis = 0; axis < 3; ++axis) {
            d[axis] = step_[axis] * (int{positions_[to][axis]} - int{positions_[from][axis]});
        }
        return d;
    };
    for (std::size_t i = 0; i < indices_.size(); i += 3) {
        const Double3 normal =
            cross(side(indices_[i], indices_[i + 1]), side(indices_[i], indices_[i + 2]));
        for (std::size_t k = 0; k < 3; ++k) {
            for (std::size_t axis = 0; axis < 3; ++axis) {
                sum[indices_[i + k]][axis] += static_cast<float>(normal[axis]);
            }
        }
    }
    normals_.assign(positions_.size(), {});
    for (std::size_t v = 0; v < sum.size(); ++v) {
        const double length = hypot3(sum[v][0], sum[v][1], sum[v][2]);
        const Double3 unit =
            length > 0 ? Double3{sum[v][0] / length, sum[v][1] / length, sum[v][2] / length}
                       : Double3{0, 0, 1};
        for (std::size_t axis = 0; axis < 3; ++axis) {
            normals_[v][axis] = rounded_normal(unit[axis]);
        }
    }
}

std::string MeshMessage::finish(Json header) {
    header["vertices"] = positions_.size();
    header["triangles"] = triangles();
    header["position_rounding"] = position_rounding();
    header["origin"] = origin_;
    header["step"] = step_;
    round_values(header);
    const std::size_t vertices = positions_.size();
    Sections sections;
    sections.add_vertices("positions", positions_);
    if (layout_.find("normal") != nullptr || !normals_.empty()) {
        sections.add_vertices("normals", normals_);
    }
    sections.add_indices(indices_, vertices);
    header["sections"] = sections.described();
    std::string text = header.dump(-1, ' ', false, Json::error_handler_t::replace);
    text.resize((text.size() + kAlignment - 1) / kAlignment * kAlignment, ' ');
    std::size_t size = kAlignment + text.size();
    for (const std::string& bytes : sections.bytes()) {
        size += (bytes.size() + kAlignment - 1) / kAlignment * kAlignment;
    }
    std::string message;
    message.reserve(size);
    message = "ISOV";
    append_number(message, kVersion);
    append_number(message, static_cast<std::uint32_t>(text.size()));
    append_number(message, 0);
    message += text;
    for (const std::string& bytes : sections.bytes()) {
        message += bytes;
        message.resize((message.size() + kAlignment - 1) / kAlignment * kAlignment, '\0');
    }
    return message;
}

}  // namespace isonest::detail::view
