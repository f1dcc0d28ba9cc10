// TIFF: one file of one or many pages, a folder of files, or a list of them.
#pragma once

#include "preprocess/sources/volume_format.h"

namespace isonest::detail {

/// Also BigTIFF, tiles, and all compressions that the installed libtiff decodes.
/// Sources: TIFF 6.0, https://www.itu.int/itudoc/itu-t/com16/tiff-fx/docs/tiff6.pdf;
/// https://docs.openmicroscopy.org/ome-model/6.2.2/ome-tiff/specification.html (OME-TIFF);
/// https://imagej.net/ij/docs/guide/146-6.html#sub:Image-Types-and-Formats (ImageJ's description).
VolumeFormat tiff_format();

}  // namespace isonest::detail
