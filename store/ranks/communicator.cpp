#include "store/ranks/communicator.h"

#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <stdexcept>

namespace isonest::detail {
namespace {

std::vector<std::byte> bytes_of(std::string_view text) {
    const auto bytes = std::as_bytes(std::span(text.data(), text.size()));
    return {bytes.begin(), bytes.end()};
}

std::string text_of(std::span<const std::byte> bytes) {
    return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

/// Combines the numbers of all ranks on rank 0, and sends the result to all of them.
template <class T, class Combine>
void reduce(Communicator& ranks, std::span<T> numbers, const Combine& combine) {
    const auto bytes = std::as_bytes(numbers);
    const std::vector<std::string> all = ranks.gather(text_of(bytes));
    for (std::size_t r = 1; r < all.size(); ++r) {
        for (std::size_t i = 0; i < numbers.size(); ++i) {
            T other{};
            std::memcpy(&other, all[r].data() + i * sizeof(T), sizeof(T));
            numbers[i] = combine(numbers[i], other);
        }
    }
    const std::string result = ranks.broadcast(text_of(bytes));
    std::memcpy(numbers.data(), result.data(), result.size());
}

}  // namespace

std::vector<std::string> Communicator::gather(std::string_view text) {
    std::vector<std::string> all;
    bool is_sent = rank() == 0;
    if (rank() == 0) {
        all.resize(static_cast<std::size_t>(size()));
        all.front() = text;
    }
    exchange(
        [&](Message& message) {
            if (is_sent) {
                return false;
            }
            is_sent = true;
            message = {0, bytes_of(text)};
            return true;
        },
        rank() == 0 ? static_cast<std::uint64_t>(size()) - 1 : 0,
        [&](int from, std::span<const std::byte> bytes) {
            all[static_cast<std::size_t>(from)] = text_of(bytes);
        });
    return all;
}

std::string Communicator::broadcast(std::string text) {
    int to = rank() == 0 ? 1 : size();
    exchange(
        [&](Message& message) {
            if (to >= size()) {
                return false;
            }
            message = {to++, bytes_of(text)};
            return true;
        },
        rank() == 0 ? 0 : 1,
        [&](int /*from*/, std::span<const std::byte> bytes) { text = text_of(bytes); });
    return text;
}

void Communicator::sum(std::span<std::uint64_t> numbers) {
    reduce(*this, numbers, [](std::uint64_t a, std::uint64_t b) { return a + b; });
}

void Communicator::largest(std::span<double> numbers) {
    reduce(*this, numbers, [](double a, double b) { return std::max(a, b); });
}

void Communicator::meet() {
    gather({});
    broadcast({});
}

std::string OneRank::host() const {
    std::array<char, 256> name{};
    return ::gethostname(name.data(), name.size() - 1) == 0 ? name.data() : "localhost";
}

void OneRank::exchange(const Next& next, std::uint64_t expected, const Take& /*take*/) {
    Message message;
    if (next(message) || expected != 0) {
        throw std::logic_error("a single rank cannot exchange messages");
    }
}

}  // namespace isonest::detail
