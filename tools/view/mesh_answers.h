// The meshes that the viewer's page asks for.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

#include <isonest/extract.h>

#include "tools/view/error_choice.h"
#include "tools/view/http_messages.h"
#include "tools/view/mesh_request.h"

namespace isonest::detail::view {

/// What one kind of mesh may use.
struct MeshBudget {
    std::uint64_t memory = 0;          ///< of the extraction
    std::uint64_t most_triangles = 0;  ///< of the answer
    int threads = 0;
};

/// Answers one request after the other. Not thread-safe.
class MeshAnswers {
  public:
    MeshAnswers(const Store& store, const MeshBudget& budget, double range)
        : store_(store), budget_(budget), choice_(range) {}

    /// A message as of PROTOCOL.md. Throws what extract() throws, and Error{limit} if the mesh
    /// would be too large.
    HttpAnswer message(const MeshRequest& request, Progress& progress);
    /// The mesh as a file of this ending, in a folder of its own below `scratch`. The same errors.
    HttpAnswer file(const MeshRequest& request, const std::string& ending,
                    const std::filesystem::path& scratch, Progress& progress);

  private:
    /// `rounding`: what a distance leaves for it.
    ExtractReport extract_to(MeshSink& sink, const MeshRequest& request, double rounding,
                             Progress& progress) const;
    [[nodiscard]] double rounding_within(const MeshRequest& request) const;
    HttpAnswer within_triangles(MeshRequest request, std::uint64_t most, double seconds,
                                Progress& progress);
    HttpAnswer within_stop(const MeshRequest& request, Progress& progress);

    const Store& store_;
    MeshBudget budget_;
    ErrorChoice choice_;
};

}  // namespace isonest::detail::view
