// Every remedy of the library has a name and a text, in commands that have the option and in those
// that do not; no text names an option that the command does not have.
#include "tools/cli/terminal/remedies.h"

#include <catch2/catch.hpp>
#include <set>
#include <string>
#include <vector>

using namespace isonest;
using namespace isonest::detail::cli;

namespace {

bool has_all(const std::string& /*option*/) {
    return true;
}
bool has_none(const std::string& /*option*/) {
    return false;
}

}  // namespace

TEST_CASE("every remedy has a unique name and a text for every command") {
    std::set<std::string> names;
    const int last = static_cast<int>(RemedyKind::download);
    for (int i = 0; i <= last; ++i) {
        const auto kind = static_cast<RemedyKind>(i);
        names.insert(name_of(kind));
        for (const char* const value : {"", "7"}) {
            CHECK(!text_of({kind, value}, has_all).empty());
            CHECK(!text_of({kind, value}, has_none).empty());
            CHECK(text_of({kind, value}, has_all).find("{}") == std::string::npos);
        }
    }
    CHECK(names.size() == static_cast<std::size_t>(last) + 1);
}

TEST_CASE("a remedy names an option only if the command has it") {
    for (const RemedyKind kind :
         {RemedyKind::replace_existing, RemedyKind::choose_dataset, RemedyKind::describe_numbers,
          RemedyKind::more_memory, RemedyKind::fewer_threads, RemedyKind::resume,
          RemedyKind::no_resume, RemedyKind::larger_error, RemedyKind::smaller_box,
          RemedyKind::state_missing, RemedyKind::correct_numbers, RemedyKind::smaller_picture,
          RemedyKind::less_memory}) {
        CHECK(text_of({kind, "dims"}, has_all).find("--") != std::string::npos);
        CHECK(text_of({kind, "dims"}, has_none).find("--") == std::string::npos);
    }
}

TEST_CASE("values are formatted as the option accepts them") {
    const auto text = [](RemedyKind kind, const char* value) {
        return text_of({kind, value}, has_all);
    };
    CHECK(text(RemedyKind::more_memory, "50331648") == "give at least --memory 48M");
    CHECK(text(RemedyKind::more_memory, "50331649") == "give at least --memory 49M");
    CHECK(text(RemedyKind::describe_numbers, "dims,type") == "give --dims X,Y[,Z] and --type T");
    CHECK(text(RemedyKind::correct_numbers, "dims,type,offset") ==
          "check --dims, --type and --offset");
    CHECK(text(RemedyKind::leave_out, "big_endian") == "leave out --endian");
    CHECK(text(RemedyKind::make_fields, "linf_bar, linf_plus") ==
          "preprocess the volume again with --indicators linf_bar,linf_plus");
}

TEST_CASE(
    "a message consists of place, problem and remedies; its JSON object has them separately") {
    const Error error(ErrorKind::corrupt, {"s.isonest", "level 2, values, chunk 0 0 1"}, "damaged",
                      {{RemedyKind::good_copy}, {RemedyKind::preprocess_again}});
    CHECK(std::string(error.what()) == "s.isonest: level 2, values, chunk 0 0 1: damaged");
    CHECK(message_of(error, has_all) ==
          "s.isonest: level 2, values, chunk 0 0 1: damaged; restore the file from a good copy or "
          "preprocess the volume again");
    const Json json = json_of(error, has_all);
    CHECK(json["kind"] == "corrupt");
    CHECK(json["file"] == "s.isonest");
    CHECK(json["inside"] == "level 2, values, chunk 0 0 1");
    CHECK(json["remedies"][0]["kind"] == "good_copy");
    CHECK(json["message"] == message_of(error, has_all));
    CHECK(message_of(
              Error(ErrorKind::not_found, "several:\n  a\n  b", {{RemedyKind::choose_dataset}}),
              has_all) == "several:\n  a\n  b\nchoose one with --dataset");
}
