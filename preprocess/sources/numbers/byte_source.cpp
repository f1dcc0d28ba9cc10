#include "preprocess/sources/numbers/byte_source.h"

#include <fmt/format.h>

#include <utility>

#include <isonest/error.h>

#include "preprocess/sources/numbers/raw_rows.h"

namespace isonest::detail {
namespace {

class ReaderSource : public RawBase {
  public:
    ReaderSource(std::unique_ptr<ByteReader> bytes, const std::string& name,
                 const RawLayout& layout, const InputFile& file)
        : RawBase(file, name, layout), bytes_(std::move(bytes)) {}
    [[nodiscard]] bool sequential() const override { return bytes_->sequential(); }
    [[nodiscard]] std::uint64_t heap() const override { return RawBase::heap() + bytes_->heap(); }

  private:
    void read_bytes(std::uint64_t at, std::byte* dst, std::uint64_t bytes) override {
        bytes_->read(at, dst, bytes);
    }
    void after_last() override { bytes_->finish(); }
    std::unique_ptr<ByteReader> bytes_;
};

}  // namespace

std::unique_ptr<VolumeSource> open_bytes(std::unique_ptr<ByteReader> bytes, const std::string& name,
                                         const RawLayout& layout, const InputFile& file) {
    check_nodes(name, layout);
    const std::uint64_t need = layout.offset + data_bytes(layout);
    if (bytes->size() < need) {
        throw Error(ErrorKind::corrupt, {name},
                    fmt::format("{} need {} bytes, but there are {}", text_of_nodes(layout), need,
                                bytes->size()));
    }
    if (bytes->sequential() && !is_nested(layout)) {
        throw Error(ErrorKind::unsupported, {name},
                    "its axes are stored in another order, which a stream cannot be read in");
    }
    return std::make_unique<ReaderSource>(std::move(bytes), name, layout, file);
}

}  // namespace isonest::detail
