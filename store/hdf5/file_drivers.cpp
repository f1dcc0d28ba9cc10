#include "store/hdf5/file_drivers.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <exception>
#include <functional>
#include <iterator>
#include <list>
#include <memory>
#include <mutex>
#include <new>
#include <string>
#include <thread>
#include <unordered_map>
#include <vector>

#include "store/files/open_file.h"

#if H5_VERSION_GE(1, 13, 0)
#include <H5FDdevelop.h>
#endif

namespace isonest::detail {
namespace {

/// The most recently used blocks of remote bytes. If a missing block follows those fetched before,
/// twice as many are fetched together, as long as this continues. Otherwise one block is fetched,
/// or up to four after many misses: with 50 ms and 50 Mbit/s, four blocks take about as long to
/// transfer as to request.
/// Thread-safety: one thread, which HDF5's lock ensures.
class HeldBlocks {
  public:
    explicit HeldBlocks(const StoreBytes& bytes) : bytes_(bytes) {}

    /// REQUIRES: the range lies within the bytes.
    void copy(std::uint64_t from, std::size_t size, std::byte* to) {
        while (size > 0) {
            const std::span<const std::byte> block = at(from / kDriverBlock);
            const std::size_t skipped = from % kDriverBlock;
            const std::size_t n = std::min(size, block.size() - skipped);
            std::memcpy(to, block.data() + skipped, n);
            from += n;
            to += n;
            size -= n;
        }
    }

  private:
    struct Block {
        std::uint64_t number = 0;
        std::vector<std::byte> bytes;
    };
    using Blocks = std::list<Block>;
    static constexpr std::size_t kMaxBlocks = kDriverHolds / kDriverBlock;
    static constexpr std::uint64_t kLongestRun = kMaxBlocks / 4;
    static constexpr std::uint64_t kLongestJump = 4;

    std::span<const std::byte> at(std::uint64_t number) {
        if (const auto found = where_.find(number); found != where_.end()) {
            blocks_.splice(blocks_.begin(), blocks_, found->second);
        } else {
            fetch(number);
        }
        return blocks_.front().bytes;
    }

    /// The block becomes the first in blocks_.
    void fetch(std::uint64_t number) {
        const std::uint64_t blocks = (bytes_.size() + kDriverBlock - 1) / kDriverBlock;
        ++misses_;
        const std::uint64_t wanted = number == end_of_run_
                                         ? std::min(2 * run_, kLongestRun)
                                         : std::clamp<std::uint64_t>(misses_ / 2, 1, kLongestJump);
        std::uint64_t end = number + 1;
        while (end < blocks && end < number + wanted && where_.find(end) == where_.end()) {
            ++end;
        }
        const std::uint64_t from = number * kDriverBlock;
        const HeldBytes held =
            bytes_.read(from, std::min(end * kDriverBlock, bytes_.size()) - from);
        for (std::uint64_t i = end; i-- > number;) {
            const std::size_t skipped = (i - number) * kDriverBlock;
            hold(i, held.bytes().subspan(skipped,
                                         std::min(kDriverBlock, held.bytes().size() - skipped)));
        }
        run_ = end - number;
        end_of_run_ = end;
    }

    void hold(std::uint64_t number, std::span<const std::byte> bytes) {
        if (blocks_.size() == kMaxBlocks) {
            where_.erase(blocks_.back().number);
            blocks_.splice(blocks_.begin(), blocks_, std::prev(blocks_.end()));
        } else {
            blocks_.emplace_front();
        }
        // If this runs out of memory, the block cannot be found.
        Block& block = blocks_.front();
        block.number = number;
        block.bytes.assign(bytes.begin(), bytes.end());
        where_.emplace(number, blocks_.begin());
    }

    const StoreBytes& bytes_;
    Blocks blocks_;  ///< most recently used first
    std::unordered_map<std::uint64_t, Blocks::iterator> where_;
    std::uint64_t misses_ = 0;
    std::uint64_t run_ = 1;         ///< number of blocks fetched last
    std::uint64_t end_of_run_ = 0;  ///< the block after them
};

/// What HDF5 reads from. Thread-safety: read() from one thread at a time.
class ReadBytes {
  public:
    explicit ReadBytes(std::shared_ptr<const StoreBytes> bytes)
        : bytes_(std::move(bytes)), blocks_(*bytes_) {}

