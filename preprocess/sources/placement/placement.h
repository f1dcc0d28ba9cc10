// The place of a volume in the world: from the steps between its samples to spacing, origin and
// directions.
#pragma once

#include <array>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <isonest/int3.h>
#include <isonest/length_unit.h>
#include <isonest/open_volume.h>
#include <isonest/volume_source.h>

namespace isonest::detail {

// The note about a spacing that the file does not give.

/// The note for a volume whose file does not give the spacing along all of its axes, so that 1 was
/// assumed. `said`: whether it does, along x, y and z. Empty if it does, or if the caller gives a
/// spacing; axes of one node need none.
std::vector<std::string> note_of_spacing(const std::array<bool, 3>& said, const Int3& nodes,
                                         const SourceOptions& options);

/// `inner`, whose file gives no spacing at all, with that note.
std::unique_ptr<VolumeSource> without_spacing(std::unique_ptr<VolumeSource> inner,
                                              const SourceOptions& options);

struct Placement {
    Double3 spacing{1, 1, 1};
    Double3 origin{0, 0, 0};  ///< of node (0, 0, 0), after axes are reversed
    Directions direction = kAlongWorld;
    /// Axes whose samples are to be read in reverse order.
    std::array<bool, 3> backward{};
};

/// `steps`: the world vector from one sample to the next along x, y and z; for an axis with one
/// sample it is replaced by one at right angles to the others. `first`: the place of the first
/// sample. If the steps are along the world's axes (all samples within a tenth of a voxel from
/// where spacings alone would put them), the directions are set to these axes, and axes that run
/// backward are reversed. Otherwise, x is reversed if the steps are left-handed. If the steps are
/// at right angles, again within a tenth of a voxel over the volume, the directions are made
/// exactly orthogonal; otherwise they are those of the steps. No I/O. Throws Error{unsupported} for
/// steps that lie nearly in a plane, and Error{corrupt} for steps of zero length or that are not
/// finite.
Placement place_in_world(const Int3& nodes, std::array<Double3, 3> steps, const Double3& first,
                         const std::string& name);

/// Gives each axis with one node and no direction a step of length 1 at right angles to the others.
/// Existing steps stay.
void complete_steps(const Int3& nodes, std::array<Double3, 3>& steps);

/// What is lost of this place if the user gives a spacing instead: a rotation, a shear, axes that
/// run backward; a sentence for VolumeSource::notes(). Empty if nothing is lost, and for invalid
/// steps. No I/O.
std::string lost_by_own_spacing(const Int3& nodes, std::array<Double3, 3> steps);

/// The same for a volume with these axes: how it is rotated and sheared.
std::string lost_by_own_spacing(const Directions& direction);

/// The same place for a stream, whose planes cannot be reversed: if z runs backward along the
/// world's axis it stays so, and x is reversed instead, so that the directions are a half turn
/// about y. No change if z does not run backward.
Placement with_z_as_it_runs(const Placement& place, const Int3& nodes);

// The place of a volume whose axes have coordinates: one number for each node of an axis.

/// What a file says about an axis of the volume.
struct AxisCoordinates {
    std::string name = {};             ///< for messages
    std::vector<double> numbers = {};  ///< one for each node; empty: the file has none
    std::string unit = {};             ///< of the numbers; empty: the file gives none
};

/// Along x, y and z: the coordinates of the nodes, in world units, in any order; empty for axes
/// with even steps.
using UnevenCoordinates = std::array<std::vector<double>, 3>;

/// `inner` with these axes; the place of its first node stays. Returns `inner` itself for null.
/// Throws Error{unsupported} for axes that its nodes cannot have.
std::unique_ptr<VolumeSource> with_uneven_axes(std::unique_ptr<VolumeSource> inner,
                                               UnevenAxesPtr axes);

/// `inner`, whose axes run along the world's or against them, and whose nodes lie at these
/// coordinates along the axes that have any. Returns `inner` itself if no axis has any. Throws
/// Error{unsupported} for coordinates that cannot be those of a volume: some are equal, too close
/// for 32-bit floats, or too many.
std::unique_ptr<VolumeSource> with_uneven_axes(std::unique_ptr<VolumeSource> inner,
                                               UnevenCoordinates coordinates);

/// `inner`, whose nodes lie at these positions instead. Throws Error{unsupported} if it has only
/// one node along an axis, and Error{corrupt} if the positions are not of its nodes.
std::unique_ptr<VolumeSource> with_positions(std::unique_ptr<VolumeSource> inner,
                                             NodePositionsPtr positions);

struct CoordinatePlace {
    /// From one node to the next; negative if the coordinates decrease.
    Double3 step{1, 1, 1};
    Double3 first{0, 0, 0};      ///< where node 0 lies
    std::array<bool, 3> said{};  ///< whether coordinates give the step
    std::optional<LengthUnit> unit = {};
    std::vector<std::string> notes = {};
    UnevenCoordinates uneven = {};
};

/// `axes`: for x, y and z; none where the volume has no such axis. Evenly spaced coordinates place
/// the volume, converted to a common unit of length (axis_choice.h). Coordinates that are finite
/// and not all equal may differ from even ones by up to a tenth of their mean step; if the
/// difference is more than rounding to float32, or a thousandth, explains, a note gives it. If they
/// differ more, the axis is uneven: `uneven` has its coordinates, and its step is their mean. If
/// the caller gives a spacing, it is used in their place, and a note says how far the nodes then
/// lie from their coordinates. Throws Error{unsupported} for uneven coordinates that neither
/// increase nor decrease throughout, with their mean spacing in the message. `name` is for
/// messages.
CoordinatePlace place_by_coordinates(const std::array<std::optional<AxisCoordinates>, 3>& axes,
                                     const Int3& nodes, const SourceOptions& options,
                                     const std::string& name);

}  // namespace isonest::detail
