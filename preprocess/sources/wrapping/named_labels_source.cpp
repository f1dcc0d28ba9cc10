#include "preprocess/sources/wrapping/named_labels_source.h"

#include <fmt/format.h>

#include <cstdint>
#include <span>
#include <string>
#include <utility>

#include "preprocess/sources/wrapping/described_source.h"
#include "store/container/codec.h"

namespace isonest::detail {
namespace {

class NamedLabelsSource : public DescribedSource {
  public:
    NamedLabelsSource(std::unique_ptr<VolumeSource> inner, std::vector<LabelName> names,
                      std::filesystem::path table)
        : DescribedSource(std::move(inner)), names_(std::move(names)), table_(std::move(table)) {}
    [[nodiscard]] std::vector<LabelName> label_names() const override { return names_; }
    [[nodiscard]] std::string identity() const override {
        std::string all;
        for (const LabelName& label : names_) {
            const LabelColor color = label.color.value_or(LabelColor{});
            all += fmt::format("{} {} {} {} {} {}\n", label.id, label.color.has_value(), color[0],
                               color[1], color[2], label.name);
        }
        return identity_and(
            fmt::format("names of labels {:016x}", checksum_of(std::as_bytes(std::span(all)))));
    }
    [[nodiscard]] std::vector<std::filesystem::path> files() const override {
        std::vector<std::filesystem::path> all = inner_source().files();
        if (!table_.empty()) {
            all.push_back(table_);
        }
        return all;
    }
    /// Who asks for the names gets a copy.
    [[nodiscard]] std::uint64_t heap() const override {
        std::uint64_t bytes = inner_source().heap();
        for (const LabelName& label : names_) {
            bytes += 2 * (sizeof(LabelName) + label.name.size());
        }
        return bytes;
    }

  private:
    std::vector<LabelName> names_;
    std::filesystem::path table_;
};

}  // namespace

std::unique_ptr<VolumeSource> with_label_names(std::unique_ptr<VolumeSource> inner,
                                               std::vector<LabelName> names,
                                               const std::filesystem::path& table) {
    return names.empty()
               ? std::move(inner)
               : std::make_unique<NamedLabelsSource>(std::move(inner), std::move(names), table);
}

}  // namespace isonest::detail
