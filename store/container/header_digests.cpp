#include "store/container/header_digests.h"

#include <span>

#include "store/base/checksum.h"

namespace isonest::detail {

std::vector<double> flat_directions(const Directions& direction) {
    std::vector<double> numbers;
    for (const Double3& axis : direction) {
        numbers.insert(numbers.end(), axis.begin(), axis.end());
    }
    return numbers;
}

std::uint64_t direction_digest(const Directions& direction) {
    const std::vector<double> numbers = flat_directions(direction);
    Checksum sum;
    sum.add(std::as_bytes(std::span(numbers)));
    return sum.value();
}

std::uint64_t text_digest(std::string_view text) {
    Checksum sum;
    sum.add(std::as_bytes(std::span(text.data(), text.size())));
    return sum.value();
}

}  // namespace isonest::detail
