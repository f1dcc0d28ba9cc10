#include "query/ranks/rank_weld.h"

#include <oneapi/tbb/parallel_sort.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstring>
#include <limits>
#include <tuple>

#include "query/march/mesh_part.h"
#include "query/ranks/rank_mapping.h"
#include "query/ranks/row_mail.h"

namespace isonest::detail {
namespace {

constexpr std::uint64_t kNotNumbered = std::numeric_limits<std::uint64_t>::max();
/// Flag in a number: another part owns the vertex of this representative.
constexpr std::uint64_t kOfOther = std::uint64_t{1} << 63U;

/// A cut, identified by its ends, which are shared elements, and its plane.
struct CutKey {
    std::array<std::uint64_t, 5> words{};
    auto operator<=>(const CutKey&) const = default;  // NOLINT(modernize-use-nullptr)
};
struct CutKeyHash {
    std::size_t operator()(const CutKey& key) const {
        std::uint64_t h = 0;
        for (const std::uint64_t word : key.words) {
            h = (h ^ word) * 0x9E3779B97F4A7C15ULL;
            h ^= h >> 29U;
        }
        return static_cast<std::size_t>(h);
    }
};
CutKey cut_key(SharedPlace a, SharedPlace b, std::uint32_t plane) {
    if (precedes(b, a)) {
        std::swap(a, b);
    }
    const auto rest = [](const SharedPlace& p) {
        return std::uint64_t{p.place} << 32U | std::uint64_t{p.rank} << 1U | p.is_link;
    };
    return {{a.order, rest(a), b.order, rest(b), plane}};
}

/// A part's counts, for rank 0.
struct PartCount {
    std::uint64_t order = 0;
    std::uint32_t owned = 0;
    std::uint32_t triangles = 0;
};
struct CountedPart {
    PartCount count;
    std::uint32_t from = 0;
    std::uint64_t number = 0;  ///< index among those of its rank
};
struct PartFirsts {
    std::uint64_t number = 0;
    std::uint64_t vertex = 0;
    std::uint64_t triangle = 0;
};
struct MeshCounts {
    std::uint64_t vertices = 0;
    std::uint64_t triangles = 0;
};

/// A request for a number: the owner, and the element for which it is requested.
struct NumberRequest {
    std::uint64_t order = 0;
    std::uint64_t element = 0;
    std::uint32_t place = 0;
};
struct NumberAnswer {
    std::uint64_t element = 0;
    std::uint64_t number = 0;
};

}  // namespace

RankWeld::RankWeld(Communicator& ranks, PartStore& parts, const ScratchFolder& folder)
    : ranks_(ranks),
      parts_(parts),
      folder_(folder),
      own_(parts, folder, Weld::Cuts::apart),
      best_file_(folder),
      number_file_(folder) {
    std::uint64_t shared = 0;
    for (const PartRecord& r : parts_.records()) {
        shared += r.shared;
    }
    best_file_.map(shared * sizeof(SharedPlace));
    best_ = best_file_.as<SharedPlace>();
    number_file_.map(shared * sizeof(std::uint64_t));
    number_ = number_file_.as<std::uint64_t>();
    begin_places();
    unite_across_ranks();
    count_owned();
    find_firsts();
    number_own();
    number_others();
}

template <class Work>
void RankWeld::each_shared(const Work& work) const {
    for (const PartRecord& r : parts_.records()) {
        std::uint64_t e = r.first_shared;
        for (const MeshPart::Shared& s : parts_.shared(r)) {
            work(r, e++, s);
        }
    }
}

SharedPlace RankWeld::own_place(const PartRecord& r, std::uint64_t element,
                                const MeshPart::Shared& shared) const {
    SharedPlace place;
    place.order = r.order;
    place.place = static_cast<std::uint32_t>(element - r.first_shared);
    place.rank = static_cast<std::uint32_t>(ranks_.rank()) & 0x7FFFFFFFU;
    place.is_link = shared.vertex == MeshPart::kNoVertex ? 1 : 0;
    return place;
}

void RankWeld::begin_places() {
    each_shared([&](const PartRecord& r, std::uint64_t e, const MeshPart::Shared& s) {
        best_[e] = own_place(r, e, s);
        number_[e] = kNotNumbered;
    });
}

void RankWeld::unite_across_ranks() {
    SharedNames<VertexKey, VertexKeyHash> names(ranks_, folder_);
    SharedNames<CutKey, CutKeyHash> cuts(ranks_, folder_);
    const auto tell_all = [&] {
        for (;;) {
            std::uint64_t untold = names.untold(best_) + cuts.untold(best_);
            ranks_.sum({&untold, 1});
            if (untold == 0) {
                return;
            }
            names.tell_again(best_);
            cuts.tell_again(best_);
        }
    };
    std::uint64_t cut = 0;
    for (const PartRecord& r : parts_.records()) {
        for (const MeshPart::Name& name : parts_.names(r)) {
            names.add(name.key, own_.representative(r.first_shared + name.shared));
        }
        cut += r.cuts;
    }
    names.tell(best_);
    tell_all();
    ranks_.sum({&cut, 1});
    if (cut == 0) {
        return;
    }
    // As in Weld, the ends are those before any cuts are merged.
    const auto best_of = [&](std::uint64_t e) { return best_[own_.representative(e)]; };
    for (const PartRecord& r : parts_.records()) {
        for (const MeshPart::Cut& c : parts_.cuts(r)) {
            cuts.add(cut_key(best_of(r.first_shared + c.end0), best_of(r.first_shared + c.end1),
                             c.plane),
                     own_.representative(r.first_shared + c.shared));
        }
    }
    cuts.tell(best_);
    tell_all();
}

void RankWeld::count_owned() {
    for (PartRecord& r : parts_.records()) {
        r.owned = r.vertices;
        std::uint64_t e = r.first_shared;
        for (const MeshPart::Shared& s : parts_.shared(r)) {
            const bool is_own = own_.representative(e) == e && best_[e] == own_place(r, e, s);
            r.owned -= s.vertex != MeshPart::kNoVertex && !is_own ? 1 : 0;
            ++e;
        }
    }
}

void RankWeld::find_firsts() {
    const std::span<PartRecord> records = parts_.records();
    RowMail<PartCount> counts(folder_);
    for (const PartRecord& r : records) {
        counts.add(0, {r.order, r.owned, r.triangles});
    }
    RowFile<CountedPart> counted(folder_);
    std::vector<std::uint64_t> numbers(static_cast<std::size_t>(ranks_.size()));
    counts.exchange(ranks_, [&](int from, const PartCount& count) {
        counted.add(
            {count, static_cast<std::uint32_t>(from), numbers[static_cast<std::size_t>(from)]++});
    });
    const std::span<CountedPart> all = counted.all();
    tbb::parallel_sort(all.begin(), all.end(), [](const CountedPart& a, const CountedPart& b) {
        return std::tie(a.count.order, a.from, a.number) <
               std::tie(b.count.order, b.from, b.number);
    });
    MeshCounts totals;
    RowMail<PartFirsts> firsts(folder_);
    for (const CountedPart& part : all) {
        firsts.add(static_cast<int>(part.from), {part.number, totals.vertices, totals.triangles});
        totals.vertices += part.count.owned;
        totals.triangles += part.count.triangles;
    }
    firsts.exchange(ranks_, [&](int, const PartFirsts& first) {
        records[first.number].first_vertex = first.vertex;
        records[first.number].first_triangle = first.triangle;
    });
    totals = value_of_text<MeshCounts>(ranks_.broadcast(text_of_value(totals)));
    vertices_ = totals.vertices;
    triangles_ = totals.triangles;
}

void RankWeld::number_own() {
    for (const PartRecord& r : parts_.records()) {
        std::uint64_t e = r.first_shared;
        std::uint32_t others = 0;
        for (const MeshPart::Shared& s : parts_.shared(r)) {
            if (s.vertex != MeshPart::kNoVertex) {
                if (own_.representative(e) == e && best_[e] == own_place(r, e, s)) {
                    number_[e] = r.first_vertex + s.vertex - others;
                } else {
                    ++others;
                }
            }
            ++e;
        }
    }
}

void RankWeld::number_others() {
    RowMail<NumberRequest> requests(folder_);
    each_shared([&](const PartRecord& /*r*/, std::uint64_t e, const MeshPart::Shared& s) {
        if (s.vertex != MeshPart::kNoVertex && own_.representative(e) == e &&
            number_[e] == kNotNumbered) {
            requests.add(static_cast<int>(best_[e].rank), {best_[e].order, e, best_[e].place});
        }
    });
    RowMail<NumberAnswer> answers(folder_);
    const std::span<const PartRecord> records = parts_.records();
    requests.exchange(ranks_, [&](int from, const NumberRequest& request) {
        const auto r = std::lower_bound(
            records.begin(), records.end(), request.order,
            [](const PartRecord& a, std::uint64_t order) { return a.order < order; });
        answers.add(from, {request.element, number_[r->first_shared + request.place]});
    });
    answers.exchange(ranks_, [&](int, const NumberAnswer& answer) {
        number_[answer.element] = answer.number | kOfOther;
    });
}

void RankWeld::numbers(const PartRecord& record, std::vector<std::uint64_t>& number,
                       std::vector<bool>& owned) const {
    number.assign(record.vertices, kNotNumbered);
    owned.assign(record.vertices, true);
    std::uint64_t e = record.first_shared;
    for (const MeshPart::Shared& s : parts_.shared(record)) {
        const std::uint64_t first = own_.representative(e);
        if (s.vertex != MeshPart::kNoVertex && (first != e || (number_[first] & kOfOther) != 0)) {
            number[s.vertex] = number_[first] & ~kOfOther;
            owned[s.vertex] = false;
        }
        ++e;
    }
    std::uint64_t next = record.first_vertex;
    for (std::size_t v = 0; v < number.size(); ++v) {
        if (owned[v]) {
            number[v] = next++;
        }
    }
}

}  // namespace isonest::detail
