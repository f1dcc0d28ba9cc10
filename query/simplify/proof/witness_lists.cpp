#include "query/simplify/proof/witness_lists.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "query/simplify/proof/point_triangle.h"

namespace isonest::detail {
namespace {

constexpr int kMaxBack = 4;       ///< fine triangles that are tested for serving their witness
constexpr int kMaxListCuts = 6;   ///< divisions of a fine triangle
constexpr int kMaxBackCuts = 10;  ///< divisions of a witness
/// A piece of a witness with a larger radius, as a multiple of the limit, is divided before testing
/// whether something is near all of it.
constexpr double kLargePiece = 1.5;

}  // namespace

WitnessLists::WitnessLists(const Patch& patch, std::span<const std::array<float, 3>> positions,
                           double limit)
    : patch_(patch),
      positions_(positions),
      limit_(limit),
      square_limit_(limit * limit),
      only_(patch.fine.size(), kNoWitness),
      served_(patch.triangles.size()),
      gathered_in_(patch.fine.size()),
      measured_in_(patch.positions.size()),
      row_(patch.positions.size()) {}

void WitnessLists::set(std::uint32_t fine, std::span<const std::uint32_t> witnesses) {
    if (witnesses.size() == 1) {
        only_[fine] = witnesses.front();
    } else {
        only_[fine] = kSomeWitnesses;
        several_[fine].assign(witnesses.begin(), witnesses.end());
    }
    for (const std::uint32_t s : witnesses) {
        served_[s].push_back(fine);
    }
}

std::span<const std::uint32_t> WitnessLists::witnesses_of(std::uint32_t fine) const {
    if (only_[fine] == kNoWitness) {
        return {};
    }
    return only_[fine] == kSomeWitnesses ? std::span<const std::uint32_t>(several_.at(fine))
                                         : std::span(&only_[fine], 1);
}

bool WitnessLists::is_changed(std::uint32_t triangle) const {
    return std::find(before_.begin(), before_.end(), triangle) != before_.end();
}

void WitnessLists::gather(std::uint32_t witness, std::uint32_t place) {
    const std::uint32_t fine = served_[witness][place];
    if (gathered_in_[fine] != question_) {
        gathered_in_[fine] = question_;
        gathered_.push_back({fine, witness, place});
    }
}

/// The first elements of all lists come first.
void WitnessLists::gather(std::span<const std::uint32_t> before) {
    gathered_.clear();
    for (const std::uint32_t witness : before) {
        if (!served_[witness].empty()) {
            gather(witness, 0);
        }
    }
    for (const std::uint32_t witness : before) {
        for (std::uint32_t place = 1; place < served_[witness].size(); ++place) {
            gather(witness, place);
        }
    }
}

double WitnessLists::square_to(std::uint32_t vertex, std::size_t witness) {
    if (measured_in_[vertex] != question_) {
        measured_in_[vertex] = question_;
        row_[vertex] = static_cast<std::uint32_t>(squares_.size());
        squares_.resize(squares_.size() + changed_, -1);
    }
    double& d = squares_[row_[vertex] + witness];
    if (d < 0) {
        d = witnesses_[witness].shape.square_distance_within(patch_.point(vertex), limit_);
    }
    return d;
}

bool WitnessLists::serves_alone(const PatchTriangle& t, std::size_t witness) {
    double most = 0;
    for (const std::uint32_t v : t) {
        const double d = square_to(v, witness);
        if (d > square_limit_) {
            return false;
        }
        most = std::max(most, d);
    }
    worst_ = std::max(worst_, most);
    last_ = witness;
    return true;
}

bool WitnessLists::fits_cut(const Triangle& t, int depth) {
    const Double3 centre = centroid(t);
    bool any = false;
    for (const Witness& witness : witnesses_) {
        const PreparedTriangle& by = witness.shape;
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
            if (std::find(found_.begin(), found_.end(), witness.triangle) == found_.end()) {
                found_.push_back(witness.triangle);
            }
            return true;
        }
    }
    if (!any || depth == kMaxListCuts) {
        return false;
    }
    const auto parts = halves(t);
    return fits_cut(parts[0], depth + 1) && fits_cut(parts[1], depth + 1);
}

/// The largest squared distance of a corner from a triangle; returns early if it is above the
/// limit.
double WitnessLists::square_off(const Triangle& t, const Triangle& from) const {
    double most = 0;
    for (std::size_t i = 0; i < 3 && most <= square_limit_; ++i) {
        most = std::max(most, square_distance(t[i], from));
    }
    return most;
}

