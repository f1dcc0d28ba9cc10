#include "preprocess/sources/wrapping/mirrored_source.h"

#include <fmt/format.h>

#include <algorithm>

#include <isonest/error.h>

#include "preprocess/sources/wrapping/wrapped_source.h"

namespace isonest::detail {
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
                        "z runs from high to low in a compressed stream; store it without "
                        "compression (encoding: raw)");
        }
    }
    [[nodiscard]] std::string identity() const override {
        return identity_and(
            fmt::format("backward {} {} {}", backward_[0], backward_[1], backward_[2]));
    }
    [[nodiscard]] Granularity granularity() const override {
        // Of a stream's planes, what comes first may be needed last.
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
