// The positions of nodes from variables with two or three axes that a variable's attribute
// `coordinates` names: the CF conventions (sections 5.2 and 5.6), https://cfconventions.org
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <isonest/int3.h>
#include <isonest/volume_source.h>

namespace isonest::detail {

/// A variable that `coordinates` names.
struct CfCoordinate {
    std::string name;
    std::vector<std::int64_t> lengths;  ///< of its axes, slowest first
    std::string units = {};             ///< attributes; empty if there are none
    std::string standard_name = {};
    std::string axis = {};
    std::string positive = {};
};

/// The names of the variables that give the nodes their positions.
struct CfPositions {
    std::string x;
    std::string y;
    std::string z;  ///< with three axes, or empty
};

/// The words of the attribute `coordinates`.
std::vector<std::string> words_of(const std::string& text);

/// Longitude (or the projected x) and latitude (y) among `named`, if they have the axes y and x of
/// the volume or z, y and x; with a vertical coordinate that has all three. Nullopt if there are
/// none. `nodes`: of the volume.
std::optional<CfPositions> choose_positions(const std::vector<CfCoordinate>& named,
                                            const Int3& nodes);

/// Opens a variable as a volume of its own.
using OpenCoordinate = std::function<std::unique_ptr<VolumeSource>(const std::string& name)>;

/// The positions of the nodes. `heights`: those of the planes, used if `chosen` has no z; if they
/// are not one for each plane, its number is the height, and `notes` gets a sentence about it.
/// Throws what `open` throws, and Error{corrupt} for variables of other sizes.
NodePositionsPtr cf_positions(const CfPositions& chosen, const Int3& nodes,
                              const std::vector<double>& heights, const OpenCoordinate& open,
                              const std::string& name, std::vector<std::string>& notes);

}  // namespace isonest::detail
