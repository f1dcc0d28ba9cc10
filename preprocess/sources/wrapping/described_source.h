// A source of which something else is said than it says itself.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <utility>

#include <isonest/volume_source.h>

#include "preprocess/sources/wrapping/wrapped_source.h"

namespace isonest::detail {

/// The inner values as they are; a derived class changes what describes them.
class DescribedSource : public WrappedSource {
  public:
    [[nodiscard]] std::span<const std::byte> mapped() const final {
        return inner_source().mapped();
    }
    void read(std::int64_t z0, std::int64_t nz, std::int64_t y0, std::int64_t ny,
              std::byte* dst) final {
        inner_source().read(z0, nz, y0, ny, dst);
    }
    /// The source whose values they are.
    [[nodiscard]] VolumeSource& undescribed() const { return inner_source(); }

  protected:
    explicit DescribedSource(std::unique_ptr<VolumeSource> inner)
        : WrappedSource(std::move(inner)) {}
};

}  // namespace isonest::detail
