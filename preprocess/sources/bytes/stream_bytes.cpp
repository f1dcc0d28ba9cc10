// Sources: RFC 1952; https://sourceware.org/bzip2/manual/manual.html#libprog

#include "preprocess/sources/bytes/stream_bytes.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <cstring>
#include <utility>

#include <isonest/error.h>

#include "preprocess/sources/bytes/input_file.h"

#if ISONEST_WITH_BZIP2
#include <bzlib.h>
#endif

namespace isonest::detail {

// Source: RFC 1952; https://zlib.net/manual.html

GzipStream::GzipStream(const InputFile& file, std::string name, std::uint64_t start,
                       DeflateWrapper wrapper)
    : name_(std::move(name)), wrapper_(wrapper), file_at_(start), in_(std::size_t{1} << 18U) {
    constexpr int kGzipOnly = 16;
    const int bits = wrapper == DeflateWrapper::gzip   ? MAX_WBITS + kGzipOnly
                     : wrapper == DeflateWrapper::zlib ? MAX_WBITS
                                                       : -MAX_WBITS;
    if (::inflateInit2(&stream_, bits) != Z_OK) {
        throw Error(ErrorKind::io, {name_}, "cannot start zlib; is there too little memory?");
    }
    if (file.is_remote()) {
        remote_ = std::make_unique<ReadAhead>(file);
        return;
    }
    fd_ = ::open(file.path().c_str(), O_RDONLY | O_CLOEXEC);
    if (fd_ < 0) {
        const int error = errno;
        ::inflateEnd(&stream_);
        throw Error(ErrorKind::io, {name_}, fmt::format("cannot open: {}", std::strerror(error)));
    }
}

GzipStream::~GzipStream() {
    ::inflateEnd(&stream_);
    if (fd_ >= 0) {
        ::close(fd_);
    }
}

void GzipStream::corrupt(const std::string& what) const {
    throw Error(ErrorKind::corrupt, {name_, fmt::format("byte {}", file_at_ - stream_.avail_in)},
                fmt::format("damaged {} stream: {}",
                            wrapper_ == DeflateWrapper::gzip ? "gzip" : "compressed", what));
}

bool GzipStream::refill() {
    ssize_t n = 0;
    if (remote_ != nullptr) {
        const std::uint64_t left = remote_->size() - std::min(remote_->size(), file_at_);
        n = static_cast<ssize_t>(std::min<std::uint64_t>(in_.size(), left));
        remote_->read(file_at_, in_.data(), static_cast<std::uint64_t>(n));
    } else {
        do {
            n = ::pread(fd_, in_.data(), in_.size(), static_cast<off_t>(file_at_));
        } while (n < 0 && errno == EINTR);
    }
    if (n < 0) {
        throw Error(ErrorKind::io, {name_, fmt::format("byte {}", file_at_)},
                    fmt::format("cannot read: {}", std::strerror(errno)));
    }
    file_at_ += static_cast<std::uint64_t>(n);
    stream_.next_in = reinterpret_cast<Bytef*>(in_.data());
    stream_.avail_in = static_cast<uInt>(n);
    return n > 0;
}

void GzipStream::next_member() {
    constexpr unsigned char kMagic = 0x1F;
    bool padding = false;
    while (stream_.avail_in > 0 || refill()) {
        if (*stream_.next_in == kMagic && !padding) {
            ::inflateReset(&stream_);
            return;
        }
        const uInt n = stream_.avail_in;
        const uInt zeros = static_cast<uInt>(
            std::find_if(stream_.next_in, stream_.next_in + n, [](Bytef b) { return b != 0; }) -
            stream_.next_in);
        stream_.next_in += zeros;
        stream_.avail_in -= zeros;
        if (zeros < n) {
            corrupt("the bytes after its end are neither gzip nor zeros");
        }
        padding = true;
    }
    ended_ = true;
}

std::uint64_t GzipStream::read(std::byte* dst, std::uint64_t bytes) {
    std::uint64_t done = 0;
    while (done < bytes && !ended_) {
        if (stream_.avail_in == 0 && !refill()) {
            corrupt("the stream is incomplete; the file was cut short");
        }
        const auto part = static_cast<uInt>(std::min<std::uint64_t>(bytes - done, 1U << 30U));
        stream_.next_out = reinterpret_cast<Bytef*>(dst + done);
        stream_.avail_out = part;
        const int code = ::inflate(&stream_, Z_NO_FLUSH);
        done += part - stream_.avail_out;
        if (code == Z_STREAM_END && wrapper_ != DeflateWrapper::gzip) {
            ended_ = true;
        } else if (code == Z_STREAM_END) {
            next_member();
        } else if (code != Z_OK && code != Z_BUF_ERROR) {
            corrupt(stream_.msg != nullptr ? stream_.msg : "invalid data");
        }
    }
    return done;
}

bool is_gzip(const InputFile& file, std::uint64_t at) {
    constexpr unsigned kReservedFlags = 0xE0;
    const std::string head = first_bytes(file, 4, at);
    return head.size() == 4 && head.starts_with("\x1F\x8B\x08") &&
           (static_cast<unsigned char>(head[3]) & kReservedFlags) == 0;
}

namespace {

constexpr std::size_t kStreamPart = std::size_t{1} << 17U;

/// Part of the output of a stream. Stream has read(dst, bytes), which returns fewer only at its
/// end.
template <class Stream>
class BytesOfStream : public ByteReader {
  public:
    template <class... Args>
    BytesOfStream(const StreamPart& part, Args&&... args)
        : name_(part.file.name()),
          skip_(part.skip),
          size_(part.size),
          stream_(std::forward<Args>(args)...) {}
    [[nodiscard]] std::uint64_t size() const override { return size_; }
    [[nodiscard]] bool sequential() const override { return true; }
    [[nodiscard]] std::uint64_t heap() const override { return 4 * kStreamPart; }
    void read(std::uint64_t at, std::byte* dst, std::uint64_t bytes) override {
        skip_to(skip_ + at);
        fetch(dst, bytes);
    }
    /// Reads to the end, because the checksum is there.
    void finish() override {
        skip_to(skip_ + size_);
        std::vector<std::byte> rest(kStreamPart);
        const std::uint64_t most = std::max<std::uint64_t>(std::uint64_t{1} << 30U, 16 * at_);
        std::uint64_t behind = 0;
        while (const std::uint64_t n = stream_.read(rest.data(), rest.size())) {
            behind += n;
            if (behind > most) {
                throw Error(
                    ErrorKind::unsupported, {name_},
                    fmt::format("more than {} bytes follow the {} bytes of data", most, at_));
            }
        }
    }

