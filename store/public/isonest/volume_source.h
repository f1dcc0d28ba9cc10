// Where a volume comes from: what preprocess() reads, and what check() compares a store with.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <isonest/frame.h>
#include <isonest/int3.h>
#include <isonest/label_name.h>
#include <isonest/length_unit.h>
#include <isonest/remote.h>
#include <isonest/value_type.h>

namespace isonest {

/// What a volume is. Node p lies at origin + the sum over the axes of direction * spacing * p.
struct VolumeDescription {
    Int3 nodes{1, 1, 1};  ///< per axis, each >= 1
    ValueType type = ValueType::f32;
    Double3 spacing{1, 1, 1};  ///< node distance per axis in world units, > 0
    Double3 origin{0, 0, 0};   ///< world position of node (0, 0, 0)
    std::string name = {};     ///< "file:dataset" or the like, for messages
    Directions direction = kAlongWorld;
    /// The values are float64 that stand for labels of up to 62 bits (SourceOptions::labels).
    bool labels = false;
    std::optional<LengthUnit> unit = {};  ///< of spacing and origin; nothing: it is not known
    AnatomicalFrame frame = AnatomicalFrame::unknown;  ///< of origin and direction
};

/// A scalar volume that is read in slabs of whole or partial planes. Three functions are enough:
/// describe(), identity() and read(); the others say what makes reading cheaper.
/// Thread-safety: one thread at a time, not always the same.
class VolumeSource {
  public:
    VolumeSource() = default;
    VolumeSource(const VolumeSource&) = delete;
    VolumeSource& operator=(const VolumeSource&) = delete;
    virtual ~VolumeSource() = default;

    /// Always the same. preprocess() refuses what cannot be (a spacing of 0).
    [[nodiscard]] virtual VolumeDescription describe() const = 0;

    /// What tells these values from any others, as lines of text of up to 32 KiB: for a file its
    /// size, time and checksums, for memory a digest. A preprocessing run only goes on with what an
    /// interrupted one left if that had the same; the name need not be part of it, and nodes, type,
    /// spacing, origin and unit are compared besides. A source that cannot tell returns "": then
    /// PreprocessOptions::resume is refused.
    [[nodiscard]] virtual std::string identity() const = 0;

    /// Reads rows [y0, y0 + ny) of planes [z0, z0 + nz), whole rows in x, native endianness, x
    /// fastest, tightly packed, into dst (nz * ny * nodes.x * size_of(type) bytes). NaN and
    /// infinities are missing data.
    /// REQUIRES: the range lies inside the volume; in ascending order if sequential().
    /// Throws Error{io, corrupt}; what else it throws reaches the caller of preprocess() too.
    virtual void read(std::int64_t z0, std::int64_t nz, std::int64_t y0, std::int64_t ny,
                      std::byte* dst) = 0;

    /// A hint: from the next read() on these rows of these planes are read, in pieces and in
    /// ascending order. Takes the place of the hint before, and returns at once. REQUIRES: as
    /// read().
    virtual void will_read(std::int64_t z0, std::int64_t nz, std::int64_t y0, std::int64_t ny) {
        static_cast<void>(z0), static_cast<void>(nz);
        static_cast<void>(y0), static_cast<void>(ny);
    }

    /// All files that it reads, also those that only say where others are: none of them may be the
    /// output. The one that was opened comes first.
    [[nodiscard]] virtual std::vector<std::filesystem::path> files() const { return {}; }

    /// Reading in multiples of this many planes (z) and rows (y), starting at multiples of it, is
    /// cheap; other reads may decode the same input chunk again.
    struct Granularity {
        std::int64_t planes = 1;
        std::int64_t rows = 1;
    };
    [[nodiscard]] virtual Granularity granularity() const { return {}; }

    /// True if reads must come in ascending order without gaps (a gzip stream).
    [[nodiscard]] virtual bool sequential() const { return false; }

    /// Bytes that the source may hold beside what it reads into: they count against the memory of
    /// the call that reads.
    [[nodiscard]] virtual std::uint64_t heap() const { return 1U << 20U; }

    /// What was done to the numbers of the file, or could not be, that its user should know: a
    /// sentence each, without an end.
    [[nodiscard]] virtual std::vector<std::string> notes() const { return {}; }

    /// What labels are called and how they are drawn, by rising ids, where the input says so and
    /// was opened for labels. preprocess() refuses what a store cannot hold (label_name.h).
    [[nodiscard]] virtual std::vector<LabelName> label_names() const { return {}; }

    /// What was fetched until now of a volume that is elsewhere, from opening it on; all 0 for
    /// others.
    [[nodiscard]] virtual FetchedCounts fetched() const { return {}; }

    /// One line that says why RemoteAccess::cache is off, or why nothing is added to it. Empty: it
    /// works, or there is none.
    [[nodiscard]] virtual std::string cache_warning() const { return {}; }

    /// The whole volume as read() would give it, where it lies in memory or in a map of a file,
    /// aligned for its type; empty where it does not.
    [[nodiscard]] virtual std::span<const std::byte> mapped() const { return {}; }
};

}  // namespace isonest
