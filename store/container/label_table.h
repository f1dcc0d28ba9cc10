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

namespace isonest::detail {

/// Where the members of a row begin.
struct LabelRow {
    static constexpr std::size_t kId = 0;
    static constexpr std::size_t kFlags = kId + sizeof(std::int64_t);
    static constexpr std::size_t kColor = kFlags + 1;
    static constexpr std::size_t kName = kColor + std::tuple_size_v<LabelColor>;
};

/// Rows as they are stored, in the map of the store. Thread-safety: const methods from any thread.
class LabelTable {
  public:
    /// Of the dataset there.
    static constexpr const char* kPath = "/label_names";

    LabelTable() = default;
    /// `file`: HDF5's identifier, `bytes`: the same file, mapped; `name` is used in messages.
    /// Nothing if it has no such dataset. Throws Error{corrupt}.
    LabelTable(std::int64_t file, std::span<const std::byte> bytes, const std::string& name);

    [[nodiscard]] std::size_t size() const;
    /// The rows are by rising ids. REQUIRES: i < size().
    [[nodiscard]] LabelName at(std::size_t i) const;
    /// None if nothing is said of this label.
    [[nodiscard]] std::optional<LabelName> find(std::int64_t id) const;

  private:
    [[nodiscard]] std::int64_t id_at(std::size_t i) const;

    std::span<const std::byte> rows_;
    std::size_t row_bytes_ = 1;
};

/// Bytes for the longest of these names, at least 1.
std::size_t name_bytes_of(std::span<const LabelName> names);
/// The rows as they are stored.
std::vector<std::byte> label_rows(std::span<const LabelName> names, std::size_t name_bytes);

}  // namespace isonest::detail
