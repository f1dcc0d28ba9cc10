// The parts of isonest view's server that need no socket.
#include <catch2/catch.hpp>
#include <cmath>
#include <random>
#include <string>
#include <vector>

#include <isonest/error.h>

#include "tools/view/http_server.h"
#include "tools/view/mesh_answers.h"
#include "tools/view/mesh_request.h"
#include "tools/view/view_service.h"
#include "tools/view/work_lane.h"

using namespace isonest::detail::view;

namespace {

/// The result of a search if errors give these numbers of triangles, and no try takes time.
struct Found {
    std::optional<double> best;
    std::uint64_t triangles = 0;
    int tries = 0;
};

template <class Triangles>
Found search(ErrorChoice& choice, std::uint64_t most, const Triangles& triangles) {
    Found found;
    ErrorChoice::Search search(choice, most, 1);
    while (const auto error = search.next()) {
        search.tried(triangles(*error), 0);
        REQUIRE(++found.tries <= 60);
    }
    choice.learn(search);
    found.best = search.best();
    found.triangles = found.best ? triangles(*found.best) : 0;
    return found;
}

}  // namespace

TEST_CASE("a search ends with the best error that it tried, for any data") {
    const double range = GENERATE(0.0, 1e-30, 1.0, 255.0, 1e30);
    for (const double power : {0.3, 1.0, 2.0, 6.0}) {
        const auto triangles = [&](double error) {
            return error <= 0 ? std::uint64_t{1} << 40
                              : static_cast<std::uint64_t>(
                                    std::min(1e12, 12 * std::pow(2 * range / error, power)));
        };
        ErrorChoice choice(range);
        for (const std::uint64_t most : {12U, 100U, 5000U, 100000U, 20U}) {
            const Found found = search(choice, most, triangles);
            if (range == 0) {
                CHECK(!found.best);
                continue;
            }
            REQUIRE(found.best);
            CHECK(found.triangles <= most);
            if (power == 1.0 && most >= 100) {
                CHECK(found.triangles * 3 > most);
            }
        }
    }
}

TEST_CASE("a slider that is moved further needs one or two tries") {
    ErrorChoice choice(100);
    const auto triangles = [](double scale) {
        return [scale](double error) {
            return static_cast<std::uint64_t>(error > 0 ? scale / error : 1e15);
        };
    };
    search(choice, 100000, triangles(1e5));
    for (int i = 0; i < 20; ++i) {
        CHECK(search(choice, 100000, triangles(1e5 * (1 + 0.05 * i))).tries <= 2);
    }
}

TEST_CASE("a search without a mesh reports that, and one with only empty meshes ends") {
    ErrorChoice choice(1);
    CHECK(!search(choice, 100, [](double) { return std::uint64_t{101}; }).best);
    const Found empty = search(choice, 100, [](double) { return std::uint64_t{0}; });
    CHECK(empty.best == 0.0);
}

TEST_CASE("a request's parameters can be taken once, and the remaining ones are named") {
    RequestTarget target("/api/surface?iso=1.5&box=1,2,3&name=a%20b+c&n=7&empty=&flag");
    CHECK(target.path() == "/api/surface");
    CHECK(target.number("iso", 0, 2) == 1.5);
    CHECK(!target.number("iso", 0, 2));
    CHECK(target.numbers("box", 3, "x,y,z") == std::vector<double>{1, 2, 3});
    CHECK(target.text("name") == "a b c");
    CHECK(target.integer("n", 1, 9) == 7);
    CHECK(target.text("empty") == "");
    CHECK_THROWS_WITH(target.require_all_taken(), Catch::Contains("flag"));
    CHECK(target.text("flag") == "");
    CHECK_NOTHROW(target.require_all_taken());
    for (const char* const wrong : {"/a?b=%", "/a?b=%1", "/a?b=%g0", "/a?b=1&b=2"}) {
        CHECK_THROWS_AS(RequestTarget(wrong), isonest::Error);
    }
    for (const char* const wrong :
         {"/a?b=", "/a?b=nan", "/a?b=inf", "/a?b=1e999", "/a?b=3", "/a?b=1x"}) {
        RequestTarget numbers(wrong);
        CHECK_THROWS_WITH(numbers.number("b", 0, 2), Catch::Contains("b '"));
    }
}

