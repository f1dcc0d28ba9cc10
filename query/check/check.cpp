#include "query/check/check.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include <isonest/error.h>

#include "query/check/check_levels.h"
#include "query/check/check_source.h"
#include "query/check/findings.h"
#include "store/base/memory.h"
#include "store/base/workers.h"
#include "store/container/chunk_cache.h"
#include "store/container/codec.h"
#include "store/container/parts/by_hdf5.h"
#include "store/container/parts/footer.h"
#include "store/container/reader.h"

namespace isonest::detail {

// Compares the data behind HDF5's end of a store with HDF5's structures and the chunk table.

/// Adds results to `findings`, as test "footer". Throws Error{io}.
void check_footer(const StoreReader& store, Findings& findings);

namespace {

/// The first version whose stores have a footer.
constexpr FormatVersion kFirst{2, 9};

std::string fault_of(const StoreReader& store) {
    const StoreBytes& file = store.bytes();
    const FoundCatalogue* const found = store.catalogue();
    if (found == nullptr) {
        return hdf5_end_of(file) == file.size()
                   ? ""  // an HDF5 program has changed the store
                   : "the bytes behind HDF5's part of the file are not the footer of this file";
    }
    if (hdf5_end_of(file) != found->footer.hdf5_end) {
        return "HDF5's part of the file does not end where the footer says";
    }
    const CatalogueTable& place = *found->catalogue.table;
    const HeldBytes table = file.read(place.offset, place.rows * sizeof(ChunkRow));
    const auto expected = Hdf5View(file).catalogue(store.layout(), table.bytes());
    if (!expected) {
        return "HDF5 does not find the data that the catalogue describes";
    }
    if (checksum_of(table.bytes()) != place.xxh64) {
        return "checksum mismatch: the chunk table has changed";
    }
    if (store.version() > FormatVersion{}) {
        return "";  // it may contain more
    }
    const std::uint64_t begin = found->footer.hdf5_end;
    const HeldBytes ours = file.read(begin, file.size() - begin);
    const std::vector<std::byte> bytes = bytes_behind_hdf5(begin, *expected);
    return std::equal(bytes.begin(), bytes.end(), ours.bytes().begin(), ours.bytes().end())
               ? ""
               : "the catalogue does not match what HDF5 finds in the file";
}

}  // namespace

void check_footer(const StoreReader& store, Findings& findings) {
    if (store.version() < kFirst) {
        return;
    }
    std::string fault;
    try {
        fault = fault_of(store);
        if (fault.empty()) {
            store.compare_range();
        }
    } catch (const Error& error) {
        if (error.kind() != ErrorKind::corrupt) {
            throw;
        }
        fault = error.what();
    }
    if (!fault.empty()) {
        findings.add("footer", store.layout().array(0, Field::values), {0, 0, 0}, kWholeChunk,
                     fault);
    }
}

namespace {

/// Number of chunks that a quick check reads.
constexpr std::int64_t kQuickChunks = 4096;

/// Size of the boxes that one thread gathers.
constexpr std::uint64_t kBoxes = 1U << 20U;

/// Distribution of the memory of a check; fewer threads are used if there is little.
struct Shares {
    int threads;
    std::uint64_t cache;
};

Shares share(const StoreReader& store, const CheckOptions& options) {
    const StoreLayout& layout = store.layout();
    const std::uint64_t largest = largest_chunk_bytes(layout);
    // One chunk is decoded directly or held, two more are in the cache.
    const std::uint64_t each = decode_heap(largest) + 3 * largest + kBoxes;
    // HDF5's data about a chunk, a chunk's stored bytes, and a bit of the findings.
    constexpr std::uint64_t kIndexEntry = 32;
    const std::uint64_t deep =
        options.depth == CheckDepth::deep ? 2 * largest + layout.rows() * kIndexEntry : 0;
    const std::uint64_t fixed = kLibraryHeap + layout.rows() / 8 + deep;
    // The source and the rows compared with it use the other three quarters.
    const std::uint64_t part = options.source != nullptr ? 4 : 1;
    require_memory(store.path().string(), options.memory, fixed + part * each,
                   "this store's chunks");
    const std::uint64_t usable = (options.memory - fixed) / part;
    const auto threads = std::clamp<std::uint64_t>(
        usable / each, 1, static_cast<std::uint64_t>(Workers::count_of(options.threads)));
    return {static_cast<int>(threads), usable - threads * (each - 3 * largest)};
}

class Checker {
  public:
    Checker(const StoreReader& store, const CheckOptions& options, std::uint64_t cache,
            Progress& progress, Communicator* ranks)
        : store_(store),
          layout_(store.layout()),
          options_(options),
          share_{ranks},
          progress_(progress),
          cache_(store, cache),
          findings_(layout_.rows()) {}

