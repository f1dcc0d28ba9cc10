#include "preprocess/sources/wrapping/noted_source.h"

#include <utility>

#include "preprocess/sources/wrapping/described_source.h"

namespace isonest::detail {
namespace {

class NotedSource : public DescribedSource {
  public:
    NotedSource(std::unique_ptr<VolumeSource> inner, std::vector<std::string> notes)
        : DescribedSource(std::move(inner)), notes_(std::move(notes)) {}
    [[nodiscard]] std::vector<std::string> notes() const override {
        std::vector<std::string> all = inner_source().notes();
        all.insert(all.end(), notes_.begin(), notes_.end());
        return all;
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
