// DICOM segmentations (PS3.3, C.8.20): the frames of segments as one volume of labels.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include <isonest/label_name.h>
#include <isonest/open_volume.h>
#include <isonest/volume_source.h>

#include "preprocess/sources/dicom/dicom_series.h"

namespace isonest::detail {

/// REQUIRES: the group is of a segmentation. Values are the segments' numbers, 0 where none is;
/// places without frames between others are 0. The entry `segment` of the index takes one segment
/// alone, by its number. A fractional segment is a volume of float32 from 0 to 1, and is to be
/// chosen if there are several. `notes` come before those about the frames.
/// Throws Error{unsupported, invalid_argument, corrupt, limit}; read() throws Error{unsupported}
/// where segments overlap.
std::unique_ptr<VolumeSource> open_dicom_segments(const DicomGroup& group,
                                                  const std::vector<std::filesystem::path>& files,
                                                  const SourceOptions& options,
                                                  std::vector<AxisIndex> index,
                                                  std::vector<std::string> notes,
                                                  const std::string& name);

/// The colour of a CIELab value as it is stored (PS3.3, C.10.7.1.1), as screens have it. L, a and b
/// are those of the profile connection space, whose white is D50.
LabelColor color_of_lab(const std::array<std::uint16_t, 3>& lab);

/// The entry of the index about `axis`, taken out of it. Throws Error{invalid_argument} where it
/// comes twice or is the whole axis.
std::optional<std::int64_t> taken_entry(std::vector<AxisIndex>& index, std::string_view axis,
                                        const std::string& name);

}  // namespace isonest::detail
