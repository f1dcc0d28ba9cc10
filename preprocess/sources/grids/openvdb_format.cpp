#include <string_view>

#include "preprocess/sources/volume_format.h"

#if ISONEST_WITH_OPENVDB
#include <memory>

#include "preprocess/sources/grids/module/vdb_module.h"
#include "preprocess/sources/module_loader.h"
#endif

namespace isonest::detail {
namespace {

bool is_vdb(const VolumeInput& input) {
    using namespace std::string_view_literals;
    return input.head.starts_with(" BDV\0\0\0\0"sv);
}

#if ISONEST_WITH_OPENVDB

std::unique_ptr<VolumeSource> open_vdb(const VolumeInput& input, const SourceOptions& options) {
    static const auto open = reinterpret_cast<decltype(&isonest_open_vdb)>(load_from_module(
        {"isonest_openvdb.so", "reads OpenVDB", "isonest-openvdb", "libopenvdb-dev"},
        "isonest_open_vdb", input.path().string()));
    return std::unique_ptr<VolumeSource>(open(input, options));
}

#endif

}  // namespace

VolumeFormat vdb_format() {
    return {
        .about = {"OpenVDB", ".vdb", "libopenvdb-dev"}, .takes = {.dataset = true},
        .recognises = is_vdb,
#if ISONEST_WITH_OPENVDB
        .open = open_vdb
#else
        .open = nullptr
#endif
    };
}

}  // namespace isonest::detail
