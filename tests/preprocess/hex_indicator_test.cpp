// The indicators of hexahedral and quadrilateral cells compared with loops over all nodes of a
// cell.
#include <catch2/catch.hpp>

#include "query/check/check.h"
#include "store/container/chunk_cache.h"
#include "store/container/reader.h"
#include "tests/support/cell_oracle.h"
#include "tests/support/test_support.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

namespace {

/// `above`: how far a stored number may exceed the exact one, relatively.
template <class T>
void require_agreement(FunctionVolume<T>& volume, int chunk, bool exact, double above) {
    const TemporaryFolder folder;
    PreprocessOptions options = with_chunk(chunk, exact);
    options.fields = {Field::deviation_bar, Field::hex_linf, Field::hex_deviation};
    make_store(volume, folder / "s", options);
    const StoreReader store(folder / "s");
    const StoreLayout& layout = store.layout();
    const std::vector<CellNumbers> expected = cell_numbers_by_loops(volume, layout.lattice());
    ChunkCache cache(store, 1U << 24U);
    std::size_t wrong = 0;
    std::size_t compared = 0;
    for (int level = 1; level <= layout.lattice().top(); ++level) {
        const CellNumbers& e = expected[static_cast<std::size_t>(level - 1)];
        REQUIRE(e.cells == layout.lattice().elements_at(level));
        for (const Field field : {Field::hex_linf, Field::hex_deviation}) {
            const ArrayInfo& array = layout.array(level, field);
            REQUIRE(array.components == 1);
            std::vector<double> stored;
            if (exact) {
                Box<float> box({0, 0, 0}, e.cells);
                gather_values(cache, array, box);
                stored.assign(box.data.begin(), box.data.end());
            } else {
                Box<IndicatorCode> box({0, 0, 0}, e.cells);
                gather_values(cache, array, box);
                for (const IndicatorCode code : box.data) {
                    stored.push_back(static_cast<double>(decode_indicator(code)));
                }
            }
            const std::vector<double>& exactly = field == Field::hex_linf ? e.bar : e.plus;
            for (std::size_t i = 0; i < stored.size(); ++i) {
                ++compared;
                const double x = exactly[i];
                wrong += !(stored[i] >= x * (1 - 1e-14)) ||
                                 (std::isfinite(x) && !(stored[i] <= x * (1 + above) + 1e-6))
                             ? 1
                             : 0;
            }
        }
    }
    CAPTURE(volume.nodes().x, volume.nodes().y, volume.nodes().z);
    CHECK((compared > 0 || layout.lattice().top() == 0));
    CHECK(wrong == 0);
}

float rough(const Int3& p) {
    return static_cast<float>(smooth(p) + 0.3 * noise(p));
}

}  // namespace

TEST_CASE("indicators of cells agree with loops over their nodes") {
    for (const Int3& n : {Int3{17, 17, 17}, Int3{20, 31, 18}, Int3{2, 2, 2}, Int3{3, 40, 5},
                          Int3{41, 6, 13}, Int3{37, 70, 1}, Int3{1, 23, 30}, Int3{29, 1, 33}}) {
        for (const int chunk : {8, 16}) {
            FunctionVolume<float> floats(n, rough);
            require_agreement(floats, chunk, true, 1e-5);
            require_agreement(floats, chunk, false, 0.04);
            FunctionVolume<std::uint8_t> bytes(
                n, [](const Int3& p) { return static_cast<std::uint8_t>(256 * noise(p)); });
            require_agreement(bytes, chunk, true, 0);
            FunctionVolume<double> doubles(n, [](const Int3& p) { return 1e3 + noise(p, 3); });
            require_agreement(doubles, chunk, true, 1e-5);
        }
    }
}

TEST_CASE("indicators of cells with missing nodes, and of the cells above them, are infinite") {
    FunctionVolume<float> holes({21, 20, 19}, [](const Int3& p) {
        return noise(p, 3) < 0.002 ? std::numeric_limits<float>::quiet_NaN() : rough(p);
    });
    require_agreement(holes, 8, true, 1e-5);
}

TEST_CASE("check finds nothing in indicators of cells") {
    const TemporaryFolder folder;
    FunctionVolume<float> volume({35, 22, 30}, rough);
    PreprocessOptions options = with_chunk(8);
    options.fields = {Field::deviation_bar, Field::hex_linf, Field::hex_deviation};
    make_store(volume, folder / "s", options);
    const CheckReport report = check(StoreReader(folder / "s"), {}, silent_progress());
    CHECK(report.findings.empty());
}
