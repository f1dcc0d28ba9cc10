#include "preprocess/sources/bytes/zip_directory.h"

#include <fmt/format.h>

#include <algorithm>
#include <string_view>

#include <isonest/error.h>

#include "preprocess/sources/bytes/header_number.h"
#include "preprocess/sources/bytes/regular_file.h"

namespace isonest::detail {
namespace {

constexpr std::uint64_t kMostMembers = 250000;
constexpr std::uint64_t kMostDirectory = std::uint64_t{1} << 26U;

class Reader {
  public:
    explicit Reader(const std::filesystem::path& path)
        : path_(path), size_(regular_file_size(path)) {}

    std::vector<ZipMember> read() {
        find_directory();
        std::vector<ZipMember> members;
        const std::string directory = bytes(at_, length_);
        std::size_t at = 0;
        for (std::uint64_t i = 0; i < count_; ++i) {
            members.push_back(member(directory, at));
        }
        return members;
    }

  private:
    [[noreturn]] void corrupt(const std::string& what) const {
        throw Error(ErrorKind::corrupt, {path_.string(), "ZIP directory"}, what);
    }
    /// All of them or an error.
    [[nodiscard]] std::string bytes(std::uint64_t at, std::uint64_t count) const {
        if (at > size_ || count > size_ - at) {
            corrupt("it leads beyond the end of the file; was it cut short?");
        }
        return first_bytes(path_, static_cast<std::size_t>(count), at);
    }

    void find_directory() {
        constexpr std::uint64_t kEnd = 22;
        constexpr std::uint64_t kMostComment = 65535;
        const std::uint64_t length = std::min(size_, kEnd + kMostComment);
        const std::string tail = bytes(size_ - length, length);
        const std::size_t end = tail.rfind("PK\5\6");
        if (end == std::string::npos || tail.size() - end < kEnd) {
            corrupt("there is none at the end of the file; was it cut short?");
        }
        count_ = number_at<std::uint16_t>(tail, end + 10, false);
        length_ = number_at<std::uint32_t>(tail, end + 12, false);
        at_ = number_at<std::uint32_t>(tail, end + 16, false);
        const bool small = count_ < 0xFFFFU && length_ < 0xFFFFFFFFU && at_ < 0xFFFFFFFFU;
        constexpr std::size_t kLocator = 20;
        if (!small && end >= kLocator && tail.compare(end - kLocator, 4, "PK\6\7") == 0) {
            constexpr std::size_t kEnd64 = 56;
            const std::string end64 =
                bytes(number_at<std::uint64_t>(tail, end - kLocator + 8, false), kEnd64);
            if (!end64.starts_with("PK\6\6")) {
                corrupt("its ZIP64 record is not where it should be");
            }
            count_ = number_at<std::uint64_t>(end64, 32, false);
            length_ = number_at<std::uint64_t>(end64, 40, false);
            at_ = number_at<std::uint64_t>(end64, 48, false);
        }
        if (count_ > kMostMembers || length_ > kMostDirectory) {
            throw Error(ErrorKind::unsupported, {path_.string(), "ZIP directory"},
                        fmt::format("{} members: up to {} are read", count_, kMostMembers));
        }
    }

    [[nodiscard]] ZipMember member(std::string_view directory, std::size_t& at) const {
        constexpr std::size_t kFixed = 46;
        if (directory.size() - at < kFixed || directory.substr(at, 4) != "PK\1\2") {
            corrupt(fmt::format("no entry at byte {} of it", at));
        }
        const auto part = directory.substr(at);
        const auto flags = number_at<std::uint16_t>(part, 8, false);
        const auto method = number_at<std::uint16_t>(part, 10, false);
        const std::size_t name = number_at<std::uint16_t>(part, 28, false);
        const std::size_t extra = number_at<std::uint16_t>(part, 30, false);
        const std::size_t comment = number_at<std::uint16_t>(part, 32, false);
        if (part.size() - kFixed < name + extra + comment) {
            corrupt("its last entry has no end");
        }
        ZipMember m;
        m.name = part.substr(kFixed, name);
        m.crc = number_at<std::uint32_t>(part, 16, false);
        m.packed = number_at<std::uint32_t>(part, 20, false);
        m.bytes = number_at<std::uint32_t>(part, 24, false);
        std::uint64_t local = number_at<std::uint32_t>(part, 42, false);
        read_zip64(part.substr(kFixed + name, extra), m, local);
        constexpr unsigned kEncrypted = 1;
        constexpr int kDeflated = 8;
        m.deflated = method == kDeflated;
        m.readable = (flags & kEncrypted) == 0 && (method == 0 || m.deflated);
        constexpr std::size_t kLocal = 30;
        const std::string head = bytes(local, kLocal);
        if (!head.starts_with("PK\3\4")) {
            corrupt(fmt::format("'{:.80}' is not where it should be", m.name));
        }
        m.start = local + kLocal + number_at<std::uint16_t>(head, 26, false) +
                  number_at<std::uint16_t>(head, 28, false);
        if (m.start > size_ || m.packed > size_ - m.start) {
            corrupt(fmt::format("'{:.80}' leads beyond the end of the file", m.name));
        }
        at += kFixed + name + extra + comment;
        return m;
    }

    /// Sizes and the place that did not fit into 32 bits follow each other in an extra field.
    void read_zip64(std::string_view extra, ZipMember& m, std::uint64_t& local) const {
        constexpr std::uint64_t kElsewhere = 0xFFFFFFFFU;
        while (extra.size() >= 4) {
            const auto id = number_at<std::uint16_t>(extra, 0, false);
            const std::size_t length = number_at<std::uint16_t>(extra, 2, false);
            if (length > extra.size() - 4) {
                return;
            }
            if (id == 1) {
                std::string_view rest = extra.substr(4, length);
                for (std::uint64_t* const number : {&m.bytes, &m.packed, &local}) {
                    if (*number != kElsewhere) {
                        continue;
                    }
                    if (rest.size() < sizeof(std::uint64_t)) {
                        corrupt(fmt::format("'{:.80}' has no size", m.name));
                    }
                    *number = number_at<std::uint64_t>(rest, 0, false);
                    rest = rest.substr(sizeof(std::uint64_t));
                }
                return;
            }
            extra = extra.substr(4 + length);
        }
    }

    const std::filesystem::path& path_;
    std::uint64_t size_;
    std::uint64_t count_ = 0;
    std::uint64_t length_ = 0;
    std::uint64_t at_ = 0;
};

}  // namespace

std::vector<ZipMember> read_zip_directory(const std::filesystem::path& path) {
    return Reader(path).read();
}

}  // namespace isonest::detail
