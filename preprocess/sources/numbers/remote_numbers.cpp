#include "preprocess/sources/numbers/remote_numbers.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <utility>
#include <vector>

#include <isonest/error.h>

#include "preprocess/sources/numbers/raw_rows.h"

namespace isonest::detail {
namespace {

/// Position of a slab relative to the one before: 1 above it, -1 below it, 0 after it along y;
/// otherwise 2.
int step_from(const Slab& last, const Slab& slab) {
    const bool same_rows = slab.y0 == last.y0 && slab.ny == last.ny;
    if (same_rows && slab.z0 == last.z0 + last.nz) {
        return 1;
    }
    if (same_rows && slab.z0 + slab.nz == last.z0) {
        return -1;
    }
    const bool same_planes = slab.z0 == last.z0 && slab.nz == last.nz;
    return same_planes && slab.y0 == last.y0 + last.ny ? 0 : 2;
}

std::uint64_t bytes_from(const std::vector<ByteRange>& ranges, std::size_t first) {
    std::uint64_t bytes = 0;
    for (std::size_t i = first; i < ranges.size(); ++i) {
        bytes += ranges[i].size;
    }
    return bytes;
}

}  // namespace

bool SlabAhead::go_on(Slab& slab, int step) const {
    if (step == 0) {
        slab.y0 += slab.ny;
        slab.ny = std::min(slab.ny, nodes_.y - slab.y0);
        return slab.ny > 0;
    }
    if (step > 0) {
        slab.z0 += slab.nz;
        slab.nz = std::min(slab.nz, nodes_.z - slab.z0);
        return slab.nz > 0;
    }
    const std::int64_t end = slab.z0;
    slab.z0 = std::max<std::int64_t>(end - slab.nz, 0);
    slab.nz = end - slab.z0;
    return slab.nz > 0;
}

void SlabAhead::begin(const Slab& slab) {
    std::vector<ByteRange> ranges;
    ranges_of_(slab, ranges);
    const int step = last_.nz > 0 ? step_from(last_, slab) : 2;
    const std::uint64_t own = bytes_from(ranges, 0);
    followed_ = step == 2 ? 0 : followed_ + own;
    const std::uint64_t most = std::min(followed_, bytes_.window());
    std::uint64_t ahead = 0;
    for (Slab next = slab; step != 2 && ahead < most && go_on(next, step);) {
        const std::size_t first = ranges.size();
        ranges_of_(next, ranges);
        ahead += bytes_from(ranges, first);
    }
    last_ = slab;
    bytes_.expect(std::move(ranges));
}

namespace {

/// Consecutive rows, x fastest.
class RemoteRows : public RawBase {
  public:
    RemoteRows(const InputFile& file, std::string name, const RawLayout& layout)
        : RawBase(file, std::move(name), layout),
          ahead_(file, layout.nodes, [this](const Slab& slab, std::vector<ByteRange>& ranges) {
              add_ranges(slab, ranges);
          }) {}

  private:
    void add_ranges(const Slab& s, std::vector<ByteRange>& ranges) const {
        const std::uint64_t row =
            static_cast<std::uint64_t>(layout_.nodes.x) * size_of(layout_.type);
        const bool whole = s.ny == layout_.nodes.y;
        const auto rows = static_cast<std::uint64_t>(whole ? s.nz * s.ny : s.ny);
        for (std::int64_t z = s.z0; z < (whole ? s.z0 + 1 : s.z0 + s.nz); ++z) {
            ranges.push_back(
                {start() + static_cast<std::uint64_t>(z * layout_.nodes.y + s.y0) * row,
                 rows * row});
        }
    }
    void before_rows(const Slab& slab) override { ahead_.begin(slab); }
    void read_bytes(std::uint64_t at, std::byte* dst, std::uint64_t bytes) override {
        ahead_.bytes().read(at, dst, bytes);
    }

