#include "preprocess/ranks/halo.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <memory>
#include <optional>
#include <set>
#include <utility>

namespace isonest::detail {
namespace {

/// First and last, inclusive.
using Span = std::array<std::int64_t, 2>;

Span common(const Span& a, const Span& b) {
    return {std::max(a[0], b[0]), std::min(a[1], b[1])};
}

/// What the pencil `at` needs along an axis. For a margin outside the array, the nearest row.
Span needed(const PencilCut& needing, const HaloArray& array, int axis, std::int64_t at) {
    const std::int64_t last = array.size[axis] - 1;
    const std::int64_t first = array.scale * at * needing.cells - array.before;
    return common({array.before > 0 ? std::min(first, last) : first,
                   array.scale * (at + 1) * needing.cells + array.behind},
                  {0, last});
}

/// What a pencil made along an axis.
Span made(const HaloArray& array, int axis, std::int64_t block) {
    return common({block * array.rows, (block + 1) * array.rows - 1}, {0, array.size[axis] - 1});
}

/// Calls f(pencil of `needing`, rows, planes) for the pencils that need something that `maker`
/// made.
template <class F>
void each_need(const PencilCut& needing, const HaloArray& array, const Pencil& maker, const F& f) {
    const Int3& grid = needing.grid;
    const int shift = needing.shift - array.made.shift;
    for (std::int64_t z = (maker.z >> shift) - 1; z <= (maker.z >> shift) + 1; ++z) {
        for (std::int64_t y = (maker.y >> shift) - 1; y <= (maker.y >> shift) + 1; ++y) {
            if (y < 0 || z < 0 || y >= grid.y || z >= grid.z) {
                continue;
            }
            const Span rows = common(needed(needing, array, 1, y), made(array, 1, maker.y));
            const Span planes = common(needed(needing, array, 2, z), made(array, 2, maker.z));
            if (rows[0] <= rows[1] && planes[0] <= planes[1]) {
                f(Pencil{y, z}, rows, planes);
            }
        }
    }
}

/// Ranks that need something from this one, and ranks from which it needs something.
struct Neighbours {
    std::set<int> receivers;
    std::set<int> senders;
};

Neighbours neighbours_of(const Pencils& pencils, const PencilCut& needing,
                         std::span<const HaloArray> arrays, int rank) {
    Neighbours found;
    for (const HaloArray& array : arrays) {
        for (const Pencil& maker : pencils.of(rank, array.made)) {
            each_need(needing, array, maker, [&](const Pencil& p, const Span&, const Span&) {
                found.receivers.insert(pencils.owner(needing, p));
            });
        }
        for (const Pencil& p : pencils.of(rank, needing)) {
            const Span rows = needed(needing, array, 1, p.y);
            const Span planes = needed(needing, array, 2, p.z);
            if (rows[0] > rows[1] || planes[0] > planes[1]) {
                continue;
            }
            for (std::int64_t z = planes[0] / array.rows; z <= planes[1] / array.rows; ++z) {
                for (std::int64_t y = rows[0] / array.rows; y <= rows[1] / array.rows; ++y) {
                    found.senders.insert(pencils.owner(array.made, {y, z}));
                }
            }
        }
    }
    found.receivers.erase(rank);
    found.senders.erase(rank);
    return found;
}

}  // namespace

HaloRuns::HaloRuns(const Pencils& pencils, const PencilCut& needing,
                   std::span<const HaloArray> arrays, int from, int to)
    : pencils_(&pencils), needing_(needing), arrays_(arrays), from_(from), to_(to) {
    if (!arrays_.empty()) {
        made_ = pencils.of(from, arrays_.front().made);
    }
}

/// Loads the runs of the next pencil that has any; false if there are none.
bool HaloRuns::load_pencil() {
    runs_.clear();
    run_ = 0;
    while (array_ < arrays_.size()) {
        const HaloArray& array = arrays_[array_];
        if (pencil_ == made_.size()) {
            pencil_ = 0;
            if (++array_ < arrays_.size()) {
                made_ = pencils_->of(from_, arrays_[array_].made);
            }
            continue;
        }
        const Pencil& maker = made_[pencil_++];
        std::vector<std::pair<Span, Span>> needs;
        each_need(needing_, array, maker,
                  [&](const Pencil& p, const Span& rows, const Span& planes) {
                      if (pencils_->owner(needing_, p) == to_) {
                          needs.emplace_back(rows, planes);
                      }
                  });
        if (needs.empty()) {
            continue;
        }
        std::sort(needs.begin(), needs.end());  // by first rows
        const Span all = made(array, 2, maker.z);
        for (std::int64_t z = all[0]; z <= all[1]; ++z) {
            std::int64_t next = 0;  // rows before this are already in runs
            for (const auto& [rows, planes] : needs) {
                const std::int64_t first = std::max(rows[0], next);
                if (z < planes[0] || z > planes[1] || first > rows[1]) {
                    continue;
                }
                runs_.push_back(
                    {array_, static_cast<std::uint64_t>(z * array.size.y + first) * array.row_bytes,
                     static_cast<std::uint64_t>(rows[1] + 1 - first) * array.row_bytes});
                next = rows[1] + 1;
            }
        }
        return true;
    }
    return false;
}

bool HaloRuns::next(Run& run) {
    while (run_ == runs_.size()) {
        if (!load_pencil()) {
            return false;
        }
    }
    run = runs_[run_++];
    return true;
}

void exchange_halos(Communicator& ranks, const Pencils& pencils, const PencilCut& needing,
                    std::span<const HaloArray> arrays) {
    const int me = ranks.rank();
    const Neighbours near = neighbours_of(pencils, needing, arrays, me);
    const auto between = [&](int from, int to) {
        return RunMessages(HaloRuns(pencils, needing, arrays, from, to));
    };
    std::uint64_t expected = 0;
    for (const int sender : near.senders) {
        expected += between(sender, me).count();
    }
    auto receiver = near.receivers.begin();
    std::optional<RunMessages<HaloRuns>> messages;
    ranks.exchange(
        [&](Communicator::Message& message) {
            while (receiver != near.receivers.end()) {
                if (!messages) {
                    messages.emplace(between(me, *receiver));
                }
                message.to = *receiver;
                if (messages->next(message.bytes, [&](std::size_t array, std::uint64_t offset) {
                        return arrays[array].bytes.data() + offset;
                    })) {
                    return true;
                }
                messages.reset();
                ++receiver;
            }
            return false;
        },
        expected,
        [&](int /*from*/, std::span<const std::byte> bytes) {
            unpack_runs(
                bytes, [&](std::size_t array) { return arrays[array].element; },
                [&](std::size_t which, std::uint64_t offset, std::span<const std::byte> from) {
                    const HaloArray& array = arrays[which];
                    array.reserve(offset, from.size());
                    std::memcpy(array.bytes.data() + offset, from.data(), from.size());
                });
        });
}

}  // namespace isonest::detail
