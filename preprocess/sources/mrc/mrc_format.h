// MRC/CCP4 maps of electron microscopy and crystallography.
#pragma once

#include "preprocess/sources/volume_format.h"

namespace isonest::detail {

/// Source: https://www.ccpem.ac.uk/mrc_format/mrc2014.php (MRC2014); IMOD's flag for unsigned
/// bytes: https://bio3d.colorado.edu/imod/doc/mrc_format.txt
VolumeFormat mrc_format();

}  // namespace isonest::detail
