#include "preprocess/sources/wrapping/noted_source.h"

#include <utility>

#include "preprocess/sources/wrapping/wrapped_source.h"

namespace isonest::detail {
namespace {

class NotedSource : public WrappedSource {
  public:
    NotedSource(std::unique_ptr<VolumeSource> inner, std::vector<std::string> notes)
        : WrappedSource(std::move(inner)), notes_(std::move(notes)) {}
    [[nodiscard]] std::vector<std::string> notes() const override {
        std::vector<std::string> all = inner_source().notes();
        all.insert(all.end(), notes_.begin(), notes_.end());
        return all;
    }
    [[nodiscard]] std::span<const std::byte> mapped() const override {
        return inner_source().mapped();
    }
    void read(std::int64_t z0, std::int64_t nz, std::int64_t y0, std::int64_t ny,
              std::byte* dst) override {
        inner_source().read(z0, nz, y0, ny, dst);
    }

  private:
    std::vector<std::string> notes_;
};

}  // namespace

std::unique_ptr<VolumeSource> with_notes(std::unique_ptr<VolumeSource> inner,
                                         std::vector<std::string> notes) {
    return notes.empty() ? std::move(inner)
                         : std::make_unique<NotedSource>(std::move(inner), std::move(notes));
}

}  // namespace isonest::detail
