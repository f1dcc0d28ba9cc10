#include "preprocess/sources/numbers/raw_rows.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstring>
#include <vector>

#include <isonest/error.h>

#include "preprocess/sources/bytes/input_file.h"
#include "store/lattice/lattice.h"

namespace isonest::detail {

void swap_bytes(std::byte* data, std::uint64_t bytes, std::size_t size) {
    for (std::uint64_t i = 0; i + size <= bytes; i += size) {
        std::reverse(data + i, data + i + size);
    }
}

std::uint64_t volume_bytes(const RawLayout& layout) {
    return static_cast<std::uint64_t>(layout.nodes.product()) * size_of(layout.type);
}

std::uint64_t data_bytes(const RawLayout& layout) {
    const std::uint64_t dense =
        layout.whole > 0 ? layout.whole * size_of(layout.type) : volume_bytes(layout);
    if (!layout.strides) {
        return dense;
    }
    // There may be gaps, for example between the records of a NetCDF variable.
    constexpr double kMax = 0x1p62;
    const std::uint64_t step = layout.strides_in_bytes ? 1 : size_of(layout.type);
    std::uint64_t last = layout.first * step;
    double rough = static_cast<double>(layout.first) * static_cast<double>(step);
    for (int a = 0; a < 3; ++a) {
        const auto steps = static_cast<std::uint64_t>(layout.nodes[a] - 1);
        const auto stride = static_cast<std::uint64_t>((*layout.strides)[a]) * step;
        last += steps * stride;
        rough += static_cast<double>(steps) * static_cast<double>((*layout.strides)[a]) *
                 static_cast<double>(step);
    }
    return rough > kMax ? ~std::uint64_t{0} : std::max(dense, last + size_of(layout.type));
}

std::string text_of_nodes(const RawLayout& layout) {
    std::string text = fmt::format("{} x {} x {} nodes of {}", layout.nodes.x, layout.nodes.y,
                                   layout.nodes.z, name_of(layout.type));
    return layout.whole > 0 ? fmt::format("{} values ({} are used)", layout.whole, text) : text;
}

void check_nodes(const std::string& name, const RawLayout& layout) {
    for (int axis = 0; axis < 3; ++axis) {
        if (layout.nodes[axis] < 1 || layout.nodes[axis] > kMaxNodesPerAxis) {
            throw Error(
                ErrorKind::unsupported, {name},
                fmt::format("{} x {} x {} nodes: each axis must have 1 to {}", layout.nodes.x,
                            layout.nodes.y, layout.nodes.z, kMaxNodesPerAxis));
        }
    }
}
bool is_nested(const RawLayout& layout) {
    const Int3 n = layout.nodes;
    const Int3 s = layout.strides.value_or(Int3{1, n.x, n.x * n.y});
    const std::int64_t row = (n.x - 1) * s.x + 1;
    return (n.y == 1 || s.y >= row) && (n.z == 1 || s.z >= (n.y - 1) * s.y + row);
}

std::string identity_of_layout(const RawLayout& layout) {
    std::string text = fmt::format("offset {}\nbig endian {}\n", layout.offset, layout.big_endian);
    if (layout.strides) {
        text += fmt::format("strides {} {} {}\n", layout.strides->x, layout.strides->y,
                            layout.strides->z);
    }
    return layout.first > 0 ? fmt::format("{}first value {}\n", text, layout.first) : text;
}

std::vector<InputFile> inputs_of(const InputFile& file, const RawLayout& layout) {
    std::vector<InputFile> inputs{file};
    if (!layout.header.empty()) {
        inputs.push_back(layout.header);
    }
    inputs.insert(inputs.end(), layout.others.begin(), layout.others.end());
    return inputs;
}

std::string identity_of_raw(const InputFile& file, const RawLayout& layout) {
    const std::string inputs = identity_of_inputs(inputs_of(file, layout));
    return inputs.empty() ? inputs : inputs + identity_of_layout(layout);
}

std::string RawBase::identity() const {
    return identity_of_raw(file_, layout_);
}

void RawBase::read(std::int64_t z0, std::int64_t nz, std::int64_t y0, std::int64_t ny,
                   std::byte* dst) {
    before_rows({z0, nz, y0, ny});
    const std::size_t value = size_of(layout_.type);
    const std::uint64_t row = static_cast<std::uint64_t>(layout_.nodes.x) * value;
    if (layout_.strides) {
        read_rows(z0, nz, y0, ny, dst);
    } else {
        const auto rows = static_cast<std::uint64_t>(ny);
        const bool whole = ny == layout_.nodes.y;
        const std::int64_t pieces = whole ? 1 : nz;
        const std::uint64_t bytes = row * rows * (whole ? static_cast<std::uint64_t>(nz) : 1);
        for (std::int64_t p = 0; p < pieces; ++p) {
            const auto at =
                static_cast<std::uint64_t>((z0 + p) * layout_.nodes.y + y0) * row + start();
            read_bytes(at, dst + static_cast<std::uint64_t>(p) * bytes, bytes);
        }
    }
    if (layout_.big_endian && value > 1) {
        swap_bytes(dst, static_cast<std::uint64_t>(nz * ny) * row, value);
    }
    if (z0 + nz == layout_.nodes.z && y0 + ny == layout_.nodes.y) {
        after_last();
    }
}

void RawBase::read_rows(std::int64_t z0, std::int64_t nz, std::int64_t y0, std::int64_t ny,
                        std::byte* dst) {
    const std::size_t value = size_of(layout_.type);
    const Int3 strides = *layout_.strides;
    const auto step = static_cast<std::size_t>(strides.x) * value;
    std::vector<std::byte> buffer(static_cast<std::size_t>(layout_.nodes.x - 1) * step + value);
    for (std::int64_t i = 0; i < nz * ny; ++i) {
        const std::int64_t z = z0 + i / ny;
        const std::int64_t y = y0 + i % ny;
        read_bytes(start() + static_cast<std::uint64_t>(z * strides.z + y * strides.y) * value,
                   buffer.data(), buffer.size());
        for (std::size_t x = 0; x < static_cast<std::size_t>(layout_.nodes.x); ++x) {
            std::memcpy(dst, buffer.data() + x * step, value);
            dst += value;
        }
    }
}

}  // namespace isonest::detail