    [[nodiscard]] std::uint64_t size() const { return bytes_->size(); }

    /// From now on raw data read by this thread are only recorded in `noted`; null: they are read.
    void note(std::vector<ByteRange>* noted) {
        noted_ = noted;
        noting_ = std::this_thread::get_id();
    }
    /// Whether the range was recorded. If that fails, read() fails too.
    bool noted(std::uint64_t from, std::size_t size) noexcept {
        if (noted_ == nullptr || noting_ != std::this_thread::get_id()) {
            return false;
        }
        try {
            noted_->push_back({from, size});
            return true;
        } catch (...) {
            const std::lock_guard lock(mutex_);
            failure_ = std::current_exception();
            return false;
        }
    }

    /// Reads zeros past the end, as HDF5's own driver. False: failed.
    bool read(std::uint64_t from, std::size_t size, std::byte* to) noexcept {
        if (failure() != nullptr) {
            return false;
        }
        try {
            const std::uint64_t end = bytes_->size();
            const std::size_t n =
                from < end ? static_cast<std::size_t>(std::min<std::uint64_t>(size, end - from))
                           : 0;
            if (bytes_->is_remote() && n < kDriverBlock) {
                blocks_.copy(from, n, to);
            } else if (n > 0) {
                const HeldBytes held = bytes_->read(from, n);
                std::memcpy(to, held.bytes().data(), n);
            }
            std::fill_n(to + n, size - n, std::byte{0});
            return true;
        } catch (...) {
            const std::lock_guard lock(mutex_);
            failure_ = std::current_exception();
            return false;
        }
    }

    /// The exception of the read that failed; null if none has.
    std::exception_ptr failure() {
        const std::lock_guard lock(mutex_);
        return failure_;
    }

