// The files of a Zarr hierarchy: in a folder, in a ZIP archive, or objects below a URL.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <isonest/open_volume.h>
#include <isonest/remote.h>

#include "store/bytes/store_bytes.h"

namespace isonest::detail {

// Metadata, of which any member may be missing or of another type.

/// Null if there is no such member.
const nlohmann::json& member(const nlohmann::json& object, const char* key);
/// Empty if there is no such member, or it is not a list.
const nlohmann::json& entries(const nlohmann::json& object, const char* key);

/// The name of a chunk in messages, and its size.
struct ZarrChunkPlace {
    const std::string& name;  ///< of the array
    std::string where;        ///< its position in the array
    std::uint64_t bytes = 0;  ///< uncompressed
};

/// What can be prefetched: a file, or a part of a shard.
struct ZarrPart {
    enum class Kind : std::uint8_t { chunk, index_at_start, index_at_end, range };
    std::filesystem::path file;
    Kind kind = Kind::chunk;
    ByteRange range = {};  ///< for an index its size, for a chunk the uncompressed size
};

/// Compressed bytes of a file, and the size of the file.
struct ZarrIndexBytes {
    std::vector<std::byte> bytes;
    std::uint64_t file_size = 0;
    /// While this is held, ranges are read from the same version of the file as the index.
    std::shared_ptr<const void> state = nullptr;
};

/// Paths begin with root(), which may be a URL without credentials, so they can be used in
/// messages.
class ZarrFiles {
  public:
    using Path = std::filesystem::path;

    ZarrFiles() = default;
    ZarrFiles(const ZarrFiles&) = delete;
    ZarrFiles& operator=(const ZarrFiles&) = delete;
    virtual ~ZarrFiles() = default;

    [[nodiscard]] virtual const Path& root() const = 0;
    [[nodiscard]] virtual bool is_remote() const = 0;

    // Descriptions; from one thread.
    /// None if there is no such file. Throws like read_json().
    virtual std::optional<nlohmann::json> json(const Path& file) = 0;
    [[nodiscard]] virtual bool has(const Path& file) = 0;
    /// False: there is certainly no such folder.
    [[nodiscard]] virtual bool may_have_folder(const Path& folder) = 0;
    /// Names, in any order; none if they cannot be listed.
    virtual std::optional<std::vector<std::string>> folders_in(const Path& folder) = 0;
    [[nodiscard]] virtual bool is_same(const Path& a, const Path& b) = 0;
    /// From now on, this folder is described by its own files, and not by the consolidated
    /// description of the hierarchy.
    virtual void read_anew(const Path& folder) = 0;
    /// To be called if no description was found: throws the error that prevented this, if there was
    /// one.
    virtual void refuse() const = 0;
    /// About descriptions that could not be read.
    [[nodiscard]] virtual std::vector<std::string> notes() const = 0;

    // Thread-safe from here on.
    /// None if there is no such file. Reads no more than the maximum compressed size of the chunk.
    /// Throws Error{corrupt, io}.
    virtual std::optional<std::vector<std::byte>> chunk(const Path& file,
                                                        const ZarrChunkPlace& place) = 0;
    /// The first or last `size` bytes of a shard; none if there is no such file.
    virtual std::optional<ZarrIndexBytes> index(const Path& file, std::uint64_t size, bool at_end,
                                                const std::string& name) = 0;
    /// The same if it is available without waiting, otherwise none.
    virtual std::optional<ZarrIndexBytes> index_at_hand(const Path& file, std::uint64_t size,
                                                        bool at_end) = 0;
    /// Part of a shard whose index was read.
    virtual std::vector<std::byte> range(const Path& file, const ByteRange& range,
                                         const ZarrChunkPlace& place) = 0;
    /// A hint that these will be read soon, in this order.
    virtual void want(std::span<const ZarrPart> parts) = 0;

    /// The files that are read; empty if remote.
    [[nodiscard]] virtual std::vector<Path> files(const std::vector<Path>& descriptions) const = 0;
    /// Lines for VolumeSource::identity(). `chunks`: some chunks of the array, which need not
    /// exist.
    [[nodiscard]] virtual std::string identity(const std::vector<Path>& descriptions,
                                               const std::vector<Path>& chunks) const = 0;
    [[nodiscard]] virtual FetchedCounts fetched() const = 0;
};

/// The maximum compressed size of this many bytes.
constexpr std::uint64_t max_packed(std::uint64_t bytes) {
    constexpr std::uint64_t kBeside = 4096;
    return bytes + bytes / 2 + kBeside;
}

/// Throws Error{corrupt} if `packed` exceeds that.
void check_packed(std::uint64_t packed, const ZarrChunkPlace& place);

std::shared_ptr<ZarrFiles> local_zarr_files(std::filesystem::path root);
/// The folder in a ZIP archive that is a Zarr hierarchy: empty for the archive itself, otherwise
/// the only folder in it that is one; none if there is none. Throws like read_zip_directory().
std::optional<std::string> zarr_in_zip(const std::filesystem::path& archive);
/// The hierarchy in that folder. Holds the archive's directory. Throws like read_zip_directory().
std::shared_ptr<ZarrFiles> zip_zarr_files(const std::filesystem::path& archive,
                                          const std::string& inside);
/// Reads the description of the root, and its consolidated metadata for everything below. Throws
/// what open_folder_location() throws, Error{io, corrupt, unsupported}, and what remote.check
/// throws.
std::shared_ptr<ZarrFiles> remote_zarr_files(const std::filesystem::path& url,
                                             const RemoteAccess& remote);
/// The same for objects that are already open.
std::shared_ptr<ZarrFiles> remote_zarr_files(std::shared_ptr<ObjectFolder> objects);

}  // namespace isonest::detail
