// Draco: https://google.github.io/draco. What Neuroglancer expects of a fragment:
// https://github.com/google/neuroglancer/blob/master/src/datasource/precomputed/meshes.md
#include "query/neuroglancer/encode_fragment.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>

#include <isonest/error.h>

#if ISONEST_WITH_DRACO
#include <draco/compression/encode.h>
#include <draco/mesh/mesh.h>
#endif

namespace isonest::detail {

std::uint32_t eighths_of(std::span<const CellTriangle> triangles) {
    // Neuroglancer's middle plane.
    constexpr std::uint16_t kMiddle = kMaxInCell / 2 + 1;
    constexpr std::array<std::uint32_t, 3> kBelow{0x55, 0x33, 0x0F};
    std::uint32_t eighths = 0;
    for (const CellTriangle& triangle : triangles) {
        std::uint32_t possible = 0xFF;
        for (const CellPoint& point : triangle.corners) {
            for (std::size_t axis = 0; axis < 3; ++axis) {
                possible &= point[axis] < kMiddle   ? kBelow[axis]
                            : point[axis] > kMiddle ? ~kBelow[axis]
                                                    : 0xFFU;
            }
        }
        eighths |= possible & (~possible + 1);
    }
    return eighths;
}

#if ISONEST_WITH_DRACO

namespace {

/// A sort key.
std::uint64_t key_of(const CellPoint& p) {
    return std::uint64_t{p[2]} << 32U | std::uint64_t{p[1]} << 16U | p[0];
}

/// Distinct positions, ascending.
std::vector<std::uint64_t> places_of(std::span<const CellTriangle> triangles) {
    std::vector<std::uint64_t> keys;
    keys.reserve(3 * triangles.size());
    for (const CellTriangle& triangle : triangles) {
        for (const CellPoint& point : triangle.corners) {
            keys.push_back(key_of(point));
        }
    }
    std::sort(keys.begin(), keys.end());
    keys.erase(std::unique(keys.begin(), keys.end()), keys.end());
    return keys;
}

void fill(draco::Mesh& mesh, std::span<const CellTriangle> triangles) {
    const std::vector<std::uint64_t> places = places_of(triangles);
    mesh.set_num_points(static_cast<std::uint32_t>(places.size()));
    draco::GeometryAttribute kind;
    constexpr std::int64_t kStride = 3 * sizeof(std::int32_t);
    kind.Init(draco::GeometryAttribute::POSITION, nullptr, 3, draco::DT_INT32, false, kStride, 0);
    const int id = mesh.AddAttribute(kind, true, static_cast<std::uint32_t>(places.size()));
    for (std::uint32_t i = 0; i < places.size(); ++i) {
        const auto at = [&](unsigned shift) {
            return static_cast<std::int32_t>(places[i] >> shift & 0xFFFFU);
        };
        const std::array<std::int32_t, 3> position{at(0), at(16), at(32)};
        mesh.attribute(id)->SetAttributeValue(draco::AttributeValueIndex(i), position.data());
    }
    mesh.SetNumFaces(triangles.size());
    for (std::uint32_t i = 0; i < triangles.size(); ++i) {
        draco::Mesh::Face face;
        for (std::size_t k = 0; k < 3; ++k) {
            const auto found =
                std::lower_bound(places.begin(), places.end(), key_of(triangles[i].corners[k]));
            face[k] = static_cast<std::uint32_t>(found - places.begin());
        }
        mesh.SetFace(draco::FaceIndex(i), face);
    }
}

/// Empty if encoding fails.
std::vector<std::byte> packed(const draco::Mesh& mesh, draco::MeshEncoderMethod method) {
    // 5 % larger than the smallest size, in half the time.
    constexpr int kSpeed = 3;
    draco::Encoder encoder;
    encoder.SetEncodingMethod(method);
    encoder.SetSpeedOptions(kSpeed, kSpeed);
    draco::EncoderBuffer buffer;
    if (!encoder.EncodeMeshToBuffer(mesh, &buffer).ok()) {
        return {};
    }
    const auto bytes = std::as_bytes(std::span(buffer.data(), buffer.size()));
    return {bytes.begin(), bytes.end()};
}

}  // namespace

bool has_draco() {
    return true;
}

std::vector<std::byte> encode_fragment(std::span<const CellTriangle> triangles) {
    if (triangles.size() > kMaxInFragment) {
        throw Error(ErrorKind::limit,
                    fmt::format("{} triangles in one cell are too many", triangles.size()));
    }
    draco::Mesh mesh;
    fill(mesh, triangles);
    std::vector<std::byte> bytes = packed(mesh, draco::MESH_EDGEBREAKER_ENCODING);
    if (bytes.empty()) {
        bytes = packed(mesh, draco::MESH_SEQUENTIAL_ENCODING);
    }
    if (bytes.empty()) {
        throw Error(ErrorKind::unsupported, "Draco cannot encode the mesh of a cell");
    }
    return bytes;
}

#else

bool has_draco() {
    return false;
}

std::vector<std::byte> encode_fragment(std::span<const CellTriangle> /*triangles*/) {
    throw Error(ErrorKind::unsupported, "this build has no Draco");
}

#endif

}  // namespace isonest::detail
