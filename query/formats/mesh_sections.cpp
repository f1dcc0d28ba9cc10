#include "query/formats/mesh_sections.h"

#include <algorithm>
#include <cstring>

namespace isonest::detail {
namespace {

template <class T>
std::byte* put(const T& number, std::byte* out) {
    std::memcpy(out, &number, sizeof(number));
    return out + sizeof(number);
}

std::array<float, 3> scaled(std::array<float, 3> position, double scale) {
    for (float& component : position) {
        component = static_cast<float>(static_cast<double>(component) * scale);
    }
    return position;
}

/// Both of a vertex, or one of several attributes.
void fill(const VertexSection& section, const VertexBatch& batch, std::byte* out) {
    const std::byte* attributes = batch.attributes.data() + section.first;
    for (const auto& position : batch.positions) {
        if (section.position) {
            out = put(section.scale == 1 ? position : scaled(position, section.scale), out);
        }
        out = std::copy_n(attributes, section.bytes, out);
        attributes += batch.row_bytes;
    }
}

}  // namespace

VertexSection position_section(std::uint64_t offset, double scale) {
    return {offset, true, 0, 0, scale};
}

VertexSection attribute_section(std::uint64_t offset, const VertexAttribute& attribute) {
    return {offset, false, attribute.offset, attribute.bytes()};
}

ElementSection connectivity_section(std::uint64_t offset, std::size_t corners) {
    return {offset, corners * sizeof(std::int64_t),
            [corners](const ElementBatch& batch, std::byte* out) {
                for (const auto& element : batch.corners) {
                    for (std::size_t i = 0; i < corners; ++i) {
                        out = put(element[i], out);
                    }
                }
            }};
}

ElementSection ends_section(std::uint64_t offset, std::size_t corners) {
    return {offset, sizeof(std::int64_t), [corners](const ElementBatch& batch, std::byte* out) {
                std::uint64_t end = corners * batch.first;
                for (std::size_t i = 0; i < batch.corners.size(); ++i) {
                    out = put(end += corners, out);
                }
            }};
}

ElementSection common_section(std::uint64_t offset, const VertexAttribute& attribute) {
    return {offset, attribute.bytes(), [attribute](const ElementBatch& batch, std::byte* out) {
                const std::byte* const rows = batch.nearby.attributes.data() + attribute.offset;
                for (const auto& element : batch.nearby_corners) {
                    out = std::copy_n(rows + element[0] * batch.nearby.row_bytes, attribute.bytes(),
                                      out);
                }
            }};
}

ElementSection sides_section(std::uint64_t offset) {
    return {offset, 2 * sizeof(std::int64_t), [](const ElementBatch& batch, std::byte* out) {
                for (const auto& sides : batch.sides) {
                    out = put(sides, out);
                }
            }};
}

ElementSection sided_indices32_section(std::uint64_t offset) {
    return {offset, 1 + 5 * sizeof(std::uint32_t), [](const ElementBatch& batch, std::byte* out) {
                for (std::size_t i = 0; i < batch.corners.size(); ++i) {
                    *out++ = std::byte{3};
                    for (const std::uint64_t corner : batch.corners[i]) {
                        out = put(static_cast<std::uint32_t>(corner), out);
                    }
                    for (const std::int64_t label : batch.sides[i]) {
                        out = put(static_cast<std::int32_t>(label), out);
                    }
                }
            }};
}

ElementSection indices32_section(std::uint64_t offset, std::optional<std::byte> prefix) {
    return {offset, (prefix ? 1 : 0) + 3 * sizeof(std::uint32_t),
            [prefix](const ElementBatch& batch, std::byte* out) {
                for (const auto& element : batch.corners) {
                    if (prefix) {
                        *out++ = *prefix;
                    }
                    for (const std::uint64_t corner : element) {
                        out = put(static_cast<std::uint32_t>(corner), out);
                    }
                }
            }};
}

void SectionedFile::Sections::shift(std::uint64_t by) {
    for (VertexSection& section : vertices) {
        section.offset += by;
    }
    for (ElementSection& section : elements) {
        section.offset += by;
    }
}

void SectionedFile::add_vertices(const VertexBatch& batch) {
    for (const VertexSection& section : sections_.vertices) {
        const std::uint64_t at = section.offset + batch.first * section.stride();
        if (section.bytes == 0 && section.scale == 1) {
            file().write_at(at, std::as_bytes(batch.positions));
        } else if (!section.position && section.bytes == batch.row_bytes) {
            file().write_at(at, batch.attributes);
        } else {
            const std::size_t bytes = batch.positions.size() * section.stride();
            const auto rows = std::make_unique_for_overwrite<std::byte[]>(bytes);
            fill(section, batch, rows.get());
            file().write_at(at, {rows.get(), bytes});
        }
    }
}

void SectionedFile::add_elements(const ElementBatch& batch) {
    for (const ElementSection& section : sections_.elements) {
        const std::size_t bytes = batch.corners.size() * section.stride;
        const auto rows = std::make_unique_for_overwrite<std::byte[]>(bytes);
        section.fill(batch, rows.get());
        file().write_at(section.offset + batch.first * section.stride, {rows.get(), bytes});
    }
}

}  // namespace isonest::detail
