// Names of labels: which texts are valid, and which of a source's names a store keeps.
#include "store/base/label_text.h"

#include <catch2/catch.hpp>

#include <isonest/error.h>
#include <isonest/mesh_file.h>
#include <isonest/store.h>

#include "preprocess/sources/wrapping/label_names.h"
#include "tests/support/test_support.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

namespace {

/// UTF-8 of a code point, by RFC 3629.
std::string utf8(std::uint32_t code) {
    const auto byte = [](std::uint32_t value) { return static_cast<char>(value); };
    if (code < 0x80) {
        return {byte(code)};
    }
    if (code < 0x800) {
        return {byte(0xC0 | code >> 6), byte(0x80 | (code & 0x3F))};
    }
    if (code < 0x10000) {
        return {byte(0xE0 | code >> 12), byte(0x80 | (code >> 6 & 0x3F)),
                byte(0x80 | (code & 0x3F))};
    }
    return {byte(0xF0 | code >> 18), byte(0x80 | (code >> 12 & 0x3F)),
            byte(0x80 | (code >> 6 & 0x3F)), byte(0x80 | (code & 0x3F))};
}

bool may_stand_in_names(std::uint32_t code) {
    const bool control = code < 0x20 || (code >= 0x7F && code <= 0x9F);
    const bool surrogate = code >= 0xD800 && code <= 0xDFFF;
    return !control && !surrogate && code != 0xFFFE && code != 0xFFFF && code <= 0x10FFFF;
}

std::unique_ptr<VolumeSource> named(std::vector<LabelName> names) {
    auto values = std::make_unique<FunctionVolume<std::int16_t>>(
        Int3{20, 18, 40}, [](const Int3& p) { return static_cast<std::int16_t>(p.x % 3); });
    values->identity_ = "labels";
    return with_label_names(std::move(values), std::move(names));
}

}  // namespace

TEST_CASE(
    "every code point except those not allowed in names is accepted, in its shortest form only") {
    for (std::uint32_t code = 0; code < 0x110400; ++code) {
        if (is_printable_utf8("a" + utf8(code) + "b") != may_stand_in_names(code)) {
            CAPTURE(code);
            FAIL_CHECK("taken or refused wrongly");
        }
    }
    CHECK(is_printable_utf8(""));
    for (const char* const wrong :
         {"\x80", "a\xC3", "\xC3(", "\xC0\xAF", "\xC1\xBF", "\xE0\x80\xAF", "\xE2\x82",
          "\xE2\x28\xA1", "\xF0\x80\x80\xAF", "\xF0\x9F\x98", "\xF4\x90\x80\x80",
          "\xF8\x88\x80\x80\x80", "\xFF"}) {
        CAPTURE(wrong);
        CHECK(!is_printable_utf8(wrong));
    }
}

TEST_CASE("a store has the names of its source, found by number and by name") {
    const std::vector<LabelName> names{{-7, "zwei", {}},
                                       {2, std::string(255, 'n'), LabelColor{1, 2, 3}},
                                       {3, "", LabelColor{255, 0, 0}},
                                       {(std::int64_t{1} << 62) - 1, "zwei", {}}};
    const TemporaryFolder folder;
    const PreprocessReport report = preprocess(*named(names), folder / "s", with_chunk(8));
    CHECK(report.label_names == names.size());
    const Store store(folder / "s");
    CHECK(store.label_names() == names);
    for (const LabelName& label : names) {
        CHECK(store.label_name(label.id) == label);
        CHECK(!store.label_name(label.id - 1).has_value() == (label.id != 3));
    }
    CHECK(store.labels_named("zwei") == std::vector<std::int64_t>{-7, names.back().id});
    CHECK(store.labels_named("").empty());
    CHECK(store.labels_named("zw").empty());
    preprocess(*named({}), folder / "t", with_chunk(8));
    CHECK(Store(folder / "t").label_names().empty());
}

TEST_CASE("names that a store cannot hold are refused before anything is written") {
    const TemporaryFolder folder;
    const std::int64_t most = (std::int64_t{1} << 62) - 1;
    std::vector<LabelName> many;
    for (std::size_t i = 0; i <= LabelName::kMaxOfStore; ++i) {
        many.push_back({static_cast<std::int64_t>(i), "a", {}});
    }
    for (const std::vector<LabelName>& names : {std::vector<LabelName>{{2, "a", {}}, {1, "b", {}}},
                                                {{1, "a", {}}, {1, "b", {}}},
                                                {{1, std::string(256, 'n'), {}}},
                                                {{1, "a\nb", {}}},
                                                {{1, "\xFF", {}}},
                                                {{1, "", {}}},
                                                {{most + 1, "a", {}}},
                                                {{-most - 1, "a", {}}},
                                                many}) {
        const auto source = named(names);
        CHECK_THROWS_AS(preprocess(*source, folder / "s", with_chunk(8)), Error);
        CHECK(folder.names().empty());
    }
}

TEST_CASE("a run is resumed only with the same names") {
    class CancelAt : public Progress {
      public:
        explicit CancelAt(int n) : left_(n) {}
        [[nodiscard]] bool cancelled() const override { return --left_ < 0; }

      private:
        mutable std::atomic<int> left_;
    };
    const TemporaryFolder folder;
    PreprocessOptions options = with_chunk(8);
    options.resume = true;
    options.threads = 1;
    const std::vector<LabelName> names{{1, "a", LabelColor{1, 2, 3}}};
    preprocess(*named(names), folder / "other", with_chunk(8));
    for (int questions = 2; folder.names().size() == 1; questions += 2) {
        REQUIRE(questions < 1000);
        CancelAt progress(questions);
        const auto source = named(names);
        CHECK_THROWS_AS(preprocess(*source, folder / "s", options, progress), Error);
    }
    for (const std::vector<LabelName>& others :
         {std::vector<LabelName>{{1, "b", LabelColor{1, 2, 3}}},
          {{1, "a", LabelColor{1, 2, 4}}},
          {{1, "a", {}}},
          {}}) {
        const auto source = named(others);
        CHECK_THROWS_WITH(preprocess(*source, folder / "s", options),
                          Catch::Contains("the interrupted run"));
    }
    const PreprocessReport report = preprocess(*named(names), folder / "s", options);
    CHECK(report.resumed_chunks > 0);
    CHECK(read_file(folder / "s") == read_file(folder / "other"));
}

TEST_CASE("a mesh file refuses a title that is not valid text") {
    const TemporaryFolder folder;
    for (const char* const title : {"\xFF", "a\tb", "\x7F"}) {
        CHECK_THROWS_AS(open_mesh_file(folder / "m.glb", {.title = title}), Error);
    }
    CHECK(open_mesh_file(folder / "m.glb", {.title = "\"<&>\\"}) != nullptr);
}
