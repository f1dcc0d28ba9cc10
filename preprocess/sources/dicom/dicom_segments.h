// DICOM segmentations (PS3.3, C.8.20): the frames of all segments as one volume of labels.
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

/// REQUIRES: the group is a segmentation. Values are segment numbers, 0 where there is no segment;
/// places without frames between others are 0. The entry `segment` of the index selects a single
/// segment by its number. A fractional segment is a float32 volume from 0 to 1, and must be
/// selected if there are several. `notes` come before those about the frames.
/// Throws Error{unsupported, invalid_argument, corrupt, limit}; read() throws Error{unsupported}
/// if segments overlap.
std::unique_ptr<VolumeSource> open_dicom_segments(const DicomGroup& group,
                                                  const std::vector<std::filesystem::path>& files,
                                                  const SourceOptions& options,
                                                  std::vector<AxisIndex> index,
                                                  std::vector<std::string> notes,
                                                  const std::string& name);

/// Converts a CIELab value as stored (PS3.3, C.10.7.1.1) to the colour space of screens. L, a and b
/// are those of the profile connection space, whose white is D50.
LabelColor color_of_lab(const std::array<std::uint16_t, 3>& lab);

/// Returns the entry of the index about `axis` and removes it. Throws Error{invalid_argument} if
/// there are two or it selects the whole axis.
std::optional<std::int64_t> taken_entry(std::vector<AxisIndex>& index, std::string_view axis,
                                        const std::string& name);

}  // namespace isonest::detail