    CheckReport run() {
        const bool quick = options_.depth == CheckDepth::quick;
        const auto all = static_cast<std::int64_t>(layout_.rows());
        const std::int64_t every =
            quick ? std::max<std::int64_t>(1, (all + kQuickChunks - 1) / kQuickChunks) : 1;
        prefetch_rows();
        for_each_chunk(
            "table", 1, [&](const ArrayInfo& a, const Int3& c) { row(a, c); }, Reads::rows);
        for_each_chunk("checksums", every,
                       [&](const ArrayInfo& a, const Int3& c) { stored(a, c); });
        if (!quick) {
            for_each_chunk("decode", 1, [&](const ArrayInfo& a, const Int3& c) { decoded(a, c); });
            if (share_.any(findings_.any_damaged())) {
                findings_.note_damage();
            }
            for_each_chunk(
                "levels", 1,
                [&](const ArrayInfo& a, const Int3& c) { check_levels(cache_, findings_, a, c); },
                Reads::others);
        }
        if (share_.is_first()) {
            vtk_group();
            check_footer(store_, findings_);
            compare_positions();
        }
        check_cube_ranges(store_, cache_, quick, findings_, progress_, share_);
        if (options_.depth == CheckDepth::deep) {
            hdf5_view();
        }
        if (options_.source != nullptr && share_.is_first()) {
            check_source(cache_, options_, findings_, progress_);
        }
        if (share_.ranks != nullptr) {
            findings_.gather(*share_.ranks);
        }
        return findings_.take();
    }

  private:
    /// Prefetches the whole part of the table that this rank reads.
    void prefetch_rows() {
        for (const ArrayInfo& array : layout_.all_arrays()) {
            const auto [low, high] = share_.of(array.grid.product());
            if (!array.alias && low < high) {
                const std::int64_t layer = array.grid.x * array.grid.y;
                store_.prefetch_rows(array, {0, 0, low / layer},
                                     {array.grid.x, array.grid.y, (high + layer - 1) / layer});
            }
        }
    }

    /// What is read for a chunk: only its row of the table, the chunk itself, or also others.
    enum class Reads { rows, itself, others };

    /// All chunks that are not known to be damaged, or every `every`-th of them.
    template <class F>
    void for_each_chunk(const char* phase, std::int64_t every, F&& f, Reads reads = Reads::itself) {
        progress_.begin(phase, layout_.rows() / static_cast<std::uint64_t>(every * share_.size()),
                        "chunks");
        for (const ArrayInfo& array : layout_.all_arrays()) {
            if (array.alias) {
                continue;
            }
            const auto [low, high] = share_.of(array.grid.product());
            const auto number = [&](std::int64_t chunk) { return (chunk + every - 1) / every; };
            const auto wanted = [&](std::int64_t i, std::vector<WantedChunk>& chunks) {
                const Int3 chunk = array.grid.unlinear(i * every);
                if (reads != Reads::rows && !findings_.is_damaged(array, chunk)) {
                    chunks.push_back({&array, chunk});
                    if (reads == Reads::others) {
                        want_compared(array, chunk, chunks);
                    }
                }
            };
            Prefetcher prefetcher = reads == Reads::others
                                        ? Prefetcher(cache_, number(low), number(high), wanted)
                                        : Prefetcher(store_, number(low), number(high), wanted);
            for_each_prefetched(store_, prefetcher, number(low), number(high), [&](std::int64_t i) {
                progress_.check();
                const Int3 chunk = array.grid.unlinear(i * every);
                if (!findings_.is_damaged(array, chunk)) {
                    try {
                        f(array, chunk);
                    } catch (const Error& error) {
                        if (error.kind() != ErrorKind::corrupt) {
                            throw;
                        }
                        // A chunk that only needs a damaged one is not damaged itself.
                        if (reads != Reads::others || !findings_.any_damaged()) {
                            findings_.add_damaged("decode", array, chunk, error.what());
                        }
                    }
                }
                progress_.advance(1);
            });
        }
    }

