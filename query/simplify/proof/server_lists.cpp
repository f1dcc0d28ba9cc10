#include "query/simplify/proof/server_lists.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "query/simplify/proof/halves.h"

namespace isonest::detail {
namespace {

constexpr int kMostBack = 4;       ///< fine triangles asked whether they serve their server
constexpr int kMostListCuts = 6;   ///< of a fine triangle, one in the other
constexpr int kMostBackCuts = 10;  ///< of a server
/// A piece of a server with a larger radius, in limits, is cut before anything is near to all of
/// it.
constexpr double kLargePiece = 1.5;

}  // namespace

ServerLists::ServerLists(const Patch& patch, std::span<const std::array<float, 3>> positions,
                         double limit)
    : patch_(patch),
      positions_(positions),
      limit_(limit),
      square_limit_(limit * limit),
      only_(patch.fine.size(), kNoServer),
      served_(patch.triangles.size()),
      gathered_in_(patch.fine.size()),
      measured_in_(patch.positions.size()),
      row_(patch.positions.size()) {}

void ServerLists::set(std::uint32_t fine, std::span<const std::uint32_t> servers) {
    if (servers.size() == 1) {
        only_[fine] = servers.front();
    } else {
        only_[fine] = kSomeServers;
        several_[fine].assign(servers.begin(), servers.end());
    }
    for (const std::uint32_t s : servers) {
        served_[s].push_back(fine);
    }
}

std::span<const std::uint32_t> ServerLists::servers_of(std::uint32_t fine) const {
    if (only_[fine] == kNoServer) {
        return {};
    }
    return only_[fine] == kSomeServers ? std::span<const std::uint32_t>(several_.at(fine))
                                       : std::span(&only_[fine], 1);
}

bool ServerLists::is_changed(std::uint32_t triangle) const {
    return std::find(before_.begin(), before_.end(), triangle) != before_.end();
}

void ServerLists::gather(std::uint32_t server, std::uint32_t place) {
    const std::uint32_t fine = served_[server][place];
    if (gathered_in_[fine] != question_) {
        gathered_in_[fine] = question_;
        gathered_.push_back({fine, server, place});
    }
}

/// The first ones of all lists come first.
void ServerLists::gather(std::span<const std::uint32_t> before) {
    gathered_.clear();
    for (const std::uint32_t server : before) {
        if (!served_[server].empty()) {
            gather(server, 0);
        }
    }
    for (const std::uint32_t server : before) {
        for (std::uint32_t place = 1; place < served_[server].size(); ++place) {
            gather(server, place);
        }
    }
}

double ServerLists::square_to(std::uint32_t vertex, std::size_t server) {
    if (measured_in_[vertex] != question_) {
        measured_in_[vertex] = question_;
        row_[vertex] = static_cast<std::uint32_t>(squares_.size());
        squares_.resize(squares_.size() + changed_, -1);
    }
    double& d = squares_[row_[vertex] + server];
    if (d < 0) {
        d = servers_[server].shape.square_distance_within(patch_.point(vertex), limit_);
    }
    return d;
}

bool ServerLists::serves_alone(const PatchTriangle& t, std::size_t server) {
    double most = 0;
    for (const std::uint32_t v : t) {
        const double d = square_to(v, server);
        if (d > square_limit_) {
            return false;
        }
        most = std::max(most, d);
    }
    worst_ = std::max(worst_, most);
    last_ = server;
    return true;
}

bool ServerLists::fits_cut(const Triangle& t, int depth) {
    const Double3 centre = centroid(t);
    bool any = false;
    for (const Server& server : servers_) {
        const PreparedTriangle& by = server.shape;
        if (by.square_distance_within(centre, limit_) > square_limit_) {
            continue;
        }
        any = true;
        double most = 0;
        for (const Double3& corner : t) {
            most = std::max(most, by.square_distance_within(corner, limit_));
        }
        if (most <= square_limit_) {
            worst_ = std::max(worst_, most);
            if (std::find(found_.begin(), found_.end(), server.triangle) == found_.end()) {
                found_.push_back(server.triangle);
            }
            return true;
        }
    }
    if (!any || depth == kMostListCuts) {
        return false;
    }
    const auto parts = halves(t);
    return fits_cut(parts[0], depth + 1) && fits_cut(parts[1], depth + 1);
}

/// The largest distance of a corner from a triangle; soon, if it is above the limit.
double ServerLists::square_off(const Triangle& t, const Triangle& from) const {
    double most = 0;
    for (std::size_t i = 0; i < 3 && most <= square_limit_; ++i) {
        most = std::max(most, square_distance(t[i], from));
    }
    return most;
}

/// Into servers_: it, and those that have a corner in common with it.
void ServerLists::gather_around(std::uint32_t hint, const CornerMesh& mesh) {
    servers_.clear();
    const auto take = [&](std::uint32_t triangle) {
        if (std::none_of(servers_.begin(), servers_.end(),
                         [&](const Server& s) { return s.triangle == triangle; })) {
            servers_.push_back(
                {triangle, PreparedTriangle(triangle_at(positions_, mesh.corners(triangle)))});
        }
    };
    take(hint);
    for (const std::uint32_t v : mesh.corners(hint)) {
        const std::uint32_t first = mesh.first(v);
        std::uint32_t h = first;
        do {
            take(h / 3);
            h = mesh.turned(h);
        } while (h != CornerMesh::kNone && h != first);
    }
}

bool ServerLists::find(std::uint32_t fine, std::uint32_t hint, const CornerMesh& mesh) {
    const Triangle t = patch_.at(patch_.fine[fine]);
    found_.clear();
    worst_ = 0;
    // What served the last one is near to this one, too, more often than not.
    for (const std::uint32_t server : {hint, found_last_}) {
        if (server == kNoServer) {
            continue;
        }
        const double off = square_off(t, triangle_at(positions_, mesh.corners(server)));
        if (off <= square_limit_) {
            worst_ = off;
            found_.push_back(server);
            break;
        }
    }
    if (found_.empty()) {
        gather_around(hint, mesh);
        if (!fits_cut(t, 0)) {
            return false;
        }
    }
    found_last_ = found_.front();
    largest_ = std::max(largest_, std::sqrt(worst_));
    set(fine, found_);
    return true;
}

bool ServerLists::fits_one(std::uint32_t fine, const CornerMesh& mesh) {
    const PatchTriangle& t = patch_.fine[fine];
    found_.clear();
    for (std::size_t i = 0; i < changed_; ++i) {
        // The one that served the triangle before is near to this one, too, more often than not.
        const std::size_t server = i == 0 ? last_ : i - (i <= last_ ? 1 : 0);
        if (serves_alone(t, server)) {
            found_.push_back(servers_[server].triangle);
            return true;
        }
    }
    for (const std::uint32_t other : servers_of(fine)) {
        if (!is_changed(other)) {
            servers_.push_back(
                {other, PreparedTriangle(triangle_at(positions_, mesh.corners(other)))});
        }
    }
    const bool fits = fits_cut(patch_.at(t), 0);
    servers_.erase(servers_.begin() + static_cast<std::ptrdiff_t>(changed_), servers_.end());
    return fits;
}

bool ServerLists::fits(std::uint32_t moved, std::span<const std::uint32_t> before,
                       std::span<const Server> after, const CornerMesh& mesh) {
    before_ = before;
    servers_.assign(after.begin(), after.end());
    changed_ = after.size();
    last_ = 0;
    ++question_;
    squares_.clear();
    plans_.clear();
    planned_.clear();
    worst_ = 0;
    bool is_near = moved == kNoVertex;
    for (std::size_t i = 0; i < changed_ && !is_near; ++i) {
        is_near = square_to(moved, i) <= square_limit_;
    }
    if (!is_near) {
        return false;
    }
    gather(before);
    for (const auto& [fine, server, place] : gathered_) {
        if (!fits_one(fine, mesh)) {
            std::swap(served_[server][0], served_[server][place]);
            return false;
        }
        plans_.push_back({fine, static_cast<std::uint32_t>(planned_.size()),
                          static_cast<std::uint32_t>(found_.size())});
        planned_.insert(planned_.end(), found_.begin(), found_.end());
    }
    return true;
}

std::optional<double> ServerLists::served_back(const Server& server) const {
    int left = kMostBack;
    for (const Plan& plan : plans_) {
        if (planned_[plan.first] != server.triangle) {
            continue;
        }
        const Triangle fine = patch_.at(patch_.fine[plan.fine]);
        double most = 0;
        for (std::size_t i = 0; i < 3 && most <= square_limit_; ++i) {
            most = std::max(most, square_distance(server.shape.corners()[i], fine));
        }
        if (most <= square_limit_) {
            return std::sqrt(most);
        }
        if (--left == 0) {
            return std::nullopt;
        }
    }
    return std::nullopt;
}

const ServerLists::Sphere& ServerLists::sphere_of(std::uint32_t fine) {
    Sphere& sphere = spheres_[fine];
    if (sphere.radius < 0) {
        const Triangle t = patch_.at(patch_.fine[fine]);
        sphere.centre = centroid(t);
        double radius = 0;
        for (const Double3& corner : t) {
            radius = std::max(radius, square(minus(corner, sphere.centre)));
        }
        sphere.radius = std::sqrt(radius);
    }
    return sphere;
}

/// Whether all of it is near to those of back_ from `begin` to `end`. What a piece is not near to
/// is not asked about parts of it.
bool ServerLists::cover_back(const Triangle& t, std::size_t begin, std::size_t end, int depth) {
    const Double3 centre = centroid(t);
    double radius = 0;
    for (const Double3& corner : t) {
        radius = std::max(radius, square(minus(corner, centre)));
    }
    radius = std::sqrt(radius);
    const bool is_small = radius <= kLargePiece * limit_;
    const std::size_t first = back_.size();
    bool any = false;
    for (std::size_t i = begin; i < end; ++i) {
        const std::uint32_t fine = back_[i];
        const Sphere& sphere = sphere_of(fine);
        const double apart = square(minus(centre, sphere.centre));
        const double reach = limit_ + sphere.radius;
        if (apart > (reach + radius) * (reach + radius)) {
            continue;
        }
        back_.push_back(fine);
        if (!is_small || apart > reach * reach) {
            continue;
        }
        const Triangle by = patch_.at(patch_.fine[fine]);
        double off = square_distance(centre, by);
        if (off > square_limit_) {
            continue;
        }
        any = true;
        off = std::sqrt(off) + radius;
        if (off > limit_) {
            const double square = square_off(t, by);
            if (square > square_limit_) {
                continue;
            }
            off = std::sqrt(square);
        }
        furthest_back_ = std::max(furthest_back_, off);
        std::swap(back_[i], back_[begin]);
        back_.resize(first);
        return true;
    }
    const std::size_t last = back_.size();
    bool is_near = false;
    if (first < last && (any || !is_small) && depth < kMostBackCuts) {
        const auto parts = halves(t);
        is_near = cover_back(parts[0], first, last, depth + 1) &&
                  cover_back(parts[1], first, last, depth + 1);
    }
    back_.resize(first);
    return is_near;
}

std::optional<double> ServerLists::covered_back(const Server& server) {
    spheres_.resize(patch_.fine.size());
    back_.clear();
    // Those that it serves come first.
    for (const bool serves : {true, false}) {
        for (const Plan& plan : plans_) {
            if ((planned_[plan.first] == server.triangle) == serves) {
                back_.push_back(plan.fine);
            }
        }
    }
    furthest_back_ = 0;
    return cover_back(server.shape.corners(), 0, back_.size(), 0) ? std::optional(furthest_back_)
                                                                  : std::nullopt;
}

void ServerLists::take() {
    for (const Gathered& gathered : gathered_) {
        const std::uint32_t fine = gathered.fine;
        if (only_[fine] != kSomeServers) {
            continue;
        }
        const auto of = several_.find(fine);
        for (const std::uint32_t s : of->second) {
            if (!is_changed(s)) {
                auto& served = served_[s];
                served.erase(std::find(served.begin(), served.end(), fine));
            }
        }
        several_.erase(of);
    }
    for (const std::uint32_t i : before_) {
        served_[i].clear();
    }
    for (const Plan& plan : plans_) {
        set(plan.fine, std::span(planned_).subspan(plan.first, plan.count));
    }
    largest_ = std::max(largest_, std::sqrt(worst_));
}

}  // namespace isonest::detail
