// Numbers on the command line: what is accepted, what is refused, and how numbers are printed.
#include "tools/cli/options/units.h"

#include <catch2/catch.hpp>
#include <limits>
#include <string>
#include <utility>

#include <isonest/error.h>

#include "tools/cli/terminal/terminal_progress.h"
#include "tools/cli/terminal/terminal_text.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::cli;

TEST_CASE("sizes have units of powers of 1024") {
    const std::vector<std::pair<const char*, std::uint64_t>> cases{
        {"0", 0},
        {"4096", 4096},
        {"512M", 512ULL << 20U},
        {"512MB", 512ULL << 20U},
        {"1GiB", 1ULL << 30U},
        {"2g", 2ULL << 30U},
        {"1.5K", 1536},
        {"3 T", 3ULL << 40U},
        {"7B", 7},
    };
    for (const auto& [text, bytes] : cases) {
        CAPTURE(text);
        CHECK(parse_bytes("--memory", text) == bytes);
    }
}

TEST_CASE("an invalid size is refused, and the message names the option") {
    for (const char* text : {"", "M", "-1M", "1X", "1Mi", "1MM", "nan", "inf", "1e30", "1.5",
                             "0x10", "5 0", "1M ", "99999999T"}) {
        CAPTURE(text);
        try {
            parse_bytes("--memory", text);
            FAIL("was taken");
        } catch (const Error& e) {
            CHECK(e.kind() == ErrorKind::invalid_argument);
            CHECK(std::string(e.what()).find("--memory") != std::string::npos);
        }
    }
}

TEST_CASE("numbers are finite, and the whole text is parsed") {
    CHECK(parse_number("--iso", "-5") == -5);
    CHECK(parse_number("--iso", "+1e-3") == 1e-3);
    CHECK(parse_number("--iso", "0.1") == 0.1);
    for (const char* text : {"", "+", "nan", "inf", "-inf", "1e999", "1,5", "5x", " 5", "+-5"}) {
        CAPTURE(text);
        CHECK_THROWS_AS(parse_number("--iso", text), Error);
    }
    CHECK(parse_integer("--threads", "8", 0, 8) == 8);
    for (const char* text : {"", "9", "-1", "1.0", "99999999999999999999"}) {
        CAPTURE(text);
        CHECK_THROWS_AS(parse_integer("--threads", text, 0, 8), Error);
    }
}

TEST_CASE("triples and pixel sizes have the exact number of parts") {
    CHECK(parse_double3("--spacing", "1,0.5,2e3") == Double3{1, 0.5, 2000});
    CHECK(parse_int3("--dims", "1,2,3", 10) == Int3{1, 2, 3});
    CHECK(parse_size("--size", "800x600", 4096) == std::vector<int>{800, 600});
    for (const char* text : {"", "1", "1,2", "1,2,3,4", "1,,3", "1,2,nan", "1, 2,3"}) {
        CAPTURE(text);
        CHECK_THROWS_AS(parse_double3("--spacing", text), Error);
        CHECK_THROWS_AS(parse_int3("--dims", text, 10), Error);
    }
    CHECK_THROWS_AS(parse_int3("--dims", "1,2,11", 10), Error);
    CHECK_THROWS_AS(parse_int3("--dims", "0,2,3", 10), Error);
    for (const char* text : {"800", "800x", "0x600", "800x600x2", "5000x5"}) {
        CAPTURE(text);
        CHECK_THROWS_AS(parse_size("--size", text, 4096), Error);
    }
}

TEST_CASE("amounts are printed with three digits") {
    CHECK(human_bytes(0) == "0 B");
    CHECK(human_bytes(999) == "999 B");
    CHECK(human_bytes(1234567) == "1.23 MB");
    CHECK(human_bytes(4.3e9) == "4.30 GB");
    CHECK(human_count(12345) == "12.3 k");
    CHECK(human_count(7) == "7");
    CHECK(human_seconds(0.25) == "0.2 s");
    CHECK(human_seconds(125) == "2:05");
    CHECK(human_seconds(3725) == "1:02:05");
}

