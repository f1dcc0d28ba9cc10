// The stage that simplifies a surface within an error of the values.
#pragma once

#include "query/extract/stages/stage.h"

namespace isonest::detail {

/// The part of the error that the triangles of the nested grid may have before they are simplified.
/// The smaller it is, the more of them there are, and the longer it takes; hardly fewer come out of
/// it (query/DISTANCE.md has figures).
inline constexpr double kNestedShare = 0.75;

/// The part of the error at which the traversal stops: triangles with exact vertices have up to
/// twice the error of their tetrahedra.
constexpr double nested_share(VertexPlace vertices) {
    return vertices == VertexPlace::exact ? kNestedShare / 2 : kNestedShare;
}

/// REQUIRES: stages.error; the volume has a store; the triangles are of a traversal within
/// nested_share() of it.
class ErrorStage : public Stage {
  public:
    using Stage::Stage;
    [[nodiscard]] int threads() const override;
    /// Throws Error{corrupt} too.
    void run(StageMesh& mesh, ExtractReport& report) override;
};

}  // namespace isonest::detail
