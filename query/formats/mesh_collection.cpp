#include <algorithm>
#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <mutex>
#include <optional>
#include <span>
#include <utility>

#include <isonest/error.h>
#include <isonest/mesh_collection.h>

#include "query/formats/mesh_files.h"
#include "store/base/memory.h"
#include "store/files/output_file.h"
#include "store/files/scratch_file.h"

namespace isonest {
namespace detail {
namespace {

using Corners = std::array<std::uint32_t, 3>;

/// A mesh in the temporary file: positions, attributes, corners.
struct StoredMesh {
    MeshLayout layout = {};
    std::uint64_t positions = 0;
    std::uint64_t rows = 0;
    std::uint64_t corners = 0;
};

}  // namespace
}  // namespace detail

struct MeshCollection::Parts {
    Parts(std::vector<MeshObject> all, std::unique_ptr<detail::MeshFile> to,
          const detail::ScratchFolder& folder)
        : objects(std::move(all)), file(std::move(to)), scratch(folder), meshes(objects.size()) {}

    std::vector<MeshObject> objects;
    std::unique_ptr<detail::MeshFile> file;
    detail::ScratchFile scratch;
    std::atomic<std::uint64_t> end = 0;      ///< of what was stored
    std::vector<detail::StoredMesh> meshes;  ///< of each object
    std::mutex mutex;                        ///< protects the file's prepare()
    std::optional<LengthUnit> unit = {};     ///< as MeshFileOptions::unit
};

namespace detail {
namespace {

class ObjectSink : public MeshSink {
  public:
    ObjectSink(MeshCollection::Parts& parts, std::size_t object)
        : parts_(parts), mesh_(parts.meshes[object]) {}

    void prepare(const MeshLayout& layout, std::span<const std::filesystem::path> inputs) override {
        const std::lock_guard lock(parts_.mutex);
        parts_.file->prepare(layout, inputs);
    }
    void begin(const MeshLayout& layout) override {
        parts_.file->require_bits(32, layout.vertices, "vertices", "a file of several objects");
        mesh_.layout = layout;
        const std::uint64_t positions = aligned(layout.vertices * sizeof(std::array<float, 3>));
        const std::uint64_t rows = aligned(layout.vertices * layout.row_bytes);
        mesh_.positions =
            parts_.end.fetch_add(positions + rows + aligned(layout.elements * sizeof(Corners)));
        mesh_.rows = mesh_.positions + positions;
        mesh_.corners = mesh_.rows + rows;
    }
    void add_vertices(const VertexBatch& batch) override {
        parts_.scratch.write_at(mesh_.positions + batch.first * sizeof(batch.positions[0]),
                                std::as_bytes(batch.positions));
        parts_.scratch.write_at(mesh_.rows + batch.first * batch.row_bytes, batch.attributes);
    }
    void add_elements(const ElementBatch& batch) override {
        std::vector<Corners> corners(batch.corners.size());
        std::transform(batch.corners.begin(), batch.corners.end(), corners.begin(),
                       [](const std::array<std::uint64_t, 3>& c) {
                           return Corners{static_cast<std::uint32_t>(c[0]),
                                          static_cast<std::uint32_t>(c[1]),
                                          static_cast<std::uint32_t>(c[2])};
                       });
        parts_.scratch.write_at(mesh_.corners + batch.first * sizeof(Corners),
                                std::as_bytes(std::span(corners)));
    }
    [[nodiscard]] bool concurrent() const override { return true; }
    [[nodiscard]] bool holds_float64() const override { return parts_.file->holds_float64(); }

