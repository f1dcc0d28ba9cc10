#include "preprocess/sources/wrapping/cropped_source.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstring>
#include <memory>
#include <utility>
#include <vector>

#include <isonest/error.h>

#include "preprocess/sources/wrapping/wrapped_source.h"
#include "store/base/vectors.h"

namespace isonest::detail {
namespace {

/// A source that several others read.
class SharedSource : public WrappedSource {
  public:
    explicit SharedSource(std::shared_ptr<VolumeSource> inner)
        : WrappedSource(*inner), shared_(std::move(inner)) {}
    [[nodiscard]] std::span<const std::byte> mapped() const override { return shared_->mapped(); }
    void read(std::int64_t z0, std::int64_t nz, std::int64_t y0, std::int64_t ny,
              std::byte* dst) override {
        shared_->read(z0, nz, y0, ny, dst);
    }

  private:
    std::shared_ptr<VolumeSource> shared_;
};

class CroppedSource : public WrappedSource {
  public:
    CroppedSource(std::unique_ptr<VolumeSource> inner, const Int3& lo, const Int3& nodes,
                  const Int3& every)
        : WrappedSource(std::move(inner)),
          given_(inner_source().describe()),
          step_(inner_source().granularity()),
          lo_(lo),
          nodes_(nodes),
          every_(every),
          value_(size_of(given_.type)) {
        // What one read of the inner source returns: whole granularity steps.
        const std::int64_t row = given_.nodes.x * static_cast<std::int64_t>(value_);
        piece_ = {sequential() ? 1 : std::min(step_.planes, given_.nodes.z),
                  std::min(step_.rows, given_.nodes.y)};
        constexpr std::int64_t kWanted = std::int64_t{1} << 20U;
        const std::int64_t more =
            kWanted / std::max<std::int64_t>(piece_.planes * row * piece_.rows, 1);
        piece_.rows = std::min(given_.nodes.y, piece_.rows * std::max<std::int64_t>(more, 1));
        piece_bytes_ = static_cast<std::size_t>(piece_.planes * piece_.rows * row);
        described_ = part();
    }
    [[nodiscard]] VolumeDescription describe() const override { return described_; }
    [[nodiscard]] std::string identity() const override {
        return identity_and(fmt::format("part from {} {} {}, every {} {} {}", lo_.x, lo_.y, lo_.z,
                                        every_.x, every_.y, every_.z));
    }
    [[nodiscard]] Granularity granularity() const override {
        if (sequential()) {
            return {1, nodes_.y};
        }
        return {std::min(nodes_.z, ceil_div(piece_.planes, every_.z)),
                std::min(nodes_.y, ceil_div(piece_.rows, every_.y))};
    }
    [[nodiscard]] std::uint64_t heap() const override {
        return inner_source().heap() + piece_bytes_;
    }

    void will_read(std::int64_t z0, std::int64_t nz, std::int64_t y0, std::int64_t ny) override {
        inner_source().will_read(lo_.z + z0 * every_.z, (nz - 1) * every_.z + 1,
                                 lo_.y + y0 * every_.y, (ny - 1) * every_.y + 1);
    }
    void read(std::int64_t z0, std::int64_t nz, std::int64_t y0, std::int64_t ny,
              std::byte* dst) override {
        buffer_.resize(piece_bytes_);
        const std::int64_t first = lo_.z + z0 * every_.z;
        const std::int64_t end = lo_.z + (z0 + nz - 1) * every_.z + 1;
        if (sequential()) {
            while (passed_ < first) {
                take_planes(passed_, 1, z0, nz, y0, ny, nullptr);
                ++passed_;
            }
        }
        const std::int64_t step = piece_.planes;
        for (std::int64_t z = sequential() ? first : first / step * step; z < end; z += step) {
            take_planes(z, std::min(step, given_.nodes.z - z), z0, nz, y0, ny, dst);
        }
        if (sequential()) {
            passed_ = end;
        }
    }

  private:
    /// The first node of the part that is at or after `at`, along one axis.
    [[nodiscard]] std::int64_t at_or_behind(std::int64_t at, int axis) const {
        return at <= lo_[axis] ? 0 : ceil_div(at - lo_[axis], every_[axis]);
    }

