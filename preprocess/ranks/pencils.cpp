#include "preprocess/ranks/pencils.h"

#include <algorithm>
#include <bit>
#include <cstddef>
#include <limits>

#include "preprocess/levels/base_block.h"
#include "preprocess/levels/coarse_block.h"
#include "preprocess/levels/pass_context.h"

namespace isonest::detail {
namespace {

/// Pencils of the base pass that one of another pass covers along each axis, as a power of two.
int below(int pass) {
    return pass - kBasePass;
}

/// Nodes of a block along one axis and in its margin: what it costs to read and to compute.
std::uint64_t weight_along(std::int64_t block, std::int64_t nodes, std::int64_t chunk) {
    return static_cast<std::uint64_t>(
        std::clamp<std::int64_t>(nodes - 2 * chunk * block, 1, 2 * chunk) + kMargin);
}

}  // namespace

Pencils::Pencils(const StoreLayout& layout, int ranks)
    : layout_(&layout), base_(base_grid(layout)) {
    // The first pencil below one of a coarser level may lie outside of the base pass.
    Int3 all = base_;
    for (int level = kBasePass + 1; level <= layout.lattice().top(); ++level) {
        all = max(all,
                  (coarse_grid(layout, level) - Int3{1, 1, 1}) * (std::int64_t{1} << below(level)) +
                      Int3{1, 1, 1});
    }
    const auto bits_of = [](std::int64_t n) {
        return static_cast<int>(std::bit_width(static_cast<std::uint64_t>(n - 1)));
    };
    longer_is_y_ = all.y >= all.z;
    bits_ = std::min(bits_of(all.y), bits_of(all.z));
    const auto rest = static_cast<std::uint64_t>((std::max(all.y, all.z) - 1) >> bits_);
    const std::uint64_t end = (rest + 1) << (2 * bits_);

    const Int3 nodes = layout.lattice().nodes();
    const std::int64_t chunk = layout.header().chunk;
    const auto weight_of = [&](const Pencil& p) {
        return p.y < base_.y && p.z < base_.z
                   ? weight_along(p.y, nodes.y, chunk) * weight_along(p.z, nodes.z, chunk)
                   : 0;
    };
    std::uint64_t total = 0;
    for (std::int64_t y = 0; y < base_.y; ++y) {
        total += weight_along(y, nodes.y, chunk);
    }
    std::uint64_t along_z = 0;
    for (std::int64_t z = 0; z < base_.z; ++z) {
        along_z += weight_along(z, nodes.z, chunk);
    }
    total *= along_z;
    // A rank begins at the pencil whose middle is the first behind its share of the whole.
    first_.reserve(static_cast<std::size_t>(ranks) + 1);
    first_.push_back(0);
    const auto share_of = [&](std::size_t rank) {
        return static_cast<double>(total) * static_cast<double>(rank) / static_cast<double>(ranks);
    };
    std::uint64_t before = 0;
    for (std::uint64_t code = 0; code < end; ++code) {
        const std::uint64_t weight = weight_of(pencil_at(code));
        const double middle = static_cast<double>(before) + static_cast<double>(weight) / 2;
        while (weight > 0 && first_.size() < static_cast<std::size_t>(ranks) &&
               middle > share_of(first_.size())) {
            first_.push_back(code);
        }
        before += weight;
    }
    first_.resize(static_cast<std::size_t>(ranks), end);
    first_.push_back(end);
}

Int3 Pencils::grid(int pass) const {
    return pass == kBasePass ? base_ : coarse_grid(*layout_, pass);
}

std::uint64_t Pencils::code_of(const Pencil& pencil) const {
    const auto y = static_cast<std::uint64_t>(pencil.y);
    const auto z = static_cast<std::uint64_t>(pencil.z);
    std::uint64_t code = ((longer_is_y_ ? y : z) >> bits_) << (2 * bits_);
    for (int bit = 0; bit < bits_; ++bit) {
        code |= ((y >> bit) & 1U) << (2 * bit) | ((z >> bit) & 1U) << (2 * bit + 1);
    }
    return code;
}

Pencil Pencils::pencil_at(std::uint64_t code) const {
    std::uint64_t y = 0;
    std::uint64_t z = 0;
    for (int bit = 0; bit < bits_; ++bit) {
        y |= ((code >> (2 * bit)) & 1U) << bit;
        z |= ((code >> (2 * bit + 1)) & 1U) << bit;
    }
    (longer_is_y_ ? y : z) |= (code >> (2 * bits_)) << bits_;
    return {static_cast<std::int64_t>(y), static_cast<std::int64_t>(z)};
}

int Pencils::owner(int pass, const Pencil& pencil) const {
    const std::uint64_t code = code_of({pencil.y << below(pass), pencil.z << below(pass)});
    // Of ranks that begin at the same code, all but the last have nothing.
    return static_cast<int>(std::upper_bound(first_.begin(), first_.end() - 1, code) -
                            first_.begin()) -
           1;
}

std::vector<Pencil> Pencils::of(int rank, int pass) const {
    const Int3 grid_of_pass = grid(pass);
    const int shift = below(pass);
    const std::uint64_t step = std::uint64_t{1} << (2 * std::min(shift, bits_));
    const auto r = static_cast<std::size_t>(rank);
    std::vector<Pencil> found;
    for (std::uint64_t code = (first_[r] + step - 1) / step * step; code < first_[r + 1];
         code += step) {
        const Pencil base = pencil_at(code);
        const Pencil pencil{base.y >> shift, base.z >> shift};
        if (base == Pencil{pencil.y << shift, pencil.z << shift} && pencil.y < grid_of_pass.y &&
            pencil.z < grid_of_pass.z) {
            found.push_back(pencil);
        }
    }
    return found;
}

std::vector<PencilBox> Pencils::boxes(int rank) const {
    const std::vector<Pencil> own = of(rank, kBasePass);
    PencilBox around{std::numeric_limits<std::int64_t>::max(), 0,
                     std::numeric_limits<std::int64_t>::max(), 0};
    for (const Pencil& p : own) {
        around.y_begin = std::min(around.y_begin, p.y);
        around.y_end = std::max(around.y_end, p.y + 1);
        around.z_begin = std::min(around.z_begin, p.z);
        around.z_end = std::max(around.z_end, p.z + 1);
    }
    std::vector<PencilBox> found;
    for (std::int64_t z = around.z_begin; z < around.z_end; ++z) {
        for (std::int64_t y = around.y_begin; y < around.y_end;) {
            if (owner(kBasePass, {y, z}) != rank) {
                ++y;
                continue;
            }
            std::int64_t end = y + 1;
            while (end < around.y_end && owner(kBasePass, {end, z}) == rank) {
                ++end;
            }
            const auto same = std::find_if(found.begin(), found.end(), [&](const PencilBox& box) {
                return box.y_begin == y && box.y_end == end && box.z_end == z;
            });
            if (same != found.end()) {
                same->z_end = z + 1;
            } else {
                found.push_back({y, end, z, z + 1});
            }
            y = end;
        }
    }
    return found;
}

}  // namespace isonest::detail
