// Stacks of pictures: a folder or a list of PNG or BMP files, or one of them.
#pragma once

#include "preprocess/sources/volume_format.h"

namespace isonest::detail {

/// Grey ones of 1 to 16 bits, and colours that are grey. Needs libpng.
/// Source: https://www.w3.org/TR/png/
VolumeFormat png_format();

/// Not compressed; grey by a palette, and colours that are grey.
/// Source: https://learn.microsoft.com/windows/win32/gdi/bitmap-storage
VolumeFormat bmp_format();

}  // namespace isonest::detail