TEST_CASE(
    "a progress line shows phase, percentage, rate and remaining time, and fits into the "
    "terminal") {
    ProgressState state{"levels 0-2", "B", 250'000'000, 1'000'000'000, 2};
    CHECK(progress_line(state, 80) == "levels 0-2        25 %   125 MB/s   6.0 s left");
    CHECK(progress_line(state, 15).size() == 14);
    state.seconds = 0.1;  // too early for a rate
    CHECK(progress_line(state, 80) == "levels 0-2        25 %");
    state = {"traverse", "bricks", 50, 0, 10};  // unknown total
    CHECK(progress_line(state, 80) == "traverse           5 bricks/s");
    state = {"write mesh", "triangles", 12, 10, 10};  // at most 100 %, no negative time
    CHECK(progress_line(state, 80) == "write mesh       100 %   1 triangles/s");
}

TEST_CASE("the progress bar of a run includes its stages, and never moves back") {
    WholeProgress run({{"copy", "copying", 1}, {"read", "reading", 2}, {"write", "writing", 1}});
    CHECK(run.begin("read")->words == "reading");  // nothing is copied this time
    CHECK(run.at(0) == 0);
    CHECK(run.at(0.5) == Approx(1.0 / 3));
    CHECK(run.begin("other") == nullptr);
    CHECK(run.at(0.9) == Approx(2.0 / 3));
    CHECK(run.begin("write")->words == "writing");
    CHECK(run.at(0) == Approx(2.0 / 3));
    CHECK(run.at(1) == Approx(1));
    CHECK(run.begin("read")->words == "reading");  // once more
    CHECK(run.at(0.1) == Approx(1));
    CHECK(WholeProgress({}).at(0.5) < 0);

    ProgressState state{"reading", "B", 250, 1000, 2};
    state.whole = 0.5;
    state.whole_seconds = 6;
    CHECK(progress_line(state, 80) ==
          "[##########----------]  50 %  reading   125 B/s   6.0 s left");
}

TEST_CASE("the nearest name is found for a typing error, and none for other texts") {
    const std::vector<std::string> names{"--error", "--error-relative", "--iso", "--output"};
    CHECK(nearest_name("--eror", names) == "--error");
    CHECK(nearest_name("--error-rel", names) == "--error-relative");
    CHECK(nearest_name("--ios", names) == "--iso");
    CHECK_FALSE(nearest_name("--frequency", names));
    CHECK_FALSE(nearest_name(std::string(100, 'x'), names));
}

TEST_CASE("help is wrapped between words") {
    CHECK(wrapped("one two  three", 0, 2) == "one two three");
    const std::string text =
        wrapped(std::string(50, 'a') + " " + std::string(29, 'b') + " c", 0, 2);
    CHECK(text == std::string(50, 'a') + " " + std::string(29, 'b') + "\n  c");
    CHECK(wrapped(std::string(99, 'a'), 0, 2) == std::string(99, 'a'));
    CHECK(wrapped("a\nb\n\nc", 0, 0) == "a b\n\nc");
}

TEST_CASE("a range is printed with enough digits to distinguish its ends") {
    CHECK(human_range(0, 255) == "0 to 255");
    CHECK(human_range(-1.98695969581604, 3.0251314640045166) == "-1.98696 to 3.02513");
    CHECK(human_range(1e9, 1e9 + 3) == "1000000000 to 1000000003");
    CHECK(human_range(5, 5) == "5 to 5");
    CHECK(human_value(616.5, 0.5) == "616.5");
    CHECK(human_value(1.0 / 3, 0.01) == "0.333333");
    CHECK(human_value(4294967294.5, 0.5) == "4294967294.5");
    CHECK(human_value(0, 0) == "0");
    CHECK(human_value(-1e308, 1e306) == "-1e+308");
    CHECK(human_range(-1e16, -1e16 + 2) == "-1e+16 to -9999999999999998");
    CHECK(human_range(-1e308, 1e308) == "-1e+308 to 1e+308");
    const double infinity = std::numeric_limits<double>::infinity();
    CHECK(human_range(infinity, -infinity) == "none");
}