TEST_CASE("request targets of random bytes are parsed or refused") {
    std::mt19937 random(7);
    int read = 0;
    for (int i = 0; i < 20000; ++i) {
        std::string text = "/api/surface?iso=1&box=0,0,0,1,1,1";
        for (unsigned k = random() % 6; k-- > 0;) {
            text[random() % text.size()] = static_cast<char>(random());
        }
        try {
            RequestTarget target(text);
            ++read;
            static_cast<void>(target.number("iso", -1, 1));
            static_cast<void>(target.numbers("box", 6, ""));
            target.require_all_taken();
        } catch (const isonest::Error& e) {
            CHECK(e.kind() == isonest::ErrorKind::invalid_argument);
        }
    }
    CHECK(read > 1000);
}

TEST_CASE("only the server's own pages are accepted") {
    const Access own{"127.0.0.1", 80, "", false};
    const auto refused = [](const Access& access, const HttpRequest& request, bool is_page = false,
                            const std::string& token = "") {
        return !why_refused(access, request, token, is_page).empty();
    };
    CHECK(!refused(own, {"GET", "/", "127.0.0.1:80", "", ""}));
    CHECK(!refused(own, {"GET", "/", "localhost:80", "http://localhost:80", "same-origin"}));
    CHECK(refused(own, {"GET", "/", "localhost:80", "http://127.0.0.1:80", ""}));
    CHECK(refused(own, {"GET", "/", "127.0.0.1:81", "", ""}));
    CHECK(refused(own, {"GET", "/", "", "", ""}));
    CHECK(refused(own, {"GET", "/", "", "", ""}, true));
    CHECK(refused(own, {"GET", "/", "127.0.0.1:80", "https://127.0.0.1:80", ""}));
    CHECK(refused(own, {"GET", "/", "127.0.0.1:80", "", "cross-site"}));
    CHECK(!refused(own, {"GET", "/", "127.0.0.1:80", "", "cross-site"}, true));
    const Access six{"::1", 80, "", false};
    CHECK(!refused(six, {"GET", "/", "[::1]:80", "", ""}));
    const Access open{"0.0.0.0", 80, "secret", true};
    CHECK(refused(open, {"GET", "/", "host:80", "", ""}));
    CHECK(refused(open, {"GET", "/", "host:80", "", ""}, false, "secreT"));
    CHECK(!refused(open, {"GET", "/", "host:80", "", ""}, false, "secret"));
    CHECK(new_token() != new_token());
}

TEST_CASE("each job of a lane is called exactly once, cancelled or not, even when the lane ends") {
    std::atomic<int> called = 0;
    std::atomic<int> cancelled = 0;
    int taken = 0;
    {
        WorkLane lane(3);
        std::vector<std::shared_ptr<Job>> jobs;
        for (int i = 0; i < 50; ++i) {
            auto job = std::make_shared<Job>();
            taken += int{lane.add(job, [&](Job& self) {
                ++called;
                for (int k = 0; k < 2 && !self.cancelled(); ++k) {
                    std::this_thread::sleep_for(std::chrono::milliseconds(1));
                }
                cancelled += int{self.cancelled()};
            })};
            if (i % 3 == 0) {
                job->cancel();
            }
            jobs.push_back(std::move(job));
        }
        auto endless = std::make_shared<Job>();
        while (!lane.add(endless, [&](Job& self) {
            ++called;
            while (!self.cancelled()) {
                std::this_thread::sleep_for(std::chrono::milliseconds(1));
            }
            ++cancelled;
        })) {
        }
        ++taken;
    }
    CHECK(called == taken);
    CHECK(cancelled >= 1);
}

TEST_CASE("a stream's new request replaces its previous one, and nothing else") {
    Streams streams;
    const auto a = std::make_shared<Job>();
    const auto b = std::make_shared<Job>();
    const auto c = std::make_shared<Job>();
    streams.replace("one", a);
    streams.replace("two", b);
    CHECK((!a->cancelled() && !b->cancelled()));
    streams.replace("one", c);
    CHECK((a->cancelled() && !b->cancelled() && !c->cancelled()));
    streams.cancel("none");
    streams.cancel("two");
    CHECK((b->cancelled() && !c->cancelled()));
    CHECK_NOTHROW(Streams::require_name("a-Z_9"));
    for (const char* const wrong : {"", "a b", "a/b", "\xC3\xA4"}) {
        CHECK_THROWS_AS(Streams::require_name(wrong), isonest::Error);
    }
}
