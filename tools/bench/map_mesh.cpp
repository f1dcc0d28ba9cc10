// What successive mappings alone leave of a mesh, and how long they take.
//
// usage: isonest_map_mesh IN.ply OUT.ply (--distance D | --triangles N) [--size X,Y,Z]
//                         [--voxel V] [--threads T] [--rounds R] [--carried 1]
//
// IN.ply is a full surface in a volume of X * Y * Z nodes with spacing V (default 1), the first one
// at 0; without --size, of as many nodes as contain the mesh. Borders in the faces of the volume
// are also simplified. D is in the mesh's unit. Prints JSON: triangles before and after, the bound
// of the distance, and processor and wall-clock seconds for the simplification alone, the minimum
// of R rounds (default 1). With --carried, one thread does what rank 0 and the others do for each
// block that another rank maps (query/ranks/rank_mapping.h), except for the messages; for the last
// round, this also prints how long each step takes, in processor seconds, and the bytes sent there
// and back.
#include "query/simplify/collapse/map_mesh.h"

#include <array>
#include <chrono>
#include <cstdio>
#include <ctime>
#include <optional>
#include <span>
#include <string>

#include "query/ranks/packed_patch.h"
#include "store/base/workers.h"
#include "tools/bench/meshes/ply_mesh.h"
#include "tools/bench/meshes/ply_write.h"
#include "tools/bench/run_program.h"

using namespace isonest;
using namespace isonest::detail;

namespace {

struct Options {
    std::string in;
    std::string out;
    double distance = 0;
    std::uint64_t triangles = 0;
    Int3 size{};
    double voxel = 1;
    int threads = 1;
    int rounds = 1;
    bool is_carried = false;
};

/// Maps each block as if another rank did it.
class CarriedMapping : public BlockMapping {
  public:
    enum Step : std::size_t { load, pack, map_there, unpack, use, kSteps };

    void map(const BlockPass& pass, Progress& /*progress*/) override {
        for (std::int64_t i = 0; i < pass.blocks; ++i) {
            mark();
            MappedBlock block = pass.load(i);
            add(load);
            const std::vector<std::byte> sent = packed_patch(block.patch);
            block.patch = {};
            add(pack);
            MappedPatch patch = unpacked_patch(sent);
            const GoneTriangles gone_at = map_patch(patch, pass.limits);
            const std::vector<std::byte> back = packed_result(patch, gone_at);
            add(map_there);
            unpack_result(back, block);
            add(unpack);
            pass.use(i, block);
            add(use);
            bytes_there_ += sent.size();
            bytes_back_ += back.size();
        }
        blocks_ += pass.blocks;
    }
    void print() const {
        std::printf(
            "{\"blocks\": %lld, \"bytes_there\": %llu, \"bytes_back\": %llu, \"load\": %.4f, "
            "\"pack\": %.4f, \"map_there\": %.4f, \"unpack\": %.4f, \"use\": %.4f}\n",
            static_cast<long long>(blocks_), static_cast<unsigned long long>(bytes_there_),
            static_cast<unsigned long long>(bytes_back_), seconds_[load], seconds_[pack],
            seconds_[map_there], seconds_[unpack], seconds_[use]);
    }

  private:
    static double now() {
        timespec t{};
        ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
        return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
    }
    void mark() { last_ = now(); }
    void add(Step step) {
        const double end = now();
        seconds_[step] += end - last_;
        last_ = end;
    }

