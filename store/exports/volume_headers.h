// What stands before the numbers (and behind them) in plain volume files.
#pragma once

#include <string>

#include "store/exports/volume_file.h"

namespace isonest::detail {

/// The numbers follow `before`, little endian, x fastest, and are followed by `behind`.
struct VolumeHeader {
    std::string before;
    std::string behind = {};
};

/// Source: http://teem.sourceforge.net/nrrd/format.html
VolumeHeader nrrd_file_header(const VolumeFileSpec& spec);
/// NIfTI-1; NIfTI-2 where an axis has more than 32767 nodes. World coordinates are the sform.
/// Source: https://nifti.nimh.nih.gov/pub/dist/src/niftilib/nifti1.h, nifti2.h
VolumeHeader nifti_file_header(const VolumeFileSpec& spec);
/// Source: https://docs.vtk.org/en/latest/design_documents/VTKFileFormats.html
VolumeHeader vti_file_header(const VolumeFileSpec& spec);
/// An array [z, y, x], which has no place in the world.
/// Source: https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html
VolumeHeader npy_file_header(const VolumeFileSpec& spec);
/// Source: https://itk.org/Wiki/ITK/MetaIO/Documentation
VolumeHeader meta_image_file_header(const VolumeFileSpec& spec);

}  // namespace isonest::detail
