#include "query/apart/manifold.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <limits>
#include <numeric>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "store/base/box.h"
#include "store/base/vectors.h"

namespace isonest::detail {
namespace {

constexpr std::uint64_t kAskEvery = std::uint64_t{1} << 13U;
constexpr std::size_t kCopiesAtOnce = std::size_t{1} << 13U;

// A corner is 3 * triangle + place. It also stands for the side of its triangle that begins there.

constexpr std::uint64_t kNoSide = std::numeric_limits<std::uint64_t>::max();

std::uint64_t following(std::uint64_t corner) {
    return corner % 3 == 2 ? corner - 2 : corner + 1;
}
std::uint64_t preceding(std::uint64_t corner) {
    return corner % 3 == 0 ? corner + 2 : corner - 1;
}

/// A list in a temporary file.
template <class T>
class FileList {
  public:
    explicit FileList(const ScratchFolder& folder) : file_(folder) {}
    void push_back(const T& value) {
        if (size_ == file_.as<T>().size()) {
            file_.map(std::max<std::uint64_t>(2 * size_, 1024) * sizeof(T));
        }
        file_.as<T>()[size_++] = value;
    }
    [[nodiscard]] std::span<T> all() const { return file_.as<T>().first(size_); }

  private:
    ScratchFile file_;
    std::size_t size_ = 0;
};

/// A list of numbers of a fixed size, all 0 at first: in the heap if it is short, else in a file.
class NumberList {
  public:
    NumberList(std::uint64_t size, bool in_heap, const ScratchFolder& folder) {
        if (in_heap) {
            heap_.resize(size);
            all_ = heap_;
        } else {
            file_.emplace(folder);
            file_->map(size * sizeof(std::uint64_t));
            all_ = file_->as<std::uint64_t>();
        }
    }
    std::uint64_t& operator[](std::uint64_t i) const { return all_[i]; }

  private:
    std::vector<std::uint64_t> heap_;
    std::optional<ScratchFile> file_;
    std::span<std::uint64_t> all_;
};

/// The triangles around all vertices of a mesh, in a chain for each.
class AllStars {
  public:
    AllStars(std::uint64_t vertices, const CornerView& corners, const ScratchFolder& folder,
             const Progress& progress)
        : vertices_(vertices),
          corners_(corners),
          first_(vertices, corners.size() <= kManifoldInHeap, folder),
          next_(3 * corners.size(), corners.size() <= kManifoldInHeap, folder) {
        std::uint64_t corner = 0;
        for (const ElementCorners& triangle : corners) {
            if (corner % (3 * kAskEvery) == 0) {
                progress.check();
            }
            for (const std::uint64_t v : triangle) {
                next_[corner] = first_[v];
                first_[v] = ++corner;
            }
        }
    }

    /// The corners at a vertex, ascending.
    void corners_of(std::uint64_t v, std::vector<std::uint64_t>& at) const {
        at.clear();
        for (std::uint64_t link = first_[v]; link != 0; link = next_[link - 1]) {
            at.push_back(link - 1);
        }
        std::reverse(at.begin(), at.end());
    }
    [[nodiscard]] std::uint64_t vertex(std::uint64_t corner) const {
        return corners_[corner / 3][corner % 3];
    }
    /// Whether a walk from triangle to triangle comes to all corners of a vertex and back to the
    /// first: they are one closed fan, and no edge there has more than two triangles.
    [[nodiscard]] bool is_ring(std::span<const std::uint64_t> at) {
        ends_.resize(at.size());
        for (std::size_t i = 0; i < at.size(); ++i) {
            ends_[i] = vertex(following(at[i]));
        }
        std::size_t here = 0;
        for (std::size_t steps = 1; steps <= at.size(); ++steps) {
            const std::uint64_t end = vertex(preceding(at[here]));
            here = static_cast<std::size_t>(std::find(ends_.begin(), ends_.end(), end) -
                                            ends_.begin());
            if (here == at.size()) {
                return false;
            }
            if (here == 0) {
                return steps == at.size();
            }
        }
        return false;
    }
    /// Calls use(v, corners) for all vertices with triangles, except for is_ring().
    template <class Use>
    void each_but_rings(const Progress& progress, const Use& use) {
        std::vector<std::uint64_t> at;
        for (std::uint64_t v = 0; v < vertices_; ++v) {
            if (v % kAskEvery == 0) {
                progress.check();
            }
            corners_of(v, at);
            if (!at.empty() && !is_ring(at)) {
                use(v, std::span<const std::uint64_t>(at));
            }
        }
    }

