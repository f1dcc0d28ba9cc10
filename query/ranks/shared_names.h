// Which elements of different ranks' parts are one vertex: those that have a name in common, or are
// linked by others that have.
//
// Each name has a home, one of the ranks, by its hash. A rank tells the home of each of its names
// the best vertex that it knows to have it; where several ranks have a name, the home answers all
// of them with the best of all. An element with several names may so learn of a better vertex than
// another of its names' homes knows, and tells that home, until nobody learns anything any more.
#pragma once

#include <oneapi/tbb/parallel_sort.h>

#include <algorithm>
#include <cstdint>
#include <span>
#include <tuple>
#include <vector>

#include "query/ranks/row_mail.h"
#include "store/files/scratch_file.h"
#include "store/ranks/communicator.h"

namespace isonest::detail {

/// A shared element of any rank: those with a vertex come first, then the order of the mesh's
/// parts counts, then the place in the part.
struct SharedPlace {
    std::uint64_t order = 0;  ///< of the part
    std::uint32_t place = 0;  ///< among the part's shared elements
    std::uint32_t rank : 31 = 0;
    std::uint32_t is_link : 1 = 0;  ///< has no vertex
    bool operator==(const SharedPlace&) const = default;
};
inline bool precedes(const SharedPlace& a, const SharedPlace& b) {
    const auto key = [](const SharedPlace& p) {
        return std::tuple<bool, std::uint64_t, std::uint32_t, std::uint32_t>(p.is_link, p.order,
                                                                             p.place, p.rank);
    };
    return key(a) < key(b);
}

/// Names of one kind. `Key`: has an order; `Hash`: of a key. What grows with the mesh lies in
/// temporary files. Thread-safety: none.
template <class Key, class Hash>
class SharedNames {
  public:
    SharedNames(Communicator& ranks, const ScratchFolder& folder)
        : ranks_(ranks), folder_(folder), own_(folder), crossing_(folder), held_(folder) {}

    /// A name of this rank's element. Elements of this rank that have a name in common may be given
    /// as one.
    void add(const Key& key, std::uint64_t element) {
        const auto home =
            static_cast<std::uint32_t>(Hash()(key) % static_cast<std::size_t>(ranks_.size()));
        own_.add({home, key, element});
    }
    /// After all were added: tells the homes, and hears what others have told. `best`: of each of
    /// this rank's elements what is known. Collective. Throws Error{io, cancelled}.
    void tell(std::span<SharedPlace> best) {
        std::span<Own> own = own_.all();
        const auto key_of = [](const Own& o) { return std::tie(o.home, o.key, o.element); };
        tbb::parallel_sort(own.begin(), own.end(),
                           [&](const Own& a, const Own& b) { return key_of(a) < key_of(b); });
        const auto end = std::unique(own.begin(), own.end(), [&](const Own& a, const Own& b) {
            return key_of(a) == key_of(b);
        });
        own = own.first(static_cast<std::size_t>(end - own.begin()));
        std::vector<std::uint64_t> first(static_cast<std::size_t>(ranks_.size()) + 1);
        {
            RowMail<Told> mail(folder_);
            for (const Own& o : own) {
                ++first[o.home + 1];
                mail.add(static_cast<int>(o.home), {o.key, best[o.element]});
            }
            for (std::size_t home = 1; home < first.size(); ++home) {
                first[home] += first[home - 1];
            }
            std::vector<std::uint64_t> numbers(static_cast<std::size_t>(ranks_.size()));
            mail.exchange(ranks_, [&](int from, const Told& told) {
                held_.add({told.key, told.best, static_cast<std::uint32_t>(from),
                           numbers[static_cast<std::size_t>(from)]++});
            });
        }
        keep_several();
        RowMail<First> answers(folder_);
        const std::span<Held> held = held_.all();
        each_name(held, [&](std::span<Held> same) {
            const SharedPlace all = best_of(same);
            for (Held& h : same) {
                h.best = all;
                answers.add(static_cast<int>(h.from),
                            {h.number, static_cast<std::uint64_t>(&h - held.data()), all});
            }
        });
        answers.exchange(ranks_, [&](int home, const First& answer) {
            const std::uint64_t element =
                own[first[static_cast<std::size_t>(home)] + answer.number].element;
            crossing_.add({element, answer.slot, static_cast<std::uint32_t>(home), answer.best});
            improve(best[element], answer.best);
        });
        own_.clear();
        const std::span<Crossing> crossing = crossing_.all();
        tbb::parallel_sort(crossing.begin(), crossing.end(),
                           [](const Crossing& a, const Crossing& b) {
                               return std::tie(a.home, a.slot) < std::tie(b.home, b.slot);
                           });
    }
    /// How many homes do not know what this rank knows.
    std::uint64_t untold(std::span<const SharedPlace> best) {
        const std::span<const Crossing> crossing = crossing_.all();
        return static_cast<std::uint64_t>(
            std::count_if(crossing.begin(), crossing.end(),
                          [&](const Crossing& c) { return precedes(best[c.element], c.known); }));
    }
    /// Tells them, and hears what follows from it. Collective. Throws Error{io, cancelled}.
    void tell_again(std::span<SharedPlace> best) {
        const std::span<Crossing> crossing = crossing_.all();
        RowMail<Again> mail(folder_);
        for (Crossing& c : crossing) {
            if (precedes(best[c.element], c.known)) {
                c.known = best[c.element];
                mail.add(static_cast<int>(c.home), {c.slot, c.known});
            }
        }
        const std::span<Held> held = held_.all();
        mail.exchange(ranks_,
                      [&](int, const Again& told) { improve(held[told.slot].best, told.best); });
        RowMail<Again> answers(folder_);
        each_name(held, [&](std::span<Held> same) {
            const SharedPlace all = best_of(same);
            for (Held& h : same) {
                if (precedes(all, h.best)) {
                    h.best = all;
                    answers.add(static_cast<int>(h.from),
                                {static_cast<std::uint64_t>(&h - held.data()), all});
                }
            }
        });
        answers.exchange(ranks_, [&](int home, const Again& answer) {
            const auto at = std::lower_bound(
                crossing.begin(), crossing.end(),
                std::pair(static_cast<std::uint32_t>(home), answer.slot),
                [](const Crossing& c, const auto& p) { return std::pair(c.home, c.slot) < p; });
            at->known = answer.best;
            improve(best[at->element], answer.best);
        });
    }