    /// Adds the chunks with which check_levels() compares a chunk.
    void want_compared(const ArrayInfo& array, const Int3& chunk,
                       std::vector<WantedChunk>& chunks) const {
        constexpr Int3 kOne{1, 1, 1};
        const Int3 first = array.first_node(chunk);
        const Int3 end = first + array.chunk;
        if (array.field == Field::values) {
            if (array.level > 0) {
                want_box(layout_.array(array.level - 1, Field::values), first * 2,
                         end * 2 - kOne * 2, chunks);
            }
            return;
        }
        if (array.level == 1 && centre_suffices_at_level_1(array.field)) {
            want_box(layout_.array(0, Field::values), first * 2, end * 2, chunks);
            return;
        }
        if (!is_of_cells(array.field)) {
            want_box(array, first, end, chunks);
        }
        if (array.level > 1) {
            want_box(layout_.array(array.level - 1, array.field), first * 2 - kOne, end * 2,
                     chunks);
        }
    }

    void row(const ArrayInfo& array, const Int3& chunk) {
        try {
            const std::uint32_t known =
                kChunkHasMissing | (array.skips_shuffle ? kChunkUnshuffled : std::uint32_t{0});
            if ((store_.row(array, chunk).flags & ~known) != 0) {
                findings_.add("table", array, chunk, kWholeChunk, "reserved flags are set");
            }
        } catch (const Error& error) {
            findings_.add_damaged("table", array, chunk, error.what());
        }
    }

    void stored(const ArrayInfo& array, const Int3& chunk) {
        findings_.count(0, 1);
        if (checksum_of(store_.stored(array, chunk).bytes()) != store_.row(array, chunk).checksum) {
            findings_.add_damaged(
                "checksum", array, chunk,
                "checksum mismatch: the bytes have changed; restore the store from a good copy");
        }
    }

    void vtk_group() {
        if (layout_.header().labels) {
            return;  // such stores have none since format 2.10
        }
        std::string fault;
        try {
            fault = Hdf5View(store_.bytes()).vtk_fault(layout_.header());
        } catch (const Error& error) {
            if (error.kind() != ErrorKind::corrupt) {
                throw;
            }
            fault = error.problem();
        }
        if (!fault.empty()) {
            findings_.add("hdf5", layout_.array(0, Field::values), {0, 0, 0}, kWholeChunk, fault);
        }
    }

    /// Compares what the header says of a curvilinear grid's box with the chunk table.
    void compare_positions() {
        for (const ArrayInfo& array : layout_.positions()) {
            const CurvedNodes& nodes = *layout_.header().curved;
            const auto a = static_cast<std::size_t>(array.coordinate);
            const ArrayTotals totals = store_.totals(array);
            if (totals.min != nodes.low[a] || totals.max != nodes.high[a]) {
                findings_.add("range", array, {0, 0, 0}, kWholeChunk,
                              fmt::format("the header says {} to {}, the table {} to {}",
                                          nodes.low[a], nodes.high[a], totals.min, totals.max));
            }
        }
    }

    /// For each array, whether its first chunk was found to be damaged, by any rank.
    std::vector<std::uint64_t> damaged_first_chunks() {
        std::vector<std::uint64_t> damaged;
        for (const ArrayInfo& array : layout_.all_arrays()) {
            damaged.push_back(findings_.is_damaged(array, {0, 0, 0}) ? 1 : 0);
        }
        if (share_.ranks != nullptr) {
            share_.ranks->sum(damaged);
        }
        return damaged;
    }

