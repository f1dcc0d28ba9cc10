// On smooth data the number of triangles doubles as the error is halved: the error is of second
// order in an element's size, the number of its triangles of second order in the inverse. On other
// data it grows faster; each search corrects what the last one assumed.
#include "tools/view/error_choice.h"

#include <algorithm>
#include <cmath>

namespace isonest::detail::view {
namespace {

/// A mesh with a third of the triangles is worth another try.
constexpr double kFew = 3;
/// What a step finer does to the number of triangles, carefully.
constexpr double kGrowth = 2;

}  // namespace

double ErrorChoice::error(int step) const {
    return step > kMostStep ? 0 : 2 * range_ * std::exp2(-0.5 * step);
}

void ErrorChoice::learn(const Search& search) {
    if (search.best_step() >= 0) {
        start_ = search.best_step();
    }
}

ErrorChoice::Search::Search(const ErrorChoice& choice, std::uint64_t most, double seconds)
    : choice_(&choice), most_(most), seconds_(seconds), step_(choice.start_) {}

std::optional<double> ErrorChoice::Search::next() const {
    return ended_ ? std::nullopt : std::optional(choice_->error(step_));
}

std::optional<double> ErrorChoice::Search::best() const {
    return best_ < 0 ? std::nullopt : std::optional(choice_->error(best_));
}

void ErrorChoice::Search::tried(std::uint64_t triangles, double seconds) {
    spent_ += seconds;
    const double part = static_cast<double>(triangles) / static_cast<double>(most_);
    if (triangles > most_) {
        too_fine_ = std::min(too_fine_, step_);
        const int back = std::max(1, static_cast<int>(std::ceil(std::log2(part))));
        step_ = std::max(step_ - back, best_ >= 0 ? best_ + 1 : 0);
        // With a mesh in hand, or at the coarsest there is.
        ended_ = best_ >= 0 || too_fine_ == 0;
        return;
    }
    best_ = step_;
    const int forth =
        triangles == 0 ? 2 : static_cast<int>(std::floor(std::log(1 / part) / std::log(kGrowth)));
    step_ = std::min({step_ + std::max(forth, 1), too_fine_ - 1, kMostStep + 1});
    ended_ = step_ <= best_ || part * kFew > 1 || spent_ > seconds_;
}

}  // namespace isonest::detail::view
