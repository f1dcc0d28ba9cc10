// The files of a Zarr hierarchy: those of a folder, or objects below a URL.
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

#include "store/bytes/object_folder.h"
#include "store/bytes/store_bytes.h"

namespace isonest::detail {

/// What a chunk is called in messages, and how large it is.
struct ZarrChunkPlace {
    const std::string& name;  ///< of the array
    std::string where;        ///< in it
    std::uint64_t bytes = 0;  ///< unpacked
};

/// What can be announced: a file, or what of a shard.
struct ZarrPart {
    enum class Kind : std::uint8_t { chunk, index_at_start, index_at_end, range };
    std::filesystem::path file;
    Kind kind = Kind::chunk;
    ByteRange range = {};  ///< of an index its size, of a chunk the size unpacked
};

/// Packed bytes of a file, and the size of that.
struct ZarrIndexBytes {
    std::vector<std::byte> bytes;
    std::uint64_t file_size = 0;
    /// As long as it is held, ranges are of the file in the state in which this was read.
    std::shared_ptr<const void> state = nullptr;
};

/// Paths begin with root(), which may be a URL without credentials: they are for messages, too.
class ZarrFiles {
  public:
    using Path = std::filesystem::path;

    ZarrFiles() = default;
    ZarrFiles(const ZarrFiles&) = delete;
    ZarrFiles& operator=(const ZarrFiles&) = delete;
    virtual ~ZarrFiles() = default;

    [[nodiscard]] virtual const Path& root() const = 0;
    [[nodiscard]] virtual bool is_far() const = 0;

    // Descriptions; by one thread.
    /// None if there is no such file. Throws as read_json().
    virtual std::optional<nlohmann::json> json(const Path& file) = 0;
    [[nodiscard]] virtual bool has(const Path& file) = 0;
    /// False: there is no such folder.
    [[nodiscard]] virtual bool may_have_folder(const Path& folder) = 0;
    /// Names, in any order; nothing where that is not known.
    virtual std::optional<std::vector<std::string>> folders_in(const Path& folder) = 0;
    [[nodiscard]] virtual bool is_same(const Path& a, const Path& b) = 0;
    /// From now on what describes this folder is what stands in its own files, not what a
    /// description of the whole hierarchy says.
    virtual void read_anew(const Path& folder) = 0;
    /// Where no description was found: throws what kept this from finding one, if there was
    /// something.
    virtual void refuse() const = 0;
    /// About descriptions that could not be had.
    [[nodiscard]] virtual std::vector<std::string> notes() const = 0;

    // Thread-safe from here on.
    /// Nothing if there is no such file. No more than what the chunk can be packed into: throws
    /// Error{corrupt, io}.
    virtual std::optional<std::vector<std::byte>> chunk(const Path& file,
                                                        const ZarrChunkPlace& place) = 0;
    /// Of a shard its first or last `size` bytes; nothing if there is no such file.
    virtual std::optional<ZarrIndexBytes> index(const Path& file, std::uint64_t size, bool at_end,
                                                const std::string& name) = 0;
    /// The same if that need not wait, else nothing.
    virtual std::optional<ZarrIndexBytes> index_at_hand(const Path& file, std::uint64_t size,
                                                        bool at_end) = 0;
    /// Of a shard whose index was read.
    virtual std::vector<std::byte> range(const Path& file, const ByteRange& range,
                                         const ZarrChunkPlace& place) = 0;
    /// A hint that these are read soon, in this order.
    virtual void want(std::span<const ZarrPart> parts) = 0;

    /// What is read of them; empty where they are elsewhere.
    [[nodiscard]] virtual std::vector<Path> files(const std::vector<Path>& descriptions) const = 0;
    /// Lines for VolumeSource::identity(). `chunks`: some of the array's, which need not be there.
    [[nodiscard]] virtual std::string identity(const std::vector<Path>& descriptions,
                                               const std::vector<Path>& chunks) const = 0;
    [[nodiscard]] virtual FetchedCounts fetched() const = 0;
};

/// The most bytes that so many can be packed into.
constexpr std::uint64_t most_packed(std::uint64_t bytes) {
    constexpr std::uint64_t kBeside = 4096;
    return bytes + bytes / 2 + kBeside;
}

/// Throws Error{corrupt} for more.
void check_packed(std::uint64_t packed, const ZarrChunkPlace& place);

std::shared_ptr<ZarrFiles> local_zarr_files(std::filesystem::path root);
/// The folder in a ZIP archive that is a Zarr hierarchy: empty for the archive itself, else the
/// only one of its folders that is one; none if there is none. Throws as read_zip_directory().
std::optional<std::string> zarr_in_zip(const std::filesystem::path& archive);
/// The hierarchy in that folder. Holds the archive's directory. Throws as read_zip_directory().
std::shared_ptr<ZarrFiles> zip_zarr_files(const std::filesystem::path& archive,
                                          const std::string& inside);
/// Reads what describes the root, and what its consolidated metadata say of all below. Throws what
/// open_folder_location() throws, Error{io, corrupt, unsupported}, and what remote.check throws.
std::shared_ptr<ZarrFiles> far_zarr_files(const std::filesystem::path& url,
                                          const RemoteAccess& remote);
/// The same of objects that somebody else opened.
std::shared_ptr<ZarrFiles> far_zarr_files(std::shared_ptr<ObjectFolder> objects);

}  // namespace isonest::detail
