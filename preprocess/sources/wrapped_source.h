// A source that is another one but for what a derived class changes.
#pragma once

#include <memory>
#include <utility>

#include <isonest/volume_source.h>

namespace isonest::detail {

/// Forwards everything but mapped() and read(), which depend on what is changed.
class WrappedSource : public VolumeSource {
  public:
    [[nodiscard]] Int3 nodes() const override { return inner_->nodes(); }
    [[nodiscard]] ValueType type() const override { return inner_->type(); }
    [[nodiscard]] Double3 spacing() const override { return inner_->spacing(); }
    [[nodiscard]] Double3 origin() const override { return inner_->origin(); }
    [[nodiscard]] std::string name() const override { return inner_->name(); }
    [[nodiscard]] std::vector<std::filesystem::path> files() const override {
        return inner_->files();
    }
    [[nodiscard]] std::string identity() const override { return inner_->identity(); }
    [[nodiscard]] Granularity granularity() const override { return inner_->granularity(); }
    [[nodiscard]] bool sequential() const override { return inner_->sequential(); }
    [[nodiscard]] std::uint64_t heap() const override { return inner_->heap(); }

  protected:
    explicit WrappedSource(std::unique_ptr<VolumeSource> inner) : inner_(std::move(inner)) {}
    [[nodiscard]] VolumeSource& inner_source() const { return *inner_; }

  private:
    std::unique_ptr<VolumeSource> inner_;
};

}  // namespace isonest::detail