  private:
    std::uint64_t vertices_;
    CornerView corners_;
    NumberList first_;  ///< corners, counted from 1; 0: the end of a chain
    NumberList next_;
    std::vector<std::uint64_t> ends_;  ///< for is_ring()
};

/// The sides from a vertex and to it.
class SidesAt {
  public:
    struct Side {
        std::uint64_t other;  ///< the vertex at the other end
        std::uint64_t side;
        bool is_out;
        auto operator<=>(const Side&) const = default;
    };

    void find(const AllStars& stars, std::span<const std::uint64_t> at) {
        sides_.clear();
        for (const std::uint64_t corner : at) {
            const std::uint64_t before = preceding(corner);
            sides_.push_back({stars.vertex(following(corner)), corner, true});
            sides_.push_back({stars.vertex(before), before, false});
        }
        std::sort(sides_.begin(), sides_.end());
    }
    /// Calls use(other, sides) for each vertex at the other end of an edge.
    template <class Use>
    void each_edge(const Use& use) const {
        for (std::size_t first = 0; first < sides_.size();) {
            std::size_t last = first;
            while (last < sides_.size() && sides_[last].other == sides_[first].other) {
                ++last;
            }
            use(sides_[first].other, std::span(sides_).subspan(first, last - first));
            first = last;
        }
    }

  private:
    std::vector<Side> sides_;
};

/// Sets of corners at one vertex.
class CornerSets {
  public:
    void start(std::span<const std::uint64_t> at) {
        at_ = at;
        parent_.resize(at.size());
        std::iota(parent_.begin(), parent_.end(), std::size_t{0});
    }
    void unite(std::uint64_t a, std::uint64_t b) {
        detail::unite(std::span(parent_), place_of(a), place_of(b));
    }
    /// Numbers the sets in the order of their first corners. Returns how many there are.
    std::size_t number() {
        std::size_t count = 0;
        number_.resize(at_.size());
        for (std::size_t i = 0; i < at_.size(); ++i) {
            const std::size_t root = root_of(std::span(parent_), i);
            number_[i] = root == i ? count++ : number_[root];
        }
        return count;
    }
    /// REQUIRES: number().
    [[nodiscard]] std::size_t of(std::uint64_t corner) const { return number_[place_of(corner)]; }

  private:
    [[nodiscard]] std::size_t place_of(std::uint64_t corner) const {
        return static_cast<std::size_t>(std::lower_bound(at_.begin(), at_.end(), corner) -
                                        at_.begin());
    }
    std::span<const std::uint64_t> at_;
    std::vector<std::size_t> parent_;
    std::vector<std::size_t> number_;
};

/// The corner at the vertex where the edge is looked at from, of the triangle with this side.
std::uint64_t corner_at(const SidesAt::Side& s) {
    return s.is_out ? s.side : following(s.side);
}

}  // namespace

SharedPlaces shared_places(std::uint64_t vertices, const CornerView& corners,
                           const ScratchFolder& folder, const Progress& progress) {
    AllStars stars(vertices, corners, folder, progress);
    SharedPlaces places;
    SidesAt sides;
    CornerSets fans;
    stars.each_but_rings(progress, [&](std::uint64_t v, std::span<const std::uint64_t> at) {
        sides.find(stars, at);
        fans.start(at);
        sides.each_edge([&](std::uint64_t other, std::span<const SidesAt::Side> edge) {
            places.edges += edge.size() > 2 && other > v ? 1 : 0;
            for (const SidesAt::Side& s : edge.subspan(1)) {
                fans.unite(corner_at(edge[0]), corner_at(s));
            }
        });
        places.vertices += fans.number() > 1 ? 1 : 0;
    });
    return places;
}

namespace {

/// A side of a triangle at an edge with more than two, and the side of the triangle behind it.
struct PairedSide {
    std::uint64_t side = 0;
    std::uint64_t mate = kNoSide;
    auto operator<=>(const PairedSide&) const = default;
};

struct CrowdedEdge {
    std::uint64_t low = 0;  ///< the vertices
    std::uint64_t high = 0;
};

/// Where a triangle is, seen along an edge: its direction around the edge.
struct Around {
    double along = 0;  ///< the direction of the first triangle
    double across = 0;
    std::uint64_t side = 0;
    bool is_out = false;

