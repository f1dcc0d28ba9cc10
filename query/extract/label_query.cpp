#include <isonest/error.h>
#include <isonest/extract.h>

#include "query/extract/combinations.h"

namespace isonest {

LabelQuery label_query(const SurfaceQuery& like, const LabelChoice& label) {
    using detail::Wish;
    detail::Wishes wishes = detail::wishes_of(like);
    wishes.set(static_cast<std::size_t>(Wish::label));
    detail::require_combination(wishes, {});
    LabelQuery query;
    query.label = label;
    if (const auto* const distance = std::get_if<DistanceBound>(&like.stop)) {
        query.stop = *distance;
    } else if (const auto* const budget = std::get_if<TriangleBudget>(&like.stop)) {
        query.stop = *budget;
    }
    query.box = like.box;
    query.cells = like.grid.cells;
    query.attributes = like.attributes;
    query.stages = like.stages;
    return query;
}

}  // namespace isonest
