// Source: RFC 1952; https://zlib.net/manual.html
#include "preprocess/sources/bytes/gzip_stream.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

#include <isonest/error.h>

#include "preprocess/sources/bytes/regular_file.h"

namespace isonest::detail {

GzipStream::GzipStream(const InputFile& file, std::string name, std::uint64_t start,
                       DeflateWrapper wrapper)
    : name_(std::move(name)), wrapper_(wrapper), file_at_(start), in_(std::size_t{1} << 18U) {
    constexpr int kGzipOnly = 16;
    const int bits = wrapper == DeflateWrapper::gzip   ? MAX_WBITS + kGzipOnly
                     : wrapper == DeflateWrapper::zlib ? MAX_WBITS
                                                       : -MAX_WBITS;
    if (::inflateInit2(&stream_, bits) != Z_OK) {
        throw Error(ErrorKind::io, {name_}, "zlib does not start: too little memory?");
    }
    if (file.is_far()) {
        far_ = std::make_unique<ReadAhead>(file);
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
    if (far_ != nullptr) {
        const std::uint64_t left = far_->size() - std::min(far_->size(), file_at_);
        n = static_cast<ssize_t>(std::min<std::uint64_t>(in_.size(), left));
        far_->read(file_at_, in_.data(), static_cast<std::uint64_t>(n));
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
            corrupt("what follows its end is neither gzip nor zeros");
        }
        padding = true;
    }
    ended_ = true;
}

std::uint64_t GzipStream::read(std::byte* dst, std::uint64_t bytes) {
    std::uint64_t done = 0;
    while (done < bytes && !ended_) {
        if (stream_.avail_in == 0 && !refill()) {
            corrupt("the file ends before the stream does; it was cut short");
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
            corrupt(stream_.msg != nullptr ? stream_.msg : "not what it should be");
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

}  // namespace isonest::detail
