#include "tools/view/viewed_steps.h"

#include <algorithm>
#include <filesystem>
#include <utility>

#include <isonest/error.h>

#include "store/container/reader.h"
#include "tools/cli/commands/series_command.h"

namespace isonest::detail::view {
namespace {

/// Steps that stay open besides the first one: for users who go back and forth.
constexpr std::size_t kMaxRecent = 8;

}  // namespace

StoreWatch::StoreWatch(const Store& store) {
    if (store.is_remote()) {
        return;
    }
    path_ = std::filesystem::absolute(store.path());
    if (::stat(path_.c_str(), &opened_) != 0) {
        throw Error(ErrorKind::not_found, {store.path().string()}, "no such file");
    }
}

StoreState StoreWatch::state() const {
    if (path_.empty()) {
        return StoreState::same;
    }
    struct stat now {};
    if (::stat(path_.c_str(), &now) != 0 || now.st_dev != opened_.st_dev ||
        now.st_ino != opened_.st_ino) {
        return StoreState::replaced;
    }
    if (now.st_size < opened_.st_size) {
        return StoreState::cut_off;
    }
    const bool written = now.st_size != opened_.st_size ||
                         now.st_mtim.tv_sec != opened_.st_mtim.tv_sec ||
                         now.st_mtim.tv_nsec != opened_.st_mtim.tv_nsec;
    return written ? StoreState::replaced : StoreState::same;
}

const char* name_of(StoreState state) {
    switch (state) {
        case StoreState::same:
            return "ok";
        case StoreState::replaced:
            return "replaced";
        case StoreState::cut_off:
            return "cut off";
    }
    return "";
}

ViewedSteps::ViewedSteps(const Store& store, const MemoryShares& shares, int threads,
                         std::vector<Quantity> quantities)
    : shares_(shares), threads_(threads) {
    steps_.push_back({store.path(), StoreWatch(store)});
    for (const Quantity& quantity : quantities) {
        // The temporary store of a volume may have no name any more.
        if (std::filesystem::exists(quantity.store->path())) {
            quantities_.emplace_back(*quantity.store);
        }
    }
    first_ = std::make_shared<const OpenStep>(store, shares, threads, std::move(quantities));
}

ViewedSteps::ViewedSteps(const Series& series, const std::vector<std::size_t>& steps,
                         const MemoryShares& shares, int threads, Progress& progress)
    : shares_(shares), threads_(threads) {
    if (steps.empty()) {
        throw Error(ErrorKind::invalid_argument, {series.folder().string()},
                    "is a series without steps: nothing can be shown yet");
    }
    series_.emplace();
    series_->name = std::filesystem::absolute(series.folder() / "").parent_path().filename();
    series_->time_unit = series.time_unit();
    progress.begin("opening the steps", steps.size(), "steps");
    for (const std::size_t step : steps) {
        progress.check();
        add(series.store(step), series.steps()[step].time);
        progress.advance(1);
    }
}

void ViewedSteps::add(const std::filesystem::path& path, double time) {
    Store store(path);
    SeriesSummary& all = *series_;
    const StoreReader& reader = store.reader();
    if (first_) {
        cli::require_same_place(first_->store, store);
    }
    if (reader.min_value() <= reader.max_value()) {
        all.min_value = std::min(all.min_value, reader.min_value());
        all.max_value = std::max(all.max_value, reader.max_value());
        least_ = std::min(least_, store.min_value());
        largest_ = std::max(largest_, store.max_value());
        all.range = largest_ - least_;
    }
    all.times.push_back(time);
    all.tolerance = std::max(all.tolerance, store.rounding().tolerance);
    all.has_missing = all.has_missing || store.has_missing();
    all.file_bytes += reader.file_bytes();
    steps_.push_back({path, StoreWatch(store)});
    if (!first_) {
        first_ = std::make_shared<const OpenStep>(std::move(store), shares_, threads_);
    }
}

double ViewedSteps::range() const {
    return series_ ? series_->range : range_of(first_->store);
}

const std::filesystem::path& ViewedSteps::path(std::size_t step) const {
    return steps_[step].path;
}

std::shared_ptr<const OpenStep> ViewedSteps::open(std::size_t step) {
    if (step == 0) {
        return first_;
    }
    const std::lock_guard lock(mutex_);
    const auto found = std::find_if(recent_.begin(), recent_.end(),
                                    [&](const Recent& one) { return one.first == step; });
    if (found != recent_.end()) {
        recent_.splice(recent_.begin(), recent_, found);
        return found->second;
    }
    const Step& asked = steps_[step];
    auto opened = std::make_shared<const OpenStep>(Store(asked.path), shares_, threads_);
    if (asked.watch.state() != StoreState::same) {
        throw Error(ErrorKind::corrupt, {asked.path.string()},
                    "the store has changed since the series was opened; start the viewer again");
    }
    cli::require_same_place(first_->store, opened->store);
    recent_.emplace_front(step, std::move(opened));
    if (recent_.size() > kMaxRecent) {
        recent_.pop_back();
    }
    return recent_.front().second;
}

StoreState ViewedSteps::state(std::size_t step) const {
    if (const StoreState state = steps_[step].watch.state(); state != StoreState::same) {
        return state;
    }
    for (const StoreWatch& quantity : quantities_) {
        if (const StoreState state = quantity.state(); state != StoreState::same) {
            return state;
        }
    }
    return StoreState::same;
}

StoreState ViewedSteps::state() const {
    for (std::size_t step = 0; step < steps_.size(); ++step) {
        if (const StoreState state = this->state(step); state != StoreState::same) {
            return state;
        }
    }
    return StoreState::same;
}

}  // namespace isonest::detail::view
