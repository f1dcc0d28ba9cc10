// Whether a chunk is stored with or without the shuffle.
#include "store/container/codec.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <cstddef>
#include <cstring>
#include <random>
#include <span>
#include <vector>

namespace isonest::detail {
namespace {

enum class Kind { few_values, noise_in_low_bits, constant };

/// `count` elements of `size` bytes. If there are only 200 values, which use all bytes, zstd finds
/// repeated elements. If the low byte is noise, only the shuffle separates it from the high bytes.
std::vector<std::byte> elements(Kind kind, std::size_t count, std::size_t size) {
    std::mt19937_64 random(static_cast<unsigned>(count * 8 + size));
    std::vector<std::uint64_t> values(200);
    std::generate(values.begin(), values.end(), random);
    std::vector<std::byte> out(count * size);
    for (std::size_t i = 0; i < count; ++i) {
        const std::uint64_t value = kind == Kind::constant     ? 7
                                    : kind == Kind::few_values ? values.at(random() % values.size())
                                                               : (i / 500) << 8U | random() % 256;
        std::memcpy(out.data() + i * size, &value, size);
    }
    return out;
}

TEST_CASE("a chunk is stored without the shuffle where that is shorter, and decodes either way") {
    for (const std::size_t size : {2U, 4U, 8U}) {
        // Fewer elements than the sampled parts have, as many, and more, so that there are gaps.
        for (const std::size_t count : {std::size_t{1}, std::size_t{512}, std::size_t{4096},
                                        kSampledParts * kSampledPart / size, std::size_t{50021}}) {
            for (const Kind kind : {Kind::few_values, Kind::noise_in_low_bits, Kind::constant}) {
                CAPTURE(size, count, static_cast<int>(kind));
                const std::vector<std::byte> raw = elements(kind, count, size);
                const CodecSpec spec{size, true, 1};
                std::vector<std::byte> stored;
                const bool plain = encode_shorter(raw, spec, stored);
                CodecSpec as_stored = spec;
                as_stored.shuffle = !plain;
                std::vector<std::byte> decoded(raw.size());
                decode_chunk(stored, as_stored, decoded, {"test"});
                CHECK(decoded == raw);

                std::vector<std::byte> again;
                encode_chunk(raw, as_stored, again);
                CHECK(again == stored);
                CodecSpec other = spec;
                other.shuffle = plain;
                encode_chunk(raw, other, again);
                // The shuffle is left out only if that saves an eighth and 64 bytes of the sampled
                // parts, in which zstd finds fewer repetitions than in the whole chunk.
                CHECK(stored.size() <= again.size() + again.size() / 4 + 128);
                if (raw.size() < 1024) {
                    CHECK_FALSE(plain);
                }
                if (count >= 4096 && size == 8 && kind == Kind::few_values) {
                    CHECK(plain);
                }
                if (count >= 4096 && kind == Kind::noise_in_low_bits) {
                    CHECK_FALSE(plain);
                }
            }
        }
    }
}

TEST_CASE("elements of one byte, and chunks that must not be shuffled, have no choice") {
    const std::vector<std::byte> raw = elements(Kind::few_values, 5000, 1);
    for (const CodecSpec& spec : {CodecSpec{1, false, 1}, CodecSpec{4, false, 1}}) {
        std::vector<std::byte> stored;
        CHECK_FALSE(encode_shorter(raw, spec, stored));
        std::vector<std::byte> expected;
        encode_chunk(raw, spec, expected);
        CHECK(stored == expected);
    }
}

}  // namespace
}  // namespace isonest::detail
