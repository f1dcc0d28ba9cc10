// A source that is another one but for what a derived class changes.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include <isonest/volume_source.h>

namespace isonest::detail {

/// Forwards everything but mapped() and read(): who changes values has to say how. Who changes none
/// derives from DescribedSource.
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
    explicit WrappedSource(std::unique_ptr<VolumeSource> inner) : inner_(std::move(inner)) {}
    [[nodiscard]] VolumeSource& inner_source() const { return *inner_; }
    /// The inner identity and a line about what is changed; nothing if it cannot tell.
    [[nodiscard]] std::string identity_and(const std::string& line) const {
        const std::string inner = inner_->identity();
        return inner.empty() ? inner : inner + (inner.back() == '\n' ? "" : "\n") + line + "\n";
    }

  private:
    std::unique_ptr<VolumeSource> inner_;
};

}  // namespace isonest::detail
