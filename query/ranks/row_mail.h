// Rows of numbers in temporary files, and their transfer between ranks.
#pragma once

#include <oneapi/tbb/parallel_sort.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <optional>
#include <span>
#include <tuple>
#include <type_traits>
#include <utility>
#include <vector>

#include "store/files/scratch_file.h"
#include "store/ranks/communicator.h"

namespace isonest::detail {

/// Rows that are added one by one: up to 64 KiB in memory, more in a temporary file. Thread-safety:
/// none.
template <class Row>
class RowFile {
    static_assert(std::is_trivially_copyable_v<Row>);

  public:
    explicit RowFile(ScratchFolder folder) : folder_(std::move(folder)) {}

    /// Throws Error{io}.
    void add(const Row& row) {
        waiting_.push_back(row);
        if (waiting_.size() >= kWaiting) {
            flush();
        }
    }
    /// All rows, valid until the next call of another method; they may be changed. Throws
    /// Error{io}.
    std::span<Row> all() {
        if (!file_) {
            return waiting_;
        }
        flush();
        file_->map(count_ * sizeof(Row));
        return file_->template as<Row>().first(count_);
    }
    /// Keeps only the first `count` rows.
    void shrink(std::uint64_t count) {
        if (file_) {
            flush();
            count_ = count;
        } else {
            waiting_.resize(count);
        }
    }
    /// Removes all rows and frees the space.
    void clear() {
        waiting_ = {};
        file_.reset();
        count_ = 0;
    }

  private:
    static constexpr std::size_t kWaiting =
        std::max<std::size_t>(1, (std::size_t{1} << 16U) / sizeof(Row));
    void flush() {
        if (!waiting_.empty()) {
            if (!file_) {
                file_.emplace(folder_);
            }
            file_->write_at(count_ * sizeof(Row), std::as_bytes(std::span(waiting_)));
            count_ += waiting_.size();
            waiting_.clear();
        }
    }
    ScratchFolder folder_;
    std::optional<ScratchFile> file_;
    std::vector<Row> waiting_;
    std::uint64_t count_ = 0;  ///< in the file
};

/// Sends a number from every rank to every other one. Returns the numbers received, by rank; its
/// own one unchanged. Collective.
inline std::vector<std::uint64_t> told_by_all(Communicator& ranks,
                                              std::span<const std::uint64_t> to) {
    std::vector<std::uint64_t> told(to.begin(), to.end());
    int other = 0;
    ranks.exchange(
        [&](Communicator::Message& message) {
            other += other == ranks.rank() ? 1 : 0;
            if (other >= ranks.size()) {
                return false;
            }
            message.to = other;
            message.bytes.resize(sizeof(std::uint64_t));
            std::memcpy(message.bytes.data(), &to[static_cast<std::size_t>(other)],
                        sizeof(std::uint64_t));
            ++other;
            return true;
        },
        static_cast<std::uint64_t>(ranks.size()) - 1,
        [&](int from, std::span<const std::byte> bytes) {
            std::memcpy(&told[static_cast<std::size_t>(from)], bytes.data(), sizeof(std::uint64_t));
        });
    return told;
}

/// Rows for several ranks, including this one. If there is more than 1 MiB, rows wait in temporary
/// files; they are sent in messages of at most Communicator::kMaxBytes. Thread-safety: none.
template <class Row>
class RowMail {
  public:
    explicit RowMail(const ScratchFolder& folder) : folder_(folder), addressed_(folder) {}

