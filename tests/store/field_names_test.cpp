// The names of indicators: in stores, where they never change, and for users.
#include <catch2/catch.hpp>
#include <set>
#include <string>
#include <vector>

#include <isonest/field.h>

using namespace isonest;

TEST_CASE("names in stores are those of the format, whatever users call the indicators") {
    // store/FORMAT.md, section 4, in the order of the store.
    std::vector<std::string> expected;
    for (const std::string indicator :
         {"linf", "deviation", "l1", "l2", "grad_linf", "grad_l1", "grad_l2", "grad_edge", "normal",
          "normal_edge", "normal_turn", "normal_component"}) {
        expected.push_back(indicator + "_bar");
        expected.push_back(indicator + "_plus");
    }
    expected.insert(expected.end(), {"hex_linf", "hex_deviation"});
    std::vector<std::string> found;
    std::set<std::string> names;
    for (const Field field : all_fields()) {
        found.emplace_back(stored_name_of(field));
        names.emplace(name_of(field));
        CHECK(field_from_stored_name(found.back()) == field);
        CHECK(field_from_name(name_of(field)) == field);
    }
    CHECK(found == expected);
    CHECK(names.size() == found.size());
    CHECK(field_from_stored_name("values") == Field::values);
    CHECK(!field_from_stored_name("normal_jump_bar"));
    const Field own = own_field("normal", Saturation::plus);
    CHECK(stored_name_of(own) == "own:normal_plus");
    CHECK(field_from_stored_name("own:normal_plus") == own);
}

TEST_CASE("normal is the paper's eta_N, and its former name is accepted with a note") {
    CHECK(stored_name_of(Field::normal_bar) == "normal_component_bar");
    CHECK(stored_name_of(Field::normal_jump_plus) == "normal_plus");
    CHECK(field_from_name("normal_component_bar") == Field::normal_bar);
    CHECK(field_from_name("normal_component_plus") == Field::normal_plus);
    CHECK(!field_from_name("normal_component_"));
    CHECK(indicators_from_name("normal_component_plus") == std::vector{Field::normal_plus});
    CHECK(note_on_name("normal_component_plus").find("normal_plus") != std::string::npos);
    CHECK(note_on_name("normal_plus").find("normal_jump_plus") != std::string::npos);
    CHECK(note_on_name("normal_bar").find("normal_jump_bar") != std::string::npos);
    for (const char* const name : {"normal_jump_bar", "normal_edge_bar", "normal_turn_plus",
                                   "linf_bar", "all", "own:normal_bar", "normal", "values", ""}) {
        CHECK(note_on_name(name).empty());
    }
}
