// Answers about a store, for a server's page and for a page without a server.
#pragma once

#include <fmt/format.h>

#include <cstdint>
#include <exception>
#include <limits>
#include <new>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include <isonest/error.h>
#include <isonest/int3.h>
#include <isonest/progress.h>
#include <isonest/store.h>

#include "query/statistics/histogram.h"
#include "store/container/reader.h"
#include "tools/view/http_messages.h"
#include "tools/view/mesh_request.h"

namespace isonest::detail::view {

// The viewer's answers as they are sent: JSON, also for errors (PROTOCOL.md).

HttpAnswer json_answer(const nlohmann::ordered_json& json, unsigned status = 200);
/// With the remedies expressed as options of `isonest view`.
HttpAnswer error_answer(const Error& error);
HttpAnswer plain_error(unsigned status, const std::string& kind, const std::string& message);

/// Runs the work; errors of the library and the standard library become answers.
template <class Work>
HttpAnswer guarded(const Work& work) {
    try {
        return work();
    } catch (const Error& e) {
        return error_answer(e);
    } catch (const std::bad_alloc&) {
        return error_answer(Error(ErrorKind::limit, "out of memory", {{RemedyKind::less_memory}}));
    } catch (const std::exception& e) {
        return plain_error(500, "internal",
                           fmt::format("internal error, please report it: {}", e.what()));
    }
}

// What is fetched from a remote store before the page requests anything.

/// The coarsest levels of a store: the values, and the field that bounds the error.
struct FirstLevels {
    /// Maximum size of values and bound together in bytes: a sixth of a second at 50 Mbit/s.
    static constexpr std::uint64_t kMaxBytes = std::uint64_t{1} << 20U;

    int level = 0;  ///< the finest of these levels
    /// Surfaces and slices within this error need only these levels, except for normals of vertices
    /// at nodes.
    double error = 0;
};

/// Requests these levels at once, and returns without waiting if the chunk table rows were read
/// when the store was opened, as those of coarse levels are. None for a local file, for labels, and
/// for a store without a catalogue or a bound. Throws Error{corrupt, io}.
std::optional<FirstLevels> fetch_first_levels(const StoreReader& store);

// The data at one point.

struct PointValue {
    bool inside = false;               ///< inside the volume
    Int3 node{};                       ///< the nearest one
    std::optional<double> value = {};  ///< linear in the finest tetrahedra; none if missing
    std::optional<double> node_value = {};
};

/// Decodes the chunks around the point, one at a time. Throws Error{corrupt}, and Error{limit} if
/// `memory` cannot hold one.
PointValue value_at(const Store& store, const Double3& world, std::uint64_t memory);

/// How the memory is divided. In sixteenths: extraction of surfaces 3, their messages 4, slices 2
/// and 1, files and tiles 3, values and histogram 1, answers being sent 2.
struct MemoryShares {
    static constexpr std::uint64_t kFileParts = 3;
    explicit MemoryShares(std::uint64_t memory_);
    /// For a page without a server, which does one thing at a time: an extraction (of anything), or
    /// values and histogram, 6; the message 3. The rest is for fetched data and temporary files.
    static MemoryShares of_page(std::uint64_t memory);
    /// A memory of which files get at least these bytes.
    static std::uint64_t for_files(std::uint64_t bytes);
    std::uint64_t memory;
    std::uint64_t surface, surface_message, slice, slice_message, file, small, sending;
};

/// Largest value minus the smallest; 0 if there are none.
double range_of(const Store& store);

/// What a page needs to know about a series besides the properties of its stores.
struct SeriesSummary {
    std::string name;                      ///< of its folder
    std::optional<std::string> time_unit;  ///< none: unknown
    std::vector<double> times;             ///< of the steps, ascending
    /// Of all steps, as StoreReader gives them; min_value > max_value if there is no value.
    double min_value = std::numeric_limits<double>::infinity();
    double max_value = -std::numeric_limits<double>::infinity();
    double range = 0;      ///< of all steps, see range_of()
    double tolerance = 0;  ///< the largest of the steps
    bool has_missing = false;
    std::uint64_t file_bytes = 0;  ///< of all steps
};

/// A quantity by which surfaces are coloured.
struct Quantity {
    std::string name;              ///< as of a VertexField
    const Store* store = nullptr;  ///< of any lattice; not of labels
};

/// Each method answers as described in PROTOCOL.md. Thread-safety: all methods from any thread.
/// They throw what the queries of the store throw, and Error{invalid_argument} for invalid
/// parameters.
class StoreAnswers {
  public:
    /// `store` and the stores of `quantities` must outlive this object. For a remote store, the
    /// coarsest levels are requested at once.
    StoreAnswers(const Store& store, const MemoryShares& shares, int threads,
                 std::vector<Quantity> quantities = {});

    [[nodiscard]] bool are_labels() const;
    /// /api/store. `series`: if this store is one of its steps.
    [[nodiscard]] HttpAnswer describe(const SeriesSummary* series = nullptr) const;
    /// /api/label
    HttpAnswer label(RequestTarget& target) const;
    /// /api/labels. `named`: only those with a name or a colour, for which no values are read.
    [[nodiscard]] HttpAnswer labels(bool named, Progress& progress) const;
    /// Takes the parameters of /api/labels; whether only named ones are wanted.
    static bool take_labels(RequestTarget& target);
    /// Takes the parameters of /api/histogram; then its answer.
    HistogramOptions take_histogram(RequestTarget& target) const;
    [[nodiscard]] HttpAnswer histogram(const HistogramOptions& options, Progress& progress) const;
    /// Takes the parameters of /api/value; then its answer.
    static Double3 take_place(RequestTarget& target);
    [[nodiscard]] HttpAnswer value(const Double3& place) const;
    /// Takes the parameters of /api/surface, /api/slice, and of requests that contain either.
    MeshRequest take_mesh(RequestTarget& target, const std::string& path) const;

  private:
    const Store& store_;
    MemoryShares shares_;
    int threads_;
    std::vector<Quantity> quantities_;
    std::optional<FirstLevels> first_;
};

}  // namespace isonest::detail::view
