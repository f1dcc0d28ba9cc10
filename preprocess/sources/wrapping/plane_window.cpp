#include "preprocess/sources/wrapping/plane_window.h"

#include <fmt/format.h>

#include <algorithm>
#include <vector>

#include <isonest/error.h>

namespace isonest::detail {

PlaneWindow::PlaneWindow(VolumeSource& source, std::int64_t planes, std::uint64_t budget,
                         const std::filesystem::path& scratch_folder, Progress& progress)
    : PlaneWindow(source, {0, source.describe().nodes.y, 0, source.describe().nodes.z}, planes,
                  budget, scratch_folder, progress) {}

PlaneWindow::PlaneWindow(VolumeSource& source, const VolumePart& part, std::int64_t planes,
                         std::uint64_t budget, const std::filesystem::path& scratch_folder,
                         Progress& progress)
    : source_(source),
      part_(part),
      step_(source.granularity()),
      progress_(progress),
      row_bytes_(source.describe().nodes.x *
                 static_cast<std::int64_t>(size_of(source.describe().type))),
      plane_bytes_(row_bytes_ * (part.y_end - part.y_begin)),
      first_row_(part.y_begin) {
    if (!source.mapped().empty()) {
        const Int3 nodes = source.describe().nodes;
        base_ = source.mapped().data();
        bytes_read_ = static_cast<std::uint64_t>(plane_bytes_ * (part.z_end - part.z_begin));
        plane_bytes_ = row_bytes_ * nodes.y;
        first_row_ = 0;
        capacity_ = nodes.z;
        whole_ = true;
        return;
    }
    const std::int64_t step = step_.planes;
    first_plane_ = part.z_begin / step * step;
    const std::int64_t nz = part.z_end - first_plane_;
    const std::int64_t affordable = static_cast<std::int64_t>(budget) / plane_bytes_;
    // Reads end at whole steps, and none is split where the ring wraps around.
    const std::int64_t needed = std::min(nz, ceil_div(planes + step - 1, step) * step);
    if (affordable >= needed) {
        // Space for reading ahead: as far as the next planes that are needed at a time.
        const std::int64_t ahead = (2 * planes + step - 1) / step * step;
        capacity_ = std::min(nz, std::max(needed, std::min(ahead, affordable / step * step)));
        ring_bytes_ = static_cast<std::uint64_t>(capacity_ * plane_bytes_);
        ring_ = std::make_unique_for_overwrite<std::byte[]>(ring_bytes_);
        base_ = ring_.get();
    } else {
        spool(budget, scratch_folder);
    }
}

void PlaneWindow::spool(std::uint64_t budget, const std::filesystem::path& folder) {
    const std::int64_t all_planes = part_.z_end - part_.z_begin;
    const std::int64_t all_rows = part_.y_end - part_.y_begin;
    const auto step = step_;
    spool_.emplace(folder);
    std::int64_t planes = std::min(all_planes, step.planes);
    std::int64_t rows = all_rows;
    const auto limit = static_cast<std::int64_t>(std::min<std::uint64_t>(budget, 64U << 20U));
    if (planes * plane_bytes_ > limit) {
        rows = std::min(all_rows, step.rows);
        rows = std::max(rows, limit / (planes * row_bytes_) / step.rows * step.rows);
    } else {
        planes = std::min(all_planes, limit / (planes * plane_bytes_) * planes);
    }
    const std::int64_t piece = planes * rows * row_bytes_;
    if (static_cast<std::uint64_t>(piece) > std::max<std::uint64_t>(budget, 1U << 20U)) {
        throw Error(
            ErrorKind::limit, {source_.describe().name},
            fmt::format("the chunks of the input are so large that reading needs {} MiB at a time",
                        (piece >> 20) + 1),
            {{RemedyKind::more_memory}, {RemedyKind::smaller_input_chunk}});
    }
    std::vector<std::byte> buffer(static_cast<std::size_t>(piece));
    progress_.begin("copy input", static_cast<std::uint64_t>(plane_bytes_ * all_planes), "B");
    // Pieces end at multiples of the step.
    const auto next = [](std::int64_t at, std::int64_t size, std::int64_t begin, std::int64_t end) {
        return size >= end - begin ? end : std::min(end, (at / size + 1) * size);
    };
    for (std::int64_t z = part_.z_begin; z < part_.z_end;) {
        const std::int64_t nz = next(z, planes, part_.z_begin, part_.z_end) - z;
        const std::int64_t behind = std::min(part_.z_end, z + 2 * nz);
        source_.will_read(z, behind - z, part_.y_begin, all_rows);
        for (std::int64_t y = part_.y_begin; y < part_.y_end;) {
            progress_.check();
            const std::int64_t ny = next(y, rows, part_.y_begin, part_.y_end) - y;
            source_.read(z, nz, y, ny, buffer.data());
            for (std::int64_t p = 0; p < nz; ++p) {
                spool_->write_at(static_cast<std::uint64_t>((z + p - part_.z_begin) * plane_bytes_ +
                                                            (y - part_.y_begin) * row_bytes_),
                                 {buffer.data() + p * ny * row_bytes_,
                                  static_cast<std::size_t>(ny * row_bytes_)});
            }
            bytes_read_ += static_cast<std::uint64_t>(nz * ny * row_bytes_);
            progress_.advance(static_cast<std::uint64_t>(nz * ny * row_bytes_));
            y += ny;
        }
        z += nz;
    }
    base_ = spool_->map(static_cast<std::uint64_t>(plane_bytes_ * all_planes)).data();
    first_plane_ = part_.z_begin;
    capacity_ = all_planes;
    whole_ = true;
}

void PlaneWindow::read_until(std::int64_t z_end) {
    const std::int64_t nz = part_.z_end;
    const std::int64_t step = step_.planes;
    while (end_ < std::min(z_end, nz)) {
        // Up to the next multiple of the step, in one read unless the ring wraps around.
        std::int64_t to = std::min(nz, (end_ / step + 1) * step);
        if (step == 1) {
            to = std::min({nz, z_end, end_ + 16});
        }
        to = std::min(to, begin_ + capacity_);
        if (to <= end_) {
            return;
        }
        // Announces up to the following piece; there is always one.
        const std::int64_t behind = std::min(nz, to + std::max<std::int64_t>(to - end_, step));
        source_.will_read(end_, behind - end_, part_.y_begin, part_.y_end - part_.y_begin);
        const std::int64_t slot = (end_ - first_plane_) % capacity_;
        const std::int64_t first = std::min(to - end_, capacity_ - slot);
        source_.read(end_, first, part_.y_begin, part_.y_end - part_.y_begin,
                     ring_.get() + slot * plane_bytes_);
        bytes_read_ += static_cast<std::uint64_t>(first * plane_bytes_);
        end_ += first;
        progress_.check();
    }
}

void PlaneWindow::load(std::int64_t z_begin, std::int64_t z_end) {
    if (whole_) {
        return;
    }
    begin_ = std::max(begin_, z_begin);
    if (end_ < begin_ && !source_.sequential()) {
        const std::int64_t step = step_.planes;
        end_ = begin_ / step * step;
    }
    read_until(z_end);
    if (end_ < std::min(z_end, part_.z_end)) {
        throw Error(ErrorKind::io, {source_.describe().name},
                    "the window is too small; this is a bug");
    }
}

void PlaneWindow::prefetch(std::int64_t z_end) {
    if (whole_) {
        return;
    }
    const std::int64_t step = step_.planes;
    // Only whole steps: a partly read compressed chunk would be decoded twice.
    std::int64_t to = std::min({z_end, begin_ + capacity_, part_.z_end});
    if (to < part_.z_end) {
        to = to / step * step;
    }
    if (to > end_) {
        read_until(to);
    }
}

}  // namespace isonest::detail
