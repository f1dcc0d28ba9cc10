// The names and colours of labels in a store: FORMAT.md, section 3.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <tuple>
#include <vector>

#include <isonest/label_name.h>

#include "store/bytes/store_bytes.h"
#include "store/container/footer/catalogue.h"

namespace isonest::detail {

/// Where the members of a row begin.
struct LabelRow {
    static constexpr std::size_t kId = 0;
    static constexpr std::size_t kFlags = kId + sizeof(std::int64_t);
    static constexpr std::size_t kColor = kFlags + 1;
    static constexpr std::size_t kName = kColor + std::tuple_size_v<LabelColor>;
};

/// Rows as they are stored. Thread-safety: const methods from any thread.
class LabelTable {
  public:
    /// Of the dataset there.
    static constexpr const char* kPath = "/label_names";

    LabelTable() = default;
    /// Throws Error{corrupt, io}. REQUIRES: `bytes` outlives this.
    LabelTable(const CatalogueNames& place, const StoreBytes& bytes);

    /// Where the rows lie by HDF5's structures; `file`: its identifier, `name`: of the store, for
    /// messages. REQUIRES: there is such a dataset. Throws Error{corrupt}.
    static CatalogueNames find(std::int64_t file, const std::string& name);

    [[nodiscard]] std::size_t size() const;
    /// The rows are by rising ids. REQUIRES: i < size().
    [[nodiscard]] LabelName at(std::size_t i) const;
    /// None if nothing is said of this label.
    [[nodiscard]] std::optional<LabelName> find(std::int64_t id) const;

  private:
    [[nodiscard]] std::int64_t id_at(std::size_t i) const;

    [[nodiscard]] std::span<const std::byte> rows() const { return held_.bytes(); }

    HeldBytes held_;
    std::size_t row_bytes_ = 1;
};

/// Throws Error{corrupt} about the names of labels in a store of this name.
[[noreturn]] void names_damaged(const std::string& store, const std::string& problem);
inline constexpr const char* kOtherNamesForm = "it has another form than the format's";

/// Bytes for the longest of these names, at least 1.
std::size_t name_bytes_of(std::span<const LabelName> names);
/// The rows as they are stored.
std::vector<std::byte> label_rows(std::span<const LabelName> names, std::size_t name_bytes);

}  // namespace isonest::detail
