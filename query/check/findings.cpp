#include "query/check/findings.h"

#include <algorithm>
#include <array>
#include <string_view>
#include <tuple>

namespace isonest::detail {
namespace {

constexpr std::size_t kMostFindings = 100;
constexpr std::array<std::string_view, 11> kTests{
    "table",     "checksum",   "decode", "range",  "injection", "saturation",
    "indicator", "cube range", "hdf5",   "source", "bound"};

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
                {test, std::string(name_of(array.field)), array.level, chunk, node, message}};
    const std::lock_guard lock(mutex_);
    ++report_.failures;
    if (first_.size() == kMostFindings) {
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
