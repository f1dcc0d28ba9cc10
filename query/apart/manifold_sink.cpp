#include "query/apart/manifold_sink.h"

#include <algorithm>
#include <limits>
#include <utility>

#include "query/apart/manifold.h"

namespace isonest::detail {
namespace {

/// Passes the progress's cancellation on, and nothing else.
class Cancellable : public Progress {
  public:
    explicit Cancellable(const Progress& of) : of_(of) {}
    [[nodiscard]] bool cancelled() const override { return of_.cancelled(); }

  private:
    const Progress& of_;
};

}  // namespace

ManifoldSink::ManifoldSink(MeshSink& sink, TouchingSheets what, ScratchFolder folder,
                           const Progress& progress)
    : sink_(sink), what_(what), folder_(std::move(folder)), progress_(progress) {}

void ManifoldSink::begin(const MeshLayout& layout) {
    layout_ = layout;
    is_first_pass_ = true;
    report_ = {};
    if (!separates()) {
        corners_.reset();
        short_corners_.clear();
        if (layout.elements <= kManifoldInHeap) {
            short_corners_.resize(layout.elements);
        } else {
            corners_ = std::make_unique<CornerFile>(folder_);
            corners_->begin(layout.vertices);
        }
        sink_.begin(layout);
        return;
    }
    // There are at most as many vertices as corners.
    constexpr std::uint64_t kMaxNarrow = std::numeric_limits<std::uint32_t>::max() / 3;
    mesh_ = std::make_unique<ScratchMesh>(folder_, layout.elements < kMaxNarrow
                                                       ? CornerFile::Bits::as_needed
                                                       : CornerFile::Bits::all);
    mesh_->begin(layout);
}

void ManifoldSink::add_vertices(const VertexBatch& batch) {
    (separates() ? *mesh_ : sink_).add_vertices(batch);
}

void ManifoldSink::add_elements(const ElementBatch& batch) {
    if (separates()) {
        mesh_->add_elements(batch);
        return;
    }
    if (is_first_pass_ && corners_ != nullptr) {
        corners_->write(batch.first, batch.corners);
    } else if (is_first_pass_) {
        for (std::size_t i = 0; i < batch.corners.size(); ++i) {
            for (std::size_t k = 0; k < 3; ++k) {
                short_corners_[batch.first + i][k] =
                    static_cast<std::uint32_t>(batch.corners[i][k]);
            }
        }
    }
    sink_.add_elements(batch);
}

bool ManifoldSink::again() {
    is_first_pass_ = false;
    return !separates() && sink_.again();
}

void ManifoldSink::end() {
    if (!separates()) {
        if (corners_ != nullptr) {
            corners_->map(layout_.elements);
        }
        const SharedPlaces found = shared_places(
            layout_.vertices,
            corners_ != nullptr ? corners_->all()
                                : CornerView(std::span<const CornerView::Narrow>(short_corners_)),
            folder_, progress_);
        corners_.reset();
        report_ = {found.edges, found.vertices, 0};
        sink_.end();
        return;
    }
    mesh_->end();
    report_.copies = make_manifold(*mesh_, folder_, progress_);
    const SharedPlaces left =
        shared_places(mesh_->layout().vertices, mesh_->corners(), folder_, progress_);
    report_.edges = left.edges;
    report_.vertices = left.vertices;
    Cancellable silent(progress_);
    sink_.begin(mesh_->layout());
    do {
        emit_vertices(*mesh_, sink_, silent);
        emit_elements(*mesh_, sink_, silent);
    } while (sink_.again());
    sink_.end();
    mesh_.reset();
}

}  // namespace isonest::detail