  private:
    /// A name of this rank.
    struct Own {
        std::uint32_t home = 0;
        Key key;
        std::uint64_t element = 0;
    };
    struct Told {
        Key key;
        SharedPlace best;
    };
    /// A name of any rank, at its home.
    struct Held {
        Key key;
        SharedPlace best;  ///< that the rank knows
        std::uint32_t from = 0;
        std::uint64_t number = 0;  ///< among those that the rank told this one
    };
    struct First {
        std::uint64_t number = 0;
        std::uint64_t slot = 0;  ///< among those that the home holds
        SharedPlace best;
    };
    struct Again {
        std::uint64_t slot = 0;
        SharedPlace best;
    };
    /// A name that others have told as well.
    struct Crossing {
        std::uint64_t element = 0;
        std::uint64_t slot = 0;
        std::uint32_t home = 0;
        SharedPlace known;  ///< to the home
    };

    static void improve(SharedPlace& best, const SharedPlace& other) {
        best = precedes(other, best) ? other : best;
    }
    static SharedPlace best_of(std::span<const Held> same) {
        return std::min_element(
                   same.begin(), same.end(),
                   [](const Held& a, const Held& b) { return precedes(a.best, b.best); })
            ->best;
    }
    /// work(those of one name) for each. REQUIRES: sorted.
    template <class Work>
    static void each_name(std::span<Held> held, const Work& work) {
        for (std::size_t begin = 0; begin < held.size();) {
            std::size_t end = begin + 1;
            while (end < held.size() && held[end].key == held[begin].key) {
                ++end;
            }
            work(held.subspan(begin, end - begin));
            begin = end;
        }
    }
    /// Of the names that were told, those that came several times.
    void keep_several() {
        const std::span<Held> held = held_.all();
        tbb::parallel_sort(held.begin(), held.end(), [](const Held& a, const Held& b) {
            return std::tie(a.key, a.from, a.number) < std::tie(b.key, b.from, b.number);
        });
        std::uint64_t kept = 0;
        each_name(held, [&](std::span<Held> same) {
            if (same.size() > 1) {
                std::copy(same.begin(), same.end(),
                          held.begin() + static_cast<std::ptrdiff_t>(kept));
                kept += same.size();
            }
        });
        held_.shrink(kept);
    }

    Communicator& ranks_;
    ScratchFolder folder_;
    RowFile<Own> own_;
    RowFile<Crossing> crossing_;  ///< sorted by home and slot
    RowFile<Held> held_;          ///< sorted by name
};

}  // namespace isonest::detail
