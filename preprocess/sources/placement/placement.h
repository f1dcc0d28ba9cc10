// Where a volume lies in the world: from the steps between its samples to spacing, origin and
// directions.
#pragma once

#include <array>
#include <string>

#include <isonest/int3.h>
#include <isonest/volume_source.h>

namespace isonest::detail {

struct Placement {
    Double3 spacing{1, 1, 1};
    Double3 origin{0, 0, 0};  ///< of node (0, 0, 0) after the axes are turned around
    Directions direction = kAlongWorld;
    /// Axes whose samples are to be taken from their other end on.
    std::array<bool, 3> backward{};
};

/// `steps`: the world vector from a sample to the next one along x, y and z; a zero vector along an
/// axis of one sample is right angled to the others. `first`: the place of the first sample.
/// Where steps are along the world's axes (all samples within a tenth of a voxel from where
/// spacings alone would put them), so are the directions, and axes that run backward are turned
/// around. Else x is turned around where the steps are left-handed. No I/O.
/// Throws Error{unsupported} for steps that are not orthogonal, again by a tenth of a voxel over
/// the volume, which says the angle and the spacing, and Error{corrupt} for steps of no length or
/// that are no numbers.
Placement place_in_world(const Int3& nodes, std::array<Double3, 3> steps, const Double3& first,
                         const std::string& name);

/// Gives each axis of one node that has no direction one, of length 1, at right angles to the
/// others. Steps that are there stay.
void complete_steps(const Int3& nodes, std::array<Double3, 3>& steps);

/// What is lost of this place where the user gives a spacing in its stead: a rotation, a shear,
/// axes that run backward; a sentence for VolumeSource::notes(). Empty where nothing is lost, and
/// for steps that are none. No I/O.
std::string lost_by_own_spacing(const Int3& nodes, std::array<Double3, 3> steps);

/// The same of a volume whose axes are these: how it is turned.
std::string lost_by_own_spacing(const Directions& direction);

/// The same place for a stream, whose planes cannot be taken from their other end on: where z runs
/// backward along the world's axis it stays as it runs, and x is turned around in its place, so
/// that the directions are half a turn about y. Nothing changes where z does not run backward.
Placement with_z_as_it_runs(const Placement& place, const Int3& nodes);

}  // namespace isonest::detail
