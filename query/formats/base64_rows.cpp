// Source of the letters: RFC 4648, section 4.
#include "query/formats/base64_rows.h"

#include <algorithm>
#include <cstring>
#include <vector>

namespace isonest::detail {
namespace {

constexpr std::string_view kLetters =
    "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";

/// Two letters for each 12 bits.
constexpr auto kPairs = [] {
    std::array<std::array<char, 2>, 4096> pairs{};
    for (std::size_t i = 0; i < pairs.size(); ++i) {
        pairs[i] = {kLetters[i / 64], kLetters[i % 64]};
    }
    return pairs;
}();

void put_letters(std::uint8_t a, std::uint8_t b, std::uint8_t c, char* out) {
    std::memcpy(out, kPairs[a * 16U + b / 16U].data(), 2);
    std::memcpy(out + 2, kPairs[(b % 16U) * 256U + c].data(), 2);
}

}  // namespace

void Base64Rows::put(const Base64Array& array, std::uint64_t at, std::span<const std::byte> bytes,
                     const Write& write) {
    const auto* const data = reinterpret_cast<const std::uint8_t*>(bytes.data());
    const std::uint64_t end = at + bytes.size();
    const auto add_some = [&](std::uint64_t from, std::uint64_t to) {
        Group group;
        for (std::uint64_t i = from; i < to; ++i) {
            group.bytes.at(i % 3) = data[i - at];
            group.has = static_cast<std::uint8_t>(group.has | 1U << (i % 3));
        }
        const std::uint64_t size = std::min<std::uint64_t>(3, array.bytes - from / 3 * 3);
        group.all = static_cast<std::uint8_t>((1U << size) - 1);
        add(array.text + from / 3 * 4, group, write);
    };
    const std::uint64_t whole_begin = std::min((at + 2) / 3 * 3, end);
    if (at < whole_begin) {
        add_some(at, whole_begin);
    }
    const std::uint64_t whole_end = std::max(end / 3 * 3, whole_begin);
    constexpr std::uint64_t kAtOnce = 3 * (std::uint64_t{1} << 16U);
    std::vector<char> letters(std::min(whole_end - whole_begin, kAtOnce) / 3 * 4);
    for (std::uint64_t from = whole_begin; from < whole_end; from += kAtOnce) {
        const std::uint64_t to = std::min(from + kAtOnce, whole_end);
        char* out = letters.data();
        for (const std::uint8_t* in = data + (from - at); in != data + (to - at); in += 3) {
            put_letters(in[0], in[1], in[2], out);
            out += 4;
        }
        write(array.text + from / 3 * 4,
              std::as_bytes(std::span(letters).first((to - from) / 3 * 4)));
    }
    if (whole_end < end) {
        add_some(whole_end, end);
    }
}

void Base64Rows::add(std::uint64_t place, const Group& some, const Write& write) {
    Group group;
    {
        const std::lock_guard lock(mutex_);
        Group& waiting = waiting_[place];
        for (std::size_t i = 0; i < some.bytes.size(); ++i) {
            waiting.bytes.at(i) |= some.bytes.at(i);
        }
        waiting.has |= some.has;
        waiting.all = some.all;
        group = waiting;
        if (group.has != group.all) {
            return;
        }
        waiting_.erase(place);
    }
    std::array<char, 4> letters{};
    put_letters(group.bytes[0], group.bytes[1], group.bytes[2], letters.data());
    for (std::size_t i = 1; i < group.bytes.size(); ++i) {
        if ((group.all >> i & 1U) == 0) {
            letters.at(i + 1) = '=';
        }
    }
    write(place, std::as_bytes(std::span(letters)));
}

std::string Base64Rows::take() {
    const std::lock_guard lock(mutex_);
    std::string taken;
    for (const auto& [place, group] : waiting_) {
        taken.append(reinterpret_cast<const char*>(&place), sizeof(place));
        taken.append(reinterpret_cast<const char*>(&group), sizeof(group));
    }
    waiting_.clear();
    return taken;
}

void Base64Rows::include(std::string_view taken, const Write& write) {
    while (!taken.empty()) {
        std::uint64_t place = 0;
        Group group;
        std::memcpy(&place, taken.data(), sizeof(place));
        std::memcpy(&group, taken.data() + sizeof(place), sizeof(group));
        add(place, group, write);
        taken.remove_prefix(sizeof(place) + sizeof(group));
    }
}

bool Base64Rows::is_complete() const {
    const std::lock_guard lock(mutex_);
    return waiting_.empty();
}

}  // namespace isonest::detail