    SlabAhead ahead_;
};

/// With strides: line by line along the axis with the smallest stride.
class RemoteStrides final : public VolumeSource {
  public:
    RemoteStrides(const InputFile& file, std::string name, const RawLayout& layout)
        : file_(file),
          name_(std::move(name)),
          layout_(layout),
          value_(size_of(layout.type)),
          ahead_(file, layout.nodes, [this](const Slab& slab, std::vector<ByteRange>& ranges) {
              add_ranges(slab, ranges);
          }) {
        // Axes of one node come last, because they need no steps.
        const auto rank = [&](int axis) {
            return std::pair(layout_.nodes[axis] == 1, (*layout_.strides)[axis]);
        };
        std::sort(order_.begin(), order_.end(), [&](int a, int b) { return rank(a) < rank(b); });
        require_few_ranges();
    }
    [[nodiscard]] VolumeDescription describe() const override {
        return {layout_.nodes,     layout_.type, layout_.spacing, layout_.origin, name_,
                layout_.direction, false,        layout_.unit,    layout_.frame};
    }
    [[nodiscard]] std::vector<std::filesystem::path> files() const override {
        return local_files({file_, layout_.header});
    }
    [[nodiscard]] std::string identity() const override { return identity_of_raw(file_, layout_); }
    /// Fetches together what is contiguous in the object.
    [[nodiscard]] Granularity granularity() const override {
        return layout_.strides->z < layout_.strides->y ? Granularity{layout_.nodes.z, 1}
                                                       : Granularity{};
    }
    [[nodiscard]] std::uint64_t heap() const override {
        return VolumeSource::heap() + line_bytes(layout_.nodes[order_[0]]);
    }
    void read(std::int64_t z0, std::int64_t nz, std::int64_t y0, std::int64_t ny,
              std::byte* dst) override {
        const Slab slab{z0, nz, y0, ny};
        ahead_.begin(slab);
        const Int3 size{layout_.nodes.x, ny, nz};
        const Int3& strides = *layout_.strides;
        const Int3 steps{1, layout_.nodes.x, layout_.nodes.x * ny};
        const auto [fast, middle, slow] = order_;
        std::vector<std::byte> line(line_bytes(size[fast]));
        for (std::int64_t s = 0; s < size[slow]; ++s) {
            for (std::int64_t m = 0; m < size[middle]; ++m) {
                const std::uint64_t at =
                    start(slab) +
                    static_cast<std::uint64_t>(s * strides[slow] + m * strides[middle]) * value_;
                // The object may end after its last value.
                ahead_.bytes().read(
                    at, line.data(),
                    std::min<std::uint64_t>(line.size(), ahead_.bytes().size() - at));
                std::byte* const to =
                    dst + static_cast<std::size_t>(s * steps[slow] + m * steps[middle]) * value_;
                for (std::int64_t f = 0; f < size[fast]; ++f) {
                    std::memcpy(to + static_cast<std::size_t>(f * steps[fast]) * value_,
                                line.data() + static_cast<std::size_t>(f * strides[fast]) * value_,
                                value_);
                }
            }
        }
        if (layout_.big_endian && value_ > 1) {
            swap_bytes(dst, static_cast<std::uint64_t>(size.product()) * value_, value_);
        }
    }

  private:
    /// Gaps up to this size between two lines are fetched with them.
    static constexpr std::int64_t kGap = 4096;

    [[nodiscard]] std::uint64_t start(const Slab& s) const {
        const Int3& strides = *layout_.strides;
        return layout_.offset +
               (layout_.first + static_cast<std::uint64_t>(s.z0 * strides.z + s.y0 * strides.y)) *
                   value_;
    }
    /// Includes the gap between the last value and the next line: unread bytes would stay in the
    /// cache, for a read that never comes.
    [[nodiscard]] std::size_t line_bytes(std::int64_t nodes) const {
        return static_cast<std::size_t>(nodes * (*layout_.strides)[order_[0]]) * value_;
    }

