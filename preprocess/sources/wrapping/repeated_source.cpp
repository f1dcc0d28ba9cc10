#include "preprocess/sources/wrapping/repeated_source.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstring>
#include <utility>
#include <vector>

#include <isonest/error.h>
#include <isonest/open_volume.h>

#include "preprocess/sources/wrapping/wrapped_source.h"
#include "store/container/format.h"
#include "store/lattice/lattice.h"

namespace isonest::detail {
namespace {

constexpr std::array kAxes{'x', 'y', 'z'};

class RepeatedSource : public WrappedSource {
  public:
    RepeatedSource(std::unique_ptr<VolumeSource> inner, const Int3& nodes)
        : WrappedSource(std::move(inner)),
          given_(inner_source().describe()),
          nodes_(nodes),
          value_(size_of(given_.type)) {
        // What one read of the inner source returns: whole granularity steps.
        const Granularity step = inner_source().granularity();
        const std::int64_t row = given_.nodes.x * static_cast<std::int64_t>(value_);
        piece_ = {std::min(step.planes, given_.nodes.z), std::min(step.rows, given_.nodes.y)};
        constexpr std::int64_t kWanted = std::int64_t{1} << 20U;
        const std::int64_t more =
            kWanted / std::max<std::int64_t>(piece_.planes * row * piece_.rows, 1);
        piece_.rows = sequential()
                          ? given_.nodes.y
                          : std::min(given_.nodes.y, piece_.rows * std::max<std::int64_t>(more, 1));
        piece_bytes_ = static_cast<std::size_t>(piece_.planes * piece_.rows * row);
    }
    [[nodiscard]] VolumeDescription describe() const override {
        VolumeDescription result = given_;
        result.nodes = nodes_;
        return result;
    }
    [[nodiscard]] std::string identity() const override {
        return identity_and(
            fmt::format("repeated to {} {} {} nodes", nodes_.x, nodes_.y, nodes_.z));
    }
    [[nodiscard]] Granularity granularity() const override {
        // Whole periods of rows, so that no piece is read twice.
        return {piece_.planes, sequential() || nodes_.y > given_.nodes.y ? nodes_.y : piece_.rows};
    }
    [[nodiscard]] std::uint64_t heap() const override {
        return inner_source().heap() + piece_bytes_;
    }
    void will_read(std::int64_t z0, std::int64_t nz, std::int64_t y0, std::int64_t ny) override {
        if (z0 + nz <= given_.nodes.z) {
            const bool all = y0 + ny > given_.nodes.y;
            inner_source().will_read(z0, nz, all ? 0 : y0, all ? given_.nodes.y : ny);
        }
    }
    void read(std::int64_t z0, std::int64_t nz, std::int64_t y0, std::int64_t ny,
              std::byte* dst) override {
        buffer_.resize(piece_bytes_);
        const Range planes{z0, z0 + nz, given_.nodes.z};
        const Range rows{y0, y0 + ny, given_.nodes.y};
        planes.each_piece(piece_.planes, [&](std::int64_t z, std::int64_t count) {
            rows.each_piece(piece_.rows, [&](std::int64_t y, std::int64_t size) {
                inner_source().read(z, count, y, size, buffer_.data());
                planes.each_in(z, count, [&](std::int64_t pz) {
                    rows.each_in(y, size, [&](std::int64_t py) {
                        const std::int64_t from =
                            (pz % given_.nodes.z - z) * size + py % given_.nodes.y - y;
                        const std::int64_t to = (pz - z0) * ny + py - y0;
                        put_row(buffer_.data() + bytes_of(from * given_.nodes.x),
                                dst + bytes_of(to * nodes_.x));
                    });
                });
            });
        });
    }

  private:
    /// Nodes [first, end) of an axis that repeats after `period` nodes.
    struct Range {
        std::int64_t first;
        std::int64_t end;
        std::int64_t period;

        /// Calls visit(from, count) for the pieces of a period, each of `step` nodes, that have
        /// some of the nodes.
        template <class Visit>
        void each_piece(std::int64_t step, const Visit& visit) const {
            for (std::int64_t at = 0; at < period; at += step) {
                const std::int64_t count = std::min(step, period - at);
                bool is_needed = false;
                each_in(at, count, [&](std::int64_t) { is_needed = true; });
                if (is_needed) {
                    visit(at, count);
                }
            }
        }
        /// Calls visit(node) for the nodes that are `at` to `at` + `count` within their period.
        template <class Visit>
        void each_in(std::int64_t at, std::int64_t count, const Visit& visit) const {
            for (std::int64_t start = first / period * period; start < end; start += period) {
                const std::int64_t to = std::min(end, start + at + count);
                for (std::int64_t n = std::max(first, start + at); n < to; ++n) {
                    visit(n);
                }
            }
        }
    };
    [[nodiscard]] std::size_t bytes_of(std::int64_t nodes) const {
        return static_cast<std::size_t>(nodes) * value_;
    }
    void put_row(const std::byte* from, std::byte* to) const {
        for (std::int64_t x = 0; x < nodes_.x; x += given_.nodes.x) {
            std::memcpy(to + bytes_of(x), from, bytes_of(std::min(given_.nodes.x, nodes_.x - x)));
        }
    }

    VolumeDescription given_;
    Int3 nodes_;
    std::size_t value_;
    Granularity piece_;  ///< of one read of the inner source
    std::size_t piece_bytes_ = 0;
    std::vector<std::byte> buffer_;
};

}  // namespace

std::unique_ptr<VolumeSource> repeated(std::unique_ptr<VolumeSource> inner,
                                       const std::array<bool, 3>& periodic, const Int3& repeat) {
    const VolumeDescription given = inner->describe();
    Int3 nodes = given.nodes;
    for (int axis = 0; axis < 3; ++axis) {
        const char name = kAxes.at(static_cast<std::size_t>(axis));
        if (!periodic.at(static_cast<std::size_t>(axis))) {
            if (repeat[axis] != 1) {
                throw Error(ErrorKind::invalid_argument, {given.name},
                            fmt::format("only periodic axes can be repeated, and {} is not", name));
            }
            continue;
        }
        require_not_curved(given, "a periodic axis");
        if (given.uneven) {
            throw Error(ErrorKind::unsupported, {given.name},
                        fmt::format("{} cannot be periodic: the nodes of this volume lie at uneven "
                                    "distances, so the length of a period is unknown",
                                    name),
                        {{RemedyKind::place_in_world, "spacing"}});
        }
        if (given.nodes[axis] < 2) {
            throw Error(ErrorKind::invalid_argument, {given.name},
                        fmt::format("{} has one node and cannot be periodic", name));
        }
        if (repeat[axis] < 1 || repeat[axis] > kMaxNodesPerAxis / given.nodes[axis]) {
            throw Error(ErrorKind::limit, {given.name},
                        fmt::format("{} periods of {} nodes along {}: a volume has at most {} "
                                    "nodes per axis",
                                    repeat[axis], given.nodes[axis], name, kMaxNodesPerAxis));
        }
        nodes[axis] = repeat[axis] * given.nodes[axis] + 1;
    }
    if (nodes == given.nodes) {
        return inner;
    }
    if (inner->sequential() && nodes.z != given.nodes.z) {
        throw Error(ErrorKind::unsupported, {given.name},
                    "z cannot be periodic in a compressed stream, which is read only once; "
                    "uncompress it first");
    }
    return std::make_unique<RepeatedSource>(std::move(inner), nodes);
}

}  // namespace isonest::detail