  private:
    MeshCollection::Parts& parts_;
    StoredMesh& mesh_;
};

/// The stored rows `begin` to `begin` + `count` of a table.
template <class T>
std::span<const T> stored(std::span<const std::byte> all, std::uint64_t table, std::uint64_t begin,
                          std::uint64_t count) {
    return {reinterpret_cast<const T*>(all.data() + table) + begin,
            static_cast<std::size_t>(count)};
}

void send_mesh(const StoredMesh& mesh, std::span<const std::byte> all, MeshSink& sink,
               Progress& progress) {
    const MeshLayout& layout = mesh.layout;
    for (std::uint64_t at = 0; at < layout.vertices; at += MeshSink::kMaxRows) {
        progress.check();
        const std::uint64_t count =
            std::min<std::uint64_t>(MeshSink::kMaxRows, layout.vertices - at);
        sink.add_vertices(
            {at, stored<std::array<float, 3>>(all, mesh.positions, at, count),
             stored<std::byte>(all, mesh.rows, at * layout.row_bytes, count * layout.row_bytes),
             layout.row_bytes});
    }
    std::vector<std::array<std::uint64_t, 3>> corners;
    for (std::uint64_t at = 0; at < layout.elements; at += MeshSink::kMaxRows) {
        progress.check();
        corners.clear();
        for (const Corners& c :
             stored<Corners>(all, mesh.corners, at,
                             std::min<std::uint64_t>(MeshSink::kMaxRows, layout.elements - at))) {
            corners.push_back({c[0], c[1], c[2]});
        }
        sink.add_elements({at, corners, {}, {}, {}});
        progress.advance(corners.size());
    }
}

}  // namespace
}  // namespace detail

bool MeshCollection::is_supported(const std::filesystem::path& path) {
    const std::string end = detail::lower_extension(path);
    return end == ".glb" || end == ".3mf" || end == ".vtkhdf";
}

MeshCollection::MeshCollection(const std::filesystem::path& path, std::vector<MeshObject> objects,
                               const MeshFileOptions& options,
                               const std::filesystem::path& scratch) {
    if (!is_supported(path)) {
        throw Error(ErrorKind::invalid_argument, {path.string()},
                    "only .glb, .3mf and .vtkhdf files can hold several meshes");
    }
    MeshFileOptions own = options;
    own.title = {};
    own.color = {};
    if (own.unit) {
        detail::require_free_unit(path);
    }
    own.unit.reset();
    std::unique_ptr<MeshSink> file = open_mesh_file(path, own);
    // open_mesh_file() returns such a file.
    std::unique_ptr<detail::MeshFile> meshes(static_cast<detail::MeshFile*>(file.release()));
    parts_ = std::make_unique<Parts>(std::move(objects), std::move(meshes),
                                     detail::ScratchFolder::metered(scratch));
    parts_->unit = options.unit;
}

MeshCollection::~MeshCollection() = default;

std::unique_ptr<MeshSink> MeshCollection::sink(std::size_t object) {
    auto own = std::make_unique<detail::ObjectSink>(*parts_, object);
    return parts_->unit ? detail::converted(std::move(own), *parts_->unit) : std::move(own);
}

void MeshCollection::finish(Progress& progress) {
    std::vector<detail::FileObject> objects;
    std::vector<std::size_t> from;
    std::uint64_t triangles = 0;
    for (std::size_t i = 0; i < parts_->meshes.size(); ++i) {
        const MeshLayout& layout = parts_->meshes[i].layout;
        triangles += layout.elements;
        if (layout.elements > 0) {
            objects.push_back({layout, parts_->objects[i].title, parts_->objects[i].color});
            from.push_back(i);
        }
    }
    progress.begin("write mesh", triangles, "triangles");
    const std::span<const std::byte> all =
        parts_->end > 0 ? parts_->scratch.map(parts_->end) : std::span<std::byte>{};
    parts_->file->begin_all(std::move(objects));
    for (std::size_t i = 0; i < from.size(); ++i) {
        parts_->file->begin_object(i);
        detail::send_mesh(parts_->meshes[from[i]], all, *parts_->file, progress);
        parts_->file->end_object();
    }
    parts_->file->end();
}

}  // namespace isonest