  private:
    void skip_to(std::uint64_t at) {
        std::vector<std::byte> skipped(at_ < at ? kStreamPart : 0);
        while (at_ < at) {
            fetch(skipped.data(), std::min<std::uint64_t>(at - at_, skipped.size()));
        }
    }
    void fetch(std::byte* dst, std::uint64_t bytes) {
        const std::uint64_t n = stream_.read(dst, bytes);
        at_ += n;
        if (n < bytes) {
            throw Error(ErrorKind::corrupt, {name_},
                        fmt::format("the decompressed data end at byte {}, but {} bytes are needed",
                                    at_, skip_ + size_));
        }
    }

    std::string name_;
    std::uint64_t skip_;
    std::uint64_t size_;
    Stream stream_;
    std::uint64_t at_ = 0;  ///< position in the stream
};

/// Reads a file from a byte to its end, in parts.
class FileParts {
  public:
    FileParts(const InputFile& file, std::uint64_t start)
        : end_(regular_file_size(file)),
          at_(std::min(start, end_)),
          bytes_(file_bytes(file, 0, end_)) {}
    /// Empty at the end of the file.
    std::vector<char>& next() {
        part_.resize(std::min<std::uint64_t>(kStreamPart, end_ - at_));
        bytes_->read(at_, reinterpret_cast<std::byte*>(part_.data()), part_.size());
        at_ += part_.size();
        return part_;
    }
    [[nodiscard]] std::uint64_t at() const { return at_; }

  private:
    std::uint64_t end_;
    std::uint64_t at_;
    std::unique_ptr<ByteReader> bytes_;
    std::vector<char> part_;
};

class HexStream {
  public:
    explicit HexStream(const StreamPart& part)
        : name_(part.file.name()), file_(part.file, part.start) {}
    std::uint64_t read(std::byte* dst, std::uint64_t bytes) {
        std::uint64_t done = 0;
        for (; done < bytes; ++done) {
            const int high = next_digit();
            const int low = high < 0 ? -1 : next_digit();
            if (low < 0) {
                break;
            }
            dst[done] = static_cast<std::byte>(16 * high + low);
        }
        return done;
    }

  private:
    /// -1 at the end of the file.
    int next_digit() {
        while (true) {
            if (used_ == part_->size()) {
                part_ = &file_.next();
                used_ = 0;
                if (part_->empty()) {
                    return -1;
                }
            }
            const auto c = static_cast<unsigned char>((*part_)[used_++]);
            if (std::isxdigit(c) != 0) {
                return std::isdigit(c) != 0 ? c - '0' : std::tolower(c) - 'a' + 10;
            }
            if (std::isspace(c) == 0) {
                throw Error(ErrorKind::corrupt,
                            {name_, fmt::format("byte {}", file_.at() - part_->size() + used_ - 1)},
                            "the character is neither a hexadecimal digit nor white space");
            }
        }
    }
    std::string name_;
    FileParts file_;
    std::vector<char> none_;
    std::vector<char>* part_ = &none_;
    std::size_t used_ = 0;
};

#if ISONEST_WITH_BZIP2
class Bzip2Stream {
  public:
    explicit Bzip2Stream(const StreamPart& part)
        : name_(part.file.name()), file_(part.file, part.start) {
        start();
    }
    Bzip2Stream(const Bzip2Stream&) = delete;
    Bzip2Stream& operator=(const Bzip2Stream&) = delete;
    ~Bzip2Stream() { ::BZ2_bzDecompressEnd(&stream_); }

