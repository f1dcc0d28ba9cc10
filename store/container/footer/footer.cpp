#include "store/container/footer/footer.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstring>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <isonest/error.h>

#include "store/container/codec.h"

namespace isonest::detail {
namespace {

constexpr std::uint32_t kFooterVersion = 1;
/// Of HDF5, version 2 or 3.
constexpr std::uint64_t kSuperblockBytes = 48;
/// A catalogue has a few bytes for each page of the chunk table.
constexpr std::uint64_t kMostCatalogueBytes = std::uint64_t{64} << 20U;
constexpr std::array<char, 8> kFooterMagic{'I', 's', 'o', 'N', 'e', 's', 't', '\n'};

/// As they are stored.
struct StoredFooter {
    Footer footer;
    std::uint32_t version = kFooterVersion;
    std::uint32_t bytes = kFooterBytes;
    std::uint64_t xxh64 = 0;  ///< of what is before it
    std::array<char, 8> magic = kFooterMagic;

    [[nodiscard]] std::uint64_t sum() const {
        return checksum_of(std::as_bytes(std::span(this, 1)).first(offsetof(StoredFooter, xxh64)));
    }
};
static_assert(sizeof(StoredFooter) == kFooterBytes);

[[noreturn]] void fail_footer(const StoreBytes& bytes, const std::string& problem) {
    throw Error(ErrorKind::corrupt, {bytes.name(), "footer"}, problem,
                {{RemedyKind::good_copy}, {RemedyKind::preprocess_again}});
}

}  // namespace

std::vector<std::byte> bytes_behind_hdf5(std::uint64_t hdf5_end,
                                         std::span<const std::byte> catalogue) {
    StoredFooter last;
    last.footer.hdf5_end = hdf5_end;
    last.footer.catalogue = (hdf5_end + 7) / 8 * 8;
    last.footer.catalogue_bytes = catalogue.size();
    last.footer.catalogue_xxh64 = checksum_of(catalogue);
    last.footer.file_bytes = last.footer.catalogue + catalogue.size() + kFooterBytes;
    last.xxh64 = last.sum();
    std::vector<std::byte> bytes(last.footer.catalogue - hdf5_end);
    bytes.insert(bytes.end(), catalogue.begin(), catalogue.end());
    const auto footer = std::as_bytes(std::span(&last, 1));
    bytes.insert(bytes.end(), footer.begin(), footer.end());
    return bytes;
}

/// See "Disk Format: Level 0A" of HDF5's file format specification: superblocks 2 and 3.
std::optional<std::uint64_t> hdf5_end_of(const StoreBytes& bytes) {
    constexpr std::array<unsigned char, 8> kSignature{0x89, 'H', 'D', 'F', '\r', '\n', 0x1A, '\n'};
    constexpr std::size_t kVersionAt = 8;
    constexpr std::size_t kSizeOfOffsetsAt = 9;
    constexpr std::size_t kEndAt = 28;
    if (bytes.size() < kSuperblockBytes) {
        return std::nullopt;
    }
    const HeldBytes held = bytes.read(0, kSuperblockBytes);
    const std::byte* const block = held.bytes().data();
    const auto version = std::to_integer<int>(block[kVersionAt]);
    if (std::memcmp(block, kSignature.data(), kSignature.size()) != 0 || version < 2 ||
        version > 3 || block[kSizeOfOffsetsAt] != std::byte{sizeof(std::uint64_t)}) {
        return std::nullopt;
    }
    std::uint64_t end = 0;
    std::memcpy(&end, block + kEndAt, sizeof(end));
    return end;
}

std::optional<FoundCatalogue> find_catalogue(const StoreBytes& bytes) {
    const std::uint64_t size = bytes.size();
    if (size < kFooterBytes) {
        return std::nullopt;
    }
    FoundCatalogue found;
    if (!bytes.is_far()) {
        // Both at once, and of a file that is not in the page cache no more than these.
        const std::uint64_t tail = std::min(size, kFarTail);
        const std::array<ByteRange, 2> first{
            {{0, std::min(size, kSuperblockBytes)}, {size - tail, tail}}};
        bytes.want(first);
    }
    found.tail_begin = size - std::min(size, bytes.is_far() ? kFarTail : kFooterBytes);
    found.tail = bytes.read(found.tail_begin, size - found.tail_begin);
    StoredFooter stored;
    std::memcpy(&stored, found.tail.bytes().last(kFooterBytes).data(), kFooterBytes);
    if (stored.magic != kFooterMagic || stored.version != kFooterVersion) {
        return std::nullopt;
    }
    if (!bytes.is_far() && hdf5_end_of(bytes) != stored.footer.hdf5_end) {
        return std::nullopt;
    }
    if (stored.xxh64 != stored.sum() || stored.bytes != kFooterBytes) {
        fail_footer(bytes, "damaged: its bytes are not those that were written");
    }
    const Footer& footer = found.footer = stored.footer;
    const std::uint64_t end = size - kFooterBytes;
    if (footer.file_bytes != size || footer.catalogue > end ||
        footer.catalogue_bytes > end - footer.catalogue || footer.hdf5_end > footer.catalogue) {
        fail_footer(bytes, "it is not this file's: bytes of it are missing, or there are others");
    }
    if (footer.catalogue_bytes > kMostCatalogueBytes) {
        fail_footer(bytes, "damaged: no catalogue is as long as it says");
    }
    found.bytes =
        footer.catalogue >= found.tail_begin
            ? HeldBytes(nullptr, found.tail.bytes().subspan(footer.catalogue - found.tail_begin,
                                                            footer.catalogue_bytes))
            : bytes.read(footer.catalogue, footer.catalogue_bytes);
    std::optional<Catalogue> catalogue;
    if (checksum_of(found.bytes.bytes()) == footer.catalogue_xxh64) {
        catalogue = parse_catalogue(found.bytes.bytes());
    }
    if (!catalogue) {
        fail_footer(bytes, "its catalogue is damaged");
    }
    found.catalogue = std::move(*catalogue);
    return found;
}

}  // namespace isonest::detail
