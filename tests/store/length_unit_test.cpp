// Units of length: their spellings, and conversions compared with numbers written out here.
#include <catch2/catch.hpp>
#include <cmath>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include <isonest/length_unit.h>

using namespace isonest;

TEST_CASE("a unit is found by its symbol and its name, in both spellings and any case") {
    std::set<std::string> symbols;
    for (const LengthUnitInfo& info : length_units()) {
        CAPTURE(info.symbol);
        symbols.emplace(info.symbol);
        CHECK(symbol_of(info.unit) == info.symbol);
        CHECK(name_of(info.unit) == info.name);
        CHECK(length_unit_from(info.symbol) == info.unit);
        CHECK(length_unit_from(info.name) == info.unit);
        CHECK(length_unit_from(" " + std::string(info.symbol) + "\t") == info.unit);
    }
    CHECK(symbols.size() == length_units().size());
    const std::vector<std::pair<const char*, LengthUnit>> spellings{
        {"millimeter", LengthUnit::millimetre},
        {"Millimeters", LengthUnit::millimetre},
        {"MILLIMETRES", LengthUnit::millimetre},
        {"MM", LengthUnit::millimetre},
        {"meter", LengthUnit::metre},
        {"meters", LengthUnit::metre},
        {"micron", LengthUnit::micrometre},
        {"Microns", LengthUnit::micrometre},
        {"\u00b5m", LengthUnit::micrometre},
        {"\u03bcm", LengthUnit::micrometre},
        {"\\u00B5m", LengthUnit::micrometre},
        {"\u00c5", LengthUnit::angstrom},
        {"\u212b", LengthUnit::angstrom},
        {"\u00c5ngstr\u00f6m", LengthUnit::angstrom},
        {"Angstroms", LengthUnit::angstrom},
        {"inches", LengthUnit::inch},
        {"inch", LengthUnit::inch},
        {"feet", LengthUnit::foot},
        {"kilometers", LengthUnit::kilometre},
    };
    for (const auto& [spelling, unit] : spellings) {
        CAPTURE(spelling);
        CHECK(length_unit_from(spelling) == unit);
    }
}

TEST_CASE("unknown and ambiguous texts are no unit of length") {
    for (const char* const word :
         {"",   " ", "pixel", "voxel", "s",       "K",  "degrees_north", "Mm", "M",   "MS",
          "nM", "A", "mm2",   "mm mm", "furlong", "me", "metr",          "ms", "ins", "mms"}) {
        CAPTURE(word);
        CHECK(!length_unit_from(word));
    }
}

TEST_CASE(
    "conversions are correct up to rounding, and exact if one unit is a multiple of the other") {
    const std::vector<long double> metres{1e3L,  1.0L,   1e-1L,  1e-2L,   1e-3L,  1e-6L,
                                          1e-9L, 1e-10L, 1e-12L, 0.3048L, 0.0254L};
    REQUIRE(metres.size() == length_units().size());
    for (std::size_t a = 0; a < metres.size(); ++a) {
        for (std::size_t b = 0; b < metres.size(); ++b) {
            const LengthUnit from = length_units()[a].unit;
            const LengthUnit to = length_units()[b].unit;
            CAPTURE(name_of(from), name_of(to));
            const double found = converted_length(0.7, from, to);
            const long double wanted = 0.7L * metres[a] / metres[b];
            CHECK(std::fabs(static_cast<double>(found / wanted - 1)) < 4e-16);
        }
    }
    CHECK(converted_length(0.5, LengthUnit::millimetre, LengthUnit::micrometre) == 500);
    CHECK(converted_length(0.3, LengthUnit::millimetre, LengthUnit::micrometre) == 300);
    CHECK(converted_length(5, LengthUnit::nanometre, LengthUnit::micrometre) == 0.005);
    CHECK(converted_length(1, LengthUnit::inch, LengthUnit::millimetre) == 25.4);
    CHECK(converted_length(1, LengthUnit::foot, LengthUnit::inch) == 12);
    CHECK(converted_length(7, LengthUnit::angstrom, LengthUnit::nanometre) == 0.7);
    CHECK(converted_length(3, LengthUnit::foot, LengthUnit::foot) == 3);
}
