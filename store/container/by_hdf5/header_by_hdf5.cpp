#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "store/container/hdf5_types.h"
#include "store/container/header_reader.h"
#include "store/container/label_table.h"

namespace isonest::detail {
namespace {

class Hdf5Attributes : public RootGroup {
  public:
    explicit Hdf5Attributes(hid_t root) : root_(root) {}
    [[nodiscard]] std::optional<std::string> text(const char* name) const override {
        return read_text(root_, name);
    }
    [[nodiscard]] std::optional<std::vector<std::uint64_t>> integers(
        const char* name, std::size_t count) const override {
        return read_integers(root_, name, count);
    }
    [[nodiscard]] std::optional<std::vector<double>> numbers(const char* name,
                                                             std::size_t count) const override {
        return read_numbers(root_, name, count);
    }
    [[nodiscard]] std::optional<std::uint64_t> digest() const override {
        return header_digest(root_);
    }
    [[nodiscard]] bool has_label_names() const override {
        return H5Lexists(root_, LabelTable::kPath, H5P_DEFAULT) > 0;
    }

  private:
    hid_t root_;
};

}  // namespace

RootAttributes read_root_attributes(std::int64_t root, const std::string& file) {
    return read_root_attributes(Hdf5Attributes(root), file);
}

}  // namespace isonest::detail
