// Keeps vertices apart that lie in one place: in the parts of a mesh or, once it was mended, as a
// stage.
#pragma once

#include "query/apart/keep_apart.h"
#include "query/extract/stages/stage.h"

namespace isonest::detail {

/// For keep_apart(), without the mesh's box.
ApartRange apart_range(const ExtractQuery& query);
/// What moves did to coordinates is counted as their rounding.
void count_apart(const ApartVertices& apart, ExtractQuery& query, ExtractReport& report);

/// After fans were split and triangles mended. Else parts_apart.h does it.
class ApartStage : public Stage {
  public:
    using Stage::Stage;
    [[nodiscard]] bool has_work(const PartStore& parts) const override {
        return parts.is_to_be_mended();
    }
    void run(StageMesh& mesh, ExtractReport& report) override;
};

}  // namespace isonest::detail