    [[nodiscard]] int half() const { return across > 0 || (across == 0 && along >= 0) ? 0 : 1; }
    bool operator<(const Around& other) const {
        if (half() != other.half()) {
            return half() < other.half();
        }
        const double turn = along * other.across - across * other.along;
        return turn != 0 ? turn > 0 : side < other.side;
    }
};

class EdgePairs {
  public:
    EdgePairs(const ScratchMesh& mesh, AllStars& stars, const ScratchFolder& folder,
              const Progress& progress)
        : positions_(mesh.positions()), stars_(stars), edges_(folder), pairs_(folder) {
        SidesAt sides;
        stars.each_but_rings(progress, [&](std::uint64_t v, std::span<const std::uint64_t> at) {
            sides.find(stars, at);
            sides.each_edge([&](std::uint64_t other, std::span<const SidesAt::Side> edge) {
                if (edge.size() > 2 && other > v) {
                    edges_.push_back({v, other});
                    pair(v, other, edge);
                }
            });
        });
        std::sort(pairs_.all().begin(), pairs_.all().end());
        for (const CrowdedEdge& edge : edges_.all()) {
            progress.check();
            separate_at(edge);
        }
    }

    /// The fans of the triangles at a vertex, by the pairs; returns how many there are.
    std::size_t fans_of(std::span<const std::uint64_t> at, CornerSets& fans) const {
        fans.start(at);
        for (const std::uint64_t corner : at) {
            const std::uint64_t side = preceding(corner);
            if (const PairedSide* const paired = find(side)) {
                if (paired->mate != kNoSide) {
                    fans.unite(corner, paired->mate);
                }
                continue;
            }
            const std::uint64_t from = stars_.vertex(side);
            const auto mate = std::find_if(at.begin(), at.end(), [&](std::uint64_t c) {
                return stars_.vertex(following(c)) == from;
            });
            if (mate != at.end()) {
                fans.unite(corner, *mate);
            }
        }
        return fans.number();
    }

  private:
    [[nodiscard]] PairedSide* find(std::uint64_t side) const {
        const auto all = pairs_.all();
        const auto at =
            std::lower_bound(all.begin(), all.end(), side,
                             [](const PairedSide& p, std::uint64_t s) { return p.side < s; });
        return at != all.end() && at->side == side ? &*at : nullptr;
    }

    /// Pairs the triangles between which the solid is, which lies behind them: seen against the
    /// edge's direction and counterclockwise, it begins at a triangle whose side leads to `v`.
    void pair(std::uint64_t v, std::uint64_t other, std::span<const SidesAt::Side> edge) {
        const auto vector = [&](std::uint64_t to) {
            Double3 d{};
            for (std::size_t axis = 0; axis < 3; ++axis) {
                d[axis] = static_cast<double>(positions_[to][axis]) -
                          static_cast<double>(positions_[v][axis]);
            }
            return d;
        };
        const Double3 axis = vector(other);
        around_.clear();
        Double3 first{};
        Double3 second{};
        for (const SidesAt::Side& s : edge) {
            const Double3 apex = vector(stars_.vertex(preceding(s.side)));
            if (around_.empty()) {
                second = cross(axis, apex);
                first = cross(second, axis);
            }
            // `first` and `second` have different lengths, which does not change the order.
            around_.push_back({dot(apex, first), dot(apex, second), s.side, s.is_out});
        }
        std::sort(around_.begin(), around_.end());
        // Twice around, because the solid may begin before the first one.
        std::vector<std::size_t> begun;
        std::vector<bool> is_paired(around_.size(), false);
        for (std::size_t i = 0; i < 2 * around_.size(); ++i) {
            const std::size_t here = i % around_.size();
            if (is_paired[here]) {
                continue;
            }
            if (!around_[here].is_out) {
                if (std::find(begun.begin(), begun.end(), here) == begun.end()) {
                    begun.push_back(here);
                }
            } else if (!begun.empty()) {
                add(around_[begun.back()].side, around_[here].side);
                is_paired[here] = is_paired[begun.back()] = true;
                begun.pop_back();
            }
        }
        for (std::size_t i = 0; i < around_.size(); ++i) {
            if (!is_paired[i]) {
                pairs_.push_back({around_[i].side, kNoSide});
            }
        }
    }
    void add(std::uint64_t a, std::uint64_t b) {
        pairs_.push_back({a, b});
        pairs_.push_back({b, a});
    }

