// The text header of NRRD files.
#pragma once

#include <array>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <isonest/open_volume.h>

#include "preprocess/sources/label_names/found_labels.h"
#include "preprocess/sources/numbers/raw_layout.h"
#include "preprocess/sources/wrapping/converted_source.h"

namespace isonest::detail {

enum class NrrdEncoding { raw, gzip, bzip2, text, hex };

struct NrrdHeader {
    /// But for `start`, which is the data file's.
    RawLayout layout;
    NrrdEncoding encoding = NrrdEncoding::raw;
    std::optional<StoredNumber> stored = {};  ///< in place of the layout's type
    std::string data_file;                    ///< empty: the data follow the header
    std::uint64_t header_bytes = 0;           ///< with the empty line that ends it
    /// In place of `data_file`: several of them, which have equally many values.
    std::vector<std::string> pieces = {};
    /// Axes that run toward smaller world coordinates; the layout's origin is their low end's.
    std::array<bool, 3> backward{};
    /// Axes that are not along the world's: over the whole volume, nodes lie a tenth of a voxel or
    /// more from where spacings would put them.
    bool oblique = false;
    std::vector<std::string> notes = {};  ///< of its units
    FoundLabels labels = {};              ///< what 3D Slicer says of its segments
    /// Of an oblique volume: the world's step along each axis; zero where the header says none.
    std::array<Double3, 3> steps{};
    /// Along which of x, y and z the header says a spacing.
    std::array<bool, 3> said{};
    /// Axes of the volume that are no directions in space.
    std::array<bool, 3> no_space{};
};

/// Parses the start of an NRRD file. Source: http://teem.sourceforge.net/nrrd/format.html
/// `spacing`: what the steps' lengths are instead of the header's, the first sample staying where
/// it is; of an oblique volume, whose directions it replaces, too. `index`: as choose_axes() takes
/// it. Axes have the names of `labels`, where these are plain; else x, y, z and t in their order,
/// but t for a time, `layer` for 3D Slicer's layers, `list` for other lists and c for components.
/// Lines that the format does not know, fields that come twice and numbers that are none or out of
/// range are errors. Throws Error{corrupt, unsupported}; `name` is used in messages. No I/O.
NrrdHeader parse_nrrd_header(std::string_view text, const std::string& name,
                             const std::optional<Double3>& spacing = {},
                             std::span<const AxisIndex> index = {});

/// Whether the text has the empty line that ends a header.
bool nrrd_header_ends(std::string_view text);

}  // namespace isonest::detail
