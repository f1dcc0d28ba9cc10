#include "query/ranks/rank_apart.h"

#include <oneapi/tbb/parallel_sort.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstring>
#include <span>
#include <tuple>
#include <vector>

#include "query/apart/keep_apart.h"
#include "query/ranks/row_mail.h"

namespace isonest::detail {
namespace {

using Place = std::array<float, 3>;

/// A vertex of any rank that may share its place.
struct Watched {
    Place at{};
    std::uint32_t is_owned = 0;  ///< owned by a part of this rank
    std::uint64_t number = 0;
};
/// A vertex at the home of its place.
struct Found {
    Watched vertex;
    std::uint32_t from = 0;
};
struct TouchedCorners {
    ElementCorners corners{};
    std::array<Place, 3> at{};
};
struct MovedVertex {
    std::uint64_t number = 0;
    Place start{};
    Place now{};
};

/// The rank that is the home of a place. Zeros of both signs are the same place.
int home_of(const Place& at, int ranks) {
    std::uint64_t h = 0;
    for (const float x : at) {
        const float coordinate = x + 0.0F;
        std::uint32_t bits = 0;
        std::memcpy(&bits, &coordinate, sizeof(bits));
        h = (h ^ bits) * 0x9E3779B97F4A7C15ULL;
        h ^= h >> 29U;
    }
    return static_cast<int>(h % static_cast<std::uint64_t>(ranks));
}

class ApartOnRanks {
  public:
    ApartOnRanks(Communicator& ranks, PartStore& parts, const VertexNumbers& weld,
                 const ScratchFolder& folder, Progress& progress)
        : ranks_(ranks),
          parts_(parts),
          weld_(weld),
          folder_(folder),
          progress_(progress),
          watched_(folder),
          found_(folder),
          touched_(folder) {}

    ApartVertices run(ApartRange range) {
        find_watched();
        tell_homes();
        std::uint64_t together = tell_touched();
        ranks_.sum({&together, 1});
        if (together == 0) {
            return {};
        }
        RowFile<PlacedVertex> placed(folder_);
        gather_watched(range, placed);
        RowFile<PlacedVertex> moved(folder_);
        const ApartVertices apart = keep_gathered(range, placed, moved);
        hear_moved(moved);
        put_back(parts_, weld_, moved.all());
        return apart;
    }

  private:
    [[nodiscard]] bool is_first() const { return ranks_.rank() == 0; }

    /// Finds the watched vertices of this rank's parts, each once.
    void find_watched() {
        std::vector<std::uint64_t> number;
        std::vector<bool> owned;
        for (const PartRecord& r : parts_.records()) {
            if (r.not_alone == 0) {
                continue;
            }
            progress_.check();
            weld_.numbers(r, number, owned);
            const auto positions = parts_.vertices(r);
            for (const std::uint32_t v : parts_.not_alone(r)) {
                watched_.add({positions[v], owned[v] ? 1U : 0U, number[v]});
            }
        }
        const std::span<Watched> all = watched_.all();
        tbb::parallel_sort(all.begin(), all.end(), [](const Watched& a, const Watched& b) {
            return std::tuple(a.number, 1 - a.is_owned) < std::tuple(b.number, 1 - b.is_owned);
        });
        const auto end =
            std::unique(all.begin(), all.end(),
                        [](const Watched& a, const Watched& b) { return a.number == b.number; });
        watched_.shrink(static_cast<std::uint64_t>(end - all.begin()));
    }

    void tell_homes() {
        RowMail<Watched> mail(folder_);
        for (const Watched& w : watched_.all()) {
            mail.add(home_of(w.at, ranks_.size()), w);
        }
        mail.exchange(ranks_, [&](int from, const Watched& w) {
            found_.add({w, static_cast<std::uint32_t>(from)});
        });
        const std::span<Found> all = found_.all();
        tbb::parallel_sort(all.begin(), all.end(), [](const Found& a, const Found& b) {
            return std::tie(a.vertex.at, a.vertex.number, a.from) <
                   std::tie(b.vertex.at, b.vertex.number, b.from);
        });
    }

