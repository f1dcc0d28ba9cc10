#include "store/bytes/cached_block.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstring>
#include <iterator>
#include <utility>

#include "store/base/checksum.h"

namespace isonest::detail {
namespace {

struct CachedBlockHead {
    std::array<char, 8> letters{};
    std::uint64_t checksum = 0;
    std::uint64_t number = 0;
    std::uint32_t name_bytes = 0;
    std::uint32_t parts = 0;
};
constexpr std::array<char, 8> kCachedBlockLetters{'i', 's', 'o', 'r', 'n', 'g', '0', '1'};
/// The checksum is that of what stands behind it.
constexpr std::size_t kCheckedFrom =
    offsetof(CachedBlockHead, checksum) + sizeof(CachedBlockHead::checksum);

/// memcpy() that takes null pointers to nothing.
void copy_bytes(void* to, const void* from, std::size_t n) {
    if (n > 0) {
        std::memcpy(to, from, n);
    }
}

}  // namespace

std::optional<CachedBlock> CachedBlock::decode(std::span<const std::byte> file,
                                               std::string_view object, std::uint64_t number) {
    CachedBlockHead head;
    if (file.size() < sizeof(head) || file.size() > kMostFileBytes) {
        return std::nullopt;
    }
    std::memcpy(&head, file.data(), sizeof(head));
    if (head.letters != kCachedBlockLetters || head.number != number ||
        head.name_bytes != object.size() || head.parts > kBytes ||
        checksum_of(file.subspan(kCheckedFrom)) != head.checksum) {
        return std::nullopt;
    }
    std::span<const std::byte> rest = file.subspan(sizeof(head));
    const std::size_t part_bytes = head.parts * sizeof(Part);
    if (rest.size() < part_bytes + object.size()) {
        return std::nullopt;
    }
    CachedBlock block;
    block.parts_.resize(head.parts);
    copy_bytes(block.parts_.data(), rest.data(), part_bytes);
    rest = rest.subspan(part_bytes);
    const auto name = std::as_bytes(std::span(object.data(), object.size()));
    if (!std::equal(name.begin(), name.end(), rest.begin())) {
        return std::nullopt;
    }
    rest = rest.subspan(object.size());
    block.bytes_.resize(block.parts_.empty() ? 0 : kBytes);
    std::size_t end = 0;
    for (const Part& part : block.parts_) {
        if (part.from < end || part.end() > kBytes || part.size > rest.size()) {
            return std::nullopt;
        }
        std::memcpy(block.bytes_.data() + part.from, rest.data(), part.size);
        rest = rest.subspan(part.size);
        end = part.end();
    }
    return rest.empty() ? std::optional(std::move(block)) : std::nullopt;
}

std::vector<std::byte> CachedBlock::encode(std::string_view object, std::uint64_t number) const {
    CachedBlockHead head{kCachedBlockLetters, 0, number, static_cast<std::uint32_t>(object.size()),
                         static_cast<std::uint32_t>(parts_.size())};
    std::size_t size = sizeof(head) + parts_.size() * sizeof(Part) + object.size();
    for (const Part& part : parts_) {
        size += part.size;
    }
    if (size > kMostFileBytes) {
        return {};
    }
    std::vector<std::byte> file(size);
    std::byte* to = file.data() + sizeof(head);
    const auto append = [&](const void* from, std::size_t n) {
        copy_bytes(to, from, n);
        to += n;
    };
    append(parts_.data(), parts_.size() * sizeof(Part));
    append(object.data(), object.size());
    for (const Part& part : parts_) {
        append(bytes_.data() + part.from, part.size);
    }
    std::memcpy(file.data(), &head, sizeof(head));
    head.checksum = checksum_of(std::span(file).subspan(kCheckedFrom));
    std::memcpy(file.data(), &head, sizeof(head));
    return file;
}

bool CachedBlock::has(std::size_t from, std::size_t size) const {
    const auto after = std::find_if(parts_.begin(), parts_.end(),
                                    [&](const Part& part) { return part.end() >= from + size; });
    return size == 0 || (after != parts_.end() && after->from <= from);
}

bool CachedBlock::copy(std::size_t from, std::span<std::byte> to) const {
    if (!has(from, to.size())) {
        return false;
    }
    if (to.empty()) {
        return true;
    }
    std::memcpy(to.data(), bytes_.data() + from, to.size());
    return true;
}

bool CachedBlock::add(std::size_t from, std::span<const std::byte> bytes) {
    if (has(from, bytes.size())) {
        return false;
    }
    bytes_.resize(kBytes);
    std::memcpy(bytes_.data() + from, bytes.data(), bytes.size());
    // All parts that overlap or touch it become one with it.
    const std::size_t end = from + bytes.size();
    const auto first = std::find_if(parts_.begin(), parts_.end(),
                                    [&](const Part& part) { return part.end() >= from; });
    const auto last =
        std::find_if(first, parts_.end(), [&](const Part& part) { return part.from > end; });
    const std::size_t low = first == last ? from : std::min<std::size_t>(from, first->from);
    const std::size_t high = first == last ? end : std::max(end, std::prev(last)->end());
    const Part joined{static_cast<std::uint32_t>(low), static_cast<std::uint32_t>(high - low)};
    parts_.insert(parts_.erase(first, last), joined);
    return true;
}

void CachedBlock::remove(std::size_t from, std::size_t size) {
    std::vector<Part> left;
    const auto add_part = [&](std::size_t begin, std::size_t end) {
        if (begin < end) {
            left.push_back(
                {static_cast<std::uint32_t>(begin), static_cast<std::uint32_t>(end - begin)});
        }
    };
    for (const Part& part : parts_) {
        add_part(part.from, std::min(part.end(), from));
        add_part(std::max<std::size_t>(part.from, from + size), part.end());
    }
    parts_ = std::move(left);
}

}  // namespace isonest::detail
