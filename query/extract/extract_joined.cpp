#include <isonest/joined_isovalues.h>

#include "query/mesh/joined_meshes.h"

namespace isonest {

void extract_joined(const Store& store, std::span<const double> isovalues,
                    const SurfaceQuery& query, MeshSink& sink,
                    const std::function<void(std::size_t number, const ExtractReport&)>& done,
                    const ExtractOptions& options, Progress& progress) {
    detail::JoinedMeshes joined(sink, isovalues, detail::ScratchFolder::metered(options.scratch));
    extract_isovalues(
        store, isovalues, query, [&](std::size_t i) { return joined.part(i); }, done, options,
        progress);
    joined.emit(progress);
}

}  // namespace isonest
