#include "preprocess/sources/placement/unsaid_spacing.h"

#include <fmt/format.h>

#include <utility>

#include "preprocess/sources/wrapping/noted_source.h"

namespace isonest::detail {

std::vector<std::string> note_of_spacing(const std::array<bool, 3>& said, const Int3& nodes,
                                         const SourceOptions& options) {
    if (options.spacing) {
        return {};
    }
    std::string unsaid;
    bool partly = false;
    for (std::size_t a = 0; a < 3; ++a) {
        if (nodes[static_cast<int>(a)] == 1) {
            continue;
        }
        if (said.at(a)) {
            partly = true;
        } else {
            unsaid += fmt::format("{}{}", unsaid.empty() ? "" : " and ", "xyz"[a]);
        }
    }
    if (unsaid.empty()) {
        return {};
    }
    return {fmt::format("the file does not say the spacing{}{}: it was taken as 1",
                        partly ? " along " : "", partly ? unsaid : "")};
}

std::unique_ptr<VolumeSource> without_spacing(std::unique_ptr<VolumeSource> inner,
                                              const SourceOptions& options) {
    const Int3 nodes = inner->describe().nodes;
    return with_notes(std::move(inner), note_of_spacing({}, nodes, options));
}

}  // namespace isonest::detail
