#include "preprocess/sources/bytes/byte_reader.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <charconv>
#include <cstring>
#include <filesystem>
#include <memory>
#include <utility>

#include <isonest/error.h>

#include "preprocess/sources/bytes/input_file.h"

namespace isonest::detail {
namespace {

class BytesOfFile : public ByteReader {
  public:
    BytesOfFile(std::filesystem::path path, std::uint64_t start, std::uint64_t size)
        : path_(std::move(path)),
          start_(start),
          size_(size),
          fd_(::open(path_.c_str(), O_RDONLY | O_CLOEXEC)) {
        if (fd_ < 0) {
            throw Error(ErrorKind::io, {path_.string()},
                        fmt::format("cannot open: {}", std::strerror(errno)));
        }
    }
    BytesOfFile(const BytesOfFile&) = delete;
    BytesOfFile& operator=(const BytesOfFile&) = delete;
    ~BytesOfFile() override { ::close(fd_); }
    [[nodiscard]] std::uint64_t size() const override { return size_; }
    void read(std::uint64_t at, std::byte* dst, std::uint64_t bytes) override {
        at += start_;
        while (bytes > 0) {
            const ssize_t n = ::pread(fd_, dst, bytes, static_cast<off_t>(at));
            if (n < 0 && errno == EINTR) {
                continue;
            }
            if (n <= 0) {
                throw Error(n == 0 ? ErrorKind::corrupt : ErrorKind::io,
                            {path_.string(), fmt::format("byte {}", at)},
                            n == 0 ? std::string("the file ends here; was it cut short?")
                                   : fmt::format("cannot read: {}", std::strerror(errno)));
            }
            dst += n;
            at += static_cast<std::uint64_t>(n);
            bytes -= static_cast<std::uint64_t>(n);
        }
    }

  private:
    std::filesystem::path path_;
    std::uint64_t start_;
    std::uint64_t size_;
    int fd_;
};

class BytesOfObject : public ByteReader {
  public:
    BytesOfObject(const InputFile& file, std::uint64_t start, std::uint64_t size)
        : name_(file.name()), start_(start), size_(size), ahead_(file) {}
    [[nodiscard]] std::uint64_t size() const override { return size_; }
    void read(std::uint64_t at, std::byte* dst, std::uint64_t bytes) override {
        at += start_;
        if (!lies_within(at, bytes, ahead_.size())) {
            throw Error(ErrorKind::corrupt, {name_, fmt::format("byte {}", ahead_.size())},
                        "the object ends here; was it cut short?");
        }
        ahead_.read(at, dst, bytes);
    }

  private:
    std::string name_;
    std::uint64_t start_;
    std::uint64_t size_;
    ReadAhead ahead_;
};

/// Source: RFC 4648, section 4.
class Base64Bytes : public ByteReader {
  public:
    Base64Bytes(const InputFile& file, std::uint64_t start, std::uint64_t size)
        : name_(file.name()), size_(size), text_(file_bytes(file, start, (size + 2) / 3 * 4)) {}
    [[nodiscard]] std::uint64_t size() const override { return size_; }
    [[nodiscard]] std::uint64_t heap() const override { return kGroups * 7; }
    void read(std::uint64_t at, std::byte* dst, std::uint64_t bytes) override {
        while (bytes > 0) {
            const std::uint64_t first = at / 3;
            const std::uint64_t groups =
                std::min<std::uint64_t>(kGroups, (at + bytes + 2) / 3 - first);
            decode(first, groups);
            const std::uint64_t skip = at % 3;
            const std::uint64_t n = std::min(bytes, 3 * groups - skip);
            std::copy_n(decoded_.begin() + static_cast<std::ptrdiff_t>(skip), n, dst);
            dst += n;
            at += n;
            bytes -= n;
        }
    }

  private:
    static constexpr std::uint64_t kGroups = std::uint64_t{1} << 15U;

