// The text header of NRRD files.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <isonest/open_volume.h>

#include "preprocess/sources/numbers/raw_rows.h"
#include "preprocess/sources/wrapping/label_names.h"
#include "preprocess/sources/wrapping/scaled_source.h"

namespace isonest::detail {

// What 3D Slicer says about the segments of a .seg.nrrd file.

/// `keys`: those of the header that begin with "Segment" ("Segment0_Name", "Segment12_Color").
/// Segments of layers other than `layer` are left out; all are if `layer` is empty, because the
/// volume then has several layers.
/// Source: https://slicer.readthedocs.io/en/latest/developer_guide/modules/segmentations.html
FoundLabels labels_of_segments(const std::map<std::string, std::string, std::less<>>& keys,
                               std::optional<std::int64_t> layer);

enum class NrrdEncoding { raw, gzip, bzip2, text, hex };

struct NrrdHeader {
    /// Without `start`, which depends on the data file.
    RawLayout layout;
    NrrdEncoding encoding = NrrdEncoding::raw;
    std::optional<StoredNumber> stored = {};  ///< instead of the layout's type
    std::string data_file;                    ///< empty: the data follow the header
    std::uint64_t header_bytes = 0;           ///< including the empty line that ends it
    /// Several files of equal numbers of values, instead of `data_file`.
    std::vector<std::string> pieces = {};
    /// Axes that run toward smaller world coordinates; the layout's origin is at their low end.
    std::array<bool, 3> backward{};
    /// The axes are not along the world's: over the whole volume, nodes lie a tenth of a voxel or
    /// more from where spacings alone would put them.
    bool oblique = false;
    std::vector<std::string> notes = {};  ///< about its units
    FoundLabels labels = {};              ///< what 3D Slicer says about its segments
    /// For an oblique volume: the step along each axis in world coordinates; zero if the header has
    /// none.
    std::array<Double3, 3> steps{};
    /// Whether the header gives a spacing along x, y and z.
    std::array<bool, 3> said{};
    /// Axes of the volume that are not directions in space.
    std::array<bool, 3> no_space{};
    std::optional<VolumeTime> time = {};  ///< position of the volume; without a coordinate
};

/// Parses the start of an NRRD file. Source: http://teem.sourceforge.net/nrrd/format.html
/// `spacing`: replaces the lengths of the header's steps; the first sample stays where it is. For
/// an oblique volume it also replaces the directions. `index`: as for choose_axes(). Axes are named
/// by `labels` if these are plain; otherwise x, y, z and t in order, but t for a time, `layer` for
/// 3D Slicer's layers, `list` for other lists and c for components. Unknown lines, duplicate
/// fields, and invalid or out-of-range numbers are errors. Throws Error{corrupt, unsupported};
/// `name` is used in messages. No I/O.
NrrdHeader parse_nrrd_header(std::string_view text, const std::string& name,
                             const std::optional<Double3>& spacing = {},
                             std::span<const AxisIndex> index = {});

/// Whether the text contains the empty line that ends a header.
bool nrrd_header_ends(std::string_view text);

}  // namespace isonest::detail
