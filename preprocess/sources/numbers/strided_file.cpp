#include "preprocess/sources/numbers/strided_file.h"

#include <fmt/format.h>

#include <optional>
#include <utility>

#include <isonest/memory_volume.h>

#include "preprocess/sources/bytes/input_file.h"
#include "preprocess/sources/numbers/raw_rows.h"
#include "store/files/mapped_file.h"

namespace isonest::detail {
namespace {

class StridedFile : public VolumeSource {
  public:
    StridedFile(const std::filesystem::path& path, std::string name, const RawLayout& layout)
        : path_(path), name_(std::move(name)), layout_(layout), map_(path) {
        const auto value =
            layout.strides_in_bytes ? 1 : static_cast<std::int64_t>(size_of(layout.type));
        MemoryLayout memory;
        memory.strides = *layout.strides * value;
        memory.name = name_;
        volume_.emplace(
            map_.bytes().data() + layout.offset + layout.first * static_cast<std::uint64_t>(value),
            layout.type, layout.nodes, memory);
    }
    [[nodiscard]] VolumeDescription describe() const override {
        return {layout_.nodes, layout_.type,      layout_.spacing, layout_.origin,
                name_,         layout_.direction, false,           layout_.unit,
                layout_.frame};
    }
    [[nodiscard]] std::vector<std::filesystem::path> files() const override {
        return local_files({path_, layout_.header});
    }
    [[nodiscard]] std::string identity() const override { return identity_of_raw(path_, layout_); }
    /// What lies together in the file is best read together.
    [[nodiscard]] Granularity granularity() const override {
        return layout_.strides->z < layout_.strides->y ? Granularity{layout_.nodes.z, 1}
                                                       : Granularity{};
    }
    void read(std::int64_t z0, std::int64_t nz, std::int64_t y0, std::int64_t ny,
              std::byte* dst) override {
        volume_->read(z0, nz, y0, ny, dst);
        const std::size_t value = size_of(layout_.type);
        if (layout_.big_endian && value > 1) {
            swap_bytes(dst, static_cast<std::uint64_t>(nz * ny * layout_.nodes.x) * value, value);
        }
    }

  private:
    std::filesystem::path path_;
    std::string name_;
    RawLayout layout_;
    MappedFile map_;
    std::optional<MemoryVolume> volume_;
};

}  // namespace

std::unique_ptr<VolumeSource> open_strided(const std::filesystem::path& path,
                                           const std::string& name, const RawLayout& layout) {
    return std::make_unique<StridedFile>(path, name, layout);
}

}  // namespace isonest::detail