    /// Throws Error{io}.
    void add(int to, const Row& row) { addressed_.add({static_cast<std::uint32_t>(to), row}); }
    /// Passes all rows that ranks have added for this one to take(from, row); those of a rank stay
    /// in order. Afterwards nothing waits. Collective. Throws Error{io, cancelled} and what `take`
    /// throws.
    template <class Take>
    void exchange(Communicator& ranks, const Take& take) {
        const auto size = static_cast<std::size_t>(ranks.size());
        const auto own = static_cast<std::size_t>(ranks.rank());
        std::vector<std::uint64_t> counts(size);
        const std::span<const Addressed> addressed = addressed_.all();
        for (const Addressed& a : addressed) {
            ++counts[a.to];
        }
        std::vector<std::uint64_t> first(size + 1);
        for (std::size_t to = 0; to < size; ++to) {
            first[to + 1] = first[to] + counts[to];
        }
        std::optional<ScratchFile> file;
        std::vector<Row> few;
        std::span<Row> rows;
        if (addressed.size() <= kRows) {
            few.resize(addressed.size());
            rows = few;
        } else {
            file.emplace(folder_);
            file->map(addressed.size() * sizeof(Row));
            rows = file->template as<Row>();
        }
        std::vector<std::uint64_t> at(first.begin(), first.end() - 1);
        for (const Addressed& a : addressed) {
            rows[at[a.to]++] = a.row;
        }
        addressed_.clear();
        const std::vector<std::uint64_t> told = told_by_all(ranks, counts);
        std::uint64_t expected = 0;
        for (std::size_t from = 0; from < size; ++from) {
            expected += from == own ? 0 : (told[from] + kRows - 1) / kRows;
        }
        for (const Row& row : rows.subspan(first[own], counts[own])) {
            take(ranks.rank(), row);
        }
        // Each rank starts with the next one, so that they do not all send to the same rank.
        std::size_t step = 1;
        std::uint64_t sent = 0;  // number for the current rank
        ranks.exchange(
            [&](Communicator::Message& message) {
                while (step < size && sent == counts[(own + step) % size]) {
                    ++step;
                    sent = 0;
                }
                if (step >= size) {
                    return false;
                }
                const std::size_t to = (own + step) % size;
                const std::uint64_t here = std::min(kRows, counts[to] - sent);
                const auto bytes = std::as_bytes(rows.subspan(first[to] + sent, here));
                message.to = static_cast<int>(to);
                message.bytes.assign(bytes.begin(), bytes.end());
                sent += here;
                return true;
            },
            expected,
            [&](int from, std::span<const std::byte> bytes) {
                for (; !bytes.empty(); bytes = bytes.subspan(sizeof(Row))) {
                    Row row;
                    std::memcpy(&row, bytes.data(), sizeof(row));
                    take(from, row);
                }
            });
    }

  private:
    static constexpr std::uint64_t kRows = Communicator::kMaxBytes / sizeof(Row);
    struct Addressed {
        std::uint32_t to = 0;
        Row row;
    };
    ScratchFolder folder_;
    RowFile<Addressed> addressed_;
};

// Which elements of different ranks' parts are one vertex: those with a common name, or linked by
// others with common names.
//
// Each name has a home, one of the ranks, given by its hash. A rank sends the best vertex that it
// knows for each of its names to the name's home. If several ranks have a name, the home sends the
// best of all to each of them. An element with several names may thus learn of a better vertex than
// the home of another of its names knows; it sends that to the other home, until nothing changes
// any more.

/// A shared element of any rank. Order: elements with a vertex first, then by the order of the
/// mesh's parts, then by the index in the part.
struct SharedPlace {
    std::uint64_t order = 0;  ///< of the part
    std::uint32_t place = 0;  ///< index among the part's shared elements
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

/// Names of one kind. `Key`: has an order; `Hash`: of a key. Data that grows with the mesh is kept
/// in temporary files. Thread-safety: none.
template <class Key, class Hash>
class SharedNames {
  public:
    SharedNames(Communicator& ranks, const ScratchFolder& folder)
        : ranks_(ranks), folder_(folder), own_(folder), crossing_(folder), held_(folder) {}

    /// Adds a name of this rank's element. Elements of this rank with a common name may be given as
    /// one.
    void add(const Key& key, std::uint64_t element) {
        const auto home =
            static_cast<std::uint32_t>(Hash()(key) % static_cast<std::size_t>(ranks_.size()));
        own_.add({home, key, element});
    }
    /// Call after all were added: sends to the homes, and receives what others have sent. `best`:
    /// for each of this rank's elements, the best known vertex. Collective. Throws Error{io,
    /// cancelled}.
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
    /// Number of homes that do not know what this rank knows.
    std::uint64_t untold(std::span<const SharedPlace> best) {
        const std::span<const Crossing> crossing = crossing_.all();
        return static_cast<std::uint64_t>(
            std::count_if(crossing.begin(), crossing.end(),
                          [&](const Crossing& c) { return precedes(best[c.element], c.known); }));
    }
    /// Sends the updates, and receives the results. Collective. Throws Error{io, cancelled}.
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
        SharedPlace best;  ///< known to the rank
        std::uint32_t from = 0;
        std::uint64_t number = 0;  ///< index among the names that the rank sent
    };
    struct First {
        std::uint64_t number = 0;
        std::uint64_t slot = 0;  ///< index among the names at the home
        SharedPlace best;
    };
    struct Again {
        std::uint64_t slot = 0;
        SharedPlace best;
    };
    /// A name that other ranks also have.
    struct Crossing {
        std::uint64_t element = 0;
        std::uint64_t slot = 0;
        std::uint32_t home = 0;
        SharedPlace known;  ///< known to the home
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
    /// Calls work(all held of one name) for each name. REQUIRES: sorted.
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
    /// Keeps only the received names that came several times.
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
