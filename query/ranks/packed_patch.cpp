#include "query/ranks/packed_patch.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <cstring>
#include <limits>
#include <stdexcept>
#include <type_traits>

namespace isonest::detail {
namespace {

static_assert(sizeof(Displacement) == 28 && std::is_trivially_copyable_v<Displacement> &&
              std::is_trivially_copyable_v<PatchBox> && std::is_trivially_copyable_v<KeptNodes>);

/// Maximum number of vertices for 16-bit numbers.
constexpr std::uint64_t kNarrow = std::numeric_limits<std::uint16_t>::max() + std::uint64_t{1};

class Packer {
  public:
    Packer() { put(std::uint64_t{0}); }
    template <class T>
    void put(const T& value) {
        put_all(&value, 1);
    }
    template <class T>
    void put_all(const T* values, std::size_t count) {
        static_assert(std::is_trivially_copyable_v<T>);
        const auto* const from = reinterpret_cast<const std::byte*>(values);
        bytes_.insert(bytes_.end(), from, from + count * sizeof(T));
    }
    void put_bits(const std::vector<bool>& bits) {
        const std::size_t begin = bytes_.size();
        bytes_.resize(begin + (bits.size() + 7) / 8);
        for (std::size_t i = 0; i < bits.size(); ++i) {
            bytes_[begin + i / 8] |= std::byte{bits[i] ? std::uint8_t{1} : std::uint8_t{0}}
                                     << (i % 8);
        }
    }
    /// Writes vertex numbers; `vertices`: total number of vertices.
    template <class Numbers>
    void put_numbers(const Numbers& numbers, std::uint64_t vertices) {
        for (const std::uint32_t v : numbers) {
            if (vertices <= kNarrow) {
                put(static_cast<std::uint16_t>(v));
            } else {
                put(v);
            }
        }
    }
    std::vector<std::byte> finish() {
        const std::uint64_t size = bytes_.size();
        static_assert(sizeof(size) == kPackedHead);
        std::memcpy(bytes_.data(), &size, sizeof(size));
        return std::move(bytes_);
    }
    void reserve(std::size_t bytes) { bytes_.reserve(bytes); }

  private:
    std::vector<std::byte> bytes_;
};

class Unpacker {
  public:
    explicit Unpacker(std::span<const std::byte> bytes) : bytes_(bytes) {
        if (get<std::uint64_t>() != bytes.size()) {
            fail();
        }
    }
    template <class T>
    T get() {
        T value{};
        get_all(&value, 1);
        return value;
    }
    template <class T>
    void get_all(T* values, std::size_t count) {
        static_assert(std::is_trivially_copyable_v<T>);
        const std::span<const std::byte> from = next(count * sizeof(T));
        if (!from.empty()) {
            std::memcpy(values, from.data(), from.size());
        }
    }
    std::vector<bool> get_bits(std::size_t count) {
        const std::span<const std::byte> from = next((count + 7) / 8);
        std::vector<bool> bits(count);
        for (std::size_t i = 0; i < count; ++i) {
            bits[i] = (from[i / 8] >> (i % 8) & std::byte{1}) != std::byte{0};
        }
        return bits;
    }
    template <class Numbers>
    void get_numbers(Numbers& numbers, std::uint64_t vertices) {
        for (std::uint32_t& v : numbers) {
            v = vertices <= kNarrow ? get<std::uint16_t>() : get<std::uint32_t>();
        }
    }
    void finish() const {
        if (!bytes_.empty()) {
            fail();
        }
    }

  private:
    std::span<const std::byte> next(std::size_t count) {
        if (count > bytes_.size()) {
            fail();
        }
        const std::span<const std::byte> from = bytes_.first(count);
        bytes_ = bytes_.subspan(count);
        return from;
    }
    [[noreturn]] static void fail() {
        throw std::logic_error("the bytes are not those of a packed patch");
    }

