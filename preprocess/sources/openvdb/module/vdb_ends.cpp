#include "preprocess/sources/openvdb/module/vdb_ends.h"

#include <algorithm>
#include <cstddef>
#include <fstream>

namespace isonest::detail {
namespace {

constexpr std::uint32_t kOldestVersion = 222;
constexpr std::uint32_t kMostGrids = 1000000;

/// Numbers and lengths of an OpenVDB file, which are little-endian; 0 behind its end.
class VdbBytes {
  public:
    explicit VdbBytes(const std::filesystem::path& path) : file_(path, std::ios::binary) {}
    [[nodiscard]] bool good() const { return file_.good(); }
    std::uint64_t number(std::size_t bytes) {
        std::uint64_t result = 0;
        for (std::size_t i = 0; i < bytes; ++i) {
            const int next = file_.get();
            result |= static_cast<std::uint64_t>(next < 0 ? 0 : next) << (8 * i);
        }
        return result;
    }
    void skip(std::uint64_t bytes) {
        file_.seekg(static_cast<std::streamoff>(bytes), std::ios::cur);
    }
    void skip_text() { skip(number(4)); }
    void go_to(std::uint64_t at) { file_.seekg(static_cast<std::streamoff>(at)); }

  private:
    std::ifstream file_;
};

}  // namespace

std::uint64_t end_of_vdb_grids(const std::filesystem::path& path) {
    constexpr std::uint64_t kMagic = 8;
    constexpr std::uint64_t kLibraryVersion = 8;
    constexpr std::uint64_t kUuid = 36;
    VdbBytes file(path);
    file.skip(kMagic);
    if (file.number(4) < kOldestVersion) {
        return 0;
    }
    file.skip(kLibraryVersion);
    const bool has_offsets = file.number(1) != 0;
    file.skip(kUuid);
    for (std::uint64_t metadata = file.number(4); metadata > 0 && file.good(); --metadata) {
        file.skip_text();  // its name
        file.skip_text();  // its type
        file.skip_text();  // its value, which has a length as well
    }
    const std::uint64_t grids = file.number(4);
    std::uint64_t end = 0;
    for (std::uint64_t i = 0; i < grids && i < kMostGrids && has_offsets && file.good(); ++i) {
        file.skip_text();  // its name
        file.skip_text();  // its type
        file.skip_text();  // the grid whose tree it shares
        file.skip(2 * 8);  // where it and its blocks begin
        const std::uint64_t at = file.number(8);
        end = std::max(end, at);
        file.go_to(at);
    }
    return end;
}

}  // namespace isonest::detail