    /// Tells the ranks which of their vertices share a place. Returns the number found by this rank
    /// as a home.
    std::uint64_t tell_touched() {
        RowMail<std::uint64_t> mail(folder_);
        std::uint64_t count = 0;
        const std::span<const Found> all = found_.all();
        for (std::size_t begin = 0; begin < all.size();) {
            std::size_t end = begin + 1;
            bool several = false;
            while (end < all.size() && all[end].vertex.at == all[begin].vertex.at) {
                several = several || all[end].vertex.number != all[begin].vertex.number;
                ++end;
            }
            for (std::size_t i = begin; several && i < end; ++i) {
                mail.add(static_cast<int>(all[i].from), all[i].vertex.number);
                ++count;
            }
            begin = end;
        }
        mail.exchange(ranks_, [&](int, std::uint64_t number) { touched_.add(number); });
        const std::span<std::uint64_t> touched = touched_.all();
        tbb::parallel_sort(touched.begin(), touched.end());
        return count;
    }

    /// Sends them to rank 0.
    void gather_watched(const ApartRange& range, RowFile<PlacedVertex>& placed) {
        RowMail<Watched> mail(folder_);
        for (const Watched& w : watched_.all()) {
            if (w.is_owned != 0) {
                mail.add(0, w);
            }
        }
        watched_.clear();
        mail.exchange(ranks_, [&](int, const Watched& w) {
            placed.add(placed_vertex(w.number, w.at, range.rotation));
        });
        sort_by_place(placed.all());
    }

    ApartVertices keep_gathered(const ApartRange& range, RowFile<PlacedVertex>& placed,
                                RowFile<PlacedVertex>& moved) {
        ScratchFile position_file(folder_);
        std::span<Place> positions;
        if (is_first()) {
            position_file.map(weld_.vertices() * sizeof(Place));
            positions = position_file.as<Place>();
        }
        RowFile<ElementCorners> triangles(folder_);
        {
            const std::span<const std::uint64_t> touched = touched_.all();
            const auto touches = [&](std::uint64_t v) {
                return std::binary_search(touched.begin(), touched.end(), v);
            };
            RowMail<TouchedCorners> mail(folder_);
            for (const PartRecord& r : parts_.records()) {
                progress_.check();
                const TouchedInPart found = touched_in(parts_, r, weld_, touches);
                for (std::size_t t = 0; t < found.triangles.size(); ++t) {
                    mail.add(0, {found.triangles[t], found.at[t]});
                }
            }
            mail.exchange(ranks_, [&](int, const TouchedCorners& t) {
                triangles.add(t.corners);
                for (std::size_t i = 0; i < 3; ++i) {
                    positions[t.corners[i]] = t.at[i];
                }
            });
        }
        ApartVertices apart;
        RowMail<MovedVertex> mail(folder_);
        if (is_first()) {
            apart = keep_apart(positions, triangles.all(), placed.all(), range, folder_, progress_);
            for (const PlacedVertex& v : placed.all()) {
                if (v.now != v.start) {
                    mail.add(home_of(v.start, ranks_.size()), {v.number, v.start, v.now});
                }
            }
        }
        mail.exchange(ranks_, [&](int, const MovedVertex& v) {
            PlacedVertex at_home;
            at_home.number = v.number;
            at_home.start = v.start;
            at_home.now = v.now;
            moved.add(at_home);
        });
        return apart;
    }

    /// Receives new positions from the homes, which know the ranks of each vertex.
    void hear_moved(RowFile<PlacedVertex>& moved) {
        RowMail<MovedVertex> mail(folder_);
        const std::span<const Found> all = found_.all();
        for (const PlacedVertex& v : moved.all()) {
            auto at = std::lower_bound(all.begin(), all.end(), v,
                                       [](const Found& f, const PlacedVertex& sought) {
                                           return std::tie(f.vertex.at, f.vertex.number) <
                                                  std::tie(sought.start, sought.number);
                                       });
            for (; at != all.end() && at->vertex.number == v.number; ++at) {
                mail.add(static_cast<int>(at->from), {v.number, v.start, v.now});
            }
        }
        moved.clear();
        mail.exchange(ranks_, [&](int, const MovedVertex& v) {
            PlacedVertex here;
            here.number = v.number;
            here.start = v.start;
            here.now = v.now;
            moved.add(here);
        });
    }

    Communicator& ranks_;
    PartStore& parts_;
    const VertexNumbers& weld_;
    ScratchFolder folder_;
    Progress& progress_;
    RowFile<Watched> watched_;        ///< sorted by number
    RowFile<Found> found_;            ///< sorted by place, number and rank
    RowFile<std::uint64_t> touched_;  ///< this rank's vertices that share a place, sorted
};

}  // namespace

ApartVertices keep_apart_on_ranks(Communicator& ranks, PartStore& parts, const VertexNumbers& weld,
                                  const ApartRange& range, const ScratchFolder& folder,
                                  Progress& progress) {
    return ApartOnRanks(ranks, parts, weld, folder, progress).run(range);
}

}  // namespace isonest::detail
