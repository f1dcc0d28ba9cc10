#include "query/check/findings.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <string_view>
#include <tuple>
#include <utility>

namespace isonest::detail {
namespace {

constexpr std::size_t kMaxFindings = 100;
constexpr std::array<std::string_view, 12> kTests{
    "table",     "checksum",   "decode", "range",  "injection", "saturation",
    "indicator", "cube range", "hdf5",   "footer", "source",    "bound"};

/// Numbers and texts, one after another.
struct Writer {
    std::string text;

    void put(std::int64_t number) {
        text.append(reinterpret_cast<const char*>(&number), sizeof(number));
    }
    void put(const std::string& string) {
        put(static_cast<std::int64_t>(string.size()));
        text += string;
    }
};

struct Reader {
    std::string_view text;

    std::int64_t number() {
        std::int64_t number = 0;
        std::memcpy(&number, text.data(), sizeof(number));
        text.remove_prefix(sizeof(number));
        return number;
    }
    std::string string() {
        const auto size = static_cast<std::size_t>(number());
        std::string out(text.substr(0, size));
        text.remove_prefix(size);
        return out;
    }
};

}  // namespace

bool Findings::Entry::operator<(const Entry& other) const {
    const auto key = [](const Entry& e) {
        const Int3& node = e.finding.node;
        return std::tie(e.test, e.row, node.z, node.y, node.x, e.finding.message);
    };
    return key(*this) < key(other);
}

void Findings::add(const char* test, const ArrayInfo& array, const Int3& chunk, const Int3& node,
                   const std::string& message) {
    const auto* const rank = std::find(kTests.begin(), kTests.end(), test);
    Entry entry{static_cast<std::size_t>(rank - kTests.begin()),
                array.row_of(chunk),
                {test,
                 array.coordinate < 0 ? std::string(name_of(array.field))
                                      : std::string("positions ") +
                                            "xyz"[static_cast<std::size_t>(array.coordinate)],
                 array.level, chunk, node, message}};
    const std::lock_guard lock(mutex_);
    ++report_.failures;
    insert(std::move(entry));
}

void Findings::insert(Entry entry) {
    if (first_.size() == kMaxFindings) {
        if (!(entry < first_.back())) {
            return;
        }
        first_.pop_back();
    }
    first_.insert(std::upper_bound(first_.begin(), first_.end(), entry), std::move(entry));
}

void Findings::add_damaged(const char* test, const ArrayInfo& array, const Int3& chunk,
                           const std::string& message) {
    {
        const std::lock_guard lock(mutex_);
        auto damaged = damaged_[array.row_of(chunk)];
        if (damaged) {
            return;
        }
        damaged = true;
        any_damaged_ = true;
    }
    add(test, array, chunk, kWholeChunk, message);
}

bool Findings::is_damaged(const ArrayInfo& array, const Int3& chunk) {
    const std::lock_guard lock(mutex_);
    return damaged_[array.row_of(chunk)];
}

bool Findings::any_damaged() {
    const std::lock_guard lock(mutex_);
    return any_damaged_;
}

void Findings::note_damage() {
    const std::lock_guard lock(mutex_);
    any_damaged_ = true;
}

void Findings::gather(Communicator& ranks) {
    std::array sums{report_.chunks, report_.nodes, report_.cubes, report_.failures};
    ranks.sum(sums);
    Writer own;
    for (const Entry& e : first_) {
        const Finding& f = e.finding;
        for (const std::int64_t number :
             {static_cast<std::int64_t>(e.test), static_cast<std::int64_t>(e.row),
              static_cast<std::int64_t>(f.level), f.chunk.x, f.chunk.y, f.chunk.z, f.node.x,
              f.node.y, f.node.z}) {
            own.put(number);
        }
        own.put(f.field);
        own.put(f.message);
    }
    const std::vector<std::string> all = ranks.gather(own.text);
    for (std::size_t rank = 1; rank < all.size(); ++rank) {
        for (Reader in{all[rank]}; !in.text.empty();) {
            Entry e;
            e.test = static_cast<std::size_t>(in.number());
            e.row = static_cast<std::uint64_t>(in.number());
            e.finding.test = kTests[e.test];
            e.finding.level = static_cast<int>(in.number());
            for (Int3* const place : {&e.finding.chunk, &e.finding.node}) {
                *place = {in.number(), in.number(), in.number()};
            }
            e.finding.field = in.string();
            e.finding.message = in.string();
            insert(std::move(e));
        }
    }
    report_.chunks = sums[0];
    report_.nodes = sums[1];
    report_.cubes = sums[2];
    report_.failures = sums[3];
}

void Findings::count(std::int64_t nodes, std::uint64_t chunks, std::uint64_t cubes) {
    const std::lock_guard lock(mutex_);
    report_.nodes += static_cast<std::uint64_t>(nodes);
    report_.chunks += chunks;
    report_.cubes += cubes;
}

CheckReport Findings::take() {
    for (Entry& entry : first_) {
        report_.findings.push_back(std::move(entry.finding));
    }
    return std::move(report_);
}

}  // namespace isonest::detail