    void decode(std::uint64_t first, std::uint64_t groups) {
        letters_.resize(4 * groups);
        text_->read(4 * first, letters_.data(), letters_.size());
        decoded_.resize(3 * groups);
        for (std::uint64_t g = 0; g < groups; ++g) {
            unsigned word = 0;
            for (std::uint64_t i = 0; i < 4; ++i) {
                const int value = value_of(std::to_integer<unsigned char>(letters_[4 * g + i]));
                if (value < 0) {
                    throw Error(
                        ErrorKind::corrupt, {name_},
                        fmt::format("character {} of the data is not base64", 4 * (first + g) + i));
                }
                word = word << 6U | static_cast<unsigned>(value);
            }
            for (unsigned i = 0; i < 3; ++i) {
                decoded_[3 * g + i] = static_cast<std::byte>(word >> (16U - 8U * i) & 0xFFU);
            }
        }
    }
    static int value_of(unsigned char c) {
        static const std::array<int, 256> values = [] {
            std::array<int, 256> v{};
            v.fill(-1);
            constexpr std::string_view kLetters =
                "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
            for (std::size_t i = 0; i < kLetters.size(); ++i) {
                v.at(static_cast<unsigned char>(kLetters[i])) = static_cast<int>(i);
            }
            v['='] = 0;
            return v;
        }();
        return values.at(c);
    }

    std::string name_;
    std::uint64_t size_;
    std::unique_ptr<ByteReader> text_;
    std::vector<std::byte> letters_;
    std::vector<std::byte> decoded_;
};

class PackedBlocks : public ByteReader {
  public:
    PackedBlocks(BlockPacking packing, std::unique_ptr<ByteReader> packed, std::string name,
                 const std::vector<std::uint64_t>& packed_sizes, std::uint64_t block,
                 std::uint64_t size)
        : packing_(packing),
          packed_(std::move(packed)),
          name_(std::move(name)),
          block_(block),
          size_(size) {
        std::uint64_t at = 0;
        for (const std::uint64_t bytes : packed_sizes) {
            starts_.push_back(at);
            max_packed_ = std::max(max_packed_, bytes);
            at += bytes;
        }
        starts_.push_back(at);
    }
    [[nodiscard]] std::uint64_t size() const override { return size_; }
    [[nodiscard]] std::uint64_t heap() const override {
        return packed_->heap() + block_ + max_packed_ + starts_.size() * sizeof(std::uint64_t) +
               max_beside(packing_, block_);
    }
    void read(std::uint64_t at, std::byte* dst, std::uint64_t bytes) override {
        while (bytes > 0) {
            decode(at / block_);
            const std::uint64_t skip = at % block_;
            const std::uint64_t n = std::min(bytes, decoded_.size() - skip);
            std::copy_n(decoded_.begin() + static_cast<std::ptrdiff_t>(skip), n, dst);
            dst += n;
            at += n;
            bytes -= n;
        }
    }

  private:
    void decode(std::uint64_t block) {
        if (block == current_) {
            return;
        }
        current_ = ~std::uint64_t{0};
        letters_.resize(starts_[block + 1] - starts_[block]);
        packed_->read(starts_[block], letters_.data(), letters_.size());
        decoded_.resize(std::min(block_, size_ - block * block_));
        if (!unpack_block(packing_, letters_, decoded_)) {
            throw Error(ErrorKind::corrupt, {name_, fmt::format("block {}", block)},
                        "the data do not decompress to the size in the header");
        }
        current_ = block;
    }

    BlockPacking packing_;
    std::unique_ptr<ByteReader> packed_;
    std::string name_;
    std::uint64_t block_;
    std::uint64_t size_;
    std::vector<std::uint64_t> starts_;
    std::uint64_t max_packed_ = 0;
    std::uint64_t current_ = ~std::uint64_t{0};
    std::vector<std::byte> letters_;
    std::vector<std::byte> decoded_;
};

class BytesBehind : public ByteReader {
  public:
    BytesBehind(std::unique_ptr<ByteReader> bytes, std::uint64_t skipped)
        : bytes_(std::move(bytes)), skipped_(skipped) {}
    [[nodiscard]] std::uint64_t size() const override { return bytes_->size() - skipped_; }
    [[nodiscard]] bool sequential() const override { return bytes_->sequential(); }
    [[nodiscard]] std::uint64_t heap() const override { return bytes_->heap(); }
    void read(std::uint64_t at, std::byte* dst, std::uint64_t bytes) override {
        bytes_->read(skipped_ + at, dst, bytes);
    }

  private:
    std::unique_ptr<ByteReader> bytes_;
    std::uint64_t skipped_;
};

template <class T>
class TextNumbers : public ByteReader {
  public:
    TextNumbers(const InputFile& file, std::uint64_t start, std::string_view type,
                std::uint64_t count, bool commas)
        : name_(file.name()),
          type_(type),
          count_(count),
          commas_(commas),
          end_(regular_file_size(file)),
          at_(start),
          text_(file_bytes(file, 0, end_)) {}
    [[nodiscard]] std::uint64_t size() const override { return count_ * sizeof(T); }
    [[nodiscard]] bool sequential() const override { return true; }
    [[nodiscard]] std::uint64_t heap() const override { return kPart + kLongest; }
    void read(std::uint64_t at, std::byte* dst, std::uint64_t bytes) override {
        for (; done_ < at / sizeof(T); ++done_) {
            static_cast<void>(next());
        }
        for (std::uint64_t i = 0; i < bytes / sizeof(T); ++i, ++done_) {
            const T value = next();
            std::memcpy(dst + i * sizeof(T), &value, sizeof(T));
        }
    }

