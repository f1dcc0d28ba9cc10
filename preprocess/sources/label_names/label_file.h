// Tables of labels that lie beside a volume.
#pragma once

#include <cstdint>
#include <filesystem>
#include <vector>

#include <isonest/label_name.h>

namespace isonest::detail {

/// A text, one label a line:
///
///   ID NAME RED GREEN BLUE [OPACITY]                      FreeSurfer, 3D Slicer (.ctbl)
///   ID RED GREEN BLUE OPACITY VISIBLE MESH "NAME"         ITK-SNAP
///   ID NAME
///
/// Colours are whole numbers from 0 to 255, and a name without quotes is one word; opacity and
/// visibility are not kept. Empty lines and those that begin with # mean nothing. Sources:
/// https://surfer.nmr.mgh.harvard.edu/fswiki/LabelsClutsAnnotationFiles, the head of ITK-SNAP's own
/// files. Gives them by rising ids. Throws Error{corrupt} naming the line for anything else, a
/// label that comes twice, and what a store cannot hold; Error{limit} if it takes more than
/// `max_heap` bytes; Error{not_found, invalid_argument, io}.
std::vector<LabelName> read_label_file(const std::filesystem::path& path, std::uint64_t max_heap);

}  // namespace isonest::detail
