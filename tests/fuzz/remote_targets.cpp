// Targets that take a server's answers, and what is cached of them.
#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <isonest/error.h>
#include <isonest/remote.h>

#include "preprocess/sources/bytes/remote_objects.h"
#include "preprocess/sources/zarr/zarr_files.h"
#include "store/base/checksum.h"
#include "store/bytes/disk_cache.h"
#include "store/bytes/store_bytes.h"
#include "store/remote/answer.h"
#include "store/remote/object_url.h"
#include "tests/fuzz/scratch.h"
#include "tests/fuzz/targets.h"

namespace isonest::detail::fuzz {
namespace {

std::string_view text_of(Bytes bytes) {
    return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

/// A number of two bytes, which are removed; 0 if there are none.
std::size_t taken(Bytes& bytes) {
    if (bytes.size() < 2) {
        bytes = {};
        return 0;
    }
    const std::size_t number = bytes[0] + std::size_t{256} * bytes[1];
    bytes = bytes.subspan(2);
    return number;
}

/// Objects in memory.
class Objects : public ObjectFolder {
  public:
    explicit Objects(std::map<std::string, std::vector<std::byte>> objects)
        : objects_(std::move(objects)) {}
    [[nodiscard]] const std::string& name() const override { return name_; }
    [[nodiscard]] FetchedPart read(const ObjectPart& part) override {
        const auto it = objects_.find(part.path);
        if (it == objects_.end()) {
            return {};
        }
        if (it->second.size() > part.size && part.kind == ObjectPart::Kind::whole) {
            throw Error(ErrorKind::corrupt, {part.path}, "it is larger");
        }
        FetchedPart found;
        found.is_there = true;
        found.bytes = HeldBytes(nullptr, it->second);
        found.object_size = it->second.size();
        return found;
    }
    [[nodiscard]] std::optional<FetchedPart> look_at(const ObjectPart& part) override {
        return read(part);
    }
    void want(std::span<const ObjectPart> /*parts*/) override {}
    [[nodiscard]] FetchedCounts fetched() const override { return {}; }

  private:
    std::string name_ = "https://example.org/v.zarr";
    std::map<std::string, std::vector<std::byte>> objects_;
};

}  // namespace

void remote_zarr(Bytes bytes) {
    constexpr std::array<const char*, 8> kNames{"zarr.json",   ".zarray",    ".zattrs",
                                                ".zgroup",     ".zmetadata", "0/.zarray",
                                                "0/zarr.json", "0/.zattrs"};
    std::map<std::string, std::vector<std::byte>> objects;
    while (bytes.size() > 3) {
        const char* const name = kNames.at(bytes[0] % kNames.size());
        bytes = bytes.subspan(1);
        const std::size_t said = taken(bytes);
        const std::size_t length = std::min(said, bytes.size());
        const auto content = std::as_bytes(bytes.first(length));
        objects[name].assign(content.begin(), content.end());
        bytes = bytes.subspan(length);
    }
    try {
        const auto files = remote_zarr_files(std::make_shared<Objects>(std::move(objects)));
        for (const char* const folder : {"", "0", "labels", "a/b"}) {
            const fs::path at = files->root() / folder;
            keep(files->may_have_folder(at) ? 1 : 0);
            if (const auto inner = files->folders_in(at)) {
                keep(static_cast<double>(inner->size()));
            }
            for (const char* const name : kNames) {
                keep(files->has(at / name) && files->json(at / name) ? 1 : 0);
            }
            files->read_anew(at);
        }
        keep(static_cast<double>(files->notes().size()));
        files->refuse();
    } catch (const Error&) {
        // Refused.
    }
}

void answer(Bytes bytes) {
    if (bytes.size() < 8) {
        return;
    }
    Asked asked;
    asked.range = {bytes[0], bytes[1]};
    asked.tail = bytes[2] % 4 == 0 ? bytes[3] : 0;
    asked.is_whole = bytes[2] % 4 == 1;
    asked.most = bytes[4];
    Validators opened;
    opened.size = bytes[5];
    opened.etag = bytes[6] % 2 == 0 ? "\"a\"" : "";
    opened.last_modified = bytes[6] % 3 == 0 ? "Thu, 26 Nov 2026 20:00:00 GMT" : "";
    const bool is_open = bytes[7] % 2 == 0;
    AnswerHead head;
    std::string_view text = text_of(bytes.subspan(8));
    while (!text.empty()) {
        const std::size_t end = std::min(text.find('\n'), text.size() - 1) + 1;
        head.add_line(text.substr(0, end));
        text.remove_prefix(end);
    }
    const Judgement said = judge(head, asked, is_open ? nullptr : &opened);
    keep(static_cast<double>(said.size) + static_cast<double>(said.range.size));
    if (said.verdict == Verdict::part && !asked.is_whole && asked.tail == 0 &&
        (said.range.offset != asked.range.offset || said.range.size > asked.range.size)) {
        throw std::logic_error("a part that was not asked for");
    }
}

void object_url(Bytes bytes) {
    const std::size_t said = taken(bytes);
    const std::size_t length = std::min(said, bytes.size());
    const std::string url(text_of(bytes.first(length)));
    const std::string name(text_of(bytes.subspan(length)));
    if (!is_url(url)) {
        return;  // which is not taken for an object
    }
    try {
        const ObjectUrl object =
            parse_object_url(url, [](const char*) -> const char* { return nullptr; });
        keep(static_cast<double>(object_below(object, name).request.size()));
        keep(static_cast<double>(origin_of(url).size()));
        keep(static_cast<double>(query_without_signature(url).size()));
        keep(static_cast<double>(last_part_of(url).size()));
        const std::string beside = url_beside(url, name, "shown");
        if (origin_of(beside) != origin_of(url)) {
            throw std::logic_error("a name leads to another server");
        }
    } catch (const Error&) {
        // Refused.
    }
}

void cached_block(Bytes bytes) {
    constexpr std::size_t kSummedFrom = 16;  // after eight letters and the checksum
    std::vector<std::byte> file(bytes.size());
    std::copy_n(std::as_bytes(bytes).begin(), bytes.size(), file.begin());
    if (file.size() > kSummedFrom) {
        const std::uint64_t sum = checksum_of(std::span(file).subspan(kSummedFrom));
        std::memcpy(file.data() + kSummedFrom - sizeof(sum), &sum, sizeof(sum));
    }
    constexpr std::string_view kObject = "https://example.org/a";
    auto block = CachedBlock::decode(file, kObject, 3);
    if (block) {
        std::vector<std::byte> part(CachedBlock::kBytes);
        keep(block->copy(0, std::span(part).first(7)) ? 1 : 0);
        if (block->encode(kObject, 3) != file) {
            throw std::logic_error("a block that is written otherwise than it was read");
        }
        block->remove(5, 9);
        keep(block->add(7, std::span(part).first(100)) ? 1 : 0);
        keep(block->copy(7, std::span(part).first(100)) ? 1 : 0);
    }
}

}  // namespace isonest::detail::fuzz