    /// Checks that other HDF5 programs find at the chunk's position what the table says.
    void hdf5_view() {
        std::optional<Hdf5View> opened;
        try {
            opened.emplace(store_.bytes());
        } catch (const Error& error) {
            if (error.kind() != ErrorKind::corrupt) {
                throw;
            }
            return;  // reported by vtk_group()
        }
        const Hdf5View& view = *opened;
        std::vector<std::byte> bytes;
        const std::vector<std::uint64_t> first_damaged = damaged_first_chunks();
        progress_.begin("HDF5", layout_.rows() / static_cast<std::uint64_t>(share_.size()),
                        "chunks");
        for (std::size_t a = 0; a < layout_.all_arrays().size(); ++a) {
            const ArrayInfo& array = layout_.all_arrays()[a];
            const auto [low, high] = share_.of(array.grid.product());
            if (low > 0 && first_damaged[a] == 0 &&
                !view.read(array, {0, 0, 0}, store_.row(array, {0, 0, 0}), bytes).empty()) {
                continue;  // reported by the rank with the first chunk
            }
            for (std::int64_t i = low; i < high; ++i) {
                progress_.check();
                progress_.advance(array.alias ? 0 : 1);
                const Int3 chunk = array.grid.unlinear(i);
                if (findings_.is_damaged(array, chunk)) {
                    continue;
                }
                const std::string fault = view.read(array, chunk, store_.row(array, chunk), bytes);
                const HeldBytes held = store_.stored(array, chunk);
                const auto ours = held.bytes();
                if (!fault.empty()) {
                    findings_.add("hdf5", array, chunk, kWholeChunk, fault);
                } else if (!std::equal(bytes.begin(), bytes.end(), ours.begin(), ours.end())) {
                    findings_.add("hdf5", array, chunk, kWholeChunk,
                                  "HDF5 finds other bytes here than the chunk table");
                }
                if (!fault.empty() && i == 0) {
                    break;  // concerns the whole dataset
                }
            }
        }
    }

    void decoded(const ArrayInfo& array, const Int3& chunk) {
        std::vector<std::byte> raw(array.chunk_bytes());
        store_.decode(array, chunk, raw);
        double low = std::numeric_limits<double>::infinity();
        double high = array.field == Field::values ? -low : 0;
        bool missing = false;
        const auto see = [&](double v) {
            if (array.field == Field::values && !std::isfinite(v)) {
                missing = true;
                return;
            }
            low = std::fmin(low, v);
            high = std::fmax(high, v);
        };
        const Int3 base = array.first_node(chunk);
        const Int3 n = min(array.chunk, array.nodes - base);
        for (std::int64_t i = 0; i < n.product(); ++i) {
            const std::int64_t at = array.chunk.linear(n.unlinear(i)) * array.components;
            for (int c = 0; c < array.components; ++c) {
                see(element(array, raw, static_cast<std::size_t>(at + c)));
            }
        }
        findings_.count(n.product() * array.components);
        const ChunkRow row = store_.row(array, chunk);
        if (row.min != low || row.max != high || ((row.flags & kChunkHasMissing) != 0) != missing) {
            findings_.add("range", array, chunk, kWholeChunk,
                          fmt::format("the table says {} to {}, the chunk holds {} to {}", row.min,
                                      row.max, low, high));
        }
    }

    [[nodiscard]] double element(const ArrayInfo& array, const std::vector<std::byte>& raw,
                                 std::size_t i) const {
        if (array.field == Field::values) {
            const ValueType type =
                array.coordinate >= 0 ? layout_.header().curved->type : layout_.header().type;
            return dispatch(type, [&](auto tag) {
                using T = typename decltype(tag)::type;
                return static_cast<double>(reinterpret_cast<const T*>(raw.data())[i]);
            });
        }
        return layout_.header().exact
                   ? static_cast<double>(reinterpret_cast<const float*>(raw.data())[i])
                   : static_cast<double>(
                         decode_indicator(reinterpret_cast<const IndicatorCode*>(raw.data())[i]));
    }

    const StoreReader& store_;
    const StoreLayout& layout_;
    const CheckOptions& options_;
    RankShare share_;
    Progress& progress_;
    ChunkCache cache_;
    Findings findings_;
};

}  // namespace

CheckReport check(const StoreReader& store, const CheckOptions& options, Progress& progress,
                  Communicator* ranks) {
    if (options.source != nullptr) {
        require_same_shape(store, *options.source);
    }
    const Shares shares = share(store, options);
    return Workers(shares.threads).execute([&] {
        return Checker(store, options, shares.cache, progress, ranks).run();
    });
}

}  // namespace isonest::detail

namespace isonest {

CheckReport check(const Store& store, const CheckOptions& options, Progress& progress) {
    return detail::check(store.reader(), options, progress);
}

}  // namespace isonest
