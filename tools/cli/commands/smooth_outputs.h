// What isonest smooth writes: functions and grids, as volume files or pictures.
#pragma once

#include <filesystem>
#include <optional>
#include <span>
#include <string>

#include <isonest/frame.h>
#include <isonest/int3.h>
#include <isonest/length_unit.h>
#include <isonest/progress.h>

#include "query/finite_elements/node_set.h"
#include "store/lattice/lattice.h"

namespace isonest::detail::cli {

/// Where a function on a lattice lies, and how it is drawn.
struct SmoothedPlace {
    Lattice lattice;
    Double3 spacing{1, 1, 1};
    Double3 origin{0, 0, 0};
    Directions direction = kAlongWorld;
    double low = 0;   ///< value of the first colour
    double high = 1;  ///< of the last
    std::string colors = "viridis";
    int width = 800;  ///< of a picture, pixels
    int height = 800;
    bool force = false;
    std::optional<LengthUnit> unit = {};
    AnatomicalFrame frame = AnatomicalFrame::unknown;
};

/// "dir/name-30.nrrd" for step 30 of "dir/name.nrrd".
std::filesystem::path name_of_step(const std::filesystem::path& path, int step);

/// Values of all nodes: .h5, .nrrd, .raw (float32), or, of data in a plane, .png. Throws Error{io,
/// invalid_argument}.
void write_values(const std::filesystem::path& path, const SmoothedPlace& place,
                  std::span<const float> values);

/// A grid: .h5, .nrrd, .raw (uint8, 1 at active nodes, else 0), or, of data in a plane, a .png with
/// its triangles and these values. Throws Error{io, invalid_argument}.
void write_grid(const std::filesystem::path& path, const SmoothedPlace& place, const NodeSet& grid,
                std::span<const float> values);

/// Throws Error{invalid_argument, not_found, io} if a name of these cannot be written: before any
/// work.
void check_smoothed(const std::filesystem::path& path, const SmoothedPlace& place,
                    const std::vector<std::filesystem::path>& inputs);

}  // namespace isonest::detail::cli
