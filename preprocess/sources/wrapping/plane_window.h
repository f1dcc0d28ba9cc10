// The planes of the input that the current blocks need. Each input byte is read only once.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>

#include <isonest/progress.h>
#include <isonest/volume_source.h>

#include "store/files/scratch_file.h"

namespace isonest::detail {

/// Rows [y_begin, y_end) of planes [z_begin, z_end) of a volume.
struct VolumePart {
    std::int64_t y_begin = 0;
    std::int64_t y_end = 0;
    std::int64_t z_begin = 0;
    std::int64_t z_end = 0;
};

/// Uses the map of the file if its bytes can be used unchanged; otherwise a sliding window of whole
/// planes in memory if the budget allows it; otherwise a copy of the volume in temporary space on
/// disk, written in the order that suits the source. Thread-safety: row() from any thread; the rest
/// from one thread, prefetch() at the same time as row().
class PlaneWindow {
  public:
    /// `planes` is the largest number of planes needed at a time, `budget` the maximum number of
    /// bytes to hold. Throws Error{io, limit}.
    PlaneWindow(VolumeSource& source, std::int64_t planes, std::uint64_t budget,
                const std::filesystem::path& scratch_folder, Progress& progress);

    /// The same for a part of the volume. REQUIRES: the part is the whole volume if the source is
    /// sequential.
    PlaneWindow(VolumeSource& source, const VolumePart& part, std::int64_t planes,
                std::uint64_t budget, const std::filesystem::path& scratch_folder,
                Progress& progress);

    /// Makes planes [z_begin, z_end) available. Planes below z_begin are released, and skipped
    /// planes are read only if the source is sequential. REQUIRES: neither ever decreases; z_end -
    /// z_begin <= planes.
    void load(std::int64_t z_begin, std::int64_t z_end);
    /// Reads ahead up to z_end, or as far as there is space, without releasing anything.
    void prefetch(std::int64_t z_end);
    /// Row y of plane z. REQUIRES: z is available, and y lies in the part.
    [[nodiscard]] const std::byte* row(std::int64_t y, std::int64_t z) const {
        return base_ + static_cast<std::size_t>(((z - first_plane_) % capacity_) * plane_bytes_ +
                                                (y - first_row_) * row_bytes_);
    }
    [[nodiscard]] bool on_disk() const { return spool_.has_value(); }
    [[nodiscard]] std::uint64_t heap() const { return ring_bytes_; }
    /// Bytes read so far; for a map, all bytes of the part.
    [[nodiscard]] std::uint64_t bytes_read() const { return bytes_read_; }

  private:
    void spool(std::uint64_t budget, const std::filesystem::path& folder);
    void read_until(std::int64_t z_end);

    VolumeSource& source_;
    VolumePart part_;
    VolumeSource::Granularity step_;
    Progress& progress_;
    std::int64_t row_bytes_;
    std::int64_t plane_bytes_;      ///< from one plane to the next
    std::int64_t first_row_;        ///< the first row of a plane in memory
    std::int64_t first_plane_ = 0;  ///< the first plane in that memory
    std::int64_t capacity_ = 1;
    std::int64_t begin_ = 0;
    std::int64_t end_ = 0;
    std::unique_ptr<std::byte[]> ring_;
    std::uint64_t ring_bytes_ = 0;
    std::optional<ScratchFile> spool_;
    bool whole_ = false;  ///< all planes of the part are available: mapped or spooled
    std::uint64_t bytes_read_ = 0;
    const std::byte* base_ = nullptr;
};

}  // namespace isonest::detail