    std::span<const std::byte> bytes_;
};

/// Compares all bits: -0 is not zero.
bool is_zero(const Displacement& d) {
    using Bits = std::array<std::uint32_t, sizeof(Displacement) / sizeof(std::uint32_t)>;
    return std::bit_cast<Bits>(d) == Bits{};
}

/// Triangles with their data. All displacements of a full surface are 0.
void put_triangles(Packer& packer, const MappedPatch& patch, std::uint64_t vertices) {
    std::vector<bool> moved(patch.triangles.size());
    for (std::size_t t = 0; t < moved.size(); ++t) {
        packer.put_numbers(patch.triangles[t], vertices);
        moved[t] = !is_zero(patch.displacements[t]);
    }
    packer.put_bits(patch.tried);
    packer.put_bits(moved);
    for (std::size_t t = 0; t < moved.size(); ++t) {
        if (moved[t]) {
            packer.put(patch.displacements[t]);
        }
    }
}

void get_triangles(Unpacker& unpacker, MappedPatch& patch, std::size_t triangles,
                   std::uint64_t vertices) {
    patch.triangles.resize(triangles);
    patch.displacements.assign(triangles, {});
    for (PatchTriangle& t : patch.triangles) {
        unpacker.get_numbers(t, vertices);
    }
    patch.tried = unpacker.get_bits(triangles);
    const std::vector<bool> moved = unpacker.get_bits(triangles);
    for (std::size_t t = 0; t < triangles; ++t) {
        if (moved[t]) {
            patch.displacements[t] = unpacker.get<Displacement>();
        }
    }
}

struct PatchHead {
    std::uint64_t vertices = 0;
    std::uint64_t triangles = 0;
    PatchBox box;
    bool has_copies = false;
    bool keeps_nodes = false;
};

struct ResultHead {
    std::uint64_t vertices = 0;
    std::uint64_t triangles = 0;
    std::uint64_t bins = 0;  ///< of gone_at
    std::uint64_t used = 0;  ///< number of bins with removed triangles
};

struct GoneInBin {
    std::uint32_t bin = 0;
    std::uint32_t triangles = 0;
};

}  // namespace

std::vector<std::byte> packed_patch(const MappedPatch& patch) {
    const std::uint64_t vertices = patch.positions.size();
    const bool is_full =
        std::all_of(patch.displacements.begin(), patch.displacements.end(), is_zero);
    Packer packer;
    packer.reserve(sizeof(PatchHead) + sizeof(KeptNodes) + 17 * vertices +
                   patch.triangles.size() * (is_full ? 13 : kMaxPackedResult));
    packer.put(PatchHead{vertices, patch.triangles.size(), patch.box, !patch.next_copy.empty(),
                         patch.kept_nodes.has_value()});
    if (patch.kept_nodes) {
        KeptNodes sent = *patch.kept_nodes;
        sent.lattice.steps.uneven = nullptr;  // an address in this process; they have even axes
        packer.put(sent);
    }
    packer.put_all(patch.positions.data(), patch.positions.size());
    packer.put_bits(patch.shared);
    packer.put_numbers(patch.next_copy, vertices);
    put_triangles(packer, patch, vertices);
    return packer.finish();
}

MappedPatch unpacked_patch(std::span<const std::byte> bytes) {
    Unpacker unpacker(bytes);
    const auto head = unpacker.get<PatchHead>();
    MappedPatch patch;
    patch.box = head.box;
    if (head.keeps_nodes) {
        patch.kept_nodes = unpacker.get<KeptNodes>();
    }
    patch.positions.resize(head.vertices);
    unpacker.get_all(patch.positions.data(), patch.positions.size());
    patch.shared = unpacker.get_bits(head.vertices);
    if (head.has_copies) {
        patch.next_copy.resize(head.vertices);
        unpacker.get_numbers(patch.next_copy, head.vertices);
    }
    get_triangles(unpacker, patch, head.triangles, head.vertices);
    unpacker.finish();
    return patch;
}

std::vector<std::byte> packed_result(const MappedPatch& patch, const GoneTriangles& gone_at) {
    std::vector<GoneInBin> gone;
    for (std::size_t bin = 0; bin < gone_at.size(); ++bin) {
        if (gone_at[bin] > 0) {
            gone.push_back(
                {static_cast<std::uint32_t>(bin), static_cast<std::uint32_t>(gone_at[bin])});
        }
    }
    const std::uint64_t vertices = patch.positions.size();
    Packer packer;
    packer.reserve(sizeof(ResultHead) + gone.size() * sizeof(GoneInBin) +
                   patch.triangles.size() * kMaxPackedResult);
    packer.put(ResultHead{vertices, patch.triangles.size(), gone_at.size(), gone.size()});
    packer.put_all(gone.data(), gone.size());
    put_triangles(packer, patch, vertices);
    return packer.finish();
}

void unpack_result(std::span<const std::byte> bytes, MappedBlock& block) {
    Unpacker unpacker(bytes);
    const auto head = unpacker.get<ResultHead>();
    block.gone_at.assign(head.bins, 0);
    for (std::uint64_t i = 0; i < head.used; ++i) {
        const auto gone = unpacker.get<GoneInBin>();
        block.gone_at.at(gone.bin) = gone.triangles;
    }
    get_triangles(unpacker, block.patch, head.triangles, head.vertices);
    unpacker.finish();
}

}  // namespace isonest::detail
