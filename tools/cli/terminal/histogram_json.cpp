#include "tools/cli/terminal/histogram_json.h"

#include <cmath>
#include <cstddef>
#include <cstdint>

namespace isonest::detail::cli {

Json histogram_json(const Histogram& h) {
    const auto value = [&](double v) {
        return h.first_label ? Json(*h.first_label + static_cast<std::int64_t>(std::round(v)))
                             : Json(v);
    };
    Json bins = Json::array();
    for (std::size_t k = 0; k < h.nodes.size(); ++k) {
        bins.push_back({{"low", value(h.bins.low[k])},
                        {"nodes", h.nodes[k]},
                        {"cubes", h.cube_level ? Json(h.cubes[k]) : Json()}});
    }
    Json suggested = Json::array();
    for (const SuggestedIsovalue& s : h.suggested) {
        suggested.push_back({{"isovalue", s.isovalue}, {"cubes", s.cubes}});
    }
    return {{"level", h.level},      {"values", h.looked},
            {"missing", h.missing},  {"cube_level", h.cube_level ? Json(*h.cube_level) : Json()},
            {"bins", bins},          {"end", h.nodes.empty() ? Json() : value(h.bins.end)},
            {"suggested", suggested}};
}

}  // namespace isonest::detail::cli
