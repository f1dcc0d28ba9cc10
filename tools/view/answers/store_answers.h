// What is answered about a store, whoever asks: a server's page, or one without a server.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include <isonest/progress.h>
#include <isonest/store.h>

#include "query/statistics/histogram.h"
#include "tools/view/answers/first_levels.h"
#include "tools/view/http_messages.h"
#include "tools/view/mesh_request.h"
#include "tools/view/request_target.h"

namespace isonest::detail::view {

/// How the memory is divided. Sixteenths: extraction of surfaces 4, their message 4, slices 2 and
/// 1, files 2, values and histogram 1, answers that are being sent 2.
struct MemoryShares {
    explicit MemoryShares(std::uint64_t memory_);
    /// Of a page without a server, which does one thing at a time: an extraction (of anything), or
    /// values and histogram, 6; the message 3. The rest is for what is fetched and for temporary
    /// files.
    static MemoryShares of_page(std::uint64_t memory);
    std::uint64_t memory;
    std::uint64_t surface, surface_message, slice, slice_message, file, small, sending;
};

/// Largest value less the smallest; 0 if there is none.
double range_of(const Store& store);

/// Each as PROTOCOL.md has it. Thread-safety: all methods from any thread. They throw what the
/// queries of the store throw, and Error{invalid_argument} for parameters that make no sense.
class StoreAnswers {
  public:
    /// `store` must outlive it. Of a store elsewhere, the coarsest levels are asked for at once.
    StoreAnswers(const Store& store, const MemoryShares& shares, int threads);

    [[nodiscard]] bool are_labels() const;
    /// /api/store
    [[nodiscard]] HttpAnswer describe() const;
    /// /api/label
    HttpAnswer label(RequestTarget& target) const;
    /// The parameters of /api/histogram, and its answer.
    HistogramOptions take_histogram(RequestTarget& target) const;
    [[nodiscard]] HttpAnswer histogram(const HistogramOptions& options, Progress& progress) const;
    /// The parameters of /api/value, and what is there.
    static Double3 take_place(RequestTarget& target);
    [[nodiscard]] HttpAnswer value(const Double3& place) const;
    /// The parameters of /api/surface, /api/slice, and what takes either.
    MeshRequest take_mesh(RequestTarget& target, const std::string& path) const;

  private:
    const Store& store_;
    MemoryShares shares_;
    int threads_;
    std::optional<FirstLevels> first_;
};

}  // namespace isonest::detail::view