    /// Changes pairs of an edge until no two of them are in the same fan at both ends. Each change
    /// divides a fan at either end, so what is separate stays separate.
    void separate_at(const CrowdedEdge& edge) {
        std::vector<std::uint64_t> at_low;
        std::vector<std::uint64_t> at_high;
        stars_.corners_of(edge.low, at_low);
        stars_.corners_of(edge.high, at_high);
        // As many changes as there can be fans.
        for (std::size_t i = 0; i < at_low.size() && change_one(edge, at_low, at_high); ++i) {
        }
    }
    bool change_one(const CrowdedEdge& edge, std::span<const std::uint64_t> at_low,
                    std::span<const std::uint64_t> at_high) {
        // One side of each pair, if possible the one from the lower vertex.
        std::vector<std::uint64_t> chosen;
        for (const std::uint64_t corner : at_low) {
            if (stars_.vertex(following(corner)) == edge.high) {
                chosen.push_back(corner);
            }
        }
        const std::size_t outgoing = chosen.size();
        for (const std::uint64_t corner : at_low) {
            const std::uint64_t before = preceding(corner);
            if (stars_.vertex(before) == edge.high && find(before)->mate == kNoSide) {
                chosen.push_back(before);
            }
        }
        fans_of(at_low, low_);
        fans_of(at_high, high_);
        const auto fans = [&](std::size_t i) {
            const std::uint64_t side = chosen[i];
            const std::uint64_t end = following(side);
            return i < outgoing ? std::pair(low_.of(side), high_.of(end))
                                : std::pair(low_.of(end), high_.of(side));
        };
        for (std::size_t i = 0; i < outgoing; ++i) {
            for (std::size_t k = i + 1; k < chosen.size(); ++k) {
                if (fans(i) == fans(k)) {
                    return exchange(chosen[i], chosen[k], k < outgoing);
                }
            }
        }
        return false;
    }
    /// Exchanges the mates of two sides. Returns false if nothing would change.
    bool exchange(std::uint64_t a, std::uint64_t b, bool both_out) {
        const std::uint64_t mate_a = find(a)->mate;
        const std::uint64_t mate_b = find(b)->mate;
        const auto join = [&](std::uint64_t side, std::uint64_t mate) {
            if (side != kNoSide) {
                find(side)->mate = mate;
            }
            if (mate != kNoSide) {
                find(mate)->mate = side;
            }
        };
        if (!both_out) {  // b is alone and leads the other way
            join(a, b);
            join(kNoSide, mate_a);
            return true;
        }
        if (mate_a == kNoSide && mate_b == kNoSide) {
            return false;
        }
        join(a, mate_b);
        join(b, mate_a);
        return true;
    }

    std::span<const std::array<float, 3>> positions_;
    const AllStars& stars_;
    FileList<CrowdedEdge> edges_;
    FileList<PairedSide> pairs_;
    std::vector<Around> around_;
    CornerSets low_;  ///< for change_one()
    CornerSets high_;
};

}  // namespace

std::uint64_t make_manifold(ScratchMesh& mesh, const ScratchFolder& folder,
                            const Progress& progress) {
    const std::uint64_t vertices = mesh.layout().vertices;
    CornerFile& corners = mesh.changeable_corners();
    AllStars stars(vertices, mesh.corners(), folder, progress);
    const EdgePairs pairs(mesh, stars, folder, progress);
    /// A corner that gets another vertex.
    struct Change {
        std::uint64_t corner;
        std::uint64_t vertex;
    };
    FileList<Change> changes(folder);
    FileList<std::uint64_t> copied(folder);
    CornerSets fans;
    stars.each_but_rings(progress, [&](std::uint64_t v, std::span<const std::uint64_t> at) {
        const std::size_t count = pairs.fans_of(at, fans);
        const std::uint64_t next = vertices + copied.all().size();
        for (const std::uint64_t corner : at) {
            if (const std::size_t fan = fans.of(corner); fan > 0) {
                changes.push_back({corner, next + fan - 1});
            }
        }
        for (std::size_t i = 1; i < count; ++i) {
            copied.push_back(v);
        }
    });
    for (const Change& change : changes.all()) {
        corners.set(change.corner / 3, change.corner % 3, change.vertex);
    }
    std::vector<ScratchMesh::MovedCopy> copies;
    for (const std::uint64_t v : copied.all()) {
        copies.push_back({mesh.positions()[v], v});
        if (copies.size() == kCopiesAtOnce) {
            mesh.add_copies(copies);
            copies.clear();
        }
    }
    mesh.add_copies(copies);
    return copied.all().size();
}

}  // namespace isonest::detail
