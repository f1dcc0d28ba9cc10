// Volume sources: the input of preprocess(), and what check() compares a store with.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <isonest/frame.h>
#include <isonest/int3.h>
#include <isonest/label_name.h>
#include <isonest/length_unit.h>
#include <isonest/remote.h>
#include <isonest/uneven_axes.h>
#include <isonest/value_type.h>

namespace isonest {

class VolumeSource;

/// Where the nodes of a curvilinear grid lie.
struct NodePositions {
    /// Volumes with the nodes of the grid, whose values are their world coordinates x, y and z.
    std::array<std::shared_ptr<VolumeSource>, 3> coordinates;
};

/// Null: the grid is not curvilinear.
using NodePositionsPtr = std::shared_ptr<const NodePositions>;

/// The position in time of a volume that is a part of an array with an axis of times.
struct VolumeTime {
    /// The coordinate on the axis; nullopt if the file gives none.
    std::optional<double> value = {};
    std::string unit = {};   ///< of `value`, as the file spells it ("hours since 2020-01-01")
    std::int64_t steps = 1;  ///< length of the axis
};

/// Description of a volume. Node p lies at origin + the sum over the axes of direction * spacing *
/// p, or along an uneven axis of direction * offset of p. Nodes of a curvilinear grid lie where
/// `curved` says; it has neither a spacing (1), nor an origin (0), nor directions.
struct VolumeDescription {
    Int3 nodes{1, 1, 1};  ///< per axis, each >= 1
    ValueType type = ValueType::f32;
    Double3 spacing{1, 1, 1};  ///< node distance per axis in world units, > 0; uneven axes: mean
    Double3 origin{0, 0, 0};   ///< world position of node (0, 0, 0)
    std::string name = {};     ///< "file:dataset" or the like, for messages
    Directions direction = kAlongWorld;
    /// The values are labels of up to 62 bits, represented as float64 (SourceOptions::labels).
    bool labels = false;
    std::optional<LengthUnit> unit = {};               ///< of spacing and origin; nullopt: unknown
    AnatomicalFrame frame = AnatomicalFrame::unknown;  ///< of origin and direction
    std::optional<VolumeTime> time =
        {};                     ///< nullopt: there is no axis of times, or it is not known
    UnevenAxesPtr uneven = {};  ///< null: all axes are even
    NodePositionsPtr curved = {};
};

/// A scalar volume that is read in slabs of whole or partial planes. Only describe(), identity()
/// and read() must be implemented; the other functions make reading cheaper.
/// Thread-safety: one thread at a time, not necessarily always the same.
class VolumeSource {
  public:
    VolumeSource() = default;
    VolumeSource(const VolumeSource&) = delete;
    VolumeSource& operator=(const VolumeSource&) = delete;
    virtual ~VolumeSource() = default;

    /// Always returns the same description. preprocess() rejects invalid ones (a spacing of 0).
    [[nodiscard]] virtual VolumeDescription describe() const = 0;

    /// Identifies the values, as lines of text of up to 32 KiB: for a file its size, time and
    /// checksums, for memory a digest. A preprocessing run continues an interrupted one only if
    /// both have the same identity. It need not include the name; nodes, type, spacing, origin and
    /// unit are compared separately. A source that cannot identify its values returns "";
    /// PreprocessOptions::resume is then refused.
    [[nodiscard]] virtual std::string identity() const = 0;

    /// Reads rows [y0, y0 + ny) of planes [z0, z0 + nz), whole rows in x, native endianness, x
    /// fastest, tightly packed, into dst (nz * ny * nodes.x * size_of(type) bytes). NaN and
    /// infinities are missing data.
    /// REQUIRES: the range lies inside the volume; ranges come in ascending order if sequential().
    /// Throws Error{io, corrupt}; other exceptions also reach the caller of preprocess().
    virtual void read(std::int64_t z0, std::int64_t nz, std::int64_t y0, std::int64_t ny,
                      std::byte* dst) = 0;

    /// A hint: from the next read() on, these rows of these planes will be read, in pieces and in
    /// ascending order. Replaces the previous hint and returns at once. REQUIRES: as for read().
    virtual void will_read(std::int64_t z0, std::int64_t nz, std::int64_t y0, std::int64_t ny) {
        static_cast<void>(z0), static_cast<void>(nz);
        static_cast<void>(y0), static_cast<void>(ny);
    }

    /// All files that the source reads, including those that only refer to others; none of them may
    /// be the output. The file that was opened comes first.
    [[nodiscard]] virtual std::vector<std::filesystem::path> files() const { return {}; }

    /// Reads are cheap in multiples of this many planes (z) and rows (y), starting at such
    /// multiples; other reads may decode the same input chunk again.
    struct Granularity {
        std::int64_t planes = 1;
        std::int64_t rows = 1;
    };
    [[nodiscard]] virtual Granularity granularity() const { return {}; }

    /// True if reads must come in ascending order without gaps (a gzip stream).
    [[nodiscard]] virtual bool sequential() const { return false; }

    /// Maximum bytes that the source holds besides the destination of read(). They count against
    /// the memory of the call that reads.
    [[nodiscard]] virtual std::uint64_t heap() const { return 1U << 20U; }

    /// What the user should know about changes made to the numbers of the file, or changes that
    /// were not possible: one sentence each, without the final full stop.
    [[nodiscard]] virtual std::vector<std::string> notes() const { return {}; }

    /// Names and colours of labels, by ascending ids, if the input has them and was opened for
    /// labels. preprocess() rejects those that a store cannot hold (label_name.h).
    [[nodiscard]] virtual std::vector<LabelName> label_names() const { return {}; }

    /// What was fetched from a remote volume since it was opened; all 0 for other sources.
    [[nodiscard]] virtual FetchedCounts fetched() const { return {}; }

    /// One line that says why RemoteAccess::cache is off, or why nothing is added to it. Empty: it
    /// works, or there is no cache.
    [[nodiscard]] virtual std::string cache_warning() const { return {}; }

    /// The whole volume as read() would return it, if it lies in memory or in a mapped file,
    /// aligned for its type; else empty.
    [[nodiscard]] virtual std::span<const std::byte> mapped() const { return {}; }
};

}  // namespace isonest
