// A source that wraps another one and changes some of it.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <isonest/volume_source.h>

namespace isonest::detail {

/// Forwards everything except mapped() and read(), which a class that changes values must define. A
/// class that does not change values derives from DescribedSource.
class WrappedSource : public VolumeSource {
  public:
    [[nodiscard]] VolumeDescription describe() const override { return inner_->describe(); }
    [[nodiscard]] std::string identity() const override { return inner_->identity(); }
    void will_read(std::int64_t z0, std::int64_t nz, std::int64_t y0, std::int64_t ny) override {
        inner_->will_read(z0, nz, y0, ny);
    }
    [[nodiscard]] std::vector<std::filesystem::path> files() const override {
        return inner_->files();
    }
    [[nodiscard]] Granularity granularity() const override { return inner_->granularity(); }
    [[nodiscard]] bool sequential() const override { return inner_->sequential(); }
    [[nodiscard]] std::uint64_t heap() const override { return inner_->heap(); }
    [[nodiscard]] std::vector<std::string> notes() const override { return inner_->notes(); }
    [[nodiscard]] std::vector<LabelName> label_names() const override {
        return inner_->label_names();
    }
    [[nodiscard]] FetchedCounts fetched() const override { return inner_->fetched(); }
    [[nodiscard]] std::string cache_warning() const override { return inner_->cache_warning(); }

  protected:
    explicit WrappedSource(std::unique_ptr<VolumeSource> inner)
        : owned_(std::move(inner)), inner_(owned_.get()) {}
    /// `inner` is not owned.
    explicit WrappedSource(VolumeSource& inner) : inner_(&inner) {}
    [[nodiscard]] VolumeSource& inner_source() const { return *inner_; }
    /// The inner identity with a line about what is changed; empty if the inner identity is.
    [[nodiscard]] std::string identity_and(const std::string& line) const {
        const std::string inner = inner_->identity();
        return inner.empty() ? inner : inner + (inner.back() == '\n' ? "" : "\n") + line + "\n";
    }

  private:
    std::unique_ptr<VolumeSource> owned_;
    VolumeSource* inner_;
};

// A source with a changed description.

/// Passes the inner values on unchanged; a derived class changes their description.
class DescribedSource : public WrappedSource {
  public:
    [[nodiscard]] std::span<const std::byte> mapped() const final {
        return inner_source().mapped();
    }
    void read(std::int64_t z0, std::int64_t nz, std::int64_t y0, std::int64_t ny,
              std::byte* dst) final {
        inner_source().read(z0, nz, y0, ny, dst);
    }
    /// The source that the values come from.
    [[nodiscard]] VolumeSource& undescribed() const { return inner_source(); }

  protected:
    explicit DescribedSource(std::unique_ptr<VolumeSource> inner)
        : WrappedSource(std::move(inner)) {}
};

}  // namespace isonest::detail