  private:
    std::shared_ptr<const StoreBytes> bytes_;
    HeldBlocks blocks_;
    std::vector<ByteRange>* noted_ = nullptr;
    std::thread::id noting_;
    std::mutex mutex_;
    std::exception_ptr failure_;
};

/// What isonest's drivers have in common: the name, the size of addresses, and how file space is
/// divided. `value`: one of those free for private drivers (HDF5 1.13 and newer).
H5FD_class_t private_driver_class(const char* name, [[maybe_unused]] int value) {
    constexpr haddr_t kMaxAddress = (haddr_t{1} << 63U) - 1;
    H5FD_class_t c{};
#if H5_VERSION_GE(1, 13, 0)
    c.version = H5FD_CLASS_VERSION;
    c.value = static_cast<H5FD_class_value_t>(value);
#endif
    c.name = name;
    c.maxaddr = kMaxAddress;
    c.fc_degree = H5F_CLOSE_WEAK;
    constexpr H5FD_mem_t kMap[] = H5FD_FLMAP_DICHOTOMY;
    std::copy(std::begin(kMap), std::end(kMap), std::begin(c.fl_map));
    return c;
}

/// Passed to the driver when it opens a file. HDF5 copies it.
struct BytesToOpen {
    const std::shared_ptr<ReadBytes>* bytes = nullptr;
};

/// HDF5 sees only the first member.
struct BytesFile {
    H5FD_t base{};
    std::shared_ptr<ReadBytes> bytes;
    haddr_t end_of_space = 0;  ///< of the space that HDF5 assumes to exist
};

BytesFile& bytes_file(H5FD_t* file) {
    return *reinterpret_cast<BytesFile*>(file);
}
const BytesFile& bytes_file(const H5FD_t* file) {
    return *reinterpret_cast<const BytesFile*>(file);
}

H5FD_t* fail_to_open(const char* why) {
    H5Epush2(H5E_DEFAULT, __FILE__, "bytes_driver", __LINE__, H5E_ERR_CLS, H5E_VFL,
             H5E_CANTOPENFILE, "%s", why);
    return nullptr;
}

/// While open_hdf5() runs, the properties contain a pointer to the bytes to read. HDF5 opens other
/// files that a file refers to with the same driver, but without that pointer.
H5FD_t* open_bytes(const char* /*name*/, unsigned flags, hid_t access, haddr_t /*most*/) {
    if ((flags & (H5F_ACC_RDWR | H5F_ACC_CREAT | H5F_ACC_TRUNC)) != 0) {
        return fail_to_open("these bytes are read-only");
    }
    const auto* const info = static_cast<const BytesToOpen*>(H5Pget_driver_info(access));
    if (info == nullptr) {
        return fail_to_open("another file, which is not opened");
    }
    auto* const file = new (std::nothrow) BytesFile;
    if (file == nullptr) {
        return fail_to_open("no memory");
    }
    file->bytes = *info->bytes;
    return &file->base;
}

herr_t close_bytes(H5FD_t* file) {
    delete &bytes_file(file);
    return 0;
}

/// No two files are equal: a failure belongs only to the file for which it occurred.
int compare_bytes(const H5FD_t* a, const H5FD_t* b) {
    return a == b ? 0 : std::less<>()(a, b) ? -1 : 1;
}

herr_t query_bytes(const H5FD_t* /*file*/, unsigned long* flags) {
    *flags =
        H5FD_FEAT_ACCUMULATE_METADATA | H5FD_FEAT_DATA_SIEVE | H5FD_FEAT_DEFAULT_VFD_COMPATIBLE;
    return 0;
}

haddr_t bytes_end_of_space(const H5FD_t* file, H5FD_mem_t /*kind*/) {
    return bytes_file(file).end_of_space;
}
herr_t set_bytes_end_of_space(H5FD_t* file, H5FD_mem_t /*kind*/, haddr_t end) {
    bytes_file(file).end_of_space = end;
    return 0;
}
haddr_t bytes_end_of_file(const H5FD_t* file, H5FD_mem_t /*kind*/) {
    return bytes_file(file).bytes->size();
}

herr_t hand_out(H5FD_t* file, hid_t /*access*/, void** handle) {
    *handle = bytes_file(file).bytes.get();
    return 0;
}

herr_t read_bytes(H5FD_t* file, H5FD_mem_t kind, hid_t /*transfer*/, haddr_t from, std::size_t size,
                  void* to) {
    if (kind == H5FD_MEM_DRAW && bytes_file(file).bytes->noted(from, size)) {
        return 0;
    }
    if (bytes_file(file).bytes->read(from, size, static_cast<std::byte*>(to))) {
        return 0;
    }
    H5Epush2(H5E_DEFAULT, __FILE__, "bytes_driver", __LINE__, H5E_ERR_CLS, H5E_VFL, H5E_READERROR,
             "file read failed");
    return -1;
}

/// HDF5 requires this function of each driver.
herr_t refuse_to_write(H5FD_t* /*file*/, H5FD_mem_t /*kind*/, hid_t /*transfer*/, haddr_t /*to*/,
                       std::size_t /*size*/, const void* /*from*/) {
    return -1;
}

H5FD_class_t bytes_driver_class() {
    H5FD_class_t c = private_driver_class("isonest_bytes", 601);
    c.fapl_size = sizeof(BytesToOpen);
    c.open = open_bytes;
    c.close = close_bytes;
    c.cmp = compare_bytes;
    c.query = query_bytes;
    c.get_eoa = bytes_end_of_space;
    c.set_eoa = set_bytes_end_of_space;
    c.get_eof = bytes_end_of_file;
    c.get_handle = hand_out;
    c.read = read_bytes;
    c.write = refuse_to_write;
    return c;
}

hid_t bytes_driver() {
    static const H5FD_class_t kind = bytes_driver_class();
    static const hid_t driver = H5FDregister(&kind);
    return driver;
}

}  // namespace

void close_nothing_at_exit() {
    static const herr_t left_alone = H5dont_atexit();
    static_cast<void>(left_alone);
}

FileHandle open_hdf5(std::shared_ptr<const StoreBytes> bytes) {
    close_nothing_at_exit();
    start_hdf5();
    require_heap_to_open_hdf5();
    const std::string name = bytes->name();
    const auto reads = std::make_shared<ReadBytes>(std::move(bytes));
    const BytesToOpen info{&reads};
    const PropertyHandle access(H5Pcreate(H5P_FILE_ACCESS));
    H5Pset_driver(access.get(), bytes_driver(), &info);
    FileHandle file(H5Fopen(name.c_str(), H5F_ACC_RDONLY, access.get()));
    if (const std::exception_ptr failure = reads->failure()) {
        std::rethrow_exception(failure);
    }
    return file;
}

namespace {

/// The bytes from which an object is read; null if its file was opened by path.
ReadBytes* reads_of(hid_t object) {
    const QuietHdf5 quiet;
    const FileHandle whole(H5Iget_file_id(object));
    const PropertyHandle access(whole.valid() ? H5Fget_access_plist(whole.get()) : H5I_INVALID_HID);
    if (!access.valid() || H5Pget_driver(access.get()) != bytes_driver()) {
        return nullptr;
    }
    void* handle = nullptr;
    return H5Fget_vfd_handle(whole.get(), H5P_DEFAULT, &handle) < 0
               ? nullptr
               : static_cast<ReadBytes*>(handle);
}

}  // namespace

bool is_of_bytes(hid_t object) {
    return reads_of(object) != nullptr;
}

std::vector<ByteRange> raw_reads_of(hid_t file, const std::function<void()>& f) {
    std::vector<ByteRange> ranges;
    ReadBytes& reads = *reads_of(file);
    reads.note(&ranges);
    try {
        f();
    } catch (...) {
        reads.note(nullptr);
        throw;
    }
    reads.note(nullptr);
    return ranges;
}

void rethrow_failed_read(hid_t file) {
    ReadBytes* const reads = reads_of(file);
    const std::exception_ptr failure = reads == nullptr ? nullptr : reads->failure();
    if (failure != nullptr) {
        std::rethrow_exception(failure);
    }
}

namespace {

/// Passed to the driver when it opens a file. HDF5 copies it.
struct WritesToPlan {
    PlannedWrites* writes = nullptr;
};

/// HDF5 sees only the first member.
struct PlannedFile {
    H5FD_t base{};
    PlannedWrites* writes = nullptr;
    int fd = -1;
    haddr_t end_of_space = 0;  ///< of the space that HDF5 has allocated
    haddr_t end_of_file = 0;   ///< as if nothing had been dropped
    struct stat status {};
};

PlannedFile& planned(H5FD_t* file) {
    return *reinterpret_cast<PlannedFile*>(file);
}
const PlannedFile& planned(const H5FD_t* file) {
    return *reinterpret_cast<const PlannedFile*>(file);
}

/// Reports in the form of HDF5's own driver, so that hdf5_message() finds the system's message.
herr_t report(const char* what, int error) {
    H5Epush2(H5E_DEFAULT, __FILE__, "planned_writes", __LINE__, H5E_ERR_CLS, H5E_VFL,
             H5E_WRITEERROR, "%s: error message = '%s'", what, std::strerror(error));
    return -1;
}

H5FD_t* open_planned(const char* name, unsigned flags, hid_t access, haddr_t /*most*/) {
    const auto has = [&](unsigned flag) { return (flags & flag) != 0; };
    const int how = (has(H5F_ACC_RDWR) ? O_RDWR : O_RDONLY) | (has(H5F_ACC_CREAT) ? O_CREAT : 0) |
                    (has(H5F_ACC_EXCL) ? O_EXCL : 0) | (has(H5F_ACC_TRUNC) ? O_TRUNC : 0);
    auto file = std::make_unique<PlannedFile>();
    file->fd = open_shared(name, how | O_CLOEXEC, 0666);
    if (file->fd < 0) {
        report("unable to open file", errno);
        return nullptr;
    }
    const auto* const info = static_cast<const WritesToPlan*>(H5Pget_driver_info(access));
    if (info == nullptr || ::fstat(file->fd, &file->status) != 0) {
        report("unable to look at the file", errno);
        ::close(file->fd);
        return nullptr;
    }
    file->writes = info->writes;
    file->end_of_file = static_cast<haddr_t>(file->status.st_size);
    return &file.release()->base;
}

herr_t close_planned(H5FD_t* file) {
    const std::unique_ptr<PlannedFile> owned(&planned(file));
    return ::close(owned->fd) == 0 ? 0 : report("unable to close file", errno);
}

int compare_planned(const H5FD_t* a, const H5FD_t* b) {
    const struct stat& left = planned(a).status;
    const struct stat& right = planned(b).status;
    if (left.st_dev != right.st_dev) {
        return left.st_dev < right.st_dev ? -1 : 1;
    }
    return left.st_ino == right.st_ino ? 0 : left.st_ino < right.st_ino ? -1 : 1;
}

/// The flags of the default driver that control how space is allocated.
herr_t query_planned(const H5FD_t* /*file*/, unsigned long* flags) {
    *flags = H5FD_FEAT_AGGREGATE_METADATA | H5FD_FEAT_ACCUMULATE_METADATA | H5FD_FEAT_DATA_SIEVE |
             H5FD_FEAT_AGGREGATE_SMALLDATA | H5FD_FEAT_DEFAULT_VFD_COMPATIBLE;
    return 0;
}

haddr_t end_of_space(const H5FD_t* file, H5FD_mem_t /*kind*/) {
    return planned(file).end_of_space;
}
herr_t set_end_of_space(H5FD_t* file, H5FD_mem_t /*kind*/, haddr_t end) {
    planned(file).end_of_space = end;
    return 0;
}
haddr_t end_of_file(const H5FD_t* file, H5FD_mem_t /*kind*/) {
    return planned(file).end_of_file;
}

/// Reads zeros past the end.
herr_t read_planned(H5FD_t* file, H5FD_mem_t /*kind*/, hid_t /*transfer*/, haddr_t from,
                    std::size_t size, void* to) {
    auto* out = static_cast<std::byte*>(to);
    while (size > 0) {
        const ssize_t n = ::pread(planned(file).fd, out, size, static_cast<off_t>(from));
        if (n < 0 && errno == EINTR) {
            continue;
        }
        if (n < 0) {
            return report("file read failed", errno);
        }
        if (n == 0) {
            std::fill_n(out, size, std::byte{0});
            return 0;
        }
        out += n;
        from += static_cast<haddr_t>(n);
        size -= static_cast<std::size_t>(n);
    }
    return 0;
}

herr_t write_planned(H5FD_t* file, H5FD_mem_t kind, hid_t /*transfer*/, haddr_t to,
                     std::size_t size, const void* from) {
    PlannedFile& f = planned(file);
    f.end_of_file = std::max(f.end_of_file, to + size);
    if (kind == H5FD_MEM_DRAW && f.writes->drops_raw) {
        f.writes->last = to;
        return 0;
    }
    const auto* bytes = static_cast<const std::byte*>(from);
    while (size > 0) {
        const ssize_t n = ::pwrite(f.fd, bytes, size, static_cast<off_t>(to));
        if (n < 0 && errno == EINTR) {
            continue;
        }
        if (n <= 0) {
            return report("file write failed", n == 0 ? ENOSPC : errno);
        }
        bytes += n;
        to += static_cast<haddr_t>(n);
        size -= static_cast<std::size_t>(n);
    }
    return 0;
}

herr_t truncate_planned(H5FD_t* file, hid_t /*transfer*/, hbool_t /*closing*/) {
    PlannedFile& f = planned(file);
    if (f.end_of_space != f.end_of_file) {
        if (::ftruncate(f.fd, static_cast<off_t>(f.end_of_space)) != 0) {
            return report("unable to extend file properly", errno);
        }
        f.end_of_file = f.end_of_space;
    }
    return 0;
}

H5FD_class_t driver_class() {
    H5FD_class_t c = private_driver_class("isonest_planned", 600);
    c.fapl_size = sizeof(WritesToPlan);
    c.open = open_planned;
    c.close = close_planned;
    c.cmp = compare_planned;
    c.query = query_planned;
    c.get_eoa = end_of_space;
    c.set_eoa = set_end_of_space;
    c.get_eof = end_of_file;
    c.read = read_planned;
    c.write = write_planned;
    c.truncate = truncate_planned;
    return c;
}

}  // namespace

void use_planned_writes(const PropertyHandle& access, PlannedWrites& writes) {
    static const H5FD_class_t kind = driver_class();
    static const hid_t driver = H5FDregister(&kind);
    const WritesToPlan info{&writes};
    H5Pset_driver(access.get(), driver, &info);
}

}  // namespace isonest::detail
