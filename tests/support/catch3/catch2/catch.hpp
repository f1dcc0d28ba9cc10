// The header of Catch2 2, where Catch2 3 is installed: the tests are written for the former, and compile with both. Only what
// they use is included, which is faster than all of it.
#pragma once

#include <catch2/catch_approx.hpp>
#include <catch2/catch_message.hpp>
#include <catch2/catch_template_test_macros.hpp>
#include <catch2/catch_test_macros.hpp>
#include <catch2/generators/catch_generators_all.hpp>
#include <catch2/matchers/catch_matchers.hpp>
#include <catch2/matchers/catch_matchers_predicate.hpp>
#include <catch2/matchers/catch_matchers_string.hpp>
#include <catch2/matchers/catch_matchers_vector.hpp>
#ifdef CATCH_CONFIG_RUNNER
#include <catch2/catch_session.hpp>
#endif
#include <string>

namespace Catch::Matchers {
inline StringContainsMatcher Contains(const std::string& part) {
    return ContainsSubstring(part);
}
}  // namespace Catch::Matchers

namespace Catch {
using Matchers::Contains;
using Matchers::EndsWith;
}  // namespace Catch

using Catch::Approx;