    /// Copies the inner planes [z, z + count) that belong to planes [z0, z0 + nz) and rows [y0, y0
    /// + ny) of the part; without `dst`, only reads all rows.
    void take_planes(std::int64_t z, std::int64_t count, std::int64_t z0, std::int64_t nz,
                     std::int64_t y0, std::int64_t ny, std::byte* dst) {
        const bool all = sequential();
        const std::int64_t from = std::max(z0, at_or_behind(z, 2));
        const std::int64_t to = std::min(z0 + nz, at_or_behind(z + count, 2));
        if (!all && from >= to) {
            return;
        }
        const std::int64_t rows = piece_.rows;
        const std::int64_t first = all ? 0 : (lo_.y + y0 * every_.y) / rows * rows;
        const std::int64_t end = all ? given_.nodes.y : lo_.y + (y0 + ny - 1) * every_.y + 1;
        for (std::int64_t y = first; y < end; y += rows) {
            const std::int64_t size = std::min(rows, given_.nodes.y - y);
            const std::int64_t row_from = std::max(y0, at_or_behind(y, 1));
            const std::int64_t row_to = std::min(y0 + ny, at_or_behind(y + size, 1));
            if (!all && row_from >= row_to) {
                continue;
            }
            inner_source().read(z, count, y, size, buffer_.data());
            for (std::int64_t pz = from; dst != nullptr && pz < to; ++pz) {
                for (std::int64_t py = row_from; py < row_to; ++py) {
                    const std::int64_t row =
                        (lo_.z + pz * every_.z - z) * size + lo_.y + py * every_.y - y;
                    take_row(
                        buffer_.data() + static_cast<std::size_t>(row * given_.nodes.x) * value_,
                        dst + static_cast<std::size_t>(((pz - z0) * ny + py - y0) * nodes_.x) *
                                  value_);
                }
            }
        }
    }

    void take_row(const std::byte* from, std::byte* to) const {
        from += static_cast<std::size_t>(lo_.x) * value_;
        if (every_.x == 1) {
            std::memcpy(to, from, static_cast<std::size_t>(nodes_.x) * value_);
            return;
        }
        const std::size_t step = static_cast<std::size_t>(every_.x) * value_;
        for (std::int64_t x = 0; x < nodes_.x; ++x, from += step, to += value_) {
            std::memcpy(to, from, value_);
        }
    }

    [[nodiscard]] VolumeDescription part() const {
        VolumeDescription result = given_;
        result.nodes = nodes_;
        Double3 shift{};
        auto uneven = std::make_shared<UnevenAxes>();
        for (int a = 0; a < 3; ++a) {
            const auto i = static_cast<std::size_t>(a);
            shift.at(i) = given_.spacing.at(i) * static_cast<double>(lo_[a]);
            result.spacing.at(i) *= static_cast<double>(every_[a]);
            if (given_.uneven && !given_.uneven->offsets.at(i).empty()) {
                const std::vector<double>& offsets = given_.uneven->offsets.at(i);
                shift.at(i) = offsets.at(static_cast<std::size_t>(lo_[a]));
                if (nodes_[a] == 1) {
                    continue;
                }
                for (std::int64_t k = 0; k < nodes_[a]; ++k) {
                    uneven->offsets.at(i).push_back(
                        offsets.at(static_cast<std::size_t>(lo_[a] + k * every_[a])) - shift.at(i));
                }
                result.spacing.at(i) =
                    uneven->offsets.at(i).back() / static_cast<double>(nodes_[a] - 1);
            }
        }
        result.uneven = *uneven == UnevenAxes() ? nullptr : std::move(uneven);
        if (given_.curved) {
            result.spacing = {1, 1, 1};
            result.curved = part_of(*given_.curved);
            return result;
        }
        shift = rotated(given_.direction, shift);
        for (std::size_t i = 0; i < 3; ++i) {
            result.origin.at(i) += shift.at(i);
        }
        result.direction =
            with_flat_axes_across(given_.direction, {nodes_.x == 1, nodes_.y == 1, nodes_.z == 1});
        return result;
    }

    [[nodiscard]] NodePositionsPtr part_of(const NodePositions& positions) const {
        auto part = std::make_shared<NodePositions>();
        for (std::size_t a = 0; a < 3; ++a) {
            part->coordinates.at(a) = std::make_shared<CroppedSource>(
                std::make_unique<SharedSource>(positions.coordinates.at(a)), lo_, nodes_, every_);
        }
        return part;
    }

