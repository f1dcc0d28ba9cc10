// OpenVDB's volumeToMesh, which merges quadrilaterals in flat regions, depending on the number
// "adaptivity" from 0 (none) to 1.
//
// usage: isonest_openvdb_mesh VALUES NX NY NZ SX SY SZ OX OY OZ ISOVALUE ADAPTIVITY OUT.ply
//
// VALUES: NX * NY * NZ float32, x fastest; spacings and origin as in the store, so that the mesh
// has the same place as isonest's. The surface ends in the outermost cells: a mask removes the part
// with which OpenVDB would close it. A quadrilateral is written as two triangles. Prints JSON; the
// seconds are the processor time of the mesher alone.
#include <openvdb/openvdb.h>
#include <openvdb/tools/VolumeToMesh.h>

#include <ctime>

#include "tools/bench/meshes/ply_write.h"

using namespace bench;

namespace {

struct Volume {
    std::array<int, 3> nodes{};
    std::array<double, 3> spacing{};
    std::array<double, 3> origin{};
    std::vector<float> values;
};

Volume read_volume(char** arguments) {
    Volume volume;
    for (std::size_t axis = 0; axis < 3; ++axis) {
        volume.nodes[axis] = std::stoi(arguments[1 + axis]);
        volume.spacing[axis] = std::stod(arguments[4 + axis]);
        volume.origin[axis] = std::stod(arguments[7 + axis]);
    }
    std::size_t count = 1;
    for (const int n : volume.nodes) {
        count *= static_cast<std::size_t>(n);
    }
    volume.values.resize(count);
    std::ifstream file(arguments[0], std::ios::binary);
    file.read(reinterpret_cast<char*>(volume.values.data()),
              static_cast<std::streamsize>(count * sizeof(float)));
    if (!file || file.peek() != std::ifstream::traits_type::eof()) {
        throw std::runtime_error(std::string(arguments[0]) + ": not NX * NY * NZ float32");
    }
    return volume;
}

openvdb::FloatGrid::Ptr grid_of(const Volume& volume) {
    const auto grid = openvdb::FloatGrid::create(volume.values[0]);
    auto accessor = grid->getAccessor();
    std::size_t i = 0;
    for (int z = 0; z < volume.nodes[2]; ++z) {
        for (int y = 0; y < volume.nodes[1]; ++y) {
            for (int x = 0; x < volume.nodes[0]; ++x) {
                accessor.setValue(openvdb::Coord(x, y, z), volume.values[i++]);
            }
        }
    }
    return grid;
}

/// All nodes except those on a face of the box.
openvdb::BoolGrid::Ptr inner_nodes(const Volume& volume) {
    const auto mask = openvdb::BoolGrid::create(false);
    const auto [nx, ny, nz] = volume.nodes;
    mask->denseFill(openvdb::CoordBBox(1, 1, 1, nx - 2, ny - 2, nz - 2), true);
    return mask;
}

}  // namespace

int main(int argc, char** argv) {
    try {
        if (argc != 14) {
            throw std::runtime_error(
                "usage: isonest_openvdb_mesh VALUES NX NY NZ SX SY SZ OX OY OZ ISOVALUE ADAPTIVITY "
                "OUT.ply");
        }
        openvdb::initialize();
        const Volume volume = read_volume(argv + 1);
        const auto grid = grid_of(volume);
        openvdb::tools::VolumeToMesh mesher(std::stod(argv[11]), std::stod(argv[12]));
        mesher.setSurfaceMask(inner_nodes(volume));
        const std::clock_t start = std::clock();
        mesher(*grid);
        const double seconds = static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC;
        Mesh mesh;
        for (std::size_t i = 0; i < mesher.pointListSize(); ++i) {
            const openvdb::Vec3s& p = mesher.pointList()[i];
            Point at{};
            for (std::size_t axis = 0; axis < 3; ++axis) {
                at[axis] = volume.origin[axis] +
                           volume.spacing[axis] * static_cast<double>(p[static_cast<int>(axis)]);
            }
            mesh.points.push_back(at);
        }
        for (std::size_t i = 0; i < mesher.polygonPoolListSize(); ++i) {
            const openvdb::tools::PolygonPool& pool = mesher.polygonPoolList()[i];
            for (std::size_t k = 0; k < pool.numTriangles(); ++k) {
                const openvdb::Vec3I& t = pool.triangle(k);
                mesh.triangles.push_back({t[0], t[1], t[2]});
            }
            for (std::size_t k = 0; k < pool.numQuads(); ++k) {
                const openvdb::Vec4I& q = pool.quad(k);
                mesh.triangles.push_back({q[0], q[1], q[2]});
                mesh.triangles.push_back({q[0], q[2], q[3]});
            }
        }
        write_ply(argv[13], mesh);
        std::printf("{\"triangles\": %zu, \"seconds\": %.3f}\n", mesh.triangles.size(), seconds);
        return 0;
    } catch (const std::exception& error) {
        std::fprintf(stderr, "isonest_openvdb_mesh: %s\n", error.what());
        return 1;
    }
}
