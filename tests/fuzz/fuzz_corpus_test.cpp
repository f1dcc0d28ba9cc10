// Replays the fuzzer's corpus and its former findings, and each seed with some changed bytes.
//
// ISONEST_MUTATIONS=100000 in the environment: number of changes of each seed.
#include <catch2/catch.hpp>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <random>

#include "tests/fuzz/targets.h"

using namespace isonest;
using namespace isonest::detail;

TEST_CASE("the fuzzing corpus and its mutations are read or refused with an error") {
    const char* const text = std::getenv("ISONEST_MUTATIONS");
    const int mutations = text != nullptr ? std::atoi(text) : 10;
    const std::filesystem::path corpus = ISONEST_FUZZ_CORPUS;
    for (const fuzz::Target& target : fuzz::targets()) {
        std::size_t seeds = 0;
        for (const auto& entry : std::filesystem::directory_iterator(corpus / target.name)) {
            std::ifstream in(entry.path(), std::ios::binary);
            std::vector<std::uint8_t> bytes{std::istreambuf_iterator<char>(in), {}};
            CAPTURE(entry.path());
            CHECK_NOTHROW(target.run(bytes));
            ++seeds;
            std::mt19937 random(static_cast<unsigned>(bytes.size()));
            for (int i = 0; i < mutations && !bytes.empty(); ++i) {
                std::vector<std::uint8_t> changed = bytes;
                for (unsigned k = random() % 3; k < 3; ++k) {
                    changed[random() % changed.size()] = static_cast<std::uint8_t>(random());
                }
                if (random() % 4 == 0) {
                    changed.resize(random() % changed.size());
                }
                CAPTURE(i);
                CHECK_NOTHROW(target.run(changed));
            }
        }
        CAPTURE(target.name);
        CHECK(seeds > 0);
    }
}
