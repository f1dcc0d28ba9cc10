// Indicators of the caller: a number for every refinement node, which preprocess() saturates and
// stores like its own.
#pragma once

#include <array>
#include <filesystem>
#include <functional>
#include <span>
#include <string>

#include <isonest/int3.h>
#include <isonest/progress.h>
#include <isonest/volume_source.h>

namespace isonest {

/// An element that is bisected at a refinement node: a tetrahedron; a triangle or an edge if the
/// volume has one node along one or two axes.
struct RefinedElement {
    /// Nodes of the finest lattice; the first two are the ends of the refinement edge. The last
    /// node of a level may lie outside the volume; it has the value of the nearest node.
    std::array<Int3, 4> vertices;
    std::array<double, 4> values{};
    int count = 4;  ///< number of vertices: 4, 3 or 2
};

/// A node at which elements are bisected, with its diamond.
struct RefinementNode {
    Int3 node;                 ///< of the finest lattice; may lie outside the volume, like vertices
    int level = 1;             ///< of its elements, from 1 (finest)
    int odd_axes = 3;          ///< 1: midpoint of an edge; 2: centre of a face; 3: centre of a cube
    double value = 0;          ///< U(x)
    std::array<Int3, 2> ends;  ///< x1, x2, the ends of the refinement edge
    std::array<double, 2> end_values{};         ///< U(x1), U(x2)
    std::span<const RefinedElement> elements;   ///< all elements that are bisected here, 1 to 8
    const VolumeDescription* volume = nullptr;  ///< nodes, place, spacing

    /// U_delta(x) = U(x) - (U(x1) + U(x2)) / 2.
    [[nodiscard]] double offset() const { return value - (end_values[0] + end_values[1]) / 2; }
};

/// An indicator of the caller. It becomes the fields "own:NAME_bar" and "own:NAME_plus"
/// (own_field()), saturated from fine to coarse: bar(x) = max(eta(x), max bar(c)), plus(x) = eta(x)
/// + max plus(c) over the children c of x.
struct OwnIndicator {
    std::string name;  ///< NAME, as own_field() accepts it
    /// Writes eta >= 0, or +inf, for each of the nodes; they belong to one level and one kind. At
    /// nodes that touch a missing value (x or a vertex of an element is NaN or infinite) it is not
    /// called, and eta is +inf.
    ///
    /// Called from several threads at once, in any order, and several times for the same node;
    /// eta may depend on nothing but the node. The pointers are valid during the call only. What it
    /// throws reaches the caller of preprocess().
    std::function<void(std::span<const RefinementNode> nodes, std::span<double> eta)> eta;
    /// Identifies the function: PreprocessOptions::resume continues a run only if this is the same,
    /// and refuses "".
    std::string identity = {};
};

/// An indicator from a function of one node. The same rules as for OwnIndicator::eta.
OwnIndicator own_indicator(std::string name, std::function<double(const RefinementNode&)> eta,
                           std::string identity = {});

/// An indicator from a volume of numbers: eta(x) is the number of node x (of the nearest node,
/// where x lies outside). `numbers` has as many nodes as the volume that is preprocessed, or
/// preprocess() throws Error{invalid_argument}; place and unit are ignored. It is read once, here,
/// and its bytes are kept in a temporary file without a name in the folder `scratch` until the
/// indicator is destroyed; one that is mapped() is used in place, and must exist as long. The
/// identity is that of `numbers`. Throws what reading throws, and Error{io, cancelled}.
OwnIndicator own_indicator(std::string name, VolumeSource& numbers,
                           const std::filesystem::path& scratch,
                           Progress& progress = silent_progress());

}  // namespace isonest
