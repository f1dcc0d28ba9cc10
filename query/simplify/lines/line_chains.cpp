#include "query/simplify/lines/line_chains.h"

#include <algorithm>
#include <array>
#include <limits>

namespace isonest::detail {
namespace {

constexpr std::uint64_t kMany = std::numeric_limits<std::uint64_t>::max();
constexpr std::uint64_t kCheckEvery = std::uint64_t{1} << 14U;

/// The segments at each vertex, and which of them are in a chain.
class Adjacency {
  public:
    Adjacency(const ScratchMesh& mesh, const CornerView& segments, const ScratchFolder& folder,
              Progress& progress)
        : corners_(segments), at_file_(folder), taken_file_(folder) {
        at_file_.map(mesh.layout().vertices * sizeof(Two));
        taken_file_.map(corners_.size());
        at_ = at_file_.as<Two>();
        taken_ = taken_file_.as<std::uint8_t>();
        for (std::uint64_t s = 0; s < corners_.size(); ++s) {
            if (s % kCheckEvery == 0) {
                progress.check();
            }
            for (std::size_t end = 0; end < 2; ++end) {
                Two& two = at_[corners_[s][end]];
                if (two[0] == 0) {
                    two[0] = s + 1;
                } else {
                    two[1] = two[1] == 0 ? s + 1 : kMany;
                }
            }
        }
    }
    [[nodiscard]] bool is_passed(std::uint64_t vertex) const {
        return at_[vertex][1] != 0 && at_[vertex][1] != kMany;
    }
    /// Has one segment.
    [[nodiscard]] bool is_open(std::uint64_t vertex) const { return at_[vertex][1] == 0; }
    /// The other segment of a vertex with two.
    [[nodiscard]] std::uint64_t other(std::uint64_t vertex, std::uint64_t segment) const {
        const Two& two = at_[vertex];
        return (two[0] == segment + 1 ? two[1] : two[0]) - 1;
    }
    [[nodiscard]] bool is_taken(std::uint64_t segment) const { return taken_[segment] != 0; }
    void take(std::uint64_t segment) { taken_[segment] = 1; }

  private:
    /// Numbers of segments from 1 on; 0 = none. The second kMany: there are more.
    using Two = std::array<std::uint64_t, 2>;
    CornerView corners_;
    ScratchFile at_file_;
    ScratchFile taken_file_;
    std::span<Two> at_;
    std::span<std::uint8_t> taken_;
};

std::uint32_t least_of(const Adjacency& adjacency, std::uint64_t from, std::uint64_t to,
                       std::uint64_t segments) {
    std::uint64_t least = 1;
    if (from == to) {
        least = 3;
    } else if (!adjacency.is_open(from) && !adjacency.is_open(to)) {
        least = 2;
    }
    return static_cast<std::uint32_t>(std::min(least, segments));
}

}  // namespace

LineChains::LineChains(const ScratchMesh& mesh, const CornerView& segments,
                       const ScratchFolder& folder, Progress& progress)
    : chains_(folder), vertices_(folder) {
    Adjacency adjacency(mesh, segments, folder, progress);
    const auto corners = segments;
    // From `from` along `segment`, to a vertex where no other segment is left.
    const auto follow = [&](std::uint64_t from, std::uint64_t segment) {
        Chain chain;
        chain.first = vertices_.size();
        std::uint64_t at = from;
        while (true) {
            if (vertices_.size() % kCheckEvery == 0) {
                progress.check();
            }
            vertices_.append(at);
            adjacency.take(segment);
            at = corners[segment][corners[segment][0] == at ? 1 : 0];
            if (!adjacency.is_passed(at)) {
                vertices_.append(at);
                chain.vertices = vertices_.size() - chain.first;
                chain.least = least_of(adjacency, from, at, chain.segments());
                break;
            }
            segment = adjacency.other(at, segment);
            if (adjacency.is_taken(segment)) {
                chain.closed = 1;
                chain.vertices = vertices_.size() - chain.first;
                chain.least =
                    static_cast<std::uint32_t>(std::min<std::uint64_t>(chain.vertices, 3));
                break;
            }
        }
        chains_.append(chain);
    };
    for (std::uint64_t s = 0; s < corners.size(); ++s) {
        for (std::size_t end = 0; end < 2; ++end) {
            if (!adjacency.is_taken(s) && !adjacency.is_passed(corners[s][end])) {
                follow(corners[s][end], s);
            }
        }
    }
    for (std::uint64_t s = 0; s < corners.size(); ++s) {
        if (!adjacency.is_taken(s)) {
            follow(corners[s][0], s);
        }
    }
    chains_.seal();
    vertices_.seal();
}

}  // namespace isonest::detail
