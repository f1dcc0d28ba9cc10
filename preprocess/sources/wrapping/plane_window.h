// The planes of the input that the current blocks need: each input byte is read once.
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

/// The map of the file where its bytes can be used as they are; else a sliding window of whole
/// planes in memory if the budget allows it; else a copy of the volume in temporary space on disk,
/// written in the order that the source likes best. Thread-safety: row() from any thread; the rest
/// from one, prefetch() at the same time as row().
class PlaneWindow {
  public:
    /// `planes` is the largest number of planes needed at a time, `budget` the bytes it may hold.
    /// Throws Error{io, limit}.
    PlaneWindow(VolumeSource& source, std::int64_t planes, std::uint64_t budget,
                const std::filesystem::path& scratch_folder, Progress& progress);

    /// The same for a part of the volume alone. REQUIRES: all of it, if the source is sequential.
    PlaneWindow(VolumeSource& source, const VolumePart& part, std::int64_t planes,
                std::uint64_t budget, const std::filesystem::path& scratch_folder,
                Progress& progress);

    /// Makes planes [z_begin, z_end) available; those below z_begin are given up, and
    /// those that were passed over are only read if the source is sequential.
    /// REQUIRES: both only ever grow; z_end - z_begin <= planes.
    void load(std::int64_t z_begin, std::int64_t z_end);
    /// Reads ahead, up to z_end or as far as the space goes, without giving anything up.
    void prefetch(std::int64_t z_end);
    /// Row y of plane z. REQUIRES: z is available, and y in the part.
    [[nodiscard]] const std::byte* row(std::int64_t y, std::int64_t z) const {
        return base_ + static_cast<std::size_t>(((z - first_plane_) % capacity_) * plane_bytes_ +
                                                (y - first_row_) * row_bytes_);
    }
    [[nodiscard]] bool on_disk() const { return spool_.has_value(); }
    [[nodiscard]] std::uint64_t heap() const { return ring_bytes_; }
    /// What was read so far; of a map, all of the part.
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
    std::int64_t first_row_;        ///< in a plane as it lies in memory
    std::int64_t first_plane_ = 0;  ///< at the beginning of that memory
    std::int64_t capacity_ = 1;
    std::int64_t begin_ = 0;
    std::int64_t end_ = 0;
    std::unique_ptr<std::byte[]> ring_;
    std::uint64_t ring_bytes_ = 0;
    std::optional<ScratchFile> spool_;
    bool whole_ = false;  ///< all planes of the part are there: mapped or spooled
    std::uint64_t bytes_read_ = 0;
    const std::byte* base_ = nullptr;
};

}  // namespace isonest::detail
