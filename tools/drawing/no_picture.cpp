// Replaces picture.cpp in a build without OSMesa's headers, or with OSMesa disabled.
#include <isonest/error.h>

#include "tools/drawing/picture.h"

namespace isonest::detail::cli {

PictureReport draw_pictures(const PlyMesh& /*mesh*/, const std::vector<PictureView>& /*views*/,
                            const PictureOptions& /*options*/, Progress& /*progress*/) {
    throw Error(ErrorKind::unsupported, "this build cannot draw meshes",
                {{RemedyKind::install_package, "libosmesa6-dev"}});
}

}  // namespace isonest::detail::cli
