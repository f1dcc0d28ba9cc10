// A finished store, open for reading.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <isonest/field.h>
#include <isonest/frame.h>
#include <isonest/int3.h>
#include <isonest/label_name.h>
#include <isonest/length_unit.h>
#include <isonest/remote.h>
#include <isonest/value_type.h>

namespace isonest {
namespace detail {
class DiskCache;
class StoreReader;
}  // namespace detail

/// What preprocess() made: all levels of a volume and the indicators of every node, in one file
/// that is mapped read-only, or in an object elsewhere of which what is asked for is fetched. Not
/// to be used after it was moved from. Thread-safety: const methods, and any number of queries of
/// the same Store, from any threads.
class Store {
  public:
    /// A file, or what is_url() takes for a URL: then `remote` says how it is reached. Throws
    /// Error{not_found}, Error{corrupt} (not a store, incomplete, damaged), Error{unsupported} (a
    /// format that this version does not read; a URL, where the library was built without libcurl),
    /// Error{invalid_argument} (a URL or header that is none), Error{io}, and what remote.check
    /// throws. Queries of a store elsewhere throw Error{io}, too, and Error{corrupt} if the object
    /// is not the one any more that was opened.
    explicit Store(const std::filesystem::path& location, const RemoteAccess& remote = {});
    Store(Store&& other) noexcept;
    Store& operator=(Store&& other) noexcept;
    Store(const Store&) = delete;
    Store& operator=(const Store&) = delete;
    ~Store();

    /// The file; of a store elsewhere the URL without userinfo, query and fragment, which is for
    /// messages: its last part is what files that go with the store are called.
    [[nodiscard]] const std::filesystem::path& path() const;
    /// Whether it is read over a network.
    [[nodiscard]] bool is_remote() const;
    /// Until now, by all queries together.
    [[nodiscard]] FetchedCounts fetched() const;
    /// Why the folder RemoteAccess::cache is not used, or why nothing is added to it any more;
    /// empty if nothing is wrong with it.
    [[nodiscard]] std::string cache_warning() const;
    /// Nodes per axis (x, y, z) of the finest level.
    [[nodiscard]] Int3 nodes() const;
    [[nodiscard]] ValueType type() const;
    /// Node p lies at origin() + the sum over the axes of direction() * spacing() * p in world
    /// units.
    [[nodiscard]] Double3 spacing() const;
    [[nodiscard]] Double3 origin() const;
    /// Of the axes: kAlongWorld unless the volume was rotated.
    [[nodiscard]] Directions direction() const;
    /// That a world unit is; nothing where it is not known.
    [[nodiscard]] std::optional<LengthUnit> unit() const;
    /// What the world's x, y and z are in a patient; unknown where the volume did not say it.
    [[nodiscard]] AnatomicalFrame frame() const;
    /// How many world units are as long as `length` of `given`. Throws Error{invalid_argument}
    /// where unit() is not known.
    [[nodiscard]] double world_units(double length, LengthUnit given) const;
    /// 0 is the finest level, levels() - 1 the coarsest.
    [[nodiscard]] int levels() const;
    /// The indicators that it holds, in the order of the file.
    [[nodiscard]] const std::vector<Field>& fields() const;
    /// Smallest and largest finite value of the finest level; min > max if there is none.
    [[nodiscard]] double min_value() const;
    [[nodiscard]] double max_value() const;
    /// Whether values are missing (NaN or infinite).
    [[nodiscard]] bool has_missing() const;
    /// Names and colours of labels, by rising ids, as the input had them when the store was made
    /// for labels; also of labels that no node has. Empty where nothing is known.
    [[nodiscard]] std::vector<LabelName> label_names() const;
    /// Of one label; none where nothing is known of it.
    [[nodiscard]] std::optional<LabelName> label_name(std::int64_t id) const;
    /// The ids of all labels of this name, rising.
    [[nodiscard]] std::vector<std::int64_t> labels_named(std::string_view name) const;

    /// For the library's own parts.
    [[nodiscard]] const detail::StoreReader& reader() const { return *reader_; }

  private:
    std::shared_ptr<const detail::DiskCache> cache_;  ///< null: none
    std::unique_ptr<const detail::StoreReader> reader_;
};

}  // namespace isonest