    double last_ = 0;
    std::array<double, kSteps> seconds_{};
    std::int64_t blocks_ = 0;  ///< in all passes
    std::uint64_t bytes_there_ = 0;
    std::uint64_t bytes_back_ = 0;
};

Options options_of(std::span<char*> arguments) {
    constexpr const char* kUsage =
        "usage: isonest_map_mesh IN.ply OUT.ply (--distance D | --triangles N) [--size X,Y,Z] "
        "[--voxel V] [--threads T] [--rounds R] [--carried 1]";
    Options options;
    for (std::size_t i = 1; i < arguments.size(); ++i) {
        const std::string word = arguments[i];
        if (!word.starts_with("--")) {
            (options.in.empty() ? options.in : options.out) = word;
            continue;
        }
        if (++i == arguments.size()) {
            throw std::runtime_error(kUsage);
        }
        const std::string value = arguments[i];
        if (word == "--distance") {
            options.distance = std::stod(value);
        } else if (word == "--triangles") {
            options.triangles = std::stoull(value);
        } else if (word == "--size") {
            long x = 0;
            long y = 0;
            long z = 0;
            if (std::sscanf(value.c_str(), "%ld,%ld,%ld", &x, &y, &z) != 3) {
                throw std::runtime_error(kUsage);
            }
            options.size = {x, y, z};
        } else if (word == "--voxel") {
            options.voxel = std::stod(value);
        } else if (word == "--threads") {
            options.threads = std::stoi(value);
        } else if (word == "--rounds") {
            options.rounds = std::stoi(value);
        } else if (word == "--carried") {
            options.is_carried = value != "0";
        } else {
            throw std::runtime_error(kUsage);
        }
    }
    if (options.out.empty() || (options.distance > 0) == (options.triangles > 0)) {
        throw std::runtime_error(kUsage);
    }
    return options;
}

void fill(ScratchMesh& mesh, const bench::Mesh& from) {
    MeshLayout layout;
    layout.vertices = from.points.size();
    layout.elements = from.triangles.size();
    mesh.begin(layout);
    std::vector<std::array<float, 3>> positions;
    for (const bench::Point& p : from.points) {
        positions.push_back(
            {static_cast<float>(p[0]), static_cast<float>(p[1]), static_cast<float>(p[2])});
    }
    VertexBatch vertices;
    vertices.positions = positions;
    mesh.add_vertices(vertices);
    std::vector<ElementCorners> corners;
    for (const bench::Triangle& t : from.triangles) {
        corners.push_back({t[0], t[1], t[2]});
    }
    ElementBatch batch;
    batch.corners = corners;
    mesh.add_elements(batch);
    mesh.end();
}

int run(std::span<char*> arguments) {
    const Options options = options_of(arguments);
    bench::Mesh read = bench::read_ply(options.in);
    const ScratchFolder folder = ScratchFolder::metered({});
    ScratchMesh mesh(folder);
    fill(mesh, read);
    WorldLattice lattice;
    lattice.steps = Double3{options.voxel, options.voxel, options.voxel};
    PatchBox box;
    for (int a = 0; a < 3; ++a) {
        const auto axis = static_cast<std::size_t>(a);
        double most = 0;
        for (const bench::Point& p : read.points) {
            most = std::max(most, p[axis] / options.voxel);
        }
        const bool is_given = options.size[a] > 0;
        lattice.nodes[a] = is_given ? options.size[a] : static_cast<std::int64_t>(most) + 2;
        if (is_given) {
            box.lo[axis] = 0;
            box.hi[axis] =
                static_cast<float>(static_cast<double>(options.size[a] - 1) * options.voxel);
        }
    }
    double cpu = 0;
    double seconds = 0;
    Mapped mapped;
    std::vector<bench::Triangle> left;
    std::optional<CarriedMapping> carried;
    Workers(options.threads).execute([&] {
        for (int round = 0; round < options.rounds; ++round) {
            const auto start = std::chrono::steady_clock::now();
            const std::clock_t cpu_start = std::clock();
            MeshMapper mapper(mesh, lattice, box, folder, silent_progress());
            if (options.is_carried) {
                mapper.map_by(carried.emplace());
            }
            mapped = options.distance > 0
                         ? mapper.within(mapper.full(mesh.corners()), options.distance)
                         : mapper.down_to(mapper.full(mesh.corners()), options.triangles,
                                          options.voxel / 4, 1e9);
            const double took =
                static_cast<double>(std::clock() - cpu_start) / static_cast<double>(CLOCKS_PER_SEC);
            const double by_clock =
                std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
            cpu = round == 0 ? took : std::min(cpu, took);
            seconds = round == 0 ? by_clock : std::min(seconds, by_clock);
            const CornerFile corners = mapper.corners(mapped);
            left.clear();
            for (const ElementCorners t : corners.all()) {
                left.push_back({static_cast<std::uint32_t>(t[0]), static_cast<std::uint32_t>(t[1]),
                                static_cast<std::uint32_t>(t[2])});
            }
        }
    });
    const std::size_t before = read.triangles.size();
    read.triangles = left;
    bench::write_ply(options.out, read);
    std::printf(
        "{\"triangles_before\": %zu, \"triangles\": %zu, \"bound\": %.6g, \"cpu\": %.4f, "
        "\"seconds\": %.4f, \"us_per_triangle\": %.3f, \"scratch_bytes\": %llu}\n",
        before, left.size(), mapped.bound, cpu, seconds, 1e6 * cpu / static_cast<double>(before),
        static_cast<unsigned long long>(folder.meter()->peak()));
    if (carried) {
        carried->print();
    }
    return 0;
}

}  // namespace

int main(int argc, char** argv) {
    return bench::run_program("isonest_map_mesh", [&] {
        return run({argv, static_cast<std::size_t>(argc)});
    });
}