    /// One range per line; or per plane or for everything, if these are close together.
    void add_ranges(const Slab& slab, std::vector<ByteRange>& ranges) const {
        const Int3 size{layout_.nodes.x, slab.ny, slab.nz};
        std::array<std::uint64_t, 2> step{};
        std::array<std::int64_t, 2> count{};
        std::uint64_t run = line_bytes(size[order_[0]]);
        for (std::size_t i = 0; i < 2; ++i) {
            const int axis = order_.at(i + 1);
            step.at(i) = static_cast<std::uint64_t>((*layout_.strides)[axis]) * value_;
            count.at(i) = size[axis];
            const bool are_inner_joined = i == 0 || count[0] == 1;
            if (are_inner_joined && step.at(i) <= run + kGap) {
                run += static_cast<std::uint64_t>(count.at(i) - 1) * step.at(i);
                count.at(i) = 1;
            }
        }
        for (std::int64_t s = 0; s < count[1]; ++s) {
            for (std::int64_t m = 0; m < count[0]; ++m) {
                ranges.push_back({start(slab) + static_cast<std::uint64_t>(s) * step[1] +
                                      static_cast<std::uint64_t>(m) * step[0],
                                  run});
            }
        }
    }

    /// An object that fits into memory may be read in any order.
    void require_few_ranges() const {
        constexpr std::uint64_t kMinRun = std::uint64_t{32} << 10U;
        constexpr std::int64_t kPlanes = 16;  // read at a time, approximately
        constexpr std::int64_t kAtOnce = std::int64_t{8} << 20U;
        if (file_.bytes()->size() <= file_.window()) {
            return;
        }
        constexpr std::uint64_t kMaxApart = 64;
        if (smallest_stride() > kMaxApart) {
            throw Error(
                ErrorKind::unsupported, {name_},
                fmt::format(
                    "the values are {} bytes apart, so everything between them would be fetched",
                    smallest_stride() * value_),
                {{RemedyKind::download}});
        }
        const Int3& n = layout_.nodes;
        Slab slab{0, std::min(n.z, kPlanes), 0, n.y};
        if (granularity().planes > 1) {
            const std::int64_t row = n.z * n.x * static_cast<std::int64_t>(value_);
            slab = {0, n.z, 0, std::clamp<std::int64_t>(kAtOnce / row, 1, n.y)};
        }
        std::vector<ByteRange> ranges;
        add_ranges(slab, ranges);
        const std::uint64_t numbers = static_cast<std::uint64_t>(n.x * slab.ny * slab.nz) * value_;
        // A single range with far more bytes than numbers is the same for all slabs.
        const bool is_scattered =
            ranges.front().size * ranges.size() > 2 * numbers * smallest_stride();
        if ((ranges.size() > 1 && ranges.front().size < kMinRun) || is_scattered) {
            throw Error(ErrorKind::unsupported, {name_},
                        fmt::format("because of the order of the axes, a slab is in {} pieces of "
                                    "{} bytes, which are too many to fetch",
                                    ranges.size(), ranges.front().size),
                        {{RemedyKind::download}});
        }
    }
    [[nodiscard]] std::uint64_t smallest_stride() const {
        return static_cast<std::uint64_t>((*layout_.strides)[order_[0]]);
    }

    InputFile file_;
    std::string name_;
    RawLayout layout_;
    std::size_t value_;
    std::array<int, 3> order_{0, 1, 2};  ///< axes, smallest stride first
    SlabAhead ahead_;
};

}  // namespace

std::unique_ptr<VolumeSource> open_remote_numbers(const InputFile& file, const std::string& name,
                                                  const RawLayout& layout) {
    if (layout.strides) {
        return std::make_unique<RemoteStrides>(file, name, layout);
    }
    return std::make_unique<RemoteRows>(file, name, layout);
}

}  // namespace isonest::detail
