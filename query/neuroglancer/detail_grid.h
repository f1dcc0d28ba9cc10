// The cells into which Neuroglancer's meshes are cut at a level of detail: where they are, and the
// order in which they are stored.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>

#include <isonest/int3.h>

namespace isonest::detail {

/// The bits of the three numbers in turn, x lowest: the place on the Z-curve. REQUIRES: below 2^21.
inline std::uint64_t z_order(const Int3& cell) {
    std::uint64_t code = 0;
    for (unsigned bit = 0; bit < 21; ++bit) {
        for (int axis = 0; axis < 3; ++axis) {
            const auto set = static_cast<std::uint64_t>(cell[axis]) >> bit & 1U;
            code |= set << (3 * bit + static_cast<unsigned>(axis));
        }
    }
    return code;
}

/// Numbers for the cells of a grid, in the order of the Z-curve: its codes without those bits that
/// no cell has, so that there are at most eight times as many numbers as cells.
class ZOrderedCells {
  public:
    /// Lists of all cells of a grid with more bits would be large, even in a file.
    static constexpr int kMostBits = 24;

    ZOrderedCells() = default;
    /// `cells`: along each axis, at least 1.
    explicit ZOrderedCells(const Int3& cells) {
        for (int axis = 0; axis < 3; ++axis) {
            bits_[static_cast<std::size_t>(axis)] =
                static_cast<int>(std::bit_width(static_cast<std::uint64_t>(cells[axis] - 1)));
        }
    }
    /// How many bits a number has.
    [[nodiscard]] int bits() const { return bits_[0] + bits_[1] + bits_[2]; }

    [[nodiscard]] std::uint64_t number_of(const Int3& cell) const {
        std::uint64_t number = 0;
        each_bit([&](int axis, int bit, int place) {
            number |= (static_cast<std::uint64_t>(cell[axis]) >> bit & 1U) << place;
        });
        return number;
    }
    [[nodiscard]] Int3 cell_of(std::uint64_t number) const {
        Int3 cell;
        each_bit([&](int axis, int bit, int place) {
            cell[axis] |= static_cast<std::int64_t>((number >> place & 1U) << bit);
        });
        return cell;
    }

  private:
    template <class Visit>
    void each_bit(const Visit& visit) const {
        int place = 0;
        for (int bit = 0; place < bits(); ++bit) {
            for (int axis = 0; axis < 3; ++axis) {
                if (bit < bits_[static_cast<std::size_t>(axis)]) {
                    visit(axis, bit, place++);
                }
            }
        }
    }
    std::array<int, 3> bits_{};
};

/// Where positions of a mesh lie in its cells at a level of detail. Coordinates are in *strips*:
/// from one plane at which triangles are cut to the next. At level 0 a cell is a strip wide; above
/// it is two, since it is drawn in eight parts, which are cells of the level below.
struct DetailGrid {
    Double3 origin{};        ///< of the volume, world units, in its own axes
    Double3 spacing{};       ///< of its nodes
    Int3 first{};            ///< the node at which cell 0 0 0 begins
    std::int64_t chunk = 1;  ///< nodes along a cell's edge at level 0; a power of two
    int level = 0;

    [[nodiscard]] int strips() const { return level == 0 ? 1 : 2; }
    /// Nodes along a cell's edge.
    [[nodiscard]] std::int64_t nodes() const { return chunk << level; }
    /// Monotone in each coordinate. `position`: world units, in the volume's own axes; not before
    /// the first cell, but for rounding.
    [[nodiscard]] Double3 strips_of(const std::array<float, 3>& position) const {
        const auto width = static_cast<double>(nodes()) / strips();
        Double3 c{};
        for (std::size_t axis = 0; axis < 3; ++axis) {
            const double node =
                (static_cast<double>(position[axis]) - origin[axis]) / spacing[axis];
            const auto from = static_cast<double>(first[static_cast<int>(axis)]);
            c[axis] = std::max((node - from) / width, 0.0);
        }
        return c;
    }
};

/// The largest number that a coordinate within a cell is rounded to: 16 bits.
inline constexpr std::int32_t kMostInCell = 65535;
inline constexpr int kBitsInCell = 16;

}  // namespace isonest::detail
