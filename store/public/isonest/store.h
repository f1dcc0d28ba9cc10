// A finished store, open for reading.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <isonest/curved_nodes.h>
#include <isonest/data_rounding.h>
#include <isonest/field.h>
#include <isonest/frame.h>
#include <isonest/int3.h>
#include <isonest/label_name.h>
#include <isonest/length_unit.h>
#include <isonest/remote.h>
#include <isonest/uneven_axes.h>
#include <isonest/value_type.h>

namespace isonest {
namespace detail {
class DiskCache;
class StoreReader;
}  // namespace detail

/// The result of preprocess(): all levels of a volume and the indicators of every node. It is
/// either a local file, mapped read-only, or a remote object, of which only the required parts are
/// fetched. Must not be used after being moved from. Thread-safety: const methods and any number of
/// queries of the same Store from any threads.
class Store {
  public:
    /// Opens a file, or a URL as defined by is_url(); `remote` says how to access a URL. Throws
    /// Error{not_found}, Error{corrupt} (no HDF5 file, incomplete, damaged), Error{unsupported} (a
    /// format that this version does not read; a URL if the library was built without libcurl),
    /// Error{invalid_argument} (another HDF5 file; invalid URL or header), Error{io}, and what
    /// remote.check throws. Queries of a remote store also throw Error{io}, and Error{corrupt} if
    /// the object has changed since it was opened.
    explicit Store(const std::filesystem::path& location, const RemoteAccess& remote = {});
    Store(Store&& other) noexcept;
    Store& operator=(Store&& other) noexcept;
    Store(const Store&) = delete;
    Store& operator=(const Store&) = delete;
    ~Store();

    /// The path of the file. For a remote store, the URL without userinfo, query and fragment, for
    /// messages; its last part is the base name of files that belong to the store.
    [[nodiscard]] const std::filesystem::path& path() const;
    /// Whether the store is read over a network.
    [[nodiscard]] bool is_remote() const;
    /// Total so far, over all queries.
    [[nodiscard]] FetchedCounts fetched() const;
    /// Why the folder RemoteAccess::cache is not used, or why nothing is added to it any more;
    /// empty if there is no problem.
    [[nodiscard]] std::string cache_warning() const;
    /// Nodes per axis (x, y, z) of the finest level.
    [[nodiscard]] Int3 nodes() const;
    [[nodiscard]] ValueType type() const;
    /// Node p lies at origin() + the sum over the axes of direction() * spacing() * p in world
    /// units, or along an uneven axis of direction() * offset of p. Uneven axes: the mean step.
    [[nodiscard]] Double3 spacing() const;
    /// The axes along which the distances between nodes differ; null if there are none.
    [[nodiscard]] UnevenAxesPtr uneven_axes() const;
    /// For a curvilinear grid: what is known of its nodes as a whole. Its spacing() is 1 and its
    /// origin() 0: they are those of the lattice. Null for other grids.
    [[nodiscard]] CurvedNodesPtr curved() const;
    /// The world positions of the `size` nodes starting at `first`, x fastest, of any grid. Decodes
    /// the chunks that contain them. Throws Error{invalid_argument} unless 0 <= first and first +
    /// size <= nodes(), and Error{corrupt, io}.
    [[nodiscard]] std::vector<Double3> positions(const Int3& first, const Int3& size) const;
    [[nodiscard]] Double3 origin() const;
    /// Directions of the axes: kAlongWorld unless the volume is rotated or sheared.
    [[nodiscard]] Directions direction() const;
    /// Length of a world unit; nullopt if unknown.
    [[nodiscard]] std::optional<LengthUnit> unit() const;
    /// What the world's x, y and z mean in a patient; unknown if the volume did not say.
    [[nodiscard]] AnatomicalFrame frame() const;
    /// Converts `length` in units of `given` to world units. Throws Error{invalid_argument} if
    /// unit() is unknown.
    [[nodiscard]] double world_units(double length, LengthUnit given) const;
    /// 0 is the finest level, levels() - 1 the coarsest.
    [[nodiscard]] int levels() const;
    /// The indicators in the store, in the order of the file.
    [[nodiscard]] const std::vector<Field>& fields() const;
    /// Smallest and largest finite value of the finest level; min > max if there is none.
    [[nodiscard]] double min_value() const;
    [[nodiscard]] double max_value() const;
    /// How the values were rounded when the store was made. Everything in the store is that of the
    /// rounded values; error bounds of queries are for the given ones.
    [[nodiscard]] DataRounding rounding() const;
    /// Whether values are missing (NaN or infinite).
    [[nodiscard]] bool has_missing() const;
    /// Names and colours of labels, by ascending ids, as read from the input if the store was made
    /// for labels; may include labels that no node has. Empty if none are known.
    [[nodiscard]] std::vector<LabelName> label_names() const;
    /// The name and colour of one label; nullopt if unknown.
    [[nodiscard]] std::optional<LabelName> label_name(std::int64_t id) const;
    /// The ids of all labels with this name, ascending.
    [[nodiscard]] std::vector<std::int64_t> labels_named(std::string_view name) const;

    /// For internal use by the library.
    [[nodiscard]] const detail::StoreReader& reader() const { return *reader_; }

  private:
    std::shared_ptr<const detail::DiskCache> cache_;  ///< null: no cache
    std::unique_ptr<const detail::StoreReader> reader_;
};

}  // namespace isonest
