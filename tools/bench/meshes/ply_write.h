// Writes a binary PLY file that ply_mesh.h reads, for the programs that run other algorithms for
// comparison.
#pragma once

#include "tools/bench/meshes/ply_mesh.h"

namespace bench {

/// Coordinates are rounded to float32, as in isonest's files. Throws std::runtime_error if the file
/// cannot be written.
inline void write_ply(const std::string& path, const Mesh& mesh) {
    std::ofstream file(path, std::ios::binary);
    file << "ply\nformat binary_little_endian 1.0\nelement vertex " << mesh.points.size()
         << "\nproperty float x\nproperty float y\nproperty float z\nelement face "
         << mesh.triangles.size() << "\nproperty list uchar uint vertex_indices\nend_header\n";
    for (const Point& p : mesh.points) {
        const std::array<float, 3> single{static_cast<float>(p[0]), static_cast<float>(p[1]),
                                          static_cast<float>(p[2])};
        file.write(reinterpret_cast<const char*>(single.data()), sizeof single);
    }
    for (const Triangle& t : mesh.triangles) {
        file.put(3);
        file.write(reinterpret_cast<const char*>(t.data()), sizeof t);
    }
    if (!file.flush()) {
        throw std::runtime_error(path + ": cannot be written");
    }
}

}  // namespace bench