  private:
    static constexpr std::size_t kPart = std::size_t{1} << 16U;
    static constexpr std::size_t kLongest = 64;  ///< letters in a number

    T next() {
        const std::string_view word = next_word();
        T value{};
        const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
        if (error != std::errc{} || end != word.data() + word.size()) {
            throw Error(
                ErrorKind::corrupt, {name_, fmt::format("number {}", done_)},
                fmt::format("{:?} is not a number of type {}", word.substr(0, kLongest), type_));
        }
        return value;
    }
    std::string_view next_word() {
        const auto blank = [this](char c) {
            return c == ' ' || (c >= '\t' && c <= '\r') || (c == ',' && commas_);
        };
        const auto ends = [&](char c) { return blank(c) || c == '<'; };
        while (true) {
            const auto from = std::find_if_not(part_.begin() + used_, part_.end(), blank);
            const auto to = std::find_if(from, part_.end(), ends);
            if (from != part_.end() && (to != part_.end() || at_ == end_)) {
                used_ = to - part_.begin();
                return {&*from, static_cast<std::size_t>(to - from)};
            }
            const std::string rest(from, part_.end());
            if (at_ == end_ || rest.size() > kLongest) {
                throw Error(ErrorKind::corrupt, {name_, fmt::format("number {}", done_)},
                            "there are no more numbers; was the file cut short?");
            }
            const std::uint64_t more = std::min<std::uint64_t>(kPart, end_ - at_);
            part_.assign(rest);
            part_.resize(rest.size() + more);
            text_->read(at_, reinterpret_cast<std::byte*>(part_.data()) + rest.size(), more);
            at_ += more;
            used_ = 0;
        }
    }

    std::string name_;
    std::string_view type_;  ///< for messages
    std::uint64_t count_;
    bool commas_;
    std::uint64_t end_;
    std::uint64_t at_;  ///< of the bytes after the part
    std::unique_ptr<ByteReader> text_;
    std::string part_;
    std::ptrdiff_t used_ = 0;
    std::uint64_t done_ = 0;
};

}  // namespace

std::unique_ptr<ByteReader> file_bytes(const InputFile& file, std::uint64_t start,
                                       std::uint64_t size) {
    if (file.is_remote()) {
        return std::make_unique<BytesOfObject>(file, start, size);
    }
    return std::make_unique<BytesOfFile>(file.path(), start, size);
}
std::unique_ptr<ByteReader> base64_bytes(const InputFile& file, std::uint64_t start,
                                         std::uint64_t size) {
    return std::make_unique<Base64Bytes>(file, start, size);
}
std::unique_ptr<ByteReader> packed_blocks(BlockPacking packing, std::unique_ptr<ByteReader> packed,
                                          std::string name,
                                          const std::vector<std::uint64_t>& packed_sizes,
                                          std::uint64_t block, std::uint64_t size) {
    return std::make_unique<PackedBlocks>(packing, std::move(packed), std::move(name), packed_sizes,
                                          block, size);
}
std::unique_ptr<ByteReader> bytes_behind(std::unique_ptr<ByteReader> bytes, std::uint64_t skipped) {
    return std::make_unique<BytesBehind>(std::move(bytes), skipped);
}
std::unique_ptr<ByteReader> text_numbers(const InputFile& file, std::uint64_t start, ValueType type,
                                         std::uint64_t count, bool commas) {
    return dispatch(type, [&](auto tag) -> std::unique_ptr<ByteReader> {
        using T = typename decltype(tag)::type;
        return std::make_unique<TextNumbers<T>>(file, start, name_of(type), count, commas);
    });
}
std::unique_ptr<ByteReader> text_integers(const InputFile& file, std::uint64_t start,
                                          bool is_signed, std::uint64_t count, bool commas) {
    if (is_signed) {
        return std::make_unique<TextNumbers<std::int64_t>>(file, start, "int64", count, commas);
    }
    return std::make_unique<TextNumbers<std::uint64_t>>(file, start, "uint64", count, commas);
}

}  // namespace isonest::detail
