// https://github.com/google/neuroglancer/blob/master/src/datasource/precomputed/sharded.md
#include "query/neuroglancer/shards.h"

#include <fmt/format.h>

#include <algorithm>

#include "store/files/output_file.h"

namespace isonest::detail {

Sharding Sharding::of(std::uint64_t labels) {
    constexpr std::uint64_t kMaxLabels = 128;
    Sharding sharding;
    while (labels > kMaxLabels << sharding.shard_bits) {
        ++sharding.shard_bits;
    }
    return sharding;
}

std::string Sharding::file_name(std::uint64_t shard) const {
    // As many hexadecimal digits as the largest number of a shard has.
    return fmt::format("{:0{}x}.shard", shard, std::max((shard_bits + 3) / 4, 1));
}

std::string Sharding::json() const {
    return fmt::format(
        R"({{"@type": "neuroglancer_uint64_sharded_v1", "preshift_bits": 0, "hash": "identity", )"
        R"("minishard_bits": 0, "shard_bits": {}, "minishard_index_encoding": "raw", )"
        R"("data_encoding": "raw"}})",
        shard_bits);
}

void Shards::add(std::uint64_t label, std::span<const std::byte> fragments,
                 std::span<const std::byte> manifest) {
    const std::lock_guard lock(mutex_);
    bytes_.write_at(end_, fragments);
    bytes_.write_at(end_ + fragments.size(), manifest);
    meshes_.append({label, end_, fragments.size(), manifest.size(), 0});
    end_ += fragments.size() + manifest.size();
}

Sharding Shards::write(const std::filesystem::path& folder) {
    bytes_.map(end_);
    meshes_.seal();
    const std::span<Mesh> meshes = meshes_.all();
    const Sharding sharding = Sharding::of(meshes.size());
    for (Mesh& mesh : meshes) {
        mesh.shard = sharding.shard_of(mesh.label);
    }
    std::sort(meshes.begin(), meshes.end(), [](const Mesh& a, const Mesh& b) {
        return a.shard != b.shard ? a.shard < b.shard : a.label < b.label;
    });
    for (std::size_t from = 0; from < meshes.size();) {
        std::size_t to = from + 1;
        while (to < meshes.size() && meshes[to].shard == meshes[from].shard) {
            ++to;
        }
        write_shard(folder / sharding.file_name(meshes[from].shard),
                    meshes.subspan(from, to - from));
        from = to;
    }
    return sharding;
}

/// The shard's index, then fragments and manifest of each mesh, then the minishard's index.
void Shards::write_shard(const std::filesystem::path& file, std::span<const Mesh> meshes) const {
    const auto number = [](AppendedFile& to, std::uint64_t n) {
        to.add(std::as_bytes(std::span(&n, 1)));
    };
    std::uint64_t size = 0;
    for (const Mesh& mesh : meshes) {
        size += mesh.fragments + mesh.manifest;
    }
    constexpr std::uint64_t kNumbers = 3;  // of a mesh in the minishard's index
    AppendedFile output(file);
    number(output, size);
    number(output, size + meshes.size() * kNumbers * sizeof(std::uint64_t));
    for (const Mesh& mesh : meshes) {
        output.add(
            bytes_.as<const std::byte>().subspan(mesh.first, mesh.fragments + mesh.manifest));
    }
    std::uint64_t before = 0;
    for (const Mesh& mesh : meshes) {
        number(output, mesh.label - before);
        before = mesh.label;
    }
    // A manifest starts this far behind the end of the previous one: the fragments precede it.
    for (const Mesh& mesh : meshes) {
        number(output, mesh.fragments);
    }
    for (const Mesh& mesh : meshes) {
        number(output, mesh.manifest);
    }
    output.publish();
}

}  // namespace isonest::detail
