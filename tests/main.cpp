#define CATCH_CONFIG_RUNNER
#include <catch2/catch.hpp>

#include "store/writer.h"

int main(int argc, char** argv) {
    isonest::leave_hdf5_alone_at_exit();
    return Catch::Session().run(argc, argv);
}
