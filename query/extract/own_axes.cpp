#include "query/extract/own_axes.h"

#include <algorithm>
#include <limits>

#include <isonest/error.h>

#include "store/base/rotation.h"

namespace isonest::detail {
namespace {

Focus turned(const Focus& focus, const StoreHeader& header) {
    constexpr double kMost = std::numeric_limits<double>::infinity();
    Focus out = focus;
    out.lo = {kMost, kMost, kMost};
    out.hi = {-kMost, -kMost, -kMost};
    for (unsigned corner = 0; corner < 8; ++corner) {
        Double3 p{};
        for (std::size_t a = 0; a < 3; ++a) {
            p[a] = (corner >> a & 1U) != 0 ? focus.hi[a] : focus.lo[a];
        }
        p = unrotated_about(header.origin, header.direction, p);
        for (std::size_t a = 0; a < 3; ++a) {
            out.lo[a] = std::min(out.lo[a], p[a]);
            out.hi[a] = std::max(out.hi[a], p[a]);
        }
    }
    return out;
}

void require_no_box(const std::optional<WorldBox>& box, const std::string& name) {
    if (box) {
        throw Error(ErrorKind::unsupported, {name},
                    "a box along the world's axes of a volume whose axes are not along them; crop "
                    "the volume when it is preprocessed",
                    {{RemedyKind::leave_out, "box"}});
    }
}

/// What surfaces of values, slices and contours have.
template <class Query>
Query with_places(Query query, const StoreHeader& header, const std::string& name) {
    require_no_box(query.box, name);
    if (query.focus) {
        query.focus = turned(*query.focus, header);
    }
    if (query.camera) {
        query.camera->position =
            unrotated_about(header.origin, header.direction, query.camera->position);
    }
    return query;
}

}  // namespace

WorldPlane in_own_axes(const WorldPlane& plane, const StoreHeader& header) {
    WorldPlane own;
    own.normal = unrotated(header.direction, plane.normal);
    own.offset = plane.offset - dot(plane.normal, header.origin) + dot(own.normal, header.origin);
    return own;
}

SurfaceQuery in_own_axes(SurfaceQuery query, const StoreHeader& header, const std::string& name) {
    query = with_places(std::move(query), header, name);
    if (auto& culling = query.grid.culling) {
        culling->direction = unrotated(header.direction, culling->direction);
    }
    return query;
}
LabelQuery in_own_axes(LabelQuery query, const StoreHeader& /*header*/, const std::string& name) {
    require_no_box(query.box, name);
    return query;
}
SliceQuery in_own_axes(SliceQuery query, const StoreHeader& header, const std::string& name) {
    query = with_places(query, header, name);
    query.plane = in_own_axes(query.plane, header);
    return query;
}
ContourQuery in_own_axes(ContourQuery query, const StoreHeader& header, const std::string& name) {
    query = with_places(std::move(query), header, name);
    query.plane = in_own_axes(query.plane, header);
    return query;
}
GraphQuery in_own_axes(const GraphQuery& /*query*/, const StoreHeader& /*header*/,
                       const std::string& name) {
    throw Error(ErrorKind::unsupported, {name},
                "a graph of data in a plane whose axes are not along the world's; preprocess them "
                "without directions",
                {{RemedyKind::place_in_world, "spacing"}});
}

}  // namespace isonest::detail
