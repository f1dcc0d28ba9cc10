// OpenVDB's volumeToMesh, which merges quadrilaterals where the surface is flat enough for a number
// "adaptivity" from 0 (none) to 1.
//
// usage: isonest_openvdb_mesh VALUES NX NY NZ SX SY SZ OX OY OZ ISOVALUE ADAPTIVITY OUT.ply
//
// VALUES: NX * NY * NZ float32, x fastest; spacings and origin as in the store, so that the mesh
// lies where isonest's does. Outside the box lies a value above or below the isovalue, whichever
// fewer nodes of the box's faces have on the other side of it: the mesh is closed there. A
// quadrilateral is two triangles. Prints JSON; the seconds are the processor time of volumeToMesh
// alone.
#include <openvdb/openvdb.h>
#include <openvdb/tools/VolumeToMesh.h>

#include <ctime>

#include "tools/bench/ply_write.h"

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

openvdb::FloatGrid::Ptr grid_of(const Volume& volume, double iso) {
    const auto [nx, ny, nz] = volume.nodes;
    float least = volume.values[0];
    float most = volume.values[0];
    long above = 0;
    std::size_t i = 0;
    const auto each = [&](const auto& visit) {
        i = 0;
        for (int z = 0; z < nz; ++z) {
            for (int y = 0; y < ny; ++y) {
                for (int x = 0; x < nx; ++x) {
                    visit(openvdb::Coord(x, y, z), volume.values[i++]);
                }
            }
        }
    };
    each([&](const openvdb::Coord& c, float value) {
        least = std::min(least, value);
        most = std::max(most, value);
        const bool face = c.x() == 0 || c.y() == 0 || c.z() == 0 || c.x() == nx - 1 ||
                          c.y() == ny - 1 || c.z() == nz - 1;
        above += face ? (value > iso ? 1 : -1) : 0;
    });
    const auto grid = openvdb::FloatGrid::create(above > 0 ? most : least);
    auto accessor = grid->getAccessor();
    each([&](const openvdb::Coord& c, float value) { accessor.setValue(c, value); });
    return grid;
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
        const double iso = std::stod(argv[11]);
        const auto grid = grid_of(volume, iso);
        std::vector<openvdb::Vec3s> points;
        std::vector<openvdb::Vec3I> triangles;
        std::vector<openvdb::Vec4I> quads;
        const std::clock_t start = std::clock();
        openvdb::tools::volumeToMesh(*grid, points, triangles, quads, iso, std::stod(argv[12]));
        const double seconds = static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC;
        Mesh mesh;
        for (const openvdb::Vec3s& p : points) {
            Point at{};
            for (std::size_t axis = 0; axis < 3; ++axis) {
                at[axis] = volume.origin[axis] +
                           volume.spacing[axis] * static_cast<double>(p[static_cast<int>(axis)]);
            }
            mesh.points.push_back(at);
        }
        for (const openvdb::Vec3I& t : triangles) {
            mesh.triangles.push_back({t[0], t[1], t[2]});
        }
        for (const openvdb::Vec4I& q : quads) {
            mesh.triangles.push_back({q[0], q[1], q[2]});
            mesh.triangles.push_back({q[0], q[2], q[3]});
        }
        write_ply(argv[13], mesh);
        std::printf("{\"triangles\": %zu, \"seconds\": %.3f}\n", mesh.triangles.size(), seconds);
        return 0;
    } catch (const std::exception& error) {
        std::fprintf(stderr, "isonest_openvdb_mesh: %s\n", error.what());
        return 1;
    }
}
