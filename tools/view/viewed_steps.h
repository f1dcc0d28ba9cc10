// The stores that a server shows: one, or the steps of a series.
#pragma once

#include <sys/stat.h>

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <list>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <isonest/progress.h>
#include <isonest/series.h>
#include <isonest/store.h>

#include "tools/view/store_answers.h"

namespace isonest::detail::view {

// Whether the file of an open store is still the one that was opened. For a remote store the reader
// checks this: fetching from a changed object is an error.

enum class StoreState : std::uint8_t { same, replaced, cut_off };

/// Thread-safe.
class StoreWatch {
  public:
    /// Throws Error{not_found} if the file no longer exists.
    explicit StoreWatch(const Store& store);
    /// Always `same` for a remote store. `replaced` if the file of that name is another one, was
    /// written to, or no longer exists.
    [[nodiscard]] StoreState state() const;

  private:
    std::filesystem::path path_;  ///< empty: remote
    struct stat opened_ {};
};

/// "ok", "replaced" or "cut off".
const char* name_of(StoreState state);

/// A store and the answers about it.
struct OpenStep {
    std::optional<Store> own;  ///< none if the store belongs to somebody else
    const Store& store;
    StoreAnswers answers;

    OpenStep(const Store& store_, const MemoryShares& shares, int threads,
             std::vector<Quantity> quantities)
        : store(store_), answers(store, shares, threads, std::move(quantities)) {}
    OpenStep(Store&& store_, const MemoryShares& shares, int threads)
        : own(std::move(store_)), store(*own), answers(store, shares, threads) {}
    OpenStep(const OpenStep&) = delete;
    OpenStep& operator=(const OpenStep&) = delete;
    ~OpenStep() = default;
};

/// Thread-safety: all methods from any thread.
class ViewedSteps {
  public:
    /// One store, which must outlive this object, as the stores of the quantities must.
    ViewedSteps(const Store& store, const MemoryShares& shares, int threads,
                std::vector<Quantity> quantities);
    /// These steps of a series. Opens each of them once, to learn the range of their values. Throws
    /// what Store throws, Error{corrupt} if they have different lattices, Error{invalid_argument}
    /// if there are none.
    ViewedSteps(const Series& series, const std::vector<std::size_t>& steps,
                const MemoryShares& shares, int threads, Progress& progress);

    [[nodiscard]] std::size_t count() const { return steps_.size(); }
    /// Null for one store.
    [[nodiscard]] const SeriesSummary* series() const { return series_ ? &*series_ : nullptr; }
    /// Largest value minus the smallest, over all steps.
    [[nodiscard]] double range() const;
    /// A step that is always open.
    [[nodiscard]] const OpenStep& first() const { return *first_; }
    /// The step, opened if necessary. REQUIRES: step < count(). Throws what Store throws.
    std::shared_ptr<const OpenStep> open(std::size_t step);
    [[nodiscard]] const std::filesystem::path& path(std::size_t step) const;
    /// The first state that is not `same`, of the step and of the quantities.
    [[nodiscard]] StoreState state(std::size_t step) const;
    /// The same of all steps.
    [[nodiscard]] StoreState state() const;

  private:
    struct Step {
        std::filesystem::path path;
        StoreWatch watch;
    };
    using Recent = std::pair<std::size_t, std::shared_ptr<const OpenStep>>;
    void add(const std::filesystem::path& path, double time);

    MemoryShares shares_;
    int threads_;
    std::vector<Step> steps_;
    std::vector<StoreWatch> quantities_;
    std::shared_ptr<const OpenStep> first_;
    std::optional<SeriesSummary> series_;
    double least_ = std::numeric_limits<double>::infinity();  ///< value of a series
    double largest_ = -std::numeric_limits<double>::infinity();
    std::mutex mutex_;
    std::list<Recent> recent_;  ///< without the first step; most recently used first
};

}  // namespace isonest::detail::view