    std::uint64_t read(std::byte* dst, std::uint64_t bytes) {
        std::uint64_t done = 0;
        while (done < bytes && !ended_) {
            if (stream_.avail_in == 0 && !refill()) {
                if (is_new_) {
                    ended_ = true;  // after a stream
                    break;
                }
                corrupt("the stream is incomplete; the file was cut short");
            }
            const auto part =
                static_cast<unsigned>(std::min<std::uint64_t>(bytes - done, 1U << 30U));
            stream_.next_out = reinterpret_cast<char*>(dst + done);
            stream_.avail_out = part;
            const int code = ::BZ2_bzDecompress(&stream_);
            done += part - stream_.avail_out;
            is_new_ = false;
            if (code == BZ_STREAM_END) {
                restart();
            } else if (code != BZ_OK) {
                corrupt("wrong checksum or invalid data");
            }
        }
        return done;
    }

  private:
    [[noreturn]] void corrupt(const std::string& what) const {
        throw Error(ErrorKind::corrupt,
                    {name_, fmt::format("byte {}", file_.at() - stream_.avail_in)},
                    "damaged bzip2 stream: " + what);
    }
    void start() {
        if (::BZ2_bzDecompressInit(&stream_, 0, 0) != BZ_OK) {
            throw Error(ErrorKind::io, {name_}, "cannot start bzip2; is there too little memory?");
        }
    }
    void restart() {
        char* const next = stream_.next_in;
        const unsigned left = stream_.avail_in;
        ::BZ2_bzDecompressEnd(&stream_);
        stream_ = {};
        start();
        stream_.next_in = next;
        stream_.avail_in = left;
        is_new_ = had_stream_ = true;
    }
    bool refill() {
        std::vector<char>& part = file_.next();
        stream_.next_in = part.data();
        stream_.avail_in = static_cast<unsigned>(part.size());
        is_new_ = is_new_ && had_stream_;
        return !part.empty();
    }
    std::string name_;
    FileParts file_;
    bz_stream stream_{};
    bool is_new_ = false;  ///< between streams: one has ended and nothing of the next was read
    bool had_stream_ = false;
    bool ended_ = false;
};
#endif

class JoinedBytes : public ByteReader {
  public:
    JoinedBytes(std::vector<InputFile> files, std::uint64_t piece, bool sequential,
                std::function<std::unique_ptr<ByteReader>(const InputFile&)> open)
        : files_(std::move(files)),
          piece_(piece),
          sequential_(sequential),
          open_(std::move(open)) {}
    [[nodiscard]] std::uint64_t size() const override { return files_.size() * piece_; }
    [[nodiscard]] bool sequential() const override { return sequential_; }
    [[nodiscard]] std::uint64_t heap() const override {
        constexpr std::uint64_t kOfName = 256;
        return (sequential_ ? 4 * kStreamPart : 0) + files_.size() * kOfName;
    }
    void read(std::uint64_t at, std::byte* dst, std::uint64_t bytes) override {
        while (bytes > 0) {
            const auto file = static_cast<std::size_t>(at / piece_);
            if (file != current_ || !bytes_) {
                finish();
                bytes_ = open_(files_[file]);
                current_ = file;
            }
            const std::uint64_t from = at % piece_;
            const std::uint64_t n = std::min(bytes, piece_ - from);
            bytes_->read(from, dst, n);
            dst += n;
            at += n;
            bytes -= n;
        }
    }
    void finish() override {
        if (bytes_ && sequential_) {
            bytes_->finish();
            bytes_.reset();
        }
    }

  private:
    std::vector<InputFile> files_;
    std::uint64_t piece_;
    bool sequential_;
    std::function<std::unique_ptr<ByteReader>(const InputFile&)> open_;
    std::size_t current_ = 0;
    std::unique_ptr<ByteReader> bytes_;
};

}  // namespace

std::unique_ptr<ByteReader> deflated_bytes(const StreamPart& part, DeflateWrapper wrapper) {
    return std::make_unique<BytesOfStream<GzipStream>>(part, part.file, part.file.name(),
                                                       part.start, wrapper);
}

std::unique_ptr<ByteReader> bzip2_bytes([[maybe_unused]] const StreamPart& part) {
#if ISONEST_WITH_BZIP2
    return std::make_unique<BytesOfStream<Bzip2Stream>>(part, part);
#else
    throw Error(ErrorKind::unsupported, {part.file.name()},
                "the data are compressed with bzip2, which this build does not support",
                {{RemedyKind::install_package, "libbz2-dev"}});
#endif
}

std::unique_ptr<ByteReader> hex_bytes(const StreamPart& part) {
    return std::make_unique<BytesOfStream<HexStream>>(part, part);
}

std::unique_ptr<ByteReader> joined_bytes(
    std::vector<InputFile> files, std::uint64_t piece, bool sequential,
    std::function<std::unique_ptr<ByteReader>(const InputFile&)> open) {
    return std::make_unique<JoinedBytes>(std::move(files), piece, sequential, std::move(open));
}

}  // namespace isonest::detail
