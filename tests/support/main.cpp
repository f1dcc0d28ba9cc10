#define CATCH_CONFIG_RUNNER
#include <catch2/catch.hpp>

#include "store/container/writer.h"

int main(int argc, char** argv) {
    isonest::detail::leave_hdf5_alone_at_exit();
    return Catch::Session().run(argc, argv);
}