    VolumeDescription given_;
    Granularity step_;
    Granularity piece_;  ///< planes and rows of one read
    Int3 lo_;
    Int3 nodes_;
    Int3 every_;
    std::size_t value_;
    std::size_t piece_bytes_ = 0;
    VolumeDescription described_;
    std::vector<std::byte> buffer_;
    std::int64_t passed_ = 0;  ///< for a stream: planes that were read
};

}  // namespace

std::unique_ptr<VolumeSource> cropped(std::unique_ptr<VolumeSource> inner,
                                      const std::array<NodeRange, 3>& crop, const Int3& every) {
    const VolumeDescription given = inner->describe();
    Int3 lo{0, 0, 0};
    Int3 size = given.nodes;
    for (int a = 0; a < 3; ++a) {
        const std::int64_t n = given.nodes[a];
        const NodeRange& range = crop.at(static_cast<std::size_t>(a));
        const auto place = [n](std::int64_t at) { return at < 0 ? at + n : at; };
        const std::int64_t from = place(range.from.value_or(0));
        const std::int64_t to = range.to ? place(*range.to) : n;
        if (from < 0 || to > n || from >= to) {
            throw Error(
                ErrorKind::invalid_argument, {given.name},
                fmt::format("the axis {} has nodes 0 to {}; a crop from {} to {} is not possible",
                            "xyz"[a], n - 1, from, to - 1),
                {{RemedyKind::correct_numbers, "crop"}});
        }
        if (every[a] < 1) {
            throw Error(ErrorKind::invalid_argument, {given.name},
                        fmt::format("the step of a crop must be at least 1, not {}", every[a]));
        }
        lo[a] = from;
        size[a] = ceil_div(to - from, every[a]);
    }
    if (size == given.nodes) {
        return inner;
    }
    return std::make_unique<CroppedSource>(std::move(inner), lo, size, every);
}

namespace {

/// Reverses the order of `count` pieces of `size` bytes.
void reverse_pieces(std::byte* bytes, std::int64_t count, std::int64_t size) {
    for (std::int64_t i = 0; i < count / 2; ++i) {
        std::swap_ranges(bytes + i * size, bytes + (i + 1) * size, bytes + (count - 1 - i) * size);
    }
}

class MirroredSource : public WrappedSource {
  public:
    MirroredSource(std::unique_ptr<VolumeSource> inner, const std::array<bool, 3>& backward)
        : WrappedSource(std::move(inner)),
          nodes_(inner_source().describe().nodes),
          value_(static_cast<std::int64_t>(size_of(inner_source().describe().type))),
          backward_(backward) {
        if (backward_[2] && inner_source().sequential() && nodes_.z > 1) {
            throw Error(ErrorKind::unsupported, {inner_source().describe().name},
                        "the z axis runs backward, so a compressed stream cannot be read in order; "
                        "store the file without compression (encoding: raw)");
        }
    }
    [[nodiscard]] std::string identity() const override {
        return identity_and(
            fmt::format("backward {} {} {}", backward_[0], backward_[1], backward_[2]));
    }
    [[nodiscard]] Granularity granularity() const override {
        // In a stream with reversed rows, the first rows may be needed last, so whole planes are
        // read.
        return sequential() && backward_[1] ? Granularity{1, nodes_.y}
                                            : inner_source().granularity();
    }

    void will_read(std::int64_t z0, std::int64_t nz, std::int64_t y0, std::int64_t ny) override {
        inner_source().will_read(backward_[2] ? nodes_.z - z0 - nz : z0, nz,
                                 backward_[1] ? nodes_.y - y0 - ny : y0, ny);
    }
    void read(std::int64_t z0, std::int64_t nz, std::int64_t y0, std::int64_t ny,
              std::byte* dst) override {
        const Int3& n = nodes_;
        inner_source().read(backward_[2] ? n.z - z0 - nz : z0, nz,
                            backward_[1] ? n.y - y0 - ny : y0, ny, dst);
        const std::int64_t row = n.x * value_;
        for (std::int64_t i = 0; i < nz * ny && backward_[0]; ++i) {
            reverse_pieces(dst + i * row, n.x, value_);
        }
        for (std::int64_t i = 0; i < nz && backward_[1]; ++i) {
            reverse_pieces(dst + i * ny * row, ny, row);
        }
        if (backward_[2]) {
            reverse_pieces(dst, nz, ny * row);
        }
    }

  private:
    Int3 nodes_;
    std::int64_t value_;  ///< bytes
    std::array<bool, 3> backward_;
};

}  // namespace

std::unique_ptr<VolumeSource> mirrored(std::unique_ptr<VolumeSource> inner,
                                       const std::array<bool, 3>& backward) {
    return backward[0] || backward[1] || backward[2]
               ? std::make_unique<MirroredSource>(std::move(inner), backward)
               : std::move(inner);
}

}  // namespace isonest::detail