/// Fills witnesses_ with the triangle and those that have a common corner with it.
void WitnessLists::gather_around(std::uint32_t hint, const CornerMesh& mesh) {
    witnesses_.clear();
    const auto take = [&](std::uint32_t triangle) {
        if (std::none_of(witnesses_.begin(), witnesses_.end(),
                         [&](const Witness& s) { return s.triangle == triangle; })) {
            witnesses_.push_back(
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

bool WitnessLists::find(std::uint32_t fine, std::uint32_t hint, const CornerMesh& mesh) {
    const Triangle t = patch_.at(patch_.fine[fine]);
    found_.clear();
    worst_ = 0;
    // The witness of the last triangle is usually near this one, too.
    for (const std::uint32_t witness : {hint, found_last_}) {
        if (witness == kNoWitness) {
            continue;
        }
        const double off = square_off(t, triangle_at(positions_, mesh.corners(witness)));
        if (off <= square_limit_) {
            worst_ = off;
            found_.push_back(witness);
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

bool WitnessLists::fits_one(std::uint32_t fine, const CornerMesh& mesh) {
    const PatchTriangle& t = patch_.fine[fine];
    found_.clear();
    for (std::size_t i = 0; i < changed_; ++i) {
        // The witness of the previous triangle is usually near this one, too.
        const std::size_t witness = i == 0 ? last_ : i - (i <= last_ ? 1 : 0);
        if (serves_alone(t, witness)) {
            found_.push_back(witnesses_[witness].triangle);
            return true;
        }
    }
    for (const std::uint32_t other : witnesses_of(fine)) {
        if (!is_changed(other)) {
            witnesses_.push_back(
                {other, PreparedTriangle(triangle_at(positions_, mesh.corners(other)))});
        }
    }
    const bool fits = fits_cut(patch_.at(t), 0);
    witnesses_.erase(witnesses_.begin() + static_cast<std::ptrdiff_t>(changed_), witnesses_.end());
    return fits;
}

bool WitnessLists::fits(std::uint32_t moved, std::span<const std::uint32_t> before,
                        std::span<const Witness> after, const CornerMesh& mesh) {
    before_ = before;
    witnesses_.assign(after.begin(), after.end());
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
    for (const auto& [fine, witness, place] : gathered_) {
        if (!fits_one(fine, mesh)) {
            std::swap(served_[witness][0], served_[witness][place]);
            return false;
        }
        plans_.push_back({fine, static_cast<std::uint32_t>(planned_.size()),
                          static_cast<std::uint32_t>(found_.size())});
        planned_.insert(planned_.end(), found_.begin(), found_.end());
    }
    return true;
}

std::optional<double> WitnessLists::served_back(const Witness& witness) const {
    int left = kMaxBack;
    for (const Plan& plan : plans_) {
        if (planned_[plan.first] != witness.triangle) {
            continue;
        }
        const Triangle fine = patch_.at(patch_.fine[plan.fine]);
        double most = 0;
        for (std::size_t i = 0; i < 3 && most <= square_limit_; ++i) {
            most = std::max(most, square_distance(witness.shape.corners()[i], fine));
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

const WitnessLists::Sphere& WitnessLists::sphere_of(std::uint32_t fine) {
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

/// Whether all of it is near the triangles in back_ from `begin` to `end`. Triangles that a piece
/// is not near are not tested for its parts.
bool WitnessLists::cover_back(const Triangle& t, std::size_t begin, std::size_t end, int depth) {
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
    if (first < last && (any || !is_small) && depth < kMaxBackCuts) {
        const auto parts = halves(t);
        is_near = cover_back(parts[0], first, last, depth + 1) &&
                  cover_back(parts[1], first, last, depth + 1);
    }
    back_.resize(first);
    return is_near;
}

std::optional<double> WitnessLists::covered_back(const Witness& witness) {
    spheres_.resize(patch_.fine.size());
    back_.clear();
    // Those that it serves come first.
    for (const bool serves : {true, false}) {
        for (const Plan& plan : plans_) {
            if ((planned_[plan.first] == witness.triangle) == serves) {
                back_.push_back(plan.fine);
            }
        }
    }
    furthest_back_ = 0;
    return cover_back(witness.shape.corners(), 0, back_.size(), 0) ? std::optional(furthest_back_)
                                                                   : std::nullopt;
}

void WitnessLists::take() {
    for (const Gathered& gathered : gathered_) {
        const std::uint32_t fine = gathered.fine;
        if (only_[fine] != kSomeWitnesses) {
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
