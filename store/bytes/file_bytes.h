// The bytes of a local file, by a read-only map.
#pragma once

#include <filesystem>
#include <string>

#include "store/bytes/store_bytes.h"
#include "store/files/mapped_file.h"

namespace isonest::detail {

class FileBytes : public StoreBytes {
  public:
    /// Throws Error{not_found, io}.
    explicit FileBytes(const std::filesystem::path& path) : name_(path.string()), file_(path) {}

    [[nodiscard]] const std::string& name() const override { return name_; }
    [[nodiscard]] std::uint64_t size() const override { return file_.bytes().size(); }
    [[nodiscard]] bool is_far() const override { return false; }
    [[nodiscard]] HeldBytes read(std::uint64_t offset, std::uint64_t size) const override {
        return {nullptr, file_.bytes().subspan(offset, size)};
    }
    void want(std::span<const ByteRange> ranges) const override {
        for (const ByteRange& range : ranges) {
            file_.prefetch(range.offset, range.size);
        }
    }

  private:
    std::string name_;
    MappedFile file_;
};

}  // namespace isonest::detail
