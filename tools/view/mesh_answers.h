// The meshes that the viewer's page requests.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>

#include <isonest/extract.h>
#include <isonest/vertex_fields.h>

#include "tools/view/http_messages.h"
#include "tools/view/mesh_request.h"

namespace isonest::detail::view {

// Chooses the error for which a mesh has at most this many triangles, starting from the previous
// choice, because a slider moves in small steps.

/// Errors are steps of half an octave: step k is twice the range / 2^(k / 2); the step after the
/// last is an error of zero.
class ErrorChoice {
  public:
    /// `range`: of the data, >= 0.
    explicit ErrorChoice(double range) : range_(range) {}

    static constexpr int kMaxStep = 48;

    /// One search: make meshes at the error of next() until it returns nothing.
    class Search {
      public:
        /// Once a mesh has few enough triangles, finer ones are tried for this many seconds.
        Search(const ErrorChoice& choice, std::uint64_t most, double seconds);
        /// The error of the next mesh; none if the best one is known.
        [[nodiscard]] std::optional<double> next() const;
        /// Reports the number of triangles and the time of the mesh for next().
        void tried(std::uint64_t triangles, double seconds);
        /// The error of the best mesh so far; none if all had too many triangles.
        [[nodiscard]] std::optional<double> best() const;
        [[nodiscard]] int best_step() const { return best_; }

      private:
        const ErrorChoice* choice_;
        std::uint64_t max_;
        double seconds_;
        int step_;
        int best_ = -1;
        int too_fine_ = kMaxStep + 2;  ///< the coarsest step with too many triangles
        double spent_ = 0;
        bool ended_ = false;
    };

    [[nodiscard]] double error(int step) const;
    /// The result of this search becomes the start of the next one.
    void learn(const Search& search);

  private:
    double range_;
    int start_ = 8;
};

/// Limits for one kind of mesh.
struct MeshBudget {
    std::uint64_t memory = 0;         ///< of the extraction
    std::uint64_t max_triangles = 0;  ///< of the answer
    int threads = 0;
};

/// Answers one request after the other, for one store or for the steps of a series: the search for
/// an error starts from what was learnt from earlier requests, also of other steps. Not
/// thread-safe.
class MeshAnswers {
  public:
    /// `range`: of the values of all these stores.
    MeshAnswers(const MeshBudget& budget, double range) : budget_(budget), choice_(range) {}

    /// A message according to PROTOCOL.md. Throws what extract() throws, and Error{limit} if the
    /// mesh would be too large.
    HttpAnswer message(const Store& store, const MeshRequest& request, Progress& progress);
    /// The mesh as a file with this extension, in its own folder below `scratch`. Throws the same
    /// errors.
    HttpAnswer file(const Store& store, const MeshRequest& request, const std::string& ending,
                    const std::filesystem::path& scratch, Progress& progress);

  private:
    /// `rounding`: part of a distance tolerance that is reserved for rounding.
    struct Extracted {
        ExtractReport report;
        std::optional<VertexFieldReport> color;  ///< of the quantity by which it is coloured
    };
    Extracted extract_to(MeshSink& sink, const Store& store, const MeshRequest& request,
                         double rounding, Progress& progress) const;
    HttpAnswer within_triangles(const Store& store, MeshRequest request, std::uint64_t most,
                                double seconds, Progress& progress);
    HttpAnswer within_stop(const Store& store, const MeshRequest& request, Progress& progress);

    MeshBudget budget_;
    ErrorChoice choice_;
};

}  // namespace isonest::detail::view
